//! Integrator: stages over a stream of paths (extend, shade, connect) until all paths have terminated.
//!
//! Next-event estimation and BSDF sampling of area lights, emissive surfaces and environment maps are
//! combined by the power heuristic (Veach, "Robust Monte Carlo Methods for Light Transport Simulation",
//! 1997, §9.2). A constant environment is sampled by the BSDF alone.

use std::sync::atomic::{AtomicBool, Ordering};

use fearless_simd::{i32x16, prelude::*};

use super::beam::Beam;
use super::extend::extend;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::light_sampling::{MIRROR, OTHER};
use super::prepared::Prepared;
use super::rays::{INSIDE, NONE, Rays};
use super::sampling::{pair, sin_cos_turns};
use super::shade::shade;
use super::stream::{Stream, StreamPacket, load, load_words, packets, store, store_words};
use crate::sampling::{
    BLOCK_CAMERA, BLOCK_LENS, ROULETTE_DEPTH, SURVIVAL_PER_THROUGHPUT, block_choice,
};

impl Prepared {
    /// Traces the paths of `stream`, whose pixels, samples and slots are set, to their end. Returns the
    /// number of rays. Once `cancelled` is true it returns within a packet, with unspecified contents of
    /// the stream.
    #[inline(always)]
    pub(super) fn trace<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        cancelled: &AtomicBool,
    ) -> u64 {
        let mut rays = 0;
        let max_depth = self.settings.max_depth;
        simd.vectorize(
            #[inline(always)]
            || self.generate(simd, stream),
        );
        // One more edge than scattering events: the last edge only collects light in the last direction.
        for depth in 0..=max_depth {
            let last = depth == max_depth;
            rays += extend(self, simd, stream, depth, last, cancelled);
            if stream.len == 0 || cancelled.load(Ordering::Relaxed) {
                break;
            }
            rays += shade(self, simd, stream, depth);
            if self.samples_light() {
                // A loop over lobes, so that the traversal is inlined once.
                let lobes = 1 + usize::from(self.samples_coat_reflection(depth));
                for lobe in [OTHER, MIRROR].into_iter().take(lobes) {
                    rays += simd.vectorize(
                        #[inline(always)]
                        || self.connect(simd, stream, lobe, depth, cancelled),
                    );
                }
            }
            if depth >= ROULETTE_DEPTH {
                simd.vectorize(
                    #[inline(always)]
                    || self.end_by_roulette(simd, stream, depth),
                );
            }
        }
        rays
    }

    /// Whether AOVs of the hits at `depth` are recorded. Paths are not compacted then, so that all keep
    /// their places.
    pub(super) fn records_aovs_at(&self, depth: u32) -> bool {
        depth == 0 && self.records_aovs()
    }

    /// Whether paths record the AOVs of their first hits: in denoised images, unless the maximum depth is
    /// 0.
    pub(super) fn records_aovs(&self) -> bool {
        self.settings.denoise && self.settings.max_depth > 0
    }

    /// Generates the camera rays through a random point of each path's pixel.
    #[inline(always)]
    fn generate<S: Simd>(&self, simd: S, stream: &mut Stream) {
        let one = Float::splat(simd, 1.0);
        stream.has_sampled_pdf =
            self.environment.probability() > 0.0 || self.emissive_surfaces.is_some();
        for StreamPacket { at, .. } in packets(stream.len) {
            let pixel = load_words(simd, &stream.pixel, at);
            let sample = load_words(simd, &stream.sample, at);
            let film = load_words(simd, &stream.film, at);
            let (origin, direction) = self.camera_ray(simd, film, pixel, sample);
            let length = direction.length_squared().sqrt();
            stream.origin.store(at, origin);
            stream.direction.store(at, direction * (one / length));
            // Kept until the hit is found: depth is measured along the camera axis, of which the
            // unnormalised direction has component 1.
            store(&mut stream.distance, at, length);
            stream.beta.store(at, Vec3x::new(one, one, one));
            stream.radiance.store(at, Vec3x::splat(simd, [0.0; 3]));
            // As after a mirror: light sampling could not have drawn the direction.
            store(&mut stream.pdf, at, Float::splat(simd, f32::INFINITY));
            if stream.has_sampled_pdf {
                let infinite = Float::splat(simd, f32::INFINITY);
                store(&mut stream.sampled_pdf, at, infinite);
            }
            store_words(&mut stream.primitive, at, Word::splat(simd, NONE));
        }
    }

    /// Reciprocal depth along the camera axis of a hit at `distance` from the near plane. `length` is that
    /// of the ray's direction scaled to have component 1 along the axis.
    #[inline(always)]
    pub(super) fn inverse_depth<S: Simd>(&self, length: Float<S>, distance: Float<S>) -> Float<S> {
        length / (distance + length * self.camera.near_m)
    }

    /// Origin on the near plane and unnormalised direction of a sample's ray through the pixel at `film`
    /// (column in the lower, row in the upper 16 bits). The direction has component 1 along the camera
    /// axis.
    #[inline(always)]
    pub(super) fn camera_ray<S: Simd>(
        &self,
        simd: S,
        film: Word<S>,
        pixel: Word<S>,
        sample: Word<S>,
    ) -> (Vec3x<S>, Vec3x<S>) {
        let camera = &self.camera;
        let mut eye = Vec3x::splat(simd, camera.eye);
        let corner = Vec3x::splat(simd, camera.corner);
        let (dx, dy) = (Vec3x::splat(simd, camera.dx), Vec3x::splat(simd, camera.dy));
        let mut u = pair(pixel, sample, BLOCK_CAMERA, self.settings.seed);
        if camera.lens_steps > 0.0 {
            let [radius2, turns] = pair(pixel, sample, BLOCK_LENS, self.settings.seed);
            let (radius, (sin, cos)) = (radius2.sqrt(), sin_cos_turns(turns));
            let lens = [radius * cos, radius * sin];
            let steps = lens.map(|l| l * camera.lens_steps);
            // The lens is spanned by the film axes, in units of a pixel. `lens_film` is `lens_steps` over
            // the focus distance f, so that eye + f·direction is the same point for the whole lens.
            eye = dx.mul_add(steps[0], dy.mul_add(steps[1], eye));
            u = [
                u[0] - lens[0] * camera.lens_film,
                u[1] - lens[1] * camera.lens_film,
            ];
        }
        let (x, y) = (small_to_float(film & 0xffff), small_to_float(film >> 16));
        // Whole pixels first: x + u would round u away in wide images.
        let at_pixel = dx.mul_add(x, dy.mul_add(y, corner));
        let direction = dx.mul_add(u[0], dy.mul_add(u[1], at_pixel));
        if camera.near_m > 0.0 {
            eye = direction.mul_add(Float::splat(simd, camera.near_m), eye);
        }
        (eye, direction)
    }

    /// Terminates paths of low throughput by Russian roulette, and compacts the stream.
    #[inline(always)]
    fn end_by_roulette<S: Simd>(&self, simd: S, stream: &mut Stream, depth: u32) {
        let mut kept = 0;
        for packet in packets(stream.len) {
            let at = packet.at;
            let beta = stream.beta.load(simd, at);
            let left = load_words(simd, &stream.primitive, at);
            let alive = packet.mask(simd) & left.simd_ne(NONE);
            // By the largest channel: it becomes exactly 1 / SURVIVAL_PER_THROUGHPUT in survivors, so that
            // no weight grows without bound.
            let survival = beta.x.max(beta.y).max(beta.z) * SURVIVAL_PER_THROUGHPUT;
            // Paths inside bodies are exempt: their next free flight is drawn by the same random number.
            let played = alive & survival.simd_lt(1.0) & (left & INSIDE).simd_eq(0);
            let mut survivors = alive;
            if played.any_true() {
                let pixel = load_words(simd, &stream.pixel, at);
                let sample = load_words(simd, &stream.sample, at);
                // The number that a free flight at the next depth would use.
                let [_, u] = pair(pixel, sample, block_choice(depth + 1), self.settings.seed);
                let ended = played & u.simd_ge(survival);
                let one = Float::splat(simd, 1.0);
                stream
                    .beta
                    .store(at, beta * (one / played.select(survival, one)));
                if ended.any_true() {
                    let radiance = stream.radiance.load(simd, at);
                    stream.finish(packet, ended, radiance);
                }
                survivors &= !ended;
            }
            kept = stream.keep(simd, packet, survivors, kept);
        }
        stream.len = kept;
    }

    /// Traces the shadow rays of a `lobe` and adds the light of those that are not occluded. Returns the
    /// number of rays.
    #[inline(always)]
    fn connect<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        lobe: usize,
        depth: u32,
        cancelled: &AtomicBool,
    ) -> u64 {
        let mut rays = 0;
        let shadow = &stream.shadows[lobe];
        for StreamPacket { at, .. } in packets(stream.len) {
            let distance = load(simd, &shadow.distance, at);
            let lit: Mask<S> = distance.simd_gt(0.0);
            let traced = lit.to_bitmask().count_ones();
            if traced == 0 || cancelled.load(Ordering::Relaxed) {
                continue;
            }
            rays += u64::from(traced);
            // Only refracted shadow rays begin elsewhere than the path; the column is neither written nor
            // read in scenes without them.
            let begins = if lobe == OTHER && self.has_refracted_nee() {
                &shadow.origin
            } else {
                &stream.origin
            };
            let origin = begins.load(simd, at);
            let direction = shadow.direction.load(simd, at);
            // Shadow rays start outside the body, even if the path continues inside.
            let start = load_words(simd, &stream.primitive, at) & !INSIDE;
            let light = load_words(simd, &shadow.light, at);
            let shadow_rays = Rays::new(simd, origin, direction, start);
            // The target light is no occluder, whatever the rounding of its distance.
            let beam = if depth == 0 {
                Beam::new(simd, &shadow_rays, lit, distance)
            } else {
                None
            };
            let beam = beam.as_ref();
            let dark = (self.geometry).occluded(simd, &shadow_rays, beam, distance, light);
            let radiance = stream.radiance.load(simd, at);
            let added = radiance + shadow.radiance.load(simd, at);
            let radiance = Vec3x::select(lit & !dark, added, radiance);
            stream.radiance.store(at, radiance);
        }
        rays
    }
}

/// Converts words below 2²³: signed conversion is exact there, and cheaper than unsigned.
#[inline(always)]
fn small_to_float<S: Simd>(word: Word<S>) -> Float<S> {
    let bits: i32x16<S> = word.bitcast();
    bits.to_float()
}
