//! Statistics of the farm over the picture: a line in plain words, a card of figures, or all of them, live or
//! frozen.
//!
//! ```text
//! Farm ─▶ FrameSample ─▶ History ─▶ StatsSummary (a few times a second) ─▶ line, card, table
//!                    │  └──▶ charts, Gantt, maps (meshes and a texture, each frame)
//!                    └─────▶ Recorder (a thread) ─▶ CSV, JSON lines
//! ```
//!
//! The model ([`history`], [`frame_record`], [`frame_rate`], [`summary`]) is independent of egui. While the
//! overlay is hidden, nothing is recorded and nothing is drawn.

mod charts;
mod compact;
mod controls;
pub mod frame_rate;
pub mod frame_record;
pub mod gantt;
pub mod glossary;
pub mod history;
pub mod maps;
mod palette;
mod panels;
mod plain_words;
mod prediction_plot;
pub mod recorder;
mod status_line;
pub mod summary;
mod table;
mod value_label;

use std::path::PathBuf;
use std::sync::Arc;

use carom_farm::quality::{QUALITY_LEVELS, QualityLevel, QualityPreference};
use carom_farm::{Balancing, Distribution, NodeStatus};
use carom_tracer::ImageSize;
use egui::{Context, Rect, Vec2};

use self::frame_rate::FrameRate;
use self::frame_record::{FrameRecord, FrameSample};
use self::history::History;
use self::maps::Maps;
use self::recorder::Recorder;
use self::summary::StatsSummary;

/// Level of detail of the overlay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum StatsLevel {
    /// Nothing.
    #[default]
    Off,
    /// A line at the top in plain words.
    Line,
    /// The line, the farm's figures, and the latency breakdown of the last picture.
    Card,
    /// All statistics.
    Full,
    /// All statistics, also written to files.
    Recording,
}

impl StatsLevel {
    /// The next one; after the last comes none.
    pub fn next(self) -> Self {
        match self {
            Self::Off => Self::Line,
            Self::Line => Self::Card,
            Self::Card => Self::Full,
            Self::Full => Self::Recording,
            Self::Recording => Self::Off,
        }
    }
}

/// What the overlay shows beside the history.
#[derive(Clone, Copy, Debug)]
pub struct StatsInput<'a> {
    /// The nodes now.
    pub nodes: &'a [NodeStatus],
    /// How pictures are divided from now on.
    pub balancing: Balancing,
    /// What of them is divided from now on.
    pub distribution: Distribution,
    /// What is given up first while things move.
    pub preference: QualityPreference,
    /// Pixels of the window.
    pub window: ImageSize,
    /// Seconds from one moving picture to the next: the budget.
    pub period_secs: f64,
    /// What moving pictures are made of.
    pub stop: QualityLevel,
    /// What a picture of each stop takes, seconds; absent before the first picture.
    pub level_secs: [Option<f64>; QUALITY_LEVELS.len()],
    /// How far ahead pictures of a shot are asked for, seconds.
    pub lead_secs: f64,
    /// Pictures of shots that were passed over.
    pub skipped: u64,
    /// Share of the window that the newest traced picture did not hold.
    pub disocclusion_fraction: Option<f64>,
    /// What the last redraw took, seconds.
    pub draw_secs: f64,
    /// What puts pictures into the window.
    pub present: &'a str,
}

/// What the player has asked for in the overlay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatsCommand {
    /// Divide pictures in this way.
    Balancing(Balancing),
    /// Divide this of them.
    Distribution(Distribution),
    /// Give up something else first.
    QualityPreference(QualityPreference),
}

/// The lower end of the line at the top: no higher than it was at the same level and in the same window. Figures that
/// grow and shrink wrap the line anew, and a picture that is framed in what is left would not come to rest.
#[derive(Debug, Default)]
struct SteadyLine {
    level: StatsLevel,
    screen: Vec2,
    bottom: f32,
}

impl SteadyLine {
    fn bottom(&mut self, level: StatsLevel, screen: Vec2, bottom: f32) -> f32 {
        if (self.level, self.screen) != (level, screen) {
            *self = Self {
                level,
                screen,
                bottom,
            };
        }
        self.bottom = self.bottom.max(bottom);
        self.bottom
    }
}

/// The overlay.
#[derive(Debug)]
pub struct Stats {
    level: StatsLevel,
    history: History,
    redraws: FrameRate,
    summary: StatsSummary,
    board_secs: f64,
    line: SteadyLine,
    /// The picture that is inspected; the newest if there is none.
    frozen: Option<Arc<FrameRecord>>,
    maps: Maps,
    scales: charts::Scales,
    rows: table::NodeRows,
    recorder: Option<Recorder>,
    folder: PathBuf,
    commands: Vec<StatsCommand>,
}

impl Stats {
    /// Hidden; recordings will go into `folder`.
    pub fn new(folder: PathBuf) -> Self {
        Self {
            level: StatsLevel::Off,
            history: History::default(),
            redraws: FrameRate::default(),
            summary: StatsSummary::default(),
            board_secs: f64::NEG_INFINITY,
            line: SteadyLine::default(),
            frozen: None,
            maps: Maps::default(),
            scales: charts::Scales::default(),
            rows: table::NodeRows::default(),
            recorder: None,
            folder,
            commands: Vec::new(),
        }
    }

    /// Shows as much as that; recording begins and ends with its level.
    pub fn set_level(&mut self, level: StatsLevel) {
        if level == self.level {
            return;
        }
        self.level = level;
        self.board_secs = f64::NEG_INFINITY;
        if level < StatsLevel::Full {
            self.frozen = None;
        }
        self.recorder = match level {
            StatsLevel::Recording => Some(Recorder::start(&self.folder)),
            _ => None,
        };
    }

    /// Whether pictures are to be taken in: not while the overlay is hidden.
    pub fn is_shown(&self) -> bool {
        self.level != StatsLevel::Off
    }

    /// How much is shown.
    pub fn level(&self) -> StatsLevel {
        self.level
    }

    /// Takes in a finished picture. While a picture is inspected the history stands still; what is
    /// recorded goes on.
    pub fn take(&mut self, seen: FrameSample<'_>) {
        if self.level == StatsLevel::Off || (self.frozen.is_some() && self.recorder.is_none()) {
            return;
        }
        if self.frozen.is_none() {
            let record = self.history.push(seen);
            if let Some(recorder) = &mut self.recorder {
                recorder.write(record);
            }
        } else if let Some(recorder) = &mut self.recorder {
            let names: Vec<Arc<str>> = seen
                .nodes
                .iter()
                .map(history::name_of)
                .map(Arc::from)
                .collect();
            recorder.write(Arc::new(FrameRecord::new(seen, &names)));
        }
    }

    /// Notes a redraw of the window; `moves` says that something has moved since the one before.
    pub fn note_redraw(&mut self, now_secs: f64, moves: bool) {
        if self.is_shown() {
            self.redraws.note(now_secs, moves);
        }
    }

    /// Draws what the level asks for; the part of the window that it leaves free.
    pub fn draw(&mut self, ctx: &Context, now_secs: f64, input: &StatsInput<'_>) -> Rect {
        if self.level == StatsLevel::Off {
            return ctx.content_rect();
        }
        if now_secs - self.board_secs >= BOARD_SECS || now_secs < self.board_secs {
            self.refresh(now_secs, input);
        }
        panels::draw(self, ctx, input)
    }

    /// What the player has asked for since the last call.
    pub fn take_commands(&mut self) -> Vec<StatsCommand> {
        std::mem::take(&mut self.commands)
    }

    /// Draws a map over the picture.
    pub fn show_map(&mut self, kind: maps::MapKind) {
        self.maps.kind = kind;
    }

    /// The pictures that are kept.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The picture that is inspected, if the charts stand still.
    pub fn frozen(&self) -> Option<&Arc<FrameRecord>> {
        self.frozen.as_ref()
    }

    /// Stands still at the picture with this place in the history; past its ends at the end.
    pub fn freeze(&mut self, place: usize) {
        let last = self.history.records().len().saturating_sub(1);
        self.frozen = self.history.records().get(place.min(last)).cloned();
        self.board_secs = f64::NEG_INFINITY;
    }

    /// Goes on.
    pub fn unfreeze(&mut self) {
        self.frozen = None;
        self.board_secs = f64::NEG_INFINITY;
    }

    /// The picture that is looked at.
    fn inspected(&self) -> Option<&Arc<FrameRecord>> {
        self.frozen.as_ref().or_else(|| self.history.newest())
    }

    fn refresh(&mut self, now_secs: f64, input: &StatsInput<'_>) {
        self.board_secs = now_secs;
        let record = self.inspected().cloned();
        self.summary = StatsSummary::new(&self.history, &self.redraws, record, input);
        self.rows.refresh(&self.summary);
    }
}

/// Seconds between two changes of the numbers.
const BOARD_SECS: f64 = 0.25;
