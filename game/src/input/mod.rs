//! From mouse and keys to what the player wants: a pure function of the events so far.
//!
//! ```text
//! Event ─▶ Trigger ─▶ Bindings ─▶ Action ─▶ Intent
//!          what was    the         what it   what the game
//!          pressed     player's    is for    does
//! ```
//!
//! A new control is a variant of [`Action`], a row of [`ACTIONS`] and an arm where it becomes an
//! [`Intent`]; help, settings and README.md follow.

pub mod action;
pub mod binding;
pub mod key;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;

use carom_billiards::rules::{Call, Choice};
use glam::DVec2;

pub use action::{ACTIONS, Action, ActionSpec, BindingContext, Group};
pub use binding::{BindingError, Bindings, Trigger, UnknownTrigger};
pub use key::Key;

use crate::camera::Viewpoint;

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

/// A mouse button.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Button {
    Left,
    Middle,
    Right,
    Back,
    Forward,
}

impl Button {
    /// All.
    pub const ALL: [Self; 5] = [
        Self::Left,
        Self::Middle,
        Self::Right,
        Self::Back,
        Self::Forward,
    ];

    /// For people, and for the settings file.
    pub fn label(self) -> &'static str {
        match self {
            Self::Left => "Mouse left",
            Self::Middle => "Mouse middle",
            Self::Right => "Mouse right",
            Self::Back => "Mouse back",
            Self::Forward => "Mouse forward",
        }
    }
}

/// What the player wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Intent {
    /// Turn the aim by this many radians, left positive.
    Turn(f64),
    /// Aim at the table under this point of the window.
    AimAt(DVec2),
    /// Turn the camera round what it looks at, radians.
    Orbit {
        /// To the left.
        yaw_rad: f64,
        /// Upwards.
        pitch_rad: f64,
    },
    /// Multiply the camera's distance.
    Zoom(f64),
    /// Look from the next of the views.
    NextView,
    /// Look from above, or go back behind the cue.
    Overhead,
    /// Keep what is seen as the saved view of this place.
    KeepView(u8),
    /// Look from the saved view of this place.
    RecallView(u8),
    /// Look from here.
    LookFrom(Viewpoint),
    /// Begin a stroke with the cue drawn back by hand.
    BeginPull,
    /// Draw the cue back to this share of its way, 0 to 1.
    Pull(f64),
    /// Begin a stroke whose power rises with time.
    BeginCharge,
    /// Take the cue in hand, for a stroke with the hand's own speed.
    BeginSwing,
    /// Move the cue that is in hand back by so many metres; forward if negative.
    Swing(f64),
    /// Let go: strike if the cue is drawn back.
    Release,
    /// Strike with the power that is set.
    Strike,
    /// Give up the stroke.
    Cancel,
    /// Give up the stroke if one is begun, else leave the table: for the menu.
    Escape,
    /// Move the tip on the cue ball, in ball radii, to the player's right and up.
    MoveTip(DVec2),
    /// Put the tip there on the cue ball.
    SetTip(DVec2),
    /// Put the tip in the middle and lay the cue level.
    CenterTip,
    /// Raise the butt of the cue by this many radians.
    Elevate(f64),
    /// Change the power that is set, 0 to 1, by so much.
    ChangePower(f64),
    /// Set the power, 0 to 1.
    SetPower(f64),
    /// Show more of the shot to come, and after all of it nothing.
    NextAids,
    /// Rack the balls again.
    Rack,
    /// Watch shots of before, or go back to the game.
    LookBack,
    /// Turn a replay's time, or show another of its shots.
    Watch(ReplayControl),
    /// Lay the balls, or leave them as they were.
    Practise,
    /// Take a picture in full quality.
    Photograph,
    /// Take up a cue ball that is in hand, or put it down.
    PickUp,
    /// Hold the cue ball over this point of the window.
    Point(DVec2),
    /// Put the cue ball down.
    Put,
    /// Say what the shot is to do, or take it back.
    Call(Option<Call>),
    /// The next call, after the last none.
    NextCall,
    /// Decide what the rules leave to the player.
    Choose(Choice),
    /// Take the last shot back.
    Undo,
    /// Let the balls rest at once where the shot that is on leaves them.
    Skip,
    /// Have the computer suggest a shot.
    Suggest,
    /// Have the computer play this shot.
    TakeOver,
    /// Show or hide what was said so far.
    ToggleLog,
    /// Show or hide the keys.
    ToggleHelp,
    /// Show or hide the statistics.
    ToggleStats,
    /// Fill the screen, or go back to a window.
    ToggleFullscreen,
}

/// What a viewer may want of a shot of before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplayControl {
    /// To stop, or to go on.
    Toggle,
    /// Another speed: seconds of the shot in a second.
    Rate(f64),
    /// Another moment of the shot, seconds since the stroke.
    Seek(f64),
    /// The moment so many seconds later; earlier if negative.
    Skip(f64),
    /// The next event, or the one before.
    Step {
        /// Whether the next one.
        forward: bool,
    },
    /// Another shot of the list.
    Pick(usize),
    /// The next shot of the list, or the one before.
    Turn {
        /// Whether the next one.
        forward: bool,
    },
}

impl ReplayControl {
    /// The rates that are offered: real time and slow motion.
    pub const RATES: [f64; 3] = [1.0, 0.25, 0.1];
}

/// What is bound, what is held, and since where.
#[derive(Clone, Debug, Default)]
pub struct Input {
    bindings: Bindings,
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
        (hold.action != Action::Orbit).then_some(Intent::Cancel)
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
                Some(Intent::Pull(hold.drawn))
            }
            Some(hold) if hold.action == Action::Swing => {
                Some(Intent::Swing(moved.y * SWING_M_PER_POINT * precision))
            }
            Some(hold) if hold.action == Action::Orbit => Some(Intent::Orbit {
                yaw_rad: -moved.x * ORBIT_RAD_PER_POINT,
                pitch_rad: moved.y * ORBIT_RAD_PER_POINT,
            }),
            Some(_) => None,
            None if self.is_carrying => Some(Intent::Point(at)),
            None => {
                let turn = -moved.x * AIM_RAD_PER_POINT * precision;
                (turn != 0.0).then_some(Intent::Turn(turn))
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
            Action::Stroke if self.is_carrying => Some(Intent::Put),
            Action::Fine => {
                self.fine.insert(trigger);
                None
            }
            Action::AimAtPointer if self.hold.is_none() => Some(Intent::AimAt(self.pointer?)),
            Action::Menu => {
                self.hold = None;
                Some(Intent::Escape)
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
                Intent::Cancel
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
            Action::Stroke => Some(Intent::BeginPull),
            Action::Charge => Some(Intent::BeginCharge),
            Action::Swing => Some(Intent::BeginSwing),
            _ => None,
        }
    }

    fn released(&mut self, trigger: Trigger) -> Option<Intent> {
        self.fine.remove(&trigger);
        let hold = self.hold.take_if(|hold| hold.trigger == trigger)?;
        (hold.action != Action::Orbit).then_some(Intent::Release)
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
