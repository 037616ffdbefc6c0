//! The filter: light divided by albedo, averaged over neighbours that look alike, times albedo.
//!
//! Three passes of an à-trous wavelet (Dammertz et al., "Edge-Avoiding À-Trous Wavelet Transform for
//! fast Global Illumination Filtering", HPG 2010) with steps of 1, 2 and 4 pixels, of 13 taps each. A
//! neighbour counts by how near its albedo, normal and inverse depth are, and its light by the
//! variance of both (Schied et al., "Spatiotemporal Variance-Guided Filtering", HPG 2017), which
//! comes from how far two halves of a pixel's samples are apart. The variance falls with more
//! samples, and the filter fades with it: pictures of many samples stay as they are.
//!
//! With fewer samples than outlines need, a pixel's first hits come from more camera rays than it
//! has paths. Such a pixel becomes the mixture of its own light and one neighbour's that explains
//! its albedo and normal best.

use fearless_simd::{Level, dispatch, f32x16, prelude::*};
use rayon::prelude::*;

use super::noisy::NoisyTile;
use super::weights::{
    ALBEDO_FACTOR, ALBEDO_MIN, DEPTH_FACTOR, MIXED_MIN, NEIGHBOURS, NORMAL_FACTOR, STEPS, TAPS,
    half_ratio, variances,
};
use crate::Tile;
use crate::layers::{Layers, SMOOTH_RAYS};

type Float<S> = f32x16<S>;
const LANES: usize = 16;

/// Rows and columns around the picture that taps may reach.
const PAD: usize = 8;
/// Planes of [`Filter::guides`].
const ALBEDO: usize = 0;
const NORMAL: usize = 3;
const INVERSE_DEPTH: usize = 6;
/// 1 where there is a pixel.
const VALID: usize = 7;
/// Planes of [`Filter::light`]: three of light over albedo.
const VARIANCE: usize = 3;

/// No surface has this normal, so that nothing mixes with what was not traced.
const NO_NORMAL: f32 = 1e6;

/// A picture in the making, column by column in planes.
pub(super) struct Filter {
    bounds: Tile,
    samples: u32,
    /// First hits of the same camera rays as `light`.
    guides: Planes,
    /// Albedo and normal of enough camera rays, where `light` has fewer.
    smooth: Option<Planes>,
    light: Planes,
}

impl Filter {
    /// Takes in all tiles of a region, of `samples` samples per pixel.
    pub(super) fn new(bounds: Tile, samples: u32, tiles: &[NoisyTile]) -> Self {
        let mut filter = Self {
            bounds,
            samples,
            guides: Planes::new(bounds, 8),
            smooth: (samples < SMOOTH_RAYS).then(|| Planes::new(bounds, 6)),
            light: Planes::new(bounds, 4),
        };
        filter.guides.plane_fill(NORMAL, NO_NORMAL);
        let touching = |y: usize| {
            let y = (bounds.y as usize + y) as u32;
            tiles.iter().filter_map(move |noisy| {
                let tile = noisy.tile;
                let row = y.checked_sub(tile.y).filter(|row| *row < tile.height)?;
                let pixels = (row * tile.width) as usize..((row + 1) * tile.width) as usize;
                // Blocks of a guard band may jut out of the bounds.
                let skipped = bounds.x.saturating_sub(tile.x).min(tile.width) as usize;
                let room = (bounds.x + bounds.width)
                    .saturating_sub(tile.x)
                    .min(tile.width);
                let end = (pixels.start + room as usize).max(pixels.start + skipped);
                let x = (tile.x as usize + skipped).saturating_sub(bounds.x as usize);
                Some((noisy, x, pixels.start + skipped..end))
            })
        };
        filter.guides.par_rows_mut().for_each(|(y, mut row)| {
            for (noisy, x, pixels) in touching(y) {
                row.put_guides(x, &noisy.hits[pixels]);
            }
        });
        if let Some(smooth) = &mut filter.smooth {
            smooth.par_rows_mut().for_each(|(y, mut row)| {
                for (noisy, x, pixels) in touching(y) {
                    row.put_smooth(x, &noisy.smooth_layers[pixels]);
                }
            });
        }
        filter.light.par_rows_mut().for_each(|(y, mut row)| {
            for (noisy, x, pixels) in touching(y) {
                row.put_light(x, noisy, pixels, samples);
            }
        });
        filter
    }

    /// Radiance without emission, row by row of the bounds.
    pub(super) fn run(mut self, level: Level) -> Filtered {
        let mut next = Planes::new(self.bounds, 4);
        self.pass(level, &mut next, Pass::Variance);
        std::mem::swap(&mut self.light, &mut next);
        for (index, step) in STEPS.into_iter().enumerate() {
            let variances = variances(self.samples, index);
            let step = step as isize;
            self.pass(level, &mut next, Pass::Smooth { step, variances });
            std::mem::swap(&mut self.light, &mut next);
        }
        self.pass(level, &mut next, Pass::Resolve);
        Filtered {
            bounds: self.bounds,
            radiance: next,
        }
    }

    fn pass(&self, level: Level, to: &mut Planes, pass: Pass) {
        to.par_rows_mut().for_each(|(y, mut row)| {
            let row = &mut row;
            dispatch!(level, simd => match pass {
                Pass::Variance => self.estimate_variance(simd, y, row),
                Pass::Smooth { step, variances } => self.smooth_row(simd, y, step, variances, row),
                Pass::Resolve => self.resolve(simd, y, row),
            });
        });
    }

    /// The mean variance of 3 × 3 pixels; of single samples, their variance among each other.
    #[inline(always)]
    fn estimate_variance<S: Simd>(&self, simd: S, y: usize, out: &mut RowMut<'_>) {
        let around = Around::new(self, y, 1);
        for x in (0..self.bounds.width as usize).step_by(LANES) {
            let zero = Float::splat(simd, 0.0);
            let (mut count, mut sum, mut squares) = (zero, [zero; 3], zero);
            for (dx, dy) in [(0, 0)].into_iter().chain(NEIGHBOURS) {
                let (dx, dy) = (dx as isize, dy as isize);
                let (guides, light) = around.at(dy);
                count += guides.load(simd, VALID, x, dx);
                if self.samples == 1 {
                    let light = light.triple(simd, 0, x, dx);
                    squares += dot(light, light);
                    sum = [sum[0] + light[0], sum[1] + light[1], sum[2] + light[2]];
                } else {
                    squares += light.load(simd, VARIANCE, x, dx);
                }
            }
            let inverse = 1.0 / count.max(1.0);
            let mean = sum.map(|sum| sum * inverse);
            let variance = (squares * inverse - dot(mean, mean)).max(0.0);
            out.store_light(x, around.at(0).1.triple(simd, 0, x, 0), variance);
        }
    }

    /// One pass of the wavelet.
    #[inline(always)]
    fn smooth_row<S: Simd>(
        &self,
        simd: S,
        y: usize,
        step: isize,
        variances: f32,
        out: &mut RowMut<'_>,
    ) {
        let around = Around::new(self, y, step);
        for x in (0..self.bounds.width as usize).step_by(LANES) {
            let here = Look::new(simd, &around, x, 0, 0);
            let square = here.inverse_depth * here.inverse_depth;
            let depth_factor = DEPTH_FACTOR / square.max(1e-20);
            let mut weights = Float::splat(simd, 1.0);
            let (mut sum, mut variance_sum) = (here.light, here.variance);
            for (dx, dy, tap_weight) in TAPS {
                let there = Look::new(simd, &around, x, dx as isize * step, dy as isize);
                let weight = here.weight(simd, &there, depth_factor, variances) * tap_weight;
                weights += weight;
                for (sum, light) in sum.iter_mut().zip(there.light) {
                    *sum = weight.mul_add(light, *sum);
                }
                variance_sum = (weight * weight).mul_add(there.variance, variance_sum);
            }
            let inverse = 1.0 / weights;
            let mean = sum.map(|sum| sum * inverse);
            out.store_light(x, mean, variance_sum * (inverse * inverse));
        }
    }

    /// Light times albedo, mixed where first hits of more rays say so.
    #[inline(always)]
    fn resolve<S: Simd>(&self, simd: S, y: usize, out: &mut RowMut<'_>) {
        let around = Around::new(self, y, 1);
        for x in (0..self.bounds.width as usize).step_by(LANES) {
            let mut radiance = around.radiance(simd, x, 0, 0);
            if let Some(smooth) = &self.smooth {
                radiance = around.mixed(simd, smooth.row(y, 0), x, radiance);
            }
            out.store_light(x, radiance, Float::splat(simd, 0.0));
        }
    }
}

/// The rows that the taps of one row lie in.
struct Around<'a> {
    guides: [Row<'a>; 5],
    light: [Row<'a>; 5],
}

impl<'a> Around<'a> {
    fn new(filter: &'a Filter, y: usize, step: isize) -> Self {
        let offsets = [-2 * step, -step, 0, step, 2 * step];
        Self {
            guides: offsets.map(|dy| filter.guides.row(y, dy)),
            light: offsets.map(|dy| filter.light.row(y, dy)),
        }
    }

    /// Guides and light `dy` steps further down.
    #[inline(always)]
    fn at(&self, dy: isize) -> (Row<'a>, Row<'a>) {
        let row = 2usize.wrapping_add_signed(dy);
        (self.guides[row], self.light[row])
    }

    #[inline(always)]
    fn radiance<S: Simd>(&self, simd: S, x: usize, dx: isize, dy: isize) -> [Float<S>; 3] {
        let (guides, light) = self.at(dy);
        let albedo = guides.triple(simd, ALBEDO, x, dx);
        let light = light.triple(simd, 0, x, dx);
        [
            light[0] * (albedo[0] + ALBEDO_MIN),
            light[1] * (albedo[1] + ALBEDO_MIN),
            light[2] * (albedo[2] + ALBEDO_MIN),
        ]
    }

    /// With `a` the appearance of a pixel, `s` that of more rays there, and `b` a neighbour's, the
    /// mixture `a + t(b − a)` nearest to `s` has `t = (s−a)·(b−a) / |b−a|²`; of all neighbours that
    /// one is taken whose mixture is nearest.
    #[inline(always)]
    fn mixed<S: Simd>(
        &self,
        simd: S,
        smooth: Row<'_>,
        x: usize,
        radiance: [Float<S>; 3],
    ) -> [Float<S>; 3] {
        let here = appearance(simd, self.at(0).0, x, 0);
        let wanted = difference(appearance(simd, smooth, x, 0), here);
        let mut nearest = product(wanted, wanted);
        let mixes = nearest.simd_gt(MIXED_MIN);
        if !mixes.any_true() {
            return radiance;
        }
        let mut mixed = radiance;
        for (dx, dy) in NEIGHBOURS {
            let (dx, dy) = (dx as isize, dy as isize);
            let other = difference(appearance(simd, self.at(dy).0, x, dx), here);
            let share = product(wanted, other) / (product(other, other) + 1e-4);
            let share = share.max(0.0).min(1.0);
            let missing = difference(wanted, other.map(|other| other * share));
            let missing = product(missing, missing);
            // Whatever the neighbours in the lanes need.
            let better = mixes & missing.simd_lt(nearest * 0.999);
            nearest = better.select(missing, nearest);
            let there = self.radiance(simd, x, dx, dy);
            for ((mixed, radiance), there) in mixed.iter_mut().zip(radiance).zip(there) {
                *mixed = better.select(share.mul_add(there - radiance, radiance), *mixed);
            }
        }
        mixed
    }
}

/// What the taps of a pass see of pixels.
struct Look<S: Simd> {
    albedo: [Float<S>; 3],
    normal: [Float<S>; 3],
    inverse_depth: Float<S>,
    light: [Float<S>; 3],
    variance: Float<S>,
}

impl<S: Simd> Look<S> {
    #[inline(always)]
    fn new(simd: S, around: &Around<'_>, x: usize, dx: isize, dy: isize) -> Self {
        let (guides, light) = around.at(dy);
        Self {
            albedo: guides.triple(simd, ALBEDO, x, dx),
            normal: guides.triple(simd, NORMAL, x, dx),
            inverse_depth: guides.load(simd, INVERSE_DEPTH, x, dx),
            light: light.triple(simd, 0, x, dx),
            variance: light.load(simd, VARIANCE, x, dx),
        }
    }

    /// How much a neighbour counts, from 0 to 1.
    #[inline(always)]
    fn weight(&self, simd: S, there: &Self, depth_factor: Float<S>, variances: f32) -> Float<S> {
        let by_depth = self.inverse_depth - there.inverse_depth;
        let likely = (self.variance + there.variance) * variances + 1e-10;
        let mut distance = distance_squared(self.light, there.light) / likely;
        distance += distance_squared(self.albedo, there.albedo) * ALBEDO_FACTOR;
        distance += distance_squared(self.normal, there.normal) * NORMAL_FACTOR;
        distance += by_depth * by_depth * depth_factor;
        let near = 1.0 - distance;
        // Nothing counts where this is not a number.
        let counts = distance.simd_lt(1.0);
        counts.select(near * near, Float::splat(simd, 0.0))
    }
}

/// Albedo and half the normal, whose difference between two sides of a box is larger.
#[inline(always)]
fn appearance<S: Simd>(simd: S, guides: Row<'_>, x: usize, dx: isize) -> [Float<S>; 6] {
    let [r, g, b] = guides.triple(simd, ALBEDO, x, dx);
    let n = guides.triple(simd, NORMAL, x, dx);
    [r, g, b, n[0] * 0.5, n[1] * 0.5, n[2] * 0.5]
}

#[derive(Clone, Copy)]
enum Pass {
    Variance,
    Smooth { step: isize, variances: f32 },
    Resolve,
}

/// A filtered region.
pub(super) struct Filtered {
    bounds: Tile,
    radiance: Planes,
}

impl Filtered {
    /// A tile's radiance, with the emission of its first hits.
    pub(super) fn tile(&self, noisy: &NoisyTile) -> Vec<[f32; 3]> {
        let tile = noisy.tile;
        let mut pixels = Vec::with_capacity(tile.pixels());
        let hits = noisy.smoothest_layers().chunks_exact(tile.width as usize);
        for (y, hits) in ((tile.y - self.bounds.y) as usize..).zip(hits) {
            let x = (tile.x - self.bounds.x) as usize;
            let [r, g, b] = [0, 1, 2].map(|plane| self.radiance.pixels(plane, x, y, hits.len()));
            let light = r.iter().zip(g).zip(b);
            pixels.extend(light.zip(hits).map(|(((r, g), b), hit)| {
                let [x, y, z] = hit.emission;
                [r + x, g + y, b + z]
            }));
        }
        pixels
    }
}

/// Planes of numbers, row by row: a row of the first plane, of the second, …, then the next row.
struct Planes {
    planes: usize,
    stride: usize,
    rows: usize,
    data: Vec<f32>,
}

/// One row of all planes, to read: looked up once for a row of results rather than for each tap.
#[derive(Clone, Copy)]
struct Row<'a> {
    stride: usize,
    data: &'a [f32],
}

/// One row of all planes.
struct RowMut<'a> {
    stride: usize,
    data: &'a mut [f32],
}

impl Planes {
    fn new(bounds: Tile, planes: usize) -> Self {
        let stride = bounds.width as usize + 2 * PAD + LANES;
        let rows = bounds.height as usize;
        Self {
            planes,
            stride,
            rows,
            data: vec![0.0; (rows + 2 * PAD) * planes * stride],
        }
    }

    fn plane_fill(&mut self, plane: usize, value: f32) {
        let begin = plane * self.stride;
        for row in self.data.chunks_exact_mut(self.planes * self.stride) {
            row[begin..begin + self.stride].fill(value);
        }
    }

    /// The picture's rows, without those around it.
    fn par_rows_mut(&mut self) -> impl IndexedParallelIterator<Item = (usize, RowMut<'_>)> {
        let (stride, row) = (self.stride, self.planes * self.stride);
        let rows = self.data[PAD * row..].par_chunks_exact_mut(row);
        let rows = rows.take(self.rows);
        rows.map(move |data| RowMut { stride, data }).enumerate()
    }

    fn pixels(&self, plane: usize, x: usize, y: usize, count: usize) -> &[f32] {
        let begin = ((y + PAD) * self.planes + plane) * self.stride + PAD + x;
        &self.data[begin..begin + count]
    }

    fn row(&self, y: usize, dy: isize) -> Row<'_> {
        let floats = self.planes * self.stride;
        let begin = (y + PAD).wrapping_add_signed(dy) * floats;
        Row {
            stride: self.stride,
            data: &self.data[begin..begin + floats],
        }
    }
}

impl Row<'_> {
    #[inline(always)]
    fn load<S: Simd>(self, simd: S, plane: usize, x: usize, dx: isize) -> Float<S> {
        let begin = plane * self.stride + (x + PAD).wrapping_add_signed(dx);
        Float::from_slice(simd, &self.data[begin..][..LANES])
    }

    #[inline(always)]
    fn triple<S: Simd>(self, simd: S, plane: usize, x: usize, dx: isize) -> [Float<S>; 3] {
        [
            self.load(simd, plane, x, dx),
            self.load(simd, plane + 1, x, dx),
            self.load(simd, plane + 2, x, dx),
        ]
    }
}

impl RowMut<'_> {
    fn plane(&mut self, plane: usize, x: usize, count: usize) -> &mut [f32] {
        &mut self.data[plane * self.stride + PAD + x..][..count]
    }

    fn put(&mut self, plane: usize, x: usize, values: impl ExactSizeIterator<Item = f32>) {
        for (to, value) in self.plane(plane, x, values.len()).iter_mut().zip(values) {
            *to = value;
        }
    }

    fn put_guides(&mut self, x: usize, hits: &[Layers]) {
        self.put_smooth(x, hits);
        self.put(INVERSE_DEPTH, x, hits.iter().map(|hit| hit.inverse_depth));
        self.plane(VALID, x, hits.len()).fill(1.0);
    }

    fn put_smooth(&mut self, x: usize, hits: &[Layers]) {
        for channel in 0..3 {
            self.put(
                ALBEDO + channel,
                x,
                hits.iter().map(|hit| hit.albedo[channel]),
            );
            self.put(
                NORMAL + channel,
                x,
                hits.iter().map(|hit| hit.normal[channel]),
            );
        }
    }

    /// Light over albedo, and the variance of its mean from that of its halves.
    fn put_light(
        &mut self,
        x: usize,
        noisy: &NoisyTile,
        pixels: std::ops::Range<usize>,
        samples: u32,
    ) {
        let hits = &noisy.hits[pixels.clone()];
        let light = &noisy.radiance[pixels.clone()];
        for channel in 0..3 {
            let over_albedo = |(light, hit): (&[f32; 3], &Layers)| {
                light[channel] / (hit.albedo[channel] + ALBEDO_MIN)
            };
            self.put(channel, x, light.iter().zip(hits).map(over_albedo));
        }
        if samples > 1 {
            let half = &noisy.half[pixels];
            let ratio = half_ratio(samples);
            let variance = |((light, half), hit): ((&[f32; 3], &[f32; 3]), &Layers)| {
                let channel = |c: usize| {
                    let apart = ratio * (half[c] - light[c]) / (hit.albedo[c] + ALBEDO_MIN);
                    apart * apart
                };
                channel(0) + channel(1) + channel(2)
            };
            let pixels = light.iter().zip(half).zip(hits);
            self.put(VARIANCE, x, pixels.map(variance));
        }
    }

    #[inline(always)]
    fn store_light<S: Simd>(&mut self, x: usize, light: [Float<S>; 3], variance: Float<S>) {
        let [r, g, b] = light;
        for (plane, values) in [r, g, b, variance].into_iter().enumerate() {
            values.store_slice(self.plane(plane, x, LANES));
        }
    }
}

#[inline(always)]
fn dot<S: Simd>(a: [Float<S>; 3], b: [Float<S>; 3]) -> Float<S> {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[inline(always)]
fn distance_squared<S: Simd>(a: [Float<S>; 3], b: [Float<S>; 3]) -> Float<S> {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    dot(d, d)
}

#[inline(always)]
fn difference<S: Simd>(a: [Float<S>; 6], b: [Float<S>; 6]) -> [Float<S>; 6] {
    let mut difference = a;
    for (a, b) in difference.iter_mut().zip(b) {
        *a -= b;
    }
    difference
}

#[inline(always)]
fn product<S: Simd>(a: [Float<S>; 6], b: [Float<S>; 6]) -> Float<S> {
    dot([a[0], a[1], a[2]], [b[0], b[1], b[2]]) + dot([a[3], a[4], a[5]], [b[3], b[4], b[5]])
}
