//! Candidate strokes that only aim to hit a ball, for breaks, safeties and escapes; for carom, strokes
//! in all directions.

use std::f64::consts::TAU;

use glam::DVec2;

use super::Position;
use crate::deterministic_math::{angle_of, asin};
use crate::physics::Stroke;
use crate::rng::CounterRng;
use crate::rules::{RuleSet, place_of};

/// Candidate strokes, `count` at most, drawn at random: half of them directly at a ball that is on,
/// full or thin, half in any direction, for paths via cushions.
pub(crate) fn contact_candidates(
    position: &Position,
    count: u32,
    rng: &mut CounterRng,
) -> Vec<Stroke> {
    let positions = position.ball_positions();
    let on = position.referee.legal_targets(&positions);
    let Some(cue) = place_of(&positions, 0) else {
        return Vec::new();
    };
    let reach = position.layout.radius_m + position.layout.cue_radius_m;
    let mut targets: Vec<DVec2> = positions
        .iter()
        .filter(|p| on.contains(&p.ball))
        .map(|p| p.at)
        .collect();
    targets.sort_by(|a, b| a.distance(cue).total_cmp(&b.distance(cue)));
    if position.referee.is_break() {
        return breaks(position, cue, &targets, reach, count.min(HITS_MAX), rng);
    }
    let count = count.min(HITS_MAX);
    let is_carom = position.referee.rules() == RuleSet::ThreeCushion;
    (0..count)
        .map(|i| {
            let target = targets.get(i as usize / 2 % targets.len().max(1));
            let (bearing_rad, speeds) = match target {
                Some(&target) if i % 2 == 0 || is_carom => (
                    towards(cue, target, reach, 2.0 * rng.unit() - 1.0),
                    (0.6, 3.5),
                ),
                _ => (TAU * rng.unit(), (1.0, 4.0)),
            };
            if is_carom {
                carom(bearing_rad, i, rng)
            } else {
                let speed = speeds.0 + (speeds.1 - speeds.0) * rng.unit();
                Stroke {
                    vertical: 0.6 * (rng.unit() - 0.5),
                    ..Stroke::straight(bearing_rad, speed)
                }
            }
        })
        .collect()
}

/// A candidate for carom: paths round the table are long and need side.
fn carom(bearing_rad: f64, i: u32, rng: &mut CounterRng) -> Stroke {
    let bearing_rad = if i % 3 == 2 {
        TAU * rng.unit()
    } else {
        bearing_rad
    };
    Stroke {
        side: 0.8 * (rng.unit() - 0.5),
        vertical: 0.7 * (rng.unit() - 0.3),
        ..Stroke::straight(bearing_rad, 2.0 + 3.5 * rng.unit())
    }
}

/// Direction in rad in which the cue ball hits a ball: full for a `thin` of 0, at its right edge for 1.
fn towards(cue: DVec2, target: DVec2, reach: f64, thin: f64) -> f64 {
    let way = target - cue;
    // Half the angle that the circle of contact subtends at the cue ball.
    let half = asin(reach / way.length().max(reach));
    // At the full angle the balls just graze, and rounding would decide whether they touch.
    angle_of(way) - 0.97 * thin * half
}

/// Candidates for a break: hard and full where it should spread the balls, soft and thin where it
/// should not.
fn breaks(
    position: &Position,
    cue: DVec2,
    targets: &[DVec2],
    reach: f64,
    count: u32,
    rng: &mut CounterRng,
) -> Vec<Stroke> {
    let is_hard = matches!(
        position.referee.rules(),
        RuleSet::Eight | RuleSet::Nine | RuleSet::Free
    );
    if position.referee.rules() == RuleSet::ThreeCushion {
        let red = targets.first().copied().unwrap_or(DVec2::X);
        return (0..count)
            .map(|i| {
                let thin = 2.0 * rng.unit() - 1.0;
                let stroke = carom(towards(cue, red, reach, thin), 0, rng);
                // Every other one a third harder.
                let factor = if i % 2 == 1 { 1.33 } else { 1.0 };
                Stroke {
                    speed_m_s: stroke.speed_m_s * factor,
                    ..stroke
                }
            })
            .collect();
    }
    let corners = if is_hard { 1 } else { targets.len() };
    (0..count.min(BREAKS_MAX))
        .filter_map(|i| {
            let target = *targets.get(i as usize % corners.max(1))?;
            let (thin, speed) = if is_hard {
                (0.1 * (rng.unit() - 0.5), 7.5 + 2.0 * rng.unit())
            } else {
                let edge = if rng.unit() < 0.5 { 1.0 } else { -1.0 };
                (edge * (0.4 + 0.55 * rng.unit()), 1.5 + 2.0 * rng.unit())
            };
            Some(Stroke::straight(towards(cue, target, reach, thin), speed))
        })
        .collect()
}

/// Maximum number of candidates: more find nothing better, and each takes memory.
const HITS_MAX: u32 = 5000;
/// Maximum number of candidates for a break, which is expensive to simulate.
const BREAKS_MAX: u32 = 24;
