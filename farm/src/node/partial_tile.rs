//! A tile that takes longer than a slice and is traced in parts: without denoising, blocks of columns or a
//! part of one column; with denoising, rectangles along the block borders of the guard band.
//!
//! A pixel does not depend on the others in its job, so the parts have the bits of the whole tile. A
//! denoised pixel depends on those within the denoiser's support, which are traced with each part as its
//! guard band.

use carom_tracer::{ImageSize, Tile, TileRadiance};

use super::guard_band::{guarded_pixels, halves};

/// A partly traced tile.
pub(super) struct PartialTile {
    /// Index of the tile in its grid.
    pub(super) index: u32,
    tile: Tile,
    /// Size of the picture if the tile is denoised.
    denoised_in: Option<ImageSize>,
    radiance: Vec<[f32; 3]>,
    /// Untraced rectangles; the next one is last.
    left: Vec<Tile>,
    dropped_samples: u32,
    /// Times that the next part has been stopped.
    stops: u32,
}

impl PartialTile {
    /// An untraced tile of this index; `denoised_in` is the picture's size if it is denoised.
    pub(super) fn new(index: u32, tile: Tile, denoised_in: Option<ImageSize>) -> Self {
        Self {
            index,
            tile,
            denoised_in,
            radiance: vec![[0.0; 3]; tile.pixels()],
            left: vec![tile],
            dropped_samples: 0,
            stops: 0,
        }
    }

    /// The next part to trace: at most `pixels` pixels where it can be divided that far.
    pub(super) fn next(&mut self, pixels: u32) -> Tile {
        let part = self.left.pop().unwrap_or(self.tile);
        let part = match self.denoised_in {
            Some(size) => self.next_guarded(part, size, pixels),
            None => self.next_columns(part, pixels),
        };
        self.left.push(part);
        part
    }

    /// The first pixels of a rectangle, at most `pixels` but at least one: in full-height columns where
    /// possible, as tracers divide rows among their threads.
    fn next_columns(&mut self, all: Tile, pixels: u32) -> Tile {
        let (columns, rows) = match pixels >= all.height {
            true => ((pixels / all.height).min(all.width), all.height),
            false => (1, pixels.max(1)),
        };
        let right = Tile {
            x: all.x + columns,
            width: all.width - columns,
            ..all
        };
        let below = Tile {
            y: all.y + rows,
            width: columns,
            height: all.height - rows,
            ..all
        };
        // `below` last, so that a begun column is finished before the next one.
        let rest = [right, below].into_iter().filter(|rest| rest.pixels() > 0);
        self.left.extend(rest);
        Tile {
            width: columns,
            height: rows,
            ..all
        }
    }

    /// A part of a rectangle that has at most `pixels` pixels with its guard band, or lies in one block.
    fn next_guarded(&mut self, all: Tile, size: ImageSize, pixels: u32) -> Tile {
        let mut part = all;
        while guarded_pixels(part, size) > pixels as usize
            && let Some([first, rest]) = halves(part)
        {
            self.left.push(rest);
            part = first;
        }
        part
    }

    /// Stores the pixels of the part returned by [`PartialTile::next`].
    pub(super) fn put(&mut self, part: Tile, traced: &TileRadiance) {
        let (left, top) = (part.x - self.tile.x, part.y - self.tile.y);
        let rows = traced.radiance.chunks_exact(part.width as usize);
        for (y, row) in (top..).zip(rows) {
            let first = (y * self.tile.width + left) as usize;
            self.radiance[first..first + row.len()].copy_from_slice(row);
        }
        let expected = self.left.pop();
        debug_assert_eq!(expected, Some(part), "another part than the next");
        self.dropped_samples = self.dropped_samples.saturating_add(traced.dropped_samples);
        self.stops = 0;
    }

    /// Records that the next part has been stopped, and returns how often.
    pub(super) fn note_stop(&mut self) -> u32 {
        self.stops += 1;
        self.stops
    }

    /// The pixels and dropped samples of the whole tile, or the tile itself if parts are missing.
    pub(super) fn whole(self) -> Result<(Vec<[f32; 3]>, u32), Self> {
        match self.left.is_empty() {
            true => Ok((self.radiance, self.dropped_samples)),
            false => Err(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::AtomicBool;

    use carom_tracer::{
        CompiledScene, CpuTracer, RenderSettings, Scene, TileGrid, TraceJob, Tracer,
    };

    use super::*;

    /// Each pixel's place, as if it had been traced.
    fn places(part: Tile) -> TileRadiance {
        let pixel = |index: u32| {
            let (x, y) = (part.x + index % part.width, part.y + index / part.width);
            [x as f32, y as f32, 0.0]
        };
        TileRadiance {
            index: 0,
            radiance: (0..part.pixels() as u32).map(pixel).collect(),
            dropped_samples: 1,
        }
    }

    #[test]
    fn parts_of_any_size_make_the_whole_tile() {
        let tile = Tile {
            x: 64,
            y: 32,
            width: 7,
            height: 5,
        };
        for sizes in [
            vec![1],
            vec![3],
            vec![5],
            vec![12],
            vec![35],
            vec![1, 30, 2, 11],
            vec![0],
        ] {
            let mut partial = PartialTile::new(9, tile, None);
            let mut parts = 0;
            let mut next_sizes = sizes.iter().copied().cycle();
            let (radiance, dropped_samples) = loop {
                let pixels = next_sizes.next().unwrap();
                let part = partial.next(pixels);
                assert!(part.pixels() as u32 <= pixels.max(1), "{part:?}");
                partial.put(part, &places(part));
                parts += 1;
                match partial.whole() {
                    Ok(whole) => break whole,
                    Err(rest) => partial = rest,
                }
            };
            assert_eq!(radiance, places(tile).radiance, "parts of {sizes:?}");
            assert_eq!(dropped_samples, parts);
        }
    }

    #[test]
    fn denoised_parts_lie_between_blocks_and_fit_with_their_guard_band() {
        let size = ImageSize::new(203, 117);
        for (x, y, width, height) in [(64, 32, 64, 64), (91, 39, 13, 13), (192, 96, 11, 21)] {
            let tile = Tile {
                x,
                y,
                width,
                height,
            };
            for pixels in [0, 24 * 24, 48 * 48, 5000, u32::MAX] {
                let mut partial = PartialTile::new(9, tile, Some(size));
                let radiance = loop {
                    let part = partial.next(pixels);
                    let fits = guarded_pixels(part, size) <= pixels as usize;
                    assert!(fits || halves(part).is_none(), "{part:?}");
                    partial.put(part, &places(part));
                    match partial.whole() {
                        Ok((radiance, _)) => break radiance,
                        Err(rest) => partial = rest,
                    }
                };
                assert_eq!(radiance, places(tile).radiance, "{tile:?} by {pixels}");
            }
        }
    }

    #[test]
    fn a_part_that_was_stopped_is_divided_when_its_price_has_risen() {
        let tile = Tile {
            x: 64,
            y: 32,
            width: 32,
            height: 32,
        };
        for denoised_in in [None, Some(ImageSize::new(203, 117))] {
            let mut partial = PartialTile::new(9, tile, denoised_in);
            assert_eq!(partial.next(u32::MAX), tile);
            assert_eq!(partial.note_stop(), 1);
            let part = partial.next(24 * 40);
            assert!(part.pixels() < tile.pixels());
            assert_eq!(partial.note_stop(), 2);
            partial.put(part, &places(part));
            assert_eq!(partial.note_stop(), 1, "of another part");
        }
    }

    #[test]
    fn denoised_parts_have_the_bits_of_the_whole_tile() {
        let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
        let scene = CompiledScene::new(&scene).unwrap();
        let tracer = CpuTracer::with_threads(1).unwrap();
        let size = ImageSize::new(103, 77);
        for (edge, tile, samples) in [(32, 5, 1), (37, 3, 2), (29, 6, 5), (64, 1, 1), (13, 26, 4)] {
            let trace = |tile: Tile| {
                let traced = Mutex::new(None);
                let job = TraceJob {
                    size,
                    tiles: &[tile],
                    settings: RenderSettings {
                        samples,
                        denoise: true,
                        ..RenderSettings::default()
                    },
                    cancelled: &AtomicBool::new(false),
                };
                let sink = |tile: TileRadiance| *traced.lock().unwrap() = Some(tile);
                let stats = tracer.trace(&scene, &job, &sink).unwrap();
                let priced = guarded_pixels(tile, size) as u64 * u64::from(samples);
                assert_eq!(stats.samples, priced, "{tile:?}");
                traced.into_inner().unwrap().unwrap()
            };
            let tile = TileGrid::new(size, edge).tile(tile);
            let whole = trace(tile);
            for pixels in [0, 24 * 32, 32 * 32] {
                let mut partial = PartialTile::new(0, tile, Some(size));
                let mut parts = 0;
                let (radiance, dropped_samples) = loop {
                    let part = partial.next(pixels);
                    partial.put(part, &trace(part));
                    parts += 1;
                    match partial.whole() {
                        Ok(whole) => break whole,
                        Err(rest) => partial = rest,
                    }
                };
                assert!(parts > 1, "{tile:?}");
                assert!(radiance == whole.radiance, "{tile:?} in {parts} parts");
                assert_eq!(dropped_samples, whole.dropped_samples);
            }
        }
    }
}
