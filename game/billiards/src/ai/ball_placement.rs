//! Placement of a cue ball in hand, by the computer.

use glam::DVec2;

use super::{Position, pot_candidates::pot_candidates, skill::Skill};
use crate::deterministic_math::unit_at;
use crate::rules::{BallPosition, BallPositions, PlacementArea, place_of};

/// The best place for the cue ball: behind a ball that is on, in line with a pocket or slightly off it,
/// where the chance of the pot is greatest; none if its present place is as good. Ties go to the first.
pub(crate) fn best_placement(
    position: &Position,
    area: PlacementArea,
    skill: &Skill,
) -> Option<DVec2> {
    let positions = position.ball_positions();
    let others: BallPositions = positions.iter().filter(|p| p.ball != 0).copied().collect();
    let on = position.referee.legal_targets(&positions);
    let layout = &position.layout;
    let chance = |at: DVec2| {
        let mut positions = others.clone();
        positions.push(BallPosition { ball: 0, at });
        let found = pot_candidates(layout, &positions, &on, skill);
        found.first().map_or(0.0, |line| line.chance)
    };
    let stays = place_of(&positions, 0);
    let mut best = stays.map_or((-1.0, None), |at| (chance(at), None));
    for at in placement_candidates(position, &others, &on) {
        if layout.may_place(&others, at, area).is_ok() {
            let chance = chance(at);
            if chance > best.0 + 1e-6 {
                best = (chance, Some(at));
            }
        }
    }
    best.1
}

fn placement_candidates(position: &Position, others: &BallPositions, on: &[u8]) -> Vec<DVec2> {
    let layout = &position.layout;
    let mut placement_candidates = Vec::new();
    for object in others.iter().filter(|p| on.contains(&p.ball)) {
        for pocket in &layout.pockets {
            // Opposite to the pocket as seen from the object ball: a straight pot, and cuts of up to
            // 35°.
            let Some(way) = (object.at - *pocket).try_normalize() else {
                continue;
            };
            for turn_deg in [0.0f64, 15.0, -15.0, 35.0, -35.0] {
                let way = unit_at(turn_deg.to_radians()).rotate(way);
                placement_candidates.extend(DISTANCES_M.map(|distance| object.at + distance * way));
            }
        }
    }
    // A grid over the area itself, for balls that can only be reached from afar.
    let half = 0.5 * DVec2::new(layout.length_m, layout.width_m);
    for i in 0..4 {
        for j in -3..=3 {
            let share = DVec2::new(-1.0 + 0.12 * f64::from(i) + 0.06, 0.28 * f64::from(j));
            placement_candidates.push(half * share);
        }
    }
    let (centre, radius) = (layout.baulk_spot(), layout.d_radius_m());
    placement_candidates
        .extend([-0.9, -0.45, 0.0, 0.45, 0.9].map(|y| centre + DVec2::new(0.0, y * radius)));
    placement_candidates.truncate(PLACES_MAX);
    placement_candidates
}

/// Distances of candidate places from the object ball.
const DISTANCES_M: [f64; 3] = [0.2, 0.4, 0.7];
/// Maximum number of candidates, which bounds the time.
const PLACES_MAX: usize = 1600;
