//! The cue: its measures, its parts, and where it is held.

use glam::{DVec3, Quat, Vec3};

/// 58 inches.
pub const CUE_LENGTH_M: f64 = 1.47;
const TIP_RADIUS_M: f64 = 0.0063;
const BUTT_RADIUS_M: f64 = 0.0145;

/// The cue's radius at a way from its tip, in m.
pub fn cue_radius_m(from_tip_m: f64) -> f64 {
    TIP_RADIUS_M + (BUTT_RADIUS_M - TIP_RADIUS_M) * (from_tip_m / CUE_LENGTH_M).min(1.0)
}

/// Materials of the cue's parts, and how far from the tip's end each ends, in m.
pub const PARTS: [(&str, f64); 7] = [
    ("cue tip", 0.008),
    ("cue ferrule", 0.033),
    ("cue shaft", 0.738),
    ("brass", 0.75),
    ("cue butt", 1.02),
    ("cue wrap", 1.33),
    ("cue butt", CUE_LENGTH_M),
];

/// The name of the parts' objects.
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

    /// `world_from_cone` of the parts.
    pub fn rotation(&self) -> Quat {
        Quat::from_rotation_arc(Vec3::Z, self.back.as_vec3().normalize())
    }

    /// Where the narrow end of each part is.
    pub fn part_centers(&self) -> impl Iterator<Item = Vec3> + '_ {
        let from = std::iter::once(0.0).chain(PARTS.into_iter().map(|(_, to)| to));
        from.take(PARTS.len())
            .map(|from| (self.tip + self.back * from).as_vec3())
    }
}

/// From the cue ball to the tip of a cue that is aimed.
pub const GAP_M: f64 = 0.012;
/// Enough to clear the rail from anywhere in the kitchen.
const ELEVATION_RAD: f64 = 0.09;
