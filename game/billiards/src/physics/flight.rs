//! A ball that touches nothing: a parabola, until it falls onto the cloth, into a pocket or to the
//! floor.
//!
//! A ball leaves the cloth when a blow gives it more than the speed of a hop of [`HOP_LEAST_M`],
//! and comes back to it when its bounce would be lower: the rest of the vertical speed is lost
//! then, so that energy never grows where one law takes over from the other. Spin stays as it is
//! in the air.

use glam::DVec3;

use super::{
    ball::Phase,
    ball_ball::Twist,
    contact_time::FreeFall,
    motion::{Motion, MotionEnd},
    table::Table,
};

/// Lower bounces than this count as lying on the cloth, in m.
pub const HOP_LEAST_M: f64 = 5e-3;

/// The vertical speed of the lowest hop that counts, in m/s.
pub(crate) fn hop_speed_m_s(gravity_m_s2: f64) -> f64 {
    (2.0 * gravity_m_s2 * HOP_LEAST_M).sqrt()
}

/// Where a ball flies and what pulls it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flight<'a> {
    pub(crate) table: &'a Table,
    pub(crate) gravity_m_s2: f64,
    pub(crate) radius_m: f64,
}

impl Flight<'_> {
    /// The way of a ball in the air over the table.
    pub(crate) fn motion(&self, position: DVec3, twist: Twist) -> Motion {
        let pocket_under = |t: f64| {
            let place = (position + t * twist.velocity).truncate();
            self.table.pocket_under(place)
        };
        let lands = self.fall_secs(position.z, twist.velocity.z, self.radius_m);
        match (lands, pocket_under(lands.unwrap_or(0.0))) {
            (_, Some(pocket)) => self.drop_into(pocket, position, twist),
            (lands, None) => self.until(position, twist, lands.unwrap_or(0.0), MotionEnd::Lands),
        }
    }

    /// The way of a ball that falls into a pocket.
    pub(crate) fn drop_into(&self, pocket: usize, position: DVec3, twist: Twist) -> Motion {
        let bottom = -self.table.pockets()[pocket].depth_m;
        let fall = self.fall_secs(position.z, twist.velocity.z, bottom);
        self.until(
            position,
            twist,
            fall.unwrap_or(0.0),
            MotionEnd::Sinks(pocket),
        )
    }

    /// The way of a ball that has left the table, down to the floor.
    pub(crate) fn fall_to_floor(&self, position: DVec3, twist: Twist) -> Motion {
        let floor = self.radius_m - self.table.bed_height_m();
        let fall = self.fall_secs(position.z, twist.velocity.z, floor);
        self.until(position, twist, fall.unwrap_or(0.0), MotionEnd::HitsFloor)
    }

    fn until(&self, position: DVec3, twist: Twist, duration_secs: f64, end: MotionEnd) -> Motion {
        Motion {
            phase: Phase::Airborne,
            position,
            velocity: twist.velocity,
            spin: twist.spin,
            acceleration: -self.gravity_m_s2 * DVec3::Z,
            spin_acceleration: DVec3::ZERO,
            duration_secs,
            radius_m: self.radius_m,
            end,
        }
    }

    /// When a height is passed on the way down; none for a ball below it that will not rise to it.
    fn fall_secs(&self, height: f64, speed: f64, to: f64) -> Option<f64> {
        FreeFall {
            above_m: height - to,
            speed_m_s: speed,
            gravity_m_s2: self.gravity_m_s2,
        }
        .ends_secs()
    }
}
