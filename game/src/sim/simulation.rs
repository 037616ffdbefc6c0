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
    ball::{BallState, Phase},
    ball_ball::Twist,
    bodies::Bodies,
    cloth::Motion,
    contact_time::{Course, direction, leaves_outline, reaches_nose, reaches_point},
    error::{Error, Result},
    event::{Event, EventKind},
    laws::Laws,
    table::Table,
    track::Track,
};

/// What happens next to one ball without another ball.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Nothing,
    PhaseEnds,
    Nose(usize),
    Jaw(usize),
    Pocket(usize),
    LeavesTable,
}

/// When the simulation ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Until {
    /// All balls are at rest.
    Rest,
    /// Ball 0 touched a ball or a cushion or left the table.
    CueBallContact,
}

/// A ball in motion.
struct Live {
    number: u8,
    motion: Motion,
    since_secs: f64,
    gone: Option<Phase>,
    change: (f64, Change),
    track: Track,
}

impl Live {
    fn course(&self, now: f64) -> Course {
        Course::after(&self.motion, now - self.since_secs)
    }

    /// How long the motion lasts from now on.
    fn rest_of_motion(&self, now: f64) -> f64 {
        (self.since_secs + self.motion.duration_secs - now).max(0.0)
    }

    fn twist(&self, now: f64) -> Twist {
        let t = now - self.since_secs;
        Twist {
            velocity: self.motion.velocity_at(t),
            spin: self.motion.spin_at(t),
        }
    }
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
    /// Contact time of balls i < j at `pair(i, j)`.
    pairs: Vec<f64>,
    events: Vec<Event>,
    second: (f64, u32),
    cue_ball_touched: bool,
}

impl<'a> Simulation<'a> {
    pub(crate) fn new(table: &'a Table, laws: &'a Laws, states: &[BallState]) -> Self {
        let balls: Vec<_> = states.iter().map(|state| live(laws, state)).collect();
        let mut simulation = Self {
            table,
            laws,
            bodies: Bodies::new(table, &laws.body, states),
            now: 0.0,
            pairs: vec![f64::INFINITY; balls.len() * balls.len().saturating_sub(1) / 2],
            balls,
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
        let end_secs = self.now;
        let tracks = self
            .balls
            .into_iter()
            .map(|ball| ball.track.finish(end_secs))
            .collect();
        Ok(Outcome {
            tracks,
            events: self.events,
            end_secs,
        })
    }

    /// Plays the next event; false if there is none.
    fn play_event(&mut self) -> Result<bool> {
        let Some((time, happening)) = self.earliest() else {
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
            Change::Nothing => {}
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
        let live = &mut self.balls[ball];
        live.motion = motion;
        live.since_secs = self.now;
        let orientation = live.track.push(self.now, motion);
        self.bodies.set_twist(ball, twist, orientation);
    }

    fn take_away(&mut self, ball: usize, phase: Phase) {
        self.bodies.remove(ball);
        let live = &mut self.balls[ball];
        live.gone = Some(phase);
        live.motion.freeze();
        live.track.leave(self.now, phase);
        self.foresee(ball);
    }

    fn report(&mut self, kind: EventKind) {
        self.cue_ball_touched |= match kind {
            EventKind::BallBall { first, second, .. } => first == 0 || second == 0,
            EventKind::Cushion { ball, .. }
            | EventKind::Pocketed { ball, .. }
            | EventKind::LeftTable { ball } => ball == 0,
            EventKind::Strike { .. } | EventKind::Rolls { .. } | EventKind::Rests { .. } => false,
        };
        self.events.push(Event {
            time_secs: self.now,
            kind,
        });
    }

    /// Computes anew what happens next to a ball whose motion changed.
    fn foresee(&mut self, ball: usize) {
        self.balls[ball].change = self.next_change(ball);
        for other in 0..self.balls.len() {
            if other != ball {
                self.pairs[pair(ball, other)] = self.contact_time(ball, other);
            }
        }
    }

    fn earliest(&self) -> Option<(f64, Happening)> {
        let mut first = (f64::INFINITY, Happening::Pair(0, 0));
        for (index, ball) in self.balls.iter().enumerate() {
            if ball.change.0 < first.0 {
                first = (ball.change.0, Happening::Alone(index, ball.change.1));
            }
        }
        for j in 1..self.balls.len() {
            for i in 0..j {
                let time = self.pairs[pair(i, j)];
                if time < first.0 {
                    first = (time, Happening::Pair(i, j));
                }
            }
        }
        first.0.is_finite().then_some(first)
    }

    fn contact_time(&self, first: usize, second: usize) -> f64 {
        let (a, b) = (&self.balls[first], &self.balls[second]);
        let moving = a.motion.is_moving() || b.motion.is_moving();
        if !moving || a.gone.is_some() || b.gone.is_some() {
            return f64::INFINITY;
        }
        let horizon = a.rest_of_motion(self.now).min(b.rest_of_motion(self.now));
        let course = a.course(self.now).relative_to(&b.course(self.now));
        reaches_point(&course, 2.0 * self.laws.body.radius_m, horizon)
            .map_or(f64::INFINITY, |t| self.now + t)
    }

    fn next_change(&self, ball: usize) -> (f64, Change) {
        let live = &self.balls[ball];
        if !live.motion.is_moving() || live.gone.is_some() {
            return (f64::INFINITY, Change::Nothing);
        }
        let course = live.course(self.now);
        let radius = self.laws.body.radius_m;
        let mut first = (live.rest_of_motion(self.now), Change::PhaseEnds);
        let mut consider = |time: Option<f64>, change| {
            if let Some(time) = time.filter(|&time| time < first.0) {
                first = (time, change);
            }
        };
        let horizon = live.rest_of_motion(self.now);
        for (index, nose) in self.table.noses().iter().enumerate() {
            consider(
                reaches_nose(&course, nose, radius, horizon),
                Change::Nose(index),
            );
        }
        for (index, jaw) in self.table.jaws().iter().enumerate() {
            let touch = reaches_point(&course.from(jaw.center), radius + jaw.radius_m, horizon);
            consider(touch, Change::Jaw(index));
        }
        for (index, pocket) in self.table.pockets().iter().enumerate() {
            let entry = reaches_point(&course.from(pocket.center), pocket.radius_m, horizon);
            consider(entry, Change::Pocket(index));
        }
        consider(
            leaves_outline(&course, self.table.outline(), horizon),
            Change::LeavesTable,
        );
        (self.now + first.0, first.1)
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

/// What happens next.
#[derive(Clone, Copy, Debug)]
enum Happening {
    Alone(usize, Change),
    Pair(usize, usize),
}

fn live(laws: &Laws, state: &BallState) -> Live {
    let on_table = state.phase.is_on_table();
    let mut motion = laws
        .cloth
        .motion(&laws.body, state.position, state.velocity, state.spin);
    if !on_table {
        motion.freeze();
    }
    let mut track = Track::new(state.number, motion, state.orientation);
    if !on_table {
        track.leave(0.0, state.phase);
    }
    Live {
        number: state.number,
        motion,
        since_secs: 0.0,
        gone: (!on_table).then_some(state.phase),
        change: (f64::INFINITY, Change::Nothing),
        track,
    }
}

/// Index of an unordered pair of different balls.
fn pair(a: usize, b: usize) -> usize {
    let (low, high) = (a.min(b), a.max(b));
    high * (high - 1) / 2 + low
}

/// More events than this within a simulated second are an error: a break has a few hundred in all.
pub const EVENTS_PER_SECOND_MAX: u32 = 20_000;
/// Longer shots are an error: on an endless cloth the strongest stroke rolls for 240 s.
pub const SHOT_SECS_MAX: f64 = 600.0;

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
