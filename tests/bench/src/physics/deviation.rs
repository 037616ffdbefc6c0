//! Deviation of a simulated shot from its reference.

use super::reference::{BallSamples, ReferenceKind, ReferenceShot};
use carom_billiards::physics::{BallState, Shot};

/// Deviation of a shot from its reference, over the time in which they are comparable.
#[derive(Clone, Copy, Debug, Default)]
pub struct Deviation {
    /// Largest distance of any ball at any sample, in m.
    pub max_m: f64,
    /// Root of the mean square of the distances, in m.
    pub rms_m: f64,
    /// For a cluster, the difference of velocity of the ball that takes the impact, once no balls touch
    /// any more, in m/s; 0 for other kinds.
    pub fastest_m_s: f64,
    /// The largest such difference of any ball.
    pub velocity_m_s: f64,
    /// Number of balls that end on the table in one and in a pocket in the other.
    pub pocketed_differently: usize,
    /// First sampled time at which a ball is over 1 mm off.
    pub parts_at_secs: Option<f64>,
}

impl Deviation {
    /// Deviation of a simulation of the shot from the reference.
    pub fn between(reference: &ReferenceShot, shot: &Shot) -> Self {
        let mut deviation = Self::default();
        let (mut sum, mut count) = (0.0, 0.0f64);
        for (sample, &t) in reference.times.iter().enumerate() {
            let states = shot.states_at(t);
            for (ball, state) in pairs(reference, &states) {
                if ball.pocketed[sample] || !state.phase.is_on_table() {
                    continue;
                }
                let off = state.position.distance(ball.positions[sample]);
                deviation.max_m = deviation.max_m.max(off);
                sum += off * off;
                count += 1.0;
                if off > PART_M && deviation.parts_at_secs.is_none() {
                    deviation.parts_at_secs = Some(t);
                }
            }
        }
        deviation.rms_m = (sum / count.max(1.0)).sqrt();
        if reference.kind == ReferenceKind::Cluster {
            (deviation.fastest_m_s, deviation.velocity_m_s) = after_cluster(reference, shot);
        }
        let ends = shot.final_states();
        let differs = |(ball, end): &(&BallSamples, &BallState)| {
            end.phase.is_on_table() == *ball.pocketed.last().unwrap_or(&false)
        };
        deviation.pocketed_differently = pairs(reference, &ends).filter(differs).count();
        deviation
    }
}

/// Difference of velocity of the fastest ball, and the largest one, once a cluster has separated.
fn after_cluster(reference: &ReferenceShot, shot: &Shot) -> (f64, f64) {
    let Some(sample) = reference.times.iter().position(|&t| t >= CLUSTER_SECS) else {
        return (0.0, 0.0);
    };
    let states = shot.states_at(reference.times[sample]);
    let mut fastest = (0.0, 0.0);
    let mut largest = 0.0f64;
    for (ball, state) in pairs(reference, &states) {
        let velocity = ball.velocities[sample];
        let off = state.velocity.distance(velocity);
        largest = largest.max(off);
        if velocity.length() > fastest.0 {
            fastest = (velocity.length(), off);
        }
    }
    (fastest.1, largest)
}

/// Each ball of a reference with its state in a simulation.
fn pairs<'a>(
    reference: &'a ReferenceShot,
    states: &'a [BallState],
) -> impl Iterator<Item = (&'a BallSamples, &'a BallState)> {
    reference.balls.iter().filter_map(|ball| {
        let state = states.iter().find(|state| state.number == ball.number)?;
        Some((ball, state))
    })
}

/// Distance beyond which two trajectories count as separated.
const PART_M: f64 = 1e-3;
/// Time in s after which no ball of a struck cluster touches another: until then its slow balls press
/// on each other, which depends on each simulator's rule for that.
const CLUSTER_SECS: f64 = 0.5;
