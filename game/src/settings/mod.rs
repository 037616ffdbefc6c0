//! The player's settings, stored as TOML in the platform's configuration folder.
//!
//! ```toml
//! [interface]
//! text-scale = 1.25
//!
//! [keys]
//! rack = ["R", "F5"]
//! ```
//!
//! [`SettingsStore`] reads and writes the file. Only changed values are written, so comments, unknown names
//! and values that could not be read are preserved.

mod engine_cost;
mod field;
mod particle_cost;
mod store;

use carom_farm::quality::{QualityPreference, Resolution};
pub use engine_cost::{engine_cost, engine_cost_table};
pub(crate) use field::value_name;
pub use particle_cost::particle_cost;
pub use store::SettingsStore;
pub(crate) use store::set_aside;

use carom_billiards::physics::{Engine, ParticlePrecision, TableOptions};
use carom_billiards::rules::RuleSet;

use crate::camera::{SAVED_MAX, Viewpoint};
use crate::input::{Bindings, MouseSettings};
use crate::play::{AimAids, BallMarks};
use crate::scene::table_style::TableStyle;
use crate::ui::lessons::Lesson;

/// All settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Size of the window in points, each edge within [`Settings::WINDOW_EDGE`].
    pub window: [u32; 2],
    /// Whether the window is full-screen.
    pub fullscreen: bool,
    /// Scale of text and panels, within [`Settings::TEXT_SCALE`].
    pub text_scale: f64,
    /// Whether camera moves are replaced by cuts, and panels do not slide or fade.
    pub reduced_motion: bool,
    /// The new player's next lesson.
    pub lesson: Lesson,
    /// How much of a shot is previewed, which is the difficulty of the game.
    pub aim_aids: AimAids,
    /// Look of the table.
    pub style: TableStyle,
    /// Options of the tables of new games.
    pub table: TableOptions,
    /// Physics engine of the balls.
    pub physics: Engine,
    /// Precision of the particles on trick tables.
    pub particle_precision: ParticlePrecision,
    /// What is reduced first while things move.
    pub quality: QualityPreference,
    /// Resolution of pictures at rest.
    pub resolution: Resolution,
    /// CPU threads of the node inside the game, up to [`Settings::THREADS_MAX`]; 0 is one per core. Takes
    /// effect at the next start of the program.
    pub threads: u16,
    /// Volume, 0 to 1.
    pub volume: f64,
    /// Best scores of the drills, in the order of [`Settings::DRILLS`].
    pub drill_bests: [u32; 3],
    /// The player's saved views.
    pub views: [Option<Viewpoint>; SAVED_MAX],
    /// Which balls are marked.
    pub ball_marks: BallMarks,
    /// Settings of the mouse.
    pub mouse: MouseSettings,
    /// Bindings of keys, mouse and gamepad.
    pub bindings: Bindings,
}

impl Settings {
    /// Least and greatest scale of text.
    pub const TEXT_SCALE: [f64; 2] = [0.75, 2.5];
    /// Least and greatest edge of the window, in points.
    pub const WINDOW_EDGE: [u32; 2] = [320, 16_384];
    /// Drills whose best scores are stored. The daily shot is not among them, as it differs every day.
    pub const DRILLS: [RuleSet; 3] = [RuleSet::LineUp, RuleSet::SpotShots, RuleSet::PositionPlay];
    /// Largest number of CPU threads.
    pub const THREADS_MAX: u16 = 1024;

    /// The best score of a drill; none for other games.
    pub fn drill_best(&self, rules: RuleSet) -> Option<u32> {
        let place = Self::DRILLS.iter().position(|drill| *drill == rules)?;
        Some(self.drill_bests[place])
    }

    /// Stores the score of a finished drill if it is the best.
    pub fn note_drill(&mut self, rules: RuleSet, score: u32) {
        if let Some(place) = Self::DRILLS.iter().position(|drill| *drill == rules) {
            let best = &mut self.drill_bests[place];
            *best = score.max(*best);
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            window: [1280, 720],
            fullscreen: false,
            text_scale: 1.0,
            reduced_motion: false,
            lesson: Lesson::default(),
            aim_aids: AimAids::default(),
            style: TableStyle::default(),
            table: TableOptions::default(),
            physics: Engine::default(),
            particle_precision: ParticlePrecision::default(),
            quality: QualityPreference::default(),
            resolution: Resolution::default(),
            threads: 0,
            volume: 0.7,
            drill_bests: [0; 3],
            views: [None; SAVED_MAX],
            ball_marks: BallMarks::default(),
            mouse: MouseSettings::default(),
            bindings: Bindings::default(),
        }
    }
}
