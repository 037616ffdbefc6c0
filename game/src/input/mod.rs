//! Translation of mouse, keyboard and gamepad input to intents: a pure function of the events so far.
//!
//! ```text
//! Event ─▶ Trigger ─▶ Bindings ─▶ Action ─▶ Intent
//!          control     the         named     command to
//!          pressed     player's    function  the game
//! ```
//!
//! A new control is a variant of [`Action`], a row of [`ACTIONS`], its `control-` text and an arm where it
//! becomes an [`Intent`]; help, settings and README.md follow.

pub mod action;
pub mod binding;
mod gamepad;
mod intent;
pub mod key;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;

pub use action::{ACTIONS, Action, ActionSpec, BindingContext, Group};
pub use binding::{BindingError, Bindings, Trigger, UnknownTrigger};
pub use gamepad::{GamepadControl, Sticks};
pub use intent::{
    AimIntent, AppIntent, Intent, MatchIntent, ReplayControl, ReplayIntent, StrokeIntent,
};
pub use key::{Button, Key};

use crate::camera::CameraIntent;

/// Input event, independent of the windowing library.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The pointer moved to a position in points from the window's top left.
    Pointer(DVec2),
    /// The pointer has left the window.
    PointerLeft,
    /// A mouse button was pressed or released.
    Button {
        /// The button.
        button: Button,
        /// Whether it was pressed.
        pressed: bool,
    },
    /// The wheel was turned by a number of notches, positive away from the player.
    Wheel(f64),
    /// A key was pressed, released, or repeats while held.
    Key {
        /// The key.
        key: Key,
        /// Whether it was pressed.
        pressed: bool,
        /// Whether it repeats.
        repeat: bool,
    },
    /// A button of a gamepad was pressed or released, or a stick crossed the threshold of a direction.
    Gamepad {
        /// The button or direction.
        control: GamepadControl,
        /// Whether it was pressed.
        pressed: bool,
    },
    /// A stick was moved in a direction.
    Stick {
        /// The direction.
        control: GamepadControl,
        /// Deflection, 0 to 1.
        deflection: f64,
    },
    /// The focus was lost: releases of keys and buttons may be missed from now on.
    FocusLost,
}

/// Settings of the mouse for turning the aim and the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MouseSettings {
    /// Factor on the default speed, within [`MouseSettings::SPEED`].
    pub speed: f64,
    /// Whether the vertical direction of the camera's rotation is inverted.
    pub inverts_pitch: bool,
}

impl MouseSettings {
    /// Least and greatest factor.
    pub const SPEED: [f64; 2] = [0.2, 5.0];
}

impl Default for MouseSettings {
    fn default() -> Self {
        Self {
            speed: 1.0,
            inverts_pitch: false,
        }
    }
}

/// State of the input: bindings, held controls, pointer.
#[derive(Clone, Debug, Default)]
pub struct Input {
    bindings: Bindings,
    mouse: MouseSettings,
    mode: BindingContext,
    pointer: Option<DVec2>,
    hold: Option<Hold>,
    fine: BTreeSet<Trigger>,
    /// Whether the pointer carries something over the table.
    is_carrying: bool,
    /// Accumulated fractions of a notch of the wheel, for actions that do not repeat.
    notches: f64,
    /// Deflected sticks and held buttons of gamepads.
    gamepad: BTreeMap<GamepadControl, HeldControl>,
}

/// A held control of a gamepad.
#[derive(Clone, Copy, Debug, PartialEq)]
struct HeldControl {
    /// Deflection, 0 to 1; 1 for buttons.
    deflection: f64,
    held_secs: f64,
}

/// An action that lasts while its trigger is held.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hold {
    trigger: Trigger,
    action: Action,
    /// Share of the cue's travel by which a stroke is drawn back, 0 to 1.
    drawn: f64,
}

impl Event {
    /// The control that was pressed or turned, if the event is that.
    pub fn trigger(&self) -> Option<Trigger> {
        match *self {
            Self::Button {
                button,
                pressed: true,
            } => Some(Trigger::Button(button)),
            Self::Key {
                key,
                pressed: true,
                repeat: false,
            } => Some(Trigger::Key(key)),
            Self::Gamepad {
                control,
                pressed: true,
            } => Some(Trigger::Gamepad(control)),
            Self::Wheel(notches) if notches > 0.0 => Some(Trigger::WheelUp),
            Self::Wheel(notches) if notches < 0.0 => Some(Trigger::WheelDown),
            _ => None,
        }
    }
}

impl Input {
    /// An input state with nothing held.
    pub fn new(bindings: Bindings) -> Self {
        Self {
            bindings,
            ..Self::default()
        }
    }

    /// Sets the settings of the mouse; held controls stay held.
    pub fn set_mouse(&mut self, mouse: MouseSettings) {
        self.mouse = mouse;
    }

    /// The bindings.
    pub fn bindings(&self) -> &Bindings {
        &self.bindings
    }

    /// Sets the context of the bindings.
    pub fn set_mode(&mut self, mode: BindingContext) {
        self.mode = mode;
    }

    /// Processes an event, and returns the intent that it causes.
    pub fn handle(&mut self, event: Event) -> Option<Intent> {
        match event {
            Event::Pointer(at) => self.pointer_moved(at),
            Event::PointerLeft => {
                self.pointer = None;
                None
            }
            Event::Button { button, pressed } => {
                self.switch(Trigger::Button(button), pressed, false)
            }
            Event::Key {
                key,
                pressed,
                repeat,
            } => self.switch(Trigger::Key(key), pressed, repeat),
            Event::Gamepad { control, pressed } => self.press_gamepad(control, pressed),
            Event::Stick {
                control,
                deflection,
            } => {
                self.hold_gamepad(control, deflection);
                None
            }
            Event::Wheel(notches) => self.wheel(notches),
            Event::FocusLost => self.let_go(),
        }
    }

    /// Releases all held controls; a stroke in progress is cancelled.
    pub fn let_go(&mut self) -> Option<Intent> {
        self.fine.clear();
        self.gamepad.clear();
        self.pointer = None;
        let hold = self.hold.take()?;
        (hold.action != Action::Orbit).then_some(Intent::Stroke(StrokeIntent::Cancel))
    }

    /// Sets whether the pointer carries something over the table rather than turning the aim.
    pub fn set_carrying(&mut self, is_carrying: bool) {
        self.is_carrying = is_carrying;
    }

    /// Records a position of the pointer outside the table, without an intent.
    pub fn passes(&mut self, at: DVec2) {
        self.pointer = Some(at);
    }

    /// Whether a held action is in progress, such as a stroke.
    pub fn is_holding(&self) -> bool {
        self.hold.is_some()
    }

    fn pointer_moved(&mut self, at: DVec2) -> Option<Intent> {
        let moved = at - self.pointer.replace(at)?;
        let precision = self.precision();
        match &mut self.hold {
            Some(hold) if hold.action == Action::Stroke => {
                hold.drawn = (hold.drawn + moved.y / PULL_POINTS * precision).clamp(0.0, 1.0);
                Some(Intent::Stroke(StrokeIntent::Pull(hold.drawn)))
            }
            Some(hold) if hold.action == Action::Swing => Some(Intent::Stroke(
                StrokeIntent::Swing(moved.y * SWING_M_PER_POINT * precision),
            )),
            Some(hold) if hold.action == Action::Orbit => {
                let MouseSettings {
                    speed,
                    inverts_pitch,
                } = self.mouse;
                let upright = if inverts_pitch { -1.0 } else { 1.0 };
                Some(Intent::Camera(CameraIntent::Orbit {
                    yaw_rad: -moved.x * ORBIT_RAD_PER_POINT * speed,
                    pitch_rad: moved.y * ORBIT_RAD_PER_POINT * speed * upright,
                }))
            }
            Some(_) => None,
            None if self.is_carrying => Some(Intent::Match(MatchIntent::Point(at))),
            None => {
                let turn = -moved.x * AIM_RAD_PER_POINT * self.mouse.speed * precision;
                (turn != 0.0).then_some(Intent::Aim(AimIntent::Turn(turn)))
            }
        }
    }

    fn press_gamepad(&mut self, control: GamepadControl, pressed: bool) -> Option<Intent> {
        if !control.is_analog() {
            self.hold_gamepad(control, f64::from(u8::from(pressed)));
        } else if pressed && self.is_steady(control) {
            return None;
        }
        self.switch(Trigger::Gamepad(control), pressed, false)
    }

    fn hold_gamepad(&mut self, control: GamepadControl, deflection: f64) {
        if deflection > 0.0 {
            let held = self.gamepad.entry(control).or_insert(HeldControl {
                deflection,
                held_secs: 0.0,
            });
            held.deflection = deflection.min(1.0);
        } else {
            self.gamepad.remove(&control);
        }
    }

    /// Whether a stick's direction acts continuously, with a rate by its deflection.
    fn is_steady(&self, control: GamepadControl) -> bool {
        let action = self.bindings.action(Trigger::Gamepad(control), self.mode);
        self.carries(control) || action.is_some_and(Action::repeats)
    }

    /// Whether a control moves what the pointer carries: the left stick.
    fn carries(&self, control: GamepadControl) -> bool {
        self.is_carrying && GamepadControl::LEFT_STICK_TO.contains(&control)
    }

    /// Whether [`Input::elapse`] has held controls to apply.
    pub fn is_steering(&self) -> bool {
        !self.gamepad.is_empty()
    }

    /// The intents of deflected sticks and held gamepad buttons over a time of `secs`. The rate of steps is
    /// proportional to the square of a stick's deflection, for fine control; buttons repeat after
    /// `REPEAT_SECS`.
    pub fn elapse(&mut self, secs: f64) -> Vec<Intent> {
        let secs = secs.clamp(0.0, ELAPSED_SECS_MAX);
        let mut intents = Vec::new();
        let mut carried = DVec2::ZERO;
        let precision = self.precision();
        for held in self.gamepad.values_mut() {
            held.held_secs += secs;
        }
        for (&control, held) in &self.gamepad {
            if self.carries(control) {
                let directions = [DVec2::NEG_X, DVec2::X, DVec2::NEG_Y, DVec2::Y];
                let at = GamepadControl::LEFT_STICK_TO
                    .iter()
                    .position(|to| *to == control);
                carried += directions[at.unwrap_or(0)] * held.deflection.powi(2);
                continue;
            }
            let action = self.bindings.action(Trigger::Gamepad(control), self.mode);
            let Some(action) = action.filter(|action| action.repeats()) else {
                continue;
            };
            if control.is_analog() || held.held_secs > REPEAT_SECS {
                let steps = action.steps_per_sec() * held.deflection.powi(2) * secs;
                intents.extend(action.intent(steps * precision));
            }
        }
        if carried != DVec2::ZERO {
            let from = self.pointer.unwrap_or(CARRIED_FROM);
            let at = from + carried * CARRIED_POINTS_PER_SEC * precision * secs;
            self.pointer = Some(at);
            intents.push(Intent::Match(MatchIntent::Point(at)));
        }
        intents
    }

    fn switch(&mut self, trigger: Trigger, pressed: bool, repeat: bool) -> Option<Intent> {
        if !pressed {
            return self.released(trigger);
        }
        let action = self.bindings.action(trigger, self.mode)?;
        if repeat && !action.repeats() {
            return None;
        }
        match action {
            Action::Stroke | Action::Strike if self.is_carrying => {
                Some(Intent::Match(MatchIntent::Put))
            }
            Action::Fine => {
                self.fine.insert(trigger);
                None
            }
            Action::AimAtPointer if self.hold.is_none() => {
                Some(Intent::Aim(AimIntent::AimAt(self.pointer?)))
            }
            Action::Menu => {
                self.hold = None;
                Some(Intent::App(AppIntent::Escape))
            }
            action if action.is_held() => self.begin(trigger, action),
            action => action.intent(self.precision()),
        }
    }

    fn begin(&mut self, trigger: Trigger, action: Action) -> Option<Intent> {
        if let Some(hold) = self.hold {
            // A second held control is ignored, except that the camera's cancels a stroke.
            let gives_up = action == Action::Orbit && hold.action != Action::Orbit;
            return gives_up.then(|| {
                self.hold = None;
                Intent::Stroke(StrokeIntent::Cancel)
            });
        }
        if action == Action::Stroke {
            // The cue is drawn with the pointer: without one there is no stroke.
            self.pointer?;
        }
        self.hold = Some(Hold {
            trigger,
            action,
            drawn: 0.0,
        });
        match action {
            Action::Stroke => Some(Intent::Stroke(StrokeIntent::BeginPull)),
            Action::Charge => Some(Intent::Stroke(StrokeIntent::BeginCharge)),
            Action::Swing => Some(Intent::Stroke(StrokeIntent::BeginSwing)),
            _ => None,
        }
    }

    fn released(&mut self, trigger: Trigger) -> Option<Intent> {
        self.fine.remove(&trigger);
        let hold = self.hold.take_if(|hold| hold.trigger == trigger)?;
        (hold.action != Action::Orbit).then_some(Intent::Stroke(StrokeIntent::Release))
    }

    fn wheel(&mut self, notches: f64) -> Option<Intent> {
        let trigger = Event::Wheel(notches).trigger()?;
        // A reversal discards the fraction accumulated in the other direction.
        if self.notches * notches < 0.0 {
            self.notches = 0.0;
        }
        let action = self.bindings.action(trigger, self.mode)?;
        if action.repeats() {
            return action.intent(notches.abs() * self.precision());
        }
        self.notches += notches;
        if self.notches.abs() < 1.0 {
            return None;
        }
        self.notches = 0.0;
        self.switch(trigger, true, false)
    }

    fn precision(&self) -> f64 {
        if self.fine.is_empty() { 1.0 } else { FINE }
    }
}

/// Rotation of the aim per point of pointer motion: 147° across a window of 1280 points.
const AIM_RAD_PER_POINT: f64 = 0.002;
const ORBIT_RAD_PER_POINT: f64 = 0.005;
/// Factor of the fine mode.
const FINE: f64 = 0.1;
/// Distance of the pointer from no power to full power.
const PULL_POINTS: f64 = 220.0;
/// Motion of the cue per point of pointer motion in a swing: 1000 points a second strike with 2.5 m/s.
const SWING_M_PER_POINT: f64 = 0.0025;
/// Time after which a held gamepad button begins to repeat.
const REPEAT_SECS: f64 = 0.4;
/// Longest time that held controls are applied over at once, for frames that took longer.
const ELAPSED_SECS_MAX: f64 = 0.1;
/// Start position of a ball in hand carried with a stick if there was no pointer yet, in points.
const CARRIED_FROM: DVec2 = DVec2::new(400.0, 300.0);
const CARRIED_POINTS_PER_SEC: f64 = 500.0;
