//! Arbitrary output variables (AOVs) of first hits: guides of the denoiser and layers of EXR files.

use crate::RenderSettings;

/// Means over a pixel's camera rays, which are the same as those of its paths.
///
/// A ray that hits an area light or nothing has no albedo and normal (0), and its inverse depth is
/// 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aovs {
    /// Reflectance of the surface, 0 to 1; of a coated surface, that of the base.
    pub albedo: [f32; 3],
    /// World-space normal on the camera's side; shorter than 1 where the rays' unit normals differ.
    pub normal: [f32; 3],
    /// Inverse of the distance along the camera's axis, in m⁻¹. Over a plane its mean is the value
    /// at the pixel's centre, which is not true of the mean distance.
    pub inverse_depth: f32,
    /// Light of area lights and environment that reaches the camera directly or by a first mirror
    /// reflection: the sharpest part of an image, whose only noise is that of the rays' positions.
    pub emission: [f32; 3],
}

/// Number of channels of [`Aovs`].
pub(crate) const AOV_CHANNELS: usize = 10;

impl Aovs {
    /// AOVs from their channels, in the order of the fields: 3, 3, 1 and 3.
    pub(crate) fn from_columns(columns: [f32; AOV_CHANNELS]) -> Self {
        let [r, g, b, x, y, z, inverse_depth, er, eg, eb] = columns;
        Self {
            albedo: [r, g, b],
            normal: [x, y, z],
            inverse_depth,
            emission: [er, eg, eb],
        }
    }

    /// The channels, in the order of [`Aovs::from_columns`].
    pub(crate) fn columns(&self) -> [f32; AOV_CHANNELS] {
        let ([r, g, b], [x, y, z], [er, eg, eb]) = (self.albedo, self.normal, self.emission);
        [r, g, b, x, y, z, self.inverse_depth, er, eg, eb]
    }

    /// Distance along the camera's axis in metres; ∞ where nothing is hit.
    pub fn depth(&self) -> f32 {
        1.0 / self.inverse_depth
    }
}

/// AOVs of a finished tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileAovs {
    /// Index into [`crate::TraceJob::tiles`].
    pub index: usize,
    /// AOVs in row-major order, `tile.width × tile.height`.
    pub pixels: Vec<Aovs>,
}

/// Images of more samples than this have smooth edges anyway.
const EDGE_SAMPLES_MAX: u32 = 16;

/// Number of camera rays of an edge pixel of a denoised image: those of its samples and further
/// ones, which cost less than samples. Four per sample up to 8 in total, then two per sample.
const fn edge_rays(samples: u32) -> u32 {
    match samples {
        0..=2 => 4 * samples,
        3..=4 => 8,
        5..=EDGE_SAMPLES_MAX => 2 * samples,
        _ => samples,
    }
}

/// Fraction of the further rays among all camera rays of an edge pixel; 0 if there are none.
pub(crate) fn further_share(samples: u32) -> f32 {
    let rays = edge_rays(samples);
    (rays - samples) as f32 / rays as f32
}

/// Settings for the further rays, if there are any.
pub(crate) fn further_rays(settings: RenderSettings) -> Option<RenderSettings> {
    let further = edge_rays(settings.samples) - settings.samples;
    (further > 0).then(|| RenderSettings {
        samples: further,
        first_sample: settings.first_sample.wrapping_add(settings.samples),
        ..settings
    })
}
