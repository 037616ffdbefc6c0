//! A game on a free table: aim, draw the cue back, strike, watch, aim again.
//!
//! ```text
//! aim ─▶ cue (drawn back, swung) ─▶ running (the shot on show) ─▶ free_table (ready again)
//! ```
//! Knows neither window nor farm; time is an argument.

mod aim;
mod cue;
mod free_table;
mod running;
#[cfg(test)]
mod tests;

use carom_tracer::Camera;
use glam::{DVec2, DVec3};

use crate::camera::{Dolly, Orbit, Projection, Viewpoint, wrap_rad};
use crate::input::Intent;
use crate::sim::{self, AimLine, BallPose, Shot, Stroke, Table, World};
use crate::stage::Stage;

pub use aim::{Aim, CUE_SPEED_M_S_MAX, cue_speed_m_s};
pub use cue::CueView;
use cue::SWING_SECS;
use running::Running;

/// One player's table.
#[derive(Debug)]
pub struct Game {
    table: Table,
    world: World,
    phase: Phase,
    aim: Aim,
    orbit: Orbit,
    dolly: Dolly,
    racks: u32,
    shots: u64,
    line: Option<(Stroke, Option<AimLine>)>,
    notice: Option<String>,
}

/// What the player is doing.
#[derive(Debug)]
enum Phase {
    /// Looking for the shot.
    Aiming,
    /// Drawing the cue back by hand, so far.
    Pulling(f64),
    /// Drawing it back with time, since.
    Charging(f64),
    /// Watching.
    Watching(Box<Running>),
}

/// What is asked of the program around the game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing.
    Stay,
    /// To end.
    Quit,
}

impl Game {
    /// A freshly racked table; `seed` draws the racks.
    ///
    /// # Errors
    /// [`sim::Error`] if the physics refuses its own table.
    pub fn new(seed: u32) -> Result<Self, sim::Error> {
        Self::on(Stage::table(), seed)
    }

    /// The same on another table.
    ///
    /// # Errors
    /// [`sim::Error`] if the balls cannot lie on it.
    pub fn on(table: Table, seed: u32) -> Result<Self, sim::Error> {
        let world = World::new(table.clone(), table.rack_eight(seed))?;
        let mut game = Self {
            table,
            world,
            phase: Phase::Aiming,
            aim: Aim::LEVEL,
            orbit: Orbit::default(),
            dolly: Dolly::new(Viewpoint::overview(0.0)),
            racks: seed,
            shots: 0,
            line: None,
            notice: None,
        };
        game.dolly = Dolly::new(game.aim_view());
        Ok(game)
    }

    /// Lets something else move the balls from the next stroke on.
    pub fn set_engine(&mut self, engine: sim::Engine) {
        self.world.set_engine(engine);
        self.line = None;
    }

    /// Shows a shot that was played before, from `now_secs` on. To turn the aim to the left or right
    /// turns time back or on; when it is over, the game goes on with the balls as it left them.
    pub fn replay(&mut self, shot: Shot, now_secs: f64) {
        self.shots += 1;
        self.notice = Some("A recorded shot: left and right turn time".to_owned());
        self.phase = Phase::Watching(Box::new(Running {
            shot,
            contact_secs: now_secs + SWING_SECS.end,
            power: 0.0,
            from: self.dolly.viewpoint(),
            bearing_rad: self.aim.bearing_rad,
            is_replay: true,
        }));
    }

    /// What is played on.
    pub fn table(&self) -> &Table {
        &self.table
    }

    /// The shot that is on.
    pub fn shot(&self) -> Option<&Shot> {
        match &self.phase {
            Phase::Watching(running) => Some(&running.shot),
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
            Phase::Watching(running) if !running.is_replay => Some((self.shots, &running.shot)),
            _ => None,
        }
    }

    /// Does what the player wants at `now_secs`. A stroke meets the ball `lead_secs` later, so
    /// that its first pictures are ready by then, but never so late that the player would wait.
    pub fn apply(&mut self, intent: Intent, now_secs: f64, lead_secs: f64, film: DVec2) -> Outcome {
        match intent {
            Intent::Turn(angle_rad) => self.turn(angle_rad, now_secs),
            Intent::AimAt(point) => self.aim_at(point, film, now_secs),
            Intent::MoveTip(by) => self.aim.move_tip(by),
            Intent::CenterTip => self.aim.level(),
            Intent::Elevate(by_rad) => self.aim.elevate(by_rad),
            Intent::Orbit { yaw_rad, pitch_rad } => {
                self.orbit.yaw_rad = wrap_rad(self.orbit.yaw_rad + yaw_rad);
                self.orbit.pitch_rad = (self.orbit.pitch_rad + pitch_rad).clamp(-1.4, 1.4);
            }
            Intent::Zoom(factor) => self.orbit.zoom = (self.orbit.zoom * factor).clamp(0.3, 2.5),
            Intent::BeginPull => self.begin(Phase::Pulling(0.0)),
            Intent::BeginCharge => self.begin(Phase::Charging(now_secs)),
            Intent::Pull(power) => {
                if let Phase::Pulling(pulled) = &mut self.phase {
                    *pulled = power;
                }
            }
            Intent::Release => self.release(now_secs, lead_secs),
            Intent::Cancel => self.cancel(),
            Intent::Escape if self.power(now_secs).is_some() => self.cancel(),
            Intent::Escape => return Outcome::Quit,
            Intent::Rack => self.rack(),
            Intent::ToggleHelp | Intent::ToggleStats | Intent::ToggleFullscreen => {}
        }
        Outcome::Stay
    }

    /// Lets time pass: the camera glides, a shot that is over ends.
    pub fn tick(&mut self, now_secs: f64, dt_secs: f64) {
        match &self.phase {
            Phase::Watching(running)
                if running.clock_secs(now_secs) >= running.shot.duration_secs() =>
            {
                self.end_shot(now_secs);
            }
            Phase::Watching(_) => {}
            _ => self.dolly.follow(self.aim_view(), dt_secs),
        }
    }

    /// The shot that is on: its number, the moment on show and the moment of its end, in seconds
    /// since the stroke.
    pub fn shot_clock(&self, now_secs: f64) -> Option<(u64, f64, f64)> {
        let Phase::Watching(running) = &self.phase else {
            return None;
        };
        Some((
            self.shots,
            running.clock_secs(now_secs),
            running.shot.duration_secs(),
        ))
    }

    /// The balls at `moment_secs` of the shot that is on, else as they lie.
    pub fn poses(&self, moment_secs: f64) -> Vec<BallPose> {
        match &self.phase {
            Phase::Watching(running) => running.shot.poses_at(moment_secs.max(0.0)),
            _ => self.lying().collect(),
        }
    }

    /// The camera at `moment_secs` of the shot that is on, else now.
    pub fn camera(&self, moment_secs: f64) -> Camera {
        match &self.phase {
            Phase::Watching(running) => running.viewpoint(moment_secs, self.orbit).camera(),
            _ => self.dolly.viewpoint().camera(),
        }
    }

    /// Cue and aim, while there is one to show.
    pub fn cue(&self, now_secs: f64) -> Option<CueView> {
        let cue_ball = self.cue_ball()?;
        match &self.phase {
            Phase::Watching(running) if running.is_replay => None,
            Phase::Watching(running) => CueView::swung(
                cue_ball,
                &self.aim,
                running.power,
                running.clock_secs(now_secs),
            ),
            _ => Some(CueView::drawn(cue_ball, &self.aim, self.power(now_secs))),
        }
    }

    /// Where the balls would go, by the code that moves them; nothing during a shot.
    pub fn aim_line(&mut self) -> Option<&AimLine> {
        if matches!(self.phase, Phase::Watching(_)) {
            return None;
        }
        let stroke = self.aim.stroke(AIM_LINE_POWER);
        if self.line.as_ref().is_none_or(|(of, _)| *of != stroke) {
            // A stroke that cannot be struck has no line; striking it says why.
            self.line = Some((stroke, sim::predict(&self.world, stroke).ok()));
        }
        self.line.as_ref().and_then(|(_, line)| line.as_ref())
    }

    /// A sentence for the player, until the next stroke.
    pub fn notice(&self) -> Option<&str> {
        self.notice.as_deref()
    }

    /// Whether time alone changes what is seen.
    pub fn is_moving(&self) -> bool {
        match self.phase {
            Phase::Aiming | Phase::Pulling(_) => self.dolly.viewpoint() != self.aim_view(),
            Phase::Charging(_) | Phase::Watching(_) => true,
        }
    }

    fn turn(&mut self, angle_rad: f64, now_secs: f64) {
        match &mut self.phase {
            Phase::Aiming => {
                self.aim.bearing_rad = wrap_rad(self.aim.bearing_rad + angle_rad);
            }
            Phase::Watching(running) if running.is_replay => {
                running.scrub(-SCRUB_SECS * angle_rad.signum(), now_secs);
                // Pictures that were asked for are of other moments: as of another shot.
                self.shots += 1;
            }
            _ => {}
        }
    }

    fn aim_at(&mut self, point: DVec2, film: DVec2, now_secs: f64) {
        let projection = Projection::new(&self.camera(now_secs), film.x, film.y);
        let target = projection.world_from_film(point, self.cue_ball().map_or(0.0, |ball| ball.z));
        if let (Phase::Aiming, Some(target), Some(ball)) = (&self.phase, target, self.cue_ball()) {
            let way = (target - ball).truncate();
            if way.length() > 0.01 {
                self.aim.bearing_rad = way.to_angle();
            }
        }
    }

    fn begin(&mut self, phase: Phase) {
        if matches!(self.phase, Phase::Aiming) {
            self.phase = phase;
            self.notice = None;
        }
    }

    fn cancel(&mut self) {
        if !matches!(self.phase, Phase::Watching(_)) {
            self.phase = Phase::Aiming;
        }
    }

    fn power(&self, now_secs: f64) -> Option<f64> {
        match self.phase {
            Phase::Pulling(power) => Some(power),
            Phase::Charging(since) => Some(((now_secs - since) / CHARGE_SECS).clamp(0.0, 1.0)),
            _ => None,
        }
    }

    fn release(&mut self, now_secs: f64, lead_secs: f64) {
        let Some(power) = self.power(now_secs) else {
            return;
        };
        let pulled = matches!(self.phase, Phase::Pulling(_));
        self.phase = Phase::Aiming;
        if pulled && power < PULL_MIN {
            return;
        }
        match self.world.strike(self.aim.stroke(power)) {
            Ok(shot) => {
                let slipped =
                    |event: &sim::Event| matches!(event.kind, sim::EventKind::Miscue { .. });
                if shot.events().iter().any(slipped) {
                    self.notice = Some("Miscue: the tip slipped off the ball".to_owned());
                }
                self.shots += 1;
                self.orbit.yaw_rad = 0.0;
                self.phase = Phase::Watching(Box::new(Running {
                    shot,
                    contact_secs: now_secs + lead_secs.clamp(SWING_SECS.start, SWING_SECS.end),
                    power,
                    from: self.dolly.viewpoint(),
                    bearing_rad: self.aim.bearing_rad,
                    is_replay: false,
                }));
            }
            Err(error) => self.notice = Some(error.to_string()),
        }
    }

    fn end_shot(&mut self, now_secs: f64) {
        let Phase::Watching(running) = std::mem::replace(&mut self.phase, Phase::Aiming) else {
            return;
        };
        let end_secs = running.clock_secs(now_secs);
        self.dolly = Dolly::new(running.viewpoint(end_secs, self.orbit));
        self.world.adopt(&running.shot);
        self.aim.level();
        self.line = None;
        if let Some(notice) = free_table::settle(&mut self.world) {
            self.notice = Some(notice);
        }
    }

    fn rack(&mut self) {
        let seed = self.racks.wrapping_add(1);
        match World::new(self.table.clone(), self.table.rack_eight(seed)) {
            Ok(mut world) => {
                world.set_engine(self.world.engine());
                self.world = world;
            }
            Err(error) => self.notice = Some(error.to_string()),
        }
        if let Phase::Watching(running) = &self.phase {
            self.dolly = Dolly::new(running.from);
        }
        self.phase = Phase::Aiming;
        self.racks = seed;
        self.line = None;
        self.aim = Aim::LEVEL;
    }

    fn lying(&self) -> impl Iterator<Item = BallPose> {
        self.world.balls().into_iter().map(|ball| BallPose {
            number: ball.number,
            position: ball.position,
            rotation: ball.orientation,
            on_table: ball.phase.is_on_table(),
        })
    }

    fn cue_ball(&self) -> Option<DVec3> {
        let cue_ball = self.lying().find(|pose| pose.number == 0)?;
        cue_ball.on_table.then_some(cue_ball.position)
    }

    fn aim_view(&self) -> Viewpoint {
        self.cue_ball()
            .map_or(Viewpoint::overview(self.aim.bearing_rad), |ball| {
                Viewpoint::behind(ball, self.aim.bearing_rad)
            })
            .adjusted(self.orbit)
    }
}

/// The power at which the aim line is drawn: where the balls go at first depends little on it.
const AIM_LINE_POWER: f64 = 0.4;
/// A cue that was hardly drawn back does not strike.
const PULL_MIN: f64 = 0.03;
/// The space bar's way to full power.
const CHARGE_SECS: f64 = 1.6;
/// A key's way through a recorded shot.
const SCRUB_SECS: f64 = 0.25;
