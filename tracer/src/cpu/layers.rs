//! First hits, a pixel per lane.

use fearless_simd::prelude::*;

use super::bsdf::Bsdf;
use super::geometry::{NONE, Nearest, Rays};
use super::integrator::Prepared;
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use crate::layers::rows;
use crate::sampling::{pixel_key, sample_key};
use crate::{Layers, Tile};

struct Sum<S: Simd> {
    albedo: Vec3x<S>,
    normal: Vec3x<S>,
    inverse_depth: Float<S>,
    emission: Vec3x<S>,
}

impl Prepared {
    /// Means over the samples of each pixel of a tile.
    #[inline(always)]
    pub(super) fn layers<S: Simd>(&self, simd: S, tile: Tile) -> Vec<Layers> {
        let mut pixels = Vec::with_capacity(tile.pixels());
        for row in rows(tile) {
            for x in (row.x..row.x + row.width).step_by(LANES) {
                let lanes = LANES.min((row.x + row.width - x) as usize);
                simd.vectorize(
                    #[inline(always)]
                    || self.layers_at(simd, x, row.y, lanes, &mut pixels),
                );
            }
        }
        pixels
    }

    #[inline(always)]
    fn layers_at<S: Simd>(&self, simd: S, x: u32, y: u32, lanes: usize, pixels: &mut Vec<Layers>) {
        // Lanes beyond the row repeat its last pixel, within the coordinates' range.
        let column = |lane: usize| x + lane.min(lanes - 1) as u32;
        let films: [u32; LANES] = std::array::from_fn(|lane| (y << 16) | column(lane));
        let keys: [u32; LANES] = std::array::from_fn(|lane| pixel_key(column(lane), y));
        let (film, pixel) = (Word::load_array(simd, films), Word::load_array(simd, keys));
        let zero = Vec3x::splat(simd, [0.0; 3]);
        let mut sum = Sum {
            albedo: zero,
            normal: zero,
            inverse_depth: Float::splat(simd, 0.0),
            emission: zero,
        };
        for taken in 0..self.settings.samples {
            let sample = self.settings.first_sample.wrapping_add(taken);
            let sample = Word::splat(simd, sample_key(sample));
            let direction = self.camera_direction(simd, film, pixel, sample);
            self.add_layers(simd, direction, &mut sum);
        }
        let share = 1.0 / self.settings.samples as f32;
        let arrays = |v: Vec3x<S>| [v.x, v.y, v.z].map(|c| (c * share).to_array());
        let (albedo, normal) = (arrays(sum.albedo), arrays(sum.normal));
        let emission = arrays(sum.emission);
        let inverse_depth = (sum.inverse_depth * share).to_array();
        let triple = |columns: &[[f32; LANES]; 3], lane: usize| {
            [columns[0][lane], columns[1][lane], columns[2][lane]]
        };
        pixels.extend((0..lanes).map(|lane| Layers {
            albedo: triple(&albedo, lane),
            normal: triple(&normal, lane),
            inverse_depth: inverse_depth[lane],
            emission: triple(&emission, lane),
        }));
    }

    #[inline(always)]
    fn add_layers<S: Simd>(&self, simd: S, direction: Vec3x<S>, sum: &mut Sum<S>) {
        let origin = self.eye(simd);
        let length = direction.length_squared().sqrt();
        let direction = direction * (1.0 / length);
        let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
        let nearest = self.geometry.nearest(simd, &rays);
        let ended = nearest.id.simd_ge(self.geometry.lamps_first);
        if ended.any_true() {
            sum.emission = sum.emission + self.emission(simd, direction, &nearest, ended);
        }
        if ended.all_true() {
            return;
        }
        // Lanes that ended are computed as if on the first surface, and left out.
        let met = !ended;
        let id = met.select(nearest.id, Word::splat(simd, 0));
        let distance = met.select(nearest.distance, Float::splat(simd, 1.0));
        let hit = self.surfaces.hit(simd, origin, direction, distance, id);
        let zero = Vec3x::splat(simd, [0.0; 3]);
        let bsdf = Bsdf::new(simd, &hit, -direction);
        let albedo = bsdf.albedo(simd, hit.albedo);
        sum.albedo = sum.albedo + Vec3x::select(met, albedo, zero);
        sum.normal = sum.normal + Vec3x::select(met, hit.normal, zero);
        sum.inverse_depth += met.select(length / distance, zero.x);
        let reflectance = bsdf.mirror(simd);
        let mirror = met & reflectance.length_squared().simd_gt(0.0);
        if !mirror.any_true() {
            return;
        }
        let mirrored = bsdf.mirrored();
        let rays = Rays::new(simd, hit.position, mirrored, id);
        let nearest = self.geometry.nearest(simd, &rays);
        let lit = mirror & nearest.id.simd_ge(self.geometry.lamps_first);
        if lit.any_true() {
            let emission = self.emission(simd, mirrored, &nearest, lit);
            sum.emission = emission.scale_add(reflectance, sum.emission);
        }
    }

    /// Light of the lamp or the environment in which rays end, for the lanes in `mask`.
    #[inline(always)]
    fn emission<S: Simd>(
        &self,
        simd: S,
        direction: Vec3x<S>,
        nearest: &Nearest<S>,
        mask: Mask<S>,
    ) -> Vec3x<S> {
        let black = Vec3x::splat(simd, [0.0; 3]);
        let escaped = mask & nearest.id.simd_eq(NONE);
        let environment = Vec3x::splat(simd, self.environment);
        let lit = mask & !escaped;
        if !lit.any_true() {
            return Vec3x::select(escaped, environment, black);
        }
        let lamp = nearest.id - self.geometry.lamps_first;
        let lamp = lit.select(lamp, Word::splat(simd, 0));
        let emission = self.lamps.emission(simd, lamp);
        let front = direction.dot(emission.normal).simd_lt(0.0);
        let emitted = Vec3x::select(lit & front, emission.radiance, black);
        Vec3x::select(escaped, environment, emitted)
    }
}
