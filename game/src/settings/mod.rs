//! The player's settings, kept as TOML in the platform's folder.
//!
//! ```toml
//! [interface]
//! text-scale = 1.25
//!
//! [keys]
//! rack = ["R", "F5"]
//! ```
//!
//! [`SettingsStore`] reads and writes the file. Only what was changed is written, so comments, unknown names
//! and values that could not be read stay as they were.

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
    /// The window's size in points, 320 to 16384 each way.
    pub window: [u32; 2],
    /// Whether it fills the screen.
    pub fullscreen: bool,
    /// Size of text and panels, [`Settings::TEXT_SCALE`].
    pub text_scale: f64,
    /// Cuts instead of camera rides, and panels that do not slide or fade.
    pub reduced_motion: bool,
    /// What a newcomer is taught next.
    pub lesson: Lesson,
    /// How much of a shot is shown beforehand: the difficulty of the game.
    pub aim_aids: AimAids,
    /// The table's look.
    pub style: TableStyle,
    /// What is chosen of the tables that games are begun on.
    pub table: TableOptions,
    /// What moves the balls.
    pub physics: Engine,
    /// How finely what lies on trick tables is simulated.
    pub particle_precision: ParticlePrecision,
    /// What is given up first while things move.
    pub quality: QualityPreference,
    /// How sharp a picture at rest is.
    pub resolution: Resolution,
    /// CPU threads of the node inside the game, up to [`Settings::THREADS_MAX`]; 0 is one a core. Counts from the next
    /// start of the program.
    pub threads: u16,
    /// Loudness, 0 to 1.
    pub volume: f64,
    /// Best scores of the drills, in the order of [`Settings::DRILLS`].
    pub drill_bests: [u32; 3],
    /// Views that the player has saved, by their places.
    pub views: [Option<Viewpoint>; SAVED_MAX],
    /// Which balls are marked.
    pub ball_marks: BallMarks,
    /// How the mouse turns the aim and the camera.
    pub mouse: MouseSettings,
    /// Which key does what.
    pub bindings: Bindings,
}

impl Settings {
    /// Smallest and largest text.
    pub const TEXT_SCALE: [f64; 2] = [0.75, 2.5];
    /// Smallest and largest edge of the window, points.
    pub const WINDOW_EDGE: [u32; 2] = [320, 16_384];
    /// Drills whose best scores are kept; that of the daily shot is one of its day.
    pub const DRILLS: [RuleSet; 3] = [RuleSet::LineUp, RuleSet::SpotShots, RuleSet::PositionPlay];
    /// Most CPU threads.
    pub const THREADS_MAX: u16 = 1024;

    /// The best score of a drill; none of other games.
    pub fn drill_best(&self, rules: RuleSet) -> Option<u32> {
        let place = Self::DRILLS.iter().position(|drill| *drill == rules)?;
        Some(self.drill_bests[place])
    }

    /// Keeps the score of a drill that is over if it is the best.
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
