//! The simulation of one shot, from event to event.
//!
//! ```text
//! earliest event ─► all balls move to it ─► the law of that event sets the velocities
//!       ▲                                                    │
//!       └──── contact times of the balls that changed ◄──────┘
//! ```
//! Events at the same instant are taken in a fixed order: phase changes and cushions by ball, then
//! pairs, of which those that share balls are solved together. Nothing else decides, so that a shot has
//! the same bits on every run.

use glam::DVec3;

use crate::{Error, Result};

use super::{
    ball::{BallState, Phase},
    ball_ball::Twist,
    ball_in_motion::BallInMotion,
    event::{Event, EventKind},
    event_queue::{BallEvent, EventQueue, NextEvent},
    flight::{Flight, hop_speed_m_s},
    laws::Laws,
    motion::{Motion, MotionEnd},
    table::Table,
    trajectory::Trajectory,
};

/// Condition at which the simulation ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Until {
    /// All balls are at rest.
    Rest,
    /// Ball 0 touched a ball or a cushion or left the table.
    CueBallContact,
}

/// Progress callback with the simulated time in s. It is called between two events and changes nothing.
pub(crate) type OnProgress<'a> = &'a mut dyn FnMut(f64);

/// Result of a simulation.
pub(crate) struct SimulatedShot {
    pub(crate) trajectories: Vec<Trajectory>,
    pub(crate) events: Vec<Event>,
    pub(crate) end_secs: f64,
}

pub(crate) struct EventEngine<'a> {
    pub(super) table: &'a Table,
    pub(super) laws: &'a Laws,
    pub(super) now: f64,
    pub(super) balls: Vec<BallInMotion>,
    /// Landings on a level surface below this speed are not reported.
    pub(super) quiet_m_s: f64,
    queue: EventQueue,
    events: Vec<Event>,
    events_played: u32,
    cue_ball_touched: bool,
}

impl<'a> EventEngine<'a> {
    pub(crate) fn new(table: &'a Table, laws: &'a Laws, states: &[BallState]) -> Self {
        let mut simulation = Self {
            table,
            laws,
            now: 0.0,
            balls: states
                .iter()
                .map(|state| BallInMotion::new(table, laws, state))
                .collect(),
            quiet_m_s: 0.0,
            queue: EventQueue::new(states.len()),
            events: Vec::new(),
            events_played: 0,
            cue_ball_touched: false,
        };
        for ball in 0..simulation.balls.len() {
            simulation.predict_events(ball);
        }
        simulation
    }

    /// Simulates until the end that `until` names.
    ///
    /// # Errors
    /// [`Error::Endless`] beyond [`SHOT_EVENTS_MAX`] or [`SHOT_SECS_MAX`].
    pub(crate) fn run(
        mut self,
        until: Until,
        on_progress: OnProgress<'_>,
    ) -> Result<SimulatedShot> {
        while let Some((time, next)) = self.queue.earliest() {
            on_progress(time);
            self.play_event(time, next)?;
            // A ball that the slate reflects onto the cue ball touches it again at the same instant.
            let after = self.queue.earliest();
            let is_over = after.is_none_or(|(time, _)| time > self.now);
            if until == Until::CueBallContact && self.cue_ball_touched && is_over {
                break;
            }
        }
        Ok(self.finish())
    }

    /// Simulates up to `end_secs`, at which the caller may change the balls' velocities.
    ///
    /// # Errors
    /// Those of [`EventEngine::run`].
    pub(super) fn run_until(&mut self, end_secs: f64) -> Result<()> {
        while let Some((time, next)) = self.queue.earliest().filter(|(time, _)| *time <= end_secs) {
            self.play_event(time, next)?;
        }
        if end_secs > SHOT_SECS_MAX {
            return self.count_event(end_secs);
        }
        self.advance_to(end_secs);
        Ok(())
    }

    pub(super) fn finish(self) -> SimulatedShot {
        let end_secs = self.now;
        let trajectories = self
            .balls
            .into_iter()
            .map(|ball| ball.finish(end_secs))
            .collect();
        SimulatedShot {
            trajectories,
            events: self.events,
            end_secs,
        }
    }

    fn play_event(&mut self, time: f64, next: NextEvent) -> Result<()> {
        self.count_event(time)?;
        self.advance_to(time);
        match next {
            NextEvent::Ball(ball, event) => self.event(ball, event),
            NextEvent::Pair(first, second) => {
                // Simultaneous contacts of a rack are solved together: one after the other, the result
                // would depend on the order of the balls' numbers.
                let pairs = self.queue.together(first, second, time + INSTANT_SECS);
                let pairs: Vec<_> = pairs
                    .into_iter()
                    .filter(|&pair| self.meets_fast(pair))
                    .collect();
                match pairs.as_slice() {
                    // The law of two balls also separates pairs whose approach is slow.
                    [] | [_] => self.collide(first, second),
                    pairs => self.collide_together(pairs),
                }
            }
        }
        Ok(())
    }

    fn advance_to(&mut self, time: f64) {
        let step = time - self.now;
        // Times of simultaneous events may differ in the last bit: time never goes back.
        if step > 0.0 {
            for ball in &mut self.balls {
                ball.advance(self.now, step);
            }
            self.now = time;
        }
    }

    /// Applies the law of an event of one ball.
    fn event(&mut self, ball: usize, event: BallEvent) {
        match event {
            BallEvent::PhaseEnds => self.end_phase(ball),
            BallEvent::Touches(obstacle) => self.touch(ball, obstacle),
            BallEvent::Pocket(pocket) if self.table.pockets()[pocket].depth_m == 0.0 => {
                self.pocket(ball, pocket);
            }
            BallEvent::Pocket(pocket) => {
                let twist = self.balls[ball].twist(self.now);
                let position = self.balls[ball].position;
                let drop = self.flight(ball).drop_into(pocket, position, twist);
                self.begin(ball, drop);
            }
            BallEvent::RailEnds => {
                let twist = self.balls[ball].twist(self.now);
                self.fly(ball, twist);
            }
            BallEvent::LeavesTable => self.leave_table(ball),
        }
    }

    fn end_phase(&mut self, ball: usize) {
        let ended = self.balls[ball].motion;
        let (velocity, spin) = ended.end_state();
        let twist = Twist { velocity, spin };
        match ended.end {
            MotionEnd::Lands => return self.land(ball, twist),
            MotionEnd::Sinks(pocket) => return self.pocket(ball, pocket),
            MotionEnd::HitsFloor => return self.take_away(ball, Phase::OffTable),
            MotionEnd::SlipStops
            | MotionEnd::RollStops
            | MotionEnd::SpinStops
            | MotionEnd::Never => {}
        }
        self.lie(ball, twist);
        let BallInMotion { number, motion, .. } = self.balls[ball];
        match motion.phase {
            Phase::Rolling if ended.phase == Phase::Sliding => {
                self.report(EventKind::Rolls { ball: number });
            }
            // A ball that comes to rest on a rail is out of play.
            Phase::Resting if self.balls[ball].is_on_rail() => {
                self.report_leaving(ball);
                self.take_away(ball, Phase::OffTable);
            }
            Phase::Resting => self.report(EventKind::Rests { ball: number }),
            _ => {}
        }
    }

    /// Begins a ball's motion after an impulse. A ball on the cloth stays down unless the impulse, or
    /// the slate's reflection of its downward part, makes it hop.
    pub(super) fn set_off(&mut self, ball: usize, mut after: Twist) {
        let BallInMotion { body, motion, .. } = &self.balls[ball];
        let hop = self.hop_speed_m_s();
        if motion.phase == Phase::Airborne {
            return self.fly(ball, after);
        }
        // The slate reflects the downward part of an impulse at the same instant.
        if -self.laws.slate.restitution * after.velocity.z >= hop {
            after = self.laws.slate.resolve(body, DVec3::Z, after);
        }
        if after.velocity.z >= hop {
            self.fly(ball, after);
        } else {
            self.lie(ball, after);
        }
    }

    /// Begins the motion of a ball on a level surface; its vertical speed is dropped.
    pub(super) fn lie(&mut self, ball: usize, mut twist: Twist) {
        twist.velocity.z = 0.0;
        let position = self.balls[ball].position;
        let motion = self
            .laws
            .cloth
            .motion(&self.balls[ball].body, position, twist);
        self.begin(ball, motion);
    }

    /// Begins the motion of a ball in the air.
    pub(super) fn fly(&mut self, ball: usize, twist: Twist) {
        let motion = self.flight(ball).motion(self.balls[ball].position, twist);
        self.begin(ball, motion);
    }

    /// Freezes a ball in the air, carried by something else, until it is pushed.
    pub(super) fn hover(&mut self, ball: usize) {
        let twist = Twist {
            velocity: DVec3::ZERO,
            spin: DVec3::ZERO,
        };
        let mut motion = self.flight(ball).motion(self.balls[ball].position, twist);
        motion.freeze();
        self.begin(ball, motion);
    }

    fn flight(&self, ball: usize) -> Flight<'a> {
        Flight {
            table: self.table,
            gravity_m_s2: self.laws.cloth.gravity_m_s2,
            radius_m: self.balls[ball].body.radius_m,
        }
    }

    fn begin(&mut self, ball: usize, motion: Motion) {
        self.balls[ball].set_off(self.now, motion);
        self.predict_events(ball);
    }

    pub(super) fn hop_speed_m_s(&self) -> f64 {
        hop_speed_m_s(self.laws.cloth.gravity_m_s2)
    }

    fn pocket(&mut self, ball: usize, pocket: usize) {
        let number = self.balls[ball].number;
        let speed_m_s = self.balls[ball].twist(self.now).velocity.length();
        self.report(EventKind::Pocketed {
            ball: number,
            pocket,
            speed_m_s,
        });
        self.take_away(ball, Phase::Pocketed);
    }

    /// A ball passes the outer edge: without rails it is removed, otherwise it falls to the floor.
    fn leave_table(&mut self, ball: usize) {
        self.report_leaving(ball);
        if self.table.rails().is_none() {
            return self.take_away(ball, Phase::OffTable);
        }
        let twist = self.balls[ball].twist(self.now);
        let flight = self.flight(ball);
        let fall = flight.fall_to_floor(self.balls[ball].position, twist);
        self.begin(ball, fall);
    }

    fn report_leaving(&mut self, ball: usize) {
        self.report(EventKind::LeftTable {
            ball: self.balls[ball].number,
            point: self.balls[ball].position,
            speed_m_s: self.balls[ball].twist(self.now).velocity.length(),
        });
    }

    fn take_away(&mut self, ball: usize, phase: Phase) {
        self.balls[ball].take_away(self.now, phase);
        self.predict_events(ball);
    }

    pub(super) fn report(&mut self, kind: EventKind) {
        self.cue_ball_touched |= kind.stops_aim_line();
        self.events.push(Event {
            time_secs: self.now,
            kind,
        });
    }

    /// Recomputes the coming events of a ball whose motion changed.
    fn predict_events(&mut self, ball: usize) {
        self.queue
            .predict_events(ball, &self.balls, self.table, self.now);
    }

    fn count_event(&mut self, time: f64) -> Result<()> {
        self.events_played += 1;
        let racks = self.balls.len().div_ceil(RACK_BALLS) as u32;
        if self.events_played > racks * SHOT_EVENTS_MAX || time > SHOT_SECS_MAX {
            return Err(Error::Endless {
                time_secs: time,
                events: self.events_played,
            });
        }
        Ok(())
    }
}

/// Contacts within this time are simultaneous: sound takes ten thousand times as long to cross a ball.
const INSTANT_SECS: f64 = 1e-9;
/// Maximum number of events for every sixteen balls; more are an error. A break has a few hundred.
pub const SHOT_EVENTS_MAX: u32 = 200_000;
/// Balls of a rack with the cue ball, to which [`SHOT_EVENTS_MAX`] refers.
const RACK_BALLS: usize = 16;
/// Maximum duration of a shot in s; longer ones are an error. On an endless cloth a ball of 100 m/s
/// rolls for 730 s, and one of 10⁴ rad/s turns in place for 920 s.
pub const SHOT_SECS_MAX: f64 = 3600.0;
