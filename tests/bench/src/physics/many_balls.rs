//! Many more balls than any game has: the cost of an event with them, and that nothing else changes.
//!
//! Balls are numbered by a byte, so that a world has at most 256. The simulation identifies them by
//! their index, and these fields, whose numbers repeat, are given to it directly.

use std::fmt;

use cpu_time::ThreadTime;
use glam::DVec3;
use serde::Serialize;

use super::infinite_table::{ball, infinite_table};
use crate::timing::ms_since;
use carom_billiards::Result;
use carom_billiards::physics::{
    BallBody, BallState, CLUSTER_ENERGY_J, Event, EventKind, Laws, Shot,
};

/// A field of balls into which a fast one is shot.
#[derive(Clone, Debug, Serialize)]
pub struct ManyBallsRow {
    /// Number of balls, with the fast one.
    pub balls: usize,
    /// Gap between neighbours, in m: 0 is frozen.
    pub gap_m: f64,
    /// Number of contacts and phase changes.
    pub events: usize,
    /// Number of balls that have moved.
    pub moved: usize,
    /// Time until all are at rest, in s.
    pub duration_secs: f64,
    /// CPU time to simulate it once.
    pub cpu_ms: f64,
    /// CPU time per event, in µs.
    pub event_us: f64,
    /// Largest growth of the energy at an event beyond what the rule for clusters adds, in J.
    pub energy_growth_j: f64,
    /// Largest final overlap of two balls, in m; negative for a gap.
    pub overlap_m: f64,
}

impl fmt::Display for ManyBallsRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:5} {:9.0e} {:7} {:6} {:9.2} {:10.1} {:9.1} {:11.1e} {:11.1e}",
            self.balls,
            self.gap_m,
            self.events,
            self.moved,
            self.duration_secs,
            self.cpu_ms,
            self.event_us,
            self.energy_growth_j,
            self.overlap_m
        )
    }
}

/// The heading of a table of [`ManyBallsRow`]s.
pub const HEADING: &str =
    "balls    gap, m  events  moved  lasts, s     CPU ms  µs/event  growth, J  overlap, m";

/// Fields of up to 1,000 balls, spread and frozen.
///
/// # Errors
/// None in practice for valid balls on an endless cloth.
pub fn measure() -> Result<Vec<ManyBallsRow>> {
    let fields = [
        (16, GAP_M),
        (64, GAP_M),
        (256, GAP_M),
        (1000, GAP_M),
        (1000, 0.0),
    ];
    fields
        .map(|(balls, gap_m)| played(balls, gap_m))
        .into_iter()
        .collect()
}

fn played(balls: usize, gap_m: f64) -> Result<ManyBallsRow> {
    let (table, laws, field) = (infinite_table()?, Laws::default(), field(balls, gap_m));
    let begun = ThreadTime::now();
    let shot = Shot::of_balls(&table, &laws, &field)?;
    let cpu_ms = ms_since(begun);
    let ends = shot.final_states();
    let moves = |(a, b): &(&BallState, &BallState)| a.position.distance(b.position) > 1e-6;
    Ok(ManyBallsRow {
        balls,
        gap_m,
        events: shot.events().len(),
        moved: field.iter().zip(&ends).filter(moves).count(),
        duration_secs: shot.duration_secs(),
        cpu_ms,
        event_us: 1e3 * cpu_ms / shot.events().len() as f64,
        energy_growth_j: energy_growth_j(&shot),
        overlap_m: overlap_m(&ends),
    })
}

/// A field of balls in rows, each in the gaps of the last, and one that comes from a distance.
fn field(balls: usize, gap_m: f64) -> Vec<BallState> {
    let pitch = 2.0 * BallBody::default().radius_m + gap_m;
    let columns = (balls as f64).sqrt().ceil() as usize;
    let place = |index: usize| {
        let (row, column) = (index / columns, index % columns);
        let shift = if row % 2 == 0 { 0.0 } else { 0.5 };
        let x = pitch * 0.75f64.sqrt() * row as f64;
        (x, pitch * (column as f64 + shift))
    };
    let still = (1..balls).map(|index| {
        let (x, y) = place(index - 1);
        ball((index % 256) as u8, x, y, DVec3::ZERO, DVec3::ZERO)
    });
    let middle = 0.5 * pitch * columns as f64 + 0.3 * pitch;
    let fast = ball(0, -0.5, middle, SPEED_M_S * DVec3::X, DVec3::ZERO);
    [fast].into_iter().chain(still).collect()
}

fn energy_growth_j(shot: &Shot) -> f64 {
    let mut last = f64::INFINITY;
    let mut growth = f64::NEG_INFINITY;
    for together in shot.events().chunk_by(|a, b| a.time_secs == b.time_secs) {
        let of = |ball: &BallState| ball.body.kinetic_energy_j(ball.velocity, ball.spin);
        let now: f64 = shot.states_at(together[0].time_secs).iter().map(of).sum();
        let meets = |event: &&Event| matches!(event.kind, EventKind::BallBall { .. });
        let allowed = CLUSTER_ENERGY_J * together.iter().filter(meets).count() as f64;
        growth = growth.max(now - last - allowed);
        last = now;
    }
    growth
}

fn overlap_m(states: &[BallState]) -> f64 {
    let mut deepest = f64::NEG_INFINITY;
    for (index, one) in states.iter().enumerate() {
        for other in &states[..index] {
            let touching = one.body.radius_m + other.body.radius_m;
            deepest = deepest.max(touching - one.position.distance(other.position));
        }
    }
    deepest
}

/// Gap between neighbours that are not frozen.
const GAP_M: f64 = 0.01;
/// Speed of the fast ball: that of the cue in the fastest stroke.
const SPEED_M_S: f64 = 20.0;
