//! Intents: commands of the player, grouped by the subject that they concern.

use carom_billiards::rules::{Call, Choice};
use glam::DVec2;

use crate::camera::CameraIntent;

/// Command of the player, routed by its subject.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Intent {
    /// Aim: direction, tip, elevation, power.
    Aim(AimIntent),
    /// Stroke.
    Stroke(StrokeIntent),
    /// Camera.
    Camera(CameraIntent),
    /// Match: calls, choices, the ball in hand, help by the computer.
    Match(MatchIntent),
    /// Replays.
    Replay(ReplayIntent),
    /// Open or leave the practice table.
    TogglePractice,
    /// The program around the game.
    App(AppIntent),
}

/// A change of the aim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AimIntent {
    /// Turn the aim by an angle in radians, positive to the left.
    Turn(f64),
    /// Aim at the point of the table under a point of the window.
    AimAt(DVec2),
    /// Move the contact point of the tip on the cue ball, in ball radii, to the player's right and up.
    MoveTip(DVec2),
    /// Set the contact point of the tip, in ball radii from the centre.
    SetTip(DVec2),
    /// Set the tip to the centre and the cue level.
    CenterTip,
    /// Raise the butt of the cue by an angle in radians.
    Elevate(f64),
    /// Change the power, 0 to 1, by a difference.
    ChangePower(f64),
    /// Set the power, 0 to 1.
    SetPower(f64),
}

/// Step of a stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StrokeIntent {
    /// Begin a stroke whose power is how far the pointer draws the cue back.
    BeginPull,
    /// Draw the cue back to this share of its travel, 0 to 1.
    Pull(f64),
    /// Begin a stroke whose power rises with time.
    BeginCharge,
    /// Begin a stroke in which the cue moves with the pointer, at the pointer's speed.
    BeginSwing,
    /// Move the cue back by a distance in metres during a swing; forward if negative.
    Swing(f64),
    /// Release the control: strike if the cue is drawn back.
    Release,
    /// Strike with the power that is set.
    Strike,
    /// Cancel the stroke.
    Cancel,
}

/// Decision in a match other than a stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MatchIntent {
    /// Rack the balls again.
    Rack,
    /// Pick up a cue ball in hand, or place it.
    PickUp,
    /// Move the carried cue ball to a point of the window.
    Point(DVec2),
    /// Place the cue ball.
    Put,
    /// Call the shot, or withdraw the call.
    Call(Option<Call>),
    /// Select the next possible call, and after the last one none.
    NextCall,
    /// Make a choice that the rules offer.
    Choose(Choice),
    /// Undo the last shot.
    Undo,
    /// Redo the last undone shot.
    Redo,
    /// Skip to the end of the present shot.
    Skip,
    /// Have the computer suggest a shot.
    Suggest,
    /// Have the computer play this shot.
    TakeOver,
}

/// Command to replays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplayIntent {
    /// Open the replay of previous shots, or return to the game.
    Toggle,
    /// Control the open replay.
    Control(ReplayControl),
}

/// Command to the program around the game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppIntent {
    /// Cancel what is in progress or leave what is open, otherwise open the menu.
    Escape,
    /// Save the current view under this index.
    SaveView(u8),
    /// Look from the saved view of this index.
    RecallView(u8),
    /// Select the next level of aiming aids, cyclically.
    NextAids,
    /// Show or hide the log of the match.
    ToggleLog,
    /// Show or hide the keys.
    ToggleHelp,
    /// Show the next level of the statistics.
    ToggleStats,
    /// Switch between full screen and a window.
    ToggleFullscreen,
    /// Take a screenshot in full quality.
    TakeScreenshot,
}

/// Playback control of a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplayControl {
    /// Pause or resume.
    Toggle,
    /// Set the rate: seconds of the shot per second.
    Rate(f64),
    /// Seek to a moment of the shot, in seconds since the stroke.
    Seek(f64),
    /// Seek by a time in seconds; backwards if negative.
    Skip(f64),
    /// Pause at the next or previous event.
    Step {
        /// Whether to go to the next one.
        forward: bool,
    },
    /// Choose a shot of the list by index.
    Pick(usize),
    /// Choose the next or previous shot of the list.
    Turn {
        /// Whether to go to the next one.
        forward: bool,
    },
}

impl ReplayControl {
    /// The offered rates: real time and slow motion.
    pub const RATES: [f64; 3] = [1.0, 0.25, 0.1];
}
