//! Noise of a scene's pictures of few samples, denoised and not, and what the denoiser costs.
//!
//! ```text
//! cargo run --release -p carom-tracer --example noise -- [key=value ...]
//! ```
//!
//! | key | is | default |
//! |---|---|---|
//! | `backend` | `cpu`, `gpu` or `scalar` | `cpu` |
//! | `scene` | a scene file | `assets/scenes/pool.json` |
//! | `reference` | the converged picture as EXR; a missing one is traced first | that of the tests |
//! | `size` | pixels of a reference that is missing | `1280x720` |
//! | `spp` | its samples | 16384 |
//! | `depth` | scattering events of a path | 5 |
//! | `pictures` | a folder for the pictures as PNG | none |
//! | `costs` | `no` leaves out the denoiser's time | `yes` |
//!
//! Prints relMSE, FLIP and dots a million pixels (`metrics::dots_per_million`), all and where the reference is smooth,
//! against the reference, then processor time for 1280×720 (wall time on a GPU).

use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use carom_tracer::film::{Film, trace_image};
use carom_tracer::gpu::AdapterChoice;
use carom_tracer::metrics::{dots_per_million, flip, rel_mse};
use carom_tracer::tonemap::srgb8;
use carom_tracer::{
    CompiledScene, CpuTracer, DeviceKind, GpuTracer, ImageSize, RadianceImage, RenderSettings,
    ScalarTracer, Scene, Tile, TileGrid, TraceJob, Tracer,
};

struct Arguments {
    tracer: Box<dyn Tracer>,
    scene: CompiledScene,
    reference: PathBuf,
    size: ImageSize,
    spp: u32,
    max_depth: u32,
    pictures: Option<PathBuf>,
    costs: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let run = arguments()?;
    println!("{}", run.tracer.info().name);
    let reference = reference(&run)?;
    errors(&run, &reference)?;
    if run.costs {
        costs(&run)?;
    }
    Ok(())
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut given = BTreeMap::new();
    for argument in std::env::args().skip(1) {
        let (key, value) = argument.split_once('=').ok_or("arguments are key=value")?;
        given.insert(key.to_owned(), value.to_owned());
    }
    let mut value = |key: &str, default: &str| {
        let value = given.remove(key);
        value.unwrap_or_else(|| default.to_owned())
    };
    let tracer: Box<dyn Tracer> = match value("backend", "cpu").as_str() {
        "cpu" => Box::new(CpuTracer::new()?),
        "gpu" => Box::new(GpuTracer::new(&AdapterChoice::Any)?),
        "scalar" => Box::new(ScalarTracer),
        name => return Err(format!("no back end is called {name}").into()),
    };
    let pool = repository("assets/scenes/pool.json");
    let converged = repository("tests/references/pool_480x270.exr");
    let scene = Scene::load(value("scene", &pool.to_string_lossy()))?;
    let run = Arguments {
        tracer,
        scene: CompiledScene::new(&scene)?,
        reference: value("reference", &converged.to_string_lossy()).into(),
        size: value("size", "1280x720").parse()?,
        spp: value("spp", "16384").parse()?,
        max_depth: value("depth", "5").parse()?,
        pictures: Some(value("pictures", ""))
            .filter(|folder| !folder.is_empty())
            .map(PathBuf::from),
        costs: value("costs", "yes") == "yes",
    };
    match given.into_keys().next() {
        Some(key) => Err(format!("there is no argument `{key}`").into()),
        None => Ok(run),
    }
}

/// The converged picture, from its file or traced and written there.
fn reference(run: &Arguments) -> Result<RadianceImage, Box<dyn Error>> {
    if run.reference.exists() {
        return Ok(RadianceImage::read_exr(&run.reference)?);
    }
    let settings = RenderSettings {
        samples: run.spp,
        max_depth: run.max_depth,
        seed: REFERENCE_SEED,
        ..RenderSettings::default()
    };
    let film = trace_image(&*run.tracer, &run.scene, run.size, settings)?;
    film.image().write_exr(&run.reference)?;
    Ok(film.image())
}

/// Figures by samples, and the pictures.
fn errors(run: &Arguments, reference: &RadianceImage) -> Result<(), Box<dyn Error>> {
    let truth = shown(reference);
    println!("samples        relMSE             FLIP        dots a million    where smooth");
    println!("           raw  denoised     raw  denoised     raw  denoised    raw  denoised");
    for samples in [1, 2, 4, 8, 16, 64, 256] {
        let mut figures = Vec::new();
        for denoise in [false, true] {
            let settings = RenderSettings {
                samples,
                max_depth: run.max_depth,
                denoise,
                ..RenderSettings::default()
            };
            let film: Film = trace_image(&*run.tracer, &run.scene, reference.size, settings)?;
            let image = film.image();
            let pixels = shown(&image);
            figures.push(rel_mse(&image, reference)?);
            figures.push(flip(reference.size, &pixels, &truth)?.mean);
            let dots = dots_per_million(reference.size, &pixels, &truth)?;
            figures.extend([dots.all, dots.smooth]);
            if let Some(folder) = &run.pictures {
                let kind = ["raw", "denoised"][usize::from(denoise)];
                image.write_png(folder.join(format!("{kind}_{samples}.png")), 1.0)?;
            }
        }
        let [raw, denoised] = figures.as_chunks::<4>().0 else {
            continue; // two pictures, four figures each
        };
        let [error, flip, dots, smooth] = std::array::from_fn(|i| [raw[i], denoised[i]]);
        println!(
            "{samples:7} {:8.6} {:9.6} {:7.4} {:9.4} {:7.0} {:9.0} {:6.0} {:9.0}",
            error[0], error[1], flip[0], flip[1], dots[0], dots[1], smooth[0], smooth[1]
        );
    }
    Ok(())
}

fn shown(image: &RadianceImage) -> Vec<[u8; 3]> {
    let pixels = image.pixels.iter();
    pixels.map(|radiance| srgb8(*radiance, 1.0)).collect()
}

/// Time of a picture of 1280×720 without and with the denoiser.
fn costs(run: &Arguments) -> Result<(), Box<dyn Error>> {
    let grid = TileGrid::new(ImageSize::new(1280, 720), 32);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    println!("samples   raw ms  denoised ms  more ms  paths a pixel (1280x720)");
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
                        max_depth: run.max_depth,
                        denoise,
                        ..RenderSettings::default()
                    },
                    cancelled: &AtomicBool::new(false),
                };
                *least = least.min(milliseconds(run, &job)?);
            }
        }
        let [noisy, denoised] = least;
        let more = denoised - noisy;
        let paths = more / noisy * f64::from(samples);
        println!("{samples:7} {noisy:8.1}  {denoised:11.1}  {more:7.1}  {paths:13.2}");
    }
    Ok(())
}

/// CPU time of this process; of a GPU wall time.
fn milliseconds(run: &Arguments, job: &TraceJob<'_>) -> Result<f64, Box<dyn Error>> {
    let (wall, cpu) = (Instant::now(), cpu_time::ProcessTime::now());
    run.tracer.trace(&run.scene, job, &|_| {})?;
    let elapsed = match run.tracer.info().kind {
        DeviceKind::Gpu => wall.elapsed(),
        _ => cpu.elapsed(),
    };
    Ok(elapsed.as_secs_f64() * 1e3)
}

const REPETITIONS: usize = 8;
/// Independent of the pictures that are measured.
const REFERENCE_SEED: u32 = 1;

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}
