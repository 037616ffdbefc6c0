//! The queue of coming events, of each ball and of each pair of balls.
//!
//! A time stays valid until one of its balls changes its motion; only then is it recomputed. Each ball
//! keeps the first of its contacts with balls of lower index, so that an event takes time linear in the
//! number of balls: 1,000 of them are feasible
//! (`carom-bench physics --part many-balls`).

use super::{
    ball::Phase,
    ball_in_motion::BallInMotion,
    contact_time::{QuadraticPath, enters_rectangle, leaves_outline, reaches_nose, reaches_point},
    static_contact::{ContactFinder, Obstacle},
    table::{Pocket, Table},
};

/// An event of one ball without another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum BallEvent {
    /// The law of motion changes, as from sliding to rolling or where the ball lands.
    PhaseEnds,
    /// It touches an obstacle.
    Touches(Obstacle),
    /// Its centre passes the rim of a pocket, by its index in the table.
    Pocket(usize),
    /// Its centre passes the edge of a rail that it lies on, towards the cushion.
    RailEnds,
    /// Its centre crosses the outline of the table.
    LeavesTable,
}

/// The next event, by the balls' indices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NextEvent {
    Ball(usize, BallEvent),
    Pair(usize, usize),
}

/// The next event of each ball and each pair.
pub(crate) struct EventQueue {
    ball_events: Vec<(f64, BallEvent)>,
    /// Contact times of balls i < j at [`pair`]`(i, j)`; infinite for none.
    pairs: Vec<f64>,
    /// For each ball the time of the earliest contact with a ball of lower index, and that ball: the
    /// first of several at the same time.
    firsts: Vec<(f64, usize)>,
}

impl EventQueue {
    pub(crate) fn new(balls: usize) -> Self {
        Self {
            ball_events: vec![(f64::INFINITY, BallEvent::PhaseEnds); balls],
            pairs: vec![f64::INFINITY; balls * balls.saturating_sub(1) / 2],
            firsts: vec![(f64::INFINITY, 0); balls],
        }
    }

    /// Recomputes the events of a ball whose motion changed.
    pub(crate) fn predict_events(
        &mut self,
        ball: usize,
        balls: &[BallInMotion],
        table: &Table,
        now: f64,
    ) {
        self.ball_events[ball] = next_ball_event(&balls[ball], table, now);
        for (other, another) in balls.iter().enumerate() {
            if other != ball {
                self.pairs[pair(ball, other)] = contact_time(&balls[ball], another, now);
            }
        }
        self.firsts[ball] = self.first_contact(ball);
        // The other pairs keep their times, so a later ball's first contact is searched again only if
        // it was with this ball: O(n) for each event in place of O(n²).
        for later in ball + 1..balls.len() {
            let time = self.pairs[pair(ball, later)];
            let (first, with) = self.firsts[later];
            // Of equal times the first ball, as a search from the beginning would find: the order of
            // events must not depend on which of them were computed when.
            if time < first || (time == first && ball < with) {
                self.firsts[later] = (time, ball);
            } else if with == ball {
                self.firsts[later] = self.first_contact(later);
            }
        }
    }

    /// The earliest contact of a ball with one of lower index.
    fn first_contact(&self, ball: usize) -> (f64, usize) {
        let mut first = (f64::INFINITY, 0);
        let row = ball * ball.saturating_sub(1) / 2;
        for (before, &time) in self.pairs[row..row + ball].iter().enumerate() {
            if time < first.0 {
                first = (time, before);
            }
        }
        first
    }

    /// The pair and all pairs that meet until `time` and are connected to it by shared balls, in a
    /// fixed order.
    pub(crate) fn together(&self, first: usize, second: usize, time: f64) -> Vec<(usize, usize)> {
        let mut pairs = vec![(first, second)];
        let mut next = 0;
        while let Some(&(a, b)) = pairs.get(next) {
            next += 1;
            for (ball, other) in [a, b]
                .into_iter()
                .flat_map(|ball| (0..self.ball_events.len()).map(move |other| (ball, other)))
            {
                let met = (ball.min(other), ball.max(other));
                if ball != other && self.pairs[pair(ball, other)] <= time && !pairs.contains(&met) {
                    pairs.push(met);
                }
            }
        }
        pairs.sort_unstable();
        pairs
    }

    /// The first event and its time; of simultaneous ones, those of single balls by index, then pairs.
    pub(crate) fn earliest(&self) -> Option<(f64, NextEvent)> {
        let mut first = (f64::INFINITY, NextEvent::Pair(0, 0));
        for (ball, &(time, event)) in self.ball_events.iter().enumerate() {
            // A strict comparison: of equal times the lower index stays, and balls come before pairs.
            if time < first.0 {
                first = (time, NextEvent::Ball(ball, event));
            }
        }
        for (ball, &(time, before)) in self.firsts.iter().enumerate() {
            if time < first.0 {
                first = (time, NextEvent::Pair(before, ball));
            }
        }
        first.0.is_finite().then_some(first)
    }
}

fn contact_time(one: &BallInMotion, other: &BallInMotion, now: f64) -> f64 {
    let in_play = one.is_in_play() && other.is_in_play();
    if !in_play || !(one.is_moving() || other.is_moving()) {
        return f64::INFINITY;
    }
    // Beyond the horizon one of the accelerations is another. That phase change is an event itself,
    // after which the pair is predicted again.
    let horizon = one.rest_of_motion(now).min(other.rest_of_motion(now));
    let path = one.path(now).relative_to(&other.path(now));
    let touching = one.body.radius_m + other.body.radius_m;
    reaches_point(&path, touching, horizon).map_or(f64::INFINITY, |t| now + t)
}

fn next_ball_event(ball: &BallInMotion, table: &Table, now: f64) -> (f64, BallEvent) {
    if !ball.is_moving() {
        return (f64::INFINITY, BallEvent::PhaseEnds);
    }
    let path = ball.path(now);
    let mut first = EarliestEvent {
        time: ball.rest_of_motion(now),
        event: BallEvent::PhaseEnds,
    };
    if ball.is_in_play() {
        let radius_m = ball.body.radius_m;
        if ball.motion.phase == Phase::Airborne {
            let touch = ContactFinder { table, radius_m }.first_obstacle(&path, first.time);
            if let Some((time, obstacle)) = touch {
                first.consider(Some(time), BallEvent::Touches(obstacle));
            }
        } else if ball.is_on_rail() {
            let edge = enters_rectangle(&path, table.inside_of_rails(), first.time);
            first.consider(edge, BallEvent::RailEnds);
            first.consider_pockets(&path, table, Pocket::bore_radius_m);
        } else {
            // The horizon of each search is the earliest event so far, so that later ones mostly end at
            // their bounds.
            first.consider_cushions(&path, table, radius_m);
            first.consider_pockets(&path, table, |pocket| pocket.radius_m);
        }
        let leaves = leaves_outline(&path, table.outline(), first.time);
        first.consider(leaves, BallEvent::LeavesTable);
    }
    (now + first.time, first.event)
}

/// The earliest event found so far.
struct EarliestEvent {
    time: f64,
    event: BallEvent,
}

impl EarliestEvent {
    fn consider(&mut self, time: Option<f64>, event: BallEvent) {
        if let Some(time) = time.filter(|&time| time < self.time) {
            *self = Self { time, event };
        }
    }

    fn consider_cushions(&mut self, path: &QuadraticPath, table: &Table, radius_m: f64) {
        for (index, nose) in table.noses().iter().enumerate() {
            let touch = reaches_nose(path, nose, radius_m, self.time);
            self.consider(touch, BallEvent::Touches(Obstacle::Nose(index)));
        }
        for (index, jaw) in table.jaws().iter().enumerate() {
            let distance = radius_m + jaw.radius_m;
            let touch = reaches_point(&path.flat_from(jaw.center), distance, self.time);
            self.consider(touch, BallEvent::Touches(Obstacle::Jaw(index)));
        }
    }

    fn consider_pockets(
        &mut self,
        path: &QuadraticPath,
        table: &Table,
        radius_m: fn(&Pocket) -> f64,
    ) {
        for (index, pocket) in table.pockets().iter().enumerate() {
            let seen = path.flat_from(pocket.center);
            let entry = reaches_point(&seen, radius_m(pocket), self.time);
            self.consider(entry, BallEvent::Pocket(index));
        }
    }
}

/// Index of an unordered pair of different balls.
fn pair(a: usize, b: usize) -> usize {
    let (low, high) = (a.min(b), a.max(b));
    high * (high - 1) / 2 + low
}
