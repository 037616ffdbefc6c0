//! Comparison of two nodes' pixels of the same tile.
//!
//! Random numbers are functions of pixel, sample and seed, so that nodes with the same back end send
//! identical bits. CPU and GPU differ by rounding: most pixels in the sixth digit, and the few whose paths
//! fall on the other side of an edge by any amount. So pixels agree within a tolerance, and tiles if enough
//! of their pixels do. Pixels that went through JPEG are compared as means of its blocks.

use carom_protocol::tile_codec::TilePixels;
use carom_tracer::Tile;

/// Share of a tile's pixels that differ, from 0 to 1; of its 8×8 blocks if JPEG has changed either side
/// (`is_lossy`). It is 1 for pixels of different formats or counts.
pub fn differing_share(tile: Tile, a: &TilePixels, b: &TilePixels, is_lossy: bool) -> f64 {
    let edge = if is_lossy { JPEG_BLOCK } else { 1 };
    match (a, b) {
        _ if a.len() != tile.pixels() || b.len() != tile.pixels() => 1.0,
        (TilePixels::Srgb8(a), TilePixels::Srgb8(b)) => {
            let level = |level: u8| f32::from(level);
            let differs = |a: f32, b: f32| (a - b).abs() > LEVELS_MAX;
            share(
                tile,
                edge,
                |i| a[i].map(level),
                |i| b[i].map(level),
                differs,
            )
        }
        (TilePixels::Linear(a), TilePixels::Linear(b)) => {
            let differs =
                |a: f32, b: f32| (a - b).abs() > RELATIVE_MAX * (DARK + a.abs().max(b.abs()));
            share(tile, edge, |i| a[i], |i| b[i], differs)
        }
        _ => 1.0,
    }
}

/// Whether two copies of a tile agree: see [`differing_share`].
pub fn tiles_agree(tile: Tile, a: &TilePixels, b: &TilePixels, is_lossy: bool) -> bool {
    differing_share(tile, a, b, is_lossy) <= SHARE_MAX
}

/// Share of blocks of `edge`×`edge` pixels in which the mean of some channel differs.
fn share(
    tile: Tile,
    edge: u32,
    a: impl Fn(usize) -> [f32; 3],
    b: impl Fn(usize) -> [f32; 3],
    differs: impl Fn(f32, f32) -> bool,
) -> f64 {
    let (mut blocks, mut differing) = (0_u32, 0_u32);
    for top in (0..tile.height).step_by(edge as usize) {
        for left in (0..tile.width).step_by(edge as usize) {
            let (mut sums, mut count) = ([[0.0; 3]; 2], 0.0);
            for y in top..(top + edge).min(tile.height) {
                for x in left..(left + edge).min(tile.width) {
                    let place = (y * tile.width + x) as usize;
                    for (sum, pixel) in sums.iter_mut().zip([a(place), b(place)]) {
                        (0..3).for_each(|channel| sum[channel] += pixel[channel]);
                    }
                    count += 1.0;
                }
            }
            let [a, b] = sums;
            blocks += 1;
            differing += u32::from((0..3).any(|c| differs(a[c] / count, b[c] / count)));
        }
    }
    f64::from(differing) / f64::from(blocks.max(1))
}

/// Pixels along the edge of a JPEG block.
const JPEG_BLOCK: u32 = 8;
/// Tolerance of a channel in levels of 255: two nodes within two levels of the true value each are up to
/// four apart, and the coarsest JPEG moves a block's mean by up to two.
const LEVELS_MAX: f32 = 8.0;
/// Tolerance of radiance, relative to its value plus [`DARK`].
const RELATIVE_MAX: f32 = 0.02;
const DARK: f32 = 0.1;
/// Share of a tile's pixels that may differ. The measured maximum is 0.012 between the CPU and a GPU
/// (printed by the test `tiles_of_cpu_and_gpu_agree`), and 0 between nodes with the same back end.
const SHARE_MAX: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    const TILE: Tile = Tile {
        x: 32,
        y: 64,
        width: 16,
        height: 12,
    };

    fn linear(light: impl Fn(usize) -> f32) -> TilePixels {
        TilePixels::Linear((0..TILE.pixels()).map(|i| [light(i), 0.3, 0.2]).collect())
    }

    fn levels(level: impl Fn(usize) -> u8) -> TilePixels {
        TilePixels::Srgb8((0..TILE.pixels()).map(|i| [level(i), 9, 80]).collect())
    }

    #[test]
    fn rounding_and_a_few_other_paths_agree() {
        let picture = linear(|i| 0.01 * i as f32);
        let rounded = linear(|i| 0.01 * i as f32 * (1.0 + 1e-5));
        assert_eq!(differing_share(TILE, &picture, &rounded, false), 0.0);
        let some_paths = linear(|i| 0.01 * i as f32 + if i % 12 == 0 { 3.0 } else { 0.0 });
        assert!(tiles_agree(TILE, &picture, &some_paths, false));
    }

    #[test]
    fn black_brighter_and_foreign_pixels_differ() {
        let picture = linear(|i| 0.5 + 0.01 * i as f32);
        for wrong in [
            linear(|_| 0.0),
            linear(|i| (0.5 + 0.01 * i as f32) * 1.05),
            linear(|i| 0.5 + 0.01 * ((i + 7) % TILE.pixels()) as f32),
            levels(|_| 0),
            TilePixels::Linear(Vec::new()),
        ] {
            assert!(!tiles_agree(TILE, &picture, &wrong, false));
        }
    }

    #[test]
    fn what_jpeg_changes_agrees_by_its_means() {
        let picture = levels(|i| 100 + (i * 7 % 40) as u8);
        let smooth = levels(|_| 119);
        assert!(!tiles_agree(TILE, &picture, &smooth, false));
        assert!(tiles_agree(TILE, &picture, &smooth, true));
        assert!(!tiles_agree(TILE, &picture, &levels(|_| 140), true));
    }
}
