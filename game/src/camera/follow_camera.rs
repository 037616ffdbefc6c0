//! Path of a camera that follows the balls of a shot.

use carom_billiards::physics::{BallPose, Shot};
use glam::DVec3;

use super::smoothstep;

/// Focus of a camera that follows the cue ball until it rests, and then the ball that rests last.
///
/// The whole shot is known, so the path is smoothed with a centred filter: the camera turns before a
/// cushion is hit. It is a function of the shot's time alone, so that frames of future moments can be
/// requested.
#[derive(Clone, Debug)]
pub struct FollowCamera {
    /// Points on the cloth every [`STEP_SECS`] from the stroke on, in m.
    focus: Vec<DVec3>,
    cuts: bool,
}

impl FollowCamera {
    /// The path for `shot`; with `cuts` the camera rests and jumps when the ball leaves the middle of the
    /// picture.
    pub fn new(shot: &Shot, cuts: bool) -> Self {
        let count = (shot.duration_secs() / STEP_SECS).ceil() as usize + 1;
        let poses: Vec<Vec<BallPose>> = (0..count)
            .map(|step| shot.poses_at(step as f64 * STEP_SECS))
            .collect();
        let focus = if cuts {
            stepped(&followed(&poses, 1.0))
        } else {
            smoothed(&smoothed(&followed(&poses, TURN_STEPS)))
        };
        Self { focus, cuts }
    }

    /// The focus at a moment of the shot, in m.
    pub fn at(&self, moment_secs: f64) -> DVec3 {
        let last = self.focus.len() - 1;
        let step = (moment_secs / STEP_SECS).clamp(0.0, last as f64);
        let from = step as usize;
        let share = if self.cuts { 0.0 } else { step.fract() };
        self.focus[from].lerp(self.focus[(from + 1).min(last)], share)
    }
}

/// Positions of the followed ball at each step, at least one, with a transition of `turn_steps` from one
/// ball to the other.
fn followed(poses: &[Vec<BallPose>], turn_steps: f64) -> Vec<DVec3> {
    let place = |step: usize, ball: usize| poses[step][ball].position.with_z(0.0);
    // The last step in which a ball moved.
    let rests = |ball: usize| {
        let moved = |&step: &usize| {
            poses[step][ball].on_table
                && place(step, ball).distance(place(step - 1, ball)) > STILL_M
        };
        (1..poses.len()).rev().find(moved).unwrap_or(0)
    };
    let balls = poses[0].iter().enumerate();
    let is_cue = |pose: &BallPose| pose.number == 0 && pose.on_table;
    let cue = balls.clone().find(|(_, pose)| is_cue(pose));
    let cue = cue.map(|(ball, _)| (ball, rests(ball)));
    let others = balls.filter(|(_, pose)| pose.number != 0 && pose.on_table);
    let others = others.map(|(ball, _)| (ball, rests(ball)));
    let last = others.max_by_key(|(_, rests)| *rests);
    let at = |step: usize, (ball, rests): (usize, usize)| place(step.min(rests), ball);
    let looked_at = |step: usize| match (cue, last) {
        (Some(cue), Some(last)) if last.1 > cue.1 => {
            let share = step.saturating_sub(cue.1) as f64 / turn_steps;
            at(step, cue).lerp(at(step, last), smoothstep(share))
        }
        (Some(ball), _) | (None, Some(ball)) => at(step, ball),
        (None, None) => DVec3::ZERO,
    };
    (0..poses.len()).map(looked_at).collect()
}

/// Moving average over [`SMOOTH_STEPS`] to either side, fewer near the ends. The window is symmetric, so
/// that motion at constant velocity is not changed.
fn smoothed(places: &[DVec3]) -> Vec<DVec3> {
    let mean = |step: usize| {
        let reach = SMOOTH_STEPS.min(step).min(places.len() - 1 - step);
        let near = &places[step - reach..=step + reach];
        near.iter().sum::<DVec3>() / near.len() as f64
    };
    (0..places.len()).map(mean).collect()
}

/// Holds each position until the next one is more than [`LEFT_M`] away.
fn stepped(places: &[DVec3]) -> Vec<DVec3> {
    let mut held = places[0];
    let step = |place: &DVec3| {
        if place.distance(held) > LEFT_M {
            held = *place;
        }
        held
    };
    places.iter().map(step).collect()
}

const STEP_SECS: f64 = 1.0 / 30.0;
/// Movement in a step below which a ball rests: 9 mm/s.
const STILL_M: f64 = 3e-4;
const SMOOTH_STEPS: usize = 5;
/// Duration of the transition between balls: 0.8 s.
const TURN_STEPS: f64 = 24.0;
/// Distance of a jump: a ball seen from 1.5 m is then a third of the way from the picture's centre to its
/// edge.
const LEFT_M: f64 = 0.4;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::{Stroke, Table, World};

    fn shot(speed_m_s: f64) -> Shot {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        world.strike(Stroke::straight(0.02, speed_m_s)).unwrap()
    }

    fn place(shot: &Shot, number: u8, moment_secs: f64) -> DVec3 {
        let poses = shot.poses_at(moment_secs);
        let pose = poses.iter().find(|pose| pose.number == number).unwrap();
        pose.position.with_z(0.0)
    }

    #[test]
    fn the_cue_ball_is_followed_and_then_what_rests_last() {
        let shot = shot(7.0);
        let chase = FollowCamera::new(&shot, false);
        let end = shot.duration_secs();
        assert!(chase.at(-1.0).distance(place(&shot, 0, 0.0)) < 1e-9);
        let resting = |number: &u8| {
            let moves = |step: u32| {
                let at = end * f64::from(step) / 2000.0;
                place(&shot, *number, at).distance(place(&shot, *number, end)) > 1e-3
            };
            (0..2000).rev().find(|step| moves(*step)).unwrap_or(0)
        };
        let last = (0..16).max_by_key(resting).unwrap();
        assert!(chase.at(end).distance(place(&shot, last, end)) < 0.05);
    }

    #[test]
    fn a_ball_that_rolls_straight_is_never_left_behind() {
        let shot = shot(1.5);
        let chase = FollowCamera::new(&shot, false);
        for moment in [0.0, 0.1, 0.2, 0.3] {
            let behind_m = chase.at(moment).distance(place(&shot, 0, moment));
            // Sliding, it slows down: by that much over the steps of the mean.
            assert!(behind_m < 0.03, "{behind_m} at {moment}");
        }
    }

    #[test]
    fn the_way_is_smooth_and_with_cuts_it_stands_between_jumps() {
        let shot = shot(7.0);
        let (smooth, cut) = (
            FollowCamera::new(&shot, false),
            FollowCamera::new(&shot, true),
        );
        let (mut stood, mut fastest) = (0, 0.0f64);
        let steps = (shot.duration_secs() * 60.0) as u32;
        for step in 0..steps {
            let [a, b] = [step, step + 1].map(|step| f64::from(step) / 60.0);
            fastest = fastest.max(smooth.at(a).distance(smooth.at(b)) * 60.0);
            stood += u32::from(cut.at(a) == cut.at(b));
        }
        let cue_ball = shot.states_at(0.0)[0].velocity.length();
        assert!(fastest < 1.05 * cue_ball, "{fastest} m/s");
        assert!(steps - stood < 40 && stood < steps, "{stood} of {steps}");
    }
}
