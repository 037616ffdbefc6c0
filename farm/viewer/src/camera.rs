//! Orbit camera that turns around a target, pans, zooms, looks around and walks.

use carom_tracer::{Camera, Lens};
use glam::{DQuat, DVec2, DVec3, Vec3};

/// Orbit camera, given by its target and the direction and distance of its eye from there.
#[derive(Clone, Debug, PartialEq)]
pub struct OrbitCamera {
    /// The scene's own camera, used until something moves.
    home: Camera,
    is_home: bool,
    target: DVec3,
    distance_m: f64,
    /// Unit vector from the target to the eye.
    to_eye: DVec3,
    /// Unit up vector: directions perpendicular to it are level in the image.
    up: DVec3,
    fov_x_deg: f64,
}

impl OrbitCamera {
    /// A camera at the position of a scene's own.
    pub fn new(home: Camera) -> Self {
        let offset = home.eye.as_dvec3() - home.target.as_dvec3();
        Self {
            is_home: true,
            target: home.target.as_dvec3(),
            distance_m: offset.length(),
            to_eye: offset.normalize_or(DVec3::NEG_Y),
            up: home.up.as_dvec3().normalize_or(DVec3::Z),
            fov_x_deg: home.fov_x_deg.into(),
            home,
        }
    }

    /// Returns to the scene's own camera.
    pub fn go_home(&mut self) {
        *self = Self::new(self.home);
    }

    /// Whether it is the scene's own camera, whose changes it then follows.
    pub fn is_home(&self) -> bool {
        self.is_home
    }

    /// Keeps its position when the scene's own camera moves on.
    pub fn detach(&mut self) {
        self.is_home = false;
    }

    /// Sets another scene's camera, or the same at another time, as home; a moved camera keeps its position.
    pub fn set_home(&mut self, home: Camera) {
        // A camera that has not been moved follows the scene.
        match self.is_home {
            true => *self = Self::new(home),
            false => self.home = home,
        }
    }

    /// The camera for tracing.
    pub fn camera(&self) -> Camera {
        if self.is_home {
            return self.home;
        }
        let home_distance = self.home.eye.distance(self.home.target);
        let focus_share = self.home.lens.focus_distance_m / home_distance.max(f32::MIN_POSITIVE);
        Camera {
            eye: self.eye().as_vec3(),
            target: self.target.as_vec3(),
            up: self.up.as_vec3(),
            fov_x_deg: self.fov_x_deg as f32,
            lens: Lens {
                // Scaled with the distance, so that the focus stays at the target if it was there.
                focus_distance_m: focus_share * self.distance_m as f32,
                ..self.home.lens
            },
            near_m: self.home.near_m,
        }
    }

    /// The cameras of `frames` frames of one turn around the target, which would end where it begins.
    pub fn turntable(&self, frames: u32) -> impl Iterator<Item = Camera> {
        let begun = self.clone();
        (0..frames).map(move |frame| {
            let mut camera = begun.clone();
            if frame > 0 {
                camera.turn(
                    std::f64::consts::TAU * f64::from(frame) / f64::from(frames),
                    0.0,
                );
            }
            camera.camera()
        })
    }

    /// Full horizontal field of view in degrees.
    pub fn fov_x_deg(&self) -> f64 {
        self.fov_x_deg
    }

    /// Sets the full horizontal field of view in degrees, clamped to [`OrbitCamera::FOV_X_DEG`].
    pub fn set_fov_x_deg(&mut self, fov_x_deg: f64) {
        let [min, max] = Self::FOV_X_DEG;
        self.fov_x_deg = fov_x_deg.clamp(min, max);
        self.is_home = false;
    }

    /// Minimum and maximum horizontal field of view in degrees.
    pub const FOV_X_DEG: [f64; 2] = [5.0, 120.0];

    /// The up vector.
    pub fn up(&self) -> Vec3 {
        self.up.as_vec3()
    }

    /// Sets the up vector. The target stays, and so does the eye unless the view is almost parallel to it.
    pub fn set_up(&mut self, up: Vec3) {
        self.up = up.as_dvec3().normalize_or(self.up);
        self.is_home = false;
        self.turn(0.0, 0.0);
    }

    /// Orbits the target at constant distance: by `yaw_rad` around the up vector, anticlockwise as seen from
    /// above, and upwards by `pitch_rad`, stopping short of the poles.
    pub fn turn(&mut self, yaw_rad: f64, pitch_rad: f64) {
        self.to_eye = self.turned(yaw_rad, pitch_rad);
        self.is_home = false;
    }

    /// Turns about the eye, which stays in place: to the left by `yaw_rad` and up by `pitch_rad`.
    pub fn look_around(&mut self, yaw_rad: f64, pitch_rad: f64) {
        let eye = self.eye();
        // `to_eye` points backwards, so it falls when the view rises.
        self.turn(yaw_rad, -pitch_rad);
        self.target = eye - self.distance_m * self.to_eye;
    }

    /// Shifts the picture right and down by shares of its width, so that points at the target's distance
    /// follow the pointer.
    pub fn pan(&mut self, shift: DVec2) {
        // Width of the visible area at the target's distance.
        let width_m = 2.0 * self.distance_m * (0.5 * self.fov_x_deg.to_radians()).tan();
        let [right, up, _] = self.axes();
        self.target += width_m * (shift.y * up - shift.x * right);
        self.is_home = false;
    }

    /// Multiplies the distance to the target by `factor`, within limits that keep the eye away from the
    /// target.
    pub fn zoom(&mut self, factor: f64) {
        let home_distance_m = f64::from(self.home.eye.distance(self.home.target));
        // At a smaller distance, eye and target would coincide in single precision.
        let nearest_m = self.target.length().max(home_distance_m) * NEAREST;
        let farthest_m = home_distance_m * FARTHEST;
        self.distance_m = (self.distance_m * factor).clamp(nearest_m, farthest_m.max(nearest_m));
        self.is_home = false;
    }

    /// Moves eye and target along the picture's (right, up, forward), in units of the distance between them.
    pub fn walk(&mut self, travel: DVec3) {
        let [right, _, forward] = self.axes();
        // Up is the world's up vector, as for a walking person.
        let way = travel.x * right + travel.y * self.up + travel.z * forward;
        self.target += self.distance_m * way;
        self.is_home = false;
    }

    fn eye(&self) -> DVec3 {
        self.target + self.distance_m * self.to_eye
    }

    /// Unit vectors right, up and forward in the picture.
    fn axes(&self) -> [DVec3; 3] {
        let forward = -self.to_eye;
        let right = forward.cross(self.up);
        let right = right.normalize_or(self.up.any_orthonormal_vector());
        [right, right.cross(forward), forward]
    }

    fn turned(&self, yaw_rad: f64, pitch_rad: f64) -> DVec3 {
        let to_eye = DQuat::from_axis_angle(self.up, yaw_rad) * self.to_eye;
        let height = to_eye.dot(self.up).clamp(-1.0, 1.0);
        // The pitch is changed as the angle above the horizontal plane, from the height along `up` and the
        // horizontal direction `level`.
        let level = (to_eye - height * self.up).normalize_or(self.up.any_orthonormal_vector());
        let was_rad = height.asin();
        // A camera of the scene beyond the limit is not pulled back, only kept from moving further.
        let limit_rad = PITCH_MAX_RAD.max(was_rad.abs().min(PITCH_LAST_RAD));
        let pitch_rad = (was_rad + pitch_rad).clamp(-limit_rad, limit_rad);
        (pitch_rad.cos() * level + pitch_rad.sin() * self.up).normalize()
    }
}

/// Maximum pitch, short of the pole, where no direction is upright.
const PITCH_MAX_RAD: f64 = 1.553; // 89°
/// Absolute maximum: nearer to the pole, the view is parallel to the up vector in single precision.
const PITCH_LAST_RAD: f64 = 1.5698;
/// Minimum distance relative to the one at home and to the target's distance from the origin.
const NEAREST: f64 = 1e-4;
/// Maximum distance relative to the one at home.
const FARTHEST: f64 = 1e4;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn scene_camera() -> impl Strategy<Value = Camera> {
        let coordinate = || -50.0..50.0_f32;
        let offset = (0.1..20.0_f32, -3.1..3.1_f32, -1.4..1.4_f32);
        (coordinate(), coordinate(), coordinate(), offset, 0..3_usize).prop_map(
            |(x, y, z, (distance, yaw, pitch), axis)| {
                let target = Vec3::new(x, y, z);
                let (up, level) =
                    [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)][axis];
                let aside = up.cross(level);
                let flat = yaw.cos() * level + yaw.sin() * aside;
                let eye = target + distance * (pitch.cos() * flat + pitch.sin() * up);
                Camera::looking_at(eye, target).upright(up)
            },
        )
    }

    fn distance(camera: &Camera) -> f32 {
        camera.eye.distance(camera.target)
    }

    /// Tolerance of a single-precision position in metres.
    fn slack(camera: &Camera) -> f32 {
        1e-6 * (camera.eye.length() + camera.target.length() + 1.0)
    }

    proptest! {
        #[test]
        fn what_has_not_moved_is_the_scenes_own(home in scene_camera()) {
            let mut camera = OrbitCamera::new(home);
            prop_assert_eq!(camera.camera(), home);
            camera.turn(1.0, 0.3);
            camera.walk(DVec3::ONE);
            camera.go_home();
            prop_assert_eq!(camera.camera(), home);
        }

        #[test]
        fn orbit_keeps_target_and_distance(
            home in scene_camera(),
            turns in prop::collection::vec((-7.0..7.0_f64, -4.0..4.0_f64), 1..20),
        ) {
            let mut camera = OrbitCamera::new(home);
            for (yaw, pitch) in turns {
                camera.turn(yaw, pitch);
                let seen = camera.camera();
                prop_assert!((distance(&seen) - distance(&home)).abs() < slack(&home));
                prop_assert!(seen.target.distance(home.target) < slack(&home));
                // Never over a pole, where the picture would turn upside down.
                let view = (seen.target - seen.eye).normalize();
                prop_assert!(view.cross(seen.up).length() > 1e-3);
            }
        }

        #[test]
        fn zoom_never_reaches_the_target(
            home in scene_camera(),
            factors in prop::collection::vec(1e-3..1e3_f64, 1..40),
        ) {
            let mut camera = OrbitCamera::new(home);
            let view = (home.target - home.eye).normalize();
            for factor in factors {
                camera.zoom(factor);
                let seen = camera.camera();
                prop_assert!((seen.target - seen.eye).dot(view) > 0.0, "{seen:?}");
                prop_assert!(seen.target.distance(home.target) < slack(&home));
            }
        }

        #[test]
        fn a_way_and_its_opposite_lead_back(home in scene_camera(), x in -1.0..1.0_f64, y in -1.0..1.0_f64) {
            let mut camera = OrbitCamera::new(home);
            camera.pan(DVec2::new(x, y));
            camera.pan(-DVec2::new(x, y));
            camera.walk(DVec3::new(x, y, 1.0));
            camera.walk(-DVec3::new(x, y, 1.0));
            camera.look_around(x, 0.1 * y);
            camera.look_around(-x, -0.1 * y);
            let seen = camera.camera();
            prop_assert!(seen.eye.distance(home.eye) < 10.0 * slack(&home), "{seen:?} {home:?}");
            prop_assert!(seen.target.distance(home.target) < 0.1 * distance(&home), "{seen:?}");
        }

        #[test]
        fn looking_around_keeps_the_eye(home in scene_camera(), yaw in -7.0..7.0_f64, pitch in -4.0..4.0_f64) {
            let mut camera = OrbitCamera::new(home);
            camera.look_around(yaw, pitch);
            let seen = camera.camera();
            prop_assert!(seen.eye.distance(home.eye) < slack(&home));
            prop_assert!((distance(&seen) - distance(&home)).abs() < slack(&home));
        }
    }

    fn in_front() -> OrbitCamera {
        OrbitCamera::new(Camera::looking_at([0.0, -4.0, 0.0], [0.0; 3]))
    }

    #[test]
    fn directions_are_those_of_the_picture() {
        let mut camera = in_front();
        camera.walk(DVec3::new(0.0, 0.0, 0.25));
        assert!(camera.camera().eye.distance(Vec3::new(0.0, -3.0, 0.0)) < 1e-6);
        camera = in_front();
        camera.walk(DVec3::new(0.25, 0.5, 0.0));
        assert!(camera.camera().eye.distance(Vec3::new(1.0, -4.0, 2.0)) < 1e-6);
        // Upwards, and towards positive x.
        camera = in_front();
        camera.turn(0.1, 0.2);
        let eye = camera.camera().eye;
        assert!(eye.x > 0.0 && eye.z > 0.0, "{eye}");
        // To the left and upwards.
        camera = in_front();
        camera.look_around(0.1, 0.2);
        let target = camera.camera().target;
        assert!(target.x < 0.0 && target.z > 0.0, "{target}");
    }

    #[test]
    fn what_is_at_the_targets_distance_follows_a_pan() {
        let mut camera = in_front();
        camera.pan(DVec2::new(0.5, 0.0));
        // What was in the middle is at the right edge, half a width of 2 · 4 tan 22.5° away.
        let half_width = 4.0 * 22.5_f32.to_radians().tan();
        assert!((camera.camera().target.x + half_width).abs() < 1e-5);
    }

    #[test]
    fn a_turntable_goes_once_round_and_keeps_its_distance() {
        let camera = in_front();
        let frames: Vec<Camera> = camera.turntable(8).collect();
        assert_eq!(frames[0], camera.camera());
        for (frame, seen) in frames.iter().enumerate() {
            let angle = std::f32::consts::TAU * frame as f32 / 8.0;
            let eye = Vec3::new(4.0 * angle.sin(), -4.0 * angle.cos(), 0.0);
            assert!(seen.eye.distance(eye) < 1e-5, "{frame}: {seen:?}");
        }
    }

    #[test]
    fn the_lens_stays_sharp_at_the_target() {
        let home = Camera::looking_at([0.0, -4.0, 0.0], [0.0; 3]).aperture_radius_m(0.1);
        let mut camera = OrbitCamera::new(home);
        camera.zoom(0.5);
        let lens = camera.camera().lens;
        assert_eq!((lens.aperture_radius_m, lens.focus_distance_m), (0.1, 2.0));
    }

    #[test]
    fn another_axis_upright_keeps_eye_and_target() {
        let mut camera = in_front();
        camera.turn(0.3, 0.4);
        let before = camera.camera();
        camera.set_up(Vec3::X);
        let after = camera.camera();
        assert!(after.eye.distance(before.eye) < 1e-5);
        assert_eq!((after.target, after.up), (before.target, Vec3::X));
        // A view along the up vector is replaced by one beside it.
        let mut above = OrbitCamera::new(Camera::looking_at([0.0, 0.0, 5.0], [0.0; 3]));
        above.set_up(Vec3::Z);
        let seen = above.camera();
        let aside = (seen.target - seen.eye).normalize().cross(Vec3::Z).length();
        assert!(aside > 0.9 * PITCH_LAST_RAD.cos() as f32, "{aside}");
    }
}
