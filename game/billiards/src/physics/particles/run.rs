//! A shot on a table with particles.

use carom_mpm::Ball;
use glam::DVec3;

use super::{ParticleBed, ParticleTrack};
use crate::Result;
use crate::physics::ball::Phase;
use crate::physics::ball_ball::Twist;
use crate::physics::ball_in_motion::BallInMotion;
use crate::physics::event_engine::{EventEngine, SimulatedShot};

/// Simulates to the end. Over each step of the particles the balls move from event to event; half of
/// the impulses from the particles over the step act at its beginning and half at its end (Verlet 1967;
/// a ball on jelly gains no energy).
///
/// Particles that press a ball up by more than its weight lift it. A ball that comes to rest on them,
/// or afloat, hovers: it counts as airborne and does not move until something pushes it.
///
/// # Errors
/// Those of the engine, and [`crate::Error::Particles`].
pub(crate) fn run(
    mut engine: EventEngine<'_>,
    bed: &mut ParticleBed,
) -> Result<(SimulatedShot, ParticleTrack)> {
    let mut track = ParticleTrack::new(bed);
    engine.quiet_m_s = QUIET_M_S;
    for ball in 0..engine.balls.len() {
        if is_carried(&engine.balls[ball], bed) {
            engine.hover(ball);
        }
    }
    let settle_steps_max = match bed.has_marbles() {
        true => ROLL_STEPS_MAX,
        false => SETTLE_STEPS_MAX,
    };
    let mut calm_steps = vec![0u32; engine.balls.len()];
    let (mut steps, mut still_steps) = (0u32, 0);
    loop {
        let is_still = !engine.balls.iter().any(BallInMotion::is_moving);
        still_steps = if is_still { still_steps + 1 } else { 0 };
        if is_still && (bed.is_asleep() || still_steps > settle_steps_max) {
            break;
        }
        let met: Vec<usize> = (0..engine.balls.len())
            .filter(|ball| {
                let ball = &engine.balls[*ball];
                ball.is_in_play() && bed.may_touch(ball.position, ball.body.radius_m)
            })
            .collect();
        let is_disturbed = met.iter().any(|ball| engine.balls[*ball].is_moving());
        // Sleeping particles take no steps: for most of a shot no particle moves.
        let kicks: Vec<(usize, Kick)> = match bed.is_asleep() && !is_disturbed {
            true => Vec::new(),
            false => {
                let bodies = met.iter().map(|ball| body(&engine, *ball)).collect();
                let pushed = bed.step(STEP_SECS, bodies)?;
                let kicks = met.iter().zip(&pushed);
                let kicks =
                    kicks.map(|(ball, pushed)| Some((*ball, Kick::of(&engine, *ball, pushed)?)));
                kicks.flatten().collect()
            }
        };
        for (ball, kick) in &kicks {
            // Half before and half after the step (velocity Verlet): whole impulses at its beginning
            // would feed energy into balls that bob on something elastic.
            kick.begin(&mut engine, *ball);
        }
        steps += 1;
        engine.run_until(f64::from(steps) * STEP_SECS)?;
        for (ball, kick) in &kicks {
            kick.end(&mut engine, *ball);
        }
        for ball in met {
            let is_calm = is_calm(&engine, ball, f64::from(steps) * STEP_SECS);
            calm_steps[ball] = if is_calm { calm_steps[ball] + 1 } else { 0 };
            if calm_steps[ball] > CALM_STEPS {
                engine.hover(ball);
            }
        }
        if steps.is_multiple_of(STEPS_A_FRAME) {
            track.push(&bed.centers());
            bed.find_bounds();
        }
    }
    bed.put_in_order()?;
    Ok((engine.finish(), track))
}

/// Whether particles carry a ball that is at rest above the cloth.
fn is_carried(ball: &BallInMotion, bed: &ParticleBed) -> bool {
    let Twist { velocity, spin } = ball.twist(0.0);
    let is_at_rest = velocity == DVec3::ZERO && spin == DVec3::ZERO;
    let is_in_air = ball.on_table && ball.motion.phase == Phase::Airborne;
    is_in_air && is_at_rest && bed.carries(ball.position, ball.body.radius_m)
}

/// Whether a ball that particles carry is nearly at rest. The threshold grows with time, so that every
/// shot ends.
fn is_calm(engine: &EventEngine<'_>, ball: usize, now_secs: f64) -> bool {
    let BallInMotion { body, motion, .. } = &engine.balls[ball];
    let Twist { velocity, spin } = engine.balls[ball].twist(engine.now);
    let is_flying = motion.phase == Phase::Airborne && engine.balls[ball].is_moving();
    let speed = velocity.length().max(spin.length() * body.radius_m);
    is_flying && engine.balls[ball].is_in_play() && speed < CALM_M_S * (1.0 + now_secs)
}

/// A ball as a boundary of the particles' simulation.
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
    let fall = -engine.laws.cloth.gravity_m_s2;
    met.acceleration = motion.acceleration.with_z(fall);
    if position.z >= body.radius_m {
        met.floor_m = body.radius_m;
    }
    met
}

/// Changes of a ball's velocity and spin by particles over a step.
#[derive(Clone, Copy, Debug)]
struct Kick {
    change: DVec3,
    turn: DVec3,
    lifts: bool,
}

impl Kick {
    /// The changes; none where a ball at rest withstands them.
    fn of(engine: &EventEngine<'_>, ball: usize, pushed: &Ball) -> Option<Self> {
        let BallInMotion { body, motion, .. } = &engine.balls[ball];
        let cloth = &engine.laws.cloth;
        let fall = cloth.gravity_m_s2 * STEP_SECS;
        let mut change = pushed.impulse / body.mass_kg;
        let turn = pushed.angular_impulse / pushed.moment_of_inertia();
        let is_flying = motion.phase == Phase::Airborne;
        // The slate bore the ball for a part of the step: lifted, it has the particles' final upward
        // speed, plus what gravity takes off again over the step.
        let lifts = !is_flying && pushed.velocity.z > LIFT_LEAST_M_S;
        match (is_flying, lifts) {
            (true, _) => {}
            (false, true) => change.z = pushed.velocity.z + fall,
            (false, false) => change.z = 0.0,
        }
        // Static friction holds a ball at rest below the force at which it slides: otherwise it would
        // creep as long as grains do.
        let is_held = motion.phase == Phase::Resting && !lifts;
        let is_hovering = is_flying && !engine.balls[ball].is_moving();
        let (felt, withstood) = match is_hovering {
            true => (change - fall * DVec3::Z, HOVER_SHARE * fall),
            false => (change, cloth.sliding_friction * fall),
        };
        let is_small = felt.length() <= withstood && turn.length() * body.radius_m <= withstood;
        let is_nothing = change == DVec3::ZERO && turn == DVec3::ZERO && !is_hovering;
        let is_felt = !(is_nothing || is_small && (is_held || is_hovering));
        is_felt.then_some(Self {
            change,
            turn,
            lifts,
        })
    }

    fn begin(&self, engine: &mut EventEngine<'_>, ball: usize) {
        let is_flying = engine.balls[ball].motion.phase == Phase::Airborne;
        self.apply_half(engine, ball, is_flying || self.lifts);
    }

    fn end(&self, engine: &mut EventEngine<'_>, ball: usize) {
        let is_flying = engine.balls[ball].motion.phase == Phase::Airborne;
        self.apply_half(engine, ball, is_flying);
    }

    fn apply_half(&self, engine: &mut EventEngine<'_>, ball: usize, flies: bool) {
        if !engine.balls[ball].is_in_play() {
            return;
        }
        let twist = engine.balls[ball].twist(engine.now);
        let twist = Twist {
            velocity: twist.velocity + 0.5 * self.change,
            spin: twist.spin + 0.5 * self.turn,
        };
        if flies {
            engine.fly(ball, twist);
        } else {
            engine.lie(ball, twist);
        }
    }
}

/// Step of the particles: a ball of 5 m/s moves a centimetre in it.
const STEP_SECS: f64 = 1.0 / 480.0;
/// Steps per frame of the track, of [`ParticleTrack::FRAMES_PER_SEC`].
const STEPS_A_FRAME: u32 = 8;
/// Steps for which particles are simulated once the balls are at rest: motion that remains continues in
/// the next shot.
const SETTLE_STEPS_MAX: u32 = 240;
/// The same with marbles, which roll for longer.
const ROLL_STEPS_MAX: u32 = 2400;
/// Upward speed after a step above which particles lift a ball off the cloth: a force of 1.1 times its
/// weight.
const LIFT_LEAST_M_S: f64 = 2e-3;
/// Landings below this speed in m/s are not reported: they are inaudible, and a ball carried by grains
/// has many.
const QUIET_M_S: f64 = 0.1;
/// Speed below which, for [`CALM_STEPS`] steps, a ball that particles carry comes to rest: a quarter of
/// a second, about as long as it bobs to and fro.
const CALM_M_S: f64 = 0.005;
const CALM_STEPS: u32 = 120;
/// Share of its weight by which the force of particles on a ball at rest on them may differ from the
/// weight without effect, as creeping grains would keep it awake.
const HOVER_SHARE: f64 = 0.5;

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use carom_mpm::{Material, Obstacle, Settings, Simulation, Water};
    use glam::Vec3;

    use super::*;
    use crate::physics::{BallBody, BallState, Laws, Table};

    #[test]
    fn light_balls_float_at_the_depth_of_archimedes() {
        for height in [0.3, -0.3] {
            let (draught, wanted) = draught_afloat(height);
            let error = draught / wanted - 1.0;
            assert!(
                error.abs() < 0.05,
                "from {height}: {draught} radii, not {wanted}"
            );
        }
    }

    /// Final and expected draught in radii of a ball of half the density of water, released with its
    /// centre at `height` radii above the level.
    fn draught_afloat(height: f64) -> (f64, f64) {
        let table = Table::nine_foot();
        let laws = Laws::of(&table);
        let radius_m = BallBody::POOL.radius_m;
        let cell = 0.006;
        let [side, depth] = [16.0, 12.0].map(|cells| cells * cell);
        let ball_m3 = 4.0 / 3.0 * PI * radius_m.powi(3);
        let density_kg_m3 = 500.0;
        let settings = Settings {
            cell_size_m: cell as f32,
            rest_speed_m_s: 0.02,
            ..Settings::default()
        };
        let mut simulation = Simulation::new(settings).unwrap();
        let max = DVec3::new(side, side, depth);
        let water = Material::Water(Water {
            viscosity_pa_s: 1.0,
            sound_speed_m_s: 8.0,
            ..Water::default()
        });
        let center = DVec3::new(side / 2.0, side / 2.0, depth + height * radius_m);
        let spacing = cell / 2.0;
        let place = |i: u32| {
            let at = [i % 32, i / 32 % 32, i / 1024].map(f64::from);
            (DVec3::from(at) + 0.5) * spacing
        };
        let places = (0..32 * 32 * 24).map(place);
        let places = places.filter(|place| place.distance(center) > radius_m);
        let places: Vec<Vec3> = places.map(|place| place.as_vec3()).collect();
        let volume_m3 = spacing.powi(3);
        let added = simulation.add(&places, water, volume_m3 as f32, Vec3::ZERO);
        added.unwrap();
        let walls = Obstacle::walls(DVec3::ZERO, max.with_z(1.0));
        let mut bed = ParticleBed::of_water(&table, simulation, walls);
        let body = BallBody {
            mass_kg: density_kg_m3 * ball_m3,
            radius_m,
        };
        let ball = BallState {
            position: center,
            phase: Phase::Airborne,
            ..BallState::at_rest(0, 0.0, 0.0, &body)
        };
        let engine = EventEngine::new(&table, &laws, &[ball]);
        let (shot, _) = run(engine, &mut bed).unwrap();
        let end = shot.trajectories[0].state_at(shot.end_secs);
        assert_eq!((end.phase, end.velocity), (Phase::Airborne, DVec3::ZERO));
        assert!(shot.end_secs < 8.0, "{} s", shot.end_secs);
        // Archimedes: the immersed cap has the share of the ball's volume that its density has of
        // water's.
        let share = density_kg_m3 / 1000.0;
        let cap = |h: f64| h * h * (3.0 - h) / 4.0;
        let wanted = (0..2000)
            .map(|i| f64::from(i) * 1e-3)
            .find(|h| cap(*h) >= share);
        // Level of the water far from the ball: twice the height of the centroid.
        let apart = |at: DVec3| at.truncate().distance(end.position.truncate());
        let centers = bed.centers().into_iter().map(|at| at.as_dvec3());
        let far: Vec<f64> = centers
            .filter(|at| apart(*at) > 1.5 * radius_m)
            .map(|at| at.z)
            .collect();
        let level = 2.0 * far.iter().sum::<f64>() / far.len() as f64;
        let draught = (level - end.position.z + radius_m) / radius_m;
        (draught, wanted.unwrap())
    }
}
