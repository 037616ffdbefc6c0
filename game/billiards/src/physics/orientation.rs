//! The orientation of a ball while its angular velocity changes linearly, as it does within a phase.
//!
//! The rotation over a short time is the fourth-order Magnus expansion of q' = ½ ω q: exact where the
//! axis is fixed (every ball that rolls without sidespin), otherwise with an error below 1e-6 rad per
//! turn. A phase stores the orientation at equal intervals, and any instant is one step from the
//! preceding one: continuous, and independent of how the shot is sampled.

use glam::{DQuat, DVec3};

use crate::deterministic_math::rotation;

/// The orientation over one phase.
#[derive(Clone, Debug)]
pub(crate) struct RotationIntegral {
    spin: DVec3,
    spin_acceleration: DVec3,
    interval_secs: f64,
    knots: Vec<DQuat>,
}

impl RotationIntegral {
    /// Integrates from `start` at time 0 for `duration_secs`.
    pub(crate) fn new(
        start: DQuat,
        spin: DVec3,
        spin_acceleration: DVec3,
        duration_secs: f64,
    ) -> Self {
        let mut integral = Self {
            spin,
            spin_acceleration,
            interval_secs: f64::INFINITY,
            knots: vec![start],
        };
        // About a fixed axis one step is exact for the whole phase.
        let tilt = spin.cross(spin_acceleration).length();
        let speed_max = spin
            .length()
            .max((spin + duration_secs * spin_acceleration).length());
        if tilt <= FIXED_AXIS * spin.length() * spin_acceleration.length() || speed_max == 0.0 {
            return integral;
        }
        let count = (speed_max * duration_secs / KNOT_ANGLE_RAD)
            .ceil()
            .clamp(1.0, KNOTS_MAX);
        integral.interval_secs = duration_secs / count;
        for knot in 1..count as usize {
            let last = integral.knots[knot - 1];
            let step = integral.step(
                (knot - 1) as f64 * integral.interval_secs,
                integral.interval_secs,
            );
            integral.knots.push((step * last).normalize());
        }
        integral
    }

    /// The orientation at time 0, bit for bit as given.
    pub(crate) fn start(&self) -> DQuat {
        self.knots[0]
    }

    /// The orientation at a time within the phase.
    pub(crate) fn at(&self, t: f64) -> DQuat {
        let knot = ((t / self.interval_secs) as usize).min(self.knots.len() - 1);
        // The interval may be infinite, and 0 · ∞ is NaN.
        let start = if knot == 0 {
            0.0
        } else {
            knot as f64 * self.interval_secs
        };
        let step = self.step(start, t - start);
        // Bit for bit as stored, without another normalisation.
        if step == DQuat::IDENTITY {
            return self.knots[knot];
        }
        (step * self.knots[knot]).normalize()
    }

    fn step(&self, start: f64, duration: f64) -> DQuat {
        let spin = self.spin + start * self.spin_acceleration;
        let mean = spin + 0.5 * duration * self.spin_acceleration;
        // The expansion's second term, ½ ∫∫ [A(s), A(r)] dr ds over r < s with A = ½ ω, of a linear ω.
        let tilt = duration.powi(3) / 12.0 * self.spin_acceleration.cross(spin);
        rotation(duration * mean + tilt)
    }
}

/// Sine of the angle between spin and its change below which the axis counts as fixed.
const FIXED_AXIS: f64 = 1e-12;
/// Rotation between two knots.
const KNOT_ANGLE_RAD: f64 = 0.25;
/// Bounds the memory; reached only by absurd spins.
const KNOTS_MAX: f64 = 65_536.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fixed_axis_is_exact_over_many_turns() {
        let integral =
            RotationIntegral::new(DQuat::IDENTITY, DVec3::X * 100.0, DVec3::X * -10.0, 10.0);
        let expected = DQuat::from_rotation_x(100.0 * 10.0 - 5.0 * 100.0);
        assert!(integral.at(10.0).dot(expected).abs() > 1.0 - 1e-12);
    }

    #[test]
    fn a_turning_axis_agrees_with_many_small_steps() {
        let (spin, change) = (DVec3::new(0.0, 60.0, 80.0), DVec3::new(7.0, -5.0, -10.9));
        let integral = RotationIntegral::new(DQuat::IDENTITY, spin, change, 2.0);
        let steps = 400_000;
        let dt = 2.0 / f64::from(steps);
        let mut fine = DQuat::IDENTITY;
        for i in 0..steps {
            let middle = spin + (f64::from(i) + 0.5) * dt * change;
            fine = DQuat::from_scaled_axis(dt * middle) * fine;
        }
        assert!(integral.at(2.0).angle_between(fine) < 1e-5);
    }
}
