//! The simulation of one shot, from event to event.
//!
//! ```text
//! earliest event ─► rapier moves all balls to it ─► the law of that event sets the velocities
//!       ▲                                                            │
//!       └──── contact times of the balls that changed ◄──────────────┘
//! ```
//! Events at the same instant are taken in a fixed order: phase changes and cushions by ball, then
//! pairs, those that share balls together. Nothing else decides, so that a shot has the same bits on every run.

use glam::DVec3;

use super::{
    agenda::{Agenda, Change, Happening},
    ball::{BallState, Phase},
    ball_ball::{CLUSTER_SPEED_M_S, Twist},
    bodies::Bodies,
    bounce::skimmed,
    contact_time::direction,
    cushion::kept_apart,
    error::{Error, Result},
    event::{Event, EventKind, Surface},
    flight::{Flight, hop_speed_m_s},
    laws::Laws,
    live::{Live, ON_RAIL_RADII},
    motion::{End, Motion},
    obstacle::{Obstacle, Push, Scout},
    simultaneous::Touch,
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
            bodies: Bodies::new(table, states),
            now: 0.0,
            balls: states
                .iter()
                .map(|state| Live::new(table, laws, state))
                .collect(),
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
            Happening::Pair(first, second) => {
                let pairs = self.agenda.together(first, second, time + INSTANT_SECS);
                let pairs: Vec<_> = pairs
                    .into_iter()
                    .filter(|&pair| self.meets_fast(pair))
                    .collect();
                match pairs.as_slice() {
                    [] | [_] => self.collide(first, second),
                    pairs => self.collide_together(pairs),
                }
            }
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
            Change::Touches(obstacle) => self.touch(ball, obstacle),
            Change::Pocket(pocket) if self.table.pockets()[pocket].depth_m == 0.0 => {
                self.pocket(ball, pocket);
            }
            Change::Pocket(pocket) => {
                let twist = self.balls[ball].twist(self.now);
                let position = self.bodies.position(ball);
                let drop = self.flight(ball).drop_into(pocket, position, twist);
                self.begin(ball, drop, twist);
            }
            Change::RailEnds => {
                let twist = self.balls[ball].twist(self.now);
                self.fly(ball, twist);
            }
            Change::LeavesTable => self.leave_table(ball),
        }
    }

    fn end_phase(&mut self, ball: usize) {
        let ended = self.balls[ball].motion;
        let (velocity, spin) = ended.end_state();
        let twist = Twist { velocity, spin };
        match ended.end {
            End::Lands => return self.land(ball, twist),
            End::Sinks(pocket) => return self.pocket(ball, pocket),
            End::HitsFloor => return self.take_away(ball, Phase::OffTable),
            End::SlipStops | End::RollStops | End::SpinStops | End::Never => {}
        }
        self.lie(ball, twist);
        let Live { number, motion, .. } = self.balls[ball];
        match motion.phase {
            Phase::Rolling if ended.phase == Phase::Sliding => {
                self.report(EventKind::Rolls { ball: number });
            }
            Phase::Resting if self.balls[ball].is_on_rail() => {
                self.report_leaving(ball);
                self.take_away(ball, Phase::OffTable);
            }
            Phase::Resting => self.report(EventKind::Rests { ball: number }),
            _ => {}
        }
    }

    fn touch(&mut self, ball: usize, obstacle: Obstacle) {
        let Live { number, body, .. } = self.balls[ball];
        let before = self.balls[ball].twist(self.now);
        if obstacle == Obstacle::Top {
            return self.land(ball, before);
        }
        let scout = Scout {
            table: self.table,
            radius_m: body.radius_m,
        };
        let center = self.bodies.position(ball);
        let Push { normal, away } = scout.push(obstacle, center);
        let point = center - body.radius_m * away;
        let speed_m_s = -before.velocity.dot(away);
        let (cushion, kind) = match obstacle {
            Obstacle::Nose(_) | Obstacle::Jaw(_) => {
                let kind = EventKind::Cushion {
                    ball: number,
                    point,
                    speed_m_s,
                };
                (true, kind)
            }
            _ => {
                let kind = EventKind::Bounces {
                    ball: number,
                    surface: obstacle.surface(),
                    point,
                    speed_m_s,
                };
                (false, kind)
            }
        };
        let law = match obstacle.surface() {
            Surface::Pocket => self.laws.pocket,
            Surface::Rail | Surface::Cloth => self.laws.slate,
        };
        let mut after = if !cushion {
            law.resolve(&body, normal, before)
        } else if self.balls[ball].motion.phase == Phase::Airborne {
            self.laws.cushion.rebound_in_air(&body, normal, before)
        } else {
            let nose_height_m = self.table.nose_height_m();
            self.laws
                .cushion
                .rebound(&body, (away, nose_height_m), before)
        };
        after.velocity = if cushion {
            kept_apart(away, before.velocity, after.velocity)
        } else {
            skimmed(away, before.velocity, after.velocity)
        };
        self.report(kind);
        self.set_off(ball, after);
    }

    /// A ball falls onto a level surface: the cloth, or a rail.
    fn land(&mut self, ball: usize, before: Twist) {
        let Live { number, body, .. } = self.balls[ball];
        let height = self.bodies.position(ball).z;
        let on_rail = height > ON_RAIL_RADII * body.radius_m;
        let (surface, level) = if on_rail {
            (Surface::Rail, self.table.rail_height_m() + body.radius_m)
        } else {
            (Surface::Cloth, body.radius_m)
        };
        self.bodies.set_height(ball, level);
        let center = self.bodies.position(ball);
        self.report(EventKind::Bounces {
            ball: number,
            surface,
            point: center.with_z(level - body.radius_m),
            speed_m_s: -before.velocity.z,
        });
        let after = self.laws.slate.resolve(&body, DVec3::Z, before);
        if after.velocity.z < self.hop_speed_m_s() {
            self.lie(ball, after);
        } else {
            self.fly(ball, after);
        }
    }

    fn collide(&mut self, first: usize, second: usize) {
        let bodies = [first, second].map(|ball| self.balls[ball].body);
        let normal = direction(self.bodies.position(first), self.bodies.position(second));
        let before = [first, second].map(|ball| self.balls[ball].twist(self.now));
        self.report(EventKind::BallBall {
            first: self.balls[first].number,
            second: self.balls[second].number,
            point: self.bodies.position(first) + bodies[0].radius_m * normal,
            speed_m_s: (before[0].velocity - before[1].velocity).dot(normal),
        });
        let (after_first, after_second) =
            self.laws
                .ball_ball
                .resolve(normal, (&bodies[0], before[0]), (&bodies[1], before[1]));
        self.set_off(first, after_first);
        self.set_off(second, after_second);
    }

    /// Whether a pair approaches fast enough not to be a matter of the rule for clusters.
    fn meets_fast(&self, (first, second): (usize, usize)) -> bool {
        let normal = direction(self.bodies.position(first), self.bodies.position(second));
        let [one, other] = [first, second].map(|ball| self.balls[ball].twist(self.now).velocity);
        (one - other).dot(normal) > CLUSTER_SPEED_M_S
    }

    /// Contacts at the same instant that share balls.
    fn collide_together(&mut self, pairs: &[(usize, usize)]) {
        let mut balls: Vec<_> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
        balls.sort_unstable();
        balls.dedup();
        let place = |ball: usize| balls.partition_point(|&b| b < ball);
        let mut twists: Vec<_> = balls
            .iter()
            .map(|&ball| self.balls[ball].twist(self.now))
            .collect();
        let bodies: Vec<_> = balls.iter().map(|&ball| self.balls[ball].body).collect();
        let mut touches = Vec::with_capacity(pairs.len());
        for &(first, second) in pairs {
            let touch = Touch {
                first: place(first),
                second: place(second),
                normal: direction(self.bodies.position(first), self.bodies.position(second)),
            };
            let closing = twists[touch.first].velocity - twists[touch.second].velocity;
            self.report(EventKind::BallBall {
                first: self.balls[first].number,
                second: self.balls[second].number,
                point: self.bodies.position(first) + bodies[touch.first].radius_m * touch.normal,
                speed_m_s: closing.dot(touch.normal),
            });
            touches.push(touch);
        }
        self.laws
            .ball_ball
            .resolve_together(&bodies, &touches, &mut twists);
        for (&ball, &twist) in balls.iter().zip(&twists) {
            self.set_off(ball, twist);
        }
    }

    /// Begins a ball's motion after a blow. What lies stays down unless the blow, or the slate's
    /// answer to it, makes it hop.
    fn set_off(&mut self, ball: usize, mut after: Twist) {
        let Live { body, motion, .. } = &self.balls[ball];
        let hop = self.hop_speed_m_s();
        if motion.phase == Phase::Airborne {
            return self.fly(ball, after);
        }
        if -self.laws.slate.restitution * after.velocity.z >= hop {
            after = self.laws.slate.resolve(body, DVec3::Z, after);
        }
        if after.velocity.z >= hop {
            self.fly(ball, after);
        } else {
            self.lie(ball, after);
        }
    }

    /// Begins the motion of a ball that lies on a level surface: what is left of vertical speed
    /// is lost.
    fn lie(&mut self, ball: usize, mut twist: Twist) {
        twist.velocity.z = 0.0;
        let position = self.bodies.position(ball);
        let motion = self
            .laws
            .cloth
            .motion(&self.balls[ball].body, position, twist);
        self.begin(ball, motion, twist);
    }

    /// Begins the motion of a ball in the air.
    fn fly(&mut self, ball: usize, twist: Twist) {
        let motion = self.flight(ball).motion(self.bodies.position(ball), twist);
        self.begin(ball, motion, twist);
    }

    fn flight(&self, ball: usize) -> Flight<'a> {
        Flight {
            table: self.table,
            gravity_m_s2: self.laws.cloth.gravity_m_s2,
            radius_m: self.balls[ball].body.radius_m,
        }
    }

    fn begin(&mut self, ball: usize, motion: Motion, twist: Twist) {
        let orientation = self.balls[ball].set_off(self.now, motion);
        self.bodies.set_twist(ball, twist, orientation);
        self.foresee(ball);
    }

    fn hop_speed_m_s(&self) -> f64 {
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

    /// A ball passes the outer edge: from a flat table it is gone, from a real one it falls.
    fn leave_table(&mut self, ball: usize) {
        self.report_leaving(ball);
        if self.table.rails().is_none() {
            return self.take_away(ball, Phase::OffTable);
        }
        let twist = self.balls[ball].twist(self.now);
        let flight = self.flight(ball);
        let fall = flight.fall_to_floor(self.bodies.position(ball), twist);
        self.begin(ball, fall, twist);
    }

    fn report_leaving(&mut self, ball: usize) {
        self.report(EventKind::LeftTable {
            ball: self.balls[ball].number,
            point: self.bodies.position(ball),
            speed_m_s: self.balls[ball].twist(self.now).velocity.length(),
        });
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
        self.agenda.foresee(ball, &self.balls, self.table, self.now);
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

/// Contacts this close count as one: sound crosses a ball in ten thousand times as long.
const INSTANT_SECS: f64 = 1e-9;
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
        let twist = laws
            .cue
            .strike(&states[0].body, &Stroke::straight(0.01, 9.0));
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
