//! Arbitrary output variables (AOVs) of first hits: guides of the denoiser and layers of EXR files.

use crate::RenderSettings;

/// Means over a pixel's camera rays, which go where those of its paths go.
///
/// A ray that meets an area light or nothing has neither albedo nor normal, and its inverse depth is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aovs {
    /// Reflectance of the surface, 0 to 1; under a coat that of the base.
    pub albedo: [f32; 3],
    /// World-space unit normals on the camera's side; shorter where they differ.
    pub normal: [f32; 3],
    /// Of the distance along the camera's axis, m⁻¹. Over a plane its mean is the value at the
    /// pixel's middle, where the mean of the distance itself is not.
    pub inverse_depth: f32,
    /// Light of area lights and environment that comes straight, or by a first mirror: the sharpest part
    /// of a picture, and without noise but that of where the rays go.
    pub emission: [f32; 3],
}

/// Numbers of [`Aovs`].
pub(crate) const AOV_CHANNELS: usize = 10;

impl Aovs {
    /// The numbers in their order: 3, 3, 1 and 3.
    pub(crate) fn from_columns(columns: [f32; AOV_CHANNELS]) -> Self {
        let [r, g, b, x, y, z, inverse_depth, er, eg, eb] = columns;
        Self {
            albedo: [r, g, b],
            normal: [x, y, z],
            inverse_depth,
            emission: [er, eg, eb],
        }
    }

    /// What [`Aovs::from_columns`] takes.
    pub(crate) fn columns(&self) -> [f32; AOV_CHANNELS] {
        let ([r, g, b], [x, y, z], [er, eg, eb]) = (self.albedo, self.normal, self.emission);
        [r, g, b, x, y, z, self.inverse_depth, er, eg, eb]
    }

    /// Distance along the camera's axis in metres; ∞ where nothing is met.
    pub fn depth(&self) -> f32 {
        1.0 / self.inverse_depth
    }
}

/// First hits of a finished tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileAovs {
    /// Index into [`crate::TraceJob::tiles`].
    pub index: usize,
    /// Row-major: `tile.width × tile.height`.
    pub pixels: Vec<Aovs>,
}

/// Pictures of more samples have smooth edges.
const EDGE_SAMPLES_MAX: u32 = 16;

/// Camera rays that look at an edge of a denoised picture: its samples' and further ones, which cost less than samples. Four
/// for each sample up to 8, then two.
const fn edge_rays(samples: u32) -> u32 {
    match samples {
        0..=2 => 4 * samples,
        3..=4 => 8,
        5..=EDGE_SAMPLES_MAX => 2 * samples,
        _ => samples,
    }
}

/// Share of the further rays among all that look at an edge; 0 where there are none.
pub(crate) fn further_share(samples: u32) -> f32 {
    let rays = edge_rays(samples);
    (rays - samples) as f32 / rays as f32
}

/// `settings` of the further rays, if there are any.
pub(crate) fn further_rays(settings: RenderSettings) -> Option<RenderSettings> {
    let further = edge_rays(settings.samples) - settings.samples;
    (further > 0).then(|| RenderSettings {
        samples: further,
        first_sample: settings.first_sample.wrapping_add(settings.samples),
        ..settings
    })
}
