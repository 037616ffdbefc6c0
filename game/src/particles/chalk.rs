//! Chalk dust that a stroke knocks off the cue's tip.
//!
//! It is a function of shot and time alone, so that a game, its replay and its film show the same. The
//! contact point of the tip follows from the ball's motion after the stroke: an impulse at `r` from the
//! centre that gives the velocity `v` gives the spin `ω` with `I ω = m r × v`.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use carom_billiards::physics::{BallState, EventKind, Shot};
use carom_mpm::{Ball, Bodies, Dust, Grain, Obstacle};
use carom_tracer::glam::{DVec3, Vec3};
use carom_tracer::sampling::uniforms;
use carom_tracer::{Material, ParticleCloud, ParticleForm};

use super::ParticleDetail;

/// The dust of a shot, simulated on demand.
#[derive(Debug)]
pub struct ChalkPuff {
    shot: Shot,
    blow: Option<Blow>,
    /// States of the last simulated steps, in consecutive order.
    states: Mutex<VecDeque<PuffState>>,
}

/// Impact of the tip on the cue ball.
#[derive(Clone, Copy, Debug)]
struct Blow {
    /// Contact point of tip and ball, in m.
    contact: Vec3,
    /// Unit vector from the ball along the cue to its butt.
    back: Vec3,
    /// Speed of the cue, in m/s.
    speed_m_s: f32,
    /// Share of the chalk that comes off, up to 1.
    share: f32,
}

/// All specks after a number of steps.
#[derive(Clone, Debug)]
struct PuffState {
    step: u32,
    /// Dust of each of [`KINDS`].
    dusts: Vec<Dust>,
    /// Step at which each speck settled, by kind; `u32::MAX` for those in the air.
    settled: Vec<Vec<u32>>,
}

/// Specks of one size. Each drawn speck stands for a cluster of many grains.
struct SpeckKind {
    /// Diameter of a grain, for its motion.
    diameter_m: f32,
    /// Radius of a drawn speck.
    radius_m: f32,
    /// Largest number of specks, at [`ParticleDetail::All`].
    specks: usize,
    /// Distance that the displaced air carries specks, in m.
    spread_m: f32,
}

impl ChalkPuff {
    /// The dust of a shot; none for a shot without a stroke.
    pub fn new(shot: &Shot) -> Self {
        Self {
            blow: blow(shot),
            shot: shot.clone(),
            states: Mutex::default(),
        }
    }

    /// The dust at a time in s since the stroke; nothing before it and after all has sunk into the cloth.
    pub fn clouds(&self, secs: f64, detail: ParticleDetail) -> Vec<ParticleCloud> {
        let stride = detail.stride();
        let Some(blow) = self.blow.filter(|_| (0.0..LAST_SECS).contains(&secs)) else {
            return Vec::new();
        };
        if stride == 0 {
            return Vec::new();
        }
        let step = (secs / STEP_SECS) as u32;
        let rest_secs = (secs - f64::from(step) * STEP_SECS) as f32;
        let mut states = self.states.lock().unwrap_or_else(PoisonError::into_inner);
        let state = self.state(&mut states, blow, step);
        let kinds = KINDS.iter().zip(state.dusts.iter().zip(&state.settled));
        let clouds = kinds.map(|(kind, (dust, settled))| {
            let mut cloud = empty_cloud(kind, blow.contact);
            let specks = dust.specks().iter().zip(settled).step_by(stride);
            let places = specks.map(|(speck, settled)| {
                let sunk_secs = step.saturating_sub(*settled) as f32 * STEP_SECS as f32 + rest_secs;
                let center = if speck.is_settled {
                    // A settled speck sinks into the nap until it is hidden, and stays there.
                    let height_m = kind.radius_m - SINK_M_S * sunk_secs;
                    speck.position + Vec3::Z * height_m.max(-kind.radius_m)
                } else {
                    speck.position + rest_secs * speck.velocity
                };
                cloud.place(center)
            });
            cloud.places = places.collect();
            cloud
        });
        clouds.filter(|cloud| !cloud.places.is_empty()).collect()
    }

    /// The specks after `step` steps. A step earlier than those kept restarts the simulation.
    fn state<'a>(
        &self,
        states: &'a mut VecDeque<PuffState>,
        blow: Blow,
        step: u32,
    ) -> &'a PuffState {
        if states.front().is_none_or(|first| first.step > step) {
            states.clear();
            states.push_back(PuffState::new(blow));
        }
        let last = states.back().map_or(0, |last| last.step);
        // Every step is simulated, whatever moments are requested: no picture depends on earlier requests.
        for next in last + 1..=step {
            if let Some(mut state) = states.back().cloned() {
                state.advance(next, &self.bodies(f64::from(next) * STEP_SECS));
                states.push_back(state);
            }
            if states.len() > STATES_KEPT {
                states.pop_front();
            }
        }
        let first = states[0].step;
        &states[(step - first) as usize]
    }

    /// The balls on the table and the cloth.
    fn bodies(&self, secs: f64) -> Bodies {
        let states = self.shot.states_at(secs);
        let on_table = states.iter().filter(|ball| ball.phase.is_on_table());
        let balls = on_table.map(|state| {
            let mut ball = Ball::new(state.position, state.body.radius_m, state.body.mass_kg);
            ball.velocity = state.velocity;
            ball.angular_velocity = state.spin;
            ball
        });
        Bodies {
            balls: balls.collect(),
            obstacles: vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)],
        }
    }
}

impl PuffState {
    fn new(blow: Blow) -> Self {
        let dusts = KINDS
            .iter()
            .zip(0..)
            .map(|(kind, number)| puff(blow, kind, number));
        let dusts: Vec<_> = dusts.collect();
        let settled = dusts.iter().map(|dust| vec![u32::MAX; dust.specks().len()]);
        Self {
            step: 0,
            settled: settled.collect(),
            dusts,
        }
    }

    fn advance(&mut self, step: u32, bodies: &Bodies) {
        self.step = step;
        for (dust, settled) in self.dusts.iter_mut().zip(&mut self.settled) {
            // Balls are copies: a grain takes a millionth of a ball's momentum, which is neglected.
            if dust.step(STEP_SECS, &mut bodies.clone()).is_err() {
                dust.retain(|_| false);
                settled.clear();
            }
            for (speck, settled) in dust.specks().iter().zip(settled) {
                *settled = match speck.is_settled {
                    true => (*settled).min(step),
                    false => u32::MAX,
                };
            }
        }
    }
}

/// The chalk of one kind as it leaves the tip: radially from the cue, and slightly backwards and upwards.
fn puff(blow: Blow, kind: &SpeckKind, number: u32) -> Dust {
    let grain = Grain {
        diameter_m: kind.diameter_m,
        ..Grain::default()
    };
    let mut dust = Dust::new(grain, Vec3::NEG_Z * 9.81).expect("diameters in range");
    let count = (blow.share * kind.specks as f32).ceil() as u32;
    let aside = blow.back.any_orthonormal_vector();
    let across = blow.back.cross(aside);
    let seed = blow.contact.x.to_bits() ^ blow.contact.y.to_bits().rotate_left(16);
    for speck in 0..count {
        let [turn, out, fast, backward] = uniforms(speck, number, seed, 0);
        let [carried, lifted, drawn, _] = uniforms(speck, number, seed, 1);
        // The root of `out` makes specks uniform over the tip's area, the square of `fast` most of them slow.
        let (sin, cos) = (std::f32::consts::TAU * turn).sin_cos();
        let radial = aside * cos + across * sin;
        let from = blow.contact
            + radial * (TIP_RADIUS_M * out.sqrt() + kind.spread_m * carried)
            + blow.back * (0.5e-3 + kind.spread_m * drawn)
            + Vec3::Z * (0.7 * kind.spread_m * lifted);
        let velocity = radial * (0.04 + 0.2 * fast * fast) + blow.back * (0.1 * backward);
        let velocity = velocity * blow.speed_m_s + Vec3::Z * (0.04 * blow.speed_m_s * lifted);
        let from = from.with_z(from.z.max(1e-3));
        dust.add(from, velocity).expect("a finite blow");
    }
    dust
}

fn empty_cloud(kind: &SpeckKind, contact: Vec3) -> ParticleCloud {
    ParticleCloud {
        material: Material::diffuse(CHALK),
        radius_m: kind.radius_m,
        form: ParticleForm::Balls,
        min: (contact - REACH_M).with_z(-2e-3),
        max: (contact + REACH_M).with_z(REACH_M),
        places: Vec::new(),
    }
}

fn blow(shot: &Shot) -> Option<Blow> {
    let speed_m_s = shot.events().iter().find_map(|event| match event.kind {
        EventKind::Strike { speed_m_s } => Some(speed_m_s as f32),
        _ => None,
    })?;
    let slipped = |kind: EventKind| matches!(kind, EventKind::Miscue { .. });
    let slipped = shot.events().iter().any(|event| slipped(event.kind));
    let states = shot.states_at(0.0);
    let cue_ball = states.iter().find(|ball| ball.number == 0)?;
    let along = cue_ball.velocity.try_normalize()?;
    let offset = tip_offset_m(cue_ball);
    let radius_m = cue_ball.body.radius_m;
    let depth_m = (radius_m * radius_m - offset.length_squared())
        .max(0.0)
        .sqrt();
    let share = if slipped {
        1.0
    } else {
        (speed_m_s / SPEED_OF_ALL_M_S).clamp(SHARE_MIN, 1.0)
    };
    Some(Blow {
        contact: (cue_ball.position + offset - along * depth_m).as_vec3(),
        back: -along.as_vec3(),
        speed_m_s,
        share,
    })
}

/// From the ball's centre to the line of the impulse, in m: `r = 2/5 R² (v × ω) / v²`, from `I ω = m r × v`
/// with r perpendicular to v and I = 2/5 m R².
fn tip_offset_m(ball: &BallState) -> DVec3 {
    let radius_m = ball.body.radius_m;
    let square = ball.velocity.length_squared();
    let offset = 0.4 * radius_m * radius_m * ball.velocity.cross(ball.spin) / square;
    offset.clamp_length_max(0.9 * radius_m)
}

/// Number of clouds of a puff.
#[cfg(test)]
pub(super) const CLOUDS: usize = KINDS.len();
/// Kinds from coarse specks, which fly farthest, to fine ones, which stay in the air.
const KINDS: [SpeckKind; 4] = [
    SpeckKind {
        diameter_m: 80e-6,
        radius_m: 0.34e-3,
        specks: 240,
        spread_m: 2e-3,
    },
    SpeckKind {
        diameter_m: 55e-6,
        radius_m: 0.27e-3,
        specks: 360,
        spread_m: 5e-3,
    },
    SpeckKind {
        diameter_m: 32e-6,
        radius_m: 0.22e-3,
        specks: 480,
        spread_m: 9e-3,
    },
    SpeckKind {
        diameter_m: 16e-6,
        radius_m: 0.18e-3,
        specks: 520,
        spread_m: 14e-3,
    },
];
/// Albedo of blue chalk as dust.
const CHALK: Vec3 = Vec3::new(0.42, 0.6, 0.8);
/// Radius of the tip's contact area.
const TIP_RADIUS_M: f32 = 4e-3;
/// Speed of the cue from which on all chalk comes off, and the least share for a soft stroke.
const SPEED_OF_ALL_M_S: f32 = 6.0;
const SHARE_MIN: f32 = 0.1;
/// Time since the stroke after which all dust has sunk into the cloth.
const LAST_SECS: f64 = 3.0;
/// Step of the dust's motion, which is exact for any step but for contacts with balls.
const STEP_SECS: f64 = 1.0 / 120.0;
/// Number of states kept, a third of a second: frames of the present and of the future are requested
/// alternately.
const STATES_KEPT: usize = 40;
/// Speed at which a settled speck sinks into the nap.
const SINK_M_S: f32 = 0.5e-3;
/// Half extent of the box around the contact; dust that flies farther is drawn at its boundary.
const REACH_M: f32 = 0.35;

#[cfg(test)]
mod tests {
    use carom_billiards::physics::{Stroke, Table, World};

    use super::*;

    fn shot(stroke: Stroke) -> Shot {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        world.strike(stroke).unwrap()
    }

    fn count(clouds: &[ParticleCloud]) -> usize {
        clouds.iter().map(|cloud| cloud.places.len()).sum()
    }

    #[test]
    fn a_puff_is_the_same_however_it_is_looked_at() {
        let shot = shot(Stroke::straight(0.1, 6.0));
        let (one, other) = (ChalkPuff::new(&shot), ChalkPuff::new(&shot));
        let at = |puff: &ChalkPuff, secs| puff.clouds(secs, ParticleDetail::All);
        let times = [0.0, 0.013, 0.4, 0.1, 1.7, 0.05, 2.9];
        let clouds: Vec<_> = times.iter().map(|secs| at(&one, *secs)).collect();
        for (secs, clouds) in times.iter().zip(&clouds).rev() {
            assert_eq!(at(&other, *secs), *clouds, "{secs} s");
        }
        assert_ne!(clouds[0], clouds[1]);
    }

    #[test]
    fn there_is_none_before_the_stroke_and_none_in_the_end() {
        let puff = ChalkPuff::new(&shot(Stroke::straight(0.1, 6.0)));
        let counts =
            [-0.1, 0.0, 2.9, 3.1].map(|secs| count(&puff.clouds(secs, ParticleDetail::All)));
        assert_eq!(counts, [0, 1600, 1600, 0]);
        assert_eq!(count(&puff.clouds(0.1, ParticleDetail::Some)), 400);
        assert_eq!(count(&puff.clouds(0.1, ParticleDetail::Off)), 0);
        let soft = ChalkPuff::new(&shot(Stroke::straight(0.1, 0.5)));
        assert_eq!(count(&soft.clouds(0.1, ParticleDetail::All)), 160);
    }

    #[test]
    fn it_comes_from_where_the_tip_met_the_ball() {
        let stroke = Stroke {
            side: 0.3,
            vertical: 0.25,
            ..Stroke::straight(0.0, 4.0)
        };
        let shot = shot(stroke);
        let ball = shot
            .states_at(0.0)
            .into_iter()
            .find(|ball| ball.number == 0)
            .unwrap();
        let blow = ChalkPuff::new(&shot).blow.unwrap();
        let off = (blow.contact.as_dvec3() - ball.position) / ball.body.radius_m;
        // Right of a cue along x is −y; squirt turns the ball's way by a degree.
        assert!(
            (off - DVec3::new(-0.92, -0.3, 0.25)).length() < 0.04,
            "{off}"
        );
        assert!((off.length() - 1.0).abs() < 1e-3, "{off}");
    }

    #[test]
    fn specks_fly_aside_and_sink_into_the_cloth() {
        let puff = ChalkPuff::new(&shot(Stroke::straight(0.0, 6.0)));
        let lowest = |secs| {
            let clouds = puff.clouds(secs, ParticleDetail::All);
            let tops = clouds.iter().map(|cloud| {
                let heights = cloud
                    .places
                    .iter()
                    .map(|place| cloud.center(*place).z + cloud.radius_m);
                heights.fold(f32::MIN, f32::max)
            });
            tops.fold(f32::MIN, f32::max)
        };
        assert!(lowest(0.1) > 0.03);
        assert!(lowest(2.99) < 5e-3, "{}", lowest(2.99));
    }
}
