//! The game's error types, whose messages are sentences for the player.

use std::io;
use std::path::PathBuf;

use carom_text::text;

use crate::input::UnknownTrigger;

/// Result of the game's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Failure of a player's request.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Error of the physics, the rules or a recording.
    #[error(transparent)]
    Billiards(#[from] carom_billiards::Error),
    /// The practice table cannot be arranged like this.
    #[error(transparent)]
    Practice(#[from] PracticeFault),
    /// The system names no folder for the player's files.
    #[error("no folder for files: could not locate home directory")]
    NoFolder,
    /// A folder cannot be read.
    #[error("{}: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file cannot be written, or its folder cannot be created.
    #[error("{}", text!("file-not-written", path = path.display().to_string(), why = source.to_string()))]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// All numbers for files of a kind are in use.
    #[error("{} has {files_max} files of this kind: move some away", path.display())]
    FolderFull {
        /// The folder.
        path: PathBuf,
        /// Largest number.
        files_max: u32,
    },
    /// The default output file exists, and was not named explicitly.
    #[error("{} is there already: name it with --out to replace it, or name another file", _0.display())]
    InTheWay(PathBuf),
    /// The settings cannot be saved.
    #[error("{} cannot be written: {source}", path.display())]
    Settings {
        /// The settings file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A layout is for another table, named here.
    #[error("{}", text!("layout-other-table", table = _0.as_str()))]
    OtherTable(String),
    /// Error of the farm.
    #[error("{}", text!("farm-error", why = .0.to_string()))]
    Farm(#[from] carom_farm::Error),
    /// The thread of a capture cannot be started.
    #[error("{}", text!("render-not-started", why = .0.to_string()))]
    CaptureThread(io::Error),
    /// The name has an ending of no known kind of video.
    #[error(
        "`{0}` is no film: give a name that ends in .mp4, .webm, .mkv or .gif (with ffmpeg \
         installed), in .y4m, in .png for an animation, or a folder"
    )]
    VideoKind(String),
    /// The name's kind of video needs ffmpeg, which is not installed.
    #[error(
        "`{0}` needs ffmpeg, which is not installed (on Debian or Ubuntu: `apt install ffmpeg`): \
         install it, or give a name that ends in .y4m, in .png for an animation, or a folder"
    )]
    FfmpegMissing(String),
}

/// Reason why a ball of the practice table cannot be added, removed or placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PracticeFault {
    /// The position is occupied.
    #[error("{}", text!("practice-not-clear"))]
    NotClear,
    /// The ball to be added is on the table.
    #[error("{}", text!("practice-on-table", ball = text!("ball", number = *_0)))]
    OnTable(u8),
    /// The ball to be removed is not on the table.
    #[error("{}", text!("practice-not-on-table", ball = text!("ball", number = *_0)))]
    NotOnTable(u8),
    /// There is no free position for the ball.
    #[error("{}", text!("practice-no-room", ball = text!("ball", number = *_0)))]
    NoRoom(u8),
}

/// Expected value of a setting that is invalid; the message continues "it must be".
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingFault {
    /// A whole number within a range.
    #[error("a whole number from {min} to {max}")]
    WholeNumber {
        /// Least value.
        min: u32,
        /// Greatest value.
        max: u32,
    },
    /// A number within a range.
    #[error("a number from {min} to {max}")]
    Number {
        /// Least value.
        min: f64,
        /// Greatest value.
        max: f64,
    },
    /// A Boolean.
    #[error("true or false")]
    Switch,
    /// One of a closed set.
    #[error("\"{}\"", names.join("\", \""))]
    Choice {
        /// The allowed names.
        names: Vec<String>,
    },
    /// The name of a physics engine.
    #[error("\"exact\" or \"rapier-N\" with N from 30 to 10000")]
    Engine,
    /// A saved view.
    #[error("{{}} or a table in a line with {}", parts.join(", "))]
    View {
        /// Each part of a view with its range.
        parts: Vec<String>,
    },
    /// A value rather than a TOML table.
    #[error("a value, not a table")]
    Table,
}

/// Reason why the keys of an action cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KeysFault {
    /// Neither a string nor an array.
    #[error("must be a key or a list of keys, such as [\"R\", \"F5\"]")]
    NotAList,
    /// An array with elements that are not strings.
    #[error("must be a list of keys in quotes")]
    NotInQuotes,
    /// There is no key of this name.
    #[error(transparent)]
    Unknown(#[from] UnknownTrigger),
}
