//! Aim line: a stroke simulated up to its first contact, by the code that plays it.

use glam::DVec3;

use crate::Result;

use super::{
    cue_impact::Stroke,
    event::{Event, EventKind},
    event_engine::Until,
    shot::Shot,
    world::World,
};

/// Path of the cue ball to its first contact.
#[derive(Clone, Debug, PartialEq)]
pub struct AimLine {
    /// Centres of the cue ball, from the stroke to the contact, to the edge of particles or to rest, in m: curved by
    /// spin and squirt as the shot itself will be.
    pub path: Vec<DVec3>,
    /// First contact of the cue ball.
    pub contact: AimContact,
}

/// First contact of the cue ball. A direction is a unit vector, or zero for a ball that stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AimContact {
    /// Nothing: it comes to rest.
    Nothing,
    /// Another ball.
    Ball {
        /// Its number.
        number: u8,
        /// Centre of the cue ball at the contact, in m.
        ghost: DVec3,
        /// Centre of the other ball, in m.
        object: DVec3,
        /// Direction of the other ball after the contact, with throw.
        object_direction: DVec3,
        /// Direction of the cue ball after the contact.
        cue_direction: DVec3,
    },
    /// A cushion or a jaw.
    Cushion {
        /// Centre of the cue ball at the contact, in m.
        ghost: DVec3,
        /// Direction of the cue ball after the contact.
        cue_direction: DVec3,
    },
    /// A pocket: a scratch.
    Pocket {
        /// Index into the table's pockets.
        pocket: usize,
    },
    /// Particles: the path among them takes seconds to simulate, and is not predicted.
    Particles,
}

/// Simulates a stroke up to the cue ball's first contact, with particles too.
///
/// # Errors
/// Those of [`World::strike`].
pub fn predict(world: &World, stroke: Stroke) -> Result<AimLine> {
    let shot = Shot::new(world.simulate(stroke, Until::CueBallContact)?);
    let cue_ball = shot.poses_at(0.0).iter().position(|ball| ball.number == 0);
    let known_secs = world
        .particles()
        .zip(cue_ball)
        .map_or(f64::INFINITY, |(bed, cue_ball)| {
            shot.known_until_secs(bed)[cue_ball]
        });
    let end = shot.duration_secs().min(known_secs);
    let cue_ball_at = |t: f64| shot.states_at(t).into_iter().find(|ball| ball.number == 0);
    let path = (0..=PATH_PIECES)
        .filter_map(|i| cue_ball_at(end * (f64::from(i) / f64::from(PATH_PIECES))))
        .map(|ball| ball.position)
        .collect();
    Ok(AimLine {
        path,
        contact: match known_secs.is_finite() {
            true => AimContact::Particles,
            false => first_contact(&shot),
        },
    })
}

fn first_contact(shot: &Shot) -> AimContact {
    let stops = |event: &&Event| event.kind.stops_aim_line();
    let Some(&Event { kind, time_secs }) = shot.events().iter().find(stops) else {
        return AimContact::Nothing;
    };
    let states = shot.states_at(time_secs);
    let ball = |number: u8| states.iter().find(|ball| ball.number == number).copied();
    let Some(cue_ball) = ball(0) else {
        return AimContact::Nothing;
    };
    let ghost = cue_ball.position;
    let cue_direction = cue_ball.velocity.normalize_or_zero();
    match kind {
        EventKind::BallBall { first, second, .. } if first == 0 || second == 0 => {
            let number = first.max(second);
            ball(number).map_or(AimContact::Nothing, |object| AimContact::Ball {
                number,
                ghost,
                object: object.position,
                object_direction: object.velocity.normalize_or_zero(),
                cue_direction,
            })
        }
        EventKind::Cushion { ball: 0, .. } => AimContact::Cushion {
            ghost,
            cue_direction,
        },
        EventKind::Pocketed {
            ball: 0, pocket, ..
        } => AimContact::Pocket { pocket },
        _ => AimContact::Nothing,
    }
}

/// Pieces of the path: enough for a massé's curve to look smooth.
const PATH_PIECES: u32 = 48;
