//! Render settings, and presets of them.

use serde::{Deserialize, Serialize};

use crate::{Error, SettingsError};

/// How a frame is sampled. Equal settings give equal images on all nodes with the same kind of
/// tracer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Paths per pixel, 1 to [`RenderSettings::SAMPLES_MAX`]. Time grows in proportion; noise
    /// falls: the pool table's squared error falls 90-fold from 1 to 16 samples and another 4-fold
    /// to 64. Powers of two are stratified best.
    pub samples: u32,
    /// Index of the first sample, modulo 2³². A second image with `first_sample` raised by
    /// `samples` complements the first: their mean is the image of both sets of samples. Ranges
    /// whose length is a power of two and whose start is a multiple of it are stratified best.
    pub first_sample: u32,
    /// Maximum number of scattering events per path, 0 to [`RenderSettings::DEPTH_MAX`]. Light hit
    /// by the path segment after the last event still counts. Each further event costs a ray and a
    /// shadow ray; lower values lose light that is reflected more often.
    pub max_depth: u32,
    /// Seed of the random numbers: images of different seeds are independent.
    pub seed: u32,
    /// Whether images are denoised ([`crate::denoise`]). On a CPU this takes as much time as two
    /// paths per pixel, and a guard band of [`crate::denoise::SUPPORT`] pixels is traced around
    /// each run of tiles; a GPU filters on its own (`examples/gpu_speed.rs` prints the time). The
    /// noise of images that are not denoised is printed by `examples/noise.rs`.
    pub denoise: bool,
}

impl RenderSettings {
    /// Largest number of samples per pixel of one request.
    pub const SAMPLES_MAX: u32 = 65_536;
    /// The largest maximum depth.
    pub const DEPTH_MAX: u32 = 64;

    /// Checks that all settings are within their ranges.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] with the value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        if !(1..=Self::SAMPLES_MAX).contains(&self.samples) {
            return Err(Error::settings(format!(
                "{} samples per pixel are asked for: it must be from 1 to {}",
                self.samples,
                Self::SAMPLES_MAX
            )));
        }
        if self.max_depth > Self::DEPTH_MAX {
            return Err(Error::settings(format!(
                "a maximum depth of {} is asked for: at most {} is allowed",
                self.max_depth,
                Self::DEPTH_MAX
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
            max_depth: 5,
            seed: 0,
            denoise: false,
        }
    }
}

/// Named settings, from the fastest to the most accurate. `carom-farm bench tradeoff` measures the
/// time and error of each: on a CPU they lie on or next to the Pareto front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Preset {
    /// For images that are shown only for a moment: a quarter of the resolution along each axis, 4
    /// samples.
    Draft,
    /// Half of the resolution along each axis, 4 samples.
    Low,
    /// Three quarters of the resolution along each axis, 4 samples.
    Medium,
    /// Full resolution, 4 samples, denoised.
    High,
    /// For stills: 256 samples, not denoised.
    Final,
    /// As a reference for comparisons: 1024 samples.
    Reference,
}

impl Preset {
    /// All presets, the fastest first.
    pub const ALL: [Self; 6] = [
        Self::Draft,
        Self::Low,
        Self::Medium,
        Self::High,
        Self::Final,
        Self::Reference,
    ];

    /// Lower-case name, for display and command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Low => "low",
            Self::Medium => "medium",
            Self::High => "high",
            Self::Final => "final",
            Self::Reference => "reference",
        }
    }

    /// Resolution along each axis as a fraction of the screen's ([`crate::ImageSize::scaled`]).
    pub const fn scale(self) -> f64 {
        match self {
            Self::Draft => 0.25,
            Self::Low => 0.5,
            Self::Medium => 0.75,
            Self::High | Self::Final | Self::Reference => 1.0,
        }
    }

    /// The render settings of the preset.
    pub fn settings(self) -> RenderSettings {
        let samples = match self {
            Self::Draft | Self::Low | Self::Medium | Self::High => 4,
            Self::Final => 256,
            Self::Reference => 1024,
        };
        RenderSettings {
            samples,
            denoise: self == Self::High,
            ..RenderSettings::default()
        }
    }
}

/// Parses the names of [`Preset::name`].
impl std::str::FromStr for Preset {
    type Err = SettingsError;

    fn from_str(text: &str) -> Result<Self, SettingsError> {
        let named = Self::ALL.into_iter().find(|preset| preset.name() == text);
        named.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            SettingsError(format!("it must be one of {names}"))
        })
    }
}
