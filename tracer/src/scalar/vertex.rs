//! Path vertices on surfaces.

use glam::DVec3;

use super::area_light::light_weight_sum;
use super::bsdf::BsdfSample;
use super::intersect::{Hit, Ray, RayOrigin};
use super::metallic_roughness::MetallicRoughness;
use super::microfacet::Conductor;
use super::scatter::Scatter;
use super::triangle::visible_shading_normal;
use crate::CompiledScene;
use crate::compiled::Primitive;
use crate::regularisation::{ALPHA_MIN, CONE_COSINE, CONE_DENSITY};

/// A path vertex on a surface that scatters.
pub(super) struct Vertex {
    pub(super) point: DVec3,
    /// Unit shading normal, on the side of `wo`.
    pub(super) n: DVec3,
    /// Unit geometric normal, on the side of `wo`.
    pub(super) geometric_n: DVec3,
    pub(super) wo: DVec3,
    pub(super) primitive: Primitive,
    /// Whether `wo` is inside the body.
    pub(super) is_inside: bool,
    pub(super) scatter: Scatter,
    /// [`light_weight_sum`] at the point, over the probability with which light sampling chooses area
    /// lights.
    pub(super) light_weight_sum: f64,
    /// Whether its specular lobes are regularised ([`crate::regularisation`]).
    pub(super) is_regularised: bool,
}

impl Vertex {
    pub(super) fn new(scene: &CompiledScene, ray: &Ray, hit: &Hit, footprint_m: f64) -> Self {
        let wo = -ray.direction;
        let is_inside = hit.n.dot(wo) < 0.0;
        let side = if is_inside { -1.0 } else { 1.0 };
        let geometric_n = side * hit.n;
        let n = match hit.shading_n == hit.n {
            true => geometric_n,
            false => visible_shading_normal(side * hit.shading_n, geometric_n, wo),
        };
        Self {
            point: hit.point,
            n,
            geometric_n,
            wo,
            primitive: hit.primitive,
            is_inside,
            scatter: Scatter::new(scene, hit, wo, footprint_m),
            light_weight_sum: light_weight_sum(&scene.area_lights, hit.point)
                / scene.area_light_probability(),
            is_regularised: false,
        }
    }

    /// Absolute cosine of the incident direction `wi`.
    pub(super) fn cosine(&self, wi: DVec3) -> f64 {
        self.scatter.cosine(wi, self.n).abs()
    }

    /// Whether `wi` is on different sides of the geometric and the shading normal, or below the surface of
    /// an opaque material with a shading normal.
    pub(super) fn is_below(&self, wi: DVec3) -> bool {
        let is_passed = self.scatter.lets_light_pass() && wi.dot(self.n) < 0.0;
        // Transmitted directions have to be below the geometric surface, all others above.
        let height = wi.dot(self.geometric_n) * if is_passed { -1.0 } else { 1.0 };
        let is_smooth = self.n != self.geometric_n || self.scatter.has_clearcoat_normal();
        is_smooth && height <= 0.0
    }

    /// Draws a direction; one below the surface has weight 0.
    pub(super) fn sample(&self, u: [f64; 4]) -> BsdfSample {
        let mut sample = self.scatter.sample(self.wo, self.n, u);
        if self.is_below(sample.wi) {
            sample.weight = DVec3::ZERO;
        }
        sample
    }

    /// The vertex with one microfacet drawn, if its coat is rough.
    pub(super) fn with_facet(self, u: impl FnOnce() -> [f64; 2]) -> Self {
        Self {
            scatter: self.scatter.with_facet(self.wo, self.n, u),
            ..self
        }
    }

    /// The vertex with its specular lobes widened, if `is_regularised`.
    pub(super) fn regularised(mut self, is_regularised: bool) -> Self {
        self.is_regularised = is_regularised;
        if !is_regularised {
            return self;
        }
        match &mut self.scatter {
            Scatter::Conductor(Conductor { alpha, .. }) => {
                *alpha = alpha.max(f64::from(ALPHA_MIN));
            }
            Scatter::MetallicRoughness(MetallicRoughness {
                alpha,
                clearcoat_alpha,
                ..
            }) => {
                *alpha = alpha.max(f64::from(ALPHA_MIN));
                *clearcoat_alpha = clearcoat_alpha.max(f64::from(ALPHA_MIN));
            }
            Scatter::Layered(_) | Scatter::Dielectric(_) => {}
        }
        self
    }

    /// `f · cos θ` of a coat's mirror, spread over the cone of path regularisation, sr⁻¹; 0 if not
    /// regularised.
    pub(super) fn regularised_coat(&self, wi: DVec3) -> f64 {
        let cos_o = self.wo.dot(self.n);
        let mirrored = self.scatter.mirrored(self.wo, self.n);
        let is_in_cone = wi.dot(mirrored) > f64::from(CONE_COSINE) && wi.dot(self.n) > 0.0;
        if !self.is_regularised || !is_in_cone {
            return 0.0;
        }
        self.scatter.coat(cos_o) * f64::from(CONE_DENSITY)
    }

    /// Origin of a ray towards `wi`: opaque surfaces are left outwards, on either side.
    pub(super) fn ray_origin(&self, wi: DVec3) -> RayOrigin {
        let is_passed = wi.dot(self.n) < 0.0;
        RayOrigin {
            primitive: self.primitive,
            is_inside: self.scatter.is_dielectric() && self.is_inside != is_passed,
        }
    }
}
