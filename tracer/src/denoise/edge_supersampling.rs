//! Edge supersampling for pictures of few samples: where something else is seen beside a pixel, more camera
//! rays look at it than it has paths, and it becomes a mixture of its own light and a neighbour's.

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

/// Pixels that more rays look at than they have paths, and what the further ones meet.
#[derive(Default)]
pub(super) struct SupersampledEdges {
    pixels: Vec<(u32, u32)>,
    hits: Vec<Aovs>,
    /// Where each tile's end.
    ends: Vec<usize>,
    /// Share of the further rays among all that look at such a pixel.
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

    /// The pixels of the tile of this index.
    pub(super) fn of_tile(&self, index: usize) -> impl Iterator<Item = (&(u32, u32), &Aovs)> {
        let end = self.ends.get(index).copied().unwrap_or(0);
        let begin = index
            .checked_sub(1)
            .map_or(0, |before| self.ends.get(before).copied().unwrap_or(0));
        self.pixels[begin..end].iter().zip(&self.hits[begin..end])
    }
}

impl Filter {
    /// The pixels of a tile beside which something else is seen, as places on the picture.
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

    /// The radiance without emission of a pixel at an edge, of whose rays a `share` has met `further`: with `a` the
    /// appearance of the pixel to its samples, `s` to all rays, and `b` a neighbour's, the mixture
    /// `a + t(b − a)` nearest to `s` has `t = (s−a)·(b−a) / |b−a|²`; of all neighbours that one is taken
    /// whose mixture is nearest.
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
            // What was not traced is so far off that its share is nothing.
            let other = difference(self.appearance_at(x, y), here);
            let share = product(wanted, other) / (product(other, other) + 1e-4);
            let share = share.clamp(0.0, 1.0);
            let missing = difference(wanted, other.map(|other| other * share));
            let missing = product(missing, missing);
            // The margin keeps rounding from choosing between neighbours that are as near, where CPU and
            // GPU would differ.
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

/// What edges are seen by.
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
        let apart = distance_squared(self.normal, there.normal) * 0.25
            + distance_squared(self.albedo, there.albedo);
        let brighter = (self.brightness - there.brightness).abs();
        let brightest = self.brightness.max(there.brightness);
        let differs = apart.simd_gt(EDGE_MIN) | brighter.simd_gt(brightest * BRIGHTNESS_SHARE);
        differs & there.normal[0].simd_lt(NO_NORMAL)
    }
}

/// Albedo and half the normal, whose difference between two sides of a box is larger.
fn appearance([r, g, b]: [f32; 3], [x, y, z]: [f32; 3]) -> [f32; 6] {
    [r, g, b, 0.5 * x, 0.5 * y, 0.5 * z]
}

fn difference(a: [f32; 6], b: [f32; 6]) -> [f32; 6] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn product(a: [f32; 6], b: [f32; 6]) -> f32 {
    a.into_iter().zip(b).map(|(a, b)| a * b).sum()
}
