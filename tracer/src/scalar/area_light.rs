//! Area lights as a point sees them, and how one of them and a direction to it are drawn.

use glam::{DVec2, DVec3};

use super::intersect::vector;
use crate::compiled::AreaLightData;
use crate::sampling::BELOW_1;

/// An area light's rectangle in a frame along its edges and its normal whose origin is the point that
/// sees it. The unit of length is about the area light's distance or its size, whichever is larger, so
/// that no product leaves the range of f32, in which the other tracers compute the same.
#[derive(Clone, Copy, Debug)]
pub struct SphericalRectangle {
    axes: [DVec3; 3],
    /// Low and high end along the first edge.
    x: [f64; 2],
    /// Low and high end along the second edge.
    y: [f64; 2],
    /// Of the point above the area light's plane, on the side that shines.
    height: f64,
    /// Of the unit of length, metres.
    unit: f64,
    /// Solid angle, sr, or what it would be if all of the area light were as far away as its centre.
    omega: f64,
    /// Area, in square units.
    area: f64,
    by_area: bool,
}

/// A point of an area light, as the direction to it.
#[derive(Clone, Copy, Debug)]
pub struct LightDirection {
    /// Unit direction from the point that sees the area light.
    pub wi: DVec3,
    /// Distance, metres.
    pub distance: f64,
    /// Inverse density of `wi` per solid angle.
    pub inverse_pdf: f64,
}

/// An area light that was drawn among all.
#[derive(Clone, Copy, Debug)]
pub struct SampledLight {
    /// Index into the scene's area lights.
    pub index: usize,
    /// How it is seen.
    pub seen: SphericalRectangle,
    /// Probability with which it was drawn.
    pub probability: f64,
    /// What is left of the random numbers: uniform again.
    pub u: [f64; 2],
}

/// The sum over all area lights of brightness times solid angle: a direction to an area light is drawn with
/// density `brightness / sum`.
pub fn light_weight_sum(area_lights: &[AreaLightData], point: DVec3) -> f64 {
    area_lights
        .iter()
        .map(|light| SphericalRectangle::new(light, point).weight(light))
        .sum()
}

/// Draws an area light by brightness times solid angle with `u[0]`; none if `point` sees none that shines.
/// One pass over the area lights: each takes the place of the one chosen so far with the probability that
/// it has among those up to it, by the upper end of `u[0]`, so that area lights keep their order: for two
/// that lie side by side the other order costs a third more error.
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
    /// The area light seen from `point`.
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

    fn weight(&self, light: &AreaLightData) -> f64 {
        f64::from(light.brightness) * self.omega
    }

    /// A complex number whose argument is the solid angle of the rectangle from (0, 0) to the
    /// corner `(x, y)`: `atan(x y / (height · distance))`.
    fn corner(&self, x: f64, y: f64) -> DVec2 {
        let distance = (x * x + y * y + self.height * self.height).sqrt();
        DVec2::new(self.height * distance, x * y)
    }

    /// The argument of a product: one arc tangent instead of four.
    fn solid_angle(&self) -> f64 {
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        let left = conjugate_product(self.corner(x0, y1), self.corner(x0, y0));
        let right = conjugate_product(self.corner(x1, y1), self.corner(x1, y0));
        let product = conjugate_product(right, left);
        let angle = product.y.atan2(product.x);
        // Below 0 it is either above π or, for an area light nearly edge on, 0 and rounding. The latter is
        // the case where the point does not lie before the rectangle.
        let is_before = x0 < 0.0 && x1 > 0.0 && y0 < 0.0 && y1 > 0.0;
        if angle < 0.0 && (is_before || product.x < 0.0) {
            angle + std::f64::consts::TAU
        } else {
            angle.max(0.0)
        }
    }

    /// Draws a direction, uniformly over the solid angle.
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

    /// Ureña, Fajardo and King, "An Area-Preserving Parametrization for Spherical Rectangles",
    /// EGSR 2013, without inverse functions: the angle `φ` that they call `aᵤ − π` turns a complex
    /// number, and the fractions are brought to a form that does not divide by its sine.
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

        let d2 = x * x + h2;
        let (h0, h1) = (y0 / (d2 + y0 * y0).sqrt(), y1 / (d2 + y1 * y1).sqrt());
        let h = h0 + v * (h1 - h0);
        let y = h * (d2 / (1.0 - h * h).max(ROOT_MIN)).sqrt();
        (x, y.clamp(y0, y1))
    }
}

/// What is under a root counts at least as this much: 0 / 0 on the rectangle's edge.
const ROOT_MIN: f64 = 1e-30;

/// `a · b*` of complex numbers.
fn conjugate_product(a: DVec2, b: DVec2) -> DVec2 {
    DVec2::new(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y)
}
