//! BSDFs of surfaces, one surface point per lane: diffuse surfaces, bare or coated, here; metals and
//! dielectrics in [`super::microfacet`], glTF's material in [`super::metallic_roughness`].

use std::f32::consts::FRAC_1_PI;

use fearless_simd::prelude::*;

use super::fresnel::fresnel;
use super::lanes::{Float, Mask, Vec3x};
use super::metallic_roughness::MetallicRoughness;
use super::microfacet::{MicrofacetBsdf, sample_visible, visibility};
use super::sampling::{BsdfSample, cosine_hemisphere};
use super::sheen::Sheen;
use super::surface::Hit;
use crate::regularisation::{CONE_COSINE, CONE_DENSITY};

/// The BSDF at a hit for one outgoing direction: a specular coat that reflects `fresnel` over a diffuse
/// base. Without a coat `fresnel` is 0.
pub(super) struct Bsdf<S: Simd> {
    normal: Vec3x<S>,
    geometric: Option<Vec3x<S>>,
    wo: Vec3x<S>,
    ior: Float<S>,
    cos_o: Float<S>,
    fresnel: Float<S>,
    /// Direction of the coat's mirror reflection.
    mirrored: Vec3x<S>,
    /// The lanes whose coat is rough; `None` if the scene has no rough coats or the packet met no coat.
    rough: Option<Mask<S>>,
    /// Probability with which the coat's mirror direction is sampled.
    specular_share: Float<S>,
    /// Albedo of the base times all factors that do not depend on `wi`.
    base: Vec3x<S>,
    coated: Mask<S>,
    any_coated: bool,
    microfacet: Option<MicrofacetBsdf<S>>,
    sheen: Option<Sheen<S>>,
    metallic_roughness: Option<MetallicRoughness<S>>,
}

impl<S: Simd> Bsdf<S> {
    /// `wo` is on the side of the normal.
    #[inline(always)]
    pub(super) fn new(simd: S, hit: &Hit<S>, wo: Vec3x<S>) -> Self {
        let cos_o = hit.normal.dot(wo);
        let coated = hit.ior.simd_gt(0.0);
        let mut bsdf = Self {
            normal: hit.normal,
            geometric: hit.geometric,
            wo,
            ior: hit.ior,
            cos_o,
            fresnel: Float::splat(simd, 0.0),
            mirrored: hit.normal.mul_add(cos_o * 2.0, -wo),
            rough: None,
            specular_share: Float::splat(simd, 0.0),
            base: hit.albedo,
            coated,
            any_coated: coated.any_true(),
            microfacet: hit.microfacet,
            sheen: hit.sheen,
            metallic_roughness: hit.metallic_roughness,
        };
        if bsdf.any_coated {
            let zero = Float::splat(simd, 0.0);
            bsdf.set_coat(
                simd,
                hit,
                coated.select(fresnel(simd, cos_o, hit.ior), zero),
            );
            if let Some(alpha) = hit.coat_alpha {
                bsdf.rough = Some(coated & alpha.simd_gt(0.0));
            }
        }
        bsdf
    }

    /// Sets the reflectance of the coat, and with it what the base receives and the lobes' probabilities.
    #[inline(always)]
    fn set_coat(&mut self, simd: S, hit: &Hit<S>, reflected: Float<S>) {
        let zero = Float::splat(simd, 0.0);
        // The mirror is chosen in proportion to its share of the albedo, F / (F + (1 − F)·mean albedo).
        let mean = (hit.albedo.x + hit.albedo.y + hit.albedo.z) * (1.0 / 3.0);
        let share = reflected / (1.0 - reflected).mul_add(mean, reflected);
        self.fresnel = reflected;
        self.specular_share = reflected.simd_gt(0.0).select(share, zero);
        self.base = hit.albedo * ((1.0 - reflected) * hit.diffuse_scale);
    }

    /// The lanes whose coat is rough; `None` if there are none.
    #[inline(always)]
    pub(super) fn rough_coats(&self) -> Option<Mask<S>> {
        self.rough.filter(|rough| rough.any_true())
    }

    /// Replaces rough coats by the mirror of one visible microfacet each:
    /// [`crate::scalar::bsdf::Bsdf::with_facet`].
    #[inline(always)]
    pub(super) fn draw_facets(&mut self, simd: S, hit: &Hit<S>, u: [Float<S>; 2]) {
        let (Some(rough), Some(alpha)) = (self.rough_coats(), hit.coat_alpha) else {
            return;
        };
        let h = sample_visible(simd, alpha, self.normal, self.wo, u[0], u[1]);
        let h = Vec3x::select(rough, h, self.normal);
        // Reflectance F(wo·h) · G1(wi): the weight of a visible-normal sample.
        let cos_h = self.wo.dot(h);
        let mirrored = h.mul_add(cos_h * 2.0, -self.wo);
        let cos_i = self.normal.dot(mirrored).max(0.0);
        let shadowing = visibility(alpha, cos_i) * cos_i;
        let reflected = fresnel(simd, cos_h, self.ior) * shadowing;
        self.mirrored = Vec3x::select(rough, mirrored, self.mirrored);
        self.set_coat(simd, hit, rough.select(reflected, self.fresnel));
    }

    /// Lanes in which light from `wi`, at `cos_i` to the normal, can be scattered to `wo` other than by a
    /// mirror.
    #[inline(always)]
    pub(super) fn sees(&self, wi: Vec3x<S>, cos_i: Float<S>) -> Mask<S> {
        let mut faces = cos_i.simd_gt(0.0);
        if let Some(surface) = &self.metallic_roughness
            && let Some(coat_faces) = surface.clearcoat_faces(wi)
        {
            faces |= coat_faces;
        }
        if let Some(surface) = &self.metallic_roughness
            && let Some(behind) = surface.spreads_behind()
        {
            faces |= behind;
        }
        match &self.microfacet {
            Some(microfacet) => (faces & !microfacet.lanes()) | microfacet.sees(cos_i),
            None => faces,
        }
    }

    /// `f · |cos θ|` without mirrors, and the pdf per solid angle, for a direction at `cos_i` that
    /// passes [`Bsdf::sees`].
    #[inline(always)]
    pub(super) fn evaluate(&self, simd: S, wi: Vec3x<S>, cos_i: Float<S>) -> (Vec3x<S>, Float<S>) {
        let diffuse = cos_i * FRAC_1_PI;
        let mut f_cos = self.base * (diffuse * self.transmitted(simd, cos_i));
        if let Some(sheen) = &self.sheen {
            f_cos = f_cos + sheen.evaluate(simd, self.normal, self.wo, wi) * cos_i;
        }
        let mut pdf = diffuse * (1.0 - self.specular_share);
        if let Some(surface) = &self.metallic_roughness {
            let (rough, rough_pdf) = surface.evaluate(simd, self.normal, self.wo, wi);
            f_cos = Vec3x::select(surface.lanes, rough, f_cos);
            pdf = surface.lanes.select(rough_pdf, pdf);
        }
        let Some(microfacet) = &self.microfacet else {
            return (f_cos, pdf);
        };
        let (glossy, glossy_pdf) = microfacet.evaluate(simd, self.normal, self.wo, wi);
        let lanes = microfacet.lanes();
        (
            Vec3x::select(lanes, glossy, f_cos),
            lanes.select(glossy_pdf, pdf),
        )
    }

    /// Whether `wi` is on the same side of the geometric as of the shading normal; `None` where all
    /// shading normals are geometric normals.
    #[inline(always)]
    pub(super) fn is_above(&self, wi: Vec3x<S>) -> Option<Mask<S>> {
        let height = self.geometric?.dot(wi);
        let above = height.simd_ge(0.0);
        let Some(transmissive) = self.is_transmissive() else {
            return Some(above);
        };
        // A transmitted direction has to be below both normals, any other above both.
        let passed = transmissive & self.normal.dot(wi).simd_lt(0.0);
        Some((passed & height.simd_le(0.0)) | (!passed & above))
    }

    /// Lanes whose surface transmits light; `None` if the packet met no such surface.
    #[inline(always)]
    fn is_transmissive(&self) -> Option<Mask<S>> {
        let walls = (self.metallic_roughness.as_ref()).and_then(MetallicRoughness::lets_pass);
        match (&self.microfacet, walls) {
            (Some(microfacet), Some(walls)) => Some(microfacet.is_transmissive() | walls),
            (Some(microfacet), None) => Some(microfacet.is_transmissive()),
            (None, walls) => walls,
        }
    }

    /// Draws a direction by `u[1]` and `u[2]`, which also choose between coat and base; `u[0]` chooses
    /// the lobe of a dielectric and of glTF's material. Sets the lanes whose ray continues inside a
    /// dielectric in `inside`. A direction on different sides of the geometric and the shading normal has
    /// weight 0.
    #[inline(always)]
    pub(super) fn sample(&self, simd: S, u: [Float<S>; 3], inside: &mut Mask<S>) -> BsdfSample<S> {
        let mut u1 = u[1];
        if self.any_coated {
            // Values of `u[1]` above the mirror's share choose the base and are rescaled to [0, 1).
            u1 = ((u1 - self.specular_share) / (1.0 - self.specular_share)).max(0.0);
        }
        let wi = cosine_hemisphere(simd, self.normal, u1, u[2]);
        let cos_i = self.normal.dot(wi).max(0.0);
        let mut scattered = BsdfSample {
            wi,
            weight: self.base,
            pdf: cos_i * FRAC_1_PI,
        };
        if self.any_coated {
            let diffuse_share = 1.0 - self.specular_share;
            scattered.weight = self.base * (self.transmitted(simd, cos_i) / diffuse_share);
            scattered.pdf *= diffuse_share;
            self.choose_mirror(simd, u[1], &mut scattered);
        }
        if let Some(sheen) = &self.sheen {
            let f = sheen.evaluate(simd, self.normal, self.wo, wi);
            let pi = Float::splat(simd, std::f32::consts::PI);
            // f · cos / pdf, where pdf = cos / π.
            scattered.weight = scattered.weight + f * pi;
        }
        if let Some(microfacet) = &self.microfacet {
            let glossy = microfacet.sample(simd, self.normal, self.wo, u, inside);
            let lanes = microfacet.lanes();
            scattered.wi = Vec3x::select(lanes, glossy.wi, scattered.wi);
            scattered.weight = Vec3x::select(lanes, glossy.weight, scattered.weight);
            scattered.pdf = lanes.select(glossy.pdf, scattered.pdf);
        }
        if let Some(surface) = &self.metallic_roughness {
            let rough = surface.sample(simd, self.normal, self.wo, u);
            scattered.wi = Vec3x::select(surface.lanes, rough.wi, scattered.wi);
            scattered.weight = Vec3x::select(surface.lanes, rough.weight, scattered.weight);
            scattered.pdf = surface.lanes.select(rough.pdf, scattered.pdf);
        }
        if let Some(above) = self.is_above(scattered.wi) {
            let black = Vec3x::splat(simd, [0.0; 3]);
            scattered.weight = Vec3x::select(above, scattered.weight, black);
        }
        scattered
    }

    /// Share of light that the coat reflects; 0 without a coat.
    #[inline(always)]
    pub(super) fn coat(&self, simd: S) -> Float<S> {
        match &self.microfacet {
            Some(microfacet) => microfacet
                .lanes()
                .select(Float::splat(simd, 0.0), self.fresnel),
            None => self.fresnel,
        }
    }

    /// `f · cos θ` of the coat's mirror, spread over the cone of path regularisation, for lanes that are
    /// `regularised`, sr⁻¹; 0 in the others.
    #[inline(always)]
    pub(super) fn regularised_coat(&self, simd: S, regularised: Mask<S>, wi: Vec3x<S>) -> Float<S> {
        let in_cone = regularised & self.mirrored.dot(wi).simd_gt(CONE_COSINE);
        in_cone.select(self.coat(simd) * CONE_DENSITY, Float::splat(simd, 0.0))
    }

    /// Lanes with a diffuse base, bare or coated.
    #[inline(always)]
    pub(super) fn layered(&self, simd: S) -> Mask<S> {
        let layered = match &self.microfacet {
            Some(microfacet) => !microfacet.lanes(),
            None => Mask::splat(simd, true),
        };
        match &self.metallic_roughness {
            Some(surface) => layered & !surface.lanes,
            None => layered,
        }
    }

    /// Replaces the sample by the coat's mirror in lanes with `u` below its probability.
    #[inline(always)]
    fn choose_mirror(&self, simd: S, u: Float<S>, scattered: &mut BsdfSample<S>) {
        let specular = u.simd_lt(self.specular_share);
        // NaN where the share is 0, in lanes that `specular` excludes.
        let weight = self.fresnel / self.specular_share;
        let weight = Vec3x::new(weight, weight, weight);
        scattered.wi = Vec3x::select(specular, self.mirrored, scattered.wi);
        scattered.weight = Vec3x::select(specular, weight, scattered.weight);
        scattered.pdf = specular.select(Float::splat(simd, 0.0), scattered.pdf);
    }

    /// Albedo AOV: reflectance of a diffuse base; 1 for metals and dielectrics, which show other surfaces.
    #[inline(always)]
    pub(super) fn albedo(&self, simd: S, mut albedo: Vec3x<S>) -> Vec3x<S> {
        if let Some(surface) = &self.metallic_roughness {
            albedo = Vec3x::select(surface.lanes, surface.albedo(), albedo);
        }
        match &self.microfacet {
            Some(microfacet) => {
                Vec3x::select(microfacet.lanes(), Vec3x::splat(simd, [1.0; 3]), albedo)
            }
            None => albedo,
        }
    }

    /// Reflectance of a smooth mirror or coat, or transmittance of a smooth thin wall; 0 for rough coats.
    #[inline(always)]
    pub(super) fn mirror(&self, simd: S) -> Vec3x<S> {
        let mut coat = Vec3x::new(self.fresnel, self.fresnel, self.fresnel);
        if let Some(rough) = self.rough_coats() {
            coat = Vec3x::select(rough, Vec3x::splat(simd, [0.0; 3]), coat);
        }
        if let Some(surface) = &self.metallic_roughness
            && let Some((smooth, passed)) = surface.straight_passed(self.normal, self.wo)
        {
            coat = Vec3x::select(smooth, passed, coat);
        }
        match &self.microfacet {
            Some(microfacet) => Vec3x::select(
                microfacet.lanes(),
                microfacet.mirror(simd, self.cos_o),
                coat,
            ),
            None => coat,
        }
    }

    /// Direction of the mirror reflection, or straight ahead through a thin wall.
    #[inline(always)]
    pub(super) fn shown(&self) -> Vec3x<S> {
        let walls = (self.metallic_roughness.as_ref()).and_then(MetallicRoughness::lets_pass);
        match walls {
            Some(walls) => Vec3x::select(walls, -self.wo, self.mirrored),
            None => self.mirrored,
        }
    }

    /// Direction of the coat's mirror reflection.
    #[inline(always)]
    pub(super) fn mirrored(&self) -> Vec3x<S> {
        self.mirrored
    }

    /// Share of light that the coat transmits at `cos` to the normal.
    #[inline(always)]
    fn transmitted(&self, simd: S, cos: Float<S>) -> Float<S> {
        let one = Float::splat(simd, 1.0);
        if !self.any_coated {
            return one;
        }
        self.coated.select(one - fresnel(simd, cos, self.ior), one)
    }
}
