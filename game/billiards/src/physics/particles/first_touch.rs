//! First touch of balls and particles that lie: up to it a shot is as if there were no particles.

use glam::DVec3;

use super::ParticleBed;
use super::height_map::HeightMap;
use crate::physics::event::EventKind;
use crate::physics::shot::Shot;
use crate::physics::trajectory::Trajectory;

impl Shot {
    /// Until when each ball of this shot, which was simulated without particles, goes as it would with those of `bed`, in
    /// s: until it touches some, or a ball that had. Infinite for a ball that does neither.
    pub fn known_until_secs(&self, bed: &ParticleBed) -> Vec<f64> {
        let end_secs = self.duration_secs();
        let trajectories = self.trajectories();
        let touches = trajectories
            .iter()
            .map(|ball| first_touch_secs(bed.heights(), ball, end_secs));
        let mut known: Vec<f64> = touches.collect();
        let index = |number: u8| trajectories.iter().position(|ball| ball.number() == number);
        // In the order of time: a ball that has touched particles passes the difference on with each
        // contact.
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

/// When a ball that moves first touches particles; infinite if it does not.
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

/// Between two looks: a ball of 5 m/s goes 5 mm.
const STEP_SECS: f64 = 1e-3;
/// Of one motion: the longest roll takes longer steps, at less speed.
const STEPS_MAX: f64 = 20_000.0;
