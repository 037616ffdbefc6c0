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
    /// The next level; [`Self::Off`] after the last.
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

/// Data of the overlay besides the history.
#[derive(Clone, Copy, Debug)]
pub struct StatsInput<'a> {
    /// The present status of the nodes.
    pub nodes: &'a [NodeStatus],
    /// The present balancing.
    pub balancing: Balancing,
    /// The present distribution.
    pub distribution: Distribution,
    /// The present quality preference: what is sacrificed first while things move.
    pub preference: QualityPreference,
    /// Size of the window in pixels.
    pub window: ImageSize,
    /// Budget: time from one moving picture to the next, in seconds.
    pub period_secs: f64,
    /// Quality level of moving pictures.
    pub stop: QualityLevel,
    /// Estimated time of a picture at each quality level in seconds; `None` before the first picture.
    pub level_secs: [Option<f64>; QUALITY_LEVELS.len()],
    /// Time in seconds by which pictures of a shot are requested ahead.
    pub lead_secs: f64,
    /// Number of pictures of shots that were skipped.
    pub skipped: u64,
    /// Share of the window for which the newest traced picture holds no data.
    pub disocclusion_fraction: Option<f64>,
    /// Duration of the last redraw in seconds.
    pub draw_secs: f64,
    /// Name of the window's display.
    pub present: &'a str,
}

/// Command that the user has given in the overlay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatsCommand {
    /// Use another balancing.
    Balancing(Balancing),
    /// Use another distribution.
    Distribution(Distribution),
    /// Use another quality preference.
    QualityPreference(QualityPreference),
}

/// Lower end of the line at the top, which never moves up at one level and window size. Changing figures wrap
/// the line differently, and a picture fitted into the remaining area would otherwise not come to rest.
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

/// Overlay with the farm's statistics.
#[derive(Debug)]
pub struct Stats {
    level: StatsLevel,
    history: History,
    redraws: FrameRate,
    summary: StatsSummary,
    board_secs: f64,
    line: SteadyLine,
    /// The inspected picture, if the charts are frozen; otherwise the newest is inspected.
    frozen: Option<Arc<FrameRecord>>,
    maps: Maps,
    scales: charts::Scales,
    rows: table::NodeRows,
    recorder: Option<Recorder>,
    folder: PathBuf,
    commands: Vec<StatsCommand>,
}

impl Stats {
    /// A hidden overlay, whose recordings will be written into `folder`.
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

    /// Sets the level of detail; entering and leaving [`StatsLevel::Recording`] begins and ends a recording.
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

    /// Whether the overlay is shown; while it is hidden, pictures need not be passed to [`Stats::take`].
    pub fn is_shown(&self) -> bool {
        self.level != StatsLevel::Off
    }

    /// The level of detail.
    pub fn level(&self) -> StatsLevel {
        self.level
    }

    /// Adds a finished picture. While the charts are frozen the history does not change, but a recording
    /// continues.
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

    /// Records a redraw of the window; `moves` states that something has moved since the previous one.
    pub fn note_redraw(&mut self, now_secs: f64, moves: bool) {
        if self.is_shown() {
            self.redraws.note(now_secs, moves);
        }
    }

    /// Draws the overlay; returns the part of the window that it leaves free.
    pub fn draw(&mut self, ctx: &Context, now_secs: f64, input: &StatsInput<'_>) -> Rect {
        if self.level == StatsLevel::Off {
            return ctx.content_rect();
        }
        if now_secs - self.board_secs >= BOARD_SECS || now_secs < self.board_secs {
            self.refresh(now_secs, input);
        }
        panels::draw(self, ctx, input)
    }

    /// The user's commands since the last call.
    pub fn take_commands(&mut self) -> Vec<StatsCommand> {
        std::mem::take(&mut self.commands)
    }

    /// Selects the map over the picture.
    pub fn show_map(&mut self, kind: maps::MapKind) {
        self.maps.kind = kind;
    }

    /// The history of pictures.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The inspected picture, if the charts are frozen.
    pub fn frozen(&self) -> Option<&Arc<FrameRecord>> {
        self.frozen.as_ref()
    }

    /// Freezes the charts at the picture with this index in the history, or the last one if there are fewer.
    pub fn freeze(&mut self, place: usize) {
        let last = self.history.records().len().saturating_sub(1);
        self.frozen = self.history.records().get(place.min(last)).cloned();
        self.board_secs = f64::NEG_INFINITY;
    }

    /// Unfreezes the charts.
    pub fn unfreeze(&mut self) {
        self.frozen = None;
        self.board_secs = f64::NEG_INFINITY;
    }

    /// The inspected picture.
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

/// Minimum time in seconds between two updates of the figures.
const BOARD_SECS: f64 = 0.25;
