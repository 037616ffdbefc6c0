//! Input of mouse and keys as intents: a pure function of the events so far.
//!
//! ```text
//! Event ─▶ Trigger ─▶ Bindings ─▶ Action ─▶ Intent
//!          what was    the         what it   what the game
//!          pressed     player's    is for    does
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

/// Something that happened at the window, in the words of no windowing library.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The pointer is here, in points from the window's top left.
    Pointer(DVec2),
    /// The pointer has left the window.
    PointerLeft,
    /// A button went down or up.
    Button {
        /// Which.
        button: Button,
        /// Down.
        pressed: bool,
    },
    /// The wheel turned by this many notches away from the player.
    Wheel(f64),
    /// A key went down, up, or repeats while held.
    Key {
        /// Which.
        key: Key,
        /// Down.
        pressed: bool,
        /// By being held.
        repeat: bool,
    },
    /// A button of a gamepad went down or up, or a stick passed half of its way in a direction.
    Gamepad {
        /// Which.
        control: GamepadControl,
        /// Down.
        pressed: bool,
    },
    /// A stick is pushed this far in a direction, 0 to 1.
    Stick {
        /// The direction.
        control: GamepadControl,
        /// How far.
        deflection: f64,
    },
    /// Keys and buttons may come up unseen from now on.
    FocusLost,
}

/// How the mouse turns the aim and the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MouseSettings {
    /// How far, over what is usual, [`MouseSettings::SPEED`].
    pub speed: f64,
    /// Whether the camera looks up when the mouse is drawn towards the player.
    pub inverts_pitch: bool,
}

impl MouseSettings {
    /// The slowest and the fastest.
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

/// What is bound, what is held, and since where.
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
    /// Parts of a notch of the wheel, for actions that are done once.
    notches: f64,
    /// Sticks that are pushed and buttons of a gamepad that are held, by how far and since how many seconds.
    gamepad: BTreeMap<GamepadControl, HeldControl>,
}

/// A control of a gamepad that is held.
#[derive(Clone, Copy, Debug, PartialEq)]
struct HeldControl {
    /// 0 to 1, of which buttons have the end.
    deflection: f64,
    held_secs: f64,
}

/// An action that lasts while its trigger is held.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hold {
    trigger: Trigger,
    action: Action,
    /// How far a stroke is drawn, 0 to 1.
    drawn: f64,
}

impl Event {
    /// What was pressed or turned, if anything was.
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
    /// Nothing is held.
    pub fn new(bindings: Bindings) -> Self {
        Self {
            bindings,
            ..Self::default()
        }
    }

    /// Sets how the mouse turns the aim and the camera; nothing that is held is let go.
    pub fn set_mouse(&mut self, mouse: MouseSettings) {
        self.mouse = mouse;
    }

    /// What is bound to what.
    pub fn bindings(&self) -> &Bindings {
        &self.bindings
    }

    /// Says what is on show, whose keys count.
    pub fn set_mode(&mut self, mode: BindingContext) {
        self.mode = mode;
    }

    /// What `event` means.
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

    /// Forgets what is held, as if it had come up; a stroke is given up.
    pub fn let_go(&mut self) -> Option<Intent> {
        self.fine.clear();
        self.gamepad.clear();
        self.pointer = None;
        let hold = self.hold.take()?;
        (hold.action != Action::Orbit).then_some(Intent::Stroke(StrokeIntent::Cancel))
    }

    /// Lets the pointer carry something over the table, in place of turning the aim.
    pub fn set_carrying(&mut self, is_carrying: bool) {
        self.is_carrying = is_carrying;
    }

    /// Takes note of a pointer that moves over something else than the table: it turns nothing.
    pub fn passes(&mut self, at: DVec2) {
        self.pointer = Some(at);
    }

    /// Whether an action lasts, such as a stroke.
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

    /// Whether a stick's direction does something for as long as it is pushed, more the further it is.
    fn is_steady(&self, control: GamepadControl) -> bool {
        let action = self.bindings.action(Trigger::Gamepad(control), self.mode);
        self.carries(control) || action.is_some_and(Action::repeats)
    }

    /// Whether the left stick moves what the pointer carries.
    fn carries(&self, control: GamepadControl) -> bool {
        self.is_carrying && GamepadControl::LEFT_STICK_TO.contains(&control)
    }

    /// Whether [`Input::elapse`] has something to do.
    pub fn is_steering(&self) -> bool {
        !self.gamepad.is_empty()
    }

    /// What sticks and held buttons of a gamepad mean for a time of `secs`: steps at a rate of the square of how far a
    /// stick is pushed, and of buttons after [`REPEAT_SECS`].
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

/// A window of 1280 points turns the aim by 147°.
const AIM_RAD_PER_POINT: f64 = 0.002;
const ORBIT_RAD_PER_POINT: f64 = 0.005;
const FINE: f64 = 0.1;
/// The way of the pointer from no power to full power.
const PULL_POINTS: f64 = 220.0;
/// A mouse that moves 1000 points a second strikes with 2.5 m/s.
const SWING_M_PER_POINT: f64 = 0.0025;
/// How long a button of a gamepad is held until it repeats, as a key does.
const REPEAT_SECS: f64 = 0.4;
/// A frame that took longer, while a window was hidden for example, turns nothing by more.
const ELAPSED_SECS_MAX: f64 = 0.1;
/// Where a ball in hand is carried from by a stick if there was no pointer yet, in points.
const CARRIED_FROM: DVec2 = DVec2::new(400.0, 300.0);
const CARRIED_POINTS_PER_SEC: f64 = 500.0;
