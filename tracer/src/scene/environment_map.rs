//! Environment maps: light from an image of all directions.

use serde::{Deserialize, Serialize};

use super::{FileBytes, ImageSource};

/// Maximum width and height of an environment map in pixels; a map of this size takes half a
/// gigabyte on each device.
pub const ENVIRONMENT_EDGE_MAX: u32 = 8192;

/// An equirectangular image of the surroundings, with at most [`ENVIRONMENT_EDGE_MAX`] pixels along
/// each edge.
///
/// Its centre is the direction +y, its right half is towards +x, its upper edge +z. Its values are
/// multiplied by [`super::Environment::radiance`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentMap {
    /// An OpenEXR or Radiance HDR file.
    pub image: ImageSource,
    /// Rotation of the surroundings about +z, anticlockwise as seen from above, in degrees, in
    /// [−360, 360].
    #[serde(default)]
    pub turn_deg: f32,
}

impl EnvironmentMap {
    /// An environment map from the bytes of an OpenEXR or Radiance HDR file.
    pub fn new(file: Vec<u8>) -> Self {
        Self {
            image: ImageSource::Encoded(FileBytes(file)),
            turn_deg: 0.0,
        }
    }

    /// Sets the rotation about +z in degrees, anticlockwise as seen from above.
    #[must_use]
    pub fn turned_deg(self, turn_deg: f32) -> Self {
        Self { turn_deg, ..self }
    }
}

/// Bytes of a compiled environment map of this size, including its sampling tables.
#[cfg(feature = "image-io")]
pub(crate) fn environment_bytes(width: u32, height: u32) -> u64 {
    let (width, height) = (u64::from(width), u64::from(height));
    // Marginal and conditional distribution functions, and three channels per pixel.
    4 * (height + 1 + height * (width + 1) + 3 * width * height)
}
