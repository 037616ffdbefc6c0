//! The bench of the quality levels: the error of each against the converged frame.

use std::path::PathBuf;

use anyhow::Context as _;
use carom_farm::quality::{QUALITY_LEVELS, QualityLevel};
use carom_tracer::film::trace_image;
use carom_tracer::metrics::flip;
use carom_tracer::tonemap::srgb8;
use carom_tracer::{CompiledScene, CpuTracer, ImageSize, RadianceImage, RenderSettings, Scene};
use carom_window::display::DisplayFrame;
use carom_window::display::software::scale_linear;
use clap::Args;

use carom::scene::scene_builder::EXPOSURE;

/// Measure the error of each quality level.
///
/// Each level is traced as a share of the reference's size, stretched over it as the window does, and
/// compared by FLIP.
#[derive(Clone, Debug, Args)]
pub(crate) struct QualityArgs {
    /// The reference: linear radiance of the pool table
    #[arg(
        long,
        value_name = "FILE",
        default_value = "tests/references/pool_480x270.exr"
    )]
    pub(crate) reference: PathBuf,
}

impl QualityArgs {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let reference = RadianceImage::read_exr(&self.reference)
            .context("--reference names a picture of the pool table as linear EXR")?;
        println!("  scale  paths  denoised     FLIP");
        for (level, error) in QUALITY_LEVELS.iter().zip(measure(&reference)?) {
            let denoised = if level.denoise { "yes" } else { "no" };
            let (scale, samples) = (level.scale, level.samples);
            println!("{scale:>7} {samples:>6}  {denoised:>8} {error:>8.4}");
        }
        Ok(())
    }
}

/// Mean FLIP of each quality level against `reference`, a picture of the pool table.
///
/// # Errors
/// A sentence if there is no processor to trace with.
pub(crate) fn measure(reference: &RadianceImage) -> anyhow::Result<Vec<f64>> {
    let tracer = CpuTracer::new()?;
    let scene = CompiledScene::new(&Scene::from_json(POOL)?)?;
    let truth: Vec<[u8; 3]> = reference
        .pixels
        .iter()
        .map(|light| srgb8(*light, EXPOSURE))
        .collect();
    let error = |level: &QualityLevel| {
        let size = level.size(reference.size);
        let settings = RenderSettings {
            samples: level.samples,
            denoise: level.denoise,
            ..RenderSettings::default()
        };
        let image = trace_image(&tracer, &scene, size, settings)?.image();
        let shown = stretched(&image, reference.size);
        Ok(flip(reference.size, &shown, &truth)?.mean)
    };
    QUALITY_LEVELS.iter().map(error).collect()
}

fn stretched(image: &RadianceImage, size: ImageSize) -> Vec<[u8; 3]> {
    let opaque = |light: &[f32; 3]| {
        let [r, g, b] = srgb8(*light, EXPOSURE);
        [r, g, b, 255]
    };
    let picture = DisplayFrame {
        serial: 0,
        size: image.size,
        rgba: image.pixels.iter().map(opaque).collect(),
        update: carom_tracer::SceneUpdate::default(),
    };
    let mut words = Vec::new();
    scale_linear(&picture, size, &mut words);
    let bytes = |word: u32| [16, 8, 0].map(|shift| (word >> shift) as u8);
    words.into_iter().map(bytes).collect()
}

const POOL: &str = include_str!("../../../assets/scenes/pool.json");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_quality_level_is_nearer_to_the_truth() {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../references/pool_480x270.exr"
        );
        let measured = measure(&RadianceImage::read_exr(path).unwrap()).unwrap();
        assert!(
            measured.windows(2).all(|pair| pair[1] < pair[0]),
            "{measured:?}"
        );
        let [coarsest, .., finest] = measured[..] else {
            panic!("there are {} stops", measured.len());
        };
        assert!(finest < 0.2 * coarsest, "{measured:?}");
    }
}
