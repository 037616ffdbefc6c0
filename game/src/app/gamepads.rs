//! Gamepads: a thread that reads them and translates their events to the game's.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use gilrs::{Axis, Button, EventType, Gilrs};
use winit::event_loop::EventLoopProxy;

use crate::input::{Event, GamepadControl, Sticks};

/// All connected gamepads, which are treated as one.
pub(super) struct Gamepads {
    received: Receiver<GamepadEvent>,
}

/// Event of a gamepad.
pub(super) enum GamepadEvent {
    /// An input event of the game, and its time.
    Input(Event, Instant),
    /// A gamepad was connected, with its name.
    Connected(String),
}

impl Gamepads {
    /// Starts the thread, which wakes the event loop for each event. Without gamepads or the system's
    /// permission there are no events.
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

    /// The events since the last call.
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
                let inputs = translate(event, &mut sticks).into_iter();
                events.extend(inputs.map(|event| GamepadEvent::Input(event, now)));
            }
            None => {}
        }
        for event in events {
            if sender.send(event).is_err() || wake.send_event(()).is_err() {
                // The window is closed.
                return;
            }
        }
    }
}

/// Translates a gamepad's event to the game's events.
fn translate(event: EventType, sticks: &mut Sticks) -> Vec<Event> {
    let button = |button, pressed| {
        let control = control_of(button);
        control.map(|control| Event::Gamepad { control, pressed })
    };
    match event {
        EventType::ButtonPressed(of, _) => button(of, true).into_iter().collect(),
        EventType::ButtonReleased(of, _) => button(of, false).into_iter().collect(),
        EventType::AxisChanged(axis, value, _) => {
            let directions = directions(axis);
            directions.map_or_else(Vec::new, |of| sticks.push(of, f64::from(value)))
        }
        EventType::Disconnected => {
            *sticks = Sticks::default();
            vec![Event::FocusLost]
        }
        _ => Vec::new(),
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

/// Longest wait for an event.
const WAIT: Duration = Duration::from_millis(500);
/// Largest number of characters shown of a gamepad's name.
const NAME_LETTERS_MAX: usize = 40;

#[cfg(test)]
mod tests {
    use super::*;

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
