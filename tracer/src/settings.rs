//! What a picture may cost.

use serde::{Deserialize, Serialize};

use crate::Error;

/// How a frame is sampled. The same settings give the same picture on every node of one back end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Paths per pixel, 1 to [`RenderSettings::SAMPLES_MAX`]. Higher costs time in proportion;
    /// lower loses smoothness: the error falls with the root of the samples.
    pub samples: u32,
    /// Index of the first sample. A second picture with `first_sample` raised by `samples` is
    /// independent of the first, so that their mean is a picture of both their samples.
    pub first_sample: u32,
    /// Surface scatterings of a path, 0 to [`RenderSettings::SCATTERINGS_MAX`]; light found by the
    /// edge after the last one counts. Higher costs a ray and a shadow ray each; lower loses
    /// light that has been reflected more often.
    pub scatterings_max: u32,
    /// Chooses the random numbers.
    pub seed: u32,
    /// Whether pictures are denoised ([`crate::post`]). On a processor it costs as much time as
    /// three to four paths per pixel, and a guard band of [`crate::post::SUPPORT`] pixels is traced
    /// around each run of tiles; a GPU's tracer leaves the filter to the processor. Without it,
    /// noise stays (`examples/denoise.rs` prints how much).
    pub denoise: bool,
}

impl RenderSettings {
    /// The most samples that one request may ask of a pixel.
    pub const SAMPLES_MAX: u32 = 65_536;
    /// The longest path.
    pub const SCATTERINGS_MAX: u32 = 64;

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] with the value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        if !(1..=Self::SAMPLES_MAX).contains(&self.samples) {
            return Err(Error::InvalidSettings(format!(
                "{} samples per pixel are asked for: it must be from 1 to {}",
                self.samples,
                Self::SAMPLES_MAX
            )));
        }
        if self.scatterings_max > Self::SCATTERINGS_MAX {
            return Err(Error::InvalidSettings(format!(
                "paths of {} scatterings are asked for: at most {} are allowed",
                self.scatterings_max,
                Self::SCATTERINGS_MAX
            )));
        }
        Ok(())
    }
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            samples: 4,
            first_sample: 0,
            scatterings_max: 5,
            seed: 0,
            denoise: false,
        }
    }
}
