//! The path tracer as stages over a stream: extend, shade, connect, until all paths have ended.
//!
//! Next-event estimation towards the area lights and directions from the BSDF are weighed by the power
//! heuristic (Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, §9.2); so are those
//! towards an environment map. A constant environment is found by the BSDF's directions alone.

use std::sync::atomic::{AtomicBool, Ordering};

use fearless_simd::{i32x16, prelude::*};

use super::beam::Beam;
use super::bsdf::Bsdf;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::light_sampling::{HitPacket, MIRROR, OTHER, power_heuristic};
use super::microfacet::{SCATTERED, untagged};
use super::prepared::Prepared;
use super::rays::{INSIDE, NONE, Nearest, Rays};
use super::regularisation::{regularised, with_spread};
use super::sampling::{pair, sin_cos_turns};
use super::stream::{Stream, StreamPacket, load, load_words, packets, store, store_words};
use super::surface::Hit;
use crate::sampling::{
    BLOCK_CAMERA, BLOCK_LENS, ROULETTE_DEPTH, SURVIVAL_PER_THROUGHPUT, block_choice, block_light,
    block_scatter,
};

impl Prepared {
    /// Traces the paths of `stream`, whose pixels, samples and slots are set, to their end.
    /// Returns the number of rays. Once `cancelled` is true it ends within a packet, and what the stream
    /// holds is of no use.
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
        for depth in 0..=max_depth {
            let last = depth == max_depth;
            rays += simd.vectorize(
                #[inline(always)]
                || self.extend(simd, stream, depth, last, cancelled),
            );
            if stream.len == 0 || cancelled.load(Ordering::Relaxed) {
                break;
            }
            // Two copies of the code: in that of simple scenes nothing else takes registers.
            rays += if self.is_general {
                simd.vectorize(
                    #[inline(always)]
                    || self.shade::<S, true>(simd, stream, depth),
                )
            } else {
                simd.vectorize(
                    #[inline(always)]
                    || self.shade::<S, false>(simd, stream, depth),
                )
            };
            if self.samples_light() {
                // One call for both lobes: two would be two copies of the traversal.
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

    /// Whether what paths meet is noted for the filter. They keep their places then, also those that
    /// end.
    fn records_aovs_at(&self, depth: u32) -> bool {
        depth == 0 && self.records_aovs()
    }

    /// Whether paths note their first hits: those of pictures that are denoised, unless they are not
    /// scattered at all.
    pub(super) fn records_aovs(&self) -> bool {
        self.settings.denoise && self.settings.max_depth > 0
    }

    /// Camera rays through a random point of each path's pixel.
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
            store(&mut stream.distance, at, length);
            stream.beta.store(at, Vec3x::new(one, one, one));
            stream.radiance.store(at, Vec3x::splat(simd, [0.0; 3]));
            store(&mut stream.pdf, at, Float::splat(simd, f32::INFINITY));
            if stream.has_sampled_pdf {
                let infinite = Float::splat(simd, f32::INFINITY);
                store(&mut stream.sampled_pdf, at, infinite);
            }
            store_words(&mut stream.primitive, at, Word::splat(simd, NONE));
        }
    }

    /// Origin and direction of a sample's ray through the pixel at `film`, x below y: the direction is of length 1
    /// along the camera's axis.
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
            eye = dx.mul_add(steps[0], dy.mul_add(steps[1], eye));
            u = [
                u[0] - lens[0] * camera.lens_film,
                u[1] - lens[1] * camera.lens_film,
            ];
        }
        let (x, y) = (small_to_float(film & 0xffff), small_to_float(film >> 16));
        // Whole pixels first: x + u would cost wide images the digits of u.
        let at_pixel = dx.mul_add(x, dy.mul_add(y, corner));
        (eye, dx.mul_add(u[0], dy.mul_add(u[1], at_pixel)))
    }

    /// Finds what each path meets next, ends those that meet light or nothing, or all if this is
    /// their last edge, and closes the ranks of the others. Returns the number of rays.
    #[inline(always)]
    fn extend<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        depth: u32,
        last: bool,
        cancelled: &AtomicBool,
    ) -> u64 {
        let (mut kept, mut rays) = (0, 0);
        for packet in packets(stream.len) {
            // A packet may take a millisecond, a batch of them seconds.
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
                // Those that ended and kept their place have not left any primitive.
                alive &= start.simd_ne(NONE);
            }
            // Deeper rays lead everywhere: a beam of theirs leaves out little.
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
                let mut light = self.emission_with_mis(simd, stream, at, light_id);
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
                // In the order of slots, in which first hits are noted.
                let emission = self.emission(simd, direction, &nearest, unscattered);
                let length = load(simd, &stream.distance, at);
                stream.store_emission(at, length / nearest.distance, emission);
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

    /// Flies through what fills dielectrics: light is absorbed, and may be scattered before the
    /// boundary.
    #[inline(always)]
    fn sample_distance<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        at: usize,
        depth: u32,
        nearest: &mut Nearest<S>,
    ) {
        let start = load_words(simd, &stream.primitive, at);
        let none = Word::splat(simd, NONE);
        let within = (start & INSIDE).simd_ne(0) & start.simd_ne(none);
        if !within.any_true() {
            return;
        }
        let pixel = load_words(simd, &stream.pixel, at);
        let sample = load_words(simd, &stream.sample, at);
        let [_, u] = pair(pixel, sample, block_choice(depth), self.settings.seed);
        let flight = self
            .surfaces
            .sample_distance(simd, within, start, nearest.distance, u);
        let beta = stream.beta.load(simd, at);
        stream.beta.store(at, beta.scale(flight.weight));
        nearest.distance = flight.distance;
        nearest.id = flight.scattered.select(start | SCATTERED, nearest.id);
    }

    /// Light that comes in along rays that meet an area light or nothing.
    #[inline(always)]
    fn emission_with_mis<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        id: Word<S>,
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
        let emission = self.area_lights.emission(simd, light);
        let cos_light = -direction.dot(emission.normal);
        let pdf = load(simd, &stream.pdf, at);
        // An area light that does not shine has no brightness: 0 / 0.
        // ∞ of a mirror gives a weight of 1, 0 of a coat's mirror one of 0: its light has been
        // added already.
        let weight = power_heuristic(emission.brightness.max(f32::MIN_POSITIVE) / pdf);
        let emitted = beta.scale(emission.radiance) * weight;
        let black = Vec3x::splat(simd, [0.0; 3]);
        let emitted = Vec3x::select(lit & cos_light.simd_gt(0.0), emitted, black);
        Vec3x::select(escaped, environment, emitted)
    }

    /// Leaves out light that is in the emission of first hits, which is traced apart.
    #[inline(always)]
    fn without_emission<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        light: Vec3x<S>,
    ) -> Vec3x<S> {
        // A mirror's density is infinite, a coat's 0.
        let pdf = load(simd, &stream.pdf, at);
        let scattered = pdf.simd_lt(f32::INFINITY) & pdf.simd_gt(0.0);
        let left = load_words(simd, &stream.primitive, at);
        let within = (left & INSIDE).simd_ne(0) & left.simd_ne(NONE);
        Vec3x::select(scattered | within, light, Vec3x::splat(simd, [0.0; 3]))
    }

    /// Ends paths that would bring little light by Russian roulette, and closes the ranks of the others.
    #[inline(always)]
    fn end_by_roulette<S: Simd>(&self, simd: S, stream: &mut Stream, depth: u32) {
        let mut kept = 0;
        for packet in packets(stream.len) {
            let at = packet.at;
            let beta = stream.beta.load(simd, at);
            let left = load_words(simd, &stream.primitive, at);
            let alive = packet.mask(simd) & left.simd_ne(NONE);
            let survival = beta.x.max(beta.y).max(beta.z) * SURVIVAL_PER_THROUGHPUT;
            let played = alive & survival.simd_lt(1.0) & (left & INSIDE).simd_eq(0);
            let mut survivors = alive;
            if played.any_true() {
                let pixel = load_words(simd, &stream.pixel, at);
                let sample = load_words(simd, &stream.sample, at);
                // The number that a body's flight would take.
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

    /// Scatters each path where it hit: a shadow ray towards an area light and the path's next direction.
    /// Returns the number of rays that this took.
    #[inline(always)]
    #[expect(
        clippy::too_many_lines,
        reason = "one packet's values, all in registers"
    )]
    fn shade<S: Simd, const GENERAL: bool>(&self, simd: S, stream: &mut Stream, depth: u32) -> u64 {
        let mut rays = 0;
        for packet in packets(stream.len) {
            let at = packet.at;
            let tag = load_words(simd, &stream.primitive, at);
            let alive = packet.mask(simd) & tag.simd_ne(NONE);
            if !alive.any_true() {
                stream.store_miss(simd, at);
                continue;
            }
            let tag = alive.select(tag, Word::splat(simd, 0));
            let direction = stream.direction.load(simd, at);
            let distance = load(simd, &stream.distance, at);
            let footprint = if depth == 0 { self.footprint } else { 0.0 };
            let (hit, regularised) = self.regularised_hit::<S, GENERAL>(
                simd, stream, at, direction, distance, tag, footprint,
            );
            let bsdf = Bsdf::new(simd, &hit, -direction);
            if self.records_aovs_at(depth) {
                let (inverse_depth, emitted) = stream.load_emission(simd, at);
                let aovs = self.surface_aovs(simd, alive, tag, &hit, &bsdf, inverse_depth, emitted);
                stream.store_aovs(at, aovs);
            }
            let beta = stream.beta.load(simd, at);
            if let Some(emission) =
                self.surface_emission(simd, stream, at, alive, direction, distance, tag, &hit)
            {
                let radiance = stream.radiance.load(simd, at);
                stream.radiance.store(at, radiance + emission);
            }
            let pixel = load_words(simd, &stream.pixel, at);
            let sample = load_words(simd, &stream.sample, at);
            let seed = self.settings.seed;
            let mut light_weight_sum = Float::splat(simd, 0.0);
            if self.samples_light() {
                let u = pair(pixel, sample, block_light(depth), seed);
                let packet = HitPacket {
                    simd,
                    at,
                    depth,
                    alive,
                    tag,
                    hit: &hit,
                    bsdf: &bsdf,
                    beta,
                    regularised,
                };
                let (traced, sum) = self.sample_light::<S, GENERAL>(&packet, stream, u);
                rays += traced;
                light_weight_sum = sum;
            }
            let [u1, u2] = pair(pixel, sample, block_scatter(depth), seed);
            let mut u0 = u1;
            if hit.microfacet.is_some() || hit.metallic_roughness.is_some() {
                [u0, _] = pair(pixel, sample, block_choice(depth), seed);
            }
            let mut inside = Mask::splat(simd, false);
            let scattered = bsdf.sample(simd, [u0, u1, u2], &mut inside);
            stream.origin.store(at, hit.origin(scattered.wi));
            stream.direction.store(at, scattered.wi);
            stream.beta.store(at, beta.scale(scattered.weight));
            if GENERAL && stream.has_sampled_pdf {
                store(&mut stream.sampled_pdf, at, scattered.pdf);
            }
            let pdf = weighed(scattered.pdf, light_weight_sum);
            let diffuse = bsdf.layered(simd) & pdf.simd_gt(0.0);
            let mut pdf = with_spread(pdf, regularised | diffuse);
            if self.has_refracted_nee() {
                let before = load(simd, &stream.pdf, at);
                let known =
                    self.exits_by_nee_hemisphere(simd, before, &hit, -direction, distance, tag);
                pdf = (known & !inside).select(Float::splat(simd, 0.0), pdf);
            }
            store(&mut stream.pdf, at, pdf);
            let mut left = tag;
            if self.surfaces.has_dielectric {
                left = inside.select(untagged(tag) | INSIDE, untagged(tag));
            }
            let left = alive.select(left, Word::splat(simd, NONE));
            store_words(&mut stream.primitive, at, left);
        }
        rays
    }

    /// What surfaces emit to the `lanes` of a packet's rays that meet them, times their throughput; none if none is of a
    /// material that emits.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "one packet's values, all in registers"
    )]
    fn surface_emission<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        lanes: Mask<S>,
        direction: Vec3x<S>,
        distance: Float<S>,
        tag: Word<S>,
        hit: &Hit<S>,
    ) -> Option<Vec3x<S>> {
        let surface = hit.metallic_roughness.as_ref()?;
        let mut emission = surface.emission;
        if let Some(lights) = &self.emissive_surfaces {
            let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
            let mut normal = hit.normal;
            if let Some(geometric) = hit.geometric {
                let is_other = geometric.length_squared().simd_gt(0.0);
                normal = Vec3x::select(is_other, geometric, normal);
            }
            let cosine = normal.dot(direction).abs();
            let pdf = load(simd, &stream.sampled_pdf, at);
            let origin = stream.origin.load(simd, at);
            let area_per_angle =
                lights.area_per_angle(simd, origin, untagged(tag), distance, cosine);
            let density = surface.point_density * lights.probability() * area_per_angle;
            let is_found = pdf.simd_gt(0.0) & pdf.simd_lt(f32::INFINITY) & density.simd_gt(0.0);
            let ratio = density / is_found.select(pdf, one);
            let weight = power_heuristic(is_found.select(ratio, zero));
            emission = emission * weight;
        }
        let black = Vec3x::splat(simd, [0.0; 3]);
        let beta = stream.beta.load(simd, at);
        let lanes = lanes & surface.lanes;
        Some(Vec3x::select(lanes, beta.scale(emission), black))
    }

    /// The same of surfaces where paths end. Out of line: scenes where nothing emits are not to pay for it.
    #[inline(never)]
    fn last_emission<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        depth: u32,
        lanes: Mask<S>,
        nearest: &Nearest<S>,
    ) -> Vec3x<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
                let tag = lanes.select(nearest.id, Word::splat(simd, 0));
                let distance = lanes.select(nearest.distance, one);
                let origin = stream.origin.load(simd, at);
                let direction = stream.direction.load(simd, at);
                let footprint = if depth == 0 { self.footprint } else { 0.0 };
                let hit = (self.surfaces)
                    .hit::<S, true>(simd, origin, direction, distance, tag, footprint);
                let emission =
                    self.surface_emission(simd, stream, at, lanes, direction, distance, tag, &hit);
                emission.unwrap_or(Vec3x::new(zero, zero, zero))
            },
        )
    }

    /// The surfaces that a packet's rays have met, their mirrors mollified in the lanes returned.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "one packet's values, all in registers"
    )]
    fn regularised_hit<S: Simd, const GENERAL: bool>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        direction: Vec3x<S>,
        distance: Float<S>,
        tag: Word<S>,
        footprint: f32,
    ) -> (Hit<S>, Mask<S>) {
        let origin = stream.origin.load(simd, at);
        let surfaces = &self.surfaces;
        let mut hit = surfaces.hit::<S, GENERAL>(simd, origin, direction, distance, tag, footprint);
        let regularised = regularised(simd, stream, at);
        if let Some(microfacet) = &mut hit.microfacet {
            microfacet.regularise(regularised);
        }
        if let Some(surface) = &mut hit.metallic_roughness {
            surface.regularise(regularised);
        }
        (hit, regularised)
    }

    /// Adds the light of the shadow rays of a `lobe` that reach their area light. Returns how many were
    /// traced.
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
            let begins = if lobe == OTHER && self.has_refracted_nee() {
                &shadow.origin
            } else {
                &stream.origin
            };
            let origin = begins.load(simd, at);
            let direction = shadow.direction.load(simd, at);
            // Shadow rays leave outwards, whatever the path does.
            let start = load_words(simd, &stream.primitive, at) & !INSIDE;
            let light = load_words(simd, &shadow.light, at);
            let shadow_rays = Rays::new(simd, origin, direction, start);
            // The light itself is no obstacle, whatever rounding does to its distance.
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

/// A density times the area lights' sum, 0 and ∞ as they are and nothing else 0 where there is no light.
#[inline(always)]
fn weighed<S: Simd>(pdf: Float<S>, light_weight_sum: Float<S>) -> Float<S> {
    let product = pdf * light_weight_sum.max(f32::MIN_POSITIVE);
    pdf.simd_gt(0.0).select(product.max(f32::MIN_POSITIVE), pdf)
}

/// Words below 2²³ as numbers: signed conversion is exact there and cheaper.
#[inline(always)]
fn small_to_float<S: Simd>(word: Word<S>) -> Float<S> {
    let bits: i32x16<S> = word.bitcast();
    bits.to_float()
}
