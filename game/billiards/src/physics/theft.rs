//! Balls that go on touching, by the rule of another simulator: so that its shots can be played by
//! its own model.
//!
//! pooltool 0.6 takes contacts one after the other. Two balls that meet are first put a micrometre
//! apart along their ways (its `make_kiss`), which makes some neighbours overlap, whose contact is
//! then at hand. Where the two part by less than a centimetre per second in nearly the same direction,
//! the slower takes a tenth of the other's momentum along the line of centres
//! (`resolve_continually_touching`, by its own words "phenomenological"): they close in again and meet
//! some five thousand times a second. So how hard they rub each other is set by the gap and not by the
//! force between them, and the energy of a contact may grow by a hundredth. The game's own rule is
//! [`Clinging::Parts`]; `carom-bench physics --part references` plays shots by both.

use glam::DVec3;

use super::{
    ball_ball::Twist, ball_in_motion::BallInMotion, contact_time::direction,
    event_engine::EventEngine,
};

/// What becomes of two balls whose contact leaves them together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clinging {
    /// They part at [`super::CLUSTER_SPEED_M_S`]; contacts at one instant are one.
    #[default]
    Parts,
    /// pooltool's rule: the slower takes a tenth of the other's momentum.
    Steals,
}

impl EventEngine<'_> {
    /// A contact of two balls by [`Clinging::Steals`].
    pub(super) fn collide_by_theft(&mut self, first: usize, second: usize) {
        self.kiss(first, second);
        let (normal, [mut one, mut other]) = self.meet(first, second);
        let stolen = stolen_m_s(normal, &one, &other);
        one.velocity += stolen * normal;
        other.velocity -= stolen * normal;
        self.set_off(first, one);
        self.set_off(second, other);
    }

    /// Puts two balls [`GAP_M`] apart: along their ways, or, where those hardly part, along the line
    /// of centres.
    fn kiss(&mut self, first: usize, second: usize) {
        let places = [first, second].map(|ball| self.bodies.position(ball));
        let balls = [first, second].map(|ball| &self.balls[ball]);
        let velocities = balls.map(|ball| ball.twist(self.now).velocity);
        let apart_m = balls[0].body.radius_m + balls[1].body.radius_m + GAP_M;
        let shift = |t: f64| velocities.map(|velocity| t * velocity);
        let middle_moves = |[a, b]: [DVec3; 2]| 0.5 * (a + b).length();
        let moves = time_apart(places, velocities, apart_m)
            .map(shift)
            .filter(|&moves| middle_moves(moves) <= KISS_MOVES_GAPS_MAX * GAP_M)
            .unwrap_or_else(|| {
                let way = direction(places[0], places[1]);
                let missing = apart_m - places[0].distance(places[1]);
                [-0.5 * missing * way, 0.5 * missing * way]
            });
        self.bodies.set_place(first, places[0] + moves[0]);
        self.bodies.set_place(second, places[1] + moves[1]);
    }
}

/// The nearest time at which two balls on straight ways are so far apart.
fn time_apart(places: [DVec3; 2], velocities: [DVec3; 2], apart_m: f64) -> Option<f64> {
    let (way, closing) = (places[1] - places[0], velocities[1] - velocities[0]);
    let (a, half_b) = (closing.length_squared(), closing.dot(way));
    let c = way.length_squared() - apart_m * apart_m;
    let root = (half_b * half_b - a * c).sqrt();
    let times = [(-half_b - root) / a, (-half_b + root) / a];
    times
        .into_iter()
        .filter(|t| t.is_finite())
        .min_by(|one, other| one.abs().total_cmp(&other.abs()))
}

/// What the first ball gains along the `normal` towards the second, which loses as much.
fn stolen_m_s(normal: DVec3, one: &Twist, other: &Twist) -> f64 {
    let [first, second] = [one, other].map(|twist| twist.velocity.dot(normal));
    let (speed, other_speed) = (one.velocity.length(), other.velocity.length());
    let aligned = one.velocity.dot(other.velocity) > ALIGNED_COS_LEAST * speed * other_speed;
    if !aligned || (second - first).abs() >= THEFT_BELOW_M_S {
        return 0.0;
    }
    if first > second {
        -STOLEN_SHARE * first
    } else {
        STOLEN_SHARE * second
    }
}

/// Whether two balls overlap: by [`Clinging::Steals`] that is a contact, even if they part.
pub(super) fn overlap(one: &BallInMotion, other: &BallInMotion, now: f64) -> bool {
    let apart = one.path(now).position - other.path(now).position;
    apart.length() < one.body.radius_m + other.body.radius_m
}

/// Left between two balls that met (`MIN_DIST`).
const GAP_M: f64 = 1e-6;
/// Ways that move the middle by more gaps than this are not followed.
const KISS_MOVES_GAPS_MAX: f64 = 5.0;
/// Balls that part more slowly cling.
const THEFT_BELOW_M_S: f64 = 0.01;
/// Only those that move nearly alike.
const ALIGNED_COS_LEAST: f64 = 0.9;
/// Of the faster ball's speed along the line of centres.
const STOLEN_SHARE: f64 = 0.1;
