//! AOVs of first hits, one pixel or path per lane.

use std::ops::Range;

use fearless_simd::prelude::*;

use super::beam::Beam;
use super::bsdf::Bsdf;
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::prepared::Prepared;
use super::rays::{NONE, Nearest, Rays};
use super::stream::{load, load_words, store};
use super::surface::Hit;
use crate::Aovs;
use crate::aov::AOV_CHANNELS;
use crate::sampling::{pixel_key, sample_key};

/// Channels of [`Aovs`], one vector per channel.
pub(super) type AovLanes<S> = [Float<S>; AOV_CHANNELS];

impl Prepared {
    /// Means over all samples of each pixel; `pixels` are (column, row) in the image.
    #[inline(always)]
    pub(super) fn aovs<S: Simd>(&self, simd: S, pixels: &[(u32, u32)]) -> Vec<Aovs> {
        let (films, keys): (Vec<u32>, Vec<u32>) = pixels
            .iter()
            .map(|&(x, y)| ((y << 16) | x, pixel_key(x, y)))
            .unzip();
        let mut sums: [Vec<f32>; AOV_CHANNELS] = std::array::from_fn(|_| vec![0.0; keys.len()]);
        self.add_first_hits(simd, &films, &keys, 0..self.settings.samples, &mut sums);
        let share = 1.0 / self.settings.samples as f32;
        let pixel = |i: usize| Aovs::from_columns(sums.each_ref().map(|sums| sums[i] * share));
        (0..keys.len()).map(pixel).collect()
    }

    /// Adds the first-hit AOVs of a range of each pixel's samples to `sums`. Not inlined: it has three
    /// callers, and each inlined copy adds about a minute to the build.
    #[inline(never)]
    pub(super) fn add_first_hits<S: Simd>(
        &self,
        simd: S,
        films: &[u32],
        keys: &[u32],
        samples: Range<u32>,
        sums: &mut [Vec<f32>; AOV_CHANNELS],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                for at in (0..keys.len()).step_by(LANES) {
                    let aovs = self.first_hits_at(simd, films, keys, samples.clone(), at);
                    add(simd, aovs, at..keys.len().min(at + LANES), sums);
                }
            },
        );
    }

    #[inline(always)]
    fn first_hits_at<S: Simd>(
        &self,
        simd: S,
        films: &[u32],
        keys: &[u32],
        samples: Range<u32>,
        at: usize,
    ) -> AovLanes<S> {
        // Excess lanes of the last packet repeat its last pixel; their results are discarded.
        let (film, pixel) = if at + LANES <= keys.len() {
            (load_words(simd, films, at), load_words(simd, keys, at))
        } else {
            let words = |column: &[u32]| -> [u32; LANES] {
                std::array::from_fn(|lane| column[(at + lane).min(column.len() - 1)])
            };
            let (films, keys) = (words(films), words(keys));
            (Word::load_array(simd, films), Word::load_array(simd, keys))
        };
        let mut sum = [Float::splat(simd, 0.0); AOV_CHANNELS];
        for sample in samples {
            let sample = self.settings.first_sample.wrapping_add(sample);
            let sample = Word::splat(simd, sample_key(sample));
            let (origin, direction) = self.camera_ray(simd, film, pixel, sample);
            let length = direction.length_squared().sqrt();
            let direction = direction * (1.0 / length);
            let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
            let (all, endless) = (Mask::splat(simd, true), Float::splat(simd, f32::INFINITY));
            let beam = Beam::new(simd, &rays, all, endless);
            let nearest = self.geometry.nearest(simd, &rays, beam.as_ref());
            let aovs = self.first_hit_aovs(simd, &rays, length, &nearest);
            for (sum, aovs) in sum.iter_mut().zip(aovs) {
                *sum += aovs;
            }
        }
        sum
    }

    /// AOVs of camera rays: those of the first surface, and the light in its mirror reflection. `length`
    /// is the length of the ray's direction scaled to have component 1 along the camera axis.
    #[inline(always)]
    fn first_hit_aovs<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        length: Float<S>,
        nearest: &Nearest<S>,
    ) -> AovLanes<S> {
        let direction = rays.direction;
        let ended = nearest.id.simd_ge(self.geometry.area_lights_first);
        let emitted = self.emission(simd, rays.origin, direction, nearest, ended);
        if ended.all_true() {
            let zero = Vec3x::splat(simd, [0.0; 3]);
            return columns(zero, zero, zero.x, emitted);
        }
        // Lanes that hit no surface are evaluated with a valid dummy hit and masked out.
        let met = !ended;
        let id = met.select(nearest.id, Word::splat(simd, 0));
        let distance = met.select(nearest.distance, Float::splat(simd, 1.0));
        let footprint = self.footprint;
        let hit =
            (self.surfaces).general_hit(simd, rays.origin, direction, distance, id, footprint);
        let bsdf = Bsdf::new(simd, &hit, -direction);
        let inverse_depth = self.inverse_depth(length, distance);
        self.surface_aovs(simd, met, id, &hit, &bsdf, inverse_depth, emitted)
    }

    /// AOVs of the surface hit by the lanes in `met`, and `emitted` in all lanes.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "one packet's values, all in registers"
    )]
    pub(super) fn surface_aovs<S: Simd>(
        &self,
        simd: S,
        met: Mask<S>,
        id: Word<S>,
        hit: &Hit<S>,
        bsdf: &Bsdf<S>,
        inverse_depth: Float<S>,
        mut emitted: Vec3x<S>,
    ) -> AovLanes<S> {
        // One mirror bounce is followed for the emission AOV, so that reflections of lamps stay sharp.
        let reflectance = bsdf.mirror(simd);
        let mut mirror = met & reflectance.length_squared().simd_gt(0.0);
        let mirrored = bsdf.shown();
        let rays = Rays::new(simd, hit.position, mirrored, id);
        if mirror.any_true() && self.environment.is_black() {
            // Occluders of the mirror ray matter only if there is a light behind them.
            let light = self.geometry.nearest_area_light(simd, &rays);
            mirror &= light.id.simd_ne(NONE);
        }
        if mirror.any_true() {
            let nearest = self.geometry.nearest(simd, &rays, None);
            let lit = mirror & nearest.id.simd_ge(self.geometry.area_lights_first);
            let emission = self.emission(simd, hit.position, mirrored, &nearest, lit);
            emitted = emission.scale_add(reflectance, emitted);
        }
        let zero = Vec3x::splat(simd, [0.0; 3]);
        columns(
            Vec3x::select(met, bsdf.albedo(simd, hit.albedo), zero),
            Vec3x::select(met, hit.normal, zero),
            met.select(inverse_depth, zero.x),
            emitted,
        )
    }

    /// Radiance of the area light or environment at which rays end, for the lanes in `mask`; 0 in others.
    #[inline(always)]
    pub(super) fn emission<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        nearest: &Nearest<S>,
        mask: Mask<S>,
    ) -> Vec3x<S> {
        let black = Vec3x::splat(simd, [0.0; 3]);
        if !mask.any_true() {
            return black;
        }
        let escaped = mask & nearest.id.simd_eq(NONE);
        let environment = self.environment.radiance(simd, direction, escaped);
        let lit = mask & !escaped;
        if !lit.any_true() {
            return Vec3x::select(escaped, environment, black);
        }
        let light = nearest.id - self.geometry.area_lights_first;
        let light = lit.select(light, Word::splat(simd, 0));
        let point = direction.mul_add(nearest.distance, origin);
        let emission = self.area_lights.emission(simd, light, point);
        let front = direction.dot(emission.normal).simd_lt(0.0);
        let emitted = Vec3x::select(lit & front, emission.radiance, black);
        Vec3x::select(escaped, environment, emitted)
    }
}

/// Adds the AOVs of the first `pixels.len()` lanes to `sums` at `pixels`.
#[inline(always)]
fn add<S: Simd>(
    simd: S,
    aovs: AovLanes<S>,
    pixels: Range<usize>,
    sums: &mut [Vec<f32>; AOV_CHANNELS],
) {
    for (sums, aovs) in sums.iter_mut().zip(aovs) {
        if pixels.len() == LANES {
            let sum = load(simd, sums, pixels.start) + aovs;
            store(sums, pixels.start, sum);
            continue;
        }
        for (sum, aovs) in sums[pixels.clone()].iter_mut().zip(aovs.to_array()) {
            *sum += aovs;
        }
    }
}

#[inline(always)]
fn columns<S: Simd>(
    albedo: Vec3x<S>,
    normal: Vec3x<S>,
    inverse_depth: Float<S>,
    emission: Vec3x<S>,
) -> AovLanes<S> {
    let [Vec3x { x: r, y: g, z: b }, Vec3x { x, y, z }] = [albedo, normal];
    let Vec3x {
        x: er,
        y: eg,
        z: eb,
    } = emission;
    [r, g, b, x, y, z, inverse_depth, er, eg, eb]
}
