//! Elementary functions with the same bits on every machine.
//!
//! Addition, multiplication, division and square roots are correctly rounded by IEEE 754 everywhere.
//! Sines,
//! exponentials and the like depend on the system's library, and a shot is chaotic: a difference in the
//! last
//! bit decides where a break ends. The pure Rust `libm` is one implementation for all platforms.
//! Simulation,
//! rules and computer players use no other functions: `clippy.toml` forbids them.

use glam::{DQuat, DVec2, DVec3};

pub(crate) use libm::{acos, asin, atan, atan2, cos, exp, hypot, log, tan};

/// Sine and cosine.
pub(crate) fn sin_cos(angle_rad: f64) -> (f64, f64) {
    libm::sincos(angle_rad)
}

/// The unit vector at an angle from +x.
pub(crate) fn unit_at(angle_rad: f64) -> DVec2 {
    let (sin, cos) = sin_cos(angle_rad);
    DVec2::new(cos, sin)
}

/// The angle of a vector from +x in rad, -π to π.
pub(crate) fn angle_of(vector: DVec2) -> f64 {
    atan2(vector.y, vector.x)
}

/// The angle by which a vector is turned anticlockwise to point as another does, in rad, -π to π.
pub(crate) fn angle_between(from: DVec2, to: DVec2) -> f64 {
    atan2(from.perp_dot(to), from.dot(to))
}

/// A vector turned about the vertical, anticlockwise from above.
pub(crate) fn turned(vector: DVec3, angle_rad: f64) -> DVec3 {
    unit_at(angle_rad)
        .rotate(vector.truncate())
        .extend(vector.z)
}

/// The rotation about the axis of a vector by its length in rad.
pub(crate) fn rotation(scaled_axis: DVec3) -> DQuat {
    let angle_rad = scaled_axis.length();
    if angle_rad == 0.0 {
        return DQuat::IDENTITY;
    }
    let (sin, cos) = sin_cos(0.5 * angle_rad);
    let axis = sin / angle_rad * scaled_axis;
    DQuat::from_xyzw(axis.x, axis.y, axis.z, cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_glam_but_for_the_last_bits() {
        for i in 0..200u32 {
            let angle = 0.37 * f64::from(i) - 31.0;
            let axis = DVec3::new(angle.sin(), 0.3, angle.cos());
            assert!((unit_at(angle) - DVec2::from_angle(angle)).length() < 1e-15);
            assert!((angle_of(unit_at(angle)) - unit_at(angle).to_angle()).abs() < 1e-15);
            let turn = DQuat::from_rotation_z(angle) * axis;
            assert!((turned(axis, angle) - turn).length() < 1e-14);
            let (ours, glams) = (
                rotation(angle * axis),
                DQuat::from_scaled_axis(angle * axis),
            );
            assert!((ours - glams).length() < 1e-13, "{ours} and {glams}");
        }
        assert_eq!(rotation(DVec3::ZERO), DQuat::IDENTITY);
    }

    /// A system's own functions would differ in these bits from machine to machine.
    #[test]
    fn they_have_the_stored_bits() {
        let mut hash = 0u64;
        for i in 1..=500u32 {
            let x = 0.061 * f64::from(i);
            let (sin, cos) = sin_cos(x);
            let values = [
                sin,
                cos,
                acos(sin),
                atan2(x, cos),
                exp(-x),
                hypot(x, sin),
                tan(x),
            ];
            for value in values {
                hash = hash.rotate_left(7) ^ value.to_bits();
            }
        }
        assert_eq!(hash, STORED, "0x{hash:016x}");
    }

    const STORED: u64 = 0x3327_e44e_7b11_a3e1;
}
