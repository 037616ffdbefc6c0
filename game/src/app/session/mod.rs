//! A game and the farm that draws it, without a window: input in, picture and overlay out.

mod drawing;

use std::fs;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Duration;

use anyhow::Context as _;
use carom_billiards::game_match::{Match, MatchSave};
use carom_billiards::physics::{Engine, Recording, Shot};
use carom_farm::{Balancing, Distribution, Farm, FarmConfig, FrameId, NodeStatus};
use carom_tracer::{ImageSize, Scene, SceneUpdate};
use glam::DVec2;

use crate::app::farm_notifications;
use crate::app::screen_mode::{Mode, ModeController};
use crate::camera::Viewpoint;
use crate::capture::screenshot::Screenshot;
use crate::display::DisplayFrame;
use crate::frame::accumulation::AccumulationThread;
use crate::frame::quality::QualityPreference;
use crate::frame::reprojection::Reprojector;
use crate::frame::scheduler::{FrameScheduler, SchedulerAction, ViewTarget};
use crate::input::Intent;
use crate::play::{AimAids, CueView, Game, Outcome};
use crate::scene::ball_materials::BallSet;
use crate::scene::table_scene::TableScene;
use crate::ui::match_hud::MatchHud;
use crate::ui::stats::Stats;
use crate::ui::stats::frame_record::FrameSample;

/// A game in progress. Times are seconds since the program began.
pub struct GameSession {
    game: Game,
    modes: ModeController,
    /// Of the farm, for pictures that are kept.
    config: FarmConfig,
    max_depth: u32,
    pixels: ImageSize,
    set: BallSet,
    /// Where the match is kept, and how much of it is.
    keeper: Option<(PathBuf, usize)>,
    table_scene: TableScene,
    scheduler: FrameScheduler,
    accumulation: AccumulationThread,
    reprojector: Reprojector,
    farm: FarmState,
    in_flight_max: usize,
    last_frame: FrameId,
    film: DVec2,
    stats: Stats,
    balancing: Balancing,
    distribution: Distribution,
    /// What the player has chosen in the statistics; the settings follow.
    requested_quality: Option<QualityPreference>,
    last_tick_secs: f64,
    draw_secs: f64,
    /// The picture that was drawn last.
    serial: u64,
    was_thinking: bool,
    dirty: bool,
    /// Whether the farm that is starting has to be told of another scene.
    is_scene_new: bool,
    is_hidden: bool,
    /// Where fresh shots are kept, and the number of the last that was.
    recorder: Option<(PathBuf, u64)>,
}

/// The farm is built beside the window: looking for a GPU takes a second.
enum FarmState {
    Starting(Receiver<Result<Farm, carom_farm::Error>>),
    Ready(Box<Farm>),
    Failed(String),
}

impl GameSession {
    /// Goes on with a match, with balls of `set`; the pictures come from the farm of `config`.
    ///
    /// # Errors
    /// A sentence if the room cannot be traced.
    pub fn new(config: FarmConfig, contest: Match, set: BallSet) -> anyhow::Result<Self> {
        let table_scene = TableScene::of(&contest, set);
        Ok(Self {
            game: Game::of(contest),
            set,
            keeper: None,
            modes: ModeController::of_player(),
            config: config.clone(),
            max_depth: set.max_depth(),
            pixels: ImageSize::new(0, 0),
            scheduler: FrameScheduler::new(
                ImageSize::new(0, 0),
                config.frames_in_flight,
                set.max_depth(),
            ),
            accumulation: AccumulationThread::open()?,
            reprojector: Reprojector::new(table_scene.scene())?,
            in_flight_max: config.frames_in_flight,
            balancing: config.balancer,
            distribution: config.distribution,
            requested_quality: None,
            farm: start_farm(config, table_scene.scene().clone()),
            table_scene,
            last_frame: FrameId::default(),
            film: DVec2::ONE,
            stats: Stats::new(PathBuf::from(STATS_FOLDER)),
            last_tick_secs: 0.0,
            draw_secs: 0.0,
            serial: 0,
            was_thinking: false,
            dirty: true,
            is_scene_new: false,
            is_hidden: false,
            recorder: None,
        })
    }

    /// Lets something else move the balls from the next stroke on.
    pub fn set_engine(&mut self, engine: Engine) {
        self.game.set_engine(engine);
    }

    /// Keeps every shot from now on as a file in a folder, which is made if there is none.
    ///
    /// # Errors
    /// A sentence if the folder cannot be made.
    pub fn record(&mut self, folder: PathBuf) -> anyhow::Result<()> {
        fs::create_dir_all(&folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        self.recorder = Some((folder, 0));
        Ok(())
    }

    /// Shows shots that were kept.
    pub fn view(&mut self, recording: Recording) {
        self.modes.view(recording, &self.game, self.last_tick_secs);
    }

    /// Sentences for the player that are new.
    pub fn take_notifications(&mut self) -> Vec<String> {
        self.modes.take_notifications()
    }

    /// Keeps the match in this file from now on, whenever something was done.
    pub fn autosave_to(&mut self, path: PathBuf) {
        self.keeper = Some((path, self.game.contest().action_count()));
    }

    fn autosave(&mut self) {
        let contest = self.game.contest();
        let Some((path, kept)) = &mut self.keeper else {
            return;
        };
        if *kept == contest.action_count() {
            return;
        }
        *kept = contest.action_count();
        if let Err(why) = MatchSave::of(contest).save(path) {
            tracing::error!("{why}");
        }
    }

    /// What is shown of the match.
    pub fn match_hud(&mut self) -> MatchHud {
        let may_play = self.game.may_play();
        let view = self.game.board();
        let calls = may_play && (view.wants_call || view.may_push_out);
        MatchHud {
            aimed: calls.then(|| self.game.aimed_ball()).flatten(),
            call: calls.then(|| self.game.call_words()).flatten(),
            pockets: calls.then(|| self.game.contest().table_layout().clone()),
            may_play,
            is_thinking: self.game.is_thinking(),
            view,
        }
    }

    /// Whether the pointer carries the cue ball.
    pub fn is_placing(&self) -> bool {
        self.game.ball_in_hand().is_some()
    }

    fn keep_shot(&mut self) {
        let Some((number, shot)) = self.game.fresh_shot() else {
            return;
        };
        self.modes.record_shot(number, shot);
        let Some((folder, last)) = &mut self.recorder else {
            return;
        };
        if number > *last {
            *last = number;
            let title = format!("Shot {number}");
            let recording = Recording::of(self.game.table(), title, shot.clone());
            if let Err(error) = recording.save(&folder.join(format!("shot_{number:04}.carom"))) {
                tracing::error!("{error}");
            }
        }
    }

    /// Follows the window: its size in pixels, and in points.
    pub fn resize(&mut self, pixels: ImageSize, points: DVec2) {
        self.scheduler.resize(pixels);
        self.pixels = pixels;
        self.film = points;
        self.dirty = true;
    }

    /// Does what the player wants.
    pub fn act(&mut self, intent: Intent, now_secs: f64) -> Outcome {
        self.dirty = true;
        if intent == Intent::ToggleStats {
            self.stats.set_level(self.stats.level().next());
        }
        if intent == Intent::Photograph {
            self.take_screenshot(now_secs);
            return Outcome::Stay;
        }
        if self.modes.handle_intent(intent, &self.game, now_secs) {
            return Outcome::Stay;
        }
        match intent {
            Intent::LookBack => self.modes.open_replay(&self.game, now_secs),
            Intent::Practise => self.modes.open_practice(&self.game),
            _ => {}
        }
        let delay_secs = self.scheduler.stroke_delay_secs();
        let outcome = self.game.apply(intent, now_secs, delay_secs, self.film);
        self.keep_shot();
        outcome
    }

    /// Lets time pass: takes finished pictures, moves the game on, asks for new pictures. Never
    /// waits for the farm.
    pub fn tick(&mut self, now_secs: f64) {
        let dt_secs = (now_secs - self.last_tick_secs).clamp(0.0, TICK_SECS_MAX);
        self.last_tick_secs = now_secs;
        self.game.tick(now_secs, dt_secs);
        self.modes.tick(now_secs);
        self.dirty |= self.modes.is_moving(&self.game);
        if self.was_thinking != self.game.is_thinking() {
            self.was_thinking = self.game.is_thinking();
            self.dirty = true;
        }
        self.autosave();
        if let Err(why) = self.exchange(now_secs) {
            tracing::error!("the farm: {why}");
            self.farm = FarmState::Failed(why);
        }
    }

    /// Shows more or less of the shot to come.
    pub fn set_aids(&mut self, aids: AimAids) {
        self.game.set_aids(aids);
        self.dirty = true;
    }

    /// Lets the camera cut to where it would glide.
    pub fn set_instant_camera(&mut self, instant_camera: bool) {
        self.game.set_instant_camera(instant_camera);
    }

    /// The cue, while there is one to show.
    pub fn cue(&self, now_secs: f64) -> Option<CueView> {
        self.game.cue(now_secs).filter(|_| self.is_game())
    }

    /// What is given up first while things move.
    pub fn set_quality_preference(&mut self, preference: QualityPreference) {
        self.scheduler.set_quality_preference(preference);
        self.dirty = true;
    }

    /// Plays on with balls of another material.
    ///
    /// # Errors
    /// A sentence if the room cannot be traced with them.
    pub fn set_ball_set(&mut self, set: BallSet) -> anyhow::Result<()> {
        self.set = set;
        self.scheduler.set_max_depth(set.max_depth());
        self.set_table_scene(TableScene::of(self.game.contest(), set))
    }

    /// Plays another match.
    ///
    /// # Errors
    /// A sentence if its room cannot be traced.
    pub fn begin(&mut self, contest: Match) -> anyhow::Result<()> {
        let table_scene = TableScene::of(&contest, self.set);
        let was = std::mem::replace(&mut self.game, Game::of(contest));
        self.game.inherit_options(&was);
        if let Some((_, kept)) = &mut self.keeper {
            *kept = usize::MAX;
        }
        self.set_table_scene(table_scene)
    }

    fn set_table_scene(&mut self, table_scene: TableScene) -> anyhow::Result<()> {
        self.reprojector = Reprojector::new(table_scene.scene())?;
        self.table_scene = table_scene;
        self.max_depth = self.set.max_depth();
        match &mut self.farm {
            FarmState::Ready(farm) => {
                farm.cancel_before(FrameId(self.last_frame.0 + 1));
                farm.set_scene(self.table_scene.scene())?;
            }
            // It starts with the scene of before.
            FarmState::Starting(_) => self.is_scene_new = true,
            FarmState::Failed(_) => {}
        }
        self.dirty = true;
        Ok(())
    }

    /// Asks for no pictures while the window cannot be seen; the game goes on.
    pub fn set_hidden(&mut self, hidden: bool) {
        self.is_hidden = hidden;
        self.dirty = true;
    }

    /// How each node of the farm is; none while it starts, or if it could not.
    pub fn nodes(&self) -> Vec<NodeStatus> {
        match &self.farm {
            FarmState::Ready(farm) => farm.nodes(),
            _ => Vec::new(),
        }
    }

    /// The farm in a line.
    pub fn farm_line(&self) -> String {
        match &self.farm {
            FarmState::Failed(why) => format!("No pictures: {why}"),
            _ => farm_notifications::line(&self.nodes()),
        }
    }

    /// The shot that is on.
    pub fn shot(&self) -> Option<&Shot> {
        match self.modes.mode() {
            Mode::Replay(player) => Some(player.shot()),
            Mode::Game | Mode::Practice(_) => self.game.shot(),
        }
    }

    /// The number of the shot that is on at its own speed, the moment on show and that of its end, in
    /// seconds since the blow.
    pub fn shot_clock(&self, now_secs: f64) -> Option<(u64, f64, f64)> {
        let is_slow = match self.modes.mode() {
            Mode::Replay(player) => player.clock().rate() != 1.0,
            Mode::Game | Mode::Practice(_) => false,
        };
        let clock = self.modes.shot_clock(&self.game, now_secs);
        clock.filter(|_| !is_slow)
    }

    /// Whether the game is on show, and nothing in its place.
    pub fn is_game(&self) -> bool {
        matches!(self.modes.mode(), Mode::Game)
    }

    /// Whether a shot of before is on show.
    pub fn is_replay(&self) -> bool {
        matches!(self.modes.mode(), Mode::Replay(_))
    }

    /// Whether a shot was played: then the player knows how.
    pub fn has_played(&self) -> bool {
        self.game.shots() > 0
    }

    /// Draws again, as something outside the game has changed.
    pub fn redraw(&mut self) {
        self.dirty = true;
    }

    /// Whether something has changed since the last [`GameSession::draw`].
    pub fn needs_redraw(&mut self) -> bool {
        let reprojector = &mut self.reprojector;
        let fill = &mut |picture: &mut _, missing: &_, before: &_| {
            reprojector.fill(picture, missing, before)
        };
        let serial = self
            .scheduler
            .picture(fill)
            .map_or(0, |picture| picture.serial);
        self.dirty || serial != self.serial
    }

    /// Whether nothing will change without input.
    pub fn is_at_rest(&self) -> bool {
        let drawn = match &self.farm {
            FarmState::Starting(_) => false,
            FarmState::Ready(_) => self.scheduler.is_at_rest(),
            FarmState::Failed(_) => true,
        };
        let is_moving = self.modes.is_moving(&self.game)
            || self.modes.is_taking_screenshot()
            || self.game.is_thinking();
        self.is_hidden || (drawn && !self.dirty && !is_moving)
    }

    /// The picture to show under the overlay at `now_secs`: the newest, as the table looks now.
    pub fn picture(&mut self, now_secs: f64) -> Option<&DisplayFrame> {
        let moment = self.moment(now_secs);
        let now = self.update(moment);
        let reprojector = &mut self.reprojector;
        let fill = &mut |picture: &mut _, missing: &_, before: &_| {
            reprojector.fill(picture, missing, before)
        };
        let picture = self.scheduler.picture(fill)?;
        self.serial = picture.serial;
        Some(self.reprojector.reproject_to(picture, &now))
    }

    /// The moment on show of the shot that is on.
    fn moment(&self, now_secs: f64) -> f64 {
        let shot = self.modes.shot_clock(&self.game, now_secs);
        shot.map_or(0.0, |(_, clock, end)| clock.min(end))
    }

    /// The view on show.
    pub fn viewpoint(&self, now_secs: f64) -> Viewpoint {
        self.modes.viewpoint(&self.game, self.moment(now_secs))
    }

    /// What is on show at a moment of its shot, if one is on.
    fn update(&self, moment: f64) -> SceneUpdate {
        let (modes, game) = (&self.modes, &self.game);
        let camera = modes.camera(game, moment);
        self.table_scene.update(camera, &modes.poses(game, moment))
    }

    fn take_screenshot(&mut self, now_secs: f64) {
        let update = self.update(self.moment(now_secs));
        let still = Screenshot::of(update, self.pixels, self.max_depth);
        let (config, scene) = (self.config.clone(), self.table_scene.scene().clone());
        if self.pixels.pixels() > 0 {
            let begin = |folder| Screenshot::begin(config, scene, still, folder);
            self.modes.take_screenshot(begin);
        }
    }

    fn exchange(&mut self, now_secs: f64) -> Result<(), String> {
        self.settle_farm()?;
        let FarmState::Ready(farm) = &mut self.farm else {
            return Ok(());
        };
        while let Some(frame) = farm.poll_frame() {
            if self.stats.is_shown() {
                let stats = frame.stats.clone();
                let samples = self.scheduler.samples_of(frame.id).unwrap_or(0);
                self.stats.take(FrameSample {
                    frame: frame.id.0,
                    at_secs: now_secs,
                    size: frame.size,
                    samples,
                    stats,
                    nodes: &farm.nodes(),
                });
            }
            if let Some(batch) = self.scheduler.finished(frame) {
                self.accumulation.submit(batch);
            }
        }
        while let Some(frame) = self.accumulation.poll() {
            self.scheduler.accumulated(frame);
        }
        if self.is_hidden {
            farm.cancel_before(FrameId(self.last_frame.0 + 1));
            return Ok(());
        }
        let (modes, game, table_scene) = (&self.modes, &self.game, &self.table_scene);
        let shot = modes.shot_clock(game, now_secs);
        let scene_at = |moment: f64| {
            let camera = modes.camera(game, moment);
            table_scene.update(camera, &modes.poses(game, moment))
        };
        let target = match shot {
            Some((number, clock_secs, end_secs)) => ViewTarget::Shot {
                number,
                clock_secs,
                end_secs,
            },
            None => ViewTarget::Live(scene_at(now_secs)),
        };
        loop {
            let room = self.in_flight_max.saturating_sub(farm.in_flight());
            match self.scheduler.plan(now_secs, &target, room, &scene_at) {
                SchedulerAction::Rest => return Ok(()),
                SchedulerAction::CancelAll => farm.cancel_before(FrameId(self.last_frame.0 + 1)),
                SchedulerAction::Trace(order) => {
                    let submitted = farm.submit_by(order.spec.clone(), order.deadline);
                    self.last_frame = submitted.map_err(|error| error.to_string())?;
                    self.scheduler.submitted(self.last_frame, &order);
                }
            }
        }
    }

    fn settle_farm(&mut self) -> Result<(), String> {
        let FarmState::Starting(receiver) = &self.farm else {
            return Ok(());
        };
        match receiver.try_recv() {
            Ok(Ok(mut farm)) => {
                if std::mem::take(&mut self.is_scene_new) {
                    farm.set_scene(self.table_scene.scene())
                        .map_err(|error| error.to_string())?;
                }
                self.farm = FarmState::Ready(Box::new(farm));
            }
            Ok(Err(error)) => return Err(error.to_string()),
            Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) => return Err("it could not be started".to_owned()),
        }
        Ok(())
    }

    /// What the player has chosen to give up first, since the last call.
    pub fn take_requested_quality(&mut self) -> Option<QualityPreference> {
        self.requested_quality.take()
    }

    /// What the window needed for the last redraw, seconds.
    pub fn note_draw(&mut self, draw_secs: f64) {
        self.draw_secs = draw_secs;
    }
}

impl Drop for GameSession {
    /// A GPU's driver must not be set up in a process that is exiting meanwhile.
    fn drop(&mut self) {
        if let FarmState::Starting(farm) = &self.farm {
            let _ = farm.recv_timeout(START_PATIENCE);
        }
    }
}

fn start_farm(config: FarmConfig, scene: Scene) -> FarmState {
    let (sender, receiver) = channel();
    let start = move || {
        let farm = Farm::new(config).and_then(|mut farm| farm.set_scene(&scene).map(|()| farm));
        // Nobody waits for a farm any more once the window is closed.
        let _ = sender.send(farm);
    };
    match thread::Builder::new()
        .name("farm start".to_owned())
        .spawn(start)
    {
        Ok(_) => FarmState::Starting(receiver),
        Err(error) => FarmState::Failed(error.to_string()),
    }
}

/// How long the farm may take to start when the window is closed; a GPU needs 0.1 to 1.2 s.
const START_PATIENCE: Duration = Duration::from_secs(3);
/// A pause, such as a window being dragged, is not made up for at once.
const TICK_SECS_MAX: f64 = 0.1;
/// Where recordings of the statistics go, in the folder that the game was begun in.
const STATS_FOLDER: &str = "carom-stats";
