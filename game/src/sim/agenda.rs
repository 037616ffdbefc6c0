//! What happens next, to each ball and to each pair of balls.
//!
//! A time stays valid until one of the balls it is about changes its motion; only then is it
//! computed anew.

use super::{
    contact_time::{leaves_outline, reaches_nose, reaches_point},
    live::Live,
    table::Table,
};

/// What happens to a ball without another ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Change {
    /// The motion's law changes, as from sliding to rolling.
    PhaseEnds,
    /// It touches a nose, by its index in the table.
    Nose(usize),
    /// It touches a jaw.
    Jaw(usize),
    /// Its centre enters a pocket.
    Pocket(usize),
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
}

impl Agenda {
    pub(crate) fn new(balls: usize) -> Self {
        Self {
            changes: vec![(f64::INFINITY, Change::PhaseEnds); balls],
            pairs: vec![f64::INFINITY; balls * balls.saturating_sub(1) / 2],
        }
    }

    /// Computes anew what happens to a ball whose motion changed.
    pub(crate) fn foresee(&mut self, ball: usize, balls: &[Live], table: &Table, place: Place) {
        self.changes[ball] = next_change(&balls[ball], table, place);
        for (other, live) in balls.iter().enumerate() {
            if other != ball {
                self.pairs[pair(ball, other)] = contact_time(&balls[ball], live, place);
            }
        }
    }

    /// What happens first and when; of things at the same instant, changes by ball and then pairs.
    pub(crate) fn earliest(&self) -> Option<(f64, Happening)> {
        let mut first = (f64::INFINITY, Happening::Pair(0, 0));
        for (ball, &(time, change)) in self.changes.iter().enumerate() {
            if time < first.0 {
                first = (time, Happening::Alone(ball, change));
            }
        }
        for high in 1..self.changes.len() {
            for low in 0..high {
                let time = self.pairs[pair(low, high)];
                if time < first.0 {
                    first = (time, Happening::Pair(low, high));
                }
            }
        }
        first.0.is_finite().then_some(first)
    }
}

/// From when on, and for which balls, the future is computed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) now: f64,
    pub(crate) radius_m: f64,
}

fn contact_time(one: &Live, other: &Live, Place { now, radius_m }: Place) -> f64 {
    let on_table = one.on_table && other.on_table;
    if !on_table || !(one.is_moving() || other.is_moving()) {
        return f64::INFINITY;
    }
    let horizon = one.rest_of_motion(now).min(other.rest_of_motion(now));
    let course = one.course(now).relative_to(&other.course(now));
    reaches_point(&course, 2.0 * radius_m, horizon).map_or(f64::INFINITY, |t| now + t)
}

fn next_change(ball: &Live, table: &Table, Place { now, radius_m }: Place) -> (f64, Change) {
    if !ball.is_moving() {
        return (f64::INFINITY, Change::PhaseEnds);
    }
    let course = ball.course(now);
    let horizon = ball.rest_of_motion(now);
    let mut first = (horizon, Change::PhaseEnds);
    let mut consider = |time: Option<f64>, change| {
        if let Some(time) = time.filter(|&time| time < first.0) {
            first = (time, change);
        }
    };
    for (index, nose) in table.noses().iter().enumerate() {
        consider(
            reaches_nose(&course, nose, radius_m, horizon),
            Change::Nose(index),
        );
    }
    for (index, jaw) in table.jaws().iter().enumerate() {
        let touch = reaches_point(&course.from(jaw.center), radius_m + jaw.radius_m, horizon);
        consider(touch, Change::Jaw(index));
    }
    for (index, pocket) in table.pockets().iter().enumerate() {
        let entry = reaches_point(&course.from(pocket.center), pocket.radius_m, horizon);
        consider(entry, Change::Pocket(index));
    }
    consider(
        leaves_outline(&course, table.outline(), horizon),
        Change::LeavesTable,
    );
    (now + first.0, first.1)
}

/// Index of an unordered pair of different balls.
fn pair(a: usize, b: usize) -> usize {
    let (low, high) = (a.min(b), a.max(b));
    high * (high - 1) / 2 + low
}
