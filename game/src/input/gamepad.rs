//! Buttons and sticks of gamepads.

use super::{Action, BindingContext, Event};

/// A button of a gamepad or a direction of one of its sticks, identified by its label in settings and help,
/// one of [`GamepadControl::all`]. Buttons are named by position as on an Xbox controller, whatever is
/// printed on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GamepadControl(&'static str);

impl GamepadControl {
    /// Lower of the four face buttons; activates the focused control on a page.
    pub const A: Self = Self("Gamepad A");
    /// Right face button; leaves a page.
    pub const B: Self = Self("Gamepad B");
    /// Left face button.
    pub const X: Self = Self("Gamepad X");
    /// Upper face button.
    pub const Y: Self = Self("Gamepad Y");
    /// Left bumper.
    pub const LEFT_BUMPER: Self = Self("Gamepad LB");
    /// Left trigger.
    pub const LEFT_TRIGGER: Self = Self("Gamepad LT");
    /// Right bumper.
    pub const RIGHT_BUMPER: Self = Self("Gamepad RB");
    /// Right trigger.
    pub const RIGHT_TRIGGER: Self = Self("Gamepad RT");
    /// Small button left of the centre.
    pub const BACK: Self = Self("Gamepad back");
    /// Small button right of the centre.
    pub const START: Self = Self("Gamepad start");
    /// Press of the left stick.
    pub const LEFT_STICK: Self = Self("Gamepad left stick");
    /// Press of the right stick.
    pub const RIGHT_STICK: Self = Self("Gamepad right stick");
    /// Left, right, up and down of the directional pad.
    pub const PAD: [Self; 4] = [
        Self("Gamepad left"),
        Self("Gamepad right"),
        Self("Gamepad up"),
        Self("Gamepad down"),
    ];
    /// Left, right, up and down of the left stick.
    pub const LEFT_STICK_TO: [Self; 4] = [
        Self("Left stick left"),
        Self("Left stick right"),
        Self("Left stick up"),
        Self("Left stick down"),
    ];
    /// Left, right, up and down of the right stick.
    pub const RIGHT_STICK_TO: [Self; 4] = [
        Self("Right stick left"),
        Self("Right stick right"),
        Self("Right stick up"),
        Self("Right stick down"),
    ];

    /// All controls, each of which can be bound.
    pub fn all() -> impl Iterator<Item = Self> {
        [
            Self::A,
            Self::B,
            Self::X,
            Self::Y,
            Self::LEFT_BUMPER,
            Self::LEFT_TRIGGER,
            Self::RIGHT_BUMPER,
            Self::RIGHT_TRIGGER,
            Self::BACK,
            Self::START,
            Self::LEFT_STICK,
            Self::RIGHT_STICK,
        ]
        .into_iter()
        .chain(Self::PAD)
        .chain(Self::LEFT_STICK_TO)
        .chain(Self::RIGHT_STICK_TO)
    }

    /// Label in the interface and the settings file.
    pub fn label(self) -> &'static str {
        self.0
    }

    /// Whether it is a direction of a stick, which has a deflection.
    pub fn is_analog(self) -> bool {
        Self::LEFT_STICK_TO.contains(&self) || Self::RIGHT_STICK_TO.contains(&self)
    }
}

/// Sticks of gamepads, whose directions count as pressed above a threshold.
#[derive(Debug, Default)]
pub struct Sticks {
    pressed: Vec<GamepadControl>,
}

impl Sticks {
    /// Moves an axis to `value`, from −1 to 1, with its negative and positive `directions`, and returns the
    /// events.
    pub fn push(&mut self, directions: [GamepadControl; 2], value: f64) -> Vec<Event> {
        let mut events = Vec::new();
        for (control, deflection) in directions.into_iter().zip([-value, value]) {
            let deflection = deflection.max(0.0);
            events.push(Event::Stick {
                control,
                deflection,
            });
            let was_pressed = self.pressed.contains(&control);
            // Hysteresis: with one threshold, a stick held near it would press and release by its noise.
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

impl Action {
    /// Steps per second at full deflection of a stick, or while a button is held.
    pub(super) fn steps_per_sec(self) -> f64 {
        match self {
            Self::AimLeft | Self::AimRight => 90.0,
            Self::LookLeft | Self::LookRight | Self::LookUp | Self::LookDown => 30.0,
            _ if self.mode() == BindingContext::Replay => 10.0,
            _ => 15.0,
        }
    }
}

/// Deflection above which a direction counts as pressed, and below which it is released.
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
        let [_, _, up, down] = GamepadControl::LEFT_STICK_TO;
        for (value, expected) in [
            (0.45, vec![]),
            (0.55, vec![(up, true)]),
            (0.45, vec![]),
            (0.9, vec![]),
            (0.3, vec![(up, false)]),
        ] {
            let events = sticks.push([down, up], value);
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
        sticks.push([left, right], -1.0);
        let events = sticks.push([left, right], 1.0);
        assert_eq!(presses(&events), [(left, false), (right, true)]);
    }
}
