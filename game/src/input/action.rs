//! The actions of the game, with their names and default bindings; `en.ftl` has their descriptions.
//!
//! Settings, the help, the legend of keys and the table in README.md are generated from [`ACTIONS`].

use carom_text::text;

use super::intent::{
    AimIntent, AppIntent, Intent, MatchIntent, ReplayControl, ReplayIntent, StrokeIntent,
};
use crate::camera::CameraIntent;

/// Function of the game that a key, a button, the wheel or a gamepad's control can be bound to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[expect(missing_docs, reason = "each is described in a row of ACTIONS")]
pub enum Action {
    AimLeft,
    AimRight,
    AimAtPointer,
    Fine,
    Aids,
    Stroke,
    Charge,
    Swing,
    Strike,
    PowerUp,
    PowerDown,
    TipUp,
    TipDown,
    TipLeft,
    TipRight,
    TipCenter,
    CueUp,
    CueDown,
    Orbit,
    LookDown,
    LookUp,
    LookLeft,
    LookRight,
    ZoomIn,
    ZoomOut,
    NextView,
    Overhead,
    /// Recalls a saved view, by index below [`crate::camera::SAVED_MAX`].
    SavedView(u8),
    KeepView(u8),
    Rack,
    PickUp,
    CallNext,
    Undo,
    Redo,
    Skip,
    Suggest,
    TakeOver,
    Log,
    LookBack,
    Practise,
    Photograph,
    Help,
    Stats,
    Fullscreen,
    Menu,
    ReplayPause,
    ReplayBack,
    ReplayForward,
    ReplayEventBefore,
    ReplayEventNext,
    ReplayShotBefore,
    ReplayShotNext,
    /// Sets a rate, by index in [`ReplayControl::RATES`].
    ReplaySpeed(u8),
}

/// Context in which bindings apply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum BindingContext {
    /// The table.
    #[default]
    Table,
    /// A replay: its own bindings, and those of the table whose triggers it does not use.
    Replay,
}

/// Row of the action map.
#[derive(Clone, Copy, Debug)]
pub struct ActionSpec {
    /// The action.
    pub action: Action,
    /// Its name in the settings file.
    pub name: &'static str,
    /// Its heading.
    pub group: Group,
    /// Labels of its default triggers, those of a gamepad last. The directional pad and A of a gamepad are
    /// bound in replays too.
    pub defaults: &'static [&'static str],
}

/// Heading of the help.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Direction of the cue.
    Aim,
    /// The stroke.
    Stroke,
    /// Contact point of the tip on the ball, and elevation of the cue.
    Spin,
    /// The camera.
    View,
    /// The game and the program.
    Game,
    /// Replays.
    Replay,
}

impl ActionSpec {
    /// Description of the action in the interface's language.
    pub fn does(&self) -> &'static str {
        text!(&format!("control-{}", self.name))
    }
}

impl Group {
    /// All headings, in the order of the help.
    pub const ALL: [Self; 6] = [
        Self::Aim,
        Self::Stroke,
        Self::Spin,
        Self::View,
        Self::Game,
        Self::Replay,
    ];

    /// Title of the heading.
    pub fn title(self) -> &'static str {
        text!(match self {
            Self::Aim => "controls-aim",
            Self::Stroke => "controls-stroke",
            Self::Spin => "controls-spin",
            Self::View => "controls-view",
            Self::Game => "controls-game",
            Self::Replay => "controls-replay",
        })
    }

    /// The rows under this heading.
    pub fn controls(self) -> impl Iterator<Item = &'static ActionSpec> {
        ACTIONS.iter().filter(move |control| control.group == self)
    }
}

impl Action {
    /// Its row of [`ACTIONS`].
    pub fn control(self) -> &'static ActionSpec {
        let mut rows = ACTIONS.iter();
        // A test checks that every action has a row.
        rows.find(|row| row.action == self).unwrap_or(&ACTIONS[0])
    }

    /// The action with this name in the settings file.
    pub fn from_name(name: &str) -> Option<Self> {
        let row = ACTIONS.iter().find(|control| control.name == name)?;
        Some(row.action)
    }

    /// The context of its bindings.
    pub fn mode(self) -> BindingContext {
        match self.control().group {
            Group::Replay => BindingContext::Replay,
            _ => BindingContext::Table,
        }
    }

    /// Whether it lasts as long as its trigger is held, so that it cannot be bound to the wheel.
    pub fn is_held(self) -> bool {
        matches!(
            self,
            Self::Fine | Self::Stroke | Self::Charge | Self::Swing | Self::Orbit
        )
    }

    /// The intent of `steps` presses, notches of the wheel or key repetitions; a step is scaled by 0.1 in
    /// fine mode. None for actions that are held or need the pointer.
    pub(crate) fn intent(self, steps: f64) -> Option<Intent> {
        let tip = |x: f64, y: f64| {
            Intent::Aim(AimIntent::MoveTip(
                glam::DVec2::new(x, y) * steps * TIP_STEP_RADII,
            ))
        };
        Some(match self {
            Self::AimLeft => Intent::Aim(AimIntent::Turn(steps * AIM_STEP_RAD)),
            Self::AimRight => Intent::Aim(AimIntent::Turn(-steps * AIM_STEP_RAD)),
            Self::TipUp => tip(0.0, 1.0),
            Self::TipDown => tip(0.0, -1.0),
            Self::TipLeft => tip(-1.0, 0.0),
            Self::TipRight => tip(1.0, 0.0),
            Self::CueUp => Intent::Aim(AimIntent::Elevate(steps * ELEVATION_STEP_RAD)),
            Self::CueDown => Intent::Aim(AimIntent::Elevate(-steps * ELEVATION_STEP_RAD)),
            Self::SavedView(place) => Intent::App(AppIntent::RecallView(place)),
            Self::KeepView(place) => Intent::App(AppIntent::SaveView(place)),
            Self::PowerUp => Intent::Aim(AimIntent::ChangePower(steps * POWER_STEP)),
            Self::PowerDown => Intent::Aim(AimIntent::ChangePower(-steps * POWER_STEP)),
            Self::Strike => Intent::Stroke(StrokeIntent::Strike),
            Self::Aids => Intent::App(AppIntent::NextAids),
            Self::TipCenter => Intent::Aim(AimIntent::CenterTip),
            Self::Rack => Intent::Match(MatchIntent::Rack),
            Self::PickUp => Intent::Match(MatchIntent::PickUp),
            Self::CallNext => Intent::Match(MatchIntent::NextCall),
            Self::Undo => Intent::Match(MatchIntent::Undo),
            Self::Redo => Intent::Match(MatchIntent::Redo),
            Self::Skip => Intent::Match(MatchIntent::Skip),
            Self::Suggest => Intent::Match(MatchIntent::Suggest),
            Self::TakeOver => Intent::Match(MatchIntent::TakeOver),
            Self::Log => Intent::App(AppIntent::ToggleLog),
            Self::LookBack => Intent::Replay(ReplayIntent::Toggle),
            Self::Practise => Intent::TogglePractice,
            Self::Photograph => Intent::App(AppIntent::TakeScreenshot),
            Self::Help => Intent::App(AppIntent::ToggleHelp),
            Self::Stats => Intent::App(AppIntent::ToggleStats),
            Self::Fullscreen => Intent::App(AppIntent::ToggleFullscreen),
            Self::Menu => Intent::App(AppIntent::Escape),
            // Held actions have no intent here; a test checks that all others do.
            _ => {
                let control = |control| Intent::Replay(ReplayIntent::Control(control));
                let of_replay = self.replay_control(steps).map(control);
                return of_replay.or_else(|| self.camera_intent(steps).map(Intent::Camera));
            }
        })
    }

    fn camera_intent(self, steps: f64) -> Option<CameraIntent> {
        let orbit = |yaw: f64, pitch: f64| CameraIntent::Orbit {
            yaw_rad: yaw * steps * YAW_STEP_RAD,
            pitch_rad: pitch * steps * PITCH_STEP_RAD,
        };
        Some(match self {
            Self::LookDown => orbit(0.0, 1.0),
            Self::LookUp => orbit(0.0, -1.0),
            Self::LookLeft => orbit(1.0, 0.0),
            Self::LookRight => orbit(-1.0, 0.0),
            Self::ZoomIn => CameraIntent::Zoom(ZOOM_STEP.powf(-steps)),
            Self::ZoomOut => CameraIntent::Zoom(ZOOM_STEP.powf(steps)),
            Self::NextView => CameraIntent::NextView,
            Self::Overhead => CameraIntent::Overhead,
            _ => return None,
        })
    }

    fn replay_control(self, steps: f64) -> Option<ReplayControl> {
        Some(match self {
            Self::ReplayPause => ReplayControl::Toggle,
            Self::ReplayBack => ReplayControl::Skip(-steps * SKIP_SECS),
            Self::ReplayForward => ReplayControl::Skip(steps * SKIP_SECS),
            Self::ReplayEventBefore => ReplayControl::Step { forward: false },
            Self::ReplayEventNext => ReplayControl::Step { forward: true },
            Self::ReplayShotBefore => ReplayControl::Turn { forward: false },
            Self::ReplayShotNext => ReplayControl::Turn { forward: true },
            Self::ReplaySpeed(place) => {
                ReplayControl::Rate(*ReplayControl::RATES.get(usize::from(place))?)
            }
            _ => return None,
        })
    }

    /// Whether it repeats while its key is held.
    pub(super) fn repeats(self) -> bool {
        matches!(
            self,
            Self::AimLeft
                | Self::AimRight
                | Self::PowerUp
                | Self::PowerDown
                | Self::TipUp
                | Self::TipDown
                | Self::TipLeft
                | Self::TipRight
                | Self::CueUp
                | Self::CueDown
                | Self::LookDown
                | Self::LookUp
                | Self::LookLeft
                | Self::LookRight
                | Self::ZoomIn
                | Self::ZoomOut
                | Self::ReplayBack
                | Self::ReplayForward
                | Self::ReplayEventBefore
                | Self::ReplayEventNext
        )
    }
}

const fn row(
    group: Group,
    action: Action,
    name: &'static str,
    defaults: &'static [&'static str],
) -> ActionSpec {
    ActionSpec {
        action,
        name,
        group,
        defaults,
    }
}

/// The action map. Turning the aim with the mouse has no binding.
#[rustfmt::skip]
pub const ACTIONS: &[ActionSpec] = &[
    row(Group::Aim, Action::AimLeft, "aim-left", &["Left", "Left stick left"]),
    row(Group::Aim, Action::AimRight, "aim-right", &["Right", "Left stick right"]),
    row(Group::Aim, Action::AimAtPointer, "aim-at-pointer", &["Mouse middle"]),
    row(Group::Aim, Action::Fine, "fine", &["Left Ctrl", "Left Shift", "Right Ctrl", "Right Shift", "Gamepad LT"]),
    row(Group::Aim, Action::Aids, "aim-aids", &["T", "Gamepad left stick"]),
    row(Group::Stroke, Action::Stroke, "stroke", &["Mouse left"]),
    row(Group::Stroke, Action::Charge, "charge", &["Space", "Gamepad RT"]),
    row(Group::Stroke, Action::Swing, "swing", &["F"]),
    row(Group::Stroke, Action::Strike, "strike", &["Enter", "Pad Enter", "Gamepad A"]),
    row(Group::Stroke, Action::PowerUp, "power-up", &["=", "Pad +", "Gamepad RB"]),
    row(Group::Stroke, Action::PowerDown, "power-down", &["-", "Pad -", "Gamepad LB"]),
    row(Group::Spin, Action::TipUp, "tip-up", &["W", "Gamepad up"]),
    row(Group::Spin, Action::TipDown, "tip-down", &["S", "Gamepad down"]),
    row(Group::Spin, Action::TipLeft, "tip-left", &["A", "Gamepad left"]),
    row(Group::Spin, Action::TipRight, "tip-right", &["D", "Gamepad right"]),
    row(Group::Spin, Action::TipCenter, "tip-center", &["X", "Gamepad right stick"]),
    row(Group::Spin, Action::CueUp, "cue-up", &["Q"]),
    row(Group::Spin, Action::CueDown, "cue-down", &["E"]),
    row(Group::View, Action::Orbit, "orbit", &["Mouse right"]),
    row(Group::View, Action::LookDown, "look-down", &["Up", "Right stick down"]),
    row(Group::View, Action::LookUp, "look-up", &["Down", "Right stick up"]),
    row(Group::View, Action::LookLeft, "look-left", &["[", "Right stick left"]),
    row(Group::View, Action::LookRight, "look-right", &["]", "Right stick right"]),
    row(Group::View, Action::ZoomIn, "zoom-in", &["Wheel up", "Page up", "Left stick up"]),
    row(Group::View, Action::ZoomOut, "zoom-out", &["Wheel down", "Page down", "Left stick down"]),
    row(Group::View, Action::NextView, "next-view", &["V", "Gamepad Y"]),
    row(Group::View, Action::Overhead, "overhead", &["O"]),
    row(Group::View, Action::SavedView(0), "view-1", &["1"]),
    row(Group::View, Action::SavedView(1), "view-2", &["2"]),
    row(Group::View, Action::SavedView(2), "view-3", &["3"]),
    row(Group::View, Action::SavedView(3), "view-4", &["4"]),
    row(Group::View, Action::KeepView(0), "keep-view-1", &["5"]),
    row(Group::View, Action::KeepView(1), "keep-view-2", &["6"]),
    row(Group::View, Action::KeepView(2), "keep-view-3", &["7"]),
    row(Group::View, Action::KeepView(3), "keep-view-4", &["8"]),
    row(Group::Game, Action::PickUp, "pick-up", &["B", "Gamepad B"]),
    row(Group::Game, Action::CallNext, "call", &["C", "Gamepad X"]),
    row(Group::Game, Action::Undo, "undo", &["U"]),
    row(Group::Game, Action::Redo, "redo", &["Y"]),
    row(Group::Game, Action::Skip, "skip", &["Z"]),
    row(Group::Game, Action::Suggest, "suggest", &["F9", "Gamepad back"]),
    row(Group::Game, Action::TakeOver, "take-over", &["F6"]),
    row(Group::Game, Action::Log, "log", &["L"]),
    row(Group::Game, Action::Rack, "rack", &["R"]),
    row(Group::Game, Action::LookBack, "look-back", &["F4"]),
    row(Group::Game, Action::Practise, "practise", &["F5"]),
    row(Group::Game, Action::Photograph, "photograph", &["F12"]),
    row(Group::Game, Action::Help, "help", &["F1", "H"]),
    row(Group::Game, Action::Stats, "stats", &["F3"]),
    row(Group::Game, Action::Fullscreen, "fullscreen", &["F11"]),
    row(Group::Game, Action::Menu, "menu", &["Esc", "Gamepad start"]),
    row(Group::Replay, Action::ReplayPause, "replay-pause", &["Space", "Gamepad A"]),
    row(Group::Replay, Action::ReplayBack, "replay-back", &["Left", "Gamepad left"]),
    row(Group::Replay, Action::ReplayForward, "replay-forward", &["Right", "Gamepad right"]),
    row(Group::Replay, Action::ReplayEventBefore, "replay-event-before", &[",", "Gamepad LB"]),
    row(Group::Replay, Action::ReplayEventNext, "replay-event-next", &[".", "Gamepad RB"]),
    row(Group::Replay, Action::ReplayShotBefore, "replay-shot-before", &["P", "Gamepad up"]),
    row(Group::Replay, Action::ReplayShotNext, "replay-shot-next", &["N", "Gamepad down"]),
    row(Group::Replay, Action::ReplaySpeed(0), "replay-speed-1", &["1"]),
    row(Group::Replay, Action::ReplaySpeed(1), "replay-speed-2", &["2"]),
    row(Group::Replay, Action::ReplaySpeed(2), "replay-speed-3", &["3"]),
];

const AIM_STEP_RAD: f64 = std::f64::consts::PI / 180.0;
/// Step of the elevation: 2.5°.
const ELEVATION_STEP_RAD: f64 = 0.043_633;
const POWER_STEP: f64 = 0.05;
const PITCH_STEP_RAD: f64 = 0.04;
const YAW_STEP_RAD: f64 = 0.05;
const TIP_STEP_RADII: f64 = 0.05;
const ZOOM_STEP: f64 = 1.1;
/// Time of a replay that a key press skips.
const SKIP_SECS: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_sentences_are_of_one_action_each() {
        for (i, control) in ACTIONS.iter().enumerate() {
            assert_eq!(Action::from_name(control.name), Some(control.action));
            assert_eq!(control.action.control().name, control.name);
            let others = ACTIONS.iter().skip(i + 1);
            others.for_each(|other| assert_ne!(other.does(), control.does()));
            assert!(!control.does().is_empty(), "{}", control.name);
            assert!(!control.defaults.is_empty(), "{}", control.name);
        }
        let grouped: usize = Group::ALL
            .map(|group| group.controls().count())
            .iter()
            .sum();
        assert_eq!(grouped, ACTIONS.len());
    }

    #[test]
    fn every_saved_view_has_its_two_keys() {
        for place in 0..crate::camera::SAVED_MAX as u8 {
            for action in [Action::SavedView(place), Action::KeepView(place)] {
                assert_eq!(action.control().action, action);
            }
        }
    }

    #[test]
    fn an_action_is_held_or_pressed() {
        for control in ACTIONS {
            let pressed = control.action.intent(1.0).is_some();
            let special = control.action.is_held() || control.action == Action::AimAtPointer;
            assert!(pressed != special, "{}", control.name);
        }
    }
}
