//! Area lights as seen from shading points, one point per lane: the arithmetic of
//! [`crate::scalar::area_light`].

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::rows::Rows;
use super::sampling::sin_cos_turns;
use crate::compiled::AreaLightData;
use crate::sampling::BELOW_1;

/// The area lights of a scene.
pub(super) struct AreaLights {
    rows: Vec<AreaLightRow>,
    /// Whether the radiance of any light varies over its area.
    is_graded: bool,
}

type AreaLightRow = [f32; 24];

const CENTER: usize = 0;
// Unit vectors along the edges.
const AXIS_U: usize = 3;
const AXIS_V: usize = 6;
const NORMAL: usize = 9;
const RADIANCE: usize = 12;
const BRIGHTNESS: usize = 15;
// Half lengths of the edges, metres.
const LENGTH_U: usize = 16;
const LENGTH_V: usize = 17;
const GRADIENT: usize = 18;
const SLOPE: usize = 21;

/// Properties of the area light that a ray has hit.
pub(super) struct Emission<S: Simd> {
    pub(super) normal: Vec3x<S>,
    pub(super) radiance: Vec3x<S>,
    pub(super) brightness: Float<S>,
}

/// An area light drawn among all, and a direction to it.
pub(super) struct LightSample<S: Simd> {
    pub(super) index: Word<S>,
    pub(super) wi: Vec3x<S>,
    /// Distance to the point, metres; 0 where no area light is visible.
    pub(super) distance: Float<S>,
    /// Reciprocal of the density of `wi` per solid angle, sr.
    pub(super) inverse_pdf: Float<S>,
    /// Reciprocal of the density used by the power heuristic: `light_weight_sum / brightness`.
    pub(super) inverse_density: Float<S>,
    pub(super) radiance: Vec3x<S>,
    /// Sum over all area lights of brightness times solid angle.
    pub(super) light_weight_sum: Float<S>,
}

impl AreaLights {
    pub(super) fn new(area_lights: &[AreaLightData]) -> Self {
        Self {
            rows: area_lights.iter().map(row).collect(),
            is_graded: area_lights.iter().any(AreaLightData::is_graded),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    #[inline(always)]
    pub(super) fn normal<S: Simd>(&self, simd: S, index: Word<S>) -> Vec3x<S> {
        Rows::new(&self.rows, index).triple(simd, NORMAL)
    }

    /// Emission of area light `index` at `point`.
    #[inline(always)]
    pub(super) fn emission<S: Simd>(
        &self,
        simd: S,
        index: Word<S>,
        point: Vec3x<S>,
    ) -> Emission<S> {
        let rows = Rows::new(&self.rows, index);
        let mut radiance = rows.triple(simd, RADIANCE);
        if self.is_graded {
            radiance = graded(simd, &rows, point, radiance);
        }
        Emission {
            normal: rows.triple(simd, NORMAL),
            radiance,
            brightness: rows.number(simd, BRIGHTNESS),
        }
    }

    /// Draws an area light with probability proportional to brightness times solid angle, by `u[0]`, and a
    /// direction to it with `u[1]` and the rescaled remainder of `u[0]`.
    #[inline(always)]
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        point: Vec3x<S>,
        mut u: [Float<S>; 2],
    ) -> LightSample<S> {
        let zero = Float::splat(simd, 0.0);
        let mut sum = zero;
        let mut chosen: Option<LightReservoir<S>> = None;
        for (index, row) in (0..).zip(&self.rows) {
            // Weighted reservoir sampling with one random number: the next light replaces the chosen one
            // with probability weight / sum, and `u[0]` is rescaled to [0, 1) within the branch taken.
            let next = LightReservoir::new(simd, index, row, point);
            let sum_before = sum;
            sum += next.weight;
            let at = u[0] * sum;
            let seen = next.weight.simd_gt(0.0);
            let taken = seen & at.simd_ge(sum_before);
            let part = taken.select(at - sum_before, at) / taken.select(next.weight, sum_before);
            u[0] = seen.select(part.min(BELOW_1 as f32), u[0]);
            chosen = Some(match chosen {
                Some(chosen) => LightReservoir::select(taken, next, chosen),
                None => next,
            });
        }
        let chosen = chosen.expect("lanes aim at area lights where there are some");
        let at = chosen.seen.sample(simd, chosen.omega, chosen.by_area, u);
        let inverse_probability = sum / chosen.weight;
        let visible = chosen.weight.simd_gt(0.0);
        let mut radiance = chosen.radiance;
        if self.is_graded {
            let rows = Rows::new(&self.rows, chosen.index);
            radiance = graded(simd, &rows, at.wi.mul_add(at.distance, point), radiance);
        }
        LightSample {
            index: chosen.index,
            wi: at.wi,
            distance: visible.select(at.distance, zero),
            inverse_pdf: at.inverse_pdf * inverse_probability,
            inverse_density: chosen.omega * inverse_probability,
            radiance,
            light_weight_sum: sum,
        }
    }
}

/// Reservoir: the area light drawn so far.
struct LightReservoir<S: Simd> {
    index: Word<S>,
    seen: SphericalRectangle<S>,
    radiance: Vec3x<S>,
    omega: Float<S>,
    by_area: Mask<S>,
    /// Brightness times solid angle, the unnormalised selection probability.
    weight: Float<S>,
}

impl<S: Simd> LightReservoir<S> {
    #[inline(always)]
    fn new(simd: S, index: u32, row: &AreaLightRow, point: Vec3x<S>) -> Self {
        let seen = SphericalRectangle::new(simd, row, point);
        let (omega, by_area) = seen.omega(simd);
        Self {
            index: Word::splat(simd, index),
            seen,
            radiance: triple(simd, row, RADIANCE),
            omega,
            by_area,
            weight: omega * row[BRIGHTNESS],
        }
    }

    /// Blends two reservoirs by lane. Selecting on registers avoids gathering table rows lane by lane.
    #[inline(always)]
    fn select(mask: Mask<S>, a: Self, b: Self) -> Self {
        Self {
            index: mask.select(a.index, b.index),
            seen: SphericalRectangle::select(mask, a.seen, b.seen),
            radiance: Vec3x::select(mask, a.radiance, b.radiance),
            omega: mask.select(a.omega, b.omega),
            by_area: (mask & a.by_area) | (!mask & b.by_area),
            weight: mask.select(a.weight, b.weight),
        }
    }
}

#[inline(always)]
fn select_two<S: Simd>(mask: Mask<S>, a: [Float<S>; 2], b: [Float<S>; 2]) -> [Float<S>; 2] {
    [mask.select(a[0], b[0]), mask.select(a[1], b[1])]
}

#[inline(always)]
fn triple<S: Simd>(simd: S, row: &AreaLightRow, column: usize) -> Vec3x<S> {
    Vec3x::splat(simd, [row[column], row[column + 1], row[column + 2]])
}

fn row(light: &AreaLightData) -> AreaLightRow {
    let mut row = [0.0; 24];
    row[CENTER..][..3].copy_from_slice(&light.center);
    row[AXIS_U..][..3].copy_from_slice(&light.axis_u);
    row[AXIS_V..][..3].copy_from_slice(&light.axis_v);
    row[NORMAL..][..3].copy_from_slice(&light.normal);
    row[RADIANCE..][..3].copy_from_slice(&light.radiance);
    row[BRIGHTNESS] = light.brightness;
    row[LENGTH_U] = light.length_u;
    row[LENGTH_V] = light.length_v;
    row[GRADIENT..][..3].copy_from_slice(&light.gradient);
    row[SLOPE..][..3].copy_from_slice(&light.slope);
    row
}

/// Radiance at points on area lights: [`AreaLightData::radiance_at`].
#[inline(always)]
fn graded<S: Simd>(simd: S, rows: &Rows<'_, 24>, point: Vec3x<S>, radiance: Vec3x<S>) -> Vec3x<S> {
    let from_center = point - rows.triple(simd, CENTER);
    let one = Float::splat(simd, 1.0);
    let u = from_center.dot(rows.triple(simd, SLOPE)).max(-1.0).min(one);
    rows.triple(simd, GRADIENT).mul_add(u, radiance)
}

/// An area light in the frame of the shading point: [`crate::scalar::area_light::SphericalRectangle`].
struct SphericalRectangle<S: Simd> {
    axes: [Vec3x<S>; 3],
    x: [Float<S>; 2],
    y: [Float<S>; 2],
    height: Float<S>,
    area: Float<S>,
    unit: Float<S>,
    /// Distance of the centre, in units of `unit`.
    distance: Float<S>,
}

struct LightDirection<S: Simd> {
    wi: Vec3x<S>,
    distance: Float<S>,
    inverse_pdf: Float<S>,
}

impl<S: Simd> SphericalRectangle<S> {
    #[inline(always)]
    fn new(simd: S, row: &AreaLightRow, point: Vec3x<S>) -> Self {
        let axes = [
            triple(simd, row, AXIS_U),
            triple(simd, row, AXIS_V),
            triple(simd, row, NORMAL),
        ];
        let (length_u, length_v) = (row[LENGTH_U], row[LENGTH_V]);
        let to_center = triple(simd, row, CENTER) - point;
        let distance = to_center.length_squared().sqrt();
        // Lengths are normalised to `unit`, so that products of four stay in the range of f32.
        let unit = distance + (length_u + length_v);
        let per_unit = 1.0 / unit;
        let (along_u, along_v) = (to_center.dot(axes[0]), to_center.dot(axes[1]));
        Self {
            x: [
                (along_u - length_u) * per_unit,
                (along_u + length_u) * per_unit,
            ],
            y: [
                (along_v - length_v) * per_unit,
                (along_v + length_v) * per_unit,
            ],
            height: -to_center.dot(axes[2]) * per_unit,
            area: per_unit * per_unit * (4.0 * length_u * length_v),
            axes,
            unit,
            distance: distance * per_unit,
        }
    }

    #[inline(always)]
    fn select(mask: Mask<S>, a: Self, b: Self) -> Self {
        let [au, av, an] = a.axes;
        let [bu, bv, bn] = b.axes;
        Self {
            axes: [
                Vec3x::select(mask, au, bu),
                Vec3x::select(mask, av, bv),
                Vec3x::select(mask, an, bn),
            ],
            x: select_two(mask, a.x, b.x),
            y: select_two(mask, a.y, b.y),
            height: mask.select(a.height, b.height),
            area: mask.select(a.area, b.area),
            unit: mask.select(a.unit, b.unit),
            distance: mask.select(a.distance, b.distance),
        }
    }

    /// Solid angle, 0 from behind, and the lanes where it is below `SOLID_ANGLE_MIN` and estimated from
    /// area, cosine and distance: there the exact formula cancels in f32.
    #[inline(always)]
    fn omega(&self, simd: S) -> (Float<S>, Mask<S>) {
        let exact = self.solid_angle(simd);
        let distance3 = self.distance * self.distance * self.distance;
        let by_area = exact.simd_lt(AreaLightData::SOLID_ANGLE_MIN as f32);
        let estimate = self.area * self.height / distance3;
        let omega = by_area.select(estimate, exact);
        let in_front = self.height.simd_gt(0.0);
        (in_front.select(omega, Float::splat(simd, 0.0)), by_area)
    }

    /// Complex number whose argument is the solid angle of the rectangle from (0, 0) to (x, y).
    #[inline(always)]
    fn corner(&self, x: Float<S>, y: Float<S>) -> Complex<S> {
        let height2 = self.height * self.height;
        let distance = x.mul_add(x, y.mul_add(y, height2)).sqrt();
        Complex {
            re: self.height * distance,
            im: x * y,
        }
    }

    #[inline(always)]
    fn solid_angle(&self, simd: S) -> Float<S> {
        let ([x0, x1], [y0, y1]) = (self.x, self.y);
        let left = self.corner(x0, y1).times_conjugate(self.corner(x0, y0));
        let right = self.corner(x1, y1).times_conjugate(self.corner(x1, y0));
        let product = right.times_conjugate(left);
        let angle = product.argument(simd);
        // A negative argument is either a solid angle above π, or 0 with rounding error seen nearly edge
        // on.
        let is_before = x0.simd_lt(0.0) & x1.simd_gt(0.0) & y0.simd_lt(0.0) & y1.simd_gt(0.0);
        let is_above_pi = angle.simd_lt(0.0) & (is_before | product.re.simd_lt(0.0));
        is_above_pi.select(angle + TAU, angle.max(0.0))
    }

    #[inline(always)]
    fn sample(
        &self,
        simd: S,
        omega: Float<S>,
        by_area: Mask<S>,
        [u, v]: [Float<S>; 2],
    ) -> LightDirection<S> {
        let (mut x, mut y) = self.sample_solid_angle(simd, omega, u, v);
        let mut inverse_pdf = omega;
        let height2 = self.height * self.height;
        // Uniform in area where the solid angle is small, with density d² / (area · cos θ) per solid angle.
        if by_area.any_true() {
            x = by_area.select((self.x[1] - self.x[0]).mul_add(u, self.x[0]), x);
            y = by_area.select((self.y[1] - self.y[0]).mul_add(v, self.y[0]), y);
            let distance2 = x.mul_add(x, y.mul_add(y, height2));
            let area = self.area * self.height / (distance2 * distance2.sqrt());
            inverse_pdf = by_area.select(area, inverse_pdf);
        }
        let distance = x.mul_add(x, y.mul_add(y, height2)).sqrt();
        let [u_axis, v_axis, normal] = self.axes;
        let to_point = u_axis.mul_add(x, v_axis.mul_add(y, normal * -self.height));
        LightDirection {
            wi: to_point * (1.0 / distance),
            distance: distance * self.unit,
            inverse_pdf,
        }
    }

    #[inline(always)]
    fn sample_solid_angle(
        &self,
        simd: S,
        omega: Float<S>,
        u: Float<S>,
        v: Float<S>,
    ) -> (Float<S>, Float<S>) {
        // Ureña, Fajardo and King 2013 in the form derived in `crate::scalar::area_light`: `start`
        // rotated by u · omega replaces their inverse trigonometric functions.
        let ([x0, x1], [y0, y1], h2) = (self.x, self.y, self.height * self.height);
        let root_min = Float::splat(simd, ROOT_MIN);
        let start = self.corner(x0, y1).times_conjugate(self.corner(x0, y0));
        let length = start.re.mul_add(start.re, start.im * start.im).sqrt();
        let (sin, cos) = sin_cos_turns(u * omega * (1.0 / TAU));
        let cos_phi = (start.re * cos - start.im * sin) / length;
        let sin_phi = start.im.mul_add(cos, start.re * sin) / length;
        let slant2 = y0.mul_add(y0, h2);
        let b0 = -y0 / slant2.sqrt();
        let b1 = y1 / y1.mul_add(y1, h2).sqrt();
        let n = cos_phi.mul_add(b0, b1);
        let root = n.mul_add(n, -(sin_phi * sin_phi * (h2 / slant2)));
        let x = (self.height * sin_phi).copysign(sin_phi * n) / root.max(root_min).sqrt();
        let x = x.max(x0).min(x1);

        let d2 = x.mul_add(x, h2);
        let h0 = y0 / y0.mul_add(y0, d2).sqrt();
        let h1 = y1 / y1.mul_add(y1, d2).sqrt();
        // h = y / √(d² + y²) is uniform along the second edge.
        let h = (h1 - h0).mul_add(v, h0);
        let y = h * (d2 / (1.0 - h * h).max(root_min)).sqrt();
        (x, y.max(y0).min(y1))
    }
}

/// Lower bound of radicands and denominators, which are 0 / 0 on the rectangle's edge.
const ROOT_MIN: f32 = 1e-30;

/// A complex number per lane.
#[derive(Clone, Copy)]
struct Complex<S: Simd> {
    re: Float<S>,
    im: Float<S>,
}

impl<S: Simd> Complex<S> {
    /// `self · other*`.
    #[inline(always)]
    fn times_conjugate(self, other: Self) -> Self {
        Self {
            re: self.re.mul_add(other.re, self.im * other.im),
            im: self.im.mul_add(other.re, -(self.re * other.im)),
        }
    }

    /// Argument in (−π, π], within 3e-7: two range reductions, to |t| ≤ tan(π/8), and the polynomial of
    /// Moshier's Cephes library (`atanf`, 1989).
    #[inline(always)]
    fn argument(self, simd: S) -> Float<S> {
        let (re, im) = (self.re.abs(), self.im.abs());
        let (low, high) = (re.min(im), re.max(im).max(f32::MIN_POSITIVE));
        let is_steep = low.simd_gt(high * TAN_EIGHTH_TURN);
        // atan(x) = π/4 + atan((x − 1)/(x + 1)); numerator and denominator are multiplied by `high`.
        let t = is_steep.select(low - high, low) / is_steep.select(low + high, high);
        let t2 = t * t;
        let tail = t2
            .mul_add(ATAN[0], ATAN[1])
            .mul_add(t2, ATAN[2])
            .mul_add(t2, ATAN[3]);
        let base = is_steep.select(Float::splat(simd, FRAC_PI_4), Float::splat(simd, 0.0));
        let angle = (tail * t2).mul_add(t, t) + base;
        let angle = im.simd_gt(re).select(FRAC_PI_2 - angle, angle);
        let angle = self.re.simd_lt(0.0).select(PI - angle, angle);
        angle.copysign(self.im)
    }
}

/// The argument of a complex number, in (−π, π], within 3e-7.
#[inline(always)]
pub(super) fn argument<S: Simd>(simd: S, re: Float<S>, im: Float<S>) -> Float<S> {
    Complex { re, im }.argument(simd)
}

/// tan(π/8).
const TAN_EIGHTH_TURN: f32 = 0.414_213_57;

/// Coefficients of `atan(t) = t + t³ (…)` for |t| ≤ tan(π/8), highest power first.
const ATAN: [f32; 4] = [
    8.053_744_5e-2,
    -1.387_768_6e-1,
    1.997_771_1e-1,
    -3.333_295e-1,
];

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::super::lanes::LANES;
    use super::*;
    use crate::sampling::uniforms;
    use crate::scalar::area_light::sample_light;
    use crate::scene::{AreaLight, Environment};
    use crate::simd::{Level, dispatch};
    use crate::{Camera, CompiledScene, Lens, Scene};

    /// Two area lights of different shapes and orientations.
    fn area_lights() -> Vec<AreaLightData> {
        let light = |center, half_u, half_v, radiance| AreaLight {
            name: "lamp".to_owned(),
            center,
            half_u,
            half_v,
            radiance: Vec3::splat(radiance),
            ..AreaLight::new(1.0, 1.0)
        };
        let scene = Scene {
            camera: Camera {
                eye: Vec3::ZERO,
                target: Vec3::X,
                up: Vec3::Z,
                fov_x_deg: 90.0,
                lens: Lens::default(),
                near_m: 0.0,
            },
            environment: Environment {
                radiance: Vec3::ZERO,
            },
            materials: Default::default(),
            objects: Vec::new(),
            area_lights: vec![
                light(
                    Vec3::new(0.2, 0.1, 1.0),
                    Vec3::new(0.45, 0.0, 0.0),
                    Vec3::new(0.0, -0.18, 0.0),
                    17.0,
                ),
                light(
                    Vec3::new(1.5, 0.0, 0.5),
                    Vec3::new(0.0, 0.3, 0.3),
                    Vec3::new(0.0, 0.2, -0.2),
                    4.0,
                ),
            ],
            ..Scene::new()
        };
        CompiledScene::new(&scene).unwrap().area_lights
    }

    #[inline(always)]
    fn drawn<S: Simd>(
        simd: S,
        area_lights: &AreaLights,
        points: &[[f32; LANES]; 5],
    ) -> [[f32; LANES]; 6] {
        let [x, y, z, u, v] = points.map(|lane| Float::load_array(simd, lane));
        let drawn = area_lights.sample(simd, Vec3x::new(x, y, z), [u, v]);
        [
            drawn.wi.x,
            drawn.wi.y,
            drawn.wi.z,
            drawn.distance,
            drawn.inverse_pdf,
            drawn.light_weight_sum,
        ]
        .map(|column| column.to_array())
    }

    #[test]
    fn lanes_sample_lights_as_scalar() {
        let (data, area_lights) = (area_lights(), AreaLights::new(&area_lights()));
        let mut differing = 0;
        for packet in 0..1024 {
            let lane = |lane| uniforms(packet, lane, 0, 1);
            let more = |lane| uniforms(packet, lane, 1, 1);
            let points: [[f32; LANES]; 5] = std::array::from_fn(|column| {
                std::array::from_fn(|i| match column {
                    0 => 4.0 * lane(i as u32)[0] - 2.0,
                    1 => 3.0 * lane(i as u32)[1] - 1.5,
                    2 => 1.5 * lane(i as u32)[2] - 0.3,
                    column => more(i as u32)[column - 3],
                })
            });
            let got = dispatch!(Level::new(), simd => drawn(simd, &area_lights, &points));
            for lane in 0..LANES {
                let [x, y, z, u, v] = points.map(|column| f64::from(column[lane]));
                let [wx, wy, wz, distance, inverse_pdf, _] = got.map(|c| f64::from(c[lane]));
                let Some(chosen) = sample_light(&data, DVec3::new(x, y, z), [u, v]) else {
                    assert_eq!(distance, 0.0);
                    continue;
                };
                let want = chosen.seen.sample(chosen.u);
                let want_pdf = want.inverse_pdf / chosen.probability;
                let same = (want.wi - DVec3::new(wx, wy, wz)).length() < 1e-3
                    && (inverse_pdf / want_pdf - 1.0).abs() < 2e-3;
                differing += u32::from(!same);
            }
        }
        // Points so close to a threshold that rounding decides.
        assert!(differing <= 16, "{differing} of 16,384");
    }
}
