//! The camera's views and the player's choice among them.

use std::f64::consts::FRAC_PI_2;

use carom_billiards::physics::{Pocket, Table};
use carom_tracer::Camera;
use glam::{DVec3, Vec3};

use super::wrap_rad;
use crate::scene::scene_builder::{self, FOV_X_DEG};

/// The eye stays below the lamps, whose plane is 1 m above the cloth.
pub const EYE_Z_M_MAX: f64 = 0.95;
/// The eye stays above the rails and the balls.
pub const EYE_Z_M_MIN: f64 = 0.12;

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
    /// Full horizontal field of view, degrees.
    pub fov_x_deg: f64,
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
            fov_x_deg: FOV_X_DEG,
        }
    }

    /// The whole table, seen along `bearing_rad`: from farther off where the table is wider.
    pub fn overview(table: &Table, bearing_rad: f64) -> Self {
        let distance_m = (3.4 + 0.8 * bearing_rad.sin().abs()) * scale(table);
        Self {
            focus: DVec3::ZERO,
            bearing_rad,
            pitch_rad: (EYE_Z_M_MAX / distance_m).asin(),
            distance_m,
            fov_x_deg: FOV_X_DEG,
        }
    }

    /// The whole table from above one long side, as steeply as the lamps allow: they hang 1 m over
    /// the cloth and would hide its middle.
    pub fn overhead(table: &Table) -> Self {
        let distance_m = OVERHEAD_DISTANCE_M * scale(table);
        // The eye lies under the plane from the far cushion through the shades' near lip.
        let near_m = OVERHEAD_NEAR_M * scale(table);
        let far_m = table.outline().1.y;
        let (low, _) = scene_builder::lampshade(table);
        let lip_rad = f64::from(low.z).atan2(far_m - f64::from(low.y) + LIP_MARGIN_M);
        let pitch_rad = lip_rad + ((far_m + near_m) * lip_rad.sin() / distance_m).asin();
        Self {
            focus: -DVec3::Y * near_m,
            bearing_rad: FRAC_PI_2,
            pitch_rad,
            distance_m,
            fov_x_deg: OVERHEAD_FOV_X_DEG,
        }
    }

    /// Over the shoulder of a ball that is followed.
    pub fn beside(ball: DVec3, bearing_rad: f64) -> Self {
        Self {
            focus: ball.with_z(0.0),
            bearing_rad,
            pitch_rad: 0.42,
            distance_m: 1.5,
            fov_x_deg: FOV_X_DEG,
        }
    }

    /// From behind a pocket over the table: what it sees coming.
    pub fn from_pocket(pocket: &Pocket) -> Self {
        let focus = (pocket.center + 0.5 * pocket.mouth).extend(0.0);
        let (away_m, above_m) = (1.25, 0.4f64);
        Self {
            focus,
            bearing_rad: pocket.mouth.to_angle(),
            pitch_rad: above_m.atan2(away_m),
            distance_m: above_m.hypot(away_m),
            fov_x_deg: 55.0,
        }
    }

    /// This view, orbited and zoomed by the player; the eye stays above the rails, and no higher than
    /// the lamps unless it was.
    #[must_use]
    pub fn adjusted(self, by: Orbit) -> Self {
        let distance_m = (self.distance_m * by.zoom).clamp(0.5, self.distance_m.max(4.5));
        let top_m = EYE_Z_M_MAX.max(self.distance_m * self.pitch_rad.sin());
        let pitch = |z: f64| (z / distance_m).clamp(-1.0, 1.0).asin();
        let highest_rad = pitch(top_m).min(self.pitch_rad.max(PITCH_RAD_MAX));
        Self {
            bearing_rad: self.bearing_rad + by.yaw_rad,
            pitch_rad: (self.pitch_rad + by.pitch_rad).clamp(pitch(EYE_Z_M_MIN), highest_rad),
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
            fov_x_deg: mix(self.fov_x_deg, to.fov_x_deg),
        }
    }

    /// The tracer's camera of this view, its eye lowered out of the lampshades if it would be in one.
    pub fn camera_in(self, table: &Table) -> Camera {
        let mut camera = self.camera();
        let (low, high) = scene_builder::lampshade(table);
        let inside =
            camera.eye.cmpgt(low - SHADE_MARGIN_M) & camera.eye.cmplt(high + SHADE_MARGIN_M);
        if inside.all() {
            camera.eye.z = low.z - SHADE_MARGIN_M;
        }
        camera
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
            fov_x_deg: self.fov_x_deg as f32,
        }
    }

    fn is_close_to(self, other: Self) -> bool {
        self.focus.distance(other.focus) < 2e-4
            && wrap_rad(self.bearing_rad - other.bearing_rad).abs() < 2e-4
            && (self.pitch_rad - other.pitch_rad).abs() < 2e-4
            && (self.distance_m - other.distance_m).abs() < 2e-4
            && (self.fov_x_deg - other.fov_x_deg).abs() < 2e-3
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
pub struct CameraSmoother {
    at: Viewpoint,
}

impl CameraSmoother {
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

/// How much larger than a nine-foot table's.
fn scale(table: &Table) -> f64 {
    (table.length_m() / 2.54).max(table.width_m() / 1.27)
}

const AIM_AHEAD_M: f64 = 0.5;
const AIM_PITCH_RAD: f64 = 0.3;
const AIM_DISTANCE_M: f64 = 1.75;
const PITCH_RAD_MAX: f64 = 1.4;
const OVERHEAD_DISTANCE_M: f64 = 3.3;
/// Nearer than the middle of the table: below are panels, above are lamps.
const OVERHEAD_NEAR_M: f64 = 0.14;
const OVERHEAD_FOV_X_DEG: f64 = 56.0;
/// So far before the shades' lip the far cushion is seen.
const LIP_MARGIN_M: f64 = 0.03;
const SHADE_MARGIN_M: f32 = 0.03;
const TIME_SECS: f64 = 0.12;

#[cfg(test)]
pub(super) mod tests {
    use glam::DVec2;
    use proptest::prelude::*;

    use super::super::Projection;
    use super::*;

    pub(in super::super) fn view() -> Viewpoint {
        Viewpoint {
            focus: DVec3::new(0.2, -0.1, 0.0),
            bearing_rad: 0.7,
            pitch_rad: 0.4,
            distance_m: 1.7,
            fov_x_deg: FOV_X_DEG,
        }
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
                    Viewpoint::overview(&Table::nine_foot(), bearing),
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

    fn tables() -> [Table; 5] {
        ["seven_foot", "eight_foot", "nine_foot", "snooker", "carom"]
            .map(|name| Table::built_in(name).unwrap())
    }

    #[test]
    fn from_above_the_whole_of_every_table_is_seen_past_the_lamps() {
        for table in tables() {
            let camera = Viewpoint::overhead(&table).camera_in(&table);
            let eye = camera.eye.as_dvec3();
            let projection = Projection::new(&camera, 1280.0, 720.0);
            let (low, _) = scene_builder::lampshade(&table);
            for end in table
                .noses()
                .iter()
                .flat_map(|nose| [nose.from(), nose.to()])
            {
                let film = projection.film_from_world(end.extend(0.0)).unwrap();
                let inside = film.cmpge(DVec2::ZERO) & film.cmple(DVec2::new(1280.0, 720.0));
                assert!(inside.all(), "{}: {end} is seen at {film}", table.name());
                // Where the line of sight passes the height of the lamps' lips.
                let share = (eye.z - f64::from(low.z)) / eye.z;
                let y = eye.y + (end.y - eye.y) * share;
                let name = table.name();
                assert!(y < f64::from(low.y), "{name}: {end} is behind a lamp: {y}");
            }
        }
    }

    #[test]
    fn the_pocket_view_sees_its_pocket_and_the_table_before_it() {
        for table in tables() {
            for pocket in table.pockets() {
                let camera = Viewpoint::from_pocket(pocket).camera_in(&table);
                let projection = Projection::new(&camera, 1280.0, 720.0);
                for ahead_m in [0.0, 0.3, 1.0] {
                    let place = (pocket.center + ahead_m * pocket.mouth).extend(0.0);
                    let film = projection.film_from_world(place).unwrap();
                    assert!((0.0..720.0).contains(&film.y), "{ahead_m}: {film}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn no_camera_is_in_a_lampshade_or_below_the_rails(
            bearing in -3.2..3.2f64, yaw_rad in -3.2..3.2f64, pitch_rad in -1.4..1.4f64,
            zoom in 0.3..2.5f64, share in 0.0..1.0f64,
        ) {
            for table in tables() {
                let by = Orbit { yaw_rad, pitch_rad, zoom };
                let from = Viewpoint::overview(&table, bearing).adjusted(by);
                let to = Viewpoint::overhead(&table).adjusted(by);
                let eye = from.lerp(to, share).camera_in(&table).eye;
                let (low, high) = scene_builder::lampshade(&table);
                let inside = eye.cmpgt(low - 0.01) & eye.cmplt(high + 0.01);
                prop_assert!(!inside.all(), "{eye} is in a lampshade");
                prop_assert!(f64::from(eye.z) > EYE_Z_M_MIN - 1e-6, "{eye}");
            }
        }
    }

    #[test]
    fn a_dolly_comes_to_rest_and_does_not_depend_on_the_frame_rate() {
        let wanted = Viewpoint {
            bearing_rad: 3.0,
            ..view()
        };
        let (mut coarse, mut fine) = (CameraSmoother::new(view()), CameraSmoother::new(view()));
        coarse.follow(wanted, 0.1);
        (0..10).for_each(|_| fine.follow(wanted, 0.01));
        assert!((coarse.viewpoint().bearing_rad - fine.viewpoint().bearing_rad).abs() < 1e-9);
        (0..200).for_each(|_| fine.follow(wanted, 0.01));
        assert_eq!(fine.viewpoint(), wanted);
    }
}
