//! Next-event estimation for a packet of paths: shadow rays towards area lights, emissive surfaces,
//! environment maps and punctual lights, refracted shadow rays out of scattering balls, and shadow rays
//! towards lights reflected by coats.

use fearless_simd::prelude::*;

use super::area_light::LightSample;
use super::bsdf::Bsdf;
use super::emissive_surface::EmissiveSurfaceSampler;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::microfacet::untagged;
use super::prepared::Prepared;
use super::punctual_light::sample_punctual_light;
use super::rays::{NONE, Rays};
use super::refracted_nee::NeeBoundaries;
use super::stream::{Stream, load, load_words, store, store_words};
use super::surface::Hit;
use crate::sampling::BELOW_1;

/// Paths of a packet at their hits.
#[derive(Clone, Copy)]
pub(super) struct HitPacket<'a, S: Simd> {
    pub(super) simd: S,
    /// First row in the stream.
    pub(super) at: usize,
    pub(super) depth: u32,
    pub(super) alive: Mask<S>,
    /// Primitive that was hit, with its flags.
    pub(super) tag: Word<S>,
    pub(super) hit: &'a Hit<S>,
    pub(super) bsdf: &'a Bsdf<S>,
    /// Throughput.
    pub(super) beta: Vec3x<S>,
    /// Lanes in which specular lobes are regularised.
    pub(super) regularised: Mask<S>,
}

/// Index of shadow rays by lobe in [`Stream::shadows`].
pub(super) const OTHER: usize = 0;
pub(super) const MIRROR: usize = 1;

impl Prepared {
    /// Whether light sampling chooses between area lights and other kinds of light.
    pub(super) fn shares_light_sampling(&self) -> bool {
        self.environment.probability() > 0.0
            || self.punctual_probability > 0.0
            || self.emissive_surfaces.is_some()
    }

    /// Probability with which light sampling chooses emissive surfaces.
    pub(super) fn emissive_surface_probability(&self) -> f32 {
        (self.emissive_surfaces.as_ref()).map_or(0.0, EmissiveSurfaceSampler::probability)
    }

    /// Whether there is any light to sample.
    pub(super) fn samples_light(&self) -> bool {
        !self.area_lights.is_empty() || self.shares_light_sampling()
    }

    /// Whether shadow rays are traced towards area lights reflected by coats. In denoised images the AOVs
    /// of first hits contain smooth mirrors, and only rough coats need them.
    pub(super) fn samples_coat_reflection(&self, depth: u32) -> bool {
        self.has_coat
            && !self.area_lights.is_empty()
            && (!self.traces_mirrors_apart(depth) || self.surfaces.has_rough_coat)
    }

    fn traces_mirrors_apart(&self, depth: u32) -> bool {
        depth == 0 && self.settings.denoise
    }

    /// Next-event estimation at a packet's hits, towards all kinds of lights. Returns the number of rays
    /// inside balls and the `light_weight_sum` of area lights.
    #[inline(always)]
    pub(super) fn sample_light<S: Simd, const GENERAL: bool>(
        &self,
        packet: &HitPacket<'_, S>,
        stream: &mut Stream,
        mut u: [Float<S>; 2],
    ) -> (u64, Float<S>) {
        let HitPacket { simd, hit, .. } = *packet;
        let (mut rays, mut light_weight_sum) = (0, Float::splat(simd, 0.0));
        let aims = if GENERAL {
            self.divide_light_sampling(hit, &mut u)
        } else {
            None
        };
        if GENERAL && self.area_lights.is_empty() {
            // Other kinds of light replace these below in the lanes that chose them.
            queue_no_shadow_rays(packet, stream);
        } else {
            let mut light = self.area_lights.sample(simd, hit.position, u);
            if aims.is_some() {
                self.weigh_beside_others(hit, &mut light);
            }
            light_weight_sum = light.light_weight_sum;
            rays = self.queue_shadow_rays(packet, stream, &light);
        }
        if let Some(aims) = aims {
            self.queue_other_shadow_rays(packet, stream, &aims, u);
        }
        (rays, light_weight_sum)
    }

    /// Queues shadow rays towards an area light for all lobes. Returns the number of rays inside balls.
    #[inline(always)]
    fn queue_shadow_rays<S: Simd>(
        &self,
        packet: &HitPacket<'_, S>,
        stream: &mut Stream,
        light: &LightSample<S>,
    ) -> u64 {
        let mut rays = 0;
        self.queue_shadow_ray(packet, stream, light);
        if self.has_refracted_nee() {
            (stream.shadows[OTHER].origin).store(packet.at, packet.hit.position);
            rays = self.queue_refracted_shadow_ray(packet, stream, light);
        }
        if self.samples_coat_reflection(packet.depth) {
            self.queue_coat_shadow_ray(packet, stream);
        }
        rays
    }

    /// Chooses the kind of light in each lane and rescales `u[0]` accordingly; `None` if there are area
    /// lights only. Lanes scattered inside bodies always choose area lights.
    #[inline(always)]
    fn divide_light_sampling<S: Simd>(
        &self,
        hit: &Hit<S>,
        u: &mut [Float<S>; 2],
    ) -> Option<LightAims<S>> {
        if !self.shares_light_sampling() {
            return None;
        }
        let emissive_share = self.emissive_surface_probability();
        let shares = [
            self.punctual_probability,
            self.environment.probability(),
            self.area_light_probability,
        ];
        let [punctual_share, environment_share, _] = shares;
        // One number chooses the kind of light and is rescaled to [0, 1) within its interval: stratified
        // points stay stratified within each kind. The order of subtractions matches the scalar tracer.
        let beside_emissive = u[0] - emissive_share;
        let mut emissive = beside_emissive.simd_lt(0.0);
        let after = beside_emissive - punctual_share;
        let mut punctual = after.simd_lt(0.0) & !emissive;
        let mut environment = after.simd_lt(environment_share) & !punctual & !emissive;
        let part = |u: Float<S>, share: f32| u * (1.0 / share.max(f32::MIN_POSITIVE));
        let rest = part(after - environment_share, shares[2]);
        let rest = environment.select(part(after, environment_share), rest);
        let mut rest = punctual
            .select(part(beside_emissive, punctual_share), rest)
            // Rounding may rescale the end of an interval to 1, which would index past the last light.
            .min(BELOW_1 as f32);
        if self.emissive_surfaces.is_some() {
            let of_emissive = part(u[0], emissive_share).min(BELOW_1 as f32);
            rest = emissive.select(of_emissive, rest.max(0.0));
        }
        if let Some(microfacet) = &hit.microfacet {
            let scattered = microfacet.is_scattered();
            // Inside bodies area lights have the whole interval, and a factor of 1 in
            // `weigh_beside_others`.
            rest = scattered.select(u[0], rest);
            punctual &= !scattered;
            environment &= !scattered;
            emissive &= !scattered;
        }
        u[0] = rest;
        Some(LightAims {
            emissive,
            punctual,
            environment,
        })
    }

    /// Divides the densities of area lights by the probability of choosing them among the kinds of light.
    #[inline(always)]
    fn weigh_beside_others<S: Simd>(&self, hit: &Hit<S>, light: &mut LightSample<S>) {
        let simd = light.inverse_pdf.token();
        let mut factor = Float::splat(simd, 1.0 / self.area_light_probability);
        if let Some(microfacet) = &hit.microfacet {
            let one = Float::splat(simd, 1.0);
            factor = microfacet.is_scattered().select(one, factor);
        }
        light.inverse_pdf *= factor;
        light.inverse_density *= factor;
        light.light_weight_sum *= factor;
    }

    /// Queues shadow rays towards other kinds of light, replacing the queued ones in the lanes that chose
    /// these kinds.
    #[inline(always)]
    fn queue_other_shadow_rays<S: Simd>(
        &self,
        packet: &HitPacket<'_, S>,
        stream: &mut Stream,
        aims: &LightAims<S>,
        u: [Float<S>; 2],
    ) {
        let HitPacket {
            simd,
            alive,
            hit,
            bsdf,
            ..
        } = *packet;
        let emissive = alive & aims.emissive;
        if emissive.any_true()
            && let Some(lights) = &self.emissive_surfaces
        {
            let drawn = lights.sample(simd, emissive, hit.position, u);
            let cos_i = hit.normal.dot(drawn.wi);
            let (f_cos, bsdf_pdf) = bsdf.evaluate(simd, drawn.wi, cos_i);
            let weight = power_heuristic(bsdf_pdf * drawn.inverse_density);
            let light = f_cos.scale(drawn.radiance) * weight;
            let lanes = emissive & bsdf.sees(drawn.wi, cos_i);
            let distance = drawn.distance;
            replace_shadow_ray(packet, stream, emissive, lanes, drawn.wi, distance, light);
        }
        let environment = alive & aims.environment;
        if environment.any_true()
            && let Some(drawn) = self.environment.sample(simd, u)
        {
            let cos_i = hit.normal.dot(drawn.wi);
            let (f_cos, bsdf_pdf) = bsdf.evaluate(simd, drawn.wi, cos_i);
            let weight = power_heuristic(bsdf_pdf * drawn.inverse_density) * drawn.inverse_density;
            let light = f_cos.scale(drawn.radiance) * weight;
            let distance = Float::splat(simd, f32::MAX);
            let lanes = environment & bsdf.sees(drawn.wi, cos_i);
            replace_shadow_ray(
                packet,
                stream,
                environment,
                lanes,
                drawn.wi,
                distance,
                light,
            );
        }
        let punctual = alive & aims.punctual;
        if punctual.any_true() {
            let lights = &self.punctual_lights;
            let chosen = sample_punctual_light(simd, lights, hit.position, u[0]);
            let cos_i = hit.normal.dot(chosen.wi);
            // No MIS: BSDF sampling never hits a point light, so that light sampling has weight 1.
            let (f_cos, _) = bsdf.evaluate(simd, chosen.wi, cos_i);
            let weight = Float::splat(simd, 1.0 / self.punctual_probability);
            let light = f_cos.scale(chosen.irradiance) * weight;
            let lanes = punctual & bsdf.sees(chosen.wi, cos_i);
            let distance = chosen.distance;
            replace_shadow_ray(packet, stream, punctual, lanes, chosen.wi, distance, light);
        }
    }

    pub(super) fn has_refracted_nee(&self) -> bool {
        !self.surfaces.nee_boundaries.is_empty()
    }

    /// Lanes whose ray, of stored density `pdf`, was scattered inside a ball, travelled `distance` to the
    /// boundary, and leaves by a path that refracted next-event estimation covers.
    #[inline(always)]
    pub(super) fn exits_by_nee_hemisphere<S: Simd>(
        &self,
        simd: S,
        pdf: Float<S>,
        hit: &Hit<S>,
        wo: Vec3x<S>,
        distance: Float<S>,
        tag: Word<S>,
    ) -> Mask<S> {
        let none = Mask::splat(simd, false);
        let Some(microfacet) = &hit.microfacet else {
            return none;
        };
        let from_inside = microfacet.is_left() & pdf.simd_eq(f32::NEG_INFINITY);
        let boundaries = NeeBoundaries::new(simd, &self.surfaces.nee_boundaries, tag, from_inside);
        boundaries.map_or(none, |boundaries| {
            boundaries.are_left(distance, hit.normal.dot(wo))
        })
    }

    /// Next-event estimation through the boundary of a ball for paths scattered inside it. Returns
    /// the number of rays inside.
    #[inline(always)]
    fn queue_refracted_shadow_ray<S: Simd>(
        &self,
        packet: &HitPacket<'_, S>,
        stream: &mut Stream,
        light: &LightSample<S>,
    ) -> u64 {
        let HitPacket { simd, at, tag, .. } = *packet;
        let (hit, beta) = (packet.hit, packet.beta);
        let Some(microfacet) = &hit.microfacet else {
            return 0;
        };
        // Counts as two scattering events, inside and at the boundary, as for paths found by sampling.
        if packet.depth + 2 > self.settings.max_depth {
            return 0;
        }
        let scattered = packet.alive & microfacet.is_scattered();
        let Some(boundaries) =
            NeeBoundaries::new(simd, &self.surfaces.nee_boundaries, tag, scattered)
        else {
            return 0;
        };
        let normal = self.area_lights.normal(simd, light.index);
        let refracted = boundaries.refracted_paths(simd, hit.position, light, normal);
        if !refracted.lanes.any_true() {
            return 0;
        }
        // The ball itself is excluded by its id. No area light is inside.
        let inner = Rays::new(simd, hit.position, refracted.inner, untagged(tag));
        let none = Word::splat(simd, NONE);
        let open = refracted.lanes
            & !self
                .geometry
                .occluded(simd, &inner, None, refracted.inside, none);
        let shadow = &mut stream.shadows[OTHER];
        let (origin, direction) = (hit.position, shadow.direction.load(simd, at));
        shadow
            .origin
            .store(at, Vec3x::select(open, refracted.place, origin));
        shadow
            .direction
            .store(at, Vec3x::select(open, refracted.outer, direction));
        let radiance = shadow.radiance.load(simd, at);
        let through = beta.scale(light.radiance).scale(refracted.weight);
        shadow
            .radiance
            .store(at, Vec3x::select(open, through, radiance));
        let distance = load(simd, &shadow.distance, at);
        store(
            &mut shadow.distance,
            at,
            open.select(refracted.outside, distance),
        );
        u64::from(refracted.lanes.to_bitmask().count_ones())
    }

    /// Queues a shadow ray towards a sampled point of an area light.
    #[inline(always)]
    fn queue_shadow_ray<S: Simd>(
        &self,
        packet: &HitPacket<'_, S>,
        stream: &mut Stream,
        light: &LightSample<S>,
    ) {
        let HitPacket { simd, at, bsdf, .. } = *packet;
        // Evaluated for all lanes; the values of lanes that do not face the light are not read, as `lit` is
        // unset there.
        let cos_i = packet.hit.normal.dot(light.wi);
        let (f_cos, bsdf_pdf) = bsdf.evaluate(simd, light.wi, cos_i);
        let weight = power_heuristic(bsdf_pdf * light.inverse_density);
        let mut reflected = f_cos * weight;
        if self.has_coat {
            let coat = bsdf.regularised_coat(simd, packet.regularised, light.wi);
            reflected = reflected + Vec3x::new(coat, coat, coat);
        }
        let mut lit = packet.alive & bsdf.sees(light.wi, cos_i) & light.distance.simd_gt(0.0);
        if let Some(above) = bsdf.is_above(light.wi) {
            lit &= above;
        }
        let shadow = &mut stream.shadows[OTHER];
        shadow.direction.store(at, light.wi);
        let radiance = light.radiance * light.inverse_pdf;
        shadow
            .radiance
            .store(at, packet.beta.scale(reflected).scale(radiance));
        let zero = Float::splat(simd, 0.0);
        store(&mut shadow.distance, at, lit.select(light.distance, zero));
        store_words(
            &mut shadow.light,
            at,
            light.index + self.geometry.area_lights_first,
        );
    }

    /// Queues a shadow ray towards the area light that a coat's mirror reflects, if any.
    #[inline(always)]
    fn queue_coat_shadow_ray<S: Simd>(&self, packet: &HitPacket<'_, S>, stream: &mut Stream) {
        let HitPacket { simd, at, bsdf, .. } = *packet;
        let zero = Float::splat(simd, 0.0);
        let shadow = &mut stream.shadows[MIRROR];
        let reflectance = bsdf.coat(simd);
        let mut exact = packet.alive & !packet.regularised;
        if self.traces_mirrors_apart(packet.depth) {
            exact &= bsdf
                .rough_coats()
                .unwrap_or_else(|| Mask::splat(simd, false));
        }
        let coated = exact & reflectance.simd_gt(0.0);
        if !coated.any_true() {
            store(&mut shadow.distance, at, zero);
            return;
        }
        let wi = bsdf.mirrored();
        let rays = Rays::new(simd, packet.hit.position, wi, Word::splat(simd, NONE));
        let nearest = self.geometry.nearest_area_light(simd, &rays);
        let met = coated & nearest.id.simd_ne(NONE);
        if !met.any_true() {
            store(&mut shadow.distance, at, zero);
            return;
        }
        let index = met.select(
            nearest.id - self.geometry.area_lights_first,
            Word::splat(simd, 0),
        );
        let point = wi.mul_add(nearest.distance, packet.hit.position);
        let emission = self.area_lights.emission(simd, index, point);
        let lit = met & wi.dot(emission.normal).simd_lt(0.0);
        shadow.direction.store(at, wi);
        shadow
            .radiance
            .store(at, packet.beta.scale(emission.radiance) * reflectance);
        store(&mut shadow.distance, at, lit.select(nearest.distance, zero));
        store_words(&mut shadow.light, at, nearest.id);
    }
}

/// Clears the shadow rays of a packet, for other kinds of light to replace.
#[inline(always)]
fn queue_no_shadow_rays<S: Simd>(packet: &HitPacket<'_, S>, stream: &mut Stream) {
    let zero = Float::splat(packet.simd, 0.0);
    for shadow in &mut stream.shadows {
        store(&mut shadow.distance, packet.at, zero);
        (shadow.origin).store(packet.at, packet.hit.position);
    }
}

/// Lanes by the kind of light that they sample; the others sample area lights.
struct LightAims<S: Simd> {
    emissive: Mask<S>,
    punctual: Mask<S>,
    environment: Mask<S>,
}

/// Replaces the queued shadow rays of the lanes in `aimed` by rays without a target light, active where
/// `lit`.
#[inline(always)]
fn replace_shadow_ray<S: Simd>(
    packet: &HitPacket<'_, S>,
    stream: &mut Stream,
    aimed: Mask<S>,
    mut lit: Mask<S>,
    wi: Vec3x<S>,
    distance: Float<S>,
    light: Vec3x<S>,
) {
    let HitPacket { simd, at, beta, .. } = *packet;
    if let Some(above) = packet.bsdf.is_above(wi) {
        lit &= above;
    }
    let shadow = &mut stream.shadows[OTHER];
    let before = shadow.direction.load(simd, at);
    shadow.direction.store(at, Vec3x::select(aimed, wi, before));
    let before = shadow.radiance.load(simd, at);
    (shadow.radiance).store(at, Vec3x::select(aimed, beta.scale(light), before));
    let distance = lit.select(distance, Float::splat(simd, 0.0));
    let before = load(simd, &shadow.distance, at);
    store(&mut shadow.distance, at, aimed.select(distance, before));
    let before = load_words(simd, &shadow.light, at);
    let none = Word::splat(simd, NONE);
    store_words(&mut shadow.light, at, aimed.select(none, before));
}

/// Weight of the power heuristic (β = 2) for a strategy whose competitor has `density_ratio` times its
/// density. Computed from the ratio, as squares of densities towards tiny area lights would overflow.
#[inline(always)]
pub(super) fn power_heuristic<S: Simd>(density_ratio: Float<S>) -> Float<S> {
    1.0 / density_ratio.mul_add(density_ratio, Float::splat(density_ratio.token(), 1.0))
}
