//! The cue: its measures, and where it is held.

use carom_tracer::Shape;
use glam::{DVec3, Quat, Vec3};

/// 58 inches.
pub const CUE_LENGTH_M: f64 = 1.47;
const TIP_RADIUS_M: f64 = 0.0063;
const BUTT_RADIUS_M: f64 = 0.0145;

/// The cue's radius at a way from its tip, in m.
pub fn cue_radius_m(from_tip_m: f64) -> f64 {
    TIP_RADIUS_M + (BUTT_RADIUS_M - TIP_RADIUS_M) * (from_tip_m / CUE_LENGTH_M).min(1.0)
}

/// The name of its object and material.
pub const CUE_NAME: &str = "cue";

/// Where a cue is held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CuePose {
    /// The middle of the tip's end, metres.
    pub tip: DVec3,
    /// From the tip to the butt, of unit length.
    pub back: DVec3,
}

impl CuePose {
    /// Aimed at the middle of a ball along `bearing_rad`, as a cue lies over the rail.
    pub fn aimed(ball: DVec3, radius_m: f64, bearing_rad: f64) -> Self {
        let (sin, cos) = ELEVATION_RAD.sin_cos();
        let back = DVec3::new(-bearing_rad.cos() * cos, -bearing_rad.sin() * cos, sin);
        Self {
            tip: ball + back * (radius_m + GAP_M),
            back,
        }
    }

    /// `world_from_cone` of its object.
    pub fn rotation(&self) -> Quat {
        Quat::from_rotation_arc(Vec3::Z, self.back.as_vec3().normalize())
    }

    /// The cue as it is held here.
    pub fn shape(&self) -> Shape {
        Shape::TruncatedCone {
            center: self.tip.as_vec3(),
            rotation: self.rotation(),
            length: CUE_LENGTH_M as f32,
            radii: [0.0, CUE_LENGTH_M].map(|from| cue_radius_m(from) as f32),
        }
    }
}

/// From the cue ball to the tip of a cue that is aimed.
pub const GAP_M: f64 = 0.012;
/// Enough to clear the rail from anywhere in the kitchen.
const ELEVATION_RAD: f64 = 0.09;
