//! Projection of world points to a camera's film, and back.

use carom_tracer::Camera;
use carom_tracer::compiled::CameraBasis;
use glam::{DVec2, DVec3};

/// Perspective projection from the world to a camera's film, for overlays: the inverse of
/// [`carom_tracer::compiled::camera_frame`].
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    basis: CameraBasis,
    film: DVec2,
    focal: f64,
}

impl Projection {
    /// The projection of a camera to a film of `width` × `height` in any unit; film positions are in that
    /// unit, from the top left.
    pub fn new(camera: &Camera, width: f64, height: f64) -> Self {
        let basis = CameraBasis::new(camera);
        Self {
            basis,
            film: DVec2::new(width, height),
            focal: 0.5 * width / basis.half_width,
        }
    }

    /// Film position of `p`; none if it is behind the eye or within `NEAR_M` of its plane.
    pub fn film_from_world(&self, p: DVec3) -> Option<DVec2> {
        let view = p - self.basis.eye;
        let depth = view.dot(self.basis.forward);
        (depth > NEAR_M).then(|| {
            let offset = DVec2::new(view.dot(self.basis.right), -view.dot(self.basis.up));
            0.5 * self.film + offset * (self.focal / depth)
        })
    }

    /// Film positions of the ends of the segment from `a` to `b`, clipped in front of the eye; none if
    /// nothing is left.
    pub fn film_segment(&self, a: DVec3, b: DVec3) -> Option<[DVec2; 2]> {
        let depth = |p: DVec3| (p - self.basis.eye).dot(self.basis.forward);
        let (depth_a, depth_b) = (depth(a), depth(b));
        // Twice the near distance of `film_from_world`, so that rounding cannot reject a clipped end.
        let near = 2.0 * NEAR_M;
        if depth_a <= near && depth_b <= near {
            return None;
        }
        let cut = |from: DVec3, from_depth: f64, to: DVec3, to_depth: f64| {
            if from_depth > near {
                return from;
            }
            from + (to - from) * ((near - from_depth) / (to_depth - from_depth))
        };
        let (p, q) = (cut(a, depth_a, b, depth_b), cut(b, depth_b, a, depth_a));
        Some([self.film_from_world(p)?, self.film_from_world(q)?])
    }

    /// Length on the film of one metre at `p` perpendicular to the view; none if `p` is too close or behind.
    pub fn film_per_metre(&self, p: DVec3) -> Option<f64> {
        let depth = (p - self.basis.eye).dot(self.basis.forward);
        (depth > NEAR_M).then(|| self.focal / depth)
    }

    /// Whether a sphere hides a point, being in front of it or containing it.
    pub fn is_hidden(&self, p: DVec3, center: DVec3, radius_m: f64) -> bool {
        let way = p - self.basis.eye;
        // The point of the line of sight that is nearest to the sphere's centre, not beyond `p`.
        let along = (center - self.basis.eye).dot(way) / way.length_squared();
        let nearest = self.basis.eye + way * along.min(1.0);
        along > 0.0 && nearest.distance_squared(center) < radius_m * radius_m
    }

    /// The point at height `z` metres that projects to `film`; none if the line of sight does not meet that
    /// height.
    pub fn world_from_film(&self, film: DVec2, z: f64) -> Option<DVec3> {
        let offset = (film - 0.5 * self.film) / self.focal;
        let direction = self.basis.forward + self.basis.right * offset.x - self.basis.up * offset.y;
        let distance = (z - self.basis.eye.z) / direction.z;
        (direction.z != 0.0 && distance > 0.0).then(|| self.basis.eye + direction * distance)
    }
}

const NEAR_M: f64 = 0.01;

#[cfg(test)]
mod tests {
    use carom_tracer::ImageSize;
    use carom_tracer::compiled::camera_frame;
    use glam::Vec3;

    use super::super::viewpoint::tests::view;
    use super::*;

    #[test]
    fn a_point_is_projected_where_the_tracer_sees_it() {
        let (camera, size) = (view().camera(), ImageSize::new(640, 360));
        let (frame, projection) = (
            camera_frame(&camera, size),
            Projection::new(&camera, 640.0, 360.0),
        );
        let vec = |v: [f32; 3]| Vec3::from_array(v).as_dvec3();
        for (x, y, t) in [
            (0.5, 0.5, 1.0),
            (320.0, 180.0, 2.0),
            (639.0, 12.25, 0.3),
            (17.0, 355.0, 7.0),
        ] {
            let direction = vec(frame.corner) + vec(frame.dx) * x + vec(frame.dy) * y;
            let film = projection
                .film_from_world(vec(frame.eye) + direction * t)
                .unwrap();
            // The tracer's camera is rounded to f32: 1e-7 of 640 pixels, a few times over.
            assert!(
                film.distance(DVec2::new(x, y)) < 2e-3,
                "{film} for {x}, {y}"
            );
        }
    }

    #[test]
    fn a_sphere_hides_what_is_behind_and_in_it() {
        let projection = Projection::new(&view().camera(), 640.0, 360.0);
        let at = |distance_m: f64, aside_m: f64| {
            let basis = &projection.basis;
            basis.eye + distance_m * basis.forward + aside_m * basis.right
        };
        let center = at(2.0, 0.0);
        for (p, hidden) in [
            (at(1.0, 0.0), false),
            (at(1.95, 0.0), true),
            (at(3.0, 0.0), true),
            (at(3.0, 0.14), true),
            (at(3.0, 0.16), false),
            (at(-3.0, 0.0), false),
        ] {
            assert_eq!(projection.is_hidden(p, center, 0.1), hidden, "{p}");
        }
    }

    #[test]
    fn the_cloth_under_a_film_position_is_seen_there() {
        let projection = Projection::new(&view().camera(), 1280.0, 720.0);
        let film = DVec2::new(200.0, 650.0);
        let p = projection.world_from_film(film, 0.0).unwrap();
        assert!(p.z.abs() < 1e-12);
        assert!(projection.film_from_world(p).unwrap().distance(film) < 1e-6);
        assert!(
            projection
                .world_from_film(DVec2::new(640.0, -2000.0), 0.0)
                .is_none()
        );
    }

    #[test]
    fn a_segment_through_the_eye_is_cut_off_before_it() {
        let projection = Projection::new(&view().camera(), 1280.0, 720.0);
        let eye = view().camera().eye.as_dvec3();
        let ahead = view().focus;
        let [p, q] = projection.film_segment(ahead, eye - (ahead - eye)).unwrap();
        assert!(p.is_finite() && q.is_finite());
        let behind = eye - (ahead - eye);
        assert!(projection.film_segment(behind, behind * 1.1).is_none());
    }
}
