//! Motion of one ball within one phase: constant accelerations, evaluated in closed form.

use glam::DVec3;

use super::ball::Phase;

/// What ends a [`Motion`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MotionEnd {
    /// The contact point stops slipping: the ball rolls.
    SlipStops,
    /// Rolling stops.
    RollStops,
    /// Spin about the vertical stops.
    SpinStops,
    /// The ball lands on the cloth.
    Lands,
    /// The ball has fallen into the pocket of this index.
    Sinks(usize),
    /// The ball has fallen to the floor of the room.
    HitsFloor,
    /// The ball is at rest: the motion has no end.
    Never,
}

/// Motion of a ball within one phase: exact for 0 ≤ t ≤ `duration_secs`, meaningless after.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    pub(crate) phase: Phase,
    pub(crate) position: DVec3,
    pub(crate) velocity: DVec3,
    pub(crate) spin: DVec3,
    pub(crate) acceleration: DVec3,
    pub(crate) spin_acceleration: DVec3,
    /// Infinite at rest.
    pub(crate) duration_secs: f64,
    pub(crate) radius_m: f64,
    pub(crate) end: MotionEnd,
}

impl Motion {
    pub(crate) fn position_at(&self, t: f64) -> DVec3 {
        self.position + t * (self.velocity + 0.5 * t * self.acceleration)
    }

    pub(crate) fn velocity_at(&self, t: f64) -> DVec3 {
        self.velocity + t * self.acceleration
    }

    pub(crate) fn spin_at(&self, t: f64) -> DVec3 {
        self.spin + t * self.spin_acceleration
    }

    /// Velocity and spin when the phase is over, with what has stopped exactly zero, so that the
    /// next phase does not begin with the round-off of this one.
    pub(crate) fn end_state(&self) -> (DVec3, DVec3) {
        let velocity = self.velocity_at(self.duration_secs);
        let spin = self.spin_at(self.duration_secs);
        match self.end {
            MotionEnd::SlipStops => (velocity, rolling_spin(velocity, spin.z, self.radius_m)),
            MotionEnd::RollStops => (DVec3::ZERO, DVec3::new(0.0, 0.0, spin.z)),
            MotionEnd::SpinStops => (velocity, DVec3::new(spin.x, spin.y, 0.0)),
            MotionEnd::Lands | MotionEnd::Sinks(_) | MotionEnd::HitsFloor => (velocity, spin),
            MotionEnd::Never => (self.velocity, self.spin),
        }
    }

    /// Whether the state changes without a contact.
    pub(crate) fn is_moving(&self) -> bool {
        self.end != MotionEnd::Never
    }

    /// Sets all rates to zero, so that the ball stays at `position` without end.
    pub(crate) fn freeze(&mut self) {
        self.velocity = DVec3::ZERO;
        self.spin = DVec3::ZERO;
        self.acceleration = DVec3::ZERO;
        self.spin_acceleration = DVec3::ZERO;
        self.duration_secs = f64::INFINITY;
        self.end = MotionEnd::Never;
    }
}

/// Spin of a ball that rolls at `velocity`, with spin `about_z` about the vertical.
pub(crate) fn rolling_spin(velocity: DVec3, about_z: f64, radius_m: f64) -> DVec3 {
    let rolling = DVec3::Z.cross(velocity) / radius_m;
    DVec3::new(rolling.x, rolling.y, about_z)
}
