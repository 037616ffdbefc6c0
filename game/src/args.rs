//! Command line of the game.

use std::path::PathBuf;

use anyhow::Context as _;
use carom_billiards::PlayersFault;
use carom_billiards::game_match::{Match, MatchConfig, Player};
use carom_billiards::physics::{Engine, Recording, Table, TableOptions};
use carom_billiards::rules::RuleSet;
use carom_farm::{FarmConfig, FrameRange};
use carom_tracer::{ImageSize, RenderSettings};
use carom_window::args::{ArgsFault, WindowArgs};
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::capture::video::{VideoTarget, VideoView};
use crate::particles::ParticleDetail;
use crate::play::tournament::MatchArgs;
use crate::play::tricks::TrickTable;
use crate::scene::ball_materials::BallSet;
use crate::scene::export::SceneArgs;
use crate::scene::table_args::TableArgs;
use crate::scene::table_scene::TableScene;
use crate::scene::table_style::{ClothColour, TableStyle};
use crate::settings::engine_cost_table;

/// The command that needs no display.
pub const HEADLESS_COMMAND: &str = "carom --headless";

/// Pool, path-traced in real time by a farm of any mix of GPUs and CPUs.
///
/// Without options a window opens and this machine traces the pictures. Without a display a
/// break shot is rendered to files.
#[derive(Clone, Debug, Parser)]
#[command(name = "carom", version, args_conflicts_with_subcommands = true)]
pub struct Args {
    /// Run a subcommand instead of the game
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Render a break shot to files instead of opening a window
    #[arg(long)]
    pub headless: bool,
    /// Render a video of the shot of --replay, or of a break, instead of opening a window: FILE.mp4, .webm,
    /// .mkv or .gif (with ffmpeg installed; all but .gif have sound), FILE.y4m (for video encoders), FILE.png
    /// (animated) or a folder for PNG files. Run the same command again to
    /// resume an interrupted video. A file of this name is replaced; a folder with frames or statistics that
    /// no run has put there is refused
    #[arg(long, value_name = "VIDEO", value_parser = VideoTarget::parse, conflicts_with = "out")]
    pub video: Option<VideoTarget>,
    /// Number of frames to render without a window, 1 to 1000000 [default: 48 of a break, all of a video]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: Option<u32>,
    /// Render only these frames of the video, the first and the last, counted from 0: a queue gives each
    /// of its jobs a range, all with one --video, which the same command without a range puts together
    #[arg(long, value_name = "FIRST-LAST", requires = "video")]
    pub frame_range: Option<FrameRange>,
    /// Frames per second, 1 to 240
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u16).range(1..=240))]
    pub fps: u16,
    /// View of the frames
    #[arg(long, value_enum, default_value_t)]
    pub view: VideoView,
    /// Size of the frames or of the window in pixels [default: 640x360 for frames, 1280x720 for a video
    /// and the window]
    #[arg(long, value_name = "WxH")]
    pub size: Option<ImageSize>,
    /// Samples per pixel of the frames [default: 16, for a video 64]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=i64::from(RenderSettings::SAMPLES_MAX)))]
    pub spp: Option<u32>,
    /// Denoise the frames: 4 samples then look like 16 and more; `--denoise=false` keeps their noise
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_value_t = true,
        default_missing_value = "true",
        action = clap::ArgAction::Set
    )]
    pub denoise: bool,
    /// Seed of the rack and of the noise: the same seed gives the same frames
    #[arg(long, default_value_t = 1)]
    pub seed: u32,
    /// Write the frames to this folder; those of an earlier run that was finished make room, files that no run
    /// has put there are refused
    #[arg(long, value_name = "DIR", default_value = "carom-frames")]
    pub out: PathBuf,
    /// The table and its options.
    #[command(flatten)]
    pub table: TableArgs,
    /// Game: free, eight, nine, straight, snooker or three-cushion [default: the unfinished match, else
    /// free]
    #[arg(long, value_enum, value_name = "GAME")]
    pub rules: Option<RuleSet>,
    /// Players: names and computer players separated by commas, such as me,ai:medium; or 2 for two people
    /// [default: you against ai:medium]
    #[arg(long, value_name = "PLAYERS", value_parser = players)]
    pub players: Option<String>,
    /// Racks, frames or points to win [default: depends on the game]
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub target: u32,
    /// Material of the balls [default: from the settings, else classic]
    #[arg(long, value_enum, value_name = "SET")]
    pub ball_set: Option<BallSet>,
    /// Colour of the cloth [default: from the settings, else tournament]
    #[arg(long, value_enum, value_name = "COLOUR")]
    pub cloth: Option<ClothColour>,
    /// Dust that strokes knock off the tip [default: from the settings, else some]
    #[arg(long, value_enum, value_name = "DETAIL")]
    pub particles: Option<ParticleDetail>,
    /// Show a shot through a trick table, in place of a break, when frames are rendered without a window
    #[arg(long, value_enum, value_name = "TRICK", conflicts_with = "replay")]
    pub trick: Option<TrickTable>,
    /// Where pictures are traced, and how they are shown.
    #[command(flatten)]
    pub window: WindowArgs,
    /// Seconds without an answer of any node after which a run without a window gives up; 0 waits for
    /// ever [default: 10 if none is connected and 60 if one may still be starting, or as in --config]
    #[arg(long, value_name = "N")]
    pub timeout_secs: Option<u32>,
    /// Replay a recorded shot, in the window or as frames
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
    /// Save every shot to a file in this folder, for --replay
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// Physics engine: exact (event-based), or rapier-N: rapier's solver at N steps per second, 30 to 10000
    /// [default: from the settings, else exact]
    #[arg(long, value_name = "ENGINE", long_help = physics_help())]
    pub physics: Option<Engine>,
    /// Settings file [default: carom/settings.toml in the platform's folder]
    #[arg(long, value_name = "FILE")]
    pub settings: Option<PathBuf>,
}

/// Subcommands of the game's program.
#[derive(Clone, Debug, Subcommand)]
pub enum Command {
    /// Let computer players play each other without a window and print the score
    Tournament(MatchArgs),
    /// Write the sound of a recorded shot, or of a break, to a WAV file
    Sound {
        /// Output file, in place of one of this name [default: shot.wav, where there is none yet]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// Recorded shot
        #[arg(long, value_name = "FILE")]
        replay: Option<PathBuf>,
        /// Cue speed of the break in m/s
        #[arg(long, default_value_t = 8.0)]
        speed: f64,
    },
    /// Write the scene of a game before its first stroke to a JSON file, for `carom-farm`
    Scene(Box<SceneArgs>),
}

impl Args {
    /// Parses the program's command line; exits with a message if it is invalid.
    pub fn of_command_line() -> Self {
        let matches = with_negative_numbers(Self::command()).get_matches();
        Self::from_arg_matches(&matches).unwrap_or_else(|why| why.exit())
    }

    /// Look of the table: `own`, overridden by options.
    pub fn style(&self, own: TableStyle) -> TableStyle {
        TableStyle {
            balls: self.ball_set.unwrap_or(own.balls),
            cloth: self.cloth.unwrap_or(own.cloth),
            particles: self.particles.unwrap_or(own.particles),
            ..own
        }
    }

    /// Configuration of the farm by the configuration file, overridden by options.
    ///
    /// # Errors
    /// As [`WindowArgs::farm_config`].
    pub fn farm_config(&self) -> Result<FarmConfig, ArgsFault> {
        let mut config = self.window.farm_config()?;
        config.timeout_secs = self.timeout_secs.or(config.timeout_secs);
        Ok(config)
    }

    /// The table to play on and the recording to show, which determines the table.
    ///
    /// # Errors
    /// If the recording cannot be read, or is of another table than the options'.
    pub fn table_and_recording(&self) -> anyhow::Result<(Table, Option<Recording>)> {
        let Some(path) = &self.replay else {
            let table = self.table.of(TableScene::table(), self.table.options());
            return Ok((table, None));
        };
        let recording = Recording::load(path).context(REPLAY)?;
        let table = match Table::named(&recording.table) {
            Some(table) if !self.table.is_asked() => table,
            _ => self.table.of(TableScene::table(), self.table.options()),
        };
        if recording.table != table.name() {
            anyhow::bail!(
                "{}: the shot was played on `{}`, which is not this table, `{}`",
                path.display(),
                recording.table,
                table.name()
            );
        }
        Ok((table, Some(recording)))
    }

    /// The match that the arguments request, on a table with `options`; none if they request none.
    ///
    /// # Errors
    /// If the game does not allow the players, the target or the table.
    pub fn contest(&self, options: TableOptions) -> anyhow::Result<Option<Match>> {
        let wants_table = self.table.is_asked() || self.replay.is_some();
        if self.rules.is_none() && self.players.is_none() && self.target == 0 && !wants_table {
            return Ok(None);
        }
        let rules = self.rules.unwrap_or_default();
        let players = match (&self.players, rules) {
            (Some(list), _) => Player::list(list)?,
            (None, rules) if rules.is_for_one() => vec![Player::you()],
            (None, _) => Player::list("ai")?,
        };
        let own = MatchConfig::new(rules, players, self.seed)?;
        // The daily shot is the same for all players, so it ignores table options of the settings.
        let options = match rules {
            RuleSet::DailyShot => self.table.options(),
            _ => options,
        };
        let table = match self.replay {
            Some(_) => self.table_and_recording()?.0,
            None => self.table.of(own.table, options),
        };
        let begun = Match::new(MatchConfig {
            table,
            target: self.target,
            ..own
        });
        Ok(Some(begun?))
    }
}

/// Message for a file that `--replay` cannot read, before the reason.
pub const REPLAY: &str = "--replay takes a file that --record or the page of replays has saved";

/// Makes all options with values accept negative numbers, so that `-1` is reported as out of range rather
/// than as an unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let option = |option: clap::Arg| match option.get_action().takes_values() {
        true => option.allow_negative_numbers(true),
        false => option,
    };
    command
        .mut_args(option)
        .mut_subcommands(with_negative_numbers)
}

/// Validates a list of players, and returns it unchanged.
fn players(text: &str) -> Result<String, PlayersFault> {
    Player::list(text).map(|_| text.to_owned())
}

/// Help of `--physics`: the choices with their measured cost and error.
fn physics_help() -> String {
    format!(
        "\
Physics engine: exact (the laws of billiards, from event to event) or rapier-N (rapier's own contacts and
solver at N steps per second, 30 to 10000). Accuracy and cost:

{}

A corner pocket a metre away forgives about 1.7°",
        engine_cost_table()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        with_negative_numbers(Args::command()).debug_assert();
    }

    #[test]
    fn a_negative_number_is_told_the_range() {
        for (line, range) in [
            (&["carom", "--spp", "-1"][..], "1..=65536"),
            (&["carom", "tournament", "--games", "-1"], "1..=10000"),
        ] {
            let refused = with_negative_numbers(Args::command()).try_get_matches_from(line);
            let said = refused.unwrap_err().to_string();
            assert!(said.contains(range), "{said}");
        }
    }

    #[test]
    fn unknown_balancers_are_refused_with_the_known() {
        let refused = Args::try_parse_from(["carom", "--balancer", "fair"]).unwrap_err();
        let said = refused.to_string();
        assert!(said.contains("no balancer `fair`"), "{said}");
        assert!(said.contains("water_filling"), "{said}");
    }

    #[test]
    fn unknown_players_are_refused_by_the_command_line() {
        for list in ["foo,ai:godlike", "a,b,c", ""] {
            let refused = Args::try_parse_from(["carom", "--headless", "--players", list]);
            let said = refused.unwrap_err().to_string();
            assert!(said.contains("--players"), "{said}");
        }
        assert!(Args::try_parse_from(["carom", "--players", "me,ai:hard"]).is_ok());
    }
}
