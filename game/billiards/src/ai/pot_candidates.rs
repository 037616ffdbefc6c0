//! Straight pots: from the cue ball by a ghost ball to a pocket, and how likely each is.

use glam::DVec2;

use super::skill::Skill;
use crate::rules::{Ground, Placed};

/// A straight way from the cue ball by an object ball to a pocket, clear of other balls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Line {
    pub(crate) ball: u8,
    pub(crate) pocket: usize,
    /// Direction of the cue, in rad.
    pub(crate) bearing_rad: f64,
    /// Unit vector from the object ball to the pocket.
    pub(crate) to_pocket: DVec2,
    /// By how much the object ball's way turns for a turn of the cue's.
    pub(crate) lever: f64,
    /// How far the balls go together, in m.
    pub(crate) length_m: f64,
    /// The chance to pot it, by geometry and the player's error of direction.
    pub(crate) chance: f64,
}

/// The straight pots of `targets`, likeliest first.
pub(crate) fn lines(ground: &Ground, lie: &[Placed], targets: &[u8], skill: &Skill) -> Vec<Line> {
    let Some(cue) = lie.iter().find(|p| p.ball == 0).map(|p| p.at) else {
        return Vec::new();
    };
    let mut lines = Vec::new();
    for object in lie.iter().filter(|p| targets.contains(&p.ball)) {
        for pocket in 0..ground.pockets.len() {
            lines.extend(line(ground, lie, (cue, object, pocket), skill));
        }
    }
    lines.sort_by(|a, b| b.chance.total_cmp(&a.chance));
    lines
}

fn line(
    ground: &Ground,
    lie: &[Placed],
    (cue, object, pocket): (DVec2, &Placed, usize),
    skill: &Skill,
) -> Option<Line> {
    let reach = ground.radius_m + ground.cue_radius_m;
    let hole = ground.pockets[pocket];
    let way = hole - object.at;
    let to_pocket = way.try_normalize()?;
    let ghost = object.at - reach * to_pocket;
    let to_ghost = ghost - cue;
    let cos_cut = to_ghost.try_normalize()?.dot(to_pocket);
    if cos_cut < COS_CUT_MIN {
        return None;
    }
    let half_m = opening_m(ground, hole, to_pocket)?;
    let others = |ball: u8| ball != 0 && ball != object.ball;
    let is_clear = ground.is_clear(lie, (cue, ghost), ground.cue_radius_m, others)
        && ground.is_clear(lie, (object.at, hole), ground.radius_m, others);
    let lever = to_ghost.length() / (reach * cos_cut);
    let off_m = skill.direction_rad() * lever * way.length();
    is_clear.then(|| Line {
        ball: object.ball,
        pocket,
        bearing_rad: to_ghost.to_angle(),
        to_pocket,
        lever,
        length_m: to_ghost.length() + way.length(),
        chance: within(half_m / off_m.max(1e-9)),
    })
}

/// By how much a ball's centre may be off when it comes to a pocket, in m: less for a side pocket that
/// is not approached straight; none where it would meet the cushion first.
fn opening_m(ground: &Ground, hole: DVec2, to_pocket: DVec2) -> Option<f64> {
    let is_side = hole.x.abs() < 0.2 * ground.length_m;
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
    let mouth = if ground.radius_m < SNOOKER_RADIUS_M {
        0.45
    } else {
        0.9
    };
    (cos > least).then_some(mouth * ground.radius_m * cos)
}

/// The share of a normal distribution within so many deviations of its mean: erf(x/√2), by the
/// approximation of Winitzki (2008), off by less than 0.00012.
fn within(deviations: f64) -> f64 {
    let square = 0.5 * deviations * deviations;
    let a = 0.147;
    let inner = -square * (4.0 / std::f64::consts::PI + a * square) / (1.0 + a * square);
    (1.0 - inner.exp()).max(0.0).sqrt()
}

/// Cuts of more than 80° are left out.
const COS_CUT_MIN: f64 = 0.17;
const COS_SIDE_MIN: f64 = 0.5;
const COS_CORNER_MIN: f64 = 0.7;
/// Between the balls of snooker, 26.25 mm, and those of pool.
const SNOOKER_RADIUS_M: f64 = 0.0275;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ai::Level;
    use crate::physics::Table;
    use crate::shot_report::ground;

    #[test]
    fn the_normal_distribution_is_known() {
        for (x, share) in [(0.5, 0.382_925), (1.0, 0.682_689), (2.0, 0.954_500)] {
            assert!((within(x) - share).abs() < 2e-4, "{x}");
        }
    }

    #[test]
    fn near_straight_pots_come_first_and_blocked_ones_not_at_all() {
        let ground = ground(&Table::nine_foot());
        let at = |ball, x, y| Placed {
            ball,
            at: DVec2::new(x, y),
        };
        let mut lie = vec![at(0, 0.8, 0.165), at(5, 1.1, 0.465), at(6, -0.6, -0.3)];
        let skill = Skill::from(Level::Medium);
        let found = lines(&ground, &lie, &[5, 6], &skill);
        assert_eq!(found[0].ball, 5);
        assert!(found[0].chance > 0.9 && found.is_sorted_by(|a, b| a.chance >= b.chance));
        lie.push(at(7, 1.2, 0.565));
        let blocked = lines(&ground, &lie, &[5], &skill);
        assert!(blocked.iter().all(|line| line.pocket != found[0].pocket));
    }
}
