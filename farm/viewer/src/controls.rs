//! Camera controls by pointer and held keys, and the list of all controls.

use std::f64::consts::PI;

use egui::{Key, PointerButton, Response, Ui};
use glam::{DVec2, DVec3};

use crate::camera::OrbitCamera;

/// Identifiers of all controls for the help, in the texts `view-key-…` and `view-does-…`.
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

/// Moves the camera by the pointer's actions on the picture; returns whether it has moved.
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
            // Scaled by the field of view, so that the point under the pointer follows it.
            let turn = pixel_share * camera.fov_x_deg().to_radians();
            camera.look_around(turn.x, turn.y);
        }
    }
    if picture.contains_pointer() && (scroll != 0.0 || pinch != 1.0) {
        has_moved = true;
        // Added as logarithms of the distance, in which equal steps are equal factors at every distance.
        let nearer = f64::from(scroll) / ZOOM_POINTS + f64::from(pinch).ln();
        camera.zoom((-nearer).exp());
    }
    has_moved
}

/// Velocity requested by the held keys, (right, up, forward), in distances to the target per second.
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

/// Integrator of walking, whose path depends on how long keys are held and not on the frame rate.
#[derive(Clone, Copy, Debug, Default)]
pub struct Walk {
    /// The velocity and the time from which on it holds, in seconds.
    going: Option<(DVec3, f64)>,
}

impl Walk {
    /// The displacement since the last call; `velocity` holds from now on.
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

    /// Whether the velocity is not zero.
    pub fn is_going(&self) -> bool {
        self.going.is_some()
    }
}

/// Angle of a drag across the picture's width: half a turn around the target.
const ORBIT_RAD: f64 = PI;
/// Scrolled points that reduce the distance to 1/e: a notch of a wheel takes a tenth of it.
const ZOOM_POINTS: f64 = 400.0;
/// Walking speed in distances to the target per second.
const WALK_PER_SEC: f64 = 0.6;
/// Factor of the walking speed with Shift.
const FAST: f64 = 4.0;
/// Maximum time step: in a longer one the window was stalled, and the user saw no motion.
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
            // Released between two calls: the last velocity still counts.
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
        // After a stall the camera has moved no further than the bounded time step allows.
        assert_eq!(walk.advance(DVec3::X, 200.0), DVec3::X * STALL_SECS_MAX);
    }
}
