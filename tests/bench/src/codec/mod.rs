//! The bench of the tile codec: bits on the wire, bytes per second of one core, and the error.

mod frames;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::tile_codec::{Decoder, Encoder, ReferenceTile, TileInput};
use carom_protocol::{PixelPrecision, PrecisionRange, RequestId, TilesDone, ToClient, codec};
use carom_tracer::metrics::flip;
use carom_tracer::tonemap::srgb8;
use carom_tracer::{ImageSize, RadianceImage, Tile, TileGrid, TileRange};
use cpu_time::ThreadTime;
use serde::Serialize;

use self::frames::{FrameQuality, TestFrames};
use crate::{BenchError, met, print_json};
use carom_farm::backend::Backend;

/// Measure the size of encoded frames, and the speed of one core at encoding and decoding them.
///
/// Frames are traced here and kept in a temporary folder. Each message, eight tiles of 32 pixels,
/// is told from the frame before, as when the client holds it; "cut" is told from nothing. Mbit/s
/// are those of 60 frames a second, with the messages' headers and without QUIC's. Rates are bytes
/// of sRGB pixels per second of CPU time, each message's the best of the repetitions of the whole
/// sequence. PSNR and FLIP compare with the exact pixels, FLIP in the last frame.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Pixels.
    #[arg(long, default_value = "1280x720")]
    size: ImageSize,
    /// Samples per pixel of the noisy frames.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: u32,
    /// Samples per pixel of the converged frames.
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    converged_spp: u32,
    /// Repetitions for the rates.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
    /// What traces the frames.
    #[arg(long, default_value = "cpu")]
    backend: Backend,
    /// Where traced frames are kept [default: `carom-bench-codec` in the system's temporary folder].
    #[arg(long)]
    cache: Option<PathBuf>,
    /// Only this precision.
    #[arg(long)]
    precision: Option<PixelPrecision>,
}

#[derive(Serialize)]
struct CodecReport {
    width: u32,
    height: u32,
    frames_per_second: f64,
    runs: Vec<CodecRow>,
}

#[derive(Serialize)]
struct CodecRow {
    picture: &'static str,
    motion: &'static str,
    precision: PixelPrecision,
    mbit_per_second: f64,
    encode_mb_per_second: f64,
    decode_mb_per_second: f64,
    /// Absent where all pixels are exact.
    psnr_db: Option<f64>,
    /// 0 where all pixels are exact.
    flip: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let tracer = args.backend.open(0)?;
    let frames = TestFrames::new(args.size, tracer, args.cache.as_deref())?;
    let mut report = CodecReport {
        width: args.size.width,
        height: args.size.height,
        frames_per_second: FRAMES_PER_SECOND,
        runs: Vec::new(),
    };
    if !args.json {
        print_heading(&report);
    }
    let pictures = [
        ("noisy", FrameQuality::traced(args.spp)),
        ("denoised", FrameQuality::denoised(args.spp)),
        ("converged", FrameQuality::traced(args.converged_spp)),
    ];
    for (name, picture) in pictures {
        for (motion, sequence, told) in frames.motions(picture)? {
            for precision in PixelPrecision::ALL {
                if args.precision.is_some_and(|only| only != precision) {
                    continue;
                }
                let measured = measure(&sequence, told, precision, args.repetitions)?;
                let row = measured.row(name, motion, precision);
                if !args.json {
                    print_row(&row);
                }
                report.runs.push(row);
            }
        }
    }
    if args.json {
        print_json(&report)?;
    } else if args.size == ImageSize::new(1280, 720) && args.spp == 4 {
        print_bars(&report.runs);
    }
    Ok(())
}

/// Sums over frames.
#[derive(Default)]
struct CodecTotals {
    frames: u32,
    pixel_bytes: usize,
    message_bytes: usize,
    /// CPU time in seconds of each message's encoder and decoder.
    secs: Vec<[f64; 2]>,
    squared_error: u64,
    /// FLIP of the last frame.
    flip: f64,
}

impl CodecTotals {
    /// Merges a repetition of the same messages: the minimum time of each counts.
    fn repeat(&mut self, other: &Self) {
        for (secs, other) in self.secs.iter_mut().zip(&other.secs) {
            *secs = [0, 1].map(|end| secs[end].min(other[end]));
        }
    }

    fn row(
        &self,
        picture: &'static str,
        motion: &'static str,
        precision: PixelPrecision,
    ) -> CodecRow {
        let bits = 8.0 * self.message_bytes as f64 / f64::from(self.frames);
        let megabytes = 1e-6 * self.pixel_bytes as f64;
        let secs = |end: usize| self.secs.iter().map(|secs| secs[end]).sum::<f64>();
        let mse = self.squared_error as f64 / self.pixel_bytes as f64;
        CodecRow {
            picture,
            motion,
            precision,
            mbit_per_second: 1e-6 * bits * FRAMES_PER_SECOND,
            encode_mb_per_second: megabytes / secs(0),
            decode_mb_per_second: megabytes / secs(1),
            psnr_db: (self.squared_error > 0).then(|| 10.0 * (255.0 * 255.0 / mse).log10()),
            flip: self.flip,
        }
    }
}

type ReferenceTiles = Vec<Option<Arc<ReferenceTile>>>;

/// Encodes and decodes all frames of a sequence but the first, which the client holds already, several
/// times.
fn measure(
    sequence: &[Arc<RadianceImage>],
    told: bool,
    precision: PixelPrecision,
    repetitions: u32,
) -> Result<CodecTotals, BenchError> {
    let (mut measured, come) = play(sequence, told, precision)?;
    for _ in 1..repetitions {
        let (again, _) = play(sequence, told, precision)?;
        measured.repeat(&again);
    }
    if let Some(last) = sequence.last().filter(|_| measured.squared_error > 0) {
        let exact = last.pixels.iter().map(|light| srgb8(*light, EXPOSURE));
        let exact: Vec<[u8; 3]> = exact.collect();
        measured.flip = flip(last.size, &come, &exact)?.mean;
    }
    Ok(measured)
}

/// Totals of a sequence with new coders, and its last frame as decoded by the client.
fn play(
    sequence: &[Arc<RadianceImage>],
    told: bool,
    precision: PixelPrecision,
) -> Result<(CodecTotals, Vec<[u8; 3]>), BenchError> {
    let mut coders = CodecPair {
        encoder: Encoder::new(),
        decoder: Decoder::new(),
        range: PrecisionRange::only(precision),
        come: vec![[0; 3]; sequence[0].pixels.len()],
    };
    let grid = TileGrid::new(sequence[0].size, TILE_EDGE);
    let nothing: ReferenceTiles = vec![None; grid.len() as usize];
    let (mut sent, mut held) = (nothing.clone(), nothing.clone());
    let mut measured = CodecTotals::default();
    for (index, image) in sequence.iter().enumerate() {
        if !told {
            (sent, held) = (nothing.clone(), nothing.clone());
        }
        let mut first_frame = CodecTotals::default();
        let sums = match index {
            0 => &mut first_frame,
            _ => &mut measured,
        };
        for first in (0..grid.len()).step_by(TILES_PER_MESSAGE_MAX as usize) {
            let count = TILES_PER_MESSAGE_MAX.min(grid.len() - first);
            let run = TileRange { first, count };
            coders.message(sums, image, grid, run, &mut sent, &mut held)?;
        }
        sums.frames += 1;
    }
    Ok((measured, coders.come))
}

struct CodecPair {
    encoder: Encoder,
    decoder: Decoder,
    range: PrecisionRange,
    /// The last frame, as decoded by the client.
    come: Vec<[u8; 3]>,
}

impl CodecPair {
    /// Encodes and decodes one message; `sent` and `held` are the references of node and client.
    fn message(
        &mut self,
        sums: &mut CodecTotals,
        image: &RadianceImage,
        grid: TileGrid,
        run: TileRange,
        sent: &mut ReferenceTiles,
        held: &mut ReferenceTiles,
    ) -> Result<(), BenchError> {
        let tiles: Vec<Tile> = grid.tiles(run).collect();
        let radiance: Vec<Vec<[f32; 3]>> = tiles.iter().map(|tile| image.cut(*tile)).collect();
        let stretch = run.first as usize..run.end() as usize;
        let inputs: Vec<TileInput> = tiles
            .iter()
            .zip(&radiance)
            .zip(&sent[stretch.clone()])
            .map(|((&tile, radiance), reference)| TileInput {
                tile,
                radiance,
                reference: reference.as_ref(),
            })
            .collect();
        let told = tiles.iter().copied();
        let told: Vec<_> = told
            .zip(held[stretch.clone()].iter().map(Option::as_ref))
            .collect();
        let (encoder, decoder) = (&mut self.encoder, &mut self.decoder);
        let precision = self.range.finest;
        let encode = || encoder.encode_srgb(EXPOSURE, precision, &inputs);
        let (encode_secs, (payload, kept)) = timed(encode);
        let decode = || decoder.decode_srgb(self.range, &told, &payload);
        let (decode_secs, decoded) = timed(decode);
        let decoded = decoded.context("what was encoded")?;
        sums.secs.push([encode_secs, decode_secs]);
        let shown = radiance
            .iter()
            .flatten()
            .map(|light| srgb8(*light, EXPOSURE));
        for (shown, decoded) in shown.zip(&decoded.pixels) {
            let squares = shown
                .iter()
                .zip(decoded)
                .map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2));
            sums.squared_error += squares.sum::<u64>();
        }
        let mut pixels = &decoded.pixels[..];
        for tile in tiles {
            for row in tile.y..tile.y + tile.height {
                let start = row as usize * image.size.width as usize + tile.x as usize;
                let (line, rest) = pixels.split_at(tile.width as usize);
                self.come[start..][..line.len()].copy_from_slice(line);
                pixels = rest;
            }
        }
        sums.pixel_bytes += decoded.pixels.as_flattened().len();
        sums.message_bytes += message_bytes(run, payload)?;
        for (place, (kept, come)) in stretch.zip(kept.into_iter().zip(decoded.references)) {
            (sent[place], held[place]) = (Some(kept), Some(come));
        }
        Ok(())
    }
}

/// Size of the whole message in bytes, with numbers as large as after some time of play.
fn message_bytes(tiles: TileRange, pixels: Vec<u8>) -> Result<usize, BenchError> {
    let message = ToClient::Tiles(TilesDone {
        request: RequestId(10_000),
        tiles,
        busy_micros: 5000,
        times: carom_protocol::NodeTimes::default(),
        dropped_samples: 0,
        pixels,
    });
    let bytes = codec::encode_to_client(&message).context("a message of tiles")?;
    Ok(bytes.len())
}

/// CPU time of a call in seconds, and its result.
fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = ThreadTime::now();
    let result = work();
    (start.elapsed().as_secs_f64(), result)
}

fn print_heading(report: &CodecReport) {
    let CodecReport { width, height, .. } = report;
    println!("{width}x{height} at {FRAMES_PER_SECOND} frames per second");
    println!(
        "{:<10} {:<10} {:<9} {:>9} {:>12} {:>12} {:>8} {:>8}",
        "picture", "motion", "precision", "Mbit/s", "encode MB/s", "decode MB/s", "PSNR dB", "FLIP"
    );
}

fn print_row(row: &CodecRow) {
    let psnr = row
        .psnr_db
        .map_or_else(|| "exact".to_owned(), |psnr| format!("{psnr:.1}"));
    println!(
        "{:<10} {:<10} {:<9} {:>9.1} {:>12.0} {:>12.0} {:>8} {:>8.4}",
        row.picture,
        row.motion,
        row.precision.to_string(),
        row.mbit_per_second,
        row.encode_mb_per_second,
        row.decode_mb_per_second,
        psnr,
        row.flip
    );
}

/// Prints the acceptance bars with the measured values.
fn print_bars(rows: &[CodecRow]) {
    println!();
    for (picture, motion, precision, most) in BARS {
        let here = |row: &&CodecRow| {
            (row.picture, row.motion, row.precision) == (picture, motion, precision)
        };
        if let Some(row) = rows.iter().find(here) {
            let came = row.mbit_per_second;
            let met = met(came <= most);
            println!(
                "{met:<6} {picture}, {motion}, {precision}: {came:.1} of at most {most} Mbit/s"
            );
        }
    }
    let least = |rate: fn(&CodecRow) -> f64| {
        let rates = rows.iter().map(rate);
        rates.fold(f64::INFINITY, f64::min)
    };
    let encode = least(|row| row.encode_mb_per_second);
    let decode = least(|row| row.decode_mb_per_second);
    for (what, rate, bar) in [("encode", encode, 170.0), ("decode", decode, 500.0)] {
        let met = met(rate >= bar);
        println!("{met:<6} {what} of all frames: {rate:.0} of at least {bar} MB/s");
    }
}

/// Maximum Mbit/s of 720p at 60 frames per second.
const BARS: [(&str, &str, PixelPrecision, f64); 5] = [
    ("denoised", "cut", PixelPrecision::Exact, 255.0),
    ("denoised", "cut", PixelPrecision::Within2, 146.0),
    ("denoised", "six balls", PixelPrecision::Exact, 60.0),
    ("noisy", "six balls", PixelPrecision::Exact, 35.0),
    ("noisy", "six balls", PixelPrecision::Within1, 30.0),
];
const FRAMES_PER_SECOND: f64 = 60.0;
/// Edge of a tile, as in the farm.
const TILE_EDGE: u16 = 32;
const EXPOSURE: f32 = 1.0;
