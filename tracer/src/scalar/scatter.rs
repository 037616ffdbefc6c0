//! BSDF at one point of a surface, of any material.

use glam::DVec3;

use super::bsdf::{Bsdf, BsdfSample};
use super::intersect::{Hit, vector};
use super::metallic_roughness::MetallicRoughness;
use super::microfacet::{Conductor, Dielectric};
use super::textured::{clearcoat_normal, texture_factors, vertex_color};
use crate::CompiledScene;
use crate::compiled::{KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_METALLIC_ROUGHNESS, PATTERN_NONE};
use crate::fresnel::{fresnel_conductor, fresnel_dielectric};

/// BSDFs of the materials of [`crate::Material`], as seen from one side of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scatter {
    /// Diffuse, bare or coated.
    Layered(Bsdf),
    /// Metal.
    Conductor(Conductor),
    /// Boundary of a dielectric.
    Dielectric(Dielectric),
    /// glTF's metallic-roughness material.
    MetallicRoughness(MetallicRoughness),
}

impl Scatter {
    /// BSDF at a hit, for light scattered towards `wo`. An area light reflects nothing. `footprint_m` is
    /// the width of the surface that the ray covers, metres; 0 for the finest level of textures.
    pub fn new(scene: &CompiledScene, hit: &Hit, wo: DVec3, footprint_m: f64) -> Self {
        let Some(material) = scene.material_of(hit.primitive) else {
            return Self::Layered(Bsdf::from_hit(scene, hit, footprint_m));
        };
        if let Some(bsdf) = Bsdf::of_number_disc(scene, material, hit, wo) {
            return Self::Layered(bsdf);
        }
        let alpha = f64::from(material.alpha);
        match material.kind {
            KIND_CONDUCTOR => Self::Conductor(Conductor {
                eta: vector(material.eta),
                k: vector(material.k),
                alpha,
            }),
            KIND_DIELECTRIC => {
                let ior = f64::from(material.ior);
                let is_inside = wo.dot(hit.n) < 0.0;
                let eta = if is_inside { 1.0 / ior } else { ior };
                Self::Dielectric(Dielectric { eta, alpha })
            }
            KIND_METALLIC_ROUGHNESS => {
                let factors = texture_factors(scene, hit, footprint_m);
                Self::MetallicRoughness(MetallicRoughness {
                    clearcoat_n: clearcoat_normal(scene, hit, wo),
                    ..MetallicRoughness::new(material, &factors)
                })
            }
            _ => {
                let mut bsdf = Bsdf::from_hit(scene, hit, footprint_m);
                if material.pattern == PATTERN_NONE {
                    bsdf.albedo *= vertex_color(scene, hit);
                }
                Self::Layered(bsdf)
            }
        }
    }

    /// `f` in sr⁻¹ without mirrors, to be multiplied by [`Scatter::cosine`], and the density per solid
    /// angle with which [`Scatter::sample`] draws `wi`. `n` is on the side of `wo`.
    pub fn eval(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        match self {
            Self::Layered(bsdf) => {
                let (cos_o, cos_i) = (wo.dot(n), wi.dot(n));
                let sheen = bsdf.sheen(wo, wi, n);
                (bsdf.eval(cos_o, cos_i) + sheen, bsdf.pdf(cos_o, cos_i))
            }
            Self::Conductor(metal) => metal.eval(wo, wi, n),
            Self::Dielectric(glass) => glass.eval(wo, wi, n),
            Self::MetallicRoughness(surface) => surface.eval(wo, wi, n),
        }
    }

    /// Cosine of the incident direction `wi` to `n`, or to the normal of a clear coat with one of its own.
    pub fn cosine(&self, wi: DVec3, n: DVec3) -> f64 {
        match self {
            Self::MetallicRoughness(surface) => surface.cosine(wi, n),
            _ => wi.dot(n),
        }
    }

    /// Whether it has a shading normal other than `n`, that of a clear coat.
    pub fn has_clearcoat_normal(&self) -> bool {
        matches!(self, Self::MetallicRoughness(surface) if surface.clearcoat_n.is_some())
    }

    /// Share of light that a coat's mirror reflects; 0 without a coat.
    pub fn coat(&self, cos_o: f64) -> f64 {
        match self {
            Self::Layered(bsdf) => bsdf.reflected(cos_o),
            Self::Conductor(_) | Self::Dielectric(_) | Self::MetallicRoughness(_) => 0.0,
        }
    }

    /// Draws a direction by `u[1]` and `u[2]`, which also choose the lobe of a layered material;
    /// `u[0]` chooses that of dielectrics and of glTF's material.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        match self {
            Self::Layered(bsdf) => bsdf.sample(wo, n, u),
            Self::Conductor(metal) => metal.sample(wo, n, u),
            Self::Dielectric(glass) => glass.sample(wo, n, u),
            Self::MetallicRoughness(surface) => surface.sample(wo, n, u),
        }
    }

    /// Albedo AOV: reflectance of a diffuse base; 1 for metals and dielectrics, which show other surfaces.
    pub(super) fn albedo(&self) -> DVec3 {
        match self {
            Self::Layered(bsdf) => bsdf.albedo,
            Self::Conductor(_) | Self::Dielectric(_) => DVec3::ONE,
            Self::MetallicRoughness(surface) => surface.albedo(),
        }
    }

    /// Reflectance of a smooth mirror or coat, or transmittance of a smooth thin wall; 0 for rough ones.
    pub(super) fn mirror(&self, wo: DVec3, n: DVec3) -> DVec3 {
        let cos_o = wo.dot(n);
        match *self {
            Self::Layered(bsdf) if bsdf.is_rough() => DVec3::ZERO,
            Self::Layered(bsdf) => DVec3::splat(bsdf.reflected(cos_o)),
            Self::Conductor(metal) if metal.alpha == 0.0 => {
                fresnel_conductor(cos_o, metal.eta, metal.k)
            }
            Self::Dielectric(glass) if glass.alpha == 0.0 => {
                DVec3::splat(fresnel_dielectric(cos_o, glass.eta))
            }
            Self::MetallicRoughness(surface) => surface.straight(wo, n),
            Self::Conductor(_) | Self::Dielectric(_) => DVec3::ZERO,
        }
    }

    /// Direction of the mirror reflection, or straight ahead through a thin wall.
    pub(super) fn mirrored(&self, wo: DVec3, n: DVec3) -> DVec3 {
        match self {
            Self::MetallicRoughness(surface) if surface.wall.is_some() => -wo,
            Self::Layered(bsdf) => bsdf.mirrored(wo, n),
            _ => 2.0 * wo.dot(n) * n - wo,
        }
    }

    /// Whether its coat is rough, so that a microfacet is drawn.
    pub fn has_rough_coat(&self) -> bool {
        matches!(self, Self::Layered(bsdf) if bsdf.is_rough())
    }

    /// The BSDF with one microfacet of a rough coat drawn: [`Bsdf::with_facet`]; others unchanged.
    #[must_use]
    pub fn with_facet(self, wo: DVec3, n: DVec3, u: impl FnOnce() -> [f64; 2]) -> Self {
        match self {
            Self::Layered(bsdf) if bsdf.is_rough() => Self::Layered(bsdf.with_facet(wo, n, u())),
            _ => self,
        }
    }

    /// Whether it has a diffuse base, bare or coated.
    pub(super) fn is_layered(&self) -> bool {
        matches!(self, Self::Layered(_))
    }

    /// Radiance emitted by the surface.
    pub fn emission(&self) -> DVec3 {
        match self {
            Self::MetallicRoughness(surface) => surface.emission,
            _ => DVec3::ZERO,
        }
    }

    /// Whether transmitted light continues inside a body.
    pub fn is_dielectric(&self) -> bool {
        matches!(self, Self::Dielectric(_))
    }

    /// Whether the surface transmits light.
    pub fn lets_light_pass(&self) -> bool {
        match self {
            Self::Dielectric(_) => true,
            Self::MetallicRoughness(surface) => surface.wall.is_some(),
            Self::Layered(_) | Self::Conductor(_) => false,
        }
    }
}
