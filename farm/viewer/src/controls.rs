//! Controls of the camera by pointer and held keys, and the list of all controls.

use std::f64::consts::PI;

use egui::{Key, PointerButton, Response, Ui};
use glam::{DVec2, DVec3};

use crate::camera::OrbitCamera;

/// Controls as the help lists them: the texts `view-key-…` and `view-does-…` of each.
pub const CONTROLS: [&str; 20] = [
    "orbit",
    "pan",
    "look",
    "zoom",
    "walk",
    "rise",
    "fast",
    "home",
    "camera",
    "exposure",
    "lights",
    "play",
    "pause",
    "save",
    "reload",
    "panel",
    "statistics",
    "help",
    "fullscreen",
    "quit",
];

/// Turns what the pointer does over the picture into moves of the camera; whether there was any.
pub(crate) fn point(camera: &mut OrbitCamera, picture: &Response, ui: &Ui) -> bool {
    let size = picture.rect.size().max(egui::Vec2::splat(1.0));
    let delta = picture.drag_delta();
    let pixel_share = DVec2::new((delta.x / size.x).into(), (delta.y / size.x).into());
    let (shift, scroll, pinch) = ui.input(|input| {
        let scroll = input.smooth_scroll_delta().y;
        (input.modifiers.shift, scroll, input.zoom_delta())
    });
    let mut has_moved = false;
    if delta != egui::Vec2::ZERO {
        has_moved = true;
        if picture.dragged_by(PointerButton::Middle)
            || (picture.dragged_by(PointerButton::Primary) && shift)
        {
            camera.pan(pixel_share);
        } else if picture.dragged_by(PointerButton::Primary) {
            let turn = pixel_share * ORBIT_RAD;
            camera.turn(-turn.x, turn.y);
        } else if picture.dragged_by(PointerButton::Secondary) {
            // What is under the pointer goes along with it.
            let turn = pixel_share * camera.fov_x_deg().to_radians();
            camera.look_around(turn.x, turn.y);
        }
    }
    if picture.contains_pointer() && (scroll != 0.0 || pinch != 1.0) {
        has_moved = true;
        let nearer = f64::from(scroll) / ZOOM_POINTS + f64::from(pinch).ln();
        camera.zoom((-nearer).exp());
    }
    has_moved
}

/// The way that the keys which are held ask for, (right, up, forward), in distances of the target a
/// second.
pub(crate) fn held(ui: &Ui) -> DVec3 {
    ui.input(|input| {
        if input.modifiers.command || input.modifiers.alt {
            return DVec3::ZERO;
        }
        let axis = |forth: Key, back: Key| {
            f64::from(u8::from(input.key_down(forth))) - f64::from(u8::from(input.key_down(back)))
        };
        let way = DVec3::new(
            axis(Key::D, Key::A),
            axis(Key::E, Key::Q),
            axis(Key::W, Key::S),
        );
        let speed = if input.modifiers.shift { FAST } else { 1.0 };
        WALK_PER_SEC * speed * way
    })
}

/// A walk, whose way depends on how long keys are held and not on how often that is looked at.
#[derive(Clone, Copy, Debug, Default)]
pub struct Walk {
    /// Velocity since when.
    going: Option<(DVec3, f64)>,
}

impl Walk {
    /// The way since the last call, if `velocity` counts from now on.
    pub fn advance(&mut self, velocity: DVec3, now_secs: f64) -> DVec3 {
        let way = match self.going {
            Some((before, since_secs)) => {
                before * (now_secs - since_secs).clamp(0.0, STALL_SECS_MAX)
            }
            None => DVec3::ZERO,
        };
        self.going = (velocity != DVec3::ZERO).then_some((velocity, now_secs));
        way
    }

    /// Whether it goes on.
    pub fn is_going(&self) -> bool {
        self.going.is_some()
    }
}

/// Once across the picture goes halfway round the target.
const ORBIT_RAD: f64 = PI;
/// Scrolling by so many points goes to 1/e of the distance: a notch of a wheel takes a tenth.
const ZOOM_POINTS: f64 = 400.0;
/// Distances of the target a second.
const WALK_PER_SEC: f64 = 0.6;
/// As fast with Shift.
const FAST: f64 = 4.0;
/// A window that has stood still for longer has not been looked at meanwhile.
const STALL_SECS_MAX: f64 = 0.5;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_walk_is_as_long_at_any_frame_rate(
            looks in prop::collection::vec(1e-4..0.3_f64, 1..60),
            x in -2.0..2.0_f64,
            z in -2.0..2.0_f64,
        ) {
            let velocity = DVec3::new(x, 0.0, z);
            let (mut walk, mut now, mut way) = (Walk::default(), 10.0, DVec3::ZERO);
            way += walk.advance(velocity, now);
            for secs in &looks {
                now += secs;
                way += walk.advance(velocity, now);
            }
            // Released between two looks: the last one still counts.
            now += 0.01;
            way += walk.advance(DVec3::ZERO, now);
            way += walk.advance(DVec3::ZERO, now + 1.0);
            let expected = velocity * (now - 10.0);
            prop_assert!(way.distance(expected) < 1e-9, "{way} {expected}");
            prop_assert!(!walk.is_going());
        }
    }

    #[test]
    fn a_pause_before_a_walk_is_no_way() {
        let mut walk = Walk::default();
        assert_eq!(walk.advance(DVec3::ZERO, 1.0), DVec3::ZERO);
        assert_eq!(walk.advance(DVec3::X, 100.0), DVec3::ZERO);
        assert_eq!(walk.advance(DVec3::X, 100.5), DVec3::X * 0.5);
        // A window that stood still has walked no farther than it could have been seen to.
        assert_eq!(walk.advance(DVec3::X, 200.0), DVec3::X * STALL_SECS_MAX);
    }
}
