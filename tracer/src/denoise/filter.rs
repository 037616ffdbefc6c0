//! The denoising filter: light is divided by albedo, averaged over similar neighbours, and
//! multiplied by albedo.
//!
//! Three passes of an à-trous wavelet (Dammertz et al., "Edge-Avoiding À-Trous Wavelet Transform
//! for fast Global Illumination Filtering", HPG 2010) with 9 taps at distances of 1, 2 and then 4
//! pixels. A neighbour is weighted by the similarity of its albedo, normal and inverse depth, and
//! of its light in relation to the pixel's variance (Schied et al., "Spatiotemporal Variance-Guided
//! Filtering", HPG 2017), which is estimated from the difference of two halves of the samples. The
//! variance falls as samples are added, and the filter fades with it: images of many samples are
//! left as they are, and their edges do not need [`super::edge_supersampling`] either.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use fearless_simd::prelude::*;
use rayon::prelude::*;

use super::guard_band::{EMPTY, GuardedRegion};
use super::input::{ALBEDO, DenoiseInputTile, EMISSION, INVERSE_DEPTH, LIGHT, NORMAL, VARIANCE};
use super::neighbourhood::{NO_NORMAL, Neighbourhood, distance_squared, guide};
use super::soa_image::{Float, LANES, SoaImage, SoaRowMut};
use super::variance::ColumnSums;
use super::weights::{ALBEDO_MIN, NEIGHBOURS, PASSES, PassWeights, variances};
use crate::Tile;
use crate::aov::further_share;
use crate::simd::{Level, dispatch};

/// An image while it is filtered, as planes of floats.
pub(super) struct Filter {
    pub(super) bounds: Tile,
    samples: u32,
    /// Planes [`LIGHT`] and [`VARIANCE`]; after the last pass, radiance without emission.
    pub(super) light: SoaImage,
    /// Output of the current pass, which then becomes `light`.
    next: SoaImage,
    /// The planes that follow in [`super::DenoiseInput`]: albedo, normal and inverse depth; of
    /// emission only the sum over the channels, and only if edges are to be found.
    pub(super) guides: SoaImage,
}

/// Memory of a finished filter, for reuse by the next: allocating as much anew takes as long as a
/// pass.
#[derive(Default)]
pub(crate) struct FilterMemory(Mutex<[Vec<f32>; 3]>);

/// Maximum number of floats that are kept, more than a filter of 1280×720 pixels takes; a larger
/// filter's memory is freed.
const KEPT_FLOATS_MAX: usize = 1 << 25;

/// Writes tiles into the planes, from any thread.
pub(super) struct FilterWriter<'a> {
    bounds: Tile,
    takes_emission: bool,
    rows: Vec<Mutex<[SoaRowMut<'a>; 2]>>,
}

impl Filter {
    /// A filter for `region`, whose pixels are to be written by [`Self::writer`].
    pub(super) fn new(region: &GuardedRegion, samples: u32, memory: &FilterMemory) -> Self {
        let bounds = region.bounds;
        let columns = EMISSION + usize::from(further_share(samples) > 0.0);
        let [light, next, guides] = std::mem::take(&mut *memory.lock());
        let mut filter = Self {
            bounds,
            samples,
            light: SoaImage::new(bounds, VARIANCE + 1, light),
            next: SoaImage::new(bounds, VARIANCE + 1, next),
            guides: SoaImage::new(bounds, guide(columns), guides),
        };
        // Pixels that are not traced have no light, and a normal that no surface has.
        filter.guides.surround(guide(NORMAL), NO_NORMAL);
        for y in region.rows_with_holes() {
            filter.light.fill_row(y, LIGHT..VARIANCE + 1, 0.0);
            let normal = guide(NORMAL)..guide(NORMAL) + 1;
            filter.guides.fill_row(y, normal, NO_NORMAL);
        }
        filter
    }

    pub(super) fn give_back(self, memory: &FilterMemory) {
        let planes = [self.light, self.next, self.guides].map(SoaImage::into_memory);
        if planes.iter().map(Vec::len).sum::<usize>() <= KEPT_FLOATS_MAX {
            *memory.lock() = planes;
        }
    }

    pub(super) fn writer(&mut self) -> FilterWriter<'_> {
        let rows = self.light.rows_mut().zip(self.guides.rows_mut());
        FilterWriter {
            bounds: self.bounds,
            takes_emission: further_share(self.samples) > 0.0,
            rows: rows
                .map(|(light, guides)| Mutex::new([light, guides]))
                .collect(),
        }
    }

    /// Runs all passes; `light` then holds radiance without emission.
    pub(super) fn run(&mut self, level: Level) {
        // Taken out of `self`, as its rows are written while the rest of the filter is read.
        let mut next = std::mem::replace(&mut self.next, SoaImage::new(EMPTY, 0, Vec::new()));
        for (index, weights) in PASSES.into_iter().enumerate() {
            let pass = Pass {
                step: weights.step as isize,
                weights,
                variances: variances(self.samples, index),
                is_first: index == 0,
                is_last: index == PASSES.len() - 1,
            };
            next.par_rows_mut()
                .for_each_init(ColumnSums::default, |columns, (y, mut row)| {
                    dispatch!(level, simd => self.smooth_row(simd, y, pass, columns, &mut row));
                });
            std::mem::swap(&mut self.light, &mut next);
        }
        self.next = next;
    }

    /// One pass of the wavelet over a row.
    #[inline(always)]
    fn smooth_row<S: Simd>(
        &self,
        simd: S,
        y: usize,
        pass: Pass,
        columns: &mut ColumnSums,
        out: &mut SoaRowMut<'_>,
    ) {
        let around = Neighbourhood::new(&self.light, &self.guides, y, pass.step);
        let (width, is_single) = (self.bounds.width as usize, self.samples == 1);
        if pass.is_first {
            columns.sum_up(simd, &around, width, is_single);
        }
        for x in (0..width).step_by(LANES) {
            let own = || around.at(0).1.load(simd, VARIANCE, x, 0);
            let variance = match (pass.is_first, is_single) {
                (true, true) => columns.variance(simd, x, true),
                // A bright outlier has a larger variance than the mean of its neighbourhood tells;
                // with the mean alone it would be preserved as a feature.
                (true, false) => columns.variance(simd, x, false).max(own()),
                (false, _) => around.mean_variance(simd, x, pass.step),
            };
            let here = Look::new(simd, &around, x, 0, 0);
            let square = here.inverse_depth * here.inverse_depth;
            let factors = Factors {
                normal: pass.weights.normal,
                albedo: pass.weights.albedo,
                // Relative to the pixel's own depth, as the footprint of a pixel grows with
                // distance.
                depth: pass.weights.depth / square.max(1e-20),
                // Without noise only equal light counts, so the filter fades as samples are added.
                light: 1.0 / (variance * pass.variances + 1e-10),
            };
            let one = Float::splat(simd, 1.0);
            // The pixel itself has weight 1, so the sum of weights is never 0.
            let (mut weights, mut squares, mut sum) = (one, one, here.light);
            for (dx, dy) in NEIGHBOURS {
                let there = Look::new(simd, &around, x, dx as isize * pass.step, dy as isize);
                let weight = here.weight(simd, &there, &factors) * pass.weights.tap((dx, dy));
                weights += weight;
                squares = weight.mul_add(weight, squares);
                for (sum, light) in sum.iter_mut().zip(there.light) {
                    *sum = weight.mul_add(light, *sum);
                }
            }
            let inverse = 1.0 / weights;
            for (channel, sum) in sum.into_iter().enumerate() {
                let light = sum * inverse;
                let light = if pass.is_last {
                    light * (here.albedo[channel] + ALBEDO_MIN)
                } else {
                    light
                };
                out.store(LIGHT + channel, x, light);
            }
            if !pass.is_last {
                // Var[Σ w l / Σ w] of independent taps of equal variance: Var[l] Σ w² / (Σ w)².
                out.store(VARIANCE, x, variance * squares * (inverse * inverse));
            }
        }
    }

    /// Radiance of a tile without emission, after the filter has run.
    pub(super) fn radiance(&self, tile: Tile) -> Vec<[f32; 3]> {
        let (columns, rows) = self.places(tile);
        let mut pixels = Vec::with_capacity(tile.pixels());
        for y in rows {
            let row = self.light.row(y, 0);
            let [r, g, b] = [0, 1, 2].map(|c| row.numbers(LIGHT + c, columns.clone()));
            let channels = r.iter().zip(g).zip(b);
            pixels.extend(channels.map(|((&r, &g), &b)| [r, g, b]));
        }
        pixels
    }

    /// Ranges of columns and rows of a tile in the planes.
    pub(super) fn places(&self, tile: Tile) -> (Range<usize>, Range<usize>) {
        let (x, y) = (
            (tile.x - self.bounds.x) as usize,
            (tile.y - self.bounds.y) as usize,
        );
        (x..x + tile.width as usize, y..y + tile.height as usize)
    }
}

impl FilterMemory {
    fn lock(&self) -> MutexGuard<'_, [Vec<f32>; 3]> {
        // The memory's contents do not matter, so it may be reused after a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FilterWriter<'_> {
    /// Writes the part of a tile that lies in the bounds: blocks of the guard band may extend
    /// beyond them.
    pub(super) fn put(&self, input: &DenoiseInputTile) {
        let (tile, bounds) = (input.tile, self.bounds);
        let skipped = bounds.x.saturating_sub(tile.x).min(tile.width) as usize;
        let room = (bounds.x + bounds.width)
            .saturating_sub(tile.x)
            .min(tile.width) as usize;
        let x = (tile.x as usize + skipped).saturating_sub(bounds.x as usize);
        let brightness = self.takes_emission.then(|| input.pixels.brightness());
        for row in 0..tile.height {
            let y = (tile.y + row).checked_sub(bounds.y);
            let Some(to) = y.and_then(|y| self.rows.get(y as usize)) else {
                continue;
            };
            // One lock per row: tiles side by side share rows, tiles above each other do not.
            let mut to = to.lock().unwrap_or_else(PoisonError::into_inner);
            let [light, guides] = &mut *to;
            let begin = (row * tile.width) as usize;
            let pixels = begin + skipped..begin + room.max(skipped);
            for (column, values) in input.pixels.columns[..EMISSION].iter().enumerate() {
                match values.get(pixels.clone()) {
                    Some(values) if column < ALBEDO => light.put(column, x, values),
                    Some(values) => guides.put(guide(column), x, values),
                    None => {}
                }
            }
            if let Some(brightness) = &brightness {
                guides.put(guide(EMISSION), x, &brightness[pixels]);
            }
        }
    }
}

#[derive(Clone, Copy)]
struct Pass {
    step: isize,
    weights: PassWeights,
    variances: f32,
    /// Whether the variances are still those of single pixels.
    is_first: bool,
    /// Whether it multiplies light by albedo.
    is_last: bool,
}

/// A pixel's features that taps are weighted by.
struct Look<S: Simd> {
    albedo: [Float<S>; 3],
    normal: [Float<S>; 3],
    inverse_depth: Float<S>,
    light: [Float<S>; 3],
}

/// Factors of squared differences in a tap's distance.
struct Factors<S: Simd> {
    normal: f32,
    albedo: f32,
    depth: Float<S>,
    light: Float<S>,
}

impl<S: Simd> Look<S> {
    #[inline(always)]
    fn new(simd: S, around: &Neighbourhood<'_>, x: usize, dx: isize, dy: isize) -> Self {
        let (guides, light) = around.at(dy);
        Self {
            albedo: guides.triple(simd, guide(ALBEDO), x, dx),
            normal: guides.triple(simd, guide(NORMAL), x, dx),
            inverse_depth: guides.load(simd, guide(INVERSE_DEPTH), x, dx),
            light: light.triple(simd, LIGHT, x, dx),
        }
    }

    /// Weight of a neighbour, from 0 to 1.
    #[inline(always)]
    fn weight(&self, simd: S, there: &Self, factors: &Factors<S>) -> Float<S> {
        let by_depth = self.inverse_depth - there.inverse_depth;
        let mut distance = distance_squared(self.light, there.light) * factors.light;
        distance += distance_squared(self.albedo, there.albedo) * factors.albedo;
        distance += distance_squared(self.normal, there.normal) * factors.normal;
        distance += by_depth * by_depth * factors.depth;
        // A squared parabola (Tukey's biweight) falls smoothly to 0 at distance 1 and needs no
        // exponential.
        let near = 1.0 - distance;
        // A comparison with NaN is false, so such a tap has no weight.
        let counts = distance.simd_lt(1.0);
        counts.select(near * near, Float::splat(simd, 0.0))
    }
}

/// The guides lie in the order of [`super::DenoiseInput`]'s columns.
const _: () = assert!(NORMAL == ALBEDO + 3 && guide(ALBEDO) == 0 && VARIANCE + 1 == ALBEDO);
/// Reach of a pixel's dependencies: the taps of all passes, and a neighbour that it is mixed with.
const _: () =
    assert!((PASSES[0].step + PASSES[1].step + PASSES[2].step + 1) as u32 == super::SUPPORT);
