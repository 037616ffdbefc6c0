//! Translation of the windowing library's events into the game's.

use glam::DVec2;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::PhysicalKey;

use crate::input::{Button, Event, Key};

/// Translates a window event to the game's event, if it has one. `scale` is in pixels per point.
pub(super) fn translate(event: &WindowEvent, scale: f64) -> Option<Event> {
    match event {
        WindowEvent::CursorMoved { position, .. } => {
            Some(Event::Pointer(DVec2::new(position.x, position.y) / scale))
        }
        WindowEvent::CursorLeft { .. } => Some(Event::PointerLeft),
        WindowEvent::Focused(false) => Some(Event::FocusLost),
        WindowEvent::MouseInput { state, button, .. } => {
            button_of(*button).map(|button| Event::Button {
                button,
                pressed: *state == ElementState::Pressed,
            })
        }
        WindowEvent::MouseWheel { delta, .. } => Some(Event::Wheel(match delta {
            MouseScrollDelta::LineDelta(_, lines) => f64::from(*lines),
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / scale / WHEEL_NOTCH_POINTS,
        })),
        WindowEvent::KeyboardInput { event, .. } => {
            key_of(event.physical_key).map(|key| Event::Key {
                key,
                pressed: event.state == ElementState::Pressed,
                repeat: event.repeat,
            })
        }
        _ => None,
    }
}

fn button_of(button: MouseButton) -> Option<Button> {
    match button {
        MouseButton::Left => Some(Button::Left),
        MouseButton::Right => Some(Button::Right),
        MouseButton::Middle => Some(Button::Middle),
        MouseButton::Back => Some(Button::Back),
        MouseButton::Forward => Some(Button::Forward),
        MouseButton::Other(_) => None,
    }
}

/// The game's key of a physical key. winit's names of key codes are those of the W3C.
fn key_of(key: PhysicalKey) -> Option<Key> {
    let PhysicalKey::Code(code) = key else {
        return None;
    };
    Key::from_code(&format!("{code:?}"))
}

/// Scroll distance of a touchpad that counts as one notch of a wheel, in points.
const WHEEL_NOTCH_POINTS: f64 = 50.0;
