//! Speed at which one core encodes and decodes tiles, and their compressed size:
//! `cargo run --release -p carom-protocol --example codec_speed`.
//!
//! Two synthetic pictures of 1280×720: "smooth", balls and cloth under soft light with a third of
//! an sRGB step of grain, which compresses like denoised frames; and "noisy", the same with the
//! grain of four samples per pixel.

use std::hint::black_box;
use std::time::{Duration, Instant};

use carom_protocol::PixelFormat;
use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::tile_codec::{Decoder, Encoder};
use carom_tracer::{ImageSize, Tile, TileGrid, TileRange};

fn main() {
    println!("picture format   bytes left  encode MB/s  decode MB/s");
    for (name, grain) in [("smooth", 0.003), ("noisy", 0.35)] {
        let messages = picture(grain);
        for (format_name, format) in [
            ("Srgb8", PixelFormat::Srgb8 { exposure: 1.0 }),
            ("LinearF16", PixelFormat::LinearF16),
            ("LinearF32", PixelFormat::LinearF32),
        ] {
            let speed = measure(format, &messages);
            println!(
                "{name:7} {format_name:9} {:8.1} % {:12.0} {:12.0}",
                100.0 * speed.bytes_left,
                speed.encode,
                speed.decode
            );
        }
    }
}

/// The tiles of one message with their radiance.
type Message = Vec<(Tile, Vec<[f32; 3]>)>;

struct Speed {
    /// Payload over pixels.
    bytes_left: f64,
    /// MB of pixels per second.
    encode: f64,
    decode: f64,
}

fn measure(format: PixelFormat, messages: &[Message]) -> Speed {
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
    let (mut encode, mut decode) = (Duration::ZERO, Duration::ZERO);
    let mut payload_bytes = 0;
    for message in messages {
        let tiles: Vec<Tile> = message.iter().map(|(tile, _)| *tile).collect();
        let lit: Vec<(Tile, &[[f32; 3]])> = message.iter().map(|(t, l)| (*t, &l[..])).collect();
        let payload = encoder.encode(format, &lit);
        payload_bytes += payload.len();
        encode += fastest(|| drop(black_box(encoder.encode(format, &lit))));
        decode += fastest(|| {
            let pixels = decoder.decode(format, &tiles, &payload);
            assert!(pixels.is_ok_and(|pixels| !pixels.is_empty()));
        });
    }
    let pixel_bytes = (SIZE.pixels() * format.bytes()) as f64;
    Speed {
        bytes_left: payload_bytes as f64 / pixel_bytes,
        encode: pixel_bytes / 1e6 / encode.as_secs_f64(),
        decode: pixel_bytes / 1e6 / decode.as_secs_f64(),
    }
}

/// The shortest of some calls: other work on the machine only ever adds.
fn fastest(mut work: impl FnMut()) -> Duration {
    let timed = |_| {
        let start = Instant::now();
        work();
        start.elapsed()
    };
    (0..REPEATS).map(timed).min().expect("some calls")
}

fn picture(grain: f32) -> Vec<Message> {
    let grid = TileGrid::new(SIZE, 32);
    let firsts = (0..grid.len()).step_by(TILES_PER_MESSAGE_MAX as usize);
    firsts
        .map(|first| {
            let count = TILES_PER_MESSAGE_MAX.min(grid.len() - first);
            let tiles = grid.tiles(TileRange { first, count });
            tiles.map(|tile| (tile, radiance(tile, grain))).collect()
        })
        .collect()
}

fn radiance(tile: Tile, grain: f32) -> Vec<[f32; 3]> {
    let rows = tile.y..tile.y + tile.height;
    rows.flat_map(|y| (tile.x..tile.x + tile.width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let light = shade(x as f32, y as f32);
            std::array::from_fn(|channel| {
                let noise = 2.0 * uniform([x, y, channel as u32]) - 1.0;
                light[channel] * (1.0 + grain * noise)
            })
        })
        .collect()
}

/// Cloth that darkens away from a lamp over the middle, and 16 balls with a highlight.
fn shade(x: f32, y: f32) -> [f32; 3] {
    let lamp = 1.0 / (1.0 + ((x - 640.0).powi(2) + (y - 360.0).powi(2)) / 4e5);
    let (column, row) = ((x / 320.0).floor(), (y / 180.0).floor());
    let (u, v) = (
        (x - column * 320.0 - 160.0) / 70.0,
        (y - row * 180.0 - 90.0) / 70.0,
    );
    let r2 = u * u + v * v;
    if r2 > 1.0 {
        return [0.05 * lamp, 0.35 * lamp, 0.2 * lamp];
    }
    let height = (1.0 - r2).sqrt();
    let lit = (0.4 * u - 0.5 * v + 0.75 * height).max(0.05) * lamp;
    let highlight = (lit / lamp).powi(60);
    let ball = row * 4.0 + column;
    [0.9 - 0.05 * ball, 0.2 + 0.04 * ball, 0.1 + 0.02 * ball].map(|albedo| albedo * lit + highlight)
}

/// A number in [0, 1) from a hash of three (PCG, Jarzynski and Olano 2020).
fn uniform(key: [u32; 3]) -> f32 {
    let [mut x, mut y, mut z] = key.map(|k| k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    for _ in 0..2 {
        x = x.wrapping_add(y.wrapping_mul(z));
        y = y.wrapping_add(z.wrapping_mul(x));
        z = z.wrapping_add(x.wrapping_mul(y));
        [x, y, z] = [x, y, z].map(|v| v ^ (v >> 16));
    }
    (x >> 8) as f32 / (1 << 24) as f32
}

const SIZE: ImageSize = ImageSize::new(1280, 720);
const REPEATS: usize = 20;
