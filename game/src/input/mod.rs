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
mod intent;
pub mod key;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use glam::DVec2;

pub use action::{ACTIONS, Action, ActionSpec, BindingContext, Group};
pub use binding::{BindingError, Bindings, Trigger, UnknownTrigger};
pub use intent::{
    AimIntent, AppIntent, Intent, MatchIntent, PracticeIntent, ReplayControl, ReplayIntent,
    StrokeIntent,
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
            Event::Wheel(notches) => self.wheel(notches),
            Event::FocusLost => self.let_go(),
        }
    }

    /// Forgets what is held, as if it had come up; a stroke is given up.
    pub fn let_go(&mut self) -> Option<Intent> {
        self.fine.clear();
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

    fn switch(&mut self, trigger: Trigger, pressed: bool, repeat: bool) -> Option<Intent> {
        if !pressed {
            return self.released(trigger);
        }
        let action = self.bindings.action(trigger, self.mode)?;
        if repeat && !action.repeats() {
            return None;
        }
        match action {
            Action::Stroke if self.is_carrying => Some(Intent::Match(MatchIntent::Put)),
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
