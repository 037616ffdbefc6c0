//! Gamepads of this machine: a thread that reads them, as events of the game.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use gilrs::{Axis, Button, EventType, Gilrs};
use winit::event_loop::EventLoopProxy;

use crate::input::{Event, GamepadControl};

/// All gamepads that are connected, now or later; they count as one.
pub(super) struct Gamepads {
    received: Receiver<GamepadEvent>,
}

/// What a gamepad has done.
pub(super) enum GamepadEvent {
    /// Something of the game, and when.
    Input(Event, Instant),
    /// A gamepad is there, with the name that it gives itself.
    Connected(String),
}

impl Gamepads {
    /// Reads gamepads from now on and wakes the event loop for each event; a machine without any, or without the
    /// system's permission, has no events.
    pub(super) fn start(wake: EventLoopProxy<()>) -> Self {
        let (sender, received) = channel();
        let read = move || read(&sender, &wake);
        if let Err(why) = thread::Builder::new()
            .name("gamepads".to_owned())
            .spawn(read)
        {
            tracing::warn!("no gamepads: {why}");
        }
        Self { received }
    }

    /// What has happened since the last call.
    pub(super) fn poll(&self) -> impl Iterator<Item = GamepadEvent> {
        self.received.try_iter()
    }
}

fn read(sender: &Sender<GamepadEvent>, wake: &EventLoopProxy<()>) {
    let mut gilrs = match Gilrs::new() {
        Ok(gilrs) => gilrs,
        Err(why) => return tracing::warn!("no gamepads: {why}"),
    };
    let mut sticks = Sticks::default();
    loop {
        let event = gilrs.next_event_blocking(Some(WAIT));
        let now = Instant::now();
        let mut events = Vec::new();
        match event.map(|event| (event.event, event.id)) {
            Some((EventType::Connected, id)) => {
                let gamepad = gilrs.gamepad(id);
                let shown = gamepad.name().chars().filter(|c| !c.is_control());
                events.push(GamepadEvent::Connected(
                    shown.take(NAME_LETTERS_MAX).collect(),
                ));
            }
            Some((event, _)) => {
                let inputs = sticks.translate(event).into_iter();
                events.extend(inputs.map(|event| GamepadEvent::Input(event, now)));
            }
            None => {}
        }
        for event in events {
            if sender.send(event).is_err() || wake.send_event(()).is_err() {
                return; // the window is closed
            }
        }
    }
}

/// Directions of the sticks that count as pressed.
#[derive(Default)]
struct Sticks {
    pressed: Vec<GamepadControl>,
}

impl Sticks {
    /// What an event of a gamepad is to the game.
    fn translate(&mut self, event: EventType) -> Vec<Event> {
        let button = |button, pressed| {
            let control = control_of(button);
            control.map(|control| Event::Gamepad { control, pressed })
        };
        match event {
            EventType::ButtonPressed(of, _) => button(of, true).into_iter().collect(),
            EventType::ButtonReleased(of, _) => button(of, false).into_iter().collect(),
            EventType::AxisChanged(axis, value, _) => self.push(axis, f64::from(value)),
            EventType::Disconnected => {
                self.pressed.clear();
                vec![Event::FocusLost]
            }
            _ => Vec::new(),
        }
    }

    fn push(&mut self, axis: Axis, value: f64) -> Vec<Event> {
        let Some([negative, positive]) = directions(axis) else {
            return Vec::new();
        };
        let mut events = Vec::new();
        for (control, deflection) in [(negative, -value), (positive, value)] {
            let deflection = deflection.max(0.0);
            events.push(Event::Stick {
                control,
                deflection,
            });
            let was_pressed = self.pressed.contains(&control);
            if !was_pressed && deflection > PRESSED_FROM {
                self.pressed.push(control);
            } else if was_pressed && deflection < RELEASED_BELOW {
                self.pressed.retain(|held| *held != control);
            } else {
                continue;
            }
            events.push(Event::Gamepad {
                control,
                pressed: !was_pressed,
            });
        }
        events
    }
}

fn control_of(button: Button) -> Option<GamepadControl> {
    Some(match button {
        Button::South => GamepadControl::A,
        Button::East => GamepadControl::B,
        Button::West => GamepadControl::X,
        Button::North => GamepadControl::Y,
        Button::LeftTrigger => GamepadControl::LEFT_BUMPER,
        Button::LeftTrigger2 => GamepadControl::LEFT_TRIGGER,
        Button::RightTrigger => GamepadControl::RIGHT_BUMPER,
        Button::RightTrigger2 => GamepadControl::RIGHT_TRIGGER,
        Button::Select => GamepadControl::BACK,
        Button::Start => GamepadControl::START,
        Button::LeftThumb => GamepadControl::LEFT_STICK,
        Button::RightThumb => GamepadControl::RIGHT_STICK,
        Button::DPadLeft => GamepadControl::PAD[0],
        Button::DPadRight => GamepadControl::PAD[1],
        Button::DPadUp => GamepadControl::PAD[2],
        Button::DPadDown => GamepadControl::PAD[3],
        _ => return None,
    })
}

/// The negative and the positive direction of an axis; up is positive.
fn directions(axis: Axis) -> Option<[GamepadControl; 2]> {
    let left = GamepadControl::LEFT_STICK_TO;
    let right = GamepadControl::RIGHT_STICK_TO;
    Some(match axis {
        Axis::LeftStickX => [left[0], left[1]],
        Axis::LeftStickY => [left[3], left[2]],
        Axis::RightStickX => [right[0], right[1]],
        Axis::RightStickY => [right[3], right[2]],
        _ => return None,
    })
}

/// How long the thread waits for an event before it looks whether the window is still open.
const WAIT: Duration = Duration::from_millis(500);
/// Letters of a gamepad's name that are shown.
const NAME_LETTERS_MAX: usize = 40;
/// How far a stick is pushed in a direction that counts as pressed, and from where it is released again.
const PRESSED_FROM: f64 = 0.5;
const RELEASED_BELOW: f64 = 0.4;

#[cfg(test)]
mod tests {
    use super::*;

    fn presses(events: &[Event]) -> Vec<(GamepadControl, bool)> {
        let of = |event: &Event| match event {
            Event::Gamepad { control, pressed } => Some((*control, *pressed)),
            _ => None,
        };
        events.iter().filter_map(of).collect()
    }

    #[test]
    fn a_stick_is_pressed_once_and_does_not_flutter() {
        let mut sticks = Sticks::default();
        let up = GamepadControl::LEFT_STICK_TO[2];
        for (value, expected) in [
            (0.45, vec![]),
            (0.55, vec![(up, true)]),
            (0.45, vec![]),
            (0.9, vec![]),
            (0.3, vec![(up, false)]),
        ] {
            let events = sticks.push(Axis::LeftStickY, value);
            assert_eq!(presses(&events), expected, "{value}");
            assert!(events.contains(&Event::Stick {
                control: up,
                deflection: value
            }));
        }
    }

    #[test]
    fn a_stick_that_flips_over_leaves_one_direction_for_the_other() {
        let mut sticks = Sticks::default();
        let [left, right, ..] = GamepadControl::RIGHT_STICK_TO;
        sticks.push(Axis::RightStickX, -1.0);
        let events = sticks.push(Axis::RightStickX, 1.0);
        assert_eq!(presses(&events), [(left, false), (right, true)]);
        assert_eq!(
            sticks.translate(EventType::Disconnected),
            [Event::FocusLost]
        );
        assert!(sticks.pressed.is_empty());
    }

    #[test]
    fn every_control_is_a_button_or_a_direction_of_a_stick() {
        let buttons = [
            Button::South,
            Button::East,
            Button::West,
            Button::North,
            Button::LeftTrigger,
            Button::LeftTrigger2,
            Button::RightTrigger,
            Button::RightTrigger2,
            Button::Select,
            Button::Start,
            Button::LeftThumb,
            Button::RightThumb,
            Button::DPadLeft,
            Button::DPadRight,
            Button::DPadUp,
            Button::DPadDown,
        ];
        let axes = [
            Axis::LeftStickX,
            Axis::LeftStickY,
            Axis::RightStickX,
            Axis::RightStickY,
        ];
        let mut made: Vec<_> = buttons.into_iter().filter_map(control_of).collect();
        made.extend(axes.into_iter().filter_map(directions).flatten());
        made.sort();
        let mut all: Vec<_> = GamepadControl::all().collect();
        all.sort();
        assert_eq!(made, all);
    }
}
