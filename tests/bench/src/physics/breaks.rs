//! Statistics of breaks: a break is chaotic, so that trajectories are not comparable after the first
//! second, but the mean outcome of a rack depends on the laws.
//!
//! Each break of the references is repeated with its balls displaced by some micrometres. The outcome
//! of the reference's own simulator is one draw of the same distribution and must lie within ours;
//! where it has drawn many times, its draws are compared with ours as a whole.

use std::fmt;

use carom_tracer::sampling::pcg4d;
use glam::DVec2;
use serde::Serialize;

use super::{
    break_outcome::{BreakOutcome, spread_m},
    break_samples::{ReferenceBreaks, ReferenceSample, chance},
    reference::{ReferenceKind, ReferenceShot},
};
use carom_billiards::Result;
use carom_billiards::physics::{BallState, Engine, Shot, Stroke, Table, World};

/// One quantity of one kind of break over all seeds.
#[derive(Clone, Debug, Serialize)]
pub struct BreakStatistic {
    /// Name of the rack.
    pub rack: String,
    /// Name of the quantity.
    pub quantity: &'static str,
    /// Number of seeds.
    pub count: usize,
    /// Mean over all seeds.
    pub mean: f64,
    /// Half of the 95 % confidence interval of the mean.
    pub mean_within: f64,
    /// Bounds of the middle 95 % of the draws.
    pub band: [f64; 2],
    /// Difference of the means of the even and the odd seeds, over its standard error: beyond ±3 the
    /// seeds would not be independent draws.
    pub halves_differ: f64,
    /// The reference's draw, if there is one.
    pub reference: Option<f64>,
    /// The other simulator's own draws of the same distribution, if there are any.
    pub theirs: Option<ReferenceSample>,
}

impl BreakStatistic {
    fn over(
        rack: &str,
        quantity: &'static str,
        draws: &[f64],
        reference: Option<f64>,
        theirs: Option<&[f64]>,
    ) -> Self {
        let half = |start: usize| {
            draws
                .iter()
                .copied()
                .skip(start)
                .step_by(2)
                .collect::<Vec<_>>()
        };
        let (even, odd) = (moments(&half(0)), moments(&half(1)));
        let (mean, error) = moments(draws);
        let differ = (even.0 - odd.0) / even.1.hypot(odd.1);
        Self {
            rack: rack.to_owned(),
            quantity,
            count: draws.len(),
            mean,
            mean_within: 1.96 * error,
            band: band(draws),
            halves_differ: if differ.is_finite() { differ } else { 0.0 },
            reference,
            theirs: theirs.map(|theirs| {
                let (mean, error) = moments(theirs);
                ReferenceSample {
                    count: theirs.len(),
                    mean,
                    mean_within: 1.96 * error,
                    chance: chance(draws, theirs),
                }
            }),
        }
    }

    /// Whether the reference's draw lies within the middle 95 % of ours.
    pub fn reference_fits(&self) -> Option<bool> {
        let [low, high] = self.band;
        self.reference.map(|value| (low..=high).contains(&value))
    }
}

impl fmt::Display for BreakStatistic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.band;
        write!(
            f,
            "{:22} {:20} {:5} {:8.4} ± {:.4}  {:8.4} to {:<8.4} {:+5.1}",
            self.rack,
            self.quantity,
            self.count,
            self.mean,
            self.mean_within,
            low,
            high,
            self.halves_differ
        )?;
        if let (Some(value), Some(fits)) = (self.reference, self.reference_fits()) {
            let words = if fits { "fits" } else { "OUTSIDE" };
            write!(f, "  {value:8.4} {words:7}")?;
        }
        match self.theirs {
            Some(theirs) => write!(
                f,
                "  {:5} {:8.4} ± {:.4}  {:.3}",
                theirs.count, theirs.mean, theirs.mean_within, theirs.chance
            ),
            None => Ok(()),
        }
    }
}

/// The heading of a table of [`BreakStatistic`]s.
pub const HEADING: &str = "rack                   quantity             seeds     mean, 95 % of it   \
                           middle 95 % of draws halves  one shot         theirs mean, 95 % of it  chance";

/// The breaks of the references, each repeated `seeds` times, and the game's own rack.
///
/// # Errors
/// A sentence with the shot that cannot be played.
pub fn measure(
    references: &[ReferenceShot],
    theirs: &ReferenceBreaks,
    seeds: u32,
) -> anyhow::Result<Vec<BreakStatistic>> {
    let mut statistics = Vec::new();
    for reference in references
        .iter()
        .filter(|reference| reference.kind == ReferenceKind::Break)
    {
        let Some(stroke) = reference.stroke() else {
            continue;
        };
        let draws = (0..seeds)
            .map(|seed| draw(&shaken(reference.world(), seed), stroke))
            .collect::<Result<Vec<_>>>()?;
        statistics.extend(table(
            &reference.name,
            &draws,
            reference.outcome(ENERGY_AFTER_SECS),
            theirs,
        ));
    }
    let own = (0..seeds).map(own_break).collect::<Result<Vec<_>>>()?;
    statistics.extend(table("the game's eight-ball", &own, None, theirs));
    Ok(statistics)
}

fn table(
    rack: &str,
    draws: &[BreakOutcome],
    reference: Option<BreakOutcome>,
    theirs: &ReferenceBreaks,
) -> [BreakStatistic; 3] {
    let row = |quantity, pick: fn(&BreakOutcome) -> f64, theirs: Option<&[f64]>| {
        let values: Vec<_> = draws.iter().map(pick).collect();
        let reference = reference.as_ref().map(pick);
        BreakStatistic::over(rack, quantity, &values, reference, theirs)
    };
    let theirs = theirs.of(rack);
    [
        row(
            "energy kept",
            |outcome| outcome.energy_kept,
            theirs.map(|rack| rack.energy_kept.as_slice()),
        ),
        row(
            "spread, m",
            |outcome| outcome.spread_m,
            theirs.map(|rack| rack.spread_m.as_slice()),
        ),
        row(
            "balls pocketed",
            |outcome| outcome.pocketed,
            theirs.map(|rack| rack.pocketed.as_slice()),
        ),
    ]
}

fn own_break(seed: u32) -> Result<BreakOutcome> {
    let table = Table::nine_foot();
    let rack = table.rack_eight(seed);
    let aim = 2e-3 * (unit(seed, 0, 9) - 0.5);
    draw(&World::new(table, rack)?, Stroke::straight(aim, 8.0))
}

fn draw(world: &World, stroke: Stroke) -> Result<BreakOutcome> {
    let mut world = world.clone();
    world.set_engine(Engine::Exact);
    let shot = world.strike(stroke)?;
    let energy_j = |t: f64| energy_j(&shot.states_at(t));
    Ok(BreakOutcome {
        energy_kept: energy_j(ENERGY_AFTER_SECS) / energy_j(0.0),
        spread_m: spread_of(&shot),
        pocketed: pocketed(&world, &shot),
    })
}

fn energy_j(states: &[BallState]) -> f64 {
    states
        .iter()
        .map(|ball| ball.body.kinetic_energy_j(ball.velocity, ball.spin))
        .sum()
}

fn spread_of(shot: &Shot) -> f64 {
    let ends = shot.final_states();
    let lying = ends.iter().filter(|ball| ball.phase.is_on_table());
    spread_m(&lying.map(|ball| ball.position).collect::<Vec<_>>())
}

fn pocketed(world: &World, shot: &Shot) -> f64 {
    let lying = |states: &[BallState]| states.iter().filter(|b| b.phase.is_on_table()).count();
    (lying(&world.balls()) - lying(&shot.final_states())) as f64
}

/// The world with each racked ball displaced within a circle of [`SHAKE_M`], as far as there is room.
fn shaken(world: &World, seed: u32) -> World {
    let mut shaken = world.clone();
    for (index, ball) in world
        .balls()
        .iter()
        .enumerate()
        .filter(|(_, ball)| ball.number != 0)
    {
        for attempt in 0..SHAKES {
            let at = |axis| unit(seed, index as u32, 2 * attempt + axis);
            // The square root makes the displacement uniform over the disc.
            let by = SHAKE_M * at(0).sqrt() * DVec2::from_angle(std::f64::consts::TAU * at(1));
            let place = ball.position.truncate() + by;
            if shaken.place(ball.number, place.x, place.y).is_ok() {
                break;
            }
        }
    }
    shaken
}

/// Uniform in [0, 1).
fn unit(seed: u32, ball: u32, draw: u32) -> f64 {
    let [word, ..] = pcg4d([seed, ball, draw, STREAM]);
    f64::from(word) / 2f64.powi(32)
}

/// Mean and its standard error.
fn moments(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (mean, (square / (count - 1.0) / count).sqrt())
}

/// Bounds of the middle 95 %.
fn band(values: &[f64]) -> [f64; 2] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * (sorted.len() as f64 - 1.0)).round() as usize;
        sorted.get(index).copied().unwrap_or(f64::NAN)
    };
    [at(0.025), at(0.975)]
}

/// Time in s after the stroke at which the energy is taken: the rack has burst, few balls have met a
/// second cushion.
const ENERGY_AFTER_SECS: f64 = 0.25;
/// Largest displacement of racked balls: a fifth of the gaps in the references' racks.
const SHAKE_M: f64 = 1e-5;
/// Number of places that are tried before a ball stays where it is.
const SHAKES: u32 = 8;
/// Random stream apart from that of the racks.
const STREAM: u32 = 0x6272_6b73;
