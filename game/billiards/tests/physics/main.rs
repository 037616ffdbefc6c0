//! The simulation: its laws, whole shots, and aiming.

#![allow(
    clippy::disallowed_methods,
    reason = "tests need no digits that all systems share"
)]

mod aiming;
mod handover;
mod laws;
mod limits;
mod particles;
mod placing;
mod shots;

use std::f64::consts::PI;

use carom_billiards::Error;
use carom_billiards::physics::{
    AimContact, BallBallLaw, BallBody, BallLayout, BallState, CLUSTER_ENERGY_J, Circle, Event,
    EventKind, Laws, Nose, Phase, REBOUND_ENERGY_J, Shot, Stroke, Table, TableParts, World,
    predict,
};
use glam::{DVec2, DVec3};
use proptest::prelude::*;

const RADIUS: f64 = 0.028_575;

/// A square of noses far from everything.
fn prairie() -> Table {
    let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]].map(DVec2::from);
    Table::from_parts(TableParts {
        name: "prairie".to_owned(),
        length_m: 100.0,
        width_m: 100.0,
        nose_height_m: 0.0365,
        noses: (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect(),
        jaws: Vec::new(),
        pockets: Vec::new(),
    })
    .expect("valid")
}

fn ball(number: u8, x: f64, y: f64, velocity: DVec3, spin: DVec3) -> BallState {
    BallState {
        velocity,
        spin,
        ..BallState::at_rest(number, x, y, &BallBody::default())
    }
}

fn resting(number: u8, x: f64, y: f64) -> BallState {
    ball(number, x, y, DVec3::ZERO, DVec3::ZERO)
}

fn released(table: Table, laws: Laws, balls: Vec<BallState>) -> Shot {
    World::with_laws(table, laws, balls)
        .expect("valid")
        .release()
        .expect("it comes to rest")
}

fn ideal() -> Laws {
    Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    }
}

fn eight_ball(seed: u32) -> World {
    let table = Table::nine_foot();
    let rack = table.rack_eight(seed);
    World::new(table, rack).expect("a rack is valid")
}

/// States right before and right after an event.
fn around(shot: &Shot, event: &Event) -> [Vec<BallState>; 2] {
    [
        shot.states_at(event.time_secs.next_down()),
        shot.states_at(event.time_secs),
    ]
}

fn first_ball_contact(shot: &Shot) -> &Event {
    let is_contact = |event: &&Event| matches!(event.kind, EventKind::BallBall { .. });
    shot.events()
        .iter()
        .find(is_contact)
        .expect("the balls meet")
}

/// Kinetic and potential energy of the balls in play, over a metre under the cloth.
fn energy_j(states: &[BallState]) -> f64 {
    let in_play = states.iter().filter(|ball| ball.phase.is_on_table());
    in_play
        .map(|ball| {
            let height = ball.position.z + 1.0;
            ball.body.kinetic_energy_j(ball.velocity, ball.spin) + ball.body.mass_kg * 9.81 * height
        })
        .sum()
}

fn momentum(states: &[BallState]) -> DVec3 {
    states.iter().map(|ball| ball.velocity).sum()
}

/// What the cluster and rebound rules may add in one event.
fn allowance_j(kind: &EventKind) -> f64 {
    match kind {
        EventKind::BallBall { .. } => CLUSTER_ENERGY_J,
        EventKind::Cushion { .. } | EventKind::Bounces { .. } => REBOUND_ENERGY_J,
        _ => 0.0,
    }
}

fn assert_energy_never_grows(shot: &Shot) {
    let mut last = f64::INFINITY;
    for together in shot.events().chunk_by(|a, b| a.time_secs == b.time_secs) {
        let [before, after] = around(shot, &together[0]).map(|states| energy_j(&states));
        if together[0].time_secs > 0.0 {
            let allowed: f64 = together.iter().map(|event| allowance_j(&event.kind)).sum();
            assert!(
                before <= last * (1.0 + 1e-12) + 1e-15,
                "{before} J after {last} J"
            );
            assert!(
                after <= before * (1.0 + 1e-12) + allowed + 1e-15,
                "{together:?}: {before} J to {after} J"
            );
        }
        last = after;
    }
}
