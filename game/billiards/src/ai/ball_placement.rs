//! Where to put a cue ball in hand.

use glam::DVec2;

use super::{Position, pot_candidates::lines, skill::Skill};
use crate::rules::{Area, Lie, Placed};

/// The best place for the cue ball: behind a ball that is on, in line with a pocket or a little off it,
/// where the chance of the pot is greatest; none where it lies is as good. Ties go to the first.
pub(crate) fn place(position: &Position, area: Area, skill: &Skill) -> Option<DVec2> {
    let lie = position.lie();
    let others: Lie = lie.iter().filter(|p| p.ball != 0).copied().collect();
    let on = position.referee.on(&lie);
    let ground = &position.ground;
    let chance = |at: DVec2| {
        let mut lie = others.clone();
        lie.push(Placed { ball: 0, at });
        let found = lines(ground, &lie, &on, skill);
        found.first().map_or(0.0, |line| line.chance)
    };
    let stays = lie.iter().find(|p| p.ball == 0).map(|p| p.at);
    let mut best = stays.map_or((-1.0, None), |at| (chance(at), None));
    for at in places(position, &others, &on) {
        if ground.may_place(&others, at, area).is_ok() {
            let chance = chance(at);
            if chance > best.0 + 1e-6 {
                best = (chance, Some(at));
            }
        }
    }
    best.1
}

fn places(position: &Position, others: &Lie, on: &[u8]) -> Vec<DVec2> {
    let ground = &position.ground;
    let mut places = Vec::new();
    for object in others.iter().filter(|p| on.contains(&p.ball)) {
        for pocket in &ground.pockets {
            let Some(way) = (object.at - *pocket).try_normalize() else {
                continue;
            };
            for turn_deg in [0.0f64, 15.0, -15.0, 35.0, -35.0] {
                let way = DVec2::from_angle(turn_deg.to_radians()).rotate(way);
                places.extend(DISTANCES_M.map(|distance| object.at + distance * way));
            }
        }
    }
    // The area's own places, for balls that can only be reached from afar.
    let half = 0.5 * DVec2::new(ground.length_m, ground.width_m);
    for i in 0..4 {
        for j in -3..=3 {
            let share = DVec2::new(-1.0 + 0.12 * f64::from(i) + 0.06, 0.28 * f64::from(j));
            places.push(half * share);
        }
    }
    let (centre, radius) = (ground.baulk_spot(), ground.d_radius_m());
    places.extend([-0.9, -0.45, 0.0, 0.45, 0.9].map(|y| centre + DVec2::new(0.0, y * radius)));
    places.truncate(PLACES_MAX);
    places
}

const DISTANCES_M: [f64; 3] = [0.2, 0.4, 0.7];
/// Bounds the geometry.
const PLACES_MAX: usize = 1600;
