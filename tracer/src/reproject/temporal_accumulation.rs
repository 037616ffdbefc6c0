//! Temporal accumulation: each frame of a moving view is blended with what earlier frames showed of
//! the same points.
//!
//! The history is reprojected to the new frame as by [`View::reproject`], and discarded where the
//! previous frame showed another primitive: such pixels start over. Changes that do not come from a
//! primitive's motion, such as shadows and reflections, are detected in the new frame itself: the
//! history is clipped to the mean of a pixel's neighbourhood plus or minus some standard deviations
//! (Salvi, "An Excursion in Temporal Supersampling", 2016). The result is a running mean of at most
//! [`FRAMES_MAX`] frames, and of fewer where reprojection would blur it: each frame interpolates
//! the history with a sharpened cubic (Keys, "Cubic Convolution Interpolation for Digital Image
//! Processing", 1981), and edges and fine texture do not survive many such interpolations.
//!
//! The means are of tone-mapped levels. These lie below the level of the mean radiance, the more so
//! the more noise there is, so frames should be denoised first.

use fearless_simd::{f32x4, prelude::*};
use rayon::prelude::*;

use super::{Channel, View};
use crate::ImageSize;
use crate::cpu::Footprint;
use crate::simd::{Level, dispatch};

/// The running mean of the frames of a moving view.
#[derive(Debug, Default)]
pub struct TemporalAccumulation {
    history: History,
    /// The history of the frame being accumulated; afterwards that of the frame before, kept for
    /// its memory.
    next: History,
    /// The blended frame; between calls any frame, kept for its memory.
    blended: Vec<[u8; 4]>,
}

/// What earlier frames have shown, for the pixels of the last one.
#[derive(Debug, Default)]
struct History {
    /// Red, green and blue in sRGB levels from 0 to 255, and the number of frames of which they are
    /// the mean.
    pixels: Vec<[f32; 4]>,
    /// Whether all eight neighbours of a pixel show the same primitive.
    is_inner: Vec<bool>,
}

impl TemporalAccumulation {
    /// Starts over with a frame of `view` whose quality is that of the mean of `frames` frames.
    ///
    /// # Panics
    /// If the number of pixels of `frame` is not that of its view.
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

    /// Blends `frame`, of the view `now`, with the history, of the view `before`, on the threads of
    /// the current rayon pool.
    ///
    /// # Panics
    /// If the number of pixels of `frame` or of the history is not that of its view.
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

/// Scratch memory of a thread for one row of pixels.
struct RowMemory {
    footprints: Vec<Footprint>,
    /// Levels of the row, of the row above and of the row below.
    lines: [Vec<[f32; 4]>; 3],
    /// Column sums over the three rows, of levels and of their squares, with one more column at
    /// either end.
    sums: [Vec<[f32; 4]>; 2],
    /// Means and standard deviations of the 3 × 3 neighbourhoods.
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

/// A frame, and the history with which it is blended.
struct Blend<'a> {
    before: &'a View,
    history: &'a History,
    size: ImageSize,
    frame: &'a [[u8; 4]],
    /// Whether pixels of static primitives are where they were.
    is_camera_still: bool,
}

impl Blend<'_> {
    /// Computes mean and standard deviation of the neighbourhoods of row `y`; at the image's
    /// borders the outermost pixels are repeated.
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
            // Levels are integers, so the sums of their squares are exact in f32 and only the two
            // products round; the cancellation does no harm.
            *deviation = (square - *mean * *mean).max(0.0).sqrt();
        }
    }

    /// Blends row `y`, given the primitive of each pixel and whether its neighbours show the same
    /// one.
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
                // The more detail there is to lose, the fewer frames.
                let contrast = deviation[0].max(deviation[1]).max(deviation[2]).max(1.0);
                (CONTRAST / contrast).clamp(DETAIL_FRAMES_MAX, FRAMES_MAX)
            } else {
                EDGE_FRAMES_MAX
            };
            // A running mean up to `frames_max` frames, an exponential moving average from there
            // on.
            let frames = (frames + 1.0).min(frames_max);
            let mean = f32x4::from_slice(simd, &memory.means[x]);
            let range = f32x4::from_slice(simd, &deviation) * DEVIATIONS + LEVELS;
            // Clipped to the range of the current neighbourhood, which discards, for instance, the
            // history of a shadow that has moved on.
            let old = old.max(mean - range).max(0.0).min(mean + range).min(255.0);
            let now = f32x4::from_slice(simd, &now);
            let sum = old + (now - old) * (1.0 / frames);
            sum.store_slice(blended);
            blended[3] = frames;
        }
    }

    /// Whether a footprint coincides with pixel `index` itself, so that the history is not
    /// interpolated.
    #[inline(always)]
    fn is_still(&self, footprint: &Footprint, index: usize) -> bool {
        let [right, below] = footprint.shares;
        let is_whole = |share: f32| (share - 0.5).abs() > 0.5 - STILL_SHARE;
        let (right_of, below_of) = (usize::from(right > 0.5), usize::from(below > 0.5));
        let nearest = footprint.first as usize + right_of + below_of * self.size.width as usize;
        nearest == index && is_whole(right) && is_whole(below)
    }

    /// The history at a footprint and its number of frames: interpolated bicubically among sixteen
    /// pixels if they all show `primitive`, otherwise as by [`View::look_up`].
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
        // Short-circuiting: the last pixels may lie outside the image, but the outermost pixels are
        // never inner ones.
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
            // The minimum, as next to pixels that have just started over, the light of what was
            // there before leaks in.
            frames = frames.min(pixels[1][3]).min(pixels[2][3]);
        }
        Some((sum, frames))
    }
}

/// Cubic weights of four pixels in a row, for a position between the second and the third; from a
/// table of [`CUBIC_PLACES`] positions.
#[inline(always)]
fn cubic_weights(share: f32) -> &'static [f32; 4] {
    // The modulo lets the compiler drop the bounds check.
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

/// Keys' cubic at one to two pixels' distance.
const fn outer(share: f32) -> f32 {
    -SHARPNESS * share * (1.0 - share) * (1.0 - share)
}

/// Keys' cubic at up to one pixel's distance.
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

/// Determines which pixels of row `y` have eight neighbours that show the same primitive.
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
        // Without branches, so that it vectorises: XOR is 0 only for equal primitives.
        let mut differ = 0;
        for column in 0..3 {
            differ |= (above[column] ^ center) | (own[column] ^ center) | (below[column] ^ center);
        }
        *inner = differ == 0;
    }
}

/// Maximum number of frames averaged where the history moves. More of them lag behind
/// view-dependent effects such as highlights, and blur. Chosen by the error of turning views at 1
/// and 4 samples (`carom-bench motion`).
const FRAMES_MAX: f32 = 4.0;
/// Maximum number of frames averaged where neither camera nor primitive moves.
pub const STILL_FRAMES_MAX: f32 = 16.0;
/// The same at the edges of primitives, whose position within a pixel changes.
const EDGE_FRAMES_MAX: f32 = 1.5;
/// The same where there is the most detail.
const DETAIL_FRAMES_MAX: f32 = 1.5;
/// Number of frames averaged where the neighbourhood has a standard deviation of one level; it is
/// inversely proportional to the deviation.
const CONTRAST: f32 = 40.0;
/// The range that history is clipped to: standard deviations of the neighbourhood around its mean,
/// plus levels.
const DEVIATIONS: f32 = 2.5;
const LEVELS: f32 = 2.0;
/// Maximum weight of a neighbouring pixel in the footprint of a still pixel.
const STILL_SHARE: f32 = 0.01;
/// Minus the slope of the cubic at a distance of one pixel (Keys' −a): 0.5 interpolates parabolas
/// exactly, larger values sharpen.
const SHARPNESS: f32 = 0.75;
/// Number of tabulated positions between two pixels.
const CUBIC_PLACES: usize = 257;
