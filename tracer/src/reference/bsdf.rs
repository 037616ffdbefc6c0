//! Diffuse surfaces and smooth plastic: evaluate, sample, density.
//!
//! `wo` and `wi` both leave the surface, to the eye and to the light; cosines are to the normal on
//! the side of `wo`.

use std::f64::consts::PI;

use glam::DVec3;

use super::intersect::{Hit, vector};
use crate::CompiledScene;
use crate::compiled::{MaterialData, Primitive, fresnel_dielectric};

/// How one point of a surface scatters: a mirror of weight `F(cos wo)` over
/// `f = albedo/π · (1−F(cos wo))(1−F(cos wi)) · diffuse_scale`, `F` being 0 without a coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bsdf {
    /// Albedo of the base.
    pub albedo: DVec3,
    /// Index of refraction of the coat; 0 for none.
    pub ior: f64,
    /// `1 / (η²(1 − F_dr,int))`; 1 without a coat.
    pub diffuse_scale: f64,
}

/// A direction that light may have come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit direction to the light.
    pub wi: DVec3,
    /// `f · cos wi / pdf`; 0 if the path ends.
    pub weight: DVec3,
    /// Density of `wi` per solid angle; none if the mirror was chosen.
    pub pdf: Option<f64>,
}

impl Bsdf {
    /// The scattering at a hit. A lamp reflects nothing.
    pub fn at(scene: &CompiledScene, hit: &Hit) -> Self {
        let material = match hit.primitive {
            Primitive::Sphere(i) => scene.spheres[i as usize].material,
            Primitive::Box(i) => scene.boxes[i as usize].material,
            Primitive::Disc(i) => scene.discs[i as usize].material,
            Primitive::Rectangle(i) => scene.rectangles[i as usize].material,
            Primitive::Lamp(_) => return Self::black(),
        };
        let material = &scene.materials[material as usize];
        let in_stripe = if let Primitive::Sphere(i) = hit.primitive {
            let axis = vector(scene.spheres[i as usize].stripe_axis);
            hit.n.dot(axis).abs() < f64::from(material.stripe_half_width)
        } else {
            false
        };
        Self::new(material, in_stripe)
    }

    /// A material, in or out of its stripe.
    pub fn new(material: &MaterialData, in_stripe: bool) -> Self {
        let albedo = if in_stripe {
            material.stripe_albedo
        } else {
            material.albedo
        };
        Self {
            albedo: vector(albedo),
            ior: f64::from(material.ior),
            diffuse_scale: f64::from(material.diffuse_scale),
        }
    }

    fn black() -> Self {
        Self {
            albedo: DVec3::ZERO,
            ior: 0.0,
            diffuse_scale: 1.0,
        }
    }

    /// Reflectance of the coat at a cosine.
    pub fn fresnel(&self, cos: f64) -> f64 {
        if self.ior == 0.0 {
            return 0.0;
        }
        fresnel_dielectric(cos, self.ior)
    }

    /// The probability with which [`Bsdf::sample`] chooses the mirror.
    pub fn probability_mirror(&self, cos_o: f64) -> f64 {
        let mirror = self.fresnel(cos_o);
        if mirror == 0.0 {
            return 0.0;
        }
        mirror / (mirror + (1.0 - mirror) * self.albedo.element_sum() / 3.0)
    }

    /// The diffuse lobe `f` in sr⁻¹; 0 below the surface.
    pub fn eval(&self, cos_o: f64, cos_i: f64) -> DVec3 {
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return DVec3::ZERO;
        }
        let coat = (1.0 - self.fresnel(cos_o)) * (1.0 - self.fresnel(cos_i));
        self.albedo * (coat * self.diffuse_scale / PI)
    }

    /// Density per solid angle with which [`Bsdf::sample`] draws a direction of cosine `cos_i`
    /// from the diffuse lobe.
    pub fn pdf(&self, cos_o: f64, cos_i: f64) -> f64 {
        (1.0 - self.probability_mirror(cos_o)) * cos_i.max(0.0) / PI
    }

    /// Draws a direction: `u[0]` chooses the lobe, `u[1]` and `u[2]` the direction. `n` is on the
    /// side of `wo`.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        let cos_o = wo.dot(n);
        let probability_mirror = self.probability_mirror(cos_o);
        if u[0] < probability_mirror {
            return BsdfSample {
                wi: 2.0 * cos_o * n - wo,
                weight: DVec3::splat(self.fresnel(cos_o) / probability_mirror),
                pdf: None,
            };
        }
        let (radius, phi) = (u[1].sqrt(), 2.0 * PI * u[2]);
        let cos_i = (1.0 - u[1]).max(0.0).sqrt();
        let (t, b) = basis(n);
        let pdf = self.pdf(cos_o, cos_i);
        BsdfSample {
            wi: radius * phi.cos() * t + radius * phi.sin() * b + cos_i * n,
            weight: self.eval(cos_o, cos_i) * (PI / (1.0 - probability_mirror)),
            pdf: Some(pdf),
        }
    }
}

/// Two unit vectors that make a right-handed basis `(t, b, n)` with the unit vector `n`: Duff et
/// al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017. Both zeros count as positive:
/// which one a component is depends on how the normal was computed.
pub fn basis(n: DVec3) -> (DVec3, DVec3) {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        DVec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}
