//! Gain and cost of the denoiser on the pool scene.
//!
//! `cargo run --release -p carom-tracer --example denoise -- [cpu|gpu|reference] [FOLDER]`
//!
//! Prints relMSE and FLIP against the independent reference with and without it, then its processor time for
//! 1280×720; writes the pictures of the first part to FOLDER as EXR.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use carom_tracer::film::trace_image;
use carom_tracer::gpu::AdapterChoice;
use carom_tracer::metrics::{flip, rel_mse};
use carom_tracer::tonemap::srgb8;
use carom_tracer::{
    CompiledScene, CpuTracer, GpuTracer, ImageSize, RadianceImage, RenderSettings, ScalarTracer,
    Scene, Tile, TileGrid, TraceJob, Tracer,
};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let tracer: Box<dyn Tracer> = match arguments.next().as_deref() {
        None | Some("cpu") => Box::new(CpuTracer::with_threads(1)?),
        Some("gpu") => Box::new(GpuTracer::new(&AdapterChoice::Any)?),
        Some("scalar") => Box::new(ScalarTracer),
        Some(name) => return Err(format!("no back end is called {name}").into()),
    };
    let folder = arguments.next().map(PathBuf::from);
    let scene = CompiledScene::new(&Scene::load(repository("assets/scenes/pool.json"))?)?;
    println!("{}", tracer.info().name);
    errors(&*tracer, &scene, folder.as_deref())?;
    costs(&*tracer, &scene)
}

/// relMSE and FLIP by samples, and the pictures.
fn errors(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    folder: Option<&Path>,
) -> Result<(), Box<dyn Error>> {
    let reference = RadianceImage::read_exr(repository("tests/references/pool_480x270.exr"))?;
    let seen = |image: &RadianceImage| -> Vec<[u8; 3]> {
        let pixels = image.pixels.iter();
        pixels.map(|radiance| srgb8(*radiance, 1.0)).collect()
    };
    let truth = seen(&reference);
    println!("samples  relMSE noisy  denoised  FLIP noisy  denoised");
    for samples in [1, 2, 4, 8, 16, 64, 256] {
        let mut figures = Vec::new();
        for denoise in [false, true] {
            let settings = RenderSettings {
                samples,
                denoise,
                ..RenderSettings::default()
            };
            let image = trace_image(tracer, scene, reference.size, settings)?.image();
            figures.push(rel_mse(&image, &reference)?);
            figures.push(flip(reference.size, &seen(&image), &truth)?.mean);
            if let Some(folder) = folder {
                let name = ["noisy", "denoised"][usize::from(denoise)];
                image.write_exr(folder.join(format!("{name}_{samples}.exr")))?;
            }
        }
        let [noisy, noisy_flip, smooth, smooth_flip] = figures[..] else {
            continue; // two pictures, two figures each
        };
        println!("{samples:7}  {noisy:12.5}  {smooth:8.5}  {noisy_flip:10.4}  {smooth_flip:8.4}");
    }
    Ok(())
}

/// Processor time of a picture of 1280×720 without and with the denoiser.
fn costs(tracer: &dyn Tracer, scene: &CompiledScene) -> Result<(), Box<dyn Error>> {
    let grid = TileGrid::new(ImageSize::new(1280, 720), 32);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    println!("samples  noisy ms  denoised ms  more ms  paths a pixel (processor time, 1280x720)");
    for samples in [1, 4] {
        // In turns: others use the machine too, for seconds on end.
        let mut least = [f64::INFINITY; 2];
        for _ in 0..REPETITIONS {
            for (denoise, least) in [false, true].into_iter().zip(&mut least) {
                let job = TraceJob {
                    size: grid.size,
                    tiles: &tiles,
                    settings: RenderSettings {
                        samples,
                        denoise,
                        ..RenderSettings::default()
                    },
                    cancelled: &AtomicBool::new(false),
                };
                let begun = cpu_time::ProcessTime::now();
                tracer.trace(scene, &job, &|_| {})?;
                *least = least.min(begun.elapsed().as_secs_f64() * 1e3);
            }
        }
        let [noisy, denoised] = least;
        let more = denoised - noisy;
        let paths = more / noisy * f64::from(samples);
        println!("{samples:7}  {noisy:8.0}  {denoised:11.0}  {more:7.0}  {paths:13.2}");
    }
    Ok(())
}

const REPETITIONS: usize = 8;

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}
