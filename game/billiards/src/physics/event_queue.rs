//! What happens next, to each ball and to each pair of balls.
//!
//! A time stays valid until one of the balls it is about changes its motion; only then is it
//! computed anew. Each ball keeps the first of its contacts with the balls before it, so that an
//! event takes time linear in the number of balls: 1,000 of them are feasible (`carom-bench physics
//! --part crowd`).

use super::{
    ball::Phase,
    ball_in_motion::Live,
    contact_time::{Course, enters_rectangle, leaves_outline, reaches_nose, reaches_point},
    static_contact::{Obstacle, Scout},
    table::{Pocket, Table},
    theft::{Clinging, overlap},
};

/// What happens to a ball without another ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Change {
    /// The motion's law changes, as from sliding to rolling or where it lands.
    PhaseEnds,
    /// It touches what does not move.
    Touches(Obstacle),
    /// Its centre passes the rim of a pocket, by its index in the table.
    Pocket(usize),
    /// Its centre passes the edge of a rail that it lies on, towards the cushion.
    RailEnds,
    /// Its centre crosses the outline of the table.
    LeavesTable,
}

/// What happens next, by the balls' indices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Happening {
    Alone(usize, Change),
    Pair(usize, usize),
}

/// The next happening of each ball and each pair.
pub(crate) struct Agenda {
    changes: Vec<(f64, Change)>,
    /// Of balls i < j at [`pair`]`(i, j)`; infinite for none.
    pairs: Vec<f64>,
    /// Of each ball the earliest contact with a ball before it, and that ball: of several at the
    /// same time the first.
    firsts: Vec<(f64, usize)>,
    clinging: Clinging,
}

impl Agenda {
    pub(crate) fn new(balls: usize, clinging: Clinging) -> Self {
        Self {
            changes: vec![(f64::INFINITY, Change::PhaseEnds); balls],
            pairs: vec![f64::INFINITY; balls * balls.saturating_sub(1) / 2],
            firsts: vec![(f64::INFINITY, 0); balls],
            clinging,
        }
    }

    /// Computes anew what happens to a ball whose motion changed.
    pub(crate) fn foresee(&mut self, ball: usize, balls: &[Live], table: &Table, now: f64) {
        self.changes[ball] = next_change(&balls[ball], table, now);
        for (other, live) in balls.iter().enumerate() {
            if other != ball {
                self.pairs[pair(ball, other)] =
                    contact_time(&balls[ball], live, (now, self.clinging));
            }
        }
        self.firsts[ball] = self.first_contact(ball);
        for later in ball + 1..balls.len() {
            let time = self.pairs[pair(ball, later)];
            let (first, with) = self.firsts[later];
            if time < first || (time == first && ball < with) {
                self.firsts[later] = (time, ball);
            } else if with == ball {
                self.firsts[later] = self.first_contact(later);
            }
        }
    }

    /// The earliest contact of a ball with one before it.
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

    /// The pair and all that meet until `time` and hang together with it, in a fixed order.
    pub(crate) fn together(&self, first: usize, second: usize, time: f64) -> Vec<(usize, usize)> {
        let mut pairs = vec![(first, second)];
        let mut next = 0;
        while let Some(&(a, b)) = pairs.get(next) {
            next += 1;
            for (ball, other) in [a, b]
                .into_iter()
                .flat_map(|ball| (0..self.changes.len()).map(move |other| (ball, other)))
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

    /// What happens first and when; of things at the same instant, changes by ball and then pairs.
    pub(crate) fn earliest(&self) -> Option<(f64, Happening)> {
        let mut first = (f64::INFINITY, Happening::Pair(0, 0));
        for (ball, &(time, change)) in self.changes.iter().enumerate() {
            if time < first.0 {
                first = (time, Happening::Alone(ball, change));
            }
        }
        for (ball, &(time, before)) in self.firsts.iter().enumerate() {
            if time < first.0 {
                first = (time, Happening::Pair(before, ball));
            }
        }
        first.0.is_finite().then_some(first)
    }
}

fn contact_time(one: &Live, other: &Live, (now, clinging): (f64, Clinging)) -> f64 {
    let in_play = one.is_in_play() && other.is_in_play();
    if !in_play || !(one.is_moving() || other.is_moving()) {
        return f64::INFINITY;
    }
    if clinging == Clinging::Steals && overlap(one, other, now) {
        return now;
    }
    let horizon = one.rest_of_motion(now).min(other.rest_of_motion(now));
    let course = one.course(now).relative_to(&other.course(now));
    let touching = one.body.radius_m + other.body.radius_m;
    reaches_point(&course, touching, horizon).map_or(f64::INFINITY, |t| now + t)
}

fn next_change(ball: &Live, table: &Table, now: f64) -> (f64, Change) {
    if !ball.is_moving() {
        return (f64::INFINITY, Change::PhaseEnds);
    }
    let course = ball.course(now);
    let mut first = First {
        time: ball.rest_of_motion(now),
        change: Change::PhaseEnds,
    };
    if ball.is_in_play() {
        let radius_m = ball.body.radius_m;
        if ball.motion.phase == Phase::Airborne {
            let touch = Scout { table, radius_m }.first_obstacle(&course, first.time);
            if let Some((time, obstacle)) = touch {
                first.consider(Some(time), Change::Touches(obstacle));
            }
        } else if ball.is_on_rail() {
            let edge = enters_rectangle(&course, table.inside_of_rails(), first.time);
            first.consider(edge, Change::RailEnds);
            first.consider_pockets(&course, table, Pocket::bore_radius_m);
        } else {
            first.consider_cushions(&course, table, radius_m);
            first.consider_pockets(&course, table, |pocket| pocket.radius_m);
        }
        let leaves = leaves_outline(&course, table.outline(), first.time);
        first.consider(leaves, Change::LeavesTable);
    }
    (now + first.time, first.change)
}

/// What comes first.
struct First {
    time: f64,
    change: Change,
}

impl First {
    fn consider(&mut self, time: Option<f64>, change: Change) {
        if let Some(time) = time.filter(|&time| time < self.time) {
            *self = Self { time, change };
        }
    }

    fn consider_cushions(&mut self, course: &Course, table: &Table, radius_m: f64) {
        for (index, nose) in table.noses().iter().enumerate() {
            let touch = reaches_nose(course, nose, radius_m, self.time);
            self.consider(touch, Change::Touches(Obstacle::Nose(index)));
        }
        for (index, jaw) in table.jaws().iter().enumerate() {
            let distance = radius_m + jaw.radius_m;
            let touch = reaches_point(&course.flat_from(jaw.center), distance, self.time);
            self.consider(touch, Change::Touches(Obstacle::Jaw(index)));
        }
    }

    fn consider_pockets(&mut self, course: &Course, table: &Table, radius_m: fn(&Pocket) -> f64) {
        for (index, pocket) in table.pockets().iter().enumerate() {
            let seen = course.flat_from(pocket.center);
            let entry = reaches_point(&seen, radius_m(pocket), self.time);
            self.consider(entry, Change::Pocket(index));
        }
    }
}

/// Index of an unordered pair of different balls.
fn pair(a: usize, b: usize) -> usize {
    let (low, high) = (a.min(b), a.max(b));
    high * (high - 1) / 2 + low
}
