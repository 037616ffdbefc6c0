//! Dimensions and pose of the cue.

use carom_tracer::Shape;
use glam::{DVec3, Quat, Vec3};

/// Length of the cue: 58 inches.
pub const CUE_LENGTH_M: f64 = 1.47;
const TIP_RADIUS_M: f64 = 0.0063;
const BUTT_RADIUS_M: f64 = 0.0145;

/// Radius of the cue at a distance from its tip, in m.
pub fn cue_radius_m(from_tip_m: f64) -> f64 {
    TIP_RADIUS_M + (BUTT_RADIUS_M - TIP_RADIUS_M) * (from_tip_m / CUE_LENGTH_M).min(1.0)
}

/// Name of the cue's object and material.
pub const CUE_NAME: &str = "cue";

/// Pose of the cue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CuePose {
    /// Centre of the tip's end, metres.
    pub tip: DVec3,
    /// Unit vector from the tip to the butt.
    pub back: DVec3,
}

impl CuePose {
    /// A cue aimed at the centre of a ball along `bearing_rad`, raised over the rail.
    pub fn aimed(ball: DVec3, radius_m: f64, bearing_rad: f64) -> Self {
        let (sin, cos) = ELEVATION_RAD.sin_cos();
        let back = DVec3::new(-bearing_rad.cos() * cos, -bearing_rad.sin() * cos, sin);
        Self {
            tip: ball + back * (radius_m + GAP_M),
            back,
        }
    }

    /// Rotation of its object (`world_from_cone`).
    pub fn rotation(&self) -> Quat {
        Quat::from_rotation_arc(Vec3::Z, self.back.as_vec3().normalize())
    }

    /// Shape of the cue in this pose.
    pub fn shape(&self) -> Shape {
        Shape::TruncatedCone {
            center: self.tip.as_vec3(),
            rotation: self.rotation(),
            length: CUE_LENGTH_M as f32,
            radii: [0.0, CUE_LENGTH_M].map(|from| cue_radius_m(from) as f32),
        }
    }
}

/// Distance from the cue ball to the tip of an aimed cue.
pub const GAP_M: f64 = 0.012;
/// Elevation that clears the rail from anywhere in the kitchen.
const ELEVATION_RAD: f64 = 0.09;
