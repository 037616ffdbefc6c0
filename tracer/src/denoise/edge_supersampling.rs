//! Edge supersampling for images of few samples: pixels at edges of geometry or colour get more
//! camera rays than they have paths, and their light becomes a mixture of their own and a
//! neighbour's.

use std::ops::Range;

use fearless_simd::prelude::*;
use rayon::prelude::*;

use super::filter::Filter;
use super::input::{ALBEDO, DenoiseSource, EMISSION, LIGHT, NORMAL};
use super::neighbourhood::{NO_NORMAL, Neighbourhood, distance_squared, guide};
use super::soa_image::{Float, LANES, Mask};
use super::weights::{BRIGHTNESS_SHARE, EDGE_MIN, MIXED_MIN, NEIGHBOURS};
use crate::aov::{further_rays, further_share};
use crate::simd::{Level, dispatch};
use crate::{Aovs, CompiledScene, Tile, TraceJob};

/// Pixels with further camera rays, and what these hit.
#[derive(Default)]
pub(super) struct SupersampledEdges {
    pixels: Vec<(u32, u32)>,
    hits: Vec<Aovs>,
    /// End of each tile's range in the other two vectors.
    ends: Vec<usize>,
    /// Fraction of the further rays among all camera rays of such a pixel.
    pub(super) share: f32,
}

impl SupersampledEdges {
    pub(super) fn find(
        tracer: &(impl DenoiseSource + ?Sized),
        level: Level,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        filter: &Filter,
    ) -> Self {
        let Some(settings) = further_rays(job.settings) else {
            return Self::default();
        };
        let tiles = job.tiles.par_iter();
        let by_tile: Vec<Vec<_>> = tiles.map(|tile| filter.edge_pixels(level, *tile)).collect();
        // A prefix sum, so that the lists of all tiles can be concatenated.
        let ends = by_tile.iter().scan(0, |end, pixels| {
            *end += pixels.len();
            Some(*end)
        });
        let ends = ends.collect();
        let pixels = by_tile.concat();
        let hits = tracer.trace_hits(scene, job.size, settings, &pixels);
        Self {
            pixels,
            hits,
            ends,
            share: further_share(job.settings.samples),
        }
    }

    /// The edge pixels of the tile with this index, and what their further rays hit.
    pub(super) fn of_tile(&self, index: usize) -> impl Iterator<Item = (&(u32, u32), &Aovs)> {
        let end = self.ends.get(index).copied().unwrap_or(0);
        let begin = index
            .checked_sub(1)
            .map_or(0, |before| self.ends.get(before).copied().unwrap_or(0));
        self.pixels[begin..end].iter().zip(&self.hits[begin..end])
    }
}

impl Filter {
    /// The pixels of a tile that differ from one of their four neighbours, as image coordinates.
    pub(super) fn edge_pixels(&self, level: Level, tile: Tile) -> Vec<(u32, u32)> {
        let mut edge_pixels = Vec::new();
        let (columns, rows) = self.places(tile);
        for y in rows {
            dispatch!(level, simd => self.edges_in(simd, y, columns.clone(), &mut edge_pixels));
        }
        edge_pixels
    }

    #[inline(always)]
    fn edges_in<S: Simd>(
        &self,
        simd: S,
        y: usize,
        columns: Range<usize>,
        edge_pixels: &mut Vec<(u32, u32)>,
    ) {
        let around = Neighbourhood::new(&self.light, &self.guides, y, 1);
        for x in columns.clone().step_by(LANES) {
            let here = Appearance::new(simd, &around, x, 0, 0);
            let differs = here.differs(&Appearance::new(simd, &around, x, -1, 0))
                | here.differs(&Appearance::new(simd, &around, x, 1, 0))
                | here.differs(&Appearance::new(simd, &around, x, 0, -1))
                | here.differs(&Appearance::new(simd, &around, x, 0, 1));
            let bits = differs.to_bitmask();
            let lanes = (x..columns.end.min(x + LANES)).enumerate();
            let lanes = lanes.filter(|(lane, _)| bits >> lane & 1 == 1);
            let (left, y) = (self.bounds.x, self.bounds.y + y as u32);
            edge_pixels.extend(lanes.map(|(_, x)| (left + x as u32, y)));
        }
    }

    /// The radiance, without emission, of an edge pixel of whose camera rays a fraction `share` has
    /// hit `further`. With `a` the appearance of the pixel as seen by its samples, `s` as seen by
    /// all rays, and `b` that of a neighbour, the mixture `a + t(b − a)` nearest to `s` has
    /// `t = (s−a)·(b−a) / |b−a|²` (least squares). Of all neighbours, the one whose mixture is nearest
    /// is used.
    pub(super) fn mixed(&self, (x, y): (u32, u32), further: &Aovs, share: f32) -> [f32; 3] {
        let (x, y) = ((x - self.bounds.x) as usize, (y - self.bounds.y) as usize);
        let own = self.radiance_at(x, y);
        let here = self.appearance_at(x, y);
        let wanted =
            difference(appearance(further.albedo, further.normal), here).map(|c| c * share);
        let mut nearest = product(wanted, wanted);
        if nearest <= MIXED_MIN {
            return own;
        }
        let mut best = None;
        for (dx, dy) in NEIGHBOURS {
            let (x, y) = (
                x.wrapping_add_signed(dx as isize),
                y.wrapping_add_signed(dy as isize),
            );
            if x >= self.bounds.width as usize || y >= self.bounds.height as usize {
                continue;
            }
            // The normal [`NO_NORMAL`] of pixels that were not traced is so large that their `t` is
            // about 0.
            let other = difference(self.appearance_at(x, y), here);
            // The constant keeps `t` finite for neighbours that look like the pixel itself.
            let share = product(wanted, other) / (product(other, other) + 1e-4);
            let share = share.clamp(0.0, 1.0);
            let missing = difference(wanted, other.map(|other| other * share));
            let missing = product(missing, missing);
            // The margin keeps rounding from deciding between equally near neighbours, where CPU
            // and GPU would differ.
            if missing < nearest * 0.999 {
                (nearest, best) = (missing, Some((x, y, share)));
            }
        }
        best.map_or(own, |(x, y, share)| {
            let there = self.radiance_at(x, y);
            std::array::from_fn(|c| share.mul_add(there[c] - own[c], own[c]))
        })
    }

    fn appearance_at(&self, x: usize, y: usize) -> [f32; 6] {
        let guides = |first: usize| [0, 1, 2].map(|c| self.guides.get(first + c, x, y));
        appearance(guides(guide(ALBEDO)), guides(guide(NORMAL)))
    }

    fn radiance_at(&self, x: usize, y: usize) -> [f32; 3] {
        [0, 1, 2].map(|c| self.light.get(LIGHT + c, x, y))
    }
}

/// The features by which edges are detected.
struct Appearance<S: Simd> {
    albedo: [Float<S>; 3],
    normal: [Float<S>; 3],
    brightness: Float<S>,
}

impl<S: Simd> Appearance<S> {
    #[inline(always)]
    fn new(simd: S, around: &Neighbourhood<'_>, x: usize, dx: isize, dy: isize) -> Self {
        let (guides, _) = around.at(dy);
        Self {
            albedo: guides.triple(simd, guide(ALBEDO), x, dx),
            normal: guides.triple(simd, guide(NORMAL), x, dx),
            brightness: guides.load(simd, guide(EMISSION), x, dx),
        }
    }

    #[inline(always)]
    fn differs(&self, there: &Self) -> Mask<S> {
        // A quarter, as `appearance` takes half the normal.
        let apart = distance_squared(self.normal, there.normal) * 0.25
            + distance_squared(self.albedo, there.albedo);
        let brighter = (self.brightness - there.brightness).abs();
        let brightest = self.brightness.max(there.brightness);
        let differs = apart.simd_gt(EDGE_MIN) | brighter.simd_gt(brightest * BRIGHTNESS_SHARE);
        // Only the x component of a missing normal is set: traced pixels are below [`NO_NORMAL`].
        differs & there.normal[0].simd_lt(NO_NORMAL)
    }
}

/// Albedo and half the normal: without the factor, the normals of two sides of a box would outweigh
/// albedos.
fn appearance([r, g, b]: [f32; 3], [x, y, z]: [f32; 3]) -> [f32; 6] {
    [r, g, b, 0.5 * x, 0.5 * y, 0.5 * z]
}

fn difference(a: [f32; 6], b: [f32; 6]) -> [f32; 6] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn product(a: [f32; 6], b: [f32; 6]) -> f32 {
    a.into_iter().zip(b).map(|(a, b)| a * b).sum()
}
