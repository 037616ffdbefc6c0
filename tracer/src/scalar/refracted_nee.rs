//! Paths from a point inside a dielectric ball to a point outside, refracted at the boundary.
//!
//! Light scattered inside would reach an area light through a smooth boundary by BSDF sampling alone.
//! Next-event estimation through a refracting surface (Walter, Zhao, Holzschuch and Bala, "Single
//! Scattering in Refractive Media with Triangle Mesh Boundaries", SIGGRAPH 2009) has to find the paths that
//! satisfy Fermat's principle. Through a sphere there may be several; of those that leave by the hemisphere
//! around the direction from the centre to the inner point there is at most one, so that all others can be
//! left to BSDF sampling exactly.
//!
//! In units of the radius, let the inner point be at `r` on an axis through the centre, and a ray leave
//! it at an angle θ ≤ 90° to that axis. It meets the boundary after `l = cos θi − r cos θ`, where
//! `sin θi = r sin θ`, not beyond the middle of its chord: `l ≤ cos θi`. When θ increases by a small
//! angle, the exit point moves by `k = l / cos θi ≤ 1` of it, and the direction outside turns by
//! `k + (1 − k) n cos θi / cos θo > 0` of it: rays that leave in a plane through the axis diverge and
//! never cross, and as they also diverge sideways, none crosses the axis. So each point outside lies on
//! at most one of them, and the side of a ray on which it lies tells in which direction to search.

use glam::{DVec2, DVec3};

use super::intersect::vector;
use crate::compiled::SphereData;

/// A refracted path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefractedPath {
    /// Point of refraction on the boundary.
    pub place: DVec3,
    /// Unit direction inside, from the inner point.
    pub inner: DVec3,
    /// Unit direction outside, away from the ball.
    pub outer: DVec3,
    /// Lengths inside and outside, metres.
    pub lengths: [f64; 2],
    /// Cosine between the normal and the segment inside, positive.
    pub cos_i: f64,
    /// Area across the path at the outer point per solid angle at the inner point, m²·sr⁻¹.
    pub spread: f64,
}

/// A ray from the inner point, in the plane of the axis (x) and the outer point; lengths in radii.
struct PlaneRay {
    place: DVec2,
    inner: DVec2,
    outer: DVec2,
    length: f64,
    cos_i: f64,
    cos_o: f64,
}

impl PlaneRay {
    /// The ray whose sine at the inner point is `sine`.
    fn new(r: f64, ior: f64, sine: f64) -> Self {
        let cosine = |sine: f64| (1.0 - sine * sine).max(0.0).sqrt();
        let inner = DVec2::new(cosine(sine), sine);
        let cos_i = cosine(r * sine);
        let cos_o = cosine(ior * r * sine);
        // cos θi − r cos θ, expanded by its conjugate: near the boundary the difference would cancel.
        let length = (1.0 - r * r).max(0.0) / (cos_i + r * inner.x);
        let place = DVec2::new(r + length * inner.x, length * sine);
        Self {
            place,
            inner,
            // Snell's law in vector form; `place` is the normal of the unit ball.
            outer: ior * inner + (cos_o - ior * cos_i) * place,
            length,
            cos_i,
            cos_o,
        }
    }

    /// Signed distance of a point from the outer ray, positive on the side of larger angles.
    fn beside(&self, point: DVec2) -> f64 {
        self.outer.perp_dot(point - self.place)
    }
}

impl RefractedPath {
    /// The path from `from`, inside the ball or on it, to `to`, outside, by the hemisphere of the boundary
    /// around the direction from the centre to `from`; `None` if there is no such path. `ior` is at least
    /// 1.
    pub fn new(sphere: &SphereData, ior: f64, from: DVec3, to: DVec3) -> Option<Self> {
        let center = vector(sphere.center);
        let radius = f64::from(sphere.radius);
        let (x, y) = ((from - center) / radius, (to - center) / radius);
        let r = x.length();
        let axis = if r > 0.0 { x / r } else { y.normalize() };
        let along = y.dot(axis);
        let across = y - along * axis;
        let side = across.try_normalize().unwrap_or(DVec3::ZERO);
        let point = DVec2::new(along, across.length());
        let ray = search(r, ior, point)?;
        let world = |v: DVec2| v.x * axis + v.y * side;
        let outside = (point - ray.place).length();
        Some(Self {
            place: center + radius * world(ray.place),
            inner: world(ray.inner),
            outer: world(ray.outer),
            lengths: [radius * ray.length, radius * outside],
            cos_i: ray.cos_i,
            spread: radius * radius * spread(&ray, ior, outside),
        })
    }
}

/// Root search for the ray through a point outside, by the Illinois method (Dowell and Jarratt, "A modified
/// regula falsi method", BIT 11, 1971).
fn search(r: f64, ior: f64, point: DVec2) -> Option<PlaneRay> {
    // Steeper rays are totally reflected, or leave by the other hemisphere.
    let sine_max = (1.0 / (ior * r)).min(1.0);
    let highest = highest(r, point);
    let (mut low, mut high) = (lowest(r, point)?, highest.min(sine_max));
    if low >= high {
        return None;
    }
    let beside = |sine: f64| PlaneRay::new(r, ior, sine).beside(point);
    let (mut at_low, mut at_high) = (beside(low), beside(high));
    if at_low < 0.0 || (at_high > 0.0 && highest > sine_max) {
        return None;
    }
    at_high = at_high.min(0.0);
    let mut sine = low;
    let mut moved_low = None;
    for _ in 0..SphereData::REFRACTED_NEE_STEPS {
        let part = at_low / (at_low - at_high).max(f64::MIN_POSITIVE);
        sine = low + part * (high - low);
        let at = beside(sine);
        let moves_low = at > 0.0;
        // The value of an end that is kept twice is halved; otherwise the secant would approach the root
        // from one side only, and slowly.
        let is_repeated = moved_low.replace(moves_low) == Some(moves_low);
        if moves_low {
            (low, at_low) = (sine, at);
            at_high *= if is_repeated { 0.5 } else { 1.0 };
        } else {
            (high, at_high) = (sine, at);
            at_low *= if is_repeated { 0.5 } else { 1.0 };
        }
    }
    Some(PlaneRay::new(r, ior, sine))
}

/// Sine of the first ray whose exit point is visible from the point: 0 if the boundary on the axis is
/// visible, else that of the point of tangency. `None` if that is on the other hemisphere.
fn lowest(r: f64, point: DVec2) -> Option<f64> {
    if point.x >= 1.0 {
        return Some(0.0);
    }
    let cos = 1.0 / point.length();
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    let tangent = DVec2::new(cos, -sin).rotate(point) * cos;
    let offset = tangent - DVec2::new(r, 0.0);
    (offset.x > 0.0).then(|| offset.y / offset.length())
}

/// Sine of the ray to the boundary point nearest to the point, an upper bound: rays beyond would
/// have to turn back. Above 1 if that is on the other hemisphere.
fn highest(r: f64, point: DVec2) -> f64 {
    let offset = point.normalize() - DVec2::new(r, 0.0);
    if offset.x > 0.0 {
        offset.y / offset.length()
    } else {
        2.0
    }
}

/// Spread of a ray: extents in its plane and sideways, per angle at the inner point (Coddington's
/// equations).
fn spread(ray: &PlaneRay, ior: f64, outside: f64) -> f64 {
    let moved = ray.length / ray.cos_i;
    // Per angle at the inner point: the exit point moves by `moved`, and the direction outside turns by
    // moved + bent (1 − moved), as derived above.
    let bent = ior * ray.cos_i / ray.cos_o.max(f64::MIN_POSITIVE);
    let in_plane = moved * ray.cos_o + outside * (moved + bent * (1.0 - moved));
    // Sagittal equation: the surface of unit radius has the power n cos θi − cos θo.
    let power = ior * ray.cos_i - ray.cos_o;
    let sideways = ray.length + outside * (ior - power * ray.length);
    in_plane * sideways
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::fresnel::fresnel_dielectric;
    use crate::sampling::uniforms;
    use crate::scalar::medium::uniform_direction;

    const CASES: u32 = 20_000;

    fn ball() -> SphereData {
        SphereData {
            center: [0.3, -0.2, 0.1],
            radius: 0.028_575,
            ..SphereData::zeroed()
        }
    }

    /// A point inside, as likely near the boundary and the centre as elsewhere, and an index.
    fn inside(i: u32) -> (DVec3, f64) {
        let [a, b, c, d] = uniforms(i, 1, 2, 3).map(f64::from);
        let r = match i % 3 {
            0 => a.cbrt(),
            1 => 1.0 - 10f64.powf(-1.0 - 6.0 * a),
            _ => 10f64.powf(-1.0 - 6.0 * a),
        };
        let sphere = ball();
        let center = vector(sphere.center);
        let point = center + f64::from(sphere.radius) * r * uniform_direction(b, c);
        (point, [1.0, 1.0001, 1.33, 1.5, 2.4][(d * 5.0) as usize])
    }

    /// Exit point of a ray from inside and its direction outside, if it is not totally reflected, and
    /// whether it leaves by the hemisphere towards which it began.
    fn leave(from: DVec3, direction: DVec3, ior: f64) -> (DVec3, Option<DVec3>, bool) {
        let sphere = ball();
        let (center, radius) = (vector(sphere.center), f64::from(sphere.radius));
        let x = from - center;
        let along = x.dot(direction);
        let length = (radius * radius - x.length_squared() + along * along).sqrt() - along;
        let place = from + length * direction;
        let n = (place - center) / radius;
        let cos_i = direction.dot(n);
        let passes = fresnel_dielectric(cos_i, 1.0 / ior) < 1.0;
        let cos_o = (1.0 - ior * ior * (1.0 - cos_i * cos_i)).max(0.0).sqrt();
        let outer = ior * direction + (cos_o - ior * cos_i) * n;
        (place, passes.then_some(outer), along >= 0.0)
    }

    #[test]
    fn every_ray_out_of_the_near_half_is_found_again() {
        let mut found = 0;
        for i in 0..CASES {
            let (from, ior) = inside(i);
            let [a, b, c, _] = uniforms(i, 4, 5, 6).map(f64::from);
            let direction = uniform_direction(a, b);
            let (place, Some(outer), is_near) = leave(from, direction, ior) else {
                continue;
            };
            let distance = 10f64.powf(-3.0 + 5.0 * c);
            let to = place + distance * outer;
            let refracted = RefractedPath::new(&ball(), ior, from, to);
            if !is_near {
                // Another path may lead there, but not this one.
                assert!(
                    refracted.is_none_or(|refracted| refracted.inner.dot(direction) < 1.0 - 1e-12)
                );
                continue;
            }
            let Some(refracted) = refracted else {
                // At the limit of existence of a path rounding decides.
                let axis = (from - vector(ball().center)).normalize();
                let cos_o = outer.dot(place - vector(ball().center)) / f64::from(ball().radius);
                let edge = direction.dot(axis).min(cos_o);
                assert!(edge < 1e-6, "{i}: {edge}, index {ior}, {distance} m");
                continue;
            };
            found += 1;
            let off = (refracted.place + refracted.lengths[1] * refracted.outer - to).length();
            assert!(
                off < 1e-4 * (distance + 0.1),
                "{i}: off by {off} of {distance}"
            );
            assert!((refracted.inner - direction).length() < 1e-3, "{i}");
            let normal = (refracted.place - vector(ball().center)).normalize();
            assert!(
                (refracted.cos_i - refracted.inner.dot(normal)).abs() < 1e-6,
                "{i}"
            );
            assert!((refracted.outer.length() - 1.0).abs() < 1e-9, "{i}");
        }
        assert!(found > CASES / 4, "{found}");
    }

    /// Estimate of the spread by three adjacent rays.
    #[test]
    fn spread_equals_that_of_neighbouring_rays() {
        const APART: f64 = 1e-6;
        for i in 0..CASES {
            let (from, ior) = inside(i);
            let [a, b, c, _] = uniforms(i, 7, 8, 9).map(f64::from);
            let direction = uniform_direction(a, b);
            let distance = 10f64.powf(-2.0 + 3.0 * c);
            let (place, Some(outer), true) = leave(from, direction, ior) else {
                continue;
            };
            let n = (place - vector(ball().center)).normalize();
            let to = place + distance * outer;
            if outer.dot(n) < 0.1 {
                continue; // neighbours may be reflected
            }
            let Some(refracted) = RefractedPath::new(&ball(), ior, from, to) else {
                continue;
            };
            let (t, b) = crate::scalar::basis::basis(direction);
            let moved = [t, b].map(|side| {
                let (place, outer, _) = leave(from, (direction + APART * side).normalize(), ior);
                let outer = outer.expect("not near the angle of total reflection");
                // Where the adjacent ray passes the plane orthogonal to the ray at its end.
                let end = place
                    + outer * ((to - place).dot(refracted.outer) / outer.dot(refracted.outer));
                (end - to) / APART
            });
            let area = moved[0].cross(moved[1]).length();
            assert!(
                (area / refracted.spread - 1.0).abs() < 2e-3,
                "{i}: {area} {}",
                refracted.spread
            );
        }
    }
}
