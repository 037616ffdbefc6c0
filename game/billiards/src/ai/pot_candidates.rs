//! Straight pots: cue ball to ghost ball and object ball to pocket, with the chance of each.

use glam::DVec2;

use super::skill::Skill;
use crate::deterministic_math::{angle_of, exp};
use crate::rules::{BallPosition, TableLayout, place_of};

/// A straight path from the cue ball via an object ball to a pocket, clear of other balls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PotCandidate {
    pub(crate) ball: u8,
    pub(crate) pocket: usize,
    /// Direction of the cue, in rad.
    pub(crate) bearing_rad: f64,
    /// Unit vector from the object ball to the pocket.
    pub(crate) to_pocket: DVec2,
    /// Change of the object ball's direction per change of the cue's.
    pub(crate) lever: f64,
    /// Sum of the paths of both balls, in m.
    pub(crate) length_m: f64,
    /// Chance of the pot, from the geometry and the player's error of direction.
    pub(crate) chance: f64,
}

/// The straight pots of `targets`, by falling chance.
pub(crate) fn pot_candidates(
    layout: &TableLayout,
    positions: &[BallPosition],
    targets: &[u8],
    skill: &Skill,
) -> Vec<PotCandidate> {
    let Some(cue) = place_of(positions, 0) else {
        return Vec::new();
    };
    let mut pot_candidates = Vec::new();
    for object in positions.iter().filter(|p| targets.contains(&p.ball)) {
        for pocket in 0..layout.pockets.len() {
            pot_candidates.extend(pot_candidate(
                layout,
                positions,
                (cue, object, pocket),
                skill,
            ));
        }
    }
    pot_candidates.sort_by(|a, b| b.chance.total_cmp(&a.chance));
    pot_candidates
}

fn pot_candidate(
    layout: &TableLayout,
    positions: &[BallPosition],
    (cue, object, pocket): (DVec2, &BallPosition, usize),
    skill: &Skill,
) -> Option<PotCandidate> {
    let reach = layout.radius_m + layout.cue_radius_m;
    let hole = layout.pockets[pocket];
    let way = hole - object.at;
    let to_pocket = way.try_normalize()?;
    let ghost = object.at - reach * to_pocket;
    let to_ghost = ghost - cue;
    let cos_cut = to_ghost.try_normalize()?.dot(to_pocket);
    if cos_cut < COS_CUT_MIN {
        return None;
    }
    // Cheap tests first: whether the paths are clear depends on every ball.
    let half_m = opening_m(layout, hole, to_pocket)?;
    let others = |ball: u8| ball != 0 && ball != object.ball;
    let is_clear = layout.is_clear(positions, (cue, ghost), layout.cue_radius_m, others)
        && layout.is_clear(positions, (object.at, hole), layout.radius_m, others);
    // A turn δ of the cue moves the cue ball sideways by L·δ at the ghost ball, which turns the line of
    // centres by L·δ over the sum of the radii and the cosine of the cut.
    let lever = to_ghost.length() / (reach * cos_cut);
    let off_m = skill.direction_rad() * lever * way.length();
    is_clear.then(|| PotCandidate {
        ball: object.ball,
        pocket,
        bearing_rad: angle_of(to_ghost),
        to_pocket,
        lever,
        length_m: to_ghost.length() + way.length(),
        chance: within(half_m / off_m.max(1e-9)),
    })
}

/// Tolerance of a ball's centre at a pocket, in m: less for a side pocket that is not approached
/// straight; none where the ball would meet the cushion first.
fn opening_m(layout: &TableLayout, hole: DVec2, to_pocket: DVec2) -> Option<f64> {
    let is_side = hole.x.abs() < 0.2 * layout.length_m;
    let straight = if is_side {
        DVec2::new(0.0, hole.y.signum())
    } else {
        DVec2::new(hole.x.signum(), hole.y.signum()).normalize()
    };
    let cos = to_pocket.dot(straight);
    let least = if is_side {
        COS_SIDE_MIN
    } else {
        COS_CORNER_MIN
    };
    // Pockets of pool are two balls wide, those of snooker one and a half.
    let mouth = if layout.radius_m < SNOOKER_RADIUS_M {
        0.45
    } else {
        0.9
    };
    (cos > least).then_some(mouth * layout.radius_m * cos)
}

/// Share of a normal distribution within this many deviations of its mean: erf(x/√2), by the
/// approximation of Winitzki (2008), with an error below 0.00012.
fn within(deviations: f64) -> f64 {
    let square = 0.5 * deviations * deviations;
    let a = 0.147;
    let inner = -square * (4.0 / std::f64::consts::PI + a * square) / (1.0 + a * square);
    (1.0 - exp(inner)).max(0.0).sqrt()
}

/// Cosine of the largest cut angle: about 80°.
const COS_CUT_MIN: f64 = 0.17;
/// Cosines of the largest angles of approach of side and corner pockets: 60° and about 46°.
const COS_SIDE_MIN: f64 = 0.5;
const COS_CORNER_MIN: f64 = 0.7;
/// Ball radius that separates snooker, 26.25 mm, from pool.
const SNOOKER_RADIUS_M: f64 = 0.0275;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ai::Level;
    use crate::physics::Table;
    use crate::shot_report::table_layout;

    #[test]
    fn the_normal_distribution_is_known() {
        for (x, share) in [(0.5, 0.382_925), (1.0, 0.682_689), (2.0, 0.954_500)] {
            assert!((within(x) - share).abs() < 2e-4, "{x}");
        }
    }

    #[test]
    fn nearest_straight_pots_come_first() {
        let layout = table_layout(&Table::nine_foot());
        let at = |ball, x, y| BallPosition {
            ball,
            at: DVec2::new(x, y),
        };
        let mut positions = vec![at(0, 0.8, 0.165), at(5, 1.1, 0.465), at(6, -0.6, -0.3)];
        let skill = Skill::from(Level::Medium);
        let found = pot_candidates(&layout, &positions, &[5, 6], &skill);
        assert_eq!(found[0].ball, 5);
        assert!(found[0].chance > 0.9 && found.is_sorted_by(|a, b| a.chance >= b.chance));
        positions.push(at(7, 1.2, 0.565));
        let blocked = pot_candidates(&layout, &positions, &[5], &skill);
        assert!(blocked.iter().all(|line| line.pocket != found[0].pocket));
    }
}
