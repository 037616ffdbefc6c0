//! The simulation of one shot, from event to event.
//!
//! ```text
//! earliest event ─► rapier moves all balls to it ─► the law of that event sets the velocities
//!       ▲                                                            │
//!       └──── contact times of the balls that changed ◄──────────────┘
//! ```
//! Events at the same instant are taken in a fixed order: phase changes and cushions by ball, then
//! pairs. Nothing else decides, so that a shot has the same bits on every run.

use glam::DVec3;

use super::{
    agenda::{Agenda, Change, Happening, Place},
    ball::{BallState, Phase},
    ball_ball::Twist,
    bodies::Bodies,
    contact_time::direction,
    error::{Error, Result},
    event::{Event, EventKind},
    laws::Laws,
    live::Live,
    table::Table,
    track::Track,
};

/// When the simulation ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Until {
    /// All balls are at rest.
    Rest,
    /// Ball 0 touched a ball or a cushion or left the table.
    CueBallContact,
}

/// What came out of a simulation.
pub(crate) struct Outcome {
    pub(crate) tracks: Vec<Track>,
    pub(crate) events: Vec<Event>,
    pub(crate) end_secs: f64,
}

pub(crate) struct Simulation<'a> {
    table: &'a Table,
    laws: &'a Laws,
    bodies: Bodies,
    now: f64,
    balls: Vec<Live>,
    agenda: Agenda,
    events: Vec<Event>,
    /// When the current second of counting began, and the events since.
    second: (f64, u32),
    cue_ball_touched: bool,
}

impl<'a> Simulation<'a> {
    pub(crate) fn new(table: &'a Table, laws: &'a Laws, states: &[BallState]) -> Self {
        let mut simulation = Self {
            table,
            laws,
            bodies: Bodies::new(table, &laws.body, states),
            now: 0.0,
            balls: states.iter().map(|state| Live::new(laws, state)).collect(),
            agenda: Agenda::new(states.len()),
            events: Vec::new(),
            second: (0.0, 0),
            cue_ball_touched: false,
        };
        for ball in 0..simulation.balls.len() {
            simulation.foresee(ball);
        }
        simulation
    }

    /// Simulates to the end.
    ///
    /// # Errors
    /// [`Error::Endless`] beyond [`EVENTS_PER_SECOND_MAX`] or [`SHOT_SECS_MAX`].
    pub(crate) fn run(mut self, until: Until) -> Result<Outcome> {
        while self.play_event()? {
            if until == Until::CueBallContact && self.cue_ball_touched {
                break;
            }
        }
        Ok(self.finish())
    }

    /// Simulates to the end and calls `each` after every `frame_secs` of the shot. The shot does
    /// not depend on it: a frame ends between two events and changes nothing.
    ///
    /// # Errors
    /// As [`Simulation::run`].
    pub(crate) fn run_in_frames(
        mut self,
        frame_secs: f64,
        each: &mut dyn FnMut(),
    ) -> Result<Outcome> {
        let mut frames = 0.0;
        while let Some((time, _)) = self.agenda.earliest() {
            while time > (frames + 1.0) * frame_secs {
                frames += 1.0;
                each();
            }
            self.play_event()?;
        }
        Ok(self.finish())
    }

    fn finish(self) -> Outcome {
        let end_secs = self.now;
        let tracks = self
            .balls
            .into_iter()
            .map(|ball| ball.finish(end_secs))
            .collect();
        Outcome {
            tracks,
            events: self.events,
            end_secs,
        }
    }

    /// Plays the next event; false if there is none.
    fn play_event(&mut self) -> Result<bool> {
        let Some((time, happening)) = self.agenda.earliest() else {
            return Ok(false);
        };
        self.count_event(time)?;
        self.advance_to(time);
        match happening {
            Happening::Alone(ball, change) => self.change(ball, change),
            Happening::Pair(first, second) => self.collide(first, second),
        }
        Ok(true)
    }

    fn advance_to(&mut self, time: f64) {
        let step = time - self.now;
        if step > 0.0 {
            let now = self.now;
            let motions = self
                .balls
                .iter()
                .map(|ball| (&ball.motion, now - ball.since_secs));
            self.bodies.advance(step, motions);
            self.now = time;
        }
    }

    /// The law of the event sets the ball's twist.
    fn change(&mut self, ball: usize, change: Change) {
        match change {
            Change::PhaseEnds => self.end_phase(ball),
            Change::Nose(nose) => {
                let away = self.table.noses()[nose].normal().extend(0.0);
                self.rebound(ball, away);
            }
            Change::Jaw(jaw) => {
                let center = self.table.jaws()[jaw].center.extend(0.0);
                self.rebound(ball, direction(center, self.bodies.position(ball)));
            }
            Change::Pocket(pocket) => {
                let number = self.balls[ball].number;
                let speed_m_s = self.balls[ball].twist(self.now).velocity.length();
                self.report(EventKind::Pocketed {
                    ball: number,
                    pocket,
                    speed_m_s,
                });
                self.take_away(ball, Phase::Pocketed);
            }
            Change::LeavesTable => {
                self.report(EventKind::LeftTable {
                    ball: self.balls[ball].number,
                });
                self.take_away(ball, Phase::OffTable);
            }
        }
    }

    fn end_phase(&mut self, ball: usize) {
        let before = self.balls[ball].motion.phase;
        let (velocity, spin) = self.balls[ball].motion.end_state();
        self.set_off(ball, Twist { velocity, spin });
        let Live { number, motion, .. } = self.balls[ball];
        match motion.phase {
            Phase::Rolling if before == Phase::Sliding => {
                self.report(EventKind::Rolls { ball: number });
            }
            Phase::Resting => self.report(EventKind::Rests { ball: number }),
            _ => {}
        }
        self.foresee(ball);
    }

    fn rebound(&mut self, ball: usize, away: DVec3) {
        let Laws { body, cushion, .. } = self.laws;
        let before = self.balls[ball].twist(self.now);
        self.report(EventKind::Cushion {
            ball: self.balls[ball].number,
            point: self.bodies.position(ball) - body.radius_m * away,
            speed_m_s: -before.velocity.dot(away),
        });
        let after = cushion.resolve(body, away, self.table.nose_height_m(), before);
        self.set_off(ball, after);
        self.foresee(ball);
    }

    fn collide(&mut self, first: usize, second: usize) {
        let Laws {
            body, ball_ball, ..
        } = self.laws;
        let normal = direction(self.bodies.position(first), self.bodies.position(second));
        let before = [first, second].map(|ball| self.balls[ball].twist(self.now));
        self.report(EventKind::BallBall {
            first: self.balls[first].number,
            second: self.balls[second].number,
            point: self.bodies.position(first) + body.radius_m * normal,
            speed_m_s: (before[0].velocity - before[1].velocity).dot(normal),
        });
        let (after_first, after_second) = ball_ball.resolve(body, normal, before[0], before[1]);
        self.set_off(first, after_first);
        self.set_off(second, after_second);
        self.foresee(first);
        self.foresee(second);
    }

    /// Begins a ball's next motion.
    fn set_off(&mut self, ball: usize, twist: Twist) {
        let position = self.bodies.position(ball);
        let motion = self
            .laws
            .cloth
            .motion(&self.laws.body, position, twist.velocity, twist.spin);
        let orientation = self.balls[ball].set_off(self.now, motion);
        self.bodies.set_twist(ball, twist, orientation);
    }

    fn take_away(&mut self, ball: usize, phase: Phase) {
        self.bodies.remove(ball);
        self.balls[ball].take_away(self.now, phase);
        self.foresee(ball);
    }

    fn report(&mut self, kind: EventKind) {
        self.cue_ball_touched |= kind.stops_aim_line();
        self.events.push(Event {
            time_secs: self.now,
            kind,
        });
    }

    /// Plans anew for a ball whose motion changed.
    fn foresee(&mut self, ball: usize) {
        let place = Place {
            now: self.now,
            radius_m: self.laws.body.radius_m,
        };
        self.agenda.foresee(ball, &self.balls, self.table, place);
    }

    fn count_event(&mut self, time: f64) -> Result<()> {
        let (since, events) = &mut self.second;
        if time - *since >= 1.0 {
            (*since, *events) = (time, 0);
        }
        *events += 1;
        if *events > EVENTS_PER_SECOND_MAX || time > SHOT_SECS_MAX {
            return Err(Error::Endless {
                time_secs: time,
                events: *events,
            });
        }
        Ok(())
    }
}

/// More events than this within a simulated second are an error: a break has a few hundred in all.
pub const EVENTS_PER_SECOND_MAX: u32 = 20_000;
/// Longer shots are an error: on an endless cloth a ball of 100 m/s rolls for 730 s, and one of
/// 10⁴ rad/s turns in place for 920 s.
pub const SHOT_SECS_MAX: f64 = 3600.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::stick::Stroke;

    /// Contact times come from polynomials; rapier's narrow phase, which knows nothing of them,
    /// must find that no ball is ever inside another or a cushion, and that a contact is touch.
    #[test]
    fn rapier_sees_contacts_where_the_polynomials_put_them() {
        let (table, laws) = (Table::nine_foot(), Laws::default());
        let mut states = table.rack_eight(9).balls;
        let twist = laws.cue.strike(&laws.body, &Stroke::straight(0.01, 9.0));
        states[0].velocity = twist.velocity;
        let mut simulation = Simulation::new(&table, &laws, &states);
        let mut contacts = 0;
        while simulation.play_event().expect("within limits") {
            let gaps = simulation.bodies.contact_gaps_m();
            let deepest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(
                deepest > -1e-9,
                "an overlap of {deepest} m at {} s",
                simulation.now
            );
            if let Some(Event {
                kind: EventKind::BallBall { .. },
                time_secs,
            }) = simulation.events.last()
                && *time_secs == simulation.now
            {
                assert!(
                    deepest < 1e-9,
                    "a contact {deepest} m apart at {time_secs} s"
                );
                contacts += 1;
            }
        }
        assert!(contacts > 20, "{contacts} contacts");
    }
}
