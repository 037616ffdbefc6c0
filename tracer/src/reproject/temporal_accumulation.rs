//! Temporal accumulation: each frame of a moving view, blended with what the frames before it showed of the same points.
//!
//! The history is reprojected to the new frame as [`View::reproject`] does it, and dropped where the frame before
//! showed another primitive: there a pixel begins anew. What has changed without a primitive's doing, as shadows and
//! mirror images do, is found by the new frame itself: the history is clipped to the mean of a pixel's neighbourhood
//! and some standard deviations (Salvi, "An Excursion in Temporal Supersampling", 2016). Then it is a running mean of at
//! most [`FRAMES_MAX`] frames, of fewer where reprojection would blur it: each one interpolates the history by a
//! sharpened cubic (Keys, "Cubic Convolution Interpolation for Digital Image Processing", 1981), which edges and fine
//! texture do not survive for long.
//!
//! Means are of tone-mapped levels, which lie below the level of the mean radiance, the more the more noise there is: frames
//! are to be denoised.

use fearless_simd::{f32x4, prelude::*};
use rayon::prelude::*;

use super::{Channel, View};
use crate::ImageSize;
use crate::cpu::Footprint;
use crate::simd::{Level, dispatch};

/// The running mean of a moving view's frames.
#[derive(Debug, Default)]
pub struct TemporalAccumulation {
    history: History,
    /// Of the frame that is being accumulated, afterwards of the one before, for its memory.
    next: History,
    /// The blended frame, afterwards any, for its memory.
    blended: Vec<[u8; 4]>,
}

/// What earlier frames have shown, by the pixels of the last one.
#[derive(Debug, Default)]
struct History {
    /// Red, green and blue in sRGB levels, 0 to 255, and of how many frames they are the mean.
    pixels: Vec<[f32; 4]>,
    /// Whether a pixel's neighbours all show its primitive.
    is_inner: Vec<bool>,
}

impl TemporalAccumulation {
    /// Begins anew with a frame of `view` that is as good as the mean of `frames` frames.
    ///
    /// # Panics
    /// If `frame` has not the pixels of its view.
    pub fn begin(&mut self, view: &View, frame: &[[u8; 4]], frames: f32) {
        assert_eq!(frame.len(), view.size().pixels(), "pixels of the frame");
        let width = (view.size().width as usize).max(1);
        self.history.resize(view.size());
        let rows = self.history.rows(width).zip(frame.par_chunks(width));
        rows.enumerate().for_each(|(y, ((row, is_inner), frame))| {
            find_inner(view, y, is_inner);
            for (pixel, [red, green, blue, _]) in row.iter_mut().zip(frame) {
                let [red, green, blue] = [*red, *green, *blue].map(f32::from);
                *pixel = [red, green, blue, frames];
            }
        });
    }

    /// Blends `frame`, of the view `now`, with what was accumulated by the pixels of the view `before`. On the threads of
    /// the current pool.
    ///
    /// # Panics
    /// If `frame` or what was accumulated has not the pixels of its view.
    pub fn accumulate(&mut self, before: &View, now: &View, frame: &mut Vec<[u8; 4]>) {
        let size = now.size();
        assert_eq!(frame.len(), size.pixels(), "pixels of the frame");
        let accumulated = self.history.pixels.len();
        assert_eq!(accumulated, before.size().pixels(), "accumulated pixels");
        let width = (size.width as usize).max(1);
        self.next.resize(size);
        self.blended.resize(size.pixels(), [0; 4]);
        let level = Level::new();
        let blend = Blend {
            before,
            history: &self.history,
            size,
            frame,
            is_camera_still: (before.camera, before.size()) == (now.camera, size),
        };
        let vectors = now.motion_vectors(before);
        let rows = self.next.rows(width);
        let rows = rows.zip(self.blended.par_chunks_mut(width)).enumerate();
        rows.for_each_init(
            || RowMemory::new(width),
            |memory, (y, ((means, is_inner), blended))| {
                vectors.row(level, &now.hits, y, &mut memory.footprints);
                find_inner(now, y, is_inner);
                let primitives = &now.hits.primitive[y * width..][..width];
                dispatch!(level, simd => {
                    blend.find_neighbourhoods(y, memory);
                    blend.row(simd, y, memory, (primitives, is_inner), means);
                    store_levels(blended, means);
                });
            },
        );
        std::mem::swap(frame, &mut self.blended);
        std::mem::swap(&mut self.history, &mut self.next);
    }
}

impl History {
    fn resize(&mut self, size: ImageSize) {
        self.pixels.resize(size.pixels(), [0.0; 4]);
        self.is_inner.resize(size.pixels(), false);
    }

    fn rows(
        &mut self,
        width: usize,
    ) -> impl IndexedParallelIterator<Item = (&mut [[f32; 4]], &mut [bool])> {
        let pixels = self.pixels.par_chunks_mut(width);
        pixels.zip(self.is_inner.par_chunks_mut(width))
    }
}

/// Memory of a thread for a row of pixels.
struct RowMemory {
    footprints: Vec<Footprint>,
    /// The row's levels and those of the rows above and below it.
    lines: [Vec<[f32; 4]>; 3],
    /// Sums over a pixel and those above and below it, of levels and of their squares; at both ends one pixel more.
    sums: [Vec<[f32; 4]>; 2],
    /// Means and standard deviations of neighbourhoods of 3 × 3.
    means: Vec<[f32; 4]>,
    deviations: Vec<[f32; 4]>,
}

impl RowMemory {
    fn new(width: usize) -> Self {
        let row = |width: usize| vec![[0.0; 4]; width];
        Self {
            footprints: vec![Footprint::default(); width],
            lines: [row(width), row(width), row(width)],
            sums: [row(width + 2), row(width + 2)],
            means: row(width),
            deviations: row(width),
        }
    }
}

/// A frame, and the history that it is blended with.
struct Blend<'a> {
    before: &'a View,
    history: &'a History,
    size: ImageSize,
    frame: &'a [[u8; 4]],
    /// Pixels of what does not move are in their old places.
    is_camera_still: bool,
}

impl Blend<'_> {
    /// Finds what the neighbourhoods of row `y` are like; beyond the film its outermost pixels count again.
    #[inline(always)]
    fn find_neighbourhoods(&self, y: usize, memory: &mut RowMemory) {
        let (width, last) = (memory.means.len(), self.size.height as usize - 1);
        let rows = [y, y.saturating_sub(1), (y + 1).min(last)];
        for (line, y) in memory.lines.iter_mut().zip(rows) {
            let pixels = self.frame[y * width..][..width].as_flattened();
            for (level, byte) in line.as_flattened_mut().iter_mut().zip(pixels) {
                *level = f32::from(*byte);
            }
        }
        let [own, above, below] = &memory.lines;
        let lines = own.as_flattened().iter().zip(above.as_flattened());
        let lines = lines.zip(below.as_flattened());
        let [sums, squares] = &mut memory.sums;
        let columns = sums[1..].as_flattened_mut().iter_mut();
        let columns = columns.zip(squares[1..].as_flattened_mut());
        for ((sum, square), ((own, above), below)) in columns.zip(lines) {
            *sum = own + above + below;
            *square = own * own + above * above + below * below;
        }
        for sums in [&mut *sums, &mut *squares] {
            sums[0] = sums[1];
            sums[width + 1] = sums[width];
        }
        let (sums, squares) = (sums.as_flattened(), squares.as_flattened());
        let found = memory.means.as_flattened_mut().iter_mut();
        let found = found.zip(memory.deviations.as_flattened_mut());
        for (at, (mean, deviation)) in found.enumerate() {
            *mean = (sums[at] + sums[at + 4] + sums[at + 8]) * (1.0 / 9.0);
            let square = (squares[at] + squares[at + 4] + squares[at + 8]) * (1.0 / 9.0);
            // Levels are whole numbers, and the sums of their squares exact in f32: only the two products
            // round.
            *deviation = (square - *mean * *mean).max(0.0).sqrt();
        }
    }

    /// Blends row `y`, of whose pixels primitives are known and whether their neighbours show them too.
    #[inline(always)]
    fn row<S: Simd>(
        &self,
        simd: S,
        y: usize,
        memory: &RowMemory,
        (primitives, is_inner): (&[u32], &[bool]),
        row: &mut [[f32; 4]],
    ) {
        let first = y * row.len();
        for (x, blended) in row.iter_mut().enumerate() {
            let now = memory.lines[0][x];
            let footprint = &memory.footprints[x];
            let Some((old, frames)) = self.look_up(simd, footprint, primitives[x]) else {
                *blended = [now[0], now[1], now[2], 1.0];
                continue;
            };
            let deviation = memory.deviations[x];
            let frames_max = if self.is_camera_still && self.is_still(footprint, first + x) {
                STILL_FRAMES_MAX
            } else if is_inner[x] {
                // The fewer the more detail there is to lose.
                let contrast = deviation[0].max(deviation[1]).max(deviation[2]).max(1.0);
                (CONTRAST / contrast).clamp(DETAIL_FRAMES_MAX, FRAMES_MAX)
            } else {
                EDGE_FRAMES_MAX
            };
            // A running mean up to `frames_max`, an exponential one from there on.
            let frames = (frames + 1.0).min(frames_max);
            let mean = f32x4::from_slice(simd, &memory.means[x]);
            let range = f32x4::from_slice(simd, &deviation) * DEVIATIONS + LEVELS;
            // Clipped to what the neighbourhood shows now: history of a shadow that has moved on is of no
            // use.
            let old = old.max(mean - range).max(0.0).min(mean + range).min(255.0);
            let now = f32x4::from_slice(simd, &now);
            let sum = old + (now - old) * (1.0 / frames);
            sum.store_slice(blended);
            blended[3] = frames;
        }
    }

    /// Whether a footprint is the pixel `index` itself, so that it is not interpolated.
    #[inline(always)]
    fn is_still(&self, footprint: &Footprint, index: usize) -> bool {
        let [right, below] = footprint.shares;
        let is_whole = |share: f32| (share - 0.5).abs() > 0.5 - STILL_SHARE;
        let (right_of, below_of) = (usize::from(right > 0.5), usize::from(below > 0.5));
        let nearest = footprint.first as usize + right_of + below_of * self.size.width as usize;
        nearest == index && is_whole(right) && is_whole(below)
    }

    /// The history in a footprint, and of how many frames it is the mean: interpolated among sixteen pixels where all show
    /// `primitive`, else as pictures are looked up.
    #[inline(always)]
    fn look_up<S: Simd>(
        &self,
        simd: S,
        footprint: &Footprint,
        primitive: u32,
    ) -> Option<(f32x4<S>, f32)> {
        if footprint.first == Footprint::OUTSIDE {
            return None;
        }
        let History { pixels, is_inner } = self.history;
        let (first, width) = (footprint.first as usize, self.before.size().width as usize);
        // One after the other: the last may lie beyond the film, of whose outermost pixels none is an inner one.
        if self.before.hits.primitive[first] != primitive
            || !(is_inner[first] && is_inner[first + 1])
            || !(is_inner[first + width] && is_inner[first + width + 1])
        {
            let found = self.before.look_up(pixels, footprint, primitive)?;
            return Some((f32x4::from_slice(simd, &found), found[3]));
        }
        let [across, down] = [
            cubic_weights(footprint.shares[0]),
            cubic_weights(footprint.shares[1]),
        ];
        let (mut sum, mut frames) = (f32x4::splat(simd, 0.0), f32::INFINITY);
        for line in 0..4 {
            let pixels = &pixels[first + line * width - width - 1..][..4];
            let mut of_line = f32x4::from_slice(simd, &pixels[0]) * across[0];
            for column in 1..4 {
                let pixel = f32x4::from_slice(simd, &pixels[column]);
                of_line = pixel.mul_add(f32x4::splat(simd, across[column]), of_line);
            }
            sum = of_line.mul_add(f32x4::splat(simd, down[line]), sum);
            // Next to what is new, what was there before shines into it.
            frames = frames.min(pixels[1][3]).min(pixels[2][3]);
        }
        Some((sum, frames))
    }
}

/// Weights of four pixels in a row for a place between the second and the third, of a table: it has fewer places than levels.
#[inline(always)]
fn cubic_weights(share: f32) -> &'static [f32; 4] {
    &CUBIC_WEIGHTS[(share * (CUBIC_PLACES as f32 - 1.0) + 0.5) as usize % CUBIC_PLACES]
}

static CUBIC_WEIGHTS: [[f32; 4]; CUBIC_PLACES] = {
    let mut table = [[0.0; 4]; CUBIC_PLACES];
    let mut place = 0;
    while place < CUBIC_PLACES {
        let share = place as f32 / (CUBIC_PLACES as f32 - 1.0);
        let rest = 1.0 - share;
        table[place] = [outer(share), inner(share), inner(rest), outer(rest)];
        place += 1;
    }
    table
};

/// The cubic from one to two pixels away.
const fn outer(share: f32) -> f32 {
    -SHARPNESS * share * (1.0 - share) * (1.0 - share)
}

/// The cubic up to one pixel away.
const fn inner(share: f32) -> f32 {
    1.0 + share * share * (SHARPNESS - 3.0 + (2.0 - SHARPNESS) * share)
}

#[inline(always)]
fn store_levels(row: &mut [[u8; 4]], means: &[[f32; 4]]) {
    let levels = row.as_flattened_mut().iter_mut().zip(means.as_flattened());
    for (level, mean) in levels {
        *level = u8::from_f32(*mean);
    }
    for pixel in row {
        pixel[3] = 255;
    }
}

/// Finds which pixels of row `y` have neighbours on all sides that show their primitive.
fn find_inner(view: &View, y: usize, is_inner: &mut [bool]) {
    let width = is_inner.len();
    let height = view.size().height as usize;
    is_inner.fill(false);
    if y == 0 || y + 1 >= height || width < 3 {
        return;
    }
    let line = |y: usize| &view.hits.primitive[y * width..][..width];
    let (above, own, below) = (line(y - 1), line(y), line(y + 1));
    let columns = above.windows(3).zip(own.windows(3)).zip(below.windows(3));
    for (inner, ((above, own), below)) in is_inner[1..].iter_mut().zip(columns) {
        let center = own[1];
        let mut differ = 0;
        for column in 0..3 {
            differ |= (above[column] ^ center) | (own[column] ^ center) | (below[column] ^ center);
        }
        *inner = differ == 0;
    }
}

/// Frames that are averaged where the history moves: more lag behind what depends on the view, such as highlights, and are
/// blurred. By the error of turning views at 1 and 4 samples: `carom-bench motion`.
const FRAMES_MAX: f32 = 4.0;
/// Where neither camera nor primitive moves.
pub const STILL_FRAMES_MAX: f32 = 16.0;
/// At the edges of primitives, whose place within a pixel changes.
const EDGE_FRAMES_MAX: f32 = 1.5;
/// Where there is the most detail.
const DETAIL_FRAMES_MAX: f32 = 1.5;
/// Frames that are averaged where the standard deviation of the neighbourhood is one level; as many times fewer as it is more.
const CONTRAST: f32 = 40.0;
/// How many standard deviations of its neighbourhood the history of a pixel may be away, and how many levels more.
const DEVIATIONS: f32 = 2.5;
const LEVELS: f32 = 2.0;
/// What a neighbour may count in the footprint of a still pixel.
const STILL_SHARE: f32 = 0.01;
/// Minus the slope of the cubic one pixel away; 0.5 interpolates parabolas exactly, more sharpens.
const SHARPNESS: f32 = 0.75;
/// Places between two pixels.
const CUBIC_PLACES: usize = 257;
