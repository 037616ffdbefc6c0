//! Where the picture is taken from, and where a point of the table lands in it.

use carom_tracer::Camera;
use glam::{DVec2, DVec3, Vec3};

/// Full horizontal field of view of every view, in degrees.
pub const FOV_X_DEG: f64 = 44.0;
/// The eye stays below the lamps, whose plane is 1 m above the cloth.
pub const EYE_Z_M_MAX: f64 = 0.95;
/// The eye stays above the rails and the balls.
pub const EYE_Z_M_MIN: f64 = 0.12;

/// A camera's map from the world to its film, for overlays: the inverse of
/// [`carom_tracer::compiled::camera_frame`].
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    eye: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    film: DVec2,
    focal: f64,
}

impl Projection {
    /// The film is `width` × `height` in any unit; film positions come out in that unit, from the
    /// top left.
    pub fn new(camera: &Camera, width: f64, height: f64) -> Self {
        let eye = camera.eye.as_dvec3();
        let forward = (camera.target.as_dvec3() - eye).normalize();
        let right = forward.cross(camera.up.as_dvec3()).normalize();
        let half_angle = f64::from(camera.fov_x_deg).to_radians() * 0.5;
        Self {
            eye,
            right,
            up: right.cross(forward),
            forward,
            film: DVec2::new(width, height),
            focal: 0.5 * width / half_angle.tan(),
        }
    }

    /// Where `p` is seen; nothing if it lies behind the eye or too close to it.
    pub fn film_from_world(&self, p: DVec3) -> Option<DVec2> {
        let view = p - self.eye;
        let depth = view.dot(self.forward);
        (depth > NEAR_M).then(|| {
            let offset = DVec2::new(view.dot(self.right), -view.dot(self.up));
            0.5 * self.film + offset * (self.focal / depth)
        })
    }

    /// Where the segment from `a` to `b` is seen, cut off just before the eye.
    pub fn film_segment(&self, a: DVec3, b: DVec3) -> Option<[DVec2; 2]> {
        let depth = |p: DVec3| (p - self.eye).dot(self.forward);
        let (depth_a, depth_b) = (depth(a), depth(b));
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

    /// How long one metre at `p`, across the view, is on the film.
    pub fn film_per_metre(&self, p: DVec3) -> Option<f64> {
        let depth = (p - self.eye).dot(self.forward);
        (depth > NEAR_M).then(|| self.focal / depth)
    }

    /// The point at height `z` metres that is seen at `film`; nothing above the horizon.
    pub fn world_from_film(&self, film: DVec2, z: f64) -> Option<DVec3> {
        let offset = (film - 0.5 * self.film) / self.focal;
        let direction = self.forward + self.right * offset.x - self.up * offset.y;
        let distance = (z - self.eye.z) / direction.z;
        (direction.z != 0.0 && distance > 0.0).then(|| self.eye + direction * distance)
    }
}

/// A view as people think of it: what is looked at, from which side, how steeply and how far off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The point at the picture's centre, metres.
    pub focus: DVec3,
    /// Compass direction of the view, radians from +x towards +y.
    pub bearing_rad: f64,
    /// Downward angle of the view, radians.
    pub pitch_rad: f64,
    /// From the eye to the focus, metres.
    pub distance_m: f64,
}

impl Viewpoint {
    /// The view over the cue ball along the aim.
    pub fn behind(cue_ball: DVec3, bearing_rad: f64) -> Self {
        let ahead = DVec3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0) * AIM_AHEAD_M;
        Self {
            focus: DVec3::new(cue_ball.x, cue_ball.y, 0.0) + ahead,
            bearing_rad,
            pitch_rad: AIM_PITCH_RAD,
            distance_m: AIM_DISTANCE_M,
        }
    }

    /// The whole table, seen along `bearing_rad`: from farther off where the table is wider.
    pub fn overview(bearing_rad: f64) -> Self {
        let distance_m = 3.4 + 0.8 * bearing_rad.sin().abs();
        Self {
            focus: DVec3::ZERO,
            bearing_rad,
            pitch_rad: (EYE_Z_M_MAX / distance_m).asin(),
            distance_m,
        }
    }

    /// This view, orbited and zoomed by the player; the eye stays between the rails and the lamps.
    #[must_use]
    pub fn adjusted(self, by: Orbit) -> Self {
        let distance_m = (self.distance_m * by.zoom).clamp(0.5, 4.5);
        let pitch = |z: f64| (z / distance_m).clamp(-1.0, 1.0).asin();
        Self {
            bearing_rad: self.bearing_rad + by.yaw_rad,
            pitch_rad: (self.pitch_rad + by.pitch_rad)
                .clamp(pitch(EYE_Z_M_MIN), pitch(EYE_Z_M_MAX).min(PITCH_RAD_MAX)),
            distance_m,
            ..self
        }
    }

    /// The view a share `s` in [0, 1] of the way to `to`, turning the shorter way round.
    #[must_use]
    pub fn lerp(self, to: Self, s: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * s;
        Self {
            focus: self.focus.lerp(to.focus, s),
            bearing_rad: self.bearing_rad + wrap_rad(to.bearing_rad - self.bearing_rad) * s,
            pitch_rad: mix(self.pitch_rad, to.pitch_rad),
            distance_m: mix(self.distance_m, to.distance_m),
        }
    }

    /// The tracer's camera of this view.
    pub fn camera(self) -> Camera {
        let (sin, cos) = self.pitch_rad.sin_cos();
        let level = DVec3::new(self.bearing_rad.cos(), self.bearing_rad.sin(), 0.0);
        let eye = self.focus - level * (cos * self.distance_m) + DVec3::Z * (sin * self.distance_m);
        Camera {
            eye: eye.as_vec3(),
            target: self.focus.as_vec3(),
            up: Vec3::Z,
            fov_x_deg: FOV_X_DEG as f32,
        }
    }

    fn is_close_to(self, other: Self) -> bool {
        self.focus.distance(other.focus) < 2e-4
            && wrap_rad(self.bearing_rad - other.bearing_rad).abs() < 2e-4
            && (self.pitch_rad - other.pitch_rad).abs() < 2e-4
            && (self.distance_m - other.distance_m).abs() < 2e-4
    }
}

/// What the player has turned and zoomed away from a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Added to the bearing, radians.
    pub yaw_rad: f64,
    /// Added to the pitch, radians.
    pub pitch_rad: f64,
    /// Factor on the distance.
    pub zoom: f64,
}

impl Default for Orbit {
    fn default() -> Self {
        Self {
            yaw_rad: 0.0,
            pitch_rad: 0.0,
            zoom: 1.0,
        }
    }
}

/// A camera that glides to where it is wanted and then rests exactly there, so that a still
/// picture can be told from a moving one.
#[derive(Clone, Copy, Debug)]
pub struct Dolly {
    at: Viewpoint,
}

impl Dolly {
    /// Starts at rest.
    pub fn new(at: Viewpoint) -> Self {
        Self { at }
    }

    /// Glides towards `wanted` for `dt_secs`, covering 63 % of what is left in `TIME_SECS`: the
    /// same way whatever the display's rate.
    pub fn follow(&mut self, wanted: Viewpoint, dt_secs: f64) {
        self.at = self
            .at
            .lerp(wanted, 1.0 - (-dt_secs.max(0.0) / TIME_SECS).exp());
        if self.at.is_close_to(wanted) {
            self.at = wanted;
        }
    }

    /// The view now.
    pub fn viewpoint(&self) -> Viewpoint {
        self.at
    }
}

/// An angle's equal in (−π, π].
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turns = (angle_rad / std::f64::consts::TAU).round();
    angle_rad - turns * std::f64::consts::TAU
}

/// From 0 to 1 with rest at both ends.
pub fn smoothstep(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

const NEAR_M: f64 = 0.01;
const AIM_AHEAD_M: f64 = 0.5;
const AIM_PITCH_RAD: f64 = 0.3;
const AIM_DISTANCE_M: f64 = 1.75;
const PITCH_RAD_MAX: f64 = 1.4;
const TIME_SECS: f64 = 0.12;

#[cfg(test)]
mod tests {
    use carom_tracer::ImageSize;
    use carom_tracer::compiled::camera_frame;

    use super::*;

    fn view() -> Viewpoint {
        Viewpoint {
            focus: DVec3::new(0.2, -0.1, 0.0),
            bearing_rad: 0.7,
            pitch_rad: 0.4,
            distance_m: 1.7,
        }
    }

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

    #[test]
    fn a_dolly_comes_to_rest_and_does_not_depend_on_the_frame_rate() {
        let wanted = Viewpoint {
            bearing_rad: 3.0,
            ..view()
        };
        let (mut coarse, mut fine) = (Dolly::new(view()), Dolly::new(view()));
        coarse.follow(wanted, 0.1);
        (0..10).for_each(|_| fine.follow(wanted, 0.01));
        assert!((coarse.viewpoint().bearing_rad - fine.viewpoint().bearing_rad).abs() < 1e-9);
        (0..200).for_each(|_| fine.follow(wanted, 0.01));
        assert_eq!(fine.viewpoint(), wanted);
    }

    #[test]
    fn every_view_keeps_the_eye_between_rails_and_lamps() {
        for step in 0..64 {
            let bearing = f64::from(step) * 0.1;
            let orbit = |pitch_rad, zoom| Orbit {
                yaw_rad: 0.3,
                pitch_rad,
                zoom,
            };
            for by in [
                orbit(0.0, 1.0),
                orbit(2.0, 9.0),
                orbit(-2.0, 0.1),
                orbit(2.0, 0.1),
            ] {
                for view in [
                    Viewpoint::behind(DVec3::ZERO, bearing),
                    Viewpoint::overview(bearing),
                ] {
                    let z = f64::from(view.adjusted(by).camera().eye.z);
                    assert!(
                        (EYE_Z_M_MIN - 1e-6..=EYE_Z_M_MAX + 1e-6).contains(&z),
                        "{z}"
                    );
                }
            }
        }
    }

    #[test]
    fn turning_takes_the_shorter_way() {
        let from = Viewpoint {
            bearing_rad: 3.0,
            ..view()
        };
        let to = Viewpoint {
            bearing_rad: -3.0,
            ..view()
        };
        let half = from.lerp(to, 0.5).bearing_rad;
        assert!((wrap_rad(half - std::f64::consts::PI)).abs() < 1e-12);
    }
}
