//! Accuracy against cost: the event-driven laws, and plain rapier at many settings.

use std::f64::consts::PI;
use std::fmt;

use anyhow::Context as _;
use cpu_time::ThreadTime;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::chart::{Axis, Chart, Mark, Series};

use super::{
    deviation::Deviation,
    infinite_table::{ball, first_secs, infinite_table},
    reference::{ReferenceKind, ReferenceShot},
};
use crate::timing::{median, ms_since};
use carom_billiards::Result;
use carom_billiards::physics::{
    BallBallLaw, BallBody, Engine, EventKind, Laws, Rapier, Shot, Stroke, Table, World,
};

/// Errors and costs of one setting.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EngineTradeoff {
    /// Engine as in `--physics`, with the settings that are not the usual.
    pub engine: String,
    /// Largest error of the object ball's direction over [`PHASES`] starts of a 30° cut at 3 m/s.
    pub cut_error_deg: f64,
    /// Median of the largest distances over the reference shots, in mm.
    pub median_max_mm: f64,
    /// Share of the cue ball's kinetic energy that is left 50 ms after the first contact of an
    /// eight-ball break.
    pub energy_kept: f64,
    /// CPU time of a whole eight-ball break: the maximum of [`BREAKS`] racks.
    pub break_ms: f64,
    /// CPU time of a break per simulated second, the maximum of the racks.
    pub ms_per_second: f64,
    /// CPU time of the most expensive 10 ms of it.
    pub worst_frame_ms: f64,
}

impl fmt::Display for EngineTradeoff {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:28} {:>9.1e} {:>10.3} {:>9.0} % {:>9.1} {:>10.2} {:>10.3}",
            self.engine,
            self.cut_error_deg,
            self.median_max_mm,
            100.0 * self.energy_kept,
            self.break_ms,
            self.ms_per_second,
            self.worst_frame_ms
        )
    }
}

/// The heading of a table of [`EngineTradeoff`]s.
pub const HEADING: &str = "engine                       cut error  mm off     energy    CPU ms,  \
                           CPU ms a   dearest\n                                   deg   \
                           (median)      kept  a break     second  10 ms, ms";

/// The settings that are compared.
pub fn engines() -> Vec<Engine> {
    let plain = |steps_per_sec, turn: fn(&mut Rapier)| {
        let mut rapier = Rapier::at(steps_per_sec);
        turn(&mut rapier);
        Engine::Rapier(rapier)
    };
    let mut engines = vec![Engine::Exact];
    engines.extend(STEPS_PER_SEC.map(|steps| plain(steps, |_| {})));
    engines.push(plain(60, |rapier| rapier.fast_rotation = false));
    engines.push(plain(60, |rapier| rapier.sweep_cue_ball = false));
    engines.push(plain(240, |rapier| rapier.recycle_contacts = true));
    engines.push(plain(240, |rapier| rapier.solver_iterations = 1));
    engines.push(plain(240, |rapier| rapier.solver_iterations = 16));
    engines.push(plain(240, |rapier| rapier.solver_iterations = 64));
    engines
}

/// Measures one setting.
///
/// # Errors
/// A sentence with the shot that cannot be played.
pub fn measure(engine: Engine, references: &[ReferenceShot]) -> anyhow::Result<EngineTradeoff> {
    measured(engine, references).with_context(|| format!("the engine {engine}"))
}

fn measured(engine: Engine, references: &[ReferenceShot]) -> anyhow::Result<EngineTradeoff> {
    let held = references
        .iter()
        .filter(|reference| reference.kind == ReferenceKind::Shot);
    let off_mm = held.map(|reference| {
        let mut reference = reference.clone();
        reference.set_engine(engine);
        Ok(1e3 * Deviation::between(&reference, &reference.play()?).max_m)
    });
    let mut trade = EngineTradeoff {
        engine: engine.to_string(),
        cut_error_deg: cut_error_deg(engine)?,
        median_max_mm: median(off_mm.collect::<anyhow::Result<Vec<_>>>()?),
        energy_kept: 0.0,
        break_ms: 0.0,
        ms_per_second: 0.0,
        worst_frame_ms: 0.0,
    };
    for seed in 1..=BREAKS {
        trade.add_break(engine, seed)?;
    }
    trade.energy_kept /= f64::from(BREAKS);
    Ok(trade)
}

impl EngineTradeoff {
    fn add_break(&mut self, engine: Engine, seed: u32) -> Result<()> {
        let table = Table::nine_foot();
        let rack = table.rack_eight(seed);
        let mut world = World::new(table, rack)?;
        world.set_engine(engine);
        let stroke = Stroke::straight(0.0, BREAK_M_S);
        let (mut whole_ms, mut frame_ms) = (f64::INFINITY, f64::INFINITY);
        let mut shot = world.strike(stroke)?;
        for _ in 0..RUNS {
            let (begun, mut frame_begun, mut worst_ms) =
                (ThreadTime::now(), ThreadTime::now(), 0.0);
            shot = world.strike_in_frames(stroke, FRAME_SECS, &mut || {
                worst_ms = ms_since(frame_begun).max(worst_ms);
                frame_begun = ThreadTime::now();
            })?;
            whole_ms = whole_ms.min(ms_since(begun));
            frame_ms = frame_ms.min(worst_ms);
        }
        self.energy_kept += energy_kept(&shot);
        self.break_ms = self.break_ms.max(whole_ms);
        self.ms_per_second = self.ms_per_second.max(whole_ms / shot.duration_secs());
        self.worst_frame_ms = self.worst_frame_ms.max(frame_ms);
        Ok(())
    }
}

/// Share of the energy of the stroke that is left 50 ms after the first contact.
fn energy_kept(shot: &Shot) -> f64 {
    let meets = |kind: &EventKind| matches!(kind, EventKind::BallBall { .. });
    let contact = first_secs(shot, meets);
    let energy_j = |t: f64| -> f64 {
        let body = BallBody::default();
        let states = shot.states_at(t);
        states
            .iter()
            .map(|b| body.kinetic_energy_j(b.velocity, b.spin))
            .sum()
    };
    energy_j(contact + 0.05) / energy_j(0.0)
}

/// Largest angle between the object ball's direction and the line of centres, which is where a cut
/// without friction sends it, over starts at different phases of a step.
fn cut_error_deg(engine: Engine) -> Result<f64> {
    let laws = Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    };
    let line = DVec2::from_angle(-PI / 6.0);
    let ghost = -2.0 * BallBody::default().radius_m * line;
    let mut worst = 0.0f64;
    for phase in 0..PHASES {
        let from = ghost.x - 0.2 - CUT_M_S / 60.0 * f64::from(phase) / f64::from(PHASES);
        let balls = vec![
            ball(0, from, ghost.y, CUT_M_S * DVec3::X, DVec3::ZERO),
            ball(1, 0.0, 0.0, DVec3::ZERO, DVec3::ZERO),
        ];
        let mut world = World::with_laws(infinite_table()?, laws, balls)?;
        world.set_engine(engine);
        let way = world.release()?.states_at(0.25)[1].velocity.truncate();
        // A ball that was passed through or missed has no direction at all.
        let error = if way == DVec2::ZERO {
            PI
        } else {
            line.angle_to(way).abs()
        };
        worst = worst.max(error.to_degrees());
    }
    Ok(worst)
}

/// Error against CPU time, of positions and of cuts.
pub(super) fn charts(trades: &[EngineTradeoff]) -> Vec<Chart> {
    let chart = |title: &str, label, error: fn(&EngineTradeoff) -> f64| {
        let place = |trade: &EngineTradeoff| (trade.ms_per_second, error(trade));
        let series = |name: &str, mark, has: &dyn Fn(&&EngineTradeoff) -> bool| Series {
            name: name.to_owned(),
            points: trades.iter().filter(has).map(place).collect(),
            mark,
        };
        let is_plain = |trade: &&EngineTradeoff| trade.engine.starts_with("rapier");
        let is_turned = |trade: &&EngineTradeoff| trade.engine.contains(',');
        let series = vec![
            series("exact", Mark::Dots, &|trade| !is_plain(trade)),
            series("rapier, 1/60 … 1/4000 s", Mark::Line, &|trade| {
                is_plain(trade) && !is_turned(trade)
            }),
            series("rapier, other knobs", Mark::Dots, &is_turned),
        ];
        let x = Axis::logarithmic("CPU ms per simulated second of a break");
        Chart::new(title, x, Axis::logarithmic(label), series)
    };
    vec![
        chart(
            "The trade: reference shots",
            "median of the largest distances, mm",
            |trade| trade.median_max_mm,
        ),
        chart(
            "The trade: a 30° cut at 3 m/s",
            "error of the line, degrees",
            |trade| trade.cut_error_deg,
        ),
    ]
}

/// Maximum CPU times of a break in ms: for the whole, per simulated second, and for the most expensive
/// 10 ms.
pub const BARS_MS: [f64; 3] = [40.0, 6.0, 2.0];
/// Step rates of plain rapier that are compared.
pub const STEPS_PER_SEC: [u32; 7] = [60, 120, 240, 480, 1000, 2000, 4000];
/// Number of starts of a cut, spread over the longest step.
pub const PHASES: u32 = 16;
/// Number of racks that are broken.
pub const BREAKS: u32 = 2;
const CUT_M_S: f64 = 3.0;
const BREAK_M_S: f64 = 8.0;
/// Simulated time of a frame; the first includes the setup of the world.
const FRAME_SECS: f64 = 0.01;
/// Repetitions, of which the best counts.
const RUNS: u32 = 3;
