//! Settings of a picture, and presets of them.

use serde::{Deserialize, Serialize};

use crate::{Error, SettingsError};

/// How a frame is sampled. The same settings give the same picture on every node of one back end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Paths per pixel, 1 to [`RenderSettings::SAMPLES_MAX`]. Higher costs time in proportion;
    /// lower loses smoothness: the pool table's squared error falls 90-fold from 1 to 16 samples and
    /// another 4 times to 64. Powers of two are spread best.
    pub samples: u32,
    /// Index of the first sample, modulo 2³². A second picture with `first_sample` raised by
    /// `samples` complements the first: their mean is the picture of both their samples. Ranges
    /// that begin at a multiple of their length, a power of two, are the best spread.
    pub first_sample: u32,
    /// Maximum path depth: scattering events per path, 0 to [`RenderSettings::DEPTH_MAX`]; light
    /// found by the edge after the last one counts. Higher costs a ray and a shadow ray each; lower loses
    /// light that has been reflected more often.
    pub max_depth: u32,
    /// Chooses the random numbers: pictures of different seeds are independent.
    pub seed: u32,
    /// Whether pictures are denoised ([`crate::denoise`]). On a processor it costs as much time as
    /// two paths per pixel, and a guard band of [`crate::denoise::SUPPORT`] pixels is traced around
    /// each run of tiles; a GPU filters by itself (`examples/gpu_speed.rs` prints its time).
    /// Without it, noise stays (`examples/noise.rs` prints how much).
    pub denoise: bool,
}

impl RenderSettings {
    /// The most samples that one request may ask of a pixel.
    pub const SAMPLES_MAX: u32 = 65_536;
    /// The largest maximum depth.
    pub const DEPTH_MAX: u32 = 64;

    /// Checks the ranges.
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

/// Choices of all knobs by name, from the fastest to the truest. `carom-farm bench tradeoff` measures
/// what each takes and loses: by its figures for a processor they lie on or next to the front of
/// choices that no other beats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Preset {
    /// For pictures that are gone at once: a quarter of the edge, four paths.
    Draft,
    /// Half of the edge, four paths.
    Low,
    /// Three quarters of the edge, four paths.
    Medium,
    /// Every pixel, four paths, denoised.
    High,
    /// For stills: 256 paths, as they are.
    Final,
    /// To compare others with: 1024 paths.
    Reference,
}

impl Preset {
    /// All, from the fastest.
    pub const ALL: [Self; 6] = [
        Self::Draft,
        Self::Low,
        Self::Medium,
        Self::High,
        Self::Final,
        Self::Reference,
    ];

    /// Lower-case, for people and command lines.
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

    /// Pixels along an edge, as a share of the screen's ([`crate::ImageSize::scaled`]).
    pub const fn scale(self) -> f64 {
        match self {
            Self::Draft => 0.25,
            Self::Low => 0.5,
            Self::Medium => 0.75,
            Self::High | Self::Final | Self::Reference => 1.0,
        }
    }

    /// The rest.
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

/// The names of [`Preset::name`].
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
