//! Extension stage of the integrator: the nearest hit of each path's ray.

use std::sync::atomic::{AtomicBool, Ordering};

use fearless_simd::prelude::*;

use super::beam::Beam;
use super::lanes::{Float, Vec3x, Word};
use super::light_sampling::power_heuristic;
use super::microfacet::{SCATTERED, untagged};
use super::prepared::Prepared;
use super::rays::{INSIDE, NONE, Nearest, Rays};
use super::sampling::pair;
use super::stream::{Stream, load, load_words, packets, store, store_words};
use crate::sampling::block_choice;

/// Finds the nearest hit of each path, terminates paths that hit a light or escape (all paths if this is
/// their last edge), and compacts the stream. Returns the number of rays.
///
/// A function, like [`shade`](super::shade::shade): rustc compiles all methods of [`Prepared`] in one
/// codegen unit, and functions in that of their own module.
pub(super) fn extend<S: Simd>(
    scene: &Prepared,
    simd: S,
    stream: &mut Stream,
    depth: u32,
    last: bool,
    cancelled: &AtomicBool,
) -> u64 {
    simd.vectorize(
        #[inline(always)]
        || scene.extend_packets(simd, stream, depth, last, cancelled),
    )
}

impl Prepared {
    #[inline(always)]
    fn extend_packets<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        depth: u32,
        last: bool,
        cancelled: &AtomicBool,
    ) -> u64 {
        let (mut kept, mut rays) = (0, 0);
        for packet in packets(stream.len) {
            // Once per packet: a packet may take a millisecond, a batch of packets seconds.
            if cancelled.load(Ordering::Relaxed) {
                break;
            }
            let at = packet.at;
            let origin = stream.origin.load(simd, at);
            let direction = stream.direction.load(simd, at);
            let start = load_words(simd, &stream.primitive, at);
            let edges = Rays::new(simd, origin, direction, start);
            let mut alive = packet.mask(simd);
            if depth > 0 {
                // Terminated paths that were not compacted have no start primitive.
                alive &= start.simd_ne(NONE);
            }
            // Beams only for camera rays: deeper rays are incoherent, and their beam culls little.
            let endless = Float::splat(simd, f32::INFINITY);
            let beam = if depth == 0 {
                Beam::new(simd, &edges, alive, endless)
            } else {
                None
            };
            let mut nearest = self.geometry.nearest(simd, &edges, beam.as_ref());
            rays += u64::from(alive.to_bitmask().count_ones());
            let mut met = nearest.id;
            if self.surfaces.has_dielectric {
                self.sample_distance(simd, stream, at, depth, &mut nearest);
                met = untagged(nearest.id);
            }
            let unscattered = met.simd_ge(self.geometry.area_lights_first) & alive;
            if unscattered.any_true() {
                let light_id = unscattered.select(nearest.id, Word::splat(simd, NONE));
                let distance = nearest.distance;
                let mut light = self.emission_with_mis(simd, stream, at, light_id, distance);
                // Light seen directly or in the first mirror is in the first-hit AOVs. It is added after
                // denoising, so that lamps and their mirror images stay sharp.
                if self.settings.denoise && depth <= 1 {
                    light = self.without_emission(simd, stream, at, light);
                }
                let radiance = stream.radiance.load(simd, at);
                stream.finish(packet, unscattered, radiance + light);
            }
            let scattering = alive & !unscattered;
            if last {
                let mut radiance = stream.radiance.load(simd, at);
                if self.has_emission && scattering.any_true() {
                    radiance = radiance
                        + self.last_emission(simd, stream, at, depth, scattering, &nearest);
                }
                stream.finish(packet, scattering, radiance);
            } else if self.records_aovs_at(depth) {
                // Paths keep their places, in the order of slots, in which the AOVs are stored.
                let emission = self.emission(simd, origin, direction, &nearest, unscattered);
                let length = load(simd, &stream.distance, at);
                let inverse_depth = self.inverse_depth(length, nearest.distance);
                stream.store_emission(at, inverse_depth, emission);
                store(&mut stream.distance, at, nearest.distance);
                let none = Word::splat(simd, NONE);
                store_words(
                    &mut stream.primitive,
                    at,
                    scattering.select(nearest.id, none),
                );
                kept = at + packet.lanes;
            } else {
                store(&mut stream.distance, at, nearest.distance);
                store_words(&mut stream.primitive, at, nearest.id);
                kept = stream.keep(simd, packet, scattering, kept);
            }
        }
        stream.len = kept;
        rays
    }

    /// Samples free flights through the interior of dielectrics: light is absorbed, and may be scattered
    /// before the boundary.
    #[inline(always)]
    fn sample_distance<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        at: usize,
        depth: u32,
        nearest: &mut Nearest<S>,
    ) {
        // NONE has all bits set, including INSIDE, but is no body.
        let start = load_words(simd, &stream.primitive, at);
        let none = Word::splat(simd, NONE);
        let within = (start & INSIDE).simd_ne(0) & start.simd_ne(none);
        if !within.any_true() {
            return;
        }
        let pixel = load_words(simd, &stream.pixel, at);
        let sample = load_words(simd, &stream.sample, at);
        // The first number of the block is reserved for the boundary, where it chooses between reflection
        // and refraction.
        let [_, u] = pair(pixel, sample, block_choice(depth), self.settings.seed);
        let flight = self
            .surfaces
            .sample_distance(simd, within, start, nearest.distance, u);
        let beta = stream.beta.load(simd, at);
        stream.beta.store(at, beta.scale(flight.weight));
        nearest.distance = flight.distance;
        // The path stays in its body: `start` has the body's id and INSIDE, with which the next edge
        // begins.
        nearest.id = flight.scattered.select(start | SCATTERED, nearest.id);
    }

    /// Emitted light, weighted by MIS and throughput, of rays that hit an area light or escape.
    #[inline(always)]
    fn emission_with_mis<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        id: Word<S>,
        distance: Float<S>,
    ) -> Vec3x<S> {
        let beta = stream.beta.load(simd, at);
        let escaped = id.simd_eq(NONE);
        let direction = stream.direction.load(simd, at);
        let sampled_pdf = || load(simd, &stream.sampled_pdf, at);
        let environment =
            (self.environment).radiance_with_mis(simd, direction, escaped, sampled_pdf);
        let environment = beta.scale(environment);
        if escaped.all_true() || self.area_lights.is_empty() {
            return environment;
        }
        let first = self.geometry.area_lights_first;
        let lit = id.simd_ge(first) & !escaped;
        let light = lit.select(id - first, Word::splat(simd, 0));
        let point = direction.mul_add(distance, stream.origin.load(simd, at));
        let emission = self.area_lights.emission(simd, light, point);
        let cos_light = -direction.dot(emission.normal);
        let pdf = load(simd, &stream.pdf, at);
        // Brightness is at least MIN_POSITIVE, because an unlit area light would give 0 / 0. A pdf of ∞
        // (mirror) gives weight 1; a pdf of 0 (coat's mirror) gives 0, as its light has been added by
        // next-event estimation.
        let weight = power_heuristic(emission.brightness.max(f32::MIN_POSITIVE) / pdf);
        let emitted = beta.scale(emission.radiance) * weight;
        let black = Vec3x::splat(simd, [0.0; 3]);
        let emitted = Vec3x::select(lit & cos_light.simd_gt(0.0), emitted, black);
        Vec3x::select(escaped, environment, emitted)
    }

    /// Removes light that the emission AOV of first hits contains: seen directly or by a mirror, outside
    /// bodies.
    #[inline(always)]
    fn without_emission<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        light: Vec3x<S>,
    ) -> Vec3x<S> {
        // Mirrors have density ∞, a coat's mirror 0.
        let pdf = load(simd, &stream.pdf, at);
        let scattered = pdf.simd_lt(f32::INFINITY) & pdf.simd_gt(0.0);
        let left = load_words(simd, &stream.primitive, at);
        let within = (left & INSIDE).simd_ne(0) & left.simd_ne(NONE);
        Vec3x::select(scattered | within, light, Vec3x::splat(simd, [0.0; 3]))
    }
}
