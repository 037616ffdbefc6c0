//! A shot on a table with particles.

use carom_mpm::Ball;
use glam::DVec3;

use super::{ParticleBed, ParticleTrack};
use crate::Result;
use crate::physics::ball::Phase;
use crate::physics::ball_ball::Twist;
use crate::physics::ball_in_motion::BallInMotion;
use crate::physics::event_engine::{EventEngine, SimulatedShot};

/// Simulates to the end: between two steps of the particles from event to event as ever, at each of them with
/// the impulses that particles gave the balls since the last.
///
/// What lies on the cloth stays on it: particles push such a ball aside, turn it and slow it, but do not lift it.
///
/// # Errors
/// Those of the engine, and [`crate::Error::Particles`].
pub(crate) fn run(
    mut engine: EventEngine<'_>,
    bed: &mut ParticleBed,
) -> Result<(SimulatedShot, ParticleTrack)> {
    let mut track = ParticleTrack::new(bed);
    let (mut steps, mut still_steps) = (0u32, 0);
    loop {
        let is_still = !engine.balls.iter().any(BallInMotion::is_moving);
        still_steps = if is_still { still_steps + 1 } else { 0 };
        if is_still && (bed.is_asleep() || still_steps > SETTLE_STEPS_MAX) {
            break;
        }
        let met: Vec<usize> = (0..engine.balls.len())
            .filter(|ball| {
                let ball = &engine.balls[*ball];
                ball.is_in_play() && bed.may_touch(ball.position, ball.body.radius_m)
            })
            .collect();
        let is_disturbed = met.iter().any(|ball| engine.balls[*ball].is_moving());
        let pushed = match bed.is_asleep() && !is_disturbed {
            true => Vec::new(),
            false => {
                let bodies = met.iter().map(|ball| body(&engine, *ball)).collect();
                bed.step(STEP_SECS, bodies)?
            }
        };
        steps += 1;
        engine.run_until(f64::from(steps) * STEP_SECS)?;
        for (ball, pushed) in met.into_iter().zip(pushed) {
            push(&mut engine, ball, &pushed);
        }
        if steps.is_multiple_of(STEPS_A_FRAME) {
            track.push(&bed.centers());
            bed.find_bounds();
        }
    }
    bed.put_in_order()?;
    Ok((engine.finish(), track))
}

/// A ball as particles meet it.
fn body(engine: &EventEngine<'_>, ball: usize) -> Ball {
    let BallInMotion {
        body,
        position,
        motion,
        ..
    } = &engine.balls[ball];
    let twist = engine.balls[ball].twist(engine.now);
    let mut met = Ball::new(*position, body.radius_m, body.mass_kg);
    met.velocity = twist.velocity;
    met.angular_velocity = twist.spin;
    met.acceleration = motion.acceleration;
    met
}

/// Changes a ball's motion by the impulses of a step.
fn push(engine: &mut EventEngine<'_>, ball: usize, pushed: &Ball) {
    let BallInMotion { body, motion, .. } = &engine.balls[ball];
    if !engine.balls[ball].is_in_play() {
        return;
    }
    let is_flying = motion.phase == Phase::Airborne;
    let change = match is_flying {
        true => pushed.impulse / body.mass_kg,
        false => (pushed.impulse / body.mass_kg).with_z(0.0),
    };
    let turn = pushed.angular_impulse / pushed.moment_of_inertia();
    // What rests is held by the cloth as long as it need not slide, or it would creep as long as grains do.
    let cloth = &engine.laws.cloth;
    let withstood = cloth.sliding_friction * cloth.gravity_m_s2 * STEP_SECS;
    let is_small = change.length() <= withstood && turn.length() * body.radius_m <= withstood;
    if is_small && motion.phase == Phase::Resting || change == DVec3::ZERO && turn == DVec3::ZERO {
        return;
    }
    let twist = engine.balls[ball].twist(engine.now);
    let twist = Twist {
        velocity: twist.velocity + change,
        spin: twist.spin + turn,
    };
    if is_flying {
        engine.fly(ball, twist);
    } else {
        engine.lie(ball, twist);
    }
}

/// A ball of 5 m/s moves a centimetre in it.
const STEP_SECS: f64 = 1.0 / 480.0;
/// [`ParticleTrack::FRAMES_PER_SEC`].
const STEPS_A_FRAME: u32 = 8;
/// When balls rest, particles are watched for so long: what sloshes on does so in the next shot.
const SETTLE_STEPS_MAX: u32 = 240;
