//! A match as it is played: aim, draw the cue back, strike, watch, and so on with whoever is next.
//!
//! ```text
//! turn_control ─▶ ball_in_hand ─▶ aim ─┬▶ shot_preview
//!  │                                   └▶ stroke_input ─▶ active_shot ─▶ turn_control
//!  └─▶ ai_turn (the computer's turn) ────────────────────────▲
//! ```
//! Knows neither window nor farm; time is an argument.

mod active_shot;
mod ai_turn;
mod aim;
mod ball_in_hand;
mod cue;
mod cue_clearance;
pub mod practice;
mod shot_clock;
mod shot_preview;
mod shot_worker;
mod stroke_input;
#[cfg(test)]
mod tests;
pub mod tournament;
pub mod tricks;
mod turn_control;

use std::cell::OnceCell;
use std::rc::Rc;
use std::sync::Arc;

use carom_billiards::game_match::{self, Match, MatchConfig, Player};
use carom_billiards::physics::{self, AimContact, BallPose, Pocket, Shot, Stroke, Table, World};
use carom_billiards::rules::{Call, RuleSet};
use carom_text::text;
use carom_tracer::Camera;
use glam::{DVec2, DVec3};

use crate::camera::{
    CameraIntent, CameraSmoother, CameraView, Framing, Projection, ViewContext, ViewSelection,
    Viewpoint, wrap_rad,
};
use crate::input::{AimIntent, StrokeIntent};
use crate::particles::{BedMoment, ParticleMoment};
use crate::scene::table_scene::TableScene;

use active_shot::ActiveShot;
use ai_turn::{AiTurn, PlannedStroke};
pub use aim::{Aim, CUE_SPEED_M_S_MAX, cue_speed_m_s, power_of_speed};
pub use ball_in_hand::BallInHand;
pub use cue::CueView;
use cue::SWING_SECS;
use cue_clearance::CueClearance;
pub use cue_clearance::cue_of_shot;
use practice::PracticeLayout;
pub use shot_clock::ShotClock;
pub use shot_preview::{AimAids, BallMarks, BallPath, PathEnd, ShotPreview};
use shot_worker::ShotWorker;
use stroke_input::{StrokeInput, SwingInput};

/// A match, and how it is looked at.
#[derive(Debug)]
pub struct Game {
    contest: Match,
    match_view: Option<Rc<game_match::MatchView>>,
    ai_turn: Option<AiTurn>,
    phase: TurnPhase,
    aim: Aim,
    views: ViewSelection,
    smoother: CameraSmoother,
    instant_camera: bool,
    shots: u64,
    aids: AimAids,
    shot_preview: Option<(Stroke, Option<ShotPreview>)>,
    notice: Option<String>,
    /// The window, and what panels leave of it.
    framing: Framing,
    /// Whether the power was set for a break.
    is_break: bool,
    particle_precision: physics::ParticlePrecision,
}

/// What the player is doing.
#[derive(Debug)]
enum TurnPhase {
    /// Looking for the shot.
    Aiming,
    /// Carrying the cue ball.
    Placing(BallInHand),
    /// Seeing the computer take aim.
    Planned(Box<PlannedStroke>),
    /// Striking.
    Stroking(StrokeInput),
    /// Waiting, the cue drawn back, for what a shot through particles will be.
    Simulating(Box<ShotWorker>),
    /// Watching.
    Watching(Box<ActiveShot>),
}

impl Game {
    /// A free table, freshly racked; `seed` draws the racks.
    ///
    /// # Errors
    /// A sentence if the physics refuses its own table.
    pub fn new(seed: u32) -> carom_billiards::Result<Self> {
        Ok(Self::of(free_table(TableScene::table(), seed)?))
    }

    /// A match where it stands.
    pub fn of(contest: Match) -> Self {
        let table = contest.world().table();
        let mut game = Self {
            views: ViewSelection::new(table),
            smoother: CameraSmoother::new(Viewpoint::overview(table, 0.0)),
            contest,
            match_view: None,
            ai_turn: None,
            phase: TurnPhase::Aiming,
            aim: Aim::LEVEL,
            instant_camera: false,
            shots: 0,
            aids: AimAids::default(),
            shot_preview: None,
            notice: None,
            framing: Framing::whole(DVec2::ONE),
            is_break: false,
            particle_precision: physics::ParticlePrecision::default(),
        };
        game.begin_turn();
        game.smoother = CameraSmoother::new(game.aim_view());
        game
    }

    /// Plays with the aids, the physics and the camera cuts of another game, and counts its shots on.
    pub fn inherit_options(&mut self, other: &Self) {
        (self.aids, self.instant_camera, self.shots) =
            (other.aids, other.instant_camera, other.shots);
        self.set_engine(other.contest.world().engine());
        self.particle_precision = other.particle_precision;
    }

    /// How finely what is laid on the table is simulated.
    pub fn particle_precision(&self) -> physics::ParticlePrecision {
        self.particle_precision
    }

    /// Simulates what is laid on the table from now on as finely as this.
    pub fn set_particle_precision(&mut self, precision: physics::ParticlePrecision) {
        self.particle_precision = precision;
    }

    /// Follows the window and its panels.
    pub fn set_framing(&mut self, framing: Framing) {
        self.framing = framing;
    }

    /// The window, and what panels leave of it.
    pub fn framing(&self) -> Framing {
        self.framing
    }

    /// The camera's map to the window, at `moment_secs` of the shot that is on, else now.
    pub fn projection(&self, moment_secs: f64) -> Projection {
        let film = self.framing.film;
        Projection::new(&self.camera(moment_secs), film.x, film.y)
    }

    /// Lets something else move the balls from the next stroke on.
    pub fn set_engine(&mut self, engine: physics::Engine) {
        self.contest.set_engine(engine);
        self.shot_preview = None;
    }

    /// Lets the camera cut to where it would glide.
    pub fn set_instant_camera(&mut self, instant_camera: bool) {
        self.instant_camera = instant_camera;
    }

    /// Puts balls and particles of a free table so, with nothing in motion.
    ///
    /// # Errors
    /// A sentence if they cannot lie like this, or in a game with rules; it stays as it was.
    pub fn lay(&mut self, layout: &PracticeLayout) -> carom_billiards::Result<()> {
        self.contest
            .arrange(&layout.balls, layout.particles.clone())?;
        if let TurnPhase::Watching(active) = &self.phase {
            self.smoother = CameraSmoother::new(active.from);
        }
        self.phase = TurnPhase::Aiming;
        self.begin_turn();
        Ok(())
    }

    /// The balls as they lay before the shot that is on, else as they lie.
    pub fn world(&self) -> &World {
        self.contest.world()
    }

    /// What is played on.
    pub fn table(&self) -> &Table {
        self.contest.world().table()
    }

    /// The shot that is on.
    pub fn shot(&self) -> Option<&Shot> {
        match &self.phase {
            TurnPhase::Watching(active) => Some(&active.shot),
            _ => None,
        }
    }

    /// How many shots were played or shown.
    pub fn shots(&self) -> u64 {
        self.shots
    }

    /// The shot that is being played for the first time, with its number.
    pub fn fresh_shot(&self) -> Option<(u64, &Shot)> {
        match &self.phase {
            TurnPhase::Watching(active) => Some((self.shots, &active.shot)),
            _ => None,
        }
    }

    /// Gives up the stroke that is begun or the ball that is carried; false if there is neither.
    pub fn escape(&mut self) -> bool {
        match &self.phase {
            TurnPhase::Stroking(_) => self.cancel(),
            TurnPhase::Placing(_) => self.put_back(),
            TurnPhase::Simulating(_) => self.phase = TurnPhase::Aiming,
            TurnPhase::Aiming | TurnPhase::Planned(_) | TurnPhase::Watching(_) => return false,
        }
        true
    }

    /// Lets time pass: the camera glides, a shot that is over ends.
    pub fn tick(&mut self, now_secs: f64, dt_secs: f64) {
        match &self.phase {
            TurnPhase::Watching(active)
                if active.clock_secs(now_secs) >= active.shot.duration_secs() =>
            {
                self.end_shot(now_secs);
            }
            TurnPhase::Watching(_) => return,
            TurnPhase::Planned(_) => self.follow_plan(now_secs),
            TurnPhase::Simulating(_) => self.follow_simulation(now_secs),
            _ => self.think(now_secs),
        }
        match &self.phase {
            TurnPhase::Watching(_) => {}
            _ if self.instant_camera => self.smoother = CameraSmoother::new(self.aim_view()),
            _ => self.smoother.follow(self.aim_view(), dt_secs),
        }
    }

    /// The clock of the shot that is on.
    pub fn shot_clock(&self, now_secs: f64) -> Option<ShotClock> {
        let TurnPhase::Watching(active) = &self.phase else {
            return None;
        };
        Some(ShotClock {
            number: self.shots,
            now_secs: active.clock_secs(now_secs),
            end_secs: active.shot.duration_secs(),
        })
    }

    /// The balls at `moment_secs` of the shot that is on, else as they lie.
    pub fn poses(&self, moment_secs: f64) -> Vec<BallPose> {
        match &self.phase {
            TurnPhase::Watching(active) => active.shot.poses_at(moment_secs.max(0.0)),
            _ => self.lying().collect(),
        }
    }

    /// The camera at `moment_secs` of the shot that is on, else now.
    pub fn camera(&self, moment_secs: f64) -> Camera {
        self.viewpoint(moment_secs).camera_in(self.table())
    }

    /// The view at `moment_secs` of the shot that is on, else now.
    pub fn viewpoint(&self, moment_secs: f64) -> Viewpoint {
        match &self.phase {
            TurnPhase::Watching(active) => {
                active.viewpoint(moment_secs, &self.views, self.table(), self.framing)
            }
            _ => self.smoother.viewpoint(),
        }
    }

    /// The particles at `moment_secs` of the shot that is on, else as they lie.
    pub fn particles(&self, moment_secs: f64) -> ParticleMoment {
        match &self.phase {
            TurnPhase::Watching(active) => active.particles(moment_secs),
            _ => ParticleMoment {
                dust: None,
                bed: self
                    .contest
                    .world()
                    .particles()
                    .map(|bed| BedMoment::Lying(Arc::clone(bed))),
            },
        }
    }

    /// The cue at `moment_secs` of the shot that is on.
    pub fn cue_in_shot(&self, moment_secs: f64) -> Option<CueView> {
        match &self.phase {
            TurnPhase::Watching(active) => active.cue.clone()?.swung(moment_secs),
            _ => None,
        }
    }

    /// Cue and aim, while there is one to show.
    pub fn cue(&self, now_secs: f64) -> Option<CueView> {
        let resting = CueView::resting(self.cue_ball()?, &self.aim);
        match &self.phase {
            TurnPhase::Aiming => self.contest.at_table().map(|_| resting),
            TurnPhase::Placing(_) => None,
            TurnPhase::Planned(planned) => self.planned_cue(planned, now_secs),
            TurnPhase::Simulating(worker) => worker.cue.clone(),
            TurnPhase::Stroking(input) => {
                let power = input.power(now_secs).unwrap_or(self.aim.power);
                Some(resting.drawn(power, input.drawn_m(now_secs)))
            }
            TurnPhase::Watching(active) => self.cue_in_shot(active.clock_secs(now_secs)),
        }
    }

    /// Where the balls would go, by the code that moves them, as far as the aids show it; nothing
    /// during a shot.
    pub fn shot_preview(&mut self, now_secs: f64) -> Option<&ShotPreview> {
        let power = match &self.phase {
            TurnPhase::Aiming => self.aim.power,
            // A rising power would change the prediction all the time.
            TurnPhase::Stroking(input) => input.power(now_secs).unwrap_or(self.aim.power),
            TurnPhase::Watching(_)
            | TurnPhase::Simulating(_)
            | TurnPhase::Planned(_)
            | TurnPhase::Placing(_) => return None,
        };
        if !self.may_play() && !matches!(self.phase, TurnPhase::Stroking(_)) {
            return None;
        }
        let stroke = match self.aids {
            AimAids::Full => self.aim.stroke(power),
            // Where the balls go at first depends little on the power.
            _ => self.aim.stroke(LINE_POWER),
        };
        if self
            .shot_preview
            .as_ref()
            .is_none_or(|(of, _)| *of != stroke)
        {
            self.shot_preview = Some((
                stroke,
                ShotPreview::of(self.contest.world(), stroke, self.aids),
            ));
        }
        self.shot_preview
            .as_ref()
            .and_then(|(_, shot_preview)| shot_preview.as_ref())
    }

    /// Shows more or less of the shot to come.
    pub fn set_aids(&mut self, aids: AimAids) {
        if std::mem::replace(&mut self.aids, aids) != aids {
            self.shot_preview = None;
        }
    }

    /// Where the cue points.
    pub fn aim(&self) -> Aim {
        self.aim
    }

    /// The answer to what the player did last, once.
    pub fn take_notice(&mut self) -> Option<String> {
        self.notice.take()
    }

    /// Whether time alone changes what is seen.
    pub fn is_moving(&self) -> bool {
        match &self.phase {
            TurnPhase::Stroking(StrokeInput::Charging(_))
            | TurnPhase::Watching(_)
            | TurnPhase::Simulating(_)
            | TurnPhase::Planned(_) => true,
            _ => self.smoother.viewpoint() != self.aim_view(),
        }
    }

    /// The view that is chosen.
    pub fn view(&self) -> CameraView {
        self.views.view()
    }

    /// Turns the camera, or chooses another view.
    pub fn look(&mut self, intent: CameraIntent, now_secs: f64) {
        let moment_secs = match &self.phase {
            TurnPhase::Watching(active) => active.clock_secs(now_secs),
            _ => 0.0,
        };
        let now = self.viewpoint(moment_secs);
        self.views.apply(intent, self.contest.world().table(), now);
        if intent.is_adjustment() {
            return;
        }
        self.notice = Some(text!("view-chosen", name = self.views.view().name()));
        if let TurnPhase::Watching(active) = &mut self.phase {
            active.turn(now, moment_secs);
        }
    }

    /// Changes the aim; moves a cue ball that is carried.
    pub fn change_aim(&mut self, intent: AimIntent, now_secs: f64) {
        if self.carry(intent) {
            return;
        }
        let is_aiming = matches!(self.phase, TurnPhase::Aiming) && self.may_play();
        match intent {
            AimIntent::AimAt(point) => self.aim_at(point, now_secs),
            // A blow that is under way is struck where it was aimed.
            _ if !is_aiming => {}
            AimIntent::Turn(angle_rad) => self.aim.turn(angle_rad),
            AimIntent::MoveTip(by) => self.aim.set_tip(self.aim.tip + by),
            AimIntent::SetTip(tip) => self.aim.set_tip(tip),
            AimIntent::CenterTip => self.aim.level(),
            AimIntent::Elevate(by_rad) => self.aim.elevate(by_rad),
            AimIntent::ChangePower(by) => self.aim.set_power(self.aim.power + by),
            AimIntent::SetPower(power) => self.aim.set_power(power),
        }
        self.clear_cue();
    }

    /// Raises the cue over what is in its way.
    fn clear_cue(&mut self) {
        let balls = self.contest.world().balls();
        if let Some(clearance) = CueClearance::new(self.contest.world().table(), &balls) {
            clearance.raise(&mut self.aim);
        }
    }

    fn aim_at(&mut self, point: DVec2, now_secs: f64) {
        let projection = self.projection(now_secs);
        let target = projection.world_from_film(point, self.cue_ball().map_or(0.0, |ball| ball.z));
        if let (true, Some(target), Some(ball)) = (self.may_play(), target, self.cue_ball()) {
            let way = (target - ball).truncate();
            if way.length() > 0.01 {
                self.aim.bearing_rad = way.to_angle();
            }
        }
    }

    /// Goes on with the stroke. It meets the ball `lead_secs` later, so that its first pictures are
    /// ready by then, but never so late that the player would wait.
    pub fn stroke(&mut self, intent: StrokeIntent, now_secs: f64, lead_secs: f64) {
        if matches!(self.phase, TurnPhase::Placing(_)) {
            return self.stroke_in_hand(intent);
        }
        if matches!(self.phase, TurnPhase::Aiming) && !self.may_play() {
            return;
        }
        let power = match (intent, &mut self.phase) {
            (StrokeIntent::BeginPull, TurnPhase::Aiming) => {
                return self.begin(StrokeInput::Pulling(0.0));
            }
            (StrokeIntent::BeginCharge, TurnPhase::Aiming) => {
                return self.begin(StrokeInput::Charging(now_secs));
            }
            (StrokeIntent::BeginSwing, TurnPhase::Aiming) => {
                return self.begin(StrokeInput::Swinging(SwingInput::default()));
            }
            (StrokeIntent::Pull(power), TurnPhase::Stroking(StrokeInput::Pulling(pulled))) => {
                *pulled = power;
                return;
            }
            (StrokeIntent::Swing(back_m), TurnPhase::Stroking(StrokeInput::Swinging(swing))) => {
                swing.swing(back_m, now_secs)
            }
            (StrokeIntent::Release, TurnPhase::Stroking(input)) => {
                let power = input.let_go(now_secs);
                if power.is_none() {
                    self.cancel();
                }
                power
            }
            (StrokeIntent::Strike, TurnPhase::Aiming) => Some(self.aim.power),
            (StrokeIntent::Cancel, _) => return self.cancel(),
            _ => None,
        };
        if let Some(power) = power {
            self.strike(power, now_secs, lead_secs);
        }
    }

    fn begin(&mut self, input: StrokeInput) {
        self.phase = TurnPhase::Stroking(input);
    }

    fn cancel(&mut self) {
        if matches!(self.phase, TurnPhase::Stroking(_)) {
            self.phase = TurnPhase::Aiming;
        }
    }

    fn strike(&mut self, power: f64, now_secs: f64, lead_secs: f64) {
        let cue = self.cue(now_secs).map(|cue| CueView {
            power,
            is_drawn: true,
            ..cue
        });
        self.phase = TurnPhase::Aiming;
        self.aim.set_power(power);
        let stroke = self.aim.stroke(power);
        if self.contest.world().particles().is_some() {
            match ShotWorker::start(self.contest.world(), stroke, cue) {
                Ok(worker) => self.phase = TurnPhase::Simulating(Box::new(worker)),
                Err(error) => self.notice = Some(error.to_string()),
            }
            return;
        }
        let contact_secs = now_secs + lead_secs.clamp(SWING_SECS.start, SWING_SECS.end);
        match self.contest.strike(stroke) {
            Ok(shot) => self.watch(stroke, shot, cue, contact_secs),
            Err(error) => self.notice = Some(error.to_string()),
        }
    }

    /// Strikes once it is known what comes of it.
    fn follow_simulation(&mut self, now_secs: f64) {
        let TurnPhase::Simulating(worker) = &self.phase else {
            return;
        };
        let Some(shot) = worker.poll() else { return };
        let (stroke, cue) = (worker.stroke, worker.cue.clone());
        self.phase = TurnPhase::Aiming;
        match shot {
            Ok(shot) => self.watch(stroke, shot, cue, now_secs + SWING_SECS.end),
            Err(error) => self.notice = Some(error.to_string()),
        }
    }

    /// Shows a shot of the match.
    fn watch(&mut self, stroke: Stroke, shot: Shot, cue: Option<CueView>, contact_secs: f64) {
        let slipped =
            |event: &physics::Event| matches!(event.kind, physics::EventKind::Miscue { .. });
        if shot.events().iter().any(slipped) {
            self.notice = Some(text!("miscue").to_owned());
        }
        (self.ai_turn, self.match_view) = (None, None);
        self.shots += 1;
        self.views.straighten();
        let pocket = self.pocket_ahead();
        self.phase = TurnPhase::Watching(Box::new(ActiveShot {
            stroke,
            shot,
            contact_secs,
            cue,
            from: self.smoother.viewpoint(),
            glide_secs: match self.views.view() {
                CameraView::Shooter => active_shot::RISE_SECS,
                _ => active_shot::ARRIVE_SECS,
            },
            bearing_rad: stroke.direction_rad,
            pocket,
            instant_camera: self.instant_camera,
            chase: OnceCell::new(),
            puff: OnceCell::new(),
        }));
    }

    fn end_shot(&mut self, now_secs: f64) {
        let active = match std::mem::replace(&mut self.phase, TurnPhase::Aiming) {
            TurnPhase::Watching(active) => active,
            other => {
                self.phase = other;
                return;
            }
        };
        let end_secs = active.clock_secs(now_secs);
        let seen = active.viewpoint(end_secs, &self.views, self.table(), self.framing);
        self.smoother = CameraSmoother::new(seen);
        self.contest.finish(active.stroke, &active.shot);
        self.begin_turn();
    }

    fn rack(&mut self) {
        if self.contest.referee().rules() != RuleSet::Free {
            self.notice = Some(text!("no-re-rack").to_owned());
            return;
        }
        let table = self.contest.world().table().clone();
        let engine = self.contest.world().engine();
        match free_table(table, self.contest.referee().seed().wrapping_add(1)) {
            Ok(contest) => self.contest = contest,
            Err(why) => self.notice = Some(why.to_string()),
        }
        self.contest.set_engine(engine);
        if let TurnPhase::Watching(active) = &self.phase {
            self.smoother = CameraSmoother::new(active.from);
        }
        self.aim = Aim::LEVEL;
        self.begin_turn();
    }

    fn lying(&self) -> impl Iterator<Item = BallPose> {
        let balls = self.contest.world().balls().into_iter();
        balls.map(|ball| ball.pose())
    }

    fn cue_ball(&self) -> Option<DVec3> {
        let cue_ball = self.lying().find(|pose| pose.number == 0)?;
        cue_ball.on_table.then_some(cue_ball.position)
    }

    fn aim_view(&self) -> Viewpoint {
        // Nobody aims while the cue ball is put down, and once the match is over.
        let is_wide =
            matches!(self.phase, TurnPhase::Placing(_)) || self.contest.at_table().is_none();
        self.views.viewpoint(&ViewContext {
            table: self.table(),
            ball: self.cue_ball().filter(|_| !is_wide),
            bearing_rad: if is_wide { 0.0 } else { self.aim.bearing_rad },
            pocket: self.pocket_ahead(),
            is_wide,
            framing: self.framing,
        })
    }

    /// The pocket that is played to, if the view depends on it: the one that is called, else the one
    /// ahead of the ball that the aim meets first.
    fn pocket_ahead(&self) -> Option<usize> {
        if self.views.view() != CameraView::Pocket {
            return None;
        }
        if let Some(Call::Pot {
            pocket: Some(pocket),
            ..
        }) = self.contest.called()
        {
            return Some(pocket);
        }
        let stroke = self.aim.stroke(LINE_POWER);
        let met = physics::predict(self.contest.world(), stroke).map(|line| line.contact);
        let (from, way) = match met {
            Ok(AimContact::Ball {
                object,
                object_direction,
                ..
            }) => (object, object_direction),
            _ => (
                self.cue_ball()?,
                DVec2::from_angle(self.aim.bearing_rad).extend(0.0),
            ),
        };
        let off_rad = |pocket: &Pocket| {
            let wanted = pocket.center - from.truncate();
            wrap_rad(wanted.to_angle() - way.truncate().to_angle()).abs()
        };
        let pockets = self.table().pockets().iter().enumerate();
        let nearest = pockets.min_by(|(_, a), (_, b)| off_rad(a).total_cmp(&off_rad(b)));
        nearest.map(|(index, _)| index)
    }
}

/// A table without rules, for one.
///
/// # Errors
/// A sentence if the balls cannot lie on it.
pub fn free_table(table: Table, seed: u32) -> carom_billiards::Result<Match> {
    Match::new(MatchConfig {
        rules: RuleSet::Free,
        players: vec![Player::Human(text!("player-you").to_owned())],
        target: 0,
        seed,
        table,
        engine: physics::Engine::default(),
    })
}

/// The power at which the way to the first contact is shown.
const LINE_POWER: f64 = 0.4;
