//! Shading stage of the integrator: next-event estimation and scattering at the hits.

use fearless_simd::prelude::*;

use super::bsdf::Bsdf;
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::light_sampling::{HitPacket, power_heuristic};
use super::microfacet::untagged;
use super::prepared::Prepared;
use super::rays::{INSIDE, NONE, Nearest};
use super::regularisation::{regularised, with_spread};
use super::sampling::pair;
use super::stream::{Stream, load, load_words, packets, store, store_words};
use super::surface::Hit;
use crate::sampling::{block_choice, block_coat, block_light, block_scatter};

/// Scatters each path at its hit: queues shadow rays and draws the next direction. Returns the number of
/// rays traced meanwhile.
pub(super) fn shade<S: Simd>(scene: &Prepared, simd: S, stream: &mut Stream, depth: u32) -> u64 {
    // Two instances of the kernel: that of simple scenes keeps more values in registers. With vectors
    // below half a packet's width all values spill in any case, and one instance suffices.
    if S::f32s::LEN < LANES / 2 || scene.is_general {
        simd.vectorize(
            #[inline(always)]
            || scene.shade_packets::<S, true>(simd, stream, depth),
        )
    } else {
        simd.vectorize(
            #[inline(always)]
            || scene.shade_packets::<S, false>(simd, stream, depth),
        )
    }
}

impl Prepared {
    #[inline(always)]
    #[expect(
        clippy::too_many_lines,
        reason = "one packet's values, all in registers"
    )]
    fn shade_packets<S: Simd, const GENERAL: bool>(
        &self,
        simd: S,
        stream: &mut Stream,
        depth: u32,
    ) -> u64 {
        let mut rays = 0;
        for packet in packets(stream.len) {
            let at = packet.at;
            let tag = load_words(simd, &stream.primitive, at);
            let alive = packet.mask(simd) & tag.simd_ne(NONE);
            if !alive.any_true() {
                stream.store_miss(simd, at);
                continue;
            }
            // Dead lanes use row 0, as tables panic on ids out of range.
            let tag = alive.select(tag, Word::splat(simd, 0));
            let direction = stream.direction.load(simd, at);
            let distance = load(simd, &stream.distance, at);
            // Ray differentials are not carried along paths: after a scattering event textures are sampled
            // at the finest level and filtered by the samples of a pixel.
            let footprint = if depth == 0 { self.footprint } else { 0.0 };
            let (hit, regularised) = self.regularised_hit::<S, GENERAL>(
                simd, stream, at, direction, distance, tag, footprint,
            );
            let mut bsdf = Bsdf::new(simd, &hit, -direction);
            if self.records_aovs_at(depth) {
                let (inverse_depth, emitted) = stream.load_emission(simd, at);
                let aovs = self.surface_aovs(simd, alive, tag, &hit, &bsdf, inverse_depth, emitted);
                stream.store_aovs(at, aovs);
            }
            let pixel = load_words(simd, &stream.pixel, at);
            let sample = load_words(simd, &stream.sample, at);
            let seed = self.settings.seed;
            if bsdf.rough_coats().is_some() {
                let u = pair(pixel, sample, block_coat(depth), seed);
                bsdf.draw_facets(simd, &hit, u);
            }
            let beta = stream.beta.load(simd, at);
            if let Some(emission) =
                self.surface_emission(simd, stream, at, alive, direction, distance, tag, &hit)
            {
                let radiance = stream.radiance.load(simd, at);
                stream.radiance.store(at, radiance + emission);
            }
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
            // Only these lobes read u0; a Sobol pair costs sixteen multiplications per lane.
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
            // Stored as a product, because MIS at the next hit needs only the ratio brightness / product;
            // the sum belongs to this point and is not known there.
            let pdf = weighed(scattered.pdf, light_weight_sum);
            let diffuse = bsdf.layered(simd) & pdf.simd_gt(0.0);
            let mut pdf = with_spread(pdf, regularised | diffuse);
            if let Some(rough) = bsdf.rough_coats() {
                // A rough coat's mirror gets a negligible density instead of 0, which marks mirrors whose
                // light the first-hit AOVs contain.
                let least = Float::splat(simd, f32::MIN_POSITIVE);
                pdf = (rough & pdf.simd_eq(0.0)).select(least, pdf);
            }
            if self.has_refracted_nee() {
                let before = load(simd, &stream.pdf, at);
                let known =
                    self.exits_by_nee_hemisphere(simd, before, &hit, -direction, distance, tag);
                // Refracted next-event estimation has covered area lights along this ray: density 0 gives
                // their emission weight 0.
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

    /// Light emitted by the surfaces hit in `lanes`, weighted by MIS and throughput; `None` if the packet
    /// hit no material that can emit.
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
            // Densities by area are converted by the geometric normal; it is 0 where it equals `normal`.
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
            // Light sampling cannot draw directions of mirrors and camera rays: weight 1.
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

    /// [`Self::surface_emission`] where paths end. Not inlined, so that scenes without emission do not pay
    /// for the code.
    #[inline(never)]
    pub(super) fn last_emission<S: Simd>(
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
                let hit =
                    (self.surfaces).general_hit(simd, origin, direction, distance, tag, footprint);
                let emission =
                    self.surface_emission(simd, stream, at, lanes, direction, distance, tag, &hit);
                emission.unwrap_or(Vec3x::new(zero, zero, zero))
            },
        )
    }

    /// Surface properties at a packet's hits, specular lobes widened in the regularised lanes, which are
    /// returned too.
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
        let mut hit = if GENERAL {
            surfaces.general_hit(simd, origin, direction, distance, tag, footprint)
        } else {
            surfaces.hit::<S, false>(simd, origin, direction, distance, tag, footprint)
        };
        let regularised = regularised(simd, stream, at);
        if let Some(microfacet) = &mut hit.microfacet {
            microfacet.regularise(regularised);
        }
        if let Some(surface) = &mut hit.metallic_roughness {
            surface.regularise(regularised);
        }
        (hit, regularised)
    }
}

/// Product of density and sum, at least MIN_POSITIVE for positive densities; 0, ±∞ and NaN are kept.
#[inline(always)]
fn weighed<S: Simd>(pdf: Float<S>, light_weight_sum: Float<S>) -> Float<S> {
    let product = pdf * light_weight_sum.max(f32::MIN_POSITIVE);
    // A product of 0 would mark a coat's mirror at the next hit. 0, −∞ and NaN fail the comparison.
    pdf.simd_gt(0.0).select(product.max(f32::MIN_POSITIVE), pdf)
}
