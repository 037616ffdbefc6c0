//! The report of a simulated shot, as a referee sees it.

use glam::{DVec2, DVec3};

use crate::deterministic_math::{cos, tan, unit_at};
use crate::physics::{BallState, EventKind, Nose, Shot, Stroke, Table, World};
use crate::rules::{BallPosition, BallPositions, ShotEvent, ShotReport, TableLayout};

/// The properties of a table that concern the rules.
pub fn table_layout(table: &Table) -> TableLayout {
    TableLayout {
        length_m: table.length_m(),
        width_m: table.width_m(),
        radius_m: table.ball().radius_m,
        cue_radius_m: table.cue_ball().radius_m,
        pockets: table.pockets().iter().map(|pocket| pocket.center).collect(),
    }
}

/// The balls that are on the table.
pub(crate) fn ball_positions(balls: &[BallState]) -> BallPositions {
    let on_table = balls.iter().filter(|ball| ball.phase.is_on_table());
    on_table
        .map(|ball| BallPosition {
            ball: ball.number,
            at: ball.position.truncate(),
        })
        .collect()
}

/// Report of a shot that `stroke` began on `world`, for the referee.
pub fn report(world: &World, stroke: &Stroke, shot: &Shot) -> ShotReport {
    let balls = world.balls();
    let before = ball_positions(&balls);
    let contact = first_contact(shot);
    let way = cue_ball_way(shot, contact.map_or(shot.duration_secs(), |(secs, _)| secs));
    ShotReport {
        events: shot_events(world.table(), &balls, shot),
        frozen: frozen(&balls),
        miscue: shot
            .events()
            .iter()
            .any(|event| matches!(event.kind, EventKind::Miscue { .. })),
        double_hit: contact.and_then(|contact| double_hit(world, stroke, shot, contact)),
        jumped: jumped(&balls, contact.map(|(_, ball)| ball), &way),
        reach_x_m: way.iter().map(|at| at.x).fold(f64::NEG_INFINITY, f64::max),
        after: ball_positions(&shot.final_states()),
        before,
    }
}

fn shot_events(table: &Table, balls: &[BallState], shot: &Shot) -> Vec<ShotEvent> {
    let seen = |(index, event): (usize, &crate::physics::Event)| match event.kind {
        EventKind::BallBall { first, second, .. } => Some(ShotEvent::Contact {
            one: first,
            other: second,
        }),
        EventKind::Cushion { ball, point, .. } => {
            is_driven(table, balls, shot, (index, ball, point))
                .then_some(ShotEvent::Cushion { ball })
        }
        EventKind::Pocketed { ball, pocket, .. } => Some(ShotEvent::Pocketed { ball, pocket }),
        EventKind::LeftTable { ball, .. } => Some(ShotEvent::LeftTable { ball }),
        _ => None,
    };
    shot.events().iter().enumerate().filter_map(seen).collect()
}

/// Whether a ball's contact with a cushion counts: it did not touch that cushion at the start, or has
/// left it since.
fn is_driven(
    table: &Table,
    balls: &[BallState],
    shot: &Shot,
    (index, ball, point): (usize, u8, DVec3),
) -> bool {
    let gap = |nose: &Nose, at: DVec2| nose.normal().dot(at - nose.from());
    let touched = table.noses().iter().min_by(|a, b| {
        gap(a, point.truncate())
            .abs()
            .total_cmp(&gap(b, point.truncate()).abs())
    });
    let Some((nose, place)) = touched.zip(balls.iter().position(|b| b.number == ball)) else {
        return true;
    };
    let radius_m = balls[place].body.radius_m;
    let is_away = |at: DVec3| gap(nose, at.truncate()) - radius_m > FROZEN_M;
    if is_away(balls[place].position) {
        return true;
    }
    let times: Vec<f64> = shot.events()[..=index]
        .iter()
        .map(|e| e.time_secs)
        .collect();
    // At the events a ball that leaves a cushion and returns may be in contact each time: it is away
    // only between them.
    let between = times.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
    let at = |t: f64| shot.states_at(t)[place].position;
    times.iter().copied().chain(between).any(|t| is_away(at(t)))
}

/// Balls that touch the cue ball.
fn frozen(balls: &[BallState]) -> Vec<u8> {
    let on_table = || balls.iter().filter(|ball| ball.phase.is_on_table());
    let Some(cue_ball) = on_table().find(|ball| ball.number == 0) else {
        return Vec::new();
    };
    let touches = |ball: &&BallState| ball.number != 0 && gap_m(cue_ball, ball) < FROZEN_M;
    on_table().filter(touches).map(|ball| ball.number).collect()
}

fn gap_m(one: &BallState, other: &BallState) -> f64 {
    one.position.distance(other.position) - one.body.radius_m - other.body.radius_m
}

/// Time in s of the cue ball's first contact with a ball, and that ball.
fn first_contact(shot: &Shot) -> Option<(f64, u8)> {
    shot.events().iter().find_map(|event| match event.kind {
        EventKind::BallBall { first, second, .. } if first == 0 || second == 0 => {
            Some((event.time_secs, first.max(second)))
        }
        _ => None,
    })
}

/// Samples of the cue ball's centre up to a time.
fn cue_ball_way(shot: &Shot, end_secs: f64) -> Vec<DVec3> {
    let at = |i: u32| {
        let states = shot.states_at(end_secs * f64::from(i) / f64::from(WAY_PIECES));
        let cue_ball = states.into_iter().find(|ball| ball.number == 0)?;
        Some(cue_ball.position)
    };
    (0..=WAY_PIECES).filter_map(at).collect()
}

/// A ball over which the cue ball passed on its path.
fn jumped(balls: &[BallState], hit: Option<u8>, way: &[DVec3]) -> Option<u8> {
    let cue_radius_m = balls.iter().find(|b| b.number == 0)?.body.radius_m;
    let others = balls
        .iter()
        .filter(|b| b.phase.is_on_table() && b.number != 0 && Some(b.number) != hit);
    others
        .filter(|ball| {
            let least = OVER_SHARE * (cue_radius_m + ball.body.radius_m);
            let over = |at: &&DVec3| at.truncate().distance(ball.position.truncate()) < least;
            way.iter().find(over).is_some()
        })
        .map(|ball| ball.number)
        .next()
}

/// The ball that is so near to the cue ball, and hit so full, that the tip following through meets the
/// cue ball again (WPA 6.7): the cue continues at the speed that the impact left it for the length of a
/// follow-through, and the cue ball after the contact is slower. A thin hit, after which the cue ball
/// keeps its speed, is none; nor is one with an elevated cue that the cloth stops first.
fn double_hit(
    world: &World,
    stroke: &Stroke,
    shot: &Shot,
    (contact_secs, ball): (f64, u8),
) -> Option<u8> {
    let balls = world.balls();
    let find = |balls: &[BallState], number: u8| balls.iter().find(|b| b.number == number).copied();
    let (cue_ball, object) = (find(&balls, 0)?, find(&balls, ball)?);
    let gap = gap_m(&cue_ball, &object);
    let height_m = cue_ball.body.radius_m * (1.0 + stroke.vertical);
    // An elevated cue reaches the cloth after the second distance.
    let reach_m = FOLLOW_M.min(height_m / tan(stroke.elevation_rad).max(1e-9));
    if !(FROZEN_M..reach_m).contains(&gap) {
        return None;
    }
    let forward = unit_at(stroke.direction_rad).extend(0.0);
    let struck = find(&shot.states_at(0.0), 0)?.velocity.length();
    let mass_share = cue_ball.body.mass_kg / world.laws().cue.mass_kg;
    // Conservation of momentum in the impact of cue and ball.
    let cue_m_s = stroke.speed_m_s - mass_share * struck;
    let after = find(&shot.states_at(contact_secs), 0)?
        .velocity
        .dot(forward);
    (after < cue_m_s * cos(stroke.elevation_rad)).then_some(ball)
}

/// Gap below which balls and cushions touch: a tenth of a millimetre.
const FROZEN_M: f64 = 1e-4;
/// Length of a follow-through in m: an inch, the width of a chalk, within which players are taught to
/// expect a double hit (Alciatore, "Illustrated Principles", 2004).
const FOLLOW_M: f64 = 0.025;
/// Samples of a path: enough for no ball to slip between.
const WAY_PIECES: u32 = 64;
/// A ball is jumped where the centres, seen from above, are nearer than this share of touching.
const OVER_SHARE: f64 = 0.9;
