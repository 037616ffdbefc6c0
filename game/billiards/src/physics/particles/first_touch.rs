//! First contact of balls with particles at rest: up to it a shot is the same as without particles.

use glam::DVec3;

use super::ParticleBed;
use super::height_map::HeightMap;
use crate::physics::event::EventKind;
use crate::physics::shot::Shot;
use crate::physics::trajectory::Trajectory;

impl Shot {
    /// Time in s up to which each ball of this shot, which was simulated without particles, moves as it
    /// would with those of `bed`: until it touches particles, or a ball that has touched some. Infinite
    /// for a ball that does neither.
    pub fn known_until_secs(&self, bed: &ParticleBed) -> Vec<f64> {
        let end_secs = self.duration_secs();
        let trajectories = self.trajectories();
        let touches = trajectories
            .iter()
            .map(|ball| first_touch_secs(bed.heights(), ball, end_secs));
        let mut known: Vec<f64> = touches.collect();
        let index = |number: u8| trajectories.iter().position(|ball| ball.number() == number);
        // Events are in time order: a ball that has touched particles passes the difference on with
        // each contact.
        for event in self.events() {
            let EventKind::BallBall { first, second, .. } = event.kind else {
                continue;
            };
            if let (Some(first), Some(second)) = (index(first), index(second))
                && known[first].min(known[second]) < event.time_secs
            {
                known[first] = known[first].min(event.time_secs);
                known[second] = known[second].min(event.time_secs);
            }
        }
        known
    }
}

/// Time in s at which a moving ball first touches particles; infinite if it does not.
fn first_touch_secs(heights: &HeightMap, ball: &Trajectory, end_secs: f64) -> f64 {
    let radius_m = ball.body().radius_m;
    let starts: Vec<_> = ball.segments().map(|(segment, _)| segment).collect();
    let ends = starts.iter().skip(1).map(|next| next.start_secs);
    for (segment, end) in starts
        .iter()
        .zip(ends.chain([ball.end_secs().min(end_secs)]))
    {
        if segment.velocity == DVec3::ZERO && segment.acceleration == DVec3::ZERO {
            continue;
        }
        let duration_secs = end - segment.start_secs;
        let steps = (duration_secs / STEP_SECS).ceil().clamp(1.0, STEPS_MAX);
        for step in 0..=steps as u32 {
            let since = duration_secs * f64::from(step) / steps;
            if heights.touches(segment.position_after(since), radius_m) {
                return segment.start_secs + since;
            }
        }
    }
    f64::INFINITY
}

/// Sampling interval: a ball at 5 m/s moves 5 mm.
const STEP_SECS: f64 = 1e-3;
/// Maximum samples of one motion: only the longest rolls, which are slower, are sampled more coarsely.
const STEPS_MAX: f64 = 20_000.0;
