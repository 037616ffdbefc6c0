//! Viewpoints of the camera and their geometry.

use std::f64::consts::FRAC_PI_2;

use carom_billiards::physics::{Pocket, Table};
use carom_tracer::{Camera, Lens};
use glam::{DVec2, DVec3, Vec3};

use super::{Framing, wrap_rad};
use crate::scene::scene_builder::FOV_X_DEG;

/// Largest height of the eye: below the lamps, whose plane is 1 m above the cloth. Views from above, which
/// do not show the lamps, are exempt.
pub const EYE_Z_M_MAX: f64 = 0.95;
/// Least height of the eye: above the rails and the balls.
pub const EYE_Z_M_MIN: f64 = 0.12;

/// Aperture radius of replays and videos, in metres: that of a 50 mm lens at f/5.6, which blurs the
/// farthest balls by about a pixel of a picture 640 pixels wide.
pub const APERTURE_RADIUS_M: f32 = 0.0045;

/// Camera placement in spherical coordinates about the point that is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Point at the picture's centre, metres.
    pub focus: DVec3,
    /// Horizontal direction of the view, radians from +x towards +y.
    pub bearing_rad: f64,
    /// Downward angle of the view, radians.
    pub pitch_rad: f64,
    /// Distance from the eye to the focus, metres.
    pub distance_m: f64,
    /// Full horizontal field of view, degrees.
    pub fov_x_deg: f64,
}

impl Viewpoint {
    /// The view over the cue ball along the aim, from the height of a player's head.
    pub fn behind(cue_ball: DVec3, bearing_rad: f64) -> Self {
        let ahead = DVec3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0) * AIM_AHEAD_M;
        Self {
            focus: DVec3::new(cue_ball.x, cue_ball.y, 0.0) + ahead,
            bearing_rad,
            pitch_rad: AIM_PITCH_RAD,
            distance_m: AIM_DISTANCE_M,
            fov_x_deg: AIM_FOV_X_DEG,
        }
    }

    /// [`Viewpoint::behind`] for a cue that is raised by `elevation_rad`: the eye is raised so far that the
    /// cue stays below the lines of sight to the cue ball and past it, but not above the lamps, and the
    /// field of view is widened to keep the ball and what is ahead of it in the picture.
    pub fn over_cue(cue_ball: DVec3, bearing_rad: f64, elevation_rad: f64) -> Self {
        let level = Self::behind(cue_ball, bearing_rad);
        let eye = |pitch_rad: f64| AIM_DISTANCE_M * DVec2::new(pitch_rad.cos(), pitch_rad.sin());
        // In the vertical plane of the cue, with x from the cue ball backwards and y upwards; the focus is
        // ahead of the ball, at a negative x.
        let focus = DVec2::new(-AIM_AHEAD_M, -cue_ball.z);
        let level_rad = (focus + eye(AIM_PITCH_RAD)).to_angle();
        let rise_rad = elevation_rad + CUE_CLEARANCE_RAD;
        if rise_rad <= level_rad {
            return level;
        }
        let up = DVec2::from_angle(rise_rad);
        let along_m = focus.dot(up);
        // The eye is on the line that the cue must stay below, at the level view's distance d from the
        // focus: s is the greater root of |s·up − focus|² = d².
        let same_m =
            along_m + (along_m.powi(2) - focus.length_squared() + AIM_DISTANCE_M.powi(2)).sqrt();
        let eye = up * same_m.min((EYE_Z_M_MAX - cue_ball.z) / up.y);
        let ahead_rad = (eye - focus).to_angle();
        // Excess of the angle between the ball and the focus, seen from the eye, over that of the level
        // view: half of it goes to either side of the picture's centre.
        let spread_rad = (rise_rad - ahead_rad) - (level_rad - AIM_PITCH_RAD);
        let pitch_rad = ahead_rad + 0.5 * spread_rad;
        let eye_z_m = eye.y + cue_ball.z;
        let ahead = DVec3::new(bearing_rad.cos(), bearing_rad.sin(), 0.0);
        Self {
            focus: cue_ball.with_z(0.0) + ahead * (eye_z_m / pitch_rad.tan() - eye.x),
            pitch_rad,
            distance_m: eye_z_m / pitch_rad.sin(),
            fov_x_deg: AIM_FOV_X_DEG + WIDENED * spread_rad.to_degrees(),
            ..level
        }
    }

    /// The whole table, seen along `bearing_rad`, from a greater distance where the table is wider.
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

    /// The table from straight above, to scale and filling the free part of the window, from so far that
    /// perspective hardly distorts the balls. [`crate::scene::scene_builder::below_lamp`] leaves the lamp
    /// out.
    pub fn overhead(table: &Table, framing: &Framing) -> Self {
        let (low, high) = table.outline();
        let reach = high - low + 2.0 * PLAN_RIM_M;
        let points_per_m = (framing.size() / reach).min_element();
        let offset_m = framing.offset() / points_per_m;
        let half_width_m = 0.5 * framing.film.x / points_per_m;
        Self {
            // Shifted so that the table's centre appears at the centre of the free part.
            focus: DVec3::new(-offset_m.x, offset_m.y, 0.0),
            bearing_rad: FRAC_PI_2,
            pitch_rad: PLAN_PITCH_RAD,
            distance_m: PLAN_EYE_Z_M,
            fov_x_deg: 2.0 * half_width_m.atan2(PLAN_EYE_Z_M).to_degrees(),
        }
    }

    /// This view from the same eye, fitted to the height of the free part of the window: turned up or down,
    /// with a wider field of view.
    #[must_use]
    pub fn framed(self, framing: &Framing) -> Self {
        if *framing == Framing::whole(framing.film) {
            return self;
        }
        // The free part shows the vertical extent of the original view, so the whole film shows 1/share of
        // it. Its centre is `offset` points off the film's: an angle whose tangent is
        // 2·half_width·offset/width.
        let share = framing.size().y / framing.film.y;
        let half_width = (0.5 * self.fov_x_deg).to_radians().tan() / share;
        let turned_rad = (2.0 * half_width * framing.offset().y / framing.film.x).atan();
        let pitch_rad = (self.pitch_rad - turned_rad).max(PITCH_RAD_MIN);
        let eye_z_m = self.distance_m * self.pitch_rad.sin();
        // The eye does not move: the focus moves to where the turned axis meets the cloth.
        let ahead_m = eye_z_m / pitch_rad.tan() - self.distance_m * self.pitch_rad.cos();
        let ahead = DVec3::new(self.bearing_rad.cos(), self.bearing_rad.sin(), 0.0);
        Self {
            focus: self.focus + ahead * ahead_m,
            pitch_rad,
            distance_m: eye_z_m / pitch_rad.sin(),
            fov_x_deg: 2.0 * half_width.atan().to_degrees(),
            ..self
        }
    }

    /// The view of a followed ball from the side.
    pub fn beside(ball: DVec3, bearing_rad: f64) -> Self {
        Self {
            focus: ball.with_z(0.0),
            bearing_rad: bearing_rad + BESIDE_RAD,
            pitch_rad: 0.5,
            distance_m: 1.3,
            fov_x_deg: FOV_X_DEG,
        }
    }

    /// The view from behind a pocket over the table.
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

    /// This view, orbited and zoomed by the player. The eye stays in the room and above the rails, and
    /// below the lamps unless it was above them.
    #[must_use]
    pub fn adjusted(self, by: Orbit) -> Self {
        let distance_m = (self.distance_m * by.zoom).clamp(0.5, self.distance_m.max(REACH_M));
        let top_m = EYE_Z_M_MAX.max(self.distance_m * self.pitch_rad.sin());
        let pitch = |z: f64| (z / distance_m).clamp(-1.0, 1.0).asin();
        let highest_rad = pitch(top_m).min(self.pitch_rad.max(PITCH_RAD_MAX));
        // The eye's horizontal distance is d·cos(pitch): for it to stay within the room's reach, distant
        // views must be steeper.
        let lowest_rad = pitch(EYE_Z_M_MIN).max((REACH_M / distance_m).min(1.0).acos());
        Self {
            bearing_rad: self.bearing_rad + by.yaw_rad,
            pitch_rad: (self.pitch_rad + by.pitch_rad)
                .clamp(lowest_rad.min(highest_rad), highest_rad),
            distance_m,
            ..self
        }
    }

    /// Interpolation to `to` by a share `s` from 0 to 1, turning by the shorter angle.
    #[must_use]
    pub fn lerp(self, to: Self, s: f64) -> Self {
        // Exactly `to`, without rounding: callers test by equality whether the camera still moves.
        if s >= 1.0 {
            return to;
        }
        let mix = |a: f64, b: f64| a + (b - a) * s;
        Self {
            focus: self.focus.lerp(to.focus, s),
            bearing_rad: self.bearing_rad + wrap_rad(to.bearing_rad - self.bearing_rad) * s,
            pitch_rad: mix(self.pitch_rad, to.pitch_rad),
            distance_m: mix(self.distance_m, to.distance_m),
            fov_x_deg: mix(self.fov_x_deg, to.fov_x_deg),
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
            fov_x_deg: self.fov_x_deg as f32,
            lens: Lens::default(),
            near_m: 0.0,
        }
    }

    /// Approaches `wanted` exponentially for `dt_secs` with the time constant `TIME_SECS`, independently
    /// of the display's rate, and finally rests exactly there, so that a picture at rest can be recognised.
    pub fn follow(&mut self, wanted: Self, dt_secs: f64) {
        *self = self.lerp(wanted, 1.0 - (-dt_secs.max(0.0) / TIME_SECS).exp());
        if self.is_close_to(wanted) {
            *self = wanted;
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

/// The player's rotation and zoom relative to a view.
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

/// Size relative to a nine-foot table.
fn scale(table: &Table) -> f64 {
    (table.length_m() / 2.54).max(table.width_m() / 1.27)
}

/// Largest horizontal distance from the eye to the focus, less than that to the walls.
const REACH_M: f64 = 4.5;
const AIM_AHEAD_M: f64 = 0.71;
/// An eye 27 cm above the cloth and 92 cm behind the ball, that of a player bent over the shot, which shows
/// the far end of the room above the rack.
const AIM_PITCH_RAD: f64 = 0.1614;
const AIM_DISTANCE_M: f64 = 1.651;
const AIM_FOV_X_DEG: f64 = 40.0;
/// Angle at the cue ball between the cue and the line to the eye: 10 cm at the eye.
const CUE_CLEARANCE_RAD: f64 = 0.1;
/// Widening of the horizontal field of view over the excess vertical angle of a raised view.
const WIDENED: f64 = 1.3;
const BESIDE_RAD: f64 = 0.6;
/// Least pitch of a view that panels turn up, at which its axis still meets the cloth.
const PITCH_RAD_MIN: f64 = 0.06;
const PITCH_RAD_MAX: f64 = 1.4;
/// Slightly less than straight down, as the camera's up vector is the z axis.
const PLAN_PITCH_RAD: f64 = FRAC_PI_2 - 3e-4;
const PLAN_EYE_Z_M: f64 = 10.0;
/// Width of the margin around the table's outline.
const PLAN_RIM_M: f64 = 0.1;
const TIME_SECS: f64 = 0.12;

#[cfg(test)]
pub(super) mod tests {
    use carom_billiards::physics::Stroke;
    use proptest::prelude::*;

    use super::super::Projection;
    use super::*;
    use crate::scene::cue_stick::cue_radius_m;
    use crate::scene::scene_builder::below_lamp;

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
    fn a_raised_cue_is_below_the_lines_of_sight() {
        let table = Table::nine_foot();
        let radius_m = table.cue_ball().radius_m;
        let ball = DVec3::new(-1.2, 0.1, radius_m);
        let (bearing_rad, film) = (0.3, DVec2::new(1280.0, 720.0));
        let mut eye_z_m = 0.0;
        for elevation_rad in (0..)
            .map(|step| 0.01 * f64::from(step))
            .take_while(|e| *e <= Stroke::ELEVATION_MAX_RAD)
        {
            let view = Viewpoint::over_cue(ball, bearing_rad, elevation_rad);
            let eye = view.camera().eye.as_dvec3();
            assert!(
                eye.z > eye_z_m - 1e-6 && eye.z < EYE_Z_M_MAX + 1e-6,
                "{elevation_rad}: {eye}"
            );
            eye_z_m = eye.z;
            let ahead = DVec2::from_angle(bearing_rad).extend(0.0);
            let projection = Projection::new(&view.camera(), film.x, film.y);
            for ahead_m in [0.0, 2.1 * radius_m, 0.7] {
                let target = ball + ahead * ahead_m;
                let seen = projection.film_from_world(target).unwrap();
                assert!((0.0..film.y).contains(&seen.y), "{elevation_rad}: {seen}");
                // Over the whole cue, which is drawn back beyond the eye.
                for along_m in (1..17).map(|step| 0.1 * f64::from(step)) {
                    let cue = ball - ahead * elevation_rad.cos() * along_m
                        + DVec3::Z * elevation_rad.sin() * along_m;
                    let share = (cue - target).dot(ahead) / (eye - target).dot(ahead);
                    if (0.0..1.0).contains(&share) {
                        let sight_z = target.lerp(eye, share).z;
                        let top_z = cue.z + cue_radius_m(along_m) / elevation_rad.cos();
                        assert!(
                            top_z < sight_z,
                            "{elevation_rad}: {along_m} m along the cue, {ahead_m} m ahead"
                        );
                    }
                }
            }
        }
        assert_eq!(
            Viewpoint::over_cue(ball, bearing_rad, 0.05),
            Viewpoint::behind(ball, bearing_rad)
        );
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
    fn the_plan_fills_what_panels_leave_to_scale() {
        let framing = Framing {
            film: DVec2::new(1280.0, 720.0),
            min: DVec2::new(124.0, 140.0),
            max: DVec2::new(1090.0, 660.0),
        };
        for table in tables() {
            let camera = Viewpoint::overhead(&table, &framing).camera();
            let projection = Projection::new(&camera, framing.film.x, framing.film.y);
            let seen = |at: DVec2| projection.film_from_world(at.extend(0.0)).unwrap();
            let (low, high) = table.outline();
            let (left, right) = (seen(low), seen(high));
            let name = table.name();
            for film in [left, right] {
                assert!(film.cmpge(framing.min).all(), "{name}: {film}");
                assert!(film.cmple(framing.max).all(), "{name}: {film}");
            }
            let share = (right - left).abs() / framing.size();
            assert!(share.max_element() > 0.8, "{name}: {share}");
            let middle = seen(0.5 * (low + high));
            let off = middle.distance(0.5 * (left + right));
            assert!(off < 0.5, "{name}: halves differ by {off} points");
        }
    }

    #[test]
    fn balls_are_round_in_the_plan_wherever_they_lie() {
        for table in tables() {
            let framing = Framing::whole(DVec2::new(1280.0, 720.0));
            let camera = Viewpoint::overhead(&table, &framing).camera();
            let eye = camera.eye.as_dvec3();
            let radius_m = table.ball().radius_m;
            let half = 0.5 * DVec2::new(table.length_m(), table.width_m()) - radius_m;
            // A sphere off the middle is longer by the secant of its direction's angle.
            let secant = eye.distance(half.extend(radius_m)) / (eye.z - radius_m);
            assert!(secant < 1.03, "{}: {secant}", table.name());
        }
    }

    #[test]
    fn framed_views_keep_their_eye_and_show_their_middle() {
        let framing = Framing {
            film: DVec2::new(640.0, 360.0),
            min: DVec2::new(124.0, 104.0),
            max: DVec2::new(450.0, 306.0),
        };
        let framed = view().framed(&framing);
        let (was, is) = (view().camera(), framed.camera());
        assert!((was.eye - is.eye).length() < 1e-5 && framed.focus.z.abs() < 1e-9);
        let projection = Projection::new(&is, 640.0, 360.0);
        let film = projection.film_from_world(view().focus).unwrap();
        assert!(film.distance(DVec2::new(320.0, 205.0)) < 0.5, "{film}");
    }

    #[test]
    fn the_pocket_view_sees_its_pocket_and_the_table_before_it() {
        for table in tables() {
            for pocket in table.pockets() {
                let camera = Viewpoint::from_pocket(pocket).camera();
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
        fn no_camera_is_outside_the_room_or_below_the_rails(
            bearing in -3.2..3.2f64, yaw_rad in -3.2..3.2f64, pitch_rad in -1.4..1.4f64,
            zoom in 0.3..2.5f64, share in 0.0..1.0f64,
        ) {
            for table in tables() {
                let by = Orbit { yaw_rad, pitch_rad, zoom };
                let from = Viewpoint::overview(&table, bearing).adjusted(by);
                let framing = Framing::whole(DVec2::new(16.0, 9.0));
                let to = Viewpoint::overhead(&table, &framing).adjusted(by);
                let camera = from.lerp(to, share).camera();
                let eye = camera.eye;
                let height = EYE_Z_M_MIN - 1e-6..PLAN_EYE_Z_M + 1e-3;
                prop_assert!(height.contains(&f64::from(eye.z)), "{eye}");
                let near_m = below_lamp(&table, camera).near_m;
                let forward = (camera.target - eye).normalize();
                let top = table.outline().1.extend(table.rail_height_m()).as_vec3();
                for side in [1.0, -1.0].map(|x| [Vec3::new(x, 1.0, 1.0), Vec3::new(x, -1.0, 1.0)]).concat() {
                    let depth = forward.dot(side * top - eye);
                    prop_assert!(near_m == 0.0 || near_m < depth, "the table is cut");
                }
                let (_, outer) = table.outline();
                let eye = to.camera().eye;
                let away_m = eye.truncate().as_dvec2().abs() - outer;
                prop_assert!(away_m.max_element() < 5.0, "{eye} is in a wall");
            }
        }
    }

    #[test]
    fn a_dolly_comes_to_rest_and_does_not_depend_on_the_frame_rate() {
        let wanted = Viewpoint {
            bearing_rad: 3.0,
            ..view()
        };
        let (mut coarse, mut fine) = (view(), view());
        coarse.follow(wanted, 0.1);
        (0..10).for_each(|_| fine.follow(wanted, 0.01));
        assert!((coarse.bearing_rad - fine.bearing_rad).abs() < 1e-9);
        (0..200).for_each(|_| fine.follow(wanted, 0.01));
        assert_eq!(fine, wanted);
    }
}
