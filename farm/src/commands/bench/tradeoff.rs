//! `carom-farm bench tradeoff`: cost and error of each setting of a picture, and the Pareto-optimal choices.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::tile_codec::{Decoder, Encoder, TileInput};
use carom_protocol::{PixelPrecision, PrecisionRange};
use carom_tracer::film::trace_image;
use carom_tracer::metrics::{flip, mean_ratio, rel_mse};
use carom_tracer::tonemap::{linear, srgb8};
use carom_tracer::{
    CompiledScene, DeviceKind, ImageSize, Preset, RadianceImage, RenderSettings, Tile, TileGrid,
    TileRange, Tracer,
};
use cpu_time::ProcessTime;
use serde::Serialize;

use super::progress::Progress;
use crate::commands::Failure;
use crate::commands::inputs;
use carom_farm::backend::{self, Backend, OpenBackend};

/// Measure error against time and bytes over resolution, samples, depth, denoiser and precision
///
/// Each picture is measured as it reaches the screen: traced at its share of the reference's size,
/// encoded, decoded and scaled up. Time is the best repetition's: CPU time on a processor,
/// wall-clock time on a warm GPU. A star marks choices that no other of the same back end beats in
/// both time and FLIP.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Compare with this EXR file of linear Rec. 709 radiance; the repository has
    /// tests/references/pool_480x270.exr
    #[arg(long)]
    reference: PathBuf,
    /// Trace this scene file [default: the built-in pool table]
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Measure only this back end [default: the CPU, and the GPU if there is one]
    #[arg(long)]
    backend: Option<Backend>,
    /// Repeat each picture this many times
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=100))]
    repetitions: u32,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// One combination of all settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
struct Choice {
    scale: f64,
    samples: u32,
    max_depth: u32,
    denoise: bool,
    precision: PixelPrecision,
}

#[derive(Clone, Debug, Serialize)]
struct Row {
    backend: &'static str,
    #[serde(flatten)]
    choice: Choice,
    /// The preset with this choice, if any.
    preset: Option<&'static str>,
    milliseconds: f64,
    bytes: usize,
    rel_mse: f64,
    flip: f64,
    /// Relative error of the picture's mean, per channel.
    bias: [f64; 3],
    pareto: bool,
}

#[derive(Serialize)]
struct Report {
    scene: String,
    width: u32,
    height: u32,
    rows: Vec<Row>,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let named = inputs::scene(args.scene.as_deref())?;
    let scene = CompiledScene::new(&named.scene)?;
    let reference = Screen::of(&RadianceImage::read_exr(&args.reference)?);
    let mut report = Report {
        scene: named.name,
        width: reference.size.width,
        height: reference.size.height,
        rows: Vec::new(),
    };
    for opened in backend::open_all(args.backend, 0)? {
        // The scalar tracer is slower than both others and gives no better picture.
        if opened.backend == Backend::Scalar && args.backend.is_none() {
            continue;
        }
        let rows = sweep(&opened, &scene, &reference, args.repetitions);
        report.rows.extend(rows.context(opened.backend.name())?);
    }
    if args.json {
        let json = serde_json::to_string(&report).context("results as JSON")?;
        println!("{json}");
    } else {
        print_table(&report);
    }
    Ok(())
}

/// A picture as displayed on a screen.
struct Screen {
    size: ImageSize,
    srgb: Vec<[u8; 3]>,
    /// Linear radiance of `srgb`.
    light: RadianceImage,
}

impl Screen {
    fn new(size: ImageSize, srgb: Vec<[u8; 3]>) -> Self {
        let pixels = srgb.iter().map(|pixel| pixel.map(linear)).collect();
        let light = RadianceImage { size, pixels };
        Self { size, srgb, light }
    }

    fn of(image: &RadianceImage) -> Self {
        let srgb = image.pixels.iter().map(|light| srgb8(*light, EXPOSURE));
        Self::new(image.size, srgb.collect())
    }

    /// Scales bilinearly, as the game's window does.
    fn stretched(self, to: ImageSize) -> Self {
        if self.size == to {
            return self;
        }
        let step = |from: u32, to: u32| from as f32 / to as f32;
        let (dx, dy) = (
            step(self.size.width, to.width),
            step(self.size.height, to.height),
        );
        let pixel = |index: usize| {
            let (x, y) = (index as u32 % to.width, index as u32 / to.width);
            self.at((x as f32 + 0.5) * dx - 0.5, (y as f32 + 0.5) * dy - 0.5)
        };
        Self::new(to, (0..to.pixels()).map(pixel).collect())
    }

    fn at(&self, x: f32, y: f32) -> [u8; 3] {
        let (left, above) = (x.floor(), y.floor());
        let tap = |i: f32, j: f32| {
            let column = (left + i).clamp(0.0, self.size.width as f32 - 1.0) as usize;
            let row = (above + j).clamp(0.0, self.size.height as f32 - 1.0) as usize;
            self.srgb[row * self.size.width as usize + column].map(f32::from)
        };
        let (u, v) = (x - left, y - above);
        let (top, bottom) = (
            [tap(0.0, 0.0), tap(1.0, 0.0)],
            [tap(0.0, 1.0), tap(1.0, 1.0)],
        );
        std::array::from_fn(|c| {
            let along = |[a, b]: [[f32; 3]; 2]| a[c] + (b[c] - a[c]) * u;
            (along(top) + (along(bottom) - along(top)) * v).round() as u8
        })
    }
}

fn sweep(
    opened: &OpenBackend,
    scene: &CompiledScene,
    reference: &Screen,
    repetitions: u32,
) -> anyhow::Result<Vec<Row>> {
    let tracer = opened.tracer.as_ref();
    trace(tracer, scene, reference.size, Choice::of(Preset::Draft))?; // compiles kernels
    let pictures = choices().len() * repetitions as usize;
    let progress = Progress::start(opened.backend.name(), pictures);
    let measure = |choice: Choice| -> anyhow::Result<Row> {
        let mut milliseconds = f64::INFINITY;
        let mut traced = None;
        // The GPU has fallen back to low clocks while the CPU compared the previous choice's picture.
        if tracer.info().kind == DeviceKind::Gpu {
            backend::wake(tracer, || {
                trace(tracer, scene, reference.size, choice).map(|_| ())
            })?;
        }
        for _ in 0..repetitions {
            let (image, cost) = trace(tracer, scene, reference.size, choice)?;
            progress.step();
            milliseconds = milliseconds.min(cost);
            traced = Some(image);
        }
        let image = traced.context("a bench repeats at least once")?;
        let (screen, bytes) = transmit(&image, choice.precision)?;
        let screen = screen.stretched(reference.size);
        Ok(Row {
            backend: opened.backend.name(),
            choice,
            preset: choice.preset(),
            milliseconds,
            bytes,
            rel_mse: rel_mse(&screen.light, &reference.light)?,
            flip: flip(reference.size, &screen.srgb, &reference.srgb)?.mean,
            bias: mean_ratio(&screen.light, &reference.light)?.map(|ratio| ratio - 1.0),
            pareto: false,
        })
    };
    let mut rows = choices()
        .into_iter()
        .map(measure)
        .collect::<anyhow::Result<Vec<Row>>>()?;
    mark_pareto(&mut rows);
    Ok(rows)
}

/// Traces a picture; returns it and its cost in milliseconds.
fn trace(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    screen: ImageSize,
    choice: Choice,
) -> anyhow::Result<(RadianceImage, f64)> {
    let size = screen.scaled(choice.scale);
    let settings = RenderSettings {
        samples: choice.samples,
        max_depth: choice.max_depth,
        denoise: choice.denoise,
        ..RenderSettings::default()
    };
    let (wall, core) = (Instant::now(), ProcessTime::now());
    let image = trace_image(tracer, scene, size, settings)?.image();
    let secs = match tracer.info().kind {
        DeviceKind::Cpu => core.elapsed(),
        _ => wall.elapsed(),
    };
    Ok((image, secs.as_secs_f64() * 1e3))
}

/// Encodes and decodes a picture as for transmission; returns the result and the number of bytes.
fn transmit(image: &RadianceImage, precision: PixelPrecision) -> anyhow::Result<(Screen, usize)> {
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let grid = TileGrid::new(image.size, TILE_EDGE);
    let width = image.size.width as usize;
    let mut srgb = vec![[0; 3]; image.size.pixels()];
    let mut bytes = 0;
    for first in (0..grid.len()).step_by(TILES_PER_MESSAGE_MAX as usize) {
        let count = TILES_PER_MESSAGE_MAX.min(grid.len() - first);
        let tiles: Vec<Tile> = grid.tiles(TileRange { first, count }).collect();
        let radiance: Vec<Vec<[f32; 3]>> = tiles.iter().map(|tile| image.cut(*tile)).collect();
        let source = |(&tile, radiance)| TileInput {
            tile,
            radiance,
            reference: None,
        };
        let sources: Vec<TileInput> = tiles
            .iter()
            .zip(radiance.iter().map(Vec::as_slice))
            .map(source)
            .collect();
        let (payload, _) = encoder.encode_srgb(EXPOSURE, precision, &sources);
        bytes += payload.len();
        let apart: Vec<_> = tiles.iter().map(|tile| (*tile, None)).collect();
        let range = PrecisionRange::only(precision);
        let decoded = decoder.decode_srgb(range, &apart, &payload)?;
        let mut pixels = decoded.pixels.as_slice();
        for tile in &tiles {
            for y in tile.y..tile.y + tile.height {
                let (row, rest) = pixels.split_at(tile.width as usize);
                let start = y as usize * width + tile.x as usize;
                srgb[start..start + row.len()].copy_from_slice(row);
                pixels = rest;
            }
        }
    }
    Ok((Screen::new(image.size, srgb), bytes))
}

impl Choice {
    fn of(preset: Preset) -> Self {
        let settings = preset.settings();
        Self {
            scale: preset.scale(),
            samples: settings.samples,
            max_depth: settings.max_depth,
            denoise: settings.denoise,
            precision: PixelPrecision::Exact,
        }
    }

    fn preset(self) -> Option<&'static str> {
        let makes = |preset: &&Preset| Self::of(**preset) == self;
        Preset::ALL.iter().find(makes).map(|preset| preset.name())
    }
}

/// The measured choices: resolution, samples and denoiser in all combinations; depth and precision one at a
/// time.
fn choices() -> Vec<Choice> {
    let full = Choice::of(Preset::High);
    let mut choices: Vec<Choice> = Preset::ALL.map(Choice::of).to_vec();
    for scale in [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 1.0] {
        for samples in [1, 2, 4, 8, 16, 64] {
            choices.extend([false, true].map(|denoise| Choice {
                scale,
                samples,
                denoise,
                ..full
            }));
        }
    }
    choices.extend([1, 2, 3].map(|max_depth| Choice { max_depth, ..full }));
    choices.extend(PixelPrecision::ALL.map(|precision| Choice { precision, ..full }));
    let mut once: Vec<Choice> = Vec::new();
    for choice in choices {
        if !once.contains(&choice) {
            once.push(choice);
        }
    }
    once
}

/// Marks the Pareto-optimal rows: those that no other is at least as good as in time and FLIP.
fn mark_pareto(rows: &mut [Row]) {
    let costs: Vec<(f64, f64)> = rows
        .iter()
        .map(|row| (row.milliseconds, row.flip))
        .collect();
    for row in rows {
        let beats = |&(ms, flip): &(f64, f64)| {
            ms <= row.milliseconds && flip <= row.flip && (ms, flip) != (row.milliseconds, row.flip)
        };
        row.pareto = !costs.iter().any(beats);
    }
}

fn print_table(report: &Report) {
    println!("{}, {}x{}", report.scene, report.width, report.height);
    println!(
        "{:<9} {:>5} {:>4} {:>5} {:>8} {:>9} {:>9} {:>9} {:>9} {:>6} {:>6}  best  preset",
        "back end",
        "scale",
        "spp",
        "depth",
        "denoised",
        "precision",
        "ms",
        "bytes",
        "relMSE",
        "FLIP",
        "bias %"
    );
    for row in &report.rows {
        let bias = row
            .bias
            .iter()
            .fold(0.0f64, |worst, bias| worst.max(bias.abs()));
        println!(
            "{:<9} {:>5} {:>4} {:>5} {:>8} {:>9} {:>9.2} {:>9} {:>9.5} {:>6.4} {:>6.2}  {:<4}  {}",
            row.backend,
            row.choice.scale,
            row.choice.samples,
            row.choice.max_depth,
            if row.choice.denoise { "yes" } else { "no" },
            row.choice.precision.to_string(),
            row.milliseconds,
            row.bytes,
            row.rel_mse,
            row.flip,
            1e2 * bias,
            if row.pareto { "*" } else { "" },
            row.preset.unwrap_or_default()
        );
    }
}

/// Edge of a tile in pixels, as in the farm.
const TILE_EDGE: u16 = 32;
const EXPOSURE: f32 = 1.0;
