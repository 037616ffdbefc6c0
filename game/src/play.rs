//! A game on a free table: aim, draw the cue back, strike, watch, aim again.
//!
//! Knows neither window nor farm; time is an argument.

use carom_tracer::Camera;
use glam::{DVec2, DVec3};

use crate::camera::{Dolly, Orbit, Projection, Viewpoint, smoothstep, wrap_rad};
use crate::input::Intent;
use crate::sim::{self, AimLine, BallPose, Shot, Stroke, Table, World};
use crate::stage::Stage;

/// The cue's speed at full power, m/s: a hard break.
pub const CUE_SPEED_M_S_MAX: f64 = 10.0;

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

/// Where the cue points.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Aim {
    bearing_rad: f64,
    tip: DVec2,
    elevation_rad: f64,
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

/// A shot that is on.
#[derive(Debug)]
struct Running {
    shot: Shot,
    /// When the tip meets the ball.
    contact_secs: f64,
    /// How far the cue had been drawn back.
    power: f64,
    from: Viewpoint,
    bearing_rad: f64,
    /// Whether it was played before: then there is no cue, and time can be turned back.
    is_replay: bool,
}

/// What is asked of the program around the game.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing.
    Stay,
    /// To end.
    Quit,
}

/// What is drawn over the picture while aiming and striking.
#[derive(Clone, Debug, PartialEq)]
pub struct CueView {
    /// Centre of the cue ball, metres.
    pub cue_ball: DVec3,
    /// Direction of the cue, radians from +x towards +y.
    pub bearing_rad: f64,
    /// The tip's place on the cue ball, in ball radii to the right and up.
    pub tip: DVec2,
    /// How far the butt is raised, radians.
    pub elevation_rad: f64,
    /// Power, 0 to 1, while the cue is drawn back.
    pub power: Option<f64>,
    /// From the cue ball to the tip, metres.
    pub gap_m: f64,
}

impl Game {
    /// A freshly racked table; `seed` draws the racks.
    ///
    /// # Errors
    /// [`sim::Error`] if the physics refuses its own table.
    pub fn new(seed: u32) -> Result<Self, sim::Error> {
        let table = Stage::table();
        let world = World::new(table.clone(), table.rack_eight(seed))?;
        let mut game = Self {
            table,
            world,
            phase: Phase::Aiming,
            aim: Aim {
                bearing_rad: 0.0,
                tip: DVec2::ZERO,
                elevation_rad: 0.0,
            },
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
            Intent::MoveTip(by) => self.move_tip(by),
            Intent::CenterTip => self.level_cue(),
            Intent::Elevate(by) => {
                let raised = self.aim.elevation_rad + by;
                self.aim.elevation_rad = raised.clamp(0.0, Stroke::ELEVATION_MAX_RAD);
            }
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
            Intent::ToggleHelp | Intent::ToggleStats => {}
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
        let view = |power: Option<f64>, gap_m: f64| {
            Some(CueView {
                cue_ball: self.cue_ball()?,
                bearing_rad: self.aim.bearing_rad,
                tip: self.aim.tip,
                elevation_rad: self.aim.elevation_rad,
                power,
                gap_m,
            })
        };
        let drawn = |power: f64| GAP_M + power * DRAW_M;
        match &self.phase {
            Phase::Watching(running) => {
                let clock = running.clock_secs(now_secs);
                // Faster and faster towards the ball, as a real stroke is.
                let s = (1.0 + clock / SWING_SECS.start).clamp(0.0, 1.0);
                (clock < FOLLOW_SECS && !running.is_replay)
                    .then(|| view(Some(running.power), drawn(running.power) * (1.0 - s * s)))?
            }
            _ => {
                let power = self.power(now_secs);
                view(power, drawn(power.unwrap_or(0.0)))
            }
        }
    }

    /// Where the balls would go, by the code that moves them; nothing during a shot.
    pub fn aim_line(&mut self) -> Option<&AimLine> {
        if matches!(self.phase, Phase::Watching(_)) {
            return None;
        }
        let stroke = self.stroke(AIM_LINE_POWER);
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
                let end_secs = running.shot.duration_secs();
                let moment = running.clock_secs(now_secs) - SCRUB_SECS * angle_rad.signum();
                running.contact_secs = now_secs - moment.clamp(0.0, end_secs);
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

    fn level_cue(&mut self) {
        self.aim.tip = DVec2::ZERO;
        self.aim.elevation_rad = 0.0;
    }

    fn move_tip(&mut self, by: DVec2) {
        self.aim.tip = (self.aim.tip + by).clamp_length_max(TIP_RADII_MAX);
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
        match self.world.strike(self.stroke(power)) {
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
        self.level_cue();
        self.line = None;
        if self.cue_ball().is_none() {
            self.notice = Some("Scratch: the cue ball is back on the head spot".to_owned());
            self.spot_cue_ball();
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
        self.aim = Aim {
            bearing_rad: 0.0,
            tip: DVec2::ZERO,
            elevation_rad: 0.0,
        };
    }

    /// Puts the cue ball on the head spot, or next to it where that is taken.
    fn spot_cue_ball(&mut self) {
        let radius = self.table.cue_ball().radius_m;
        let on_table = self.lying().filter(|pose| pose.on_table);
        let others: Vec<DVec2> = on_table.map(|pose| pose.position.truncate()).collect();
        let head = self.table.head_spot();
        let spot = free_spot(head, radius, &others);
        if let Err(error) = self.world.place(0, spot.x, spot.y) {
            self.notice = Some(error.to_string());
        }
    }

    fn stroke(&self, power: f64) -> Stroke {
        Stroke {
            direction_rad: self.aim.bearing_rad,
            speed_m_s: cue_speed_m_s(power),
            side: self.aim.tip.x,
            vertical: self.aim.tip.y,
            elevation_rad: self.aim.elevation_rad,
        }
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

impl Running {
    fn clock_secs(&self, now_secs: f64) -> f64 {
        now_secs - self.contact_secs
    }

    /// From behind the cue ball up and back to the whole table, as a function of the shot's own
    /// time: pictures of the future know where the camera will be.
    fn viewpoint(&self, moment_secs: f64, orbit: Orbit) -> Viewpoint {
        let s = smoothstep((moment_secs - RISE_SECS.start) / (RISE_SECS.end - RISE_SECS.start));
        let overview = Viewpoint::overview(self.bearing_rad + orbit.yaw_rad);
        self.from.lerp(overview, s)
    }
}

/// The cue's speed at `power` from 0 to 1: quadratic, so that soft shots have room.
pub fn cue_speed_m_s(power: f64) -> f64 {
    CUE_SPEED_M_S_MIN + (CUE_SPEED_M_S_MAX - CUE_SPEED_M_S_MIN) * power * power
}

/// The nearest of `spot` and places in rings round it where a ball touches none of `others`.
fn free_spot(spot: DVec2, radius_m: f64, others: &[DVec2]) -> DVec2 {
    let ring = |i: u32| {
        let reach = radius_m * 0.5 * f64::from(i.div_ceil(12));
        spot + DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / 12.0) * reach
    };
    let is_free = |place: &DVec2| {
        others
            .iter()
            .all(|other| other.distance(*place) > 2.01 * radius_m)
    };
    (0..12 * 40).map(ring).find(is_free).unwrap_or(spot)
}

const CUE_SPEED_M_S_MIN: f64 = 0.15;
/// The tip can be set beyond where it slips off the ball, about 0.51: that is the player's risk.
const TIP_RADII_MAX: f64 = 0.6;
/// The power at which the aim line is drawn: where the balls go at first depends little on it.
const AIM_LINE_POWER: f64 = 0.4;
/// A cue that was hardly drawn back does not strike.
const PULL_MIN: f64 = 0.03;
/// The space bar's way to full power.
const CHARGE_SECS: f64 = 1.6;
/// From letting go to the blow. With a display's period of 17 ms it stays under the 100 ms within
/// which people take an answer for immediate (Miller, "Response Time in Man-Computer Conversational
/// Transactions", 1968).
const SWING_SECS: std::ops::Range<f64> = 0.06..0.08;
/// The cue stays this long after the blow.
const FOLLOW_SECS: f64 = 0.35;
/// When the camera rises after the blow.
const RISE_SECS: std::ops::Range<f64> = 0.1..1.7;
/// A key's way through a recorded shot.
const SCRUB_SECS: f64 = 0.25;
const GAP_M: f64 = 0.012;
const DRAW_M: f64 = 0.2;

#[cfg(test)]
mod tests {
    use super::*;

    const FILM: DVec2 = DVec2::new(1280.0, 720.0);

    fn strike(game: &mut Game, power: f64, now_secs: f64) {
        for intent in [Intent::BeginPull, Intent::Pull(power), Intent::Release] {
            game.apply(intent, now_secs, 0.2, FILM);
        }
    }

    /// Lets the shot that is on play to its end.
    fn watch(game: &mut Game, mut now_secs: f64) -> f64 {
        while game.shot_clock(now_secs).is_some() {
            now_secs += 0.1;
            game.tick(now_secs, 0.1);
        }
        now_secs
    }

    #[test]
    fn a_stroke_plays_moves_balls_and_ends() {
        let mut game = Game::new(1).unwrap();
        let before = game.poses(0.0);
        strike(&mut game, 0.9, 5.0);
        let (_, clock, end) = game.shot_clock(5.0).unwrap();
        assert!(clock <= -SWING_SECS.start && end > 1.0);
        assert_eq!(game.poses(-0.05), before, "nothing moves before the blow");
        let now = watch(&mut game, 5.0);
        assert!((now - 5.0 - end) < 1.0);
        assert_ne!(game.poses(0.0), before);
    }

    #[test]
    fn a_recorded_shot_is_watched_again_back_and_forth_and_played_on_from() {
        let mut game = Game::new(1).unwrap();
        strike(&mut game, 0.7, 5.0);
        let (number, shot) = game.fresh_shot().unwrap();
        let shot = shot.clone();
        assert_eq!(number, 1);
        let mut other = Game::new(9).unwrap();
        other.replay(shot.clone(), 0.0);
        assert!(other.fresh_shot().is_none() && other.cue(0.0).is_none());
        assert_eq!(other.poses(0.7), shot.poses_at(0.7));
        let (first, clock, end) = other.shot_clock(2.0).unwrap();
        other.apply(Intent::Turn(-0.01), 2.0, 0.2, FILM);
        let (second, later, _) = other.shot_clock(2.0).unwrap();
        assert!(second > first && (later - clock - SCRUB_SECS).abs() < 1e-9);
        for _ in 0..100 {
            other.apply(Intent::Turn(0.01), 2.0, 0.2, FILM);
        }
        assert_eq!(other.shot_clock(2.0).unwrap().1, 0.0);
        other.tick(2.1 + end, 0.1);
        assert!(other.shot_clock(2.1 + end).is_none());
        let lying = |poses: Vec<BallPose>| poses.iter().filter(|pose| pose.on_table).count();
        assert!(
            lying(other.poses(0.0)) >= lying(shot.poses_at(end)),
            "played on from there"
        );
    }

    #[test]
    fn a_stroke_that_is_given_up_leaves_the_table_alone() {
        let mut game = Game::new(1).unwrap();
        for intent in [
            Intent::BeginPull,
            Intent::Pull(1.0),
            Intent::Cancel,
            Intent::Release,
        ] {
            game.apply(intent, 1.0, 0.2, FILM);
        }
        strike(&mut game, 0.5 * PULL_MIN, 1.0);
        assert_eq!(game.shot_clock(1.0), None);
    }

    #[test]
    fn escape_gives_up_a_stroke_first_and_then_quits() {
        let mut game = Game::new(1).unwrap();
        game.apply(Intent::BeginCharge, 1.0, 0.2, FILM);
        assert_eq!(game.apply(Intent::Escape, 1.5, 0.2, FILM), Outcome::Stay);
        assert_eq!(game.apply(Intent::Escape, 1.6, 0.2, FILM), Outcome::Quit);
    }

    #[test]
    fn aiming_at_a_point_of_the_window_points_the_cue_there() {
        let mut game = Game::new(1).unwrap();
        let target = DVec3::new(0.3, 0.4, game.cue_ball().unwrap().z);
        let projection = Projection::new(&game.camera(0.0), FILM.x, FILM.y);
        let point = projection.film_from_world(target).unwrap();
        game.apply(Intent::AimAt(point), 0.0, 0.2, FILM);
        let way = (target - game.cue_ball().unwrap()).truncate();
        // The camera's place is rounded to f32.
        assert!(wrap_rad(game.aim.bearing_rad - way.to_angle()).abs() < 1e-5);
    }

    #[test]
    fn the_camera_behind_the_ball_sees_the_ball_and_the_overview_the_whole_table() {
        let mut game = Game::new(1).unwrap();
        let seen = |camera: &Camera, p: DVec3| {
            let film = Projection::new(camera, FILM.x, FILM.y).film_from_world(p);
            film.is_some_and(|film| film.cmpge(DVec2::ZERO).all() && film.cmple(FILM).all())
        };
        assert!(seen(&game.camera(0.0), game.cue_ball().unwrap()));
        for bearing in [0.0, 0.5, 1.57, 3.0, -2.0] {
            game.aim.bearing_rad = bearing;
            strike(&mut game, 0.1, 0.0);
            for corner in [
                (-1.27, -0.635),
                (1.27, -0.635),
                (1.27, 0.635),
                (-1.27, 0.635),
            ] {
                let corner = DVec3::new(corner.0, corner.1, 0.0);
                assert!(seen(&game.camera(5.0), corner), "{corner} from {bearing}");
            }
            game.rack();
        }
    }

    #[test]
    fn a_pocketed_cue_ball_comes_back_where_there_is_room() {
        let mut game = Game::new(1).unwrap();
        let head = game.table.head_spot();
        // The left head corner is straight ahead at this bearing.
        game.aim.bearing_rad = (DVec2::new(-1.282, 0.647) - head).to_angle();
        strike(&mut game, 0.35, 0.0);
        watch(&mut game, 0.0);
        assert!(
            game.notice()
                .is_some_and(|notice| notice.starts_with("Scratch"))
        );
        assert!(game.cue_ball().unwrap().truncate().distance(head) < 1e-9);
    }

    #[test]
    fn a_raised_cue_jumps_and_comes_level_again_after_the_shot() {
        let mut game = Game::new(1).unwrap();
        for _ in 0..100 {
            game.apply(Intent::Elevate(0.1), 0.0, 0.2, FILM);
        }
        assert_eq!(
            game.cue(0.0).unwrap().elevation_rad,
            Stroke::ELEVATION_MAX_RAD
        );
        game.apply(
            Intent::Elevate(0.7 - Stroke::ELEVATION_MAX_RAD),
            0.0,
            0.2,
            FILM,
        );
        strike(&mut game, 0.6, 1.0);
        let heights = (0..50).map(|i| game.poses(0.01 * f64::from(i))[0].position.z);
        assert!(heights.fold(0.0, f64::max) > 0.08, "the cue ball flies");
        watch(&mut game, 1.0);
        assert_eq!(game.cue(99.0).unwrap().elevation_rad, 0.0);
    }

    #[test]
    fn a_tip_set_too_far_out_miscues_and_says_so() {
        let mut game = Game::new(1).unwrap();
        game.apply(Intent::MoveTip(DVec2::new(-0.3, -2.0)), 0.0, 0.2, FILM);
        strike(&mut game, 0.4, 1.0);
        assert!(
            game.notice()
                .is_some_and(|notice| notice.starts_with("Miscue"))
        );
    }

    #[test]
    fn a_taken_spot_is_stepped_aside_from() {
        let others = [DVec2::ZERO, DVec2::new(0.06, 0.0)];
        let spot = free_spot(DVec2::ZERO, 0.03, &others);
        assert!(others.iter().all(|other| other.distance(spot) > 0.06));
        assert!(spot.length() < 0.12);
    }

    #[test]
    fn soft_shots_have_most_of_the_way() {
        assert!(cue_speed_m_s(0.5) < 0.3 * CUE_SPEED_M_S_MAX);
        assert_eq!(cue_speed_m_s(1.0), CUE_SPEED_M_S_MAX);
    }
}
