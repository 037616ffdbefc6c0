//! Intents: what the player wants, grouped by the subject that it concerns.

use carom_billiards::rules::{Call, Choice};
use glam::DVec2;

use crate::camera::CameraIntent;

/// Something that the player wants, routed once by its subject.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Intent {
    /// Of the aim: direction, tip, elevation, power.
    Aim(AimIntent),
    /// Of the stroke.
    Stroke(StrokeIntent),
    /// Of the camera.
    Camera(CameraIntent),
    /// Of the match: calls, choices, the ball in hand, help by the computer.
    Match(MatchIntent),
    /// Of replays.
    Replay(ReplayIntent),
    /// Arrange the balls, or leave them as they were.
    TogglePractice,
    /// Of the program around the game.
    App(AppIntent),
}

/// A change of the aim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AimIntent {
    /// Turn the aim by this many radians, left positive.
    Turn(f64),
    /// Aim at the table under this point of the window.
    AimAt(DVec2),
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
}

/// A step of a stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StrokeIntent {
    /// Begin a stroke with the cue drawn back by hand.
    BeginPull,
    /// Draw the cue back to this share of its travel, 0 to 1.
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
}

/// A decision in a match that is no stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MatchIntent {
    /// Rack the balls again.
    Rack,
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
    /// Take the last undo back.
    Redo,
    /// Let the balls rest at once where the shot that is on leaves them.
    Skip,
    /// Have the computer suggest a shot.
    Suggest,
    /// Have the computer play this shot.
    TakeOver,
}

/// A wish that concerns replays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplayIntent {
    /// Open the replay of previous shots, or go back to the game.
    Toggle,
    /// Control the replay that is open.
    Control(ReplayControl),
}

/// A wish that concerns the program around the game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppIntent {
    /// Give up what is begun or leave what is open, else open the menu.
    Escape,
    /// Keep the current view as the saved view of this number.
    SaveView(u8),
    /// Look from the saved view of this number.
    RecallView(u8),
    /// Show more of the shot to come, and after all of it nothing.
    NextAids,
    /// Show or hide the log of the match.
    ToggleLog,
    /// Show or hide the keys.
    ToggleHelp,
    /// Show the next level of the statistics.
    ToggleStats,
    /// Fill the screen, or go back to a window.
    ToggleFullscreen,
    /// Take a screenshot in full quality.
    TakeScreenshot,
}

/// Playback control of a replay.
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
