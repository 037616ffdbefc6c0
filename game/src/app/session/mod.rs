//! Session: a game with its mode and frame pipeline, independent of the window.

mod interface;
mod match_practice;
mod steps;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

use carom_billiards::game_match::Match;
use carom_billiards::physics::{Recording, Shot};
use carom_farm::quality::QualityPreference;
use carom_farm::{Balancing, Distribution, FarmConfig, NodeStatus};
use carom_text::text;
use carom_tracer::ImageSize;
use carom_window::notifications;
use carom_window::stats::Stats;

use self::match_practice::InterruptedMatch;
use crate::app::autosave::Autosave;
use crate::app::mode::{Mode, ModeView, ViewTime};
use crate::app::mode_controller::ModeController;
use crate::camera::{CameraIntent, Viewpoint};
use crate::capture::ShotRecorder;
use crate::capture::background::CaptureSlot;
use crate::capture::screenshot;
use crate::capture::video::replay_film::{self, ReplayFilm};
use crate::frame::farm_startup::FarmState;
use crate::frame::opening_still::OpeningStill;
use crate::frame::pipeline::FramePipeline;
use crate::input::{AimIntent, MatchIntent, ReplayIntent, StrokeIntent};
use crate::play::{BallMarks, CueView, Game, ShotClock};
use crate::scene::table_scene::TableScene;
use crate::scene::table_style::TableStyle;
use crate::settings::Settings;
use crate::ui::match_hud::MatchHud;

/// A game in progress. Times are seconds since the program started.
pub struct GameSession {
    game: Game,
    modes: ModeController,
    table_scene: TableScene,
    style: TableStyle,
    pipeline: FramePipeline,
    screenshot: CaptureSlot,
    film: CaptureSlot,
    /// Progress of screenshot and film at the last request of frames.
    capture_percents: [Option<u32>; 2],
    autosave: Autosave,
    /// The match that is suspended while the player practises.
    interrupted: Option<InterruptedMatch>,
    recorder: Option<ShotRecorder>,
    stats: Stats,
    balancing: Balancing,
    distribution: Distribution,
    /// Quality chosen by the player in the statistics, to be taken over to the settings.
    requested_quality: Option<QualityPreference>,
    /// Size of the window in pixels.
    pixels: ImageSize,
    last_advance_secs: f64,
    /// Whether a practice table was arranged when the simulation was last advanced.
    was_practising: bool,
    /// Whether the view from above was chosen because of practice.
    is_raised_for_practice: bool,
    /// Start of the present pause, if play is paused, and the total duration of earlier pauses.
    paused_secs: Option<f64>,
    lost_secs: f64,
    draw_secs: f64,
    was_thinking: bool,
    is_dirty: bool,
    is_hidden: bool,
    ball_marks: BallMarks,
}

impl GameSession {
    /// A session of a match on a table of `style`, with frames from the farm of `config`.
    ///
    /// # Errors
    /// If the scene is invalid or a thread cannot be started.
    pub fn new(config: FarmConfig, contest: Match, style: TableStyle) -> anyhow::Result<Self> {
        let table_scene = TableScene::of(&contest, style);
        Ok(Self {
            game: Game::of(contest),
            modes: ModeController::of_player(),
            style,
            screenshot: CaptureSlot::default(),
            film: CaptureSlot::default(),
            capture_percents: [None; 2],
            autosave: Autosave::default(),
            interrupted: None,
            recorder: None,
            stats: Stats::new(PathBuf::from(STATS_FOLDER)),
            balancing: config.balancer,
            distribution: config.distribution,
            requested_quality: None,
            pipeline: FramePipeline::new(config, table_scene.scene(), style.balls.max_depth())?,
            table_scene,
            pixels: ImageSize::new(0, 0),
            last_advance_secs: 0.0,
            was_practising: false,
            is_raised_for_practice: false,
            paused_secs: None,
            lost_secs: 0.0,
            draw_secs: 0.0,
            was_thinking: false,
            is_dirty: true,
            is_hidden: false,
            ball_marks: BallMarks::default(),
        })
    }

    /// Records every shot from now on.
    pub fn record(&mut self, recorder: ShotRecorder) {
        self.recorder = Some(recorder);
    }

    /// Pauses or resumes the time of play, replays and computer players; the farm keeps working.
    pub fn set_paused(&mut self, is_paused: bool, now_secs: f64) {
        if is_paused == self.paused_secs.is_some() {
            return;
        }
        match self.paused_secs.take() {
            Some(since_secs) => self.lost_secs += now_secs - since_secs,
            None => self.paused_secs = Some(now_secs),
        }
        self.is_dirty = true;
    }

    /// Play time, which does not advance while the game is paused.
    fn play_secs(&self, now_secs: f64) -> f64 {
        self.paused_secs.unwrap_or(now_secs) - self.lost_secs
    }

    /// Opens a replay of a recording.
    pub fn view(&mut self, recording: Recording) {
        self.modes
            .view(recording, &self.game, self.last_advance_secs);
    }

    /// Takes the messages for the player since the last call.
    pub fn take_notifications(&mut self) -> Vec<String> {
        self.modes.take_notifications()
    }

    /// Takes the response to the player's last action.
    pub fn take_notice(&mut self) -> Option<String> {
        self.game.take_notice()
    }

    /// Enables saving of the match to this file after every action.
    pub fn autosave_to(&mut self, path: PathBuf) {
        self.autosave.begin(path, self.game.contest());
    }

    /// Shows the opening still until the farm has traced a frame.
    pub fn show_opening_still(&mut self) {
        match OpeningStill::of(&self.table_scene) {
            Ok(Some(still)) => self.pipeline.scheduler_mut().show_still(still),
            Ok(None) => {}
            Err(why) => tracing::error!("{why:#}"),
        }
    }

    /// Sets the window's size.
    pub fn resize(&mut self, pixels: ImageSize) {
        self.pipeline.scheduler_mut().resize(pixels);
        self.pixels = pixels;
        self.is_dirty = true;
    }

    /// Changes the aim.
    pub fn aim(&mut self, intent: AimIntent, now_secs: f64) {
        if self.is_game() {
            self.game.change_aim(intent, self.play_secs(now_secs));
        }
    }

    /// Applies a step of a stroke.
    pub fn stroke(&mut self, intent: StrokeIntent, now_secs: f64) {
        if self.is_game() {
            let delay_secs = self.pipeline.scheduler().stroke_delay_secs();
            self.game
                .stroke(intent, self.play_secs(now_secs), delay_secs);
            self.record_shot();
        }
    }

    /// Applies a command to the camera of the present mode.
    pub fn look(&mut self, intent: CameraIntent, now_secs: f64) {
        let now_secs = self.play_secs(now_secs);
        match self.modes.mode_mut() {
            Mode::Replay(player) => player.look(intent, &self.game, now_secs),
            // A practice table is seen through the game's camera.
            Mode::Game | Mode::Practice(_) => self.game.look(intent, now_secs),
        }
    }

    /// Applies a decision in the match.
    pub fn decide(&mut self, intent: MatchIntent, now_secs: f64) {
        if self.is_game() && !self.lays_again(intent) {
            self.game.decide(intent, self.play_secs(now_secs));
        }
    }

    /// Opens, closes or controls a replay.
    pub fn replay(&mut self, intent: ReplayIntent, now_secs: f64) {
        self.record_shot();
        let now_secs = self.play_secs(now_secs);
        self.modes.replay(intent, &self.game, now_secs);
    }

    /// Opens or leaves practice.
    pub fn toggle_practice(&mut self) {
        self.modes.toggle_practice(&self.game);
    }

    /// Leaves a replay or practice, or cancels what is in progress in the game; false if there is nothing
    /// to cancel.
    pub fn escape(&mut self) -> bool {
        self.modes.close() || self.game.escape()
    }

    /// Shows the next level of the statistics.
    pub fn toggle_stats(&mut self) {
        self.stats.set_level(self.stats.level().next());
    }

    /// Takes a screenshot in full quality, or cancels the one that is being taken.
    pub fn take_screenshot(&mut self, now_secs: f64) {
        if self.screenshot.percent().is_some() {
            self.screenshot.cancel();
            return self.modes.notify(text!("screenshot-cancelled").to_owned());
        }
        let update = self.scene_at(ViewTime::Now(now_secs));
        let Some(farm) = self.pipeline.farm_mut() else {
            return self.modes.notify(text!("screenshot-no-farm").to_owned());
        };
        if self.pixels.pixels() == 0 {
            return;
        }
        let scene = self.table_scene.scene();
        let spec =
            screenshot::frame_spec(update.clone(), self.pixels, self.style.balls.max_depth());
        let folder = self.modes.folder().map(|folder| folder.join("pictures"));
        let slot = &mut self.screenshot;
        let begun = folder.and_then(|folder| screenshot::begin(slot, farm, scene, spec, folder));
        if let Err(why) = begun {
            let sentence = text!("screenshot-failed", why = why.to_string());
            self.modes.notify(sentence);
        }
        self.is_dirty = true;
    }

    /// Renders a film of a replay's shot in the present view, or cancels the one in progress.
    pub fn film_replay(&mut self) {
        self.is_dirty = true;
        if self.film.percent().is_some() {
            self.film.cancel();
            return self.modes.notify(text!("film-cancelled").to_owned());
        }
        let Mode::Replay(player) = self.modes.mode() else {
            return;
        };
        let shot = player.shot().clone();
        let replay = Mode::Replay(Box::new(player.restarted()));
        let updates = replay_film::moments(&shot).map(|moment_secs| {
            let view = replay.view(&self.game, ViewTime::Moment(moment_secs));
            view.update(&self.table_scene)
        });
        let updates: Vec<_> = updates.collect();
        let film = ReplayFilm {
            updates,
            shot: shot.clone(),
            size: ReplayFilm::SIZE,
            max_depth: self.style.balls.max_depth(),
        };
        let Some(farm) = self.pipeline.farm_mut() else {
            return self.modes.notify(text!("screenshot-no-farm").to_owned());
        };
        let scene = self.table_scene.scene();
        let slot = &mut self.film;
        let begun = self
            .modes
            .folder()
            .and_then(|folder| film.begin(slot, farm, scene, &folder.join("films")));
        if let Err(why) = begun {
            let sentence = text!("film-failed", why = why.to_string());
            self.modes.notify(sentence);
        }
    }

    /// Applies settings, except for the table's look, see [`GameSession::set_style`]. The resolution
    /// applies to the window's picture; screenshots have the window's size.
    pub fn apply(&mut self, settings: &Settings) {
        let scheduler = self.pipeline.scheduler_mut();
        scheduler.set_quality_preference(settings.quality);
        scheduler.set_resolution(settings.resolution);
        self.game.set_engine(settings.physics);
        self.game.set_aids(settings.aim_aids);
        self.game
            .set_particle_precision(settings.particle_precision);
        self.game.set_instant_camera(settings.reduced_motion);
        self.ball_marks = settings.ball_marks;
        self.is_dirty = true;
    }

    /// Changes the look of the table, such as the balls' material and the cloth.
    ///
    /// # Errors
    /// If the scene is invalid.
    pub fn set_style(&mut self, style: TableStyle) -> anyhow::Result<()> {
        self.style = style;
        let contest = InterruptedMatch::contest(self.interrupted.as_ref(), &self.game);
        self.set_table_scene(TableScene::of(contest, style))
    }

    /// Begins a rematch, in which the other player breaks; `seed` determines the racks.
    ///
    /// # Errors
    /// Those of [`GameSession::begin`].
    pub fn rematch(&mut self, seed: u32) -> anyhow::Result<()> {
        let contest = self.game.contest().rematch(seed)?;
        self.begin(contest)
    }

    /// Begins another match.
    ///
    /// # Errors
    /// If its scene is invalid.
    pub fn begin(&mut self, contest: Match) -> anyhow::Result<()> {
        let table_scene = TableScene::of(&contest, self.style);
        let was = std::mem::replace(&mut self.game, Game::of(contest));
        self.game.inherit_options(&was);
        self.interrupted = None;
        self.autosave.invalidate();
        self.set_table_scene(table_scene)
    }

    fn set_table_scene(&mut self, table_scene: TableScene) -> anyhow::Result<()> {
        let max_depth = self.style.balls.max_depth();
        self.pipeline.set_scene(table_scene.scene(), max_depth)?;
        self.table_scene = table_scene;
        self.is_dirty = true;
        Ok(())
    }

    /// Sets whether the window is hidden. No frames are requested then; the game goes on.
    pub fn set_hidden(&mut self, hidden: bool) {
        self.is_hidden = hidden;
        self.is_dirty = true;
    }

    /// Requests a redraw after a change outside of the session.
    pub fn redraw(&mut self) {
        self.is_dirty = true;
    }

    /// Sets the duration of the last redraw, for the statistics.
    pub fn set_draw_secs(&mut self, draw_secs: f64) {
        self.draw_secs = draw_secs;
    }

    /// Takes the quality chosen by the player in the statistics since the last call.
    pub fn take_requested_quality(&mut self) -> Option<QualityPreference> {
        self.requested_quality.take()
    }

    /// State of the match for its panels.
    pub fn match_hud(&mut self) -> MatchHud {
        let may_play = self.game.may_play();
        let view = self.game.match_view();
        let calls = may_play && (view.wants_call || view.may_push_out);
        MatchHud {
            may_redo: self.game.contest().may_redo(),
            aimed: calls.then(|| self.game.aimed_ball()).flatten(),
            call: calls.then(|| self.game.call_words()).flatten(),
            pockets: calls.then(|| self.game.contest().table_layout().clone()),
            may_play,
            is_thinking: self.game.is_thinking(),
            intention: self.game.intention().map(str::to_owned),
            view,
        }
    }

    /// Whether the pointer carries the cue ball.
    pub fn is_placing(&self) -> bool {
        self.game.ball_in_hand().is_some()
    }

    /// The cue, if it is visible.
    pub fn cue(&self, now_secs: f64) -> Option<CueView> {
        let cue = self.game.cue(self.play_secs(now_secs));
        cue.filter(|_| self.is_game())
    }

    /// Status of each node of the farm; empty while it starts or after it has failed.
    pub fn nodes(&self) -> Vec<NodeStatus> {
        self.pipeline.farm().nodes()
    }

    /// Status of the farm in a line.
    pub fn farm_line(&self) -> String {
        match self.pipeline.farm() {
            FarmState::Failed(why) => text!("farm-failed", why = why.as_str()),
            _ => notifications::line(&self.nodes()),
        }
    }

    /// The shot on show.
    pub fn shot(&self) -> Option<&Shot> {
        match self.modes.mode() {
            Mode::Replay(player) => Some(player.shot()),
            Mode::Game | Mode::Practice(_) => self.game.shot(),
        }
    }

    /// The clock of the shot on show, if it runs in real time.
    pub fn shot_clock(&self, now_secs: f64) -> Option<ShotClock> {
        let is_slow =
            matches!(self.modes.mode(), Mode::Replay(player) if player.clock().rate() != 1.0);
        self.mode_view(ViewTime::Now(now_secs))
            .clock
            .filter(|_| !is_slow)
    }

    /// The present viewpoint.
    pub fn viewpoint(&self, now_secs: f64) -> Viewpoint {
        self.mode_view(ViewTime::Now(now_secs)).viewpoint
    }

    fn mode_view(&self, time: ViewTime) -> ModeView {
        let time = match time {
            ViewTime::Now(now_secs) => ViewTime::Now(self.play_secs(now_secs)),
            moment => moment,
        };
        let mut view = self.modes.mode().view(&self.game, time);
        // While paused, there is no clock: no frames of future moments are requested.
        view.clock = view.clock.filter(|_| self.paused_secs.is_none());
        view
    }

    /// Whether the view changes with time.
    fn is_moving(&self) -> bool {
        self.paused_secs.is_none() && self.modes.mode().is_moving(&self.game)
    }

    /// Whether the game is on show rather than a replay or practice.
    pub fn is_game(&self) -> bool {
        matches!(self.modes.mode(), Mode::Game)
    }

    /// Whether a replay is on show.
    pub fn is_replay(&self) -> bool {
        matches!(self.modes.mode(), Mode::Replay(_))
    }

    /// The game.
    pub fn game(&self) -> &Game {
        &self.game
    }

    /// Whether the game is on show and its match is over.
    pub fn is_over(&self) -> bool {
        self.is_game() && self.game.contest().at_table().is_none()
    }

    /// Number of shots played since the program started.
    pub fn shots(&self) -> u64 {
        self.game.shots()
    }

    /// Whether something has changed since the window was last drawn.
    pub fn needs_redraw(&self) -> bool {
        self.is_dirty || self.pipeline.has_new_frame()
    }

    /// Whether nothing will change without input.
    pub fn is_at_rest(&self) -> bool {
        let is_moving = self.is_moving() || (self.paused_secs.is_none() && self.game.is_thinking());
        let is_still = self.pipeline.is_at_rest() && !self.is_dirty && !is_moving;
        let is_capturing = self.screenshot.percent().or(self.film.percent()).is_some();
        !is_capturing && (self.is_hidden || is_still)
    }
}

/// Folder for recordings of the statistics, relative to the working directory.
const STATS_FOLDER: &str = "carom-stats";
