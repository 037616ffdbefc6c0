//! The crate's error type: the party at fault, and the offending values.

use std::path::PathBuf;

use carom_text::text;
use glam::{DVec2, DVec3};

/// Result type of the crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A request that cannot be carried out. Each variant names the party at fault.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The player's stroke is out of range.
    #[error("this stroke cannot be played: {0}")]
    Stroke(#[from] StrokeFault),
    /// The specification of a table breaks a rule.
    #[error("the table cannot be used: {0}")]
    Table(#[from] TableFault),
    /// Balls are placed where they cannot lie.
    #[error("the balls cannot lie like this: {0}")]
    Layout(#[from] LayoutFault),
    /// A law's constant makes no physical sense.
    #[error(
        "the laws of the table cannot hold: the {constant} is {value}, not from {min:e} to {max:e}"
    )]
    Laws {
        /// Name of the constant.
        constant: &'static str,
        /// Its value.
        value: f64,
        /// Minimum with which the law holds.
        min: f64,
        /// Exclusive upper bound.
        max: f64,
    },
    /// Particles cannot lie on the table.
    #[error("the particles cannot lie like this: {0}")]
    Particles(#[from] ParticleFault),
    /// A setting of the simulation engine is out of range.
    #[error("the physics cannot be set so: {0}")]
    Engine(#[from] EngineFault),
    /// A file of recorded shots cannot be written or read.
    #[error("this recorded shot cannot be used: {0}")]
    Recording(FileFault),
    /// The simulation did not come to rest within its limits: the crate's own fault.
    #[error(
        "the shot did not come to rest: {events} contacts and phase changes until {time_secs} s"
    )]
    Endless {
        /// Simulated time at which it was aborted.
        time_secs: f64,
        /// Number of events until then.
        events: u32,
    },
    /// The cue ball may not be put there.
    #[error("{0}")]
    Placement(#[from] PlacementFault),
    /// The rules do not allow it.
    #[error("{0}")]
    Rules(#[from] RuleFault),
    /// A file of a saved match cannot be written or read.
    #[error("{path} cannot be {action}: {fault}", path = .path.display())]
    MatchFile {
        /// The file.
        path: PathBuf,
        /// The failed operation: `read` or `written`.
        action: &'static str,
        /// The reason.
        fault: FileFault,
    },
    /// The bytes are not a saved match.
    #[error("{0}")]
    MatchBytes(FileFault),
    /// A saved match cannot be played again.
    #[error("step {step} cannot be done: {reason}")]
    Replay {
        /// Step of the match, counted from 1.
        step: usize,
        /// The reason.
        reason: Box<Error>,
    },
    /// A list of players cannot be read.
    #[error("{0}")]
    Players(#[from] PlayersFault),
    /// The system cannot start a thread for the computer player.
    #[error("the computer cannot think: {0}")]
    NoThread(std::io::Error),
    /// The thread of a shot among particles ended without a result.
    #[error("the simulation of the shot broke off")]
    ShotBrokeOff,
    /// The computer player's thread ended without a decision.
    #[error("the computer stopped thinking")]
    SearchBrokeOff,
}

/// A value of a stroke that cannot be played.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum StrokeFault {
    /// The direction, in rad, is not finite.
    #[error("the direction {0} is not an angle")]
    Direction(f64),
    /// The cue's speed is out of range.
    #[error("the cue's speed of {speed_m_s} m/s is not over 0 and up to {max_m_s} m/s")]
    Speed {
        /// Speed, in m/s.
        speed_m_s: f64,
        /// Maximum, in m/s.
        max_m_s: f64,
    },
    /// The tip is too far out.
    #[error("the tip is {offset} radii from the centre, not up to {max}")]
    Offset {
        /// Offset, in ball radii.
        offset: f64,
        /// Maximum, in ball radii.
        max: f64,
    },
    /// The cue's elevation is out of range.
    #[error("the cue's elevation of {elevation_rad} rad is not from 0 to {max_rad:.4} rad")]
    Elevation {
        /// Elevation, in rad.
        elevation_rad: f64,
        /// Maximum, in rad.
        max_rad: f64,
    },
    /// There is no cue ball on the table.
    #[error("the cue ball is not on the table")]
    NoCueBall,
}

/// A broken rule of a table.
#[derive(Debug, thiserror::Error)]
pub enum TableFault {
    /// The text is not a table.
    #[error("{0}")]
    Json(serde_json::Error),
    /// A dimension is out of range.
    #[error("{table}: the {dimension} is {value}, not from {min} to {max}")]
    Dimension {
        /// Display name of the table.
        table: String,
        /// Name of the dimension.
        dimension: &'static str,
        /// Its value, in m or degrees.
        value: f64,
        /// Minimum.
        min: f64,
        /// Maximum.
        max: f64,
    },
    /// Side pockets need corner pockets: of the table with this name.
    #[error("{0}: it has side pockets but no corner pockets")]
    SidePocketsOnly(String),
    /// The pockets are too wide.
    #[error("{table}: its pockets take {taken_m} m and leave no cushion")]
    NoCushionLeft {
        /// Display name of the table.
        table: String,
        /// Length taken by all pockets of a side, in m.
        taken_m: f64,
    },
    /// A length, in m, is not positive and finite.
    #[error("a size of {0} m is not over 0")]
    Size(f64),
    /// The centre of a circle is not finite.
    #[error("a circle's center is not finite")]
    CircleNotFinite,
    /// The table has no cushions.
    #[error("it has no noses, so that nothing holds the balls")]
    NoNoses,
    /// The ends of a nose coincide or are not finite.
    #[error("a nose from {from} to {to} has no length")]
    NoseWithoutLength {
        /// One end, in m.
        from: DVec2,
        /// The other end, in m.
        to: DVec2,
    },
    /// No table that ships with the crate has this name.
    #[error("there is no table `{name}`: there are {known}")]
    Unknown {
        /// The requested name.
        name: String,
        /// The existing names.
        known: String,
    },
    /// No table that ships with the crate has this display name.
    #[error("there is no table `{0}`")]
    Unnamed(String),
}

/// A reason why balls cannot lie as they should.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum LayoutFault {
    /// No ball has this number.
    #[error("there is no ball {0}")]
    NoSuchBall(u8),
    /// The body is not physical.
    #[error("the {quantity} of ball {ball} is {value} {unit}: it must be finite and over 0")]
    Body {
        /// The ball.
        ball: u8,
        /// `mass` or `radius`.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// Unit: `kg` or `m`.
        unit: &'static str,
    },
    /// Position or motion of the ball is not finite.
    #[error("ball {0} has a place or a speed that is not finite")]
    NotFinite(u8),
    /// Two balls share a number.
    #[error("ball {0} is there twice")]
    Twice(u8),
    /// It neither lies on the cloth nor flies over it.
    #[error("ball {ball} with its centre at {height_m} m does not lie on the cloth")]
    NotOnCloth {
        /// The ball.
        ball: u8,
        /// Height of its centre above the cloth, in m.
        height_m: f64,
    },
    /// It is outside the table.
    #[error("ball {ball} at {position} is off the table")]
    OffTable {
        /// The ball.
        ball: u8,
        /// Its centre, in m.
        position: DVec3,
    },
    /// It is over a pocket.
    #[error("ball {ball} at {position} is in the pocket at {pocket}")]
    InPocket {
        /// The ball.
        ball: u8,
        /// Its centre, in m.
        position: DVec3,
        /// The pocket's centre, in m.
        pocket: DVec2,
    },
    /// It is inside a cushion or rail.
    #[error("ball {ball} at {position} is in a cushion")]
    InCushion {
        /// The ball.
        ball: u8,
        /// Its centre, in m.
        position: DVec3,
    },
    /// It overlaps another ball.
    #[error("ball {ball} at {position} overlaps ball {other}")]
    Overlap {
        /// The ball.
        ball: u8,
        /// Its centre, in m.
        position: DVec3,
        /// The other.
        other: u8,
    },
}

/// A setting of the engine that is out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EngineFault {
    /// A number is out of range.
    #[error("{value} {quantity} are not from {min} to {max}")]
    OutOfRange {
        /// Steps per second or solver iterations.
        quantity: &'static str,
        /// Its value.
        value: u32,
        /// Minimum.
        min: u32,
        /// Maximum.
        max: u32,
    },
    /// No engine has this name.
    #[error("`{0}` is neither `exact` nor `rapier-` and steps per second, as rapier-240")]
    Unknown(String),
    /// A frame is too short.
    #[error("a frame of {frame_secs} s is shorter than {min_secs} s")]
    FrameTooShort {
        /// Duration, in s.
        frame_secs: f64,
        /// Minimum, in s.
        min_secs: f64,
    },
}

/// A reason why a file of shots or of a match cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FileFault {
    /// The system failed, or a fault of the file's contents, with its path.
    #[error("{path}: {fault}", path = .path.display())]
    At {
        /// The file.
        path: PathBuf,
        /// The reason.
        fault: Box<FileFault>,
    },
    /// The system failed.
    #[error("{0}")]
    Io(std::io::Error),
    /// It is a folder, a pipe or a device.
    #[error("it is no plain file")]
    NotPlain,
    /// It is not this kind of file, `recorded shot` or `match`.
    #[error("it does not begin as a {0} does")]
    OtherKind(&'static str),
    /// It ends before the version.
    #[error("it ends within its version")]
    NoVersion,
    /// It is of a version that this crate does not know.
    #[error("its version is {version}, this program reads {known}")]
    OtherVersion {
        /// The file's.
        version: u16,
        /// This crate's.
        known: u16,
    },
    /// It cannot be decoded.
    #[error("it is cut off or damaged ({0})")]
    Damaged(postcard::Error),
    /// It cannot be encoded.
    #[error("{0}")]
    NotEncoded(postcard::Error),
    /// This many bytes follow its end.
    #[error("{0} bytes follow its end")]
    TrailingBytes(usize),
    /// It is too large.
    #[error("it has {bytes} bytes, at most {max} are kept")]
    TooLarge {
        /// Its size.
        bytes: u64,
        /// Maximum size.
        max: u64,
    },
    /// The duration of a shot, in s, is out of range.
    #[error("it lasts {0} s")]
    Duration(f64),
    /// Events are out of order.
    #[error("its events are not in the order of time")]
    EventsUnordered,
    /// No simulation produces such a path.
    #[error("the path of ball {ball} {fault}")]
    Path {
        /// The ball.
        ball: u8,
        /// The fault of the path.
        fault: &'static str,
    },
    /// A ball's body is not physical.
    #[error("{0}")]
    Body(LayoutFault),
    /// The balls turn too often, all together, to be kept in memory.
    #[error("its balls turn {0} times")]
    Turns(f64),
    /// It has no shots, or too many.
    #[error("it has {shots} shots, not 1 to {max}")]
    ShotCount {
        /// Number of shots.
        shots: usize,
        /// Maximum.
        max: usize,
    },
    /// No simulation produces such particles, for this reason.
    #[error("its particles are not a shot's: {0}")]
    Particles(&'static str),
    /// A title does not fit a line.
    #[error("a title of {bytes} bytes is longer than {max} or not one line")]
    Title {
        /// Its length in bytes.
        bytes: usize,
        /// Maximum length in bytes.
        max: usize,
    },
}

/// A reason why the cue ball may not be put somewhere, a sentence for the player.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlacementFault {
    /// It does not lie on the cloth there.
    #[error("{}", text!("place-not-on-cloth"))]
    NotOnCloth,
    /// It is in hand elsewhere: in an area named to follow "in hand".
    #[error("{}", text!("place-outside", area = *_0))]
    OutsideArea(&'static str),
    /// It touches this ball there.
    #[error("{}", text!("place-touches"))]
    Touches(u8),
    /// It is not in hand.
    #[error("{}", text!("ball-not-in-hand"))]
    NotInHand,
}

/// Something that a game or the state of a match does not allow.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RuleFault {
    /// The game is for another number of players.
    #[error("{game} is played by {}, not by {players}", player_range(*.min, *.max))]
    PlayerCount {
        /// The game's name.
        game: &'static str,
        /// Requested number of players.
        players: usize,
        /// Minimum.
        min: usize,
        /// Maximum.
        max: usize,
    },
    /// The target is too high.
    #[error("a match to {target} {unit} is too long: at most {max}")]
    TargetTooLong {
        /// The requested number.
        target: u32,
        /// Unit of the target.
        unit: &'static str,
        /// Maximum.
        max: u32,
    },
    /// The choice, named as on its button, is not offered.
    #[error("\u{201c}{0}\u{201d} is no choice now")]
    NoSuchChoice(&'static str),
    /// The table's pockets do not fit the game.
    #[error("{game} cannot be played on the {table}: it has {pockets} pockets")]
    OtherTable {
        /// The game's name.
        game: &'static str,
        /// The table's name.
        table: String,
        /// Number of its pockets.
        pockets: usize,
    },
    /// Balls are laid only on the free table.
    #[error("{}", text!("layout-not-free-table"))]
    NotFreeTable,
    /// No shot is left to suggest.
    #[error("{}", text!("hint-match-over"))]
    NothingToSuggest,
    /// The match was over before this step.
    #[error("the match was over before it")]
    MatchOver,
    /// The free table has no end and no winner.
    #[error("the free table has no end and no winner: choose another game")]
    NoWinner,
    /// A person is at the table where a computer is to play.
    #[error("it is the turn of {0}, a person")]
    PersonsTurn(String),
}

/// A reason why a list of players cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlayersFault {
    /// The number of people is out of range.
    #[error("{players} players are not 1 to {max}")]
    Count {
        /// The requested number.
        players: usize,
        /// Maximum.
        max: usize,
    },
    /// The list is too long.
    #[error("{players} players are more than {max}")]
    TooMany {
        /// Number of players in the list.
        players: usize,
        /// Maximum.
        max: usize,
    },
    /// No level has this name.
    #[error("`{0}` is no player: the levels are ai:easy, ai:medium, ai:hard, ai:expert")]
    UnknownLevel(String),
    /// A name is empty, too long or has control characters.
    #[error("a player's name has 1 to {max} letters, not `{text}`")]
    Name {
        /// The given text.
        text: String,
        /// Maximum number of characters.
        max: usize,
    },
}

fn player_range(min: usize, max: usize) -> String {
    match (min, max) {
        (1, 1) => "1 player".to_owned(),
        (min, max) if min == max => format!("{min} players"),
        (min, max) => format!("{min} to {max} players"),
    }
}

/// A reason why particles cannot be on a table.
#[derive(Debug, thiserror::Error)]
pub enum ParticleFault {
    /// There are no particles.
    #[error("there are none: cover some of the cloth")]
    None,
    /// There are more than a shot can be simulated with.
    #[error("there are {particles}, more than {max}: cover less of the cloth")]
    TooMany {
        /// Their number.
        particles: usize,
        /// Maximum.
        max: usize,
    },
    /// There are marbles beside particles of other kinds.
    #[error(
        "marbles and other things are on one table, and would go through each other: cover the cloth with marbles alone or \
         without any"
    )]
    Mixed,
    /// The groups of a file do not match its particles.
    #[error("the file holds other particles than it says: it is damaged")]
    OtherThanSaid,
    /// A patch reaches beyond the cushions.
    #[error("the patch at ({:.2}, {:.2}) m is not on the cloth: leave it out", .at.x, .at.y)]
    OffCloth {
        /// Its corner, in m.
        at: DVec2,
    },
    /// The simulation of the particles failed.
    #[error("{0}")]
    Simulation(#[from] carom_mpm::Error),
}
