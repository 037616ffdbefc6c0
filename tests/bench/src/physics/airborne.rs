//! Balls in the air: the closed form of flight, and rapier's solver, which simulates parabola, contact
//! and impulse in steps with an accuracy of its own.
//!
//! Both are compared with closed forms. Gravity accelerates two balls in the air equally, so that they
//! meet where two straight paths do: at the root of a quadratic, with the line of centres known there;
//! ideal balls of equal mass exchange their speeds along it.

use std::fmt;

use cpu_time::ThreadTime;
use glam::DVec3;
use serde::Serialize;

use super::{
    accuracy_cost::{PHASES, STEPS_PER_SEC},
    infinite_table::infinite_table,
};
use crate::timing::ms_since;
use carom_billiards::Result;
use carom_billiards::physics::{
    BallBallLaw, BallBody, BallState, Engine, Laws, Phase, Rapier, Shot, World,
};

/// Errors and cost of one engine.
#[derive(Clone, Debug, Serialize)]
pub struct FlightRow {
    /// Engine as in `--physics`.
    pub engine: String,
    /// Distance from the parabola after half a second, in mm.
    pub flight_off_mm: f64,
    /// Largest distance of two balls from their exact positions 0.1 s after they met at 5 m/s, over
    /// [`PHASES`] starts, in mm.
    pub meeting_off_mm: f64,
    /// Largest relative change of the horizontal momentum in such a collision.
    pub momentum_off: f64,
    /// Largest relative change of the energy, in the frame of both balls.
    pub energy_off: f64,
    /// CPU time of such a shot per simulated second, in ms.
    pub ms_per_second: f64,
}

impl fmt::Display for FlightRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:24} {:>9.1e} {:>11.1e} {:>11.1e} {:>11.1e} {:>11.3}",
            self.engine,
            self.flight_off_mm,
            self.meeting_off_mm,
            self.momentum_off,
            self.energy_off,
            self.ms_per_second
        )
    }
}

/// The heading of a table of [`FlightRow`]s.
pub const HEADING: &str = "engine                      flight    meeting    momentum      energy      CPU ms\n\
                           \u{20}                          mm off     mm off         off         off    a second";

/// Rows of the closed flight, and of rapier's solver at all step rates.
///
/// # Errors
/// Those of the simulation.
pub fn measure() -> Result<Vec<FlightRow>> {
    let stepped = STEPS_PER_SEC.map(|steps| Engine::Rapier(Rapier::at(steps)));
    let engines = [Engine::Exact].into_iter().chain(stepped);
    engines.map(FlightRow::of).collect()
}

impl FlightRow {
    fn of(engine: Engine) -> Result<Self> {
        let thrown = flying(0, DVec3::new(0.0, 0.0, 0.3), DVec3::new(2.0, 1.0, 2.0));
        let shot = play(engine, vec![thrown])?;
        let off_m = shot.states_at(FLIGHT_SECS)[0]
            .position
            .distance(parabola(&thrown, FLIGHT_SECS));
        let mut air = Self {
            engine: engine.to_string(),
            flight_off_mm: 1e3 * off_m,
            meeting_off_mm: 0.0,
            momentum_off: 0.0,
            energy_off: 0.0,
            ms_per_second: 0.0,
        };
        for phase in 0..PHASES {
            air.add_meeting(engine, f64::from(phase) / f64::from(PHASES))?;
        }
        Ok(air)
    }

    fn add_meeting(&mut self, engine: Engine, phase: f64) -> Result<()> {
        // Farther apart by up to the distance of the longest step.
        let from = -0.1 - SPEED_M_S / 60.0 * phase;
        let balls = [
            flying(0, DVec3::new(from, 0.01, 0.52), DVec3::new(4.0, 0.0, 0.5)),
            flying(1, DVec3::new(0.1, -0.01, 0.5), DVec3::new(-1.0, 0.2, 0.5)),
        ];
        let begun = ThreadTime::now();
        let shot = play(engine, balls.to_vec())?;
        let cost = ms_since(begun) / shot.duration_secs();
        let met = Collision::of(&balls);
        let late = met.time_secs + AFTER_SECS;
        let [one, other] = [0, 1].map(|ball| shot.states_at(late)[ball]);
        for (state, exact) in [one, other].iter().zip(met.positions(&balls, late)) {
            let off_mm = 1e3 * state.position.distance(exact);
            self.meeting_off_mm = self.meeting_off_mm.max(off_mm);
        }
        let sum = |states: [&BallState; 2]| (states[0].velocity + states[1].velocity).with_z(0.0);
        let part = |states: [&BallState; 2]| (states[0].velocity - states[1].velocity).length();
        let [before, after] = [[&balls[0], &balls[1]], [&one, &other]];
        let momentum = (sum(after) - sum(before)).length() / sum(before).length();
        let energy = (part(after) / part(before)).powi(2) - 1.0;
        self.momentum_off = self.momentum_off.max(momentum);
        self.energy_off = self.energy_off.max(energy.abs());
        self.ms_per_second = self.ms_per_second.max(cost);
        Ok(())
    }
}

fn flying(number: u8, position: DVec3, velocity: DVec3) -> BallState {
    BallState {
        position,
        velocity,
        phase: Phase::Airborne,
        ..BallState::at_rest(number, 0.0, 0.0, &BallBody::default())
    }
}

fn play(engine: Engine, balls: Vec<BallState>) -> Result<Shot> {
    let laws = Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    };
    let mut world = World::with_laws(infinite_table()?, laws, balls)?;
    world.set_engine(engine);
    world.release()
}

fn fallen(t: f64) -> DVec3 {
    -0.5 * Laws::default().cloth.gravity_m_s2 * t * t * DVec3::Z
}

fn parabola(ball: &BallState, t: f64) -> DVec3 {
    ball.position + t * ball.velocity + fallen(t)
}

/// Collision of two ideal balls in the air, in closed form.
struct Collision {
    time_secs: f64,
    /// Change of the first ball's velocity; the other's is the opposite.
    kick: DVec3,
}

impl Collision {
    fn of([one, other]: &[BallState; 2]) -> Self {
        let (way, speed) = (one.position - other.position, one.velocity - other.velocity);
        let touch = one.body.radius_m + other.body.radius_m;
        let (a, half_b) = (speed.length_squared(), speed.dot(way));
        let c = way.length_squared() - touch * touch;
        // The first root of |way + t·speed| = touch: gravity cancels in the relative motion.
        let time_secs = (-half_b - (half_b * half_b - a * c).sqrt()) / a;
        let normal = (way + time_secs * speed) / touch;
        Self {
            time_secs,
            kick: -speed.dot(normal) * normal,
        }
    }

    fn positions(&self, balls: &[BallState; 2], t: f64) -> [DVec3; 2] {
        let since = t - self.time_secs;
        [
            parabola(&balls[0], t) + since * self.kick,
            parabola(&balls[1], t) - since * self.kick,
        ]
    }
}

/// Maximum error of the closed flight, in mm and relative.
pub const OFF_MAX: f64 = 1e-9;
/// Time of flight in s, in which no ball lands.
const FLIGHT_SECS: f64 = 0.5;
/// Time in s after a collision at which positions are compared.
const AFTER_SECS: f64 = 0.1;
/// Speed of approach.
const SPEED_M_S: f64 = 5.0;
