//! Environment maps: light from a picture of all directions.

use serde::{Deserialize, Serialize};

use super::{FileBytes, ImageSource};

/// The longest side of an environment map in pixels: it takes half a gigabyte on each back end.
pub const ENVIRONMENT_EDGE_MAX: u32 = 8192;

/// An equirectangular picture of the surroundings, of at most [`ENVIRONMENT_EDGE_MAX`] pixels a side.
///
/// Its middle shows +y, its right half +x, its upper edge +z. [`super::Environment::radiance`] multiplies its numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentMap {
    /// An OpenEXR or Radiance HDR file.
    pub image: ImageSource,
    /// Turn of what is seen about +z, anticlockwise from above, in degrees, in [−360, 360].
    #[serde(default)]
    pub turn_deg: f32,
}

impl EnvironmentMap {
    /// The bytes of an OpenEXR or Radiance HDR file.
    pub fn new(file: Vec<u8>) -> Self {
        Self {
            image: ImageSource::Encoded(FileBytes(file)),
            turn_deg: 0.0,
        }
    }

    /// Turned about +z, anticlockwise from above.
    #[must_use]
    pub fn turned_deg(self, turn_deg: f32) -> Self {
        Self { turn_deg, ..self }
    }
}

/// Bytes that a map of that size takes, with what directions are drawn by.
#[cfg(feature = "image-io")]
pub(crate) fn environment_bytes(width: u32, height: u32) -> u64 {
    let (width, height) = (u64::from(width), u64::from(height));
    4 * (height + 1 + height * (width + 1) + 3 * width * height)
}
