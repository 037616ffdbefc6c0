//! Ballistic flight: a ball without contact follows a parabola until it lands on the cloth, falls into
//! a pocket or reaches the floor.
//!
//! A ball leaves the cloth when an impulse gives it more than the vertical speed of a hop of
//! [`HOP_LEAST_M`], and stays on it when its next bounce would be lower: the remaining vertical speed
//! is dropped, so that energy never grows where one law takes over from the other. Spin is constant in
//! the air.

use glam::DVec3;

use super::{
    ball::Phase,
    ball_ball::Twist,
    motion::{Motion, MotionEnd},
    table::Table,
};

/// Height in m below which a bounce counts as lying on the cloth.
pub const HOP_LEAST_M: f64 = 5e-3;

/// The vertical speed of the lowest hop that counts, in m/s.
pub(crate) fn hop_speed_m_s(gravity_m_s2: f64) -> f64 {
    (2.0 * gravity_m_s2 * HOP_LEAST_M).sqrt()
}

/// What determines the flight of a ball.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight<'a> {
    pub(crate) table: &'a Table,
    pub(crate) gravity_m_s2: f64,
    pub(crate) radius_m: f64,
}

impl Flight<'_> {
    /// Motion of an airborne ball over the table: into the pocket under its landing point, else onto
    /// the cloth.
    pub(crate) fn motion(&self, position: DVec3, twist: Twist) -> Motion {
        // Whether it falls into a pocket is decided where it would touch the cloth: over a hole it
        // falls on.
        let lands_secs = self.fall_secs(position, twist, self.radius_m);
        let place = (position + lands_secs * twist.velocity).truncate();
        match self.table.pocket_under(place) {
            Some(pocket) => self.drop_into(pocket, position, twist),
            None => self.fall_to(self.radius_m, MotionEnd::Lands, position, twist),
        }
    }

    /// Motion of a ball that falls into a pocket, to its depth.
    pub(crate) fn drop_into(&self, pocket: usize, position: DVec3, twist: Twist) -> Motion {
        let bottom = -self.table.pockets()[pocket].depth_m;
        self.fall_to(bottom, MotionEnd::Sinks(pocket), position, twist)
    }

    /// Motion of a ball that has left the table, down to the floor.
    pub(crate) fn fall_to_floor(&self, position: DVec3, twist: Twist) -> Motion {
        let floor = self.radius_m - self.table.bed_height_m();
        self.fall_to(floor, MotionEnd::HitsFloor, position, twist)
    }

    fn fall_to(&self, level_m: f64, end: MotionEnd, position: DVec3, twist: Twist) -> Motion {
        Motion {
            phase: Phase::Airborne,
            position,
            velocity: twist.velocity,
            spin: twist.spin,
            acceleration: -self.gravity_m_s2 * DVec3::Z,
            spin_acceleration: DVec3::ZERO,
            duration_secs: self.fall_secs(position, twist, level_m),
            radius_m: self.radius_m,
            end,
        }
    }

    /// Time in s from now at which the centre descends through `level_m`; 0 for a ball below it that
    /// will not rise to it.
    fn fall_secs(&self, position: DVec3, twist: Twist, level_m: f64) -> f64 {
        let speed_m_s = twist.velocity.z;
        let apex_secs = (speed_m_s / self.gravity_m_s2).max(0.0);
        let rise = position.z - level_m + 0.5 * speed_m_s.max(0.0) * apex_secs;
        if rise < 0.0 {
            return 0.0;
        }
        // t = 2 h / (v + √(v² + 2 g h)) is the form of the root without cancellation: from the apex
        // with v = 0 if the ball still rises, otherwise from now with the downward speed.
        let downward = (-speed_m_s).max(0.0);
        let root = (downward * downward + 2.0 * self.gravity_m_s2 * rise).sqrt();
        apex_secs + 2.0 * rise / (downward + root).max(f64::MIN_POSITIVE)
    }
}
