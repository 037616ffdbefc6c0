//! The game's error: what hinders, with the values that do, as a sentence for the player.

use std::io;
use std::path::PathBuf;

use carom_text::text;

use crate::input::UnknownTrigger;

/// The game's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A wish of the player's that cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The physics, the rules or a recording forbid it.
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
    /// A file cannot be written, or the folder that it belongs in cannot be made.
    #[error("{}", text!("file-not-written", path = path.display().to_string(), why = source.to_string()))]
    Unwritable {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// All numbers for files of a kind are given away.
    #[error("{} has {files_max} files of this kind: move some away", path.display())]
    FolderFull {
        /// The folder.
        path: PathBuf,
        /// As many as there are numbers.
        files_max: u32,
    },
    /// A file that nobody has named to be written is there already.
    #[error("{} is there already: name it with --out to replace it, or name another file", _0.display())]
    InTheWay(PathBuf),
    /// The settings cannot be saved.
    #[error("{} cannot be written: {source}", path.display())]
    Settings {
        /// Their file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A layout is for this table, and another is played on.
    #[error("{}", text!("layout-other-table", table = _0.as_str()))]
    OtherTable(String),
    /// The farm does not take what it is asked for.
    #[error("{}", text!("farm-error", why = .0.to_string()))]
    Farm(#[from] carom_farm::Error),
    /// The system gives no thread.
    #[error("{}", text!("render-not-started", why = .0.to_string()))]
    CaptureThread(io::Error),
    /// No kind of video has this name.
    #[error(
        "`{0}` is no film: give a name that ends in .mp4, .webm, .mkv or .gif (with ffmpeg \
         installed), in .y4m, in .png for an animation, or a folder"
    )]
    VideoKind(String),
    /// A video of this name takes ffmpeg.
    #[error(
        "`{0}` needs ffmpeg, which is not installed (on Debian or Ubuntu: `apt install ffmpeg`): \
         install it, or give a name that ends in .y4m, in .png for an animation, or a folder"
    )]
    FfmpegMissing(String),
}

/// A reason why a ball of the practice table cannot come, go or lie somewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PracticeFault {
    /// Something else is where the ball would lie.
    #[error("{}", text!("practice-not-clear"))]
    NotClear,
    /// The ball that is to come is there.
    #[error("{}", text!("practice-on-table", ball = text!("ball", number = *_0)))]
    OnTable(u8),
    /// The ball that is to go is not there.
    #[error("{}", text!("practice-not-on-table", ball = text!("ball", number = *_0)))]
    NotOnTable(u8),
    /// The table is full.
    #[error("{}", text!("practice-no-room", ball = text!("ball", number = *_0)))]
    NoRoom(u8),
}

/// What a setting must be and is not, to follow "it must be".
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingFault {
    /// A whole number within a range.
    #[error("a whole number from {min} to {max}")]
    WholeNumber {
        /// The least.
        min: u32,
        /// The most.
        max: u32,
    },
    /// A number within a range.
    #[error("a number from {min} to {max}")]
    Number {
        /// The least.
        min: f64,
        /// The most.
        max: f64,
    },
    /// A truth value.
    #[error("true or false")]
    Switch,
    /// One of a closed set.
    #[error("\"{}\"", names.join("\", \""))]
    Choice {
        /// The set.
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
    /// Anything but a heading.
    #[error("a value, not a table")]
    Table,
}

/// A reason why the keys of an action cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KeysFault {
    /// Neither a word nor an array.
    #[error("must be a key or a list of keys, such as [\"R\", \"F5\"]")]
    NotAList,
    /// An array of something else than words.
    #[error("must be a list of keys in quotes")]
    NotInQuotes,
    /// No key is called so.
    #[error(transparent)]
    Unknown(#[from] UnknownTrigger),
}
