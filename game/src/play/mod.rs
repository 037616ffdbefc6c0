//! State machine of a match in play: aim, draw the cue back, strike, watch the shot, next turn.
//!
//! ```text
//! turn_control ─▶ ball_in_hand ─▶ aim ─┬▶ shot_preview
//!  │                                   └▶ stroke_input ─▶ active_shot ─▶ turn_control
//!  └─▶ ai_turn (the computer's turn) ────────────────────────▲
//! ```
//! Uses neither window nor farm; time is an argument.

mod active_shot;
mod ai_turn;
mod aim;
mod ball_in_hand;
mod cue;
mod cue_clearance;
mod game_camera;
pub mod practice;
mod shot_clock;
mod shot_preview;
mod shot_worker;
mod stroke;
mod stroke_input;
#[cfg(test)]
mod tests;
pub mod tournament;
pub mod tricks;
mod turn_control;

use std::rc::Rc;

use carom_billiards::game_match::{self, Match, MatchConfig, Player};
use carom_billiards::physics::{self, BallPose, Shot, Stroke, Table, World};
use carom_billiards::rules::RuleSet;
use carom_text::text;
use glam::{DVec2, DVec3};

use crate::camera::{Framing, ViewSelection, Viewpoint};
use crate::input::AimIntent;
use crate::particles::ParticleMoment;
use crate::scene::table_scene::TableScene;

use active_shot::ActiveShot;
use ai_turn::{AiTurn, PlannedStroke};
pub use aim::{Aim, CUE_SPEED_M_S_MAX, cue_speed_m_s, power_of_speed};
pub use ball_in_hand::BallInHand;
pub use cue::CueView;
use cue_clearance::CueClearance;
pub use cue_clearance::cue_of_shot;
use practice::PracticeLayout;
pub use shot_clock::ShotClock;
pub use shot_preview::{AimAids, BallMarks, BallPath, PathEnd, ShotPreview};
use shot_worker::ShotWorker;
use stroke_input::StrokeInput;

/// A match in play, with its camera.
#[derive(Debug)]
pub struct Game {
    contest: Match,
    match_view: Option<Rc<game_match::MatchView>>,
    ai_turn: Option<AiTurn>,
    phase: TurnPhase,
    aim: Aim,
    views: ViewSelection,
    seen_from: Viewpoint,
    instant_camera: bool,
    shots: u64,
    aids: AimAids,
    shot_preview: Option<(Stroke, Option<ShotPreview>)>,
    notice: Option<String>,
    /// The window and its free part.
    framing: Framing,
    /// Whether the power is set for a break.
    is_break: bool,
    particle_precision: physics::ParticlePrecision,
}

/// Phase of a turn.
#[derive(Debug)]
enum TurnPhase {
    /// The player aims, or the computer searches a shot.
    Aiming,
    /// The player places the cue ball.
    Placing(BallInHand),
    /// The computer's cue turns to its shot.
    Planned(Box<PlannedStroke>),
    /// A stroke is in progress.
    Stroking(StrokeInput),
    /// A shot through particles is being simulated, with the cue drawn back.
    Simulating(Box<ShotWorker>),
    /// A shot is on show.
    Watching(Box<ActiveShot>),
}

impl Game {
    /// A free table, freshly racked; `seed` determines the racks.
    ///
    /// # Errors
    /// If the balls cannot be placed on the table.
    pub fn new(seed: u32) -> carom_billiards::Result<Self> {
        Ok(Self::of(free_table(TableScene::table(), seed)?))
    }

    /// A game that continues a match.
    pub fn of(contest: Match) -> Self {
        let table = contest.world().table();
        let mut game = Self {
            views: ViewSelection::new(table),
            seen_from: Viewpoint::overview(table, 0.0),
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
        game.seen_from = game.aim_view();
        game
    }

    /// Takes over the aids, the physics engine, the precision of particles, the camera cuts and the number
    /// of shots of another game.
    pub fn inherit_options(&mut self, other: &Self) {
        (self.aids, self.instant_camera, self.shots) =
            (other.aids, other.instant_camera, other.shots);
        self.set_engine(other.contest.world().engine());
        self.particle_precision = other.particle_precision;
    }

    /// Precision of newly placed particles.
    pub fn particle_precision(&self) -> physics::ParticlePrecision {
        self.particle_precision
    }

    /// Sets the precision of newly placed particles.
    pub fn set_particle_precision(&mut self, precision: physics::ParticlePrecision) {
        self.particle_precision = precision;
    }

    /// Sets the physics engine from the next stroke on.
    pub fn set_engine(&mut self, engine: physics::Engine) {
        self.contest.set_engine(engine);
        self.shot_preview = None;
    }

    /// Arranges balls and particles of a free table, at rest.
    ///
    /// # Errors
    /// If they cannot be placed like this, or the game has rules; nothing has changed then.
    pub fn lay(&mut self, layout: &PracticeLayout) -> carom_billiards::Result<()> {
        self.contest
            .arrange(&layout.balls, layout.particles.clone())?;
        self.look_from_before();
        self.phase = TurnPhase::Aiming;
        self.begin_turn();
        Ok(())
    }

    /// The table before the present shot, or at rest.
    pub fn world(&self) -> &World {
        self.contest.world()
    }

    /// The table.
    pub fn table(&self) -> &Table {
        self.contest.world().table()
    }

    /// The present shot, if one is on show.
    pub fn shot(&self) -> Option<&Shot> {
        self.active().map(|active| &active.shot)
    }

    /// The present shot with its clock and camera.
    fn active(&self) -> Option<&ActiveShot> {
        match &self.phase {
            TurnPhase::Watching(active) => Some(active),
            _ => None,
        }
    }

    /// The result of an action; an error becomes the notice to the player.
    fn report<T>(&mut self, done: carom_billiards::Result<T>) -> Option<T> {
        done.map_err(|why| self.notice = Some(why.to_string())).ok()
    }

    /// Number of shots played so far.
    pub fn shots(&self) -> u64 {
        self.shots
    }

    /// The present shot with its number.
    pub fn fresh_shot(&self) -> Option<(u64, &Shot)> {
        self.shot().map(|shot| (self.shots, shot))
    }

    /// Cancels the stroke in progress or puts the carried ball back; false if there is neither.
    pub fn escape(&mut self) -> bool {
        match &self.phase {
            TurnPhase::Stroking(_) => self.cancel(),
            TurnPhase::Placing(_) => self.put_back(),
            TurnPhase::Simulating(_) => self.phase = TurnPhase::Aiming,
            TurnPhase::Aiming | TurnPhase::Planned(_) | TurnPhase::Watching(_) => return false,
        }
        true
    }

    /// Advances to `now_secs`: ends a shot that is over, follows the computer's turn, moves the camera by
    /// `dt_secs`.
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
            _ if self.instant_camera => self.seen_from = self.aim_view(),
            _ => self.seen_from.follow(self.aim_view(), dt_secs),
        }
    }

    /// The clock of the present shot.
    pub fn shot_clock(&self, now_secs: f64) -> Option<ShotClock> {
        let active = self.active()?;
        Some(ShotClock {
            number: self.shots,
            now_secs: active.clock_secs(now_secs),
            end_secs: active.shot.duration_secs(),
        })
    }

    /// The balls at `moment_secs` of the present shot, or at rest.
    pub fn poses(&self, moment_secs: f64) -> Vec<BallPose> {
        match self.shot() {
            Some(shot) => shot.poses_at(moment_secs.max(0.0)),
            None => self.lying().collect(),
        }
    }

    /// The particles at `moment_secs` of the present shot, or at rest.
    pub fn particles(&self, moment_secs: f64) -> ParticleMoment {
        match self.active() {
            Some(active) => active.particles(moment_secs),
            None => ParticleMoment::lying(self.world()),
        }
    }

    /// The cue at `moment_secs` of the present shot.
    pub fn cue_in_shot(&self, moment_secs: f64) -> Option<CueView> {
        self.active()?.cue.clone()?.swung(moment_secs)
    }

    /// The cue with its aim, if it is visible.
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

    /// Preview of the stroke by the same physics code, as far as the aids show it; none during a shot.
    pub fn shot_preview(&mut self, now_secs: f64) -> Option<&ShotPreview> {
        let power = match &self.phase {
            TurnPhase::Aiming => self.aim.power,
            // The speed of a swing is not known before the contact.
            TurnPhase::Stroking(input) => input.power(now_secs).unwrap_or(self.aim.power),
            _ => return None,
        };
        if !self.may_play() && !matches!(self.phase, TurnPhase::Stroking(_)) {
            return None;
        }
        let stroke = match self.aids {
            AimAids::Full => self.aim.stroke(power),
            // The path to the first contact hardly depends on the power: a fixed one lets the preview be
            // reused.
            _ => self.aim.stroke(LINE_POWER),
        };
        let known = self.shot_preview.take().filter(|(of, _)| *of == stroke);
        let preview = || ShotPreview::of(self.contest.world(), stroke, self.aids);
        let (_, preview) = self
            .shot_preview
            .insert(known.unwrap_or_else(|| (stroke, preview())));
        preview.as_ref()
    }

    /// Sets how much of a shot is previewed.
    pub fn set_aids(&mut self, aids: AimAids) {
        if std::mem::replace(&mut self.aids, aids) != aids {
            self.shot_preview = None;
        }
    }

    /// The present aim.
    pub fn aim(&self) -> Aim {
        self.aim
    }

    /// Takes the response to the player's last action.
    pub fn take_notice(&mut self) -> Option<String> {
        self.notice.take()
    }

    /// Whether the view changes with time.
    pub fn is_moving(&self) -> bool {
        match &self.phase {
            TurnPhase::Stroking(StrokeInput::Charging(_))
            | TurnPhase::Watching(_)
            | TurnPhase::Simulating(_)
            | TurnPhase::Planned(_) => true,
            _ => self.seen_from != self.aim_view(),
        }
    }

    /// Changes the aim, or moves a carried cue ball.
    pub fn change_aim(&mut self, intent: AimIntent, now_secs: f64) {
        if self.carry(intent) {
            return;
        }
        let is_aiming = matches!(self.phase, TurnPhase::Aiming) && self.may_play();
        match intent {
            AimIntent::AimAt(point) => self.aim_at(point, now_secs),
            // The aim is fixed while a stroke is in progress.
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

    /// Raises the cue over rails and balls in its way.
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

    fn rack(&mut self) {
        if self.contest.referee().rules() != RuleSet::Free {
            self.notice = Some(text!("no-re-rack").to_owned());
            return;
        }
        let table = self.contest.world().table().clone();
        let engine = self.contest.world().engine();
        let seed = self.contest.referee().seed().wrapping_add(1);
        if let Some(contest) = self.report(free_table(table, seed)) {
            self.contest = contest;
        }
        self.contest.set_engine(engine);
        self.look_from_before();
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
}

/// A match without rules for one player.
///
/// # Errors
/// If the balls cannot be placed on the table.
pub fn free_table(table: Table, seed: u32) -> carom_billiards::Result<Match> {
    Match::new(MatchConfig {
        table,
        ..MatchConfig::new(RuleSet::Free, vec![Player::you()], seed)?
    })
}

/// Power at which the path to the first contact is computed.
const LINE_POWER: f64 = 0.4;
