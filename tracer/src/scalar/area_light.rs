//! Area lights as seen from a shading point, and light sampling by solid angle.

use glam::{DVec2, DVec3};

use super::intersect::vector;
use crate::compiled::AreaLightData;
use crate::sampling::BELOW_1;

/// Rectangle of an area light in a frame along its edges and its normal with the shading point as origin.
/// Lengths are in units of its distance plus half its edges, so that no product leaves the range of f32, in
/// which the other tracers compute the same.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle {
    axes: [DVec3; 3],
    /// Low and high end along the first edge, in units.
    x: [f64; 2],
    /// Low and high end along the second edge, in units.
    y: [f64; 2],
    /// Height of the shading point above the light's plane, positive on the emitting side, in units.
    height: f64,
    /// Unit of length, metres.
    unit: f64,
    /// Solid angle, sr, 0 from behind; if `by_area`, estimated by the distance and cosine of the centre.
    omega: f64,
    /// Area, in units squared.
    area: f64,
    /// Whether points are sampled by area, because the solid angle is small.
    by_area: bool,
}

/// A sampled point of an area light, as the direction to it.
#[derive(Clone, Copy, Debug)]
pub struct LightDirection {
    /// Unit direction from the shading point.
    pub wi: DVec3,
    /// Distance, metres.
    pub distance: f64,
    /// Reciprocal of the density of `wi` per solid angle, sr.
    pub inverse_pdf: f64,
}

/// An area light drawn among all.
#[derive(Clone, Copy, Debug)]
pub struct SampledLight {
    /// Index into the scene's area lights.
    pub index: usize,
    /// The light as seen from the shading point.
    pub seen: SphericalRectangle,
    /// Probability with which it was drawn.
    pub probability: f64,
    /// Remainder of the random numbers, uniform in [0, 1).
    pub u: [f64; 2],
}

/// Sum over all area lights of brightness times solid angle: the density of a direction to an area light is
/// `brightness / sum`.
pub fn light_weight_sum(area_lights: &[AreaLightData], point: DVec3) -> f64 {
    area_lights
        .iter()
        .map(|light| SphericalRectangle::new(light, point).weight(light))
        .sum()
}

/// Draws an area light in proportion to brightness times solid angle with `u[0]`; `None` if no emitting
/// side faces `point`. Weighted reservoir sampling in one pass: each light replaces the chosen one with
/// probability weight / (sum up to it), for the upper end of `u[0]`, so that the lights keep their order in
/// `u[0]`: for two adjacent lights the reverse order costs a third more error.
pub fn sample_light(
    area_lights: &[AreaLightData],
    point: DVec3,
    mut u: [f64; 2],
) -> Option<SampledLight> {
    let mut sum = 0.0;
    let mut chosen: Option<(usize, SphericalRectangle, f64)> = None;
    for (index, light) in area_lights.iter().enumerate() {
        let seen = SphericalRectangle::new(light, point);
        let weight = seen.weight(light);
        // Probability of keeping the light chosen before.
        let kept = if sum + weight > 0.0 {
            sum / (sum + weight)
        } else {
            1.0
        };
        sum += weight;
        if u[0] >= kept {
            u[0] = (u[0] - kept) * sum / weight;
            chosen = Some((index, seen, weight));
        } else {
            u[0] /= kept;
        }
        u[0] = u[0].min(BELOW_1);
    }
    chosen.map(|(index, seen, weight)| SampledLight {
        index,
        seen,
        probability: weight / sum,
        u,
    })
}

impl SphericalRectangle {
    /// The area light as seen from `point`.
    pub fn new(light: &AreaLightData, point: DVec3) -> Self {
        let lengths = DVec2::new(f64::from(light.length_u), f64::from(light.length_v));
        let axes = [light.axis_u, light.axis_v, light.normal].map(vector);
        let to_center = vector(light.center) - point;
        let distance = to_center.length();
        let unit = distance + lengths.x + lengths.y;
        let along = axes.map(|axis| to_center.dot(axis) / unit);
        let half = lengths / unit;
        let mut seen = Self {
            axes,
            x: [along[0] - half.x, along[0] + half.x],
            y: [along[1] - half.y, along[1] + half.y],
            height: -along[2],
            unit,
            omega: 0.0,
            area: 4.0 * half.x * half.y,
            by_area: false,
        };
        if seen.height > 0.0 {
            seen.omega = seen.solid_angle();
            seen.by_area = seen.omega < AreaLightData::SOLID_ANGLE_MIN;
            if seen.by_area {
                seen.omega = seen.area * seen.height / (distance / unit).powi(3);
            }
        }
        seen
    }

    /// Unnormalised probability of drawing it.
    fn weight(&self, light: &AreaLightData) -> f64 {
        f64::from(light.brightness) * self.omega
    }

    /// Complex number whose argument is the solid angle of the rectangle from (0, 0) to the
    /// corner `(x, y)`: `atan(x y / (height · distance))`.
    fn corner(&self, x: f64, y: f64) -> DVec2 {
        let distance = (x * x + y * y + self.height * self.height).sqrt();
        DVec2::new(self.height * distance, x * y)
    }

    /// Solid angle: the signed sum over the corners, as the argument of a product, with one arc tangent
    /// instead of four.
    fn solid_angle(&self) -> f64 {
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        let left = conjugate_product(self.corner(x0, y1), self.corner(x0, y0));
        let right = conjugate_product(self.corner(x1, y1), self.corner(x1, y0));
        let product = conjugate_product(right, left);
        let angle = product.y.atan2(product.x);
        // A negative argument is either a solid angle above π, or 0 with rounding error for a light nearly
        // edge on. In the latter case the projection of the point lies outside the rectangle.
        let is_before = x0 < 0.0 && x1 > 0.0 && y0 < 0.0 && y1 > 0.0;
        if angle < 0.0 && (is_before || product.x < 0.0) {
            angle + std::f64::consts::TAU
        } else {
            angle.max(0.0)
        }
    }

    /// Draws a direction uniformly over the solid angle, or a point uniformly by area if that is small.
    pub fn sample(&self, [u, v]: [f64; 2]) -> LightDirection {
        let (x, y) = if self.by_area {
            let at = |[low, high]: [f64; 2], u: f64| low + u * (high - low);
            (at(self.x, u), at(self.y, v))
        } else {
            self.sample_solid_angle(u, v)
        };
        let to_point = x * self.axes[0] + y * self.axes[1] - self.height * self.axes[2];
        let distance = (x * x + y * y + self.height * self.height).sqrt();
        LightDirection {
            wi: to_point / distance,
            distance: distance * self.unit,
            inverse_pdf: if self.by_area {
                self.area * self.height / distance.powi(3)
            } else {
                self.omega
            },
        }
    }

    /// Ureña, Fajardo and King, "An Area-Preserving Parametrization for Spherical Rectangles", EGSR 2013,
    /// without inverse trigonometric functions: the angle `φ`, which they call `aᵤ − π`, rotates a complex
    /// number, and the fractions are rearranged so that none divides by its sine.
    fn sample_solid_angle(&self, u: f64, v: f64) -> (f64, f64) {
        let ([x0, x1], [y0, y1], h2) = (self.x, self.y, self.height * self.height);
        let start = conjugate_product(self.corner(x0, y1), self.corner(x0, y0));
        let turned = DVec2::from_angle(u * self.omega).rotate(start) / start.length();
        let b0 = -y0 / (h2 + y0 * y0).sqrt();
        let b1 = y1 / (h2 + y1 * y1).sqrt();
        let c2 = h2 / (h2 + y0 * y0);
        let n = turned.x * b0 + b1;
        let root = (n * n - turned.y * turned.y * c2).max(ROOT_MIN).sqrt();
        let x = (self.height * turned.y).copysign(turned.y * n) / root;
        let x = x.clamp(x0, x1);

        // The height h = y / √(d² + y²) is uniform along the second edge, as by Archimedes' theorem on the
        // sphere.
        let d2 = x * x + h2;
        let (h0, h1) = (y0 / (d2 + y0 * y0).sqrt(), y1 / (d2 + y1 * y1).sqrt());
        let h = h0 + v * (h1 - h0);
        let y = h * (d2 / (1.0 - h * h).max(ROOT_MIN)).sqrt();
        (x, y.clamp(y0, y1))
    }
}

/// Lower bound of radicands and denominators, which are 0 / 0 on the rectangle's edge.
const ROOT_MIN: f64 = 1e-30;

/// `a · conj(b)` of complex numbers.
fn conjugate_product(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y)
}
