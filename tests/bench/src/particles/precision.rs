//! The trade: how finely sand is simulated, against time and the ball's way.

use std::time::Instant;

use anyhow::Context as _;
use carom::play::tricks::TrickTable;
use carom_billiards::physics::{ParticlePrecision, Shot, Table};
use clap::ValueEnum as _;
use cpu_time::ProcessTime;

use crate::BenchError;

pub(super) fn run() -> Result<(), BenchError> {
    let table = Table::nine_foot();
    println!(
        "{:<14} {:<9} {:>9} {:>7} {:>8} {:>8} {:>9} {:>9}",
        "trick", "precision", "particles", "shot s", "CPU s", "wall s", "way m", "differs mm"
    );
    for trick in TrickTable::value_variants() {
        let mut shots = Vec::new();
        for precision in ParticlePrecision::value_variants() {
            let (world, stroke) = trick.world(&table, *precision).context("the trick table")?;
            let (cpu, wall) = (ProcessTime::now(), Instant::now());
            let shot = world.strike(stroke).context("the shot")?;
            let (cpu, wall) = (cpu.elapsed().as_secs_f64(), wall.elapsed().as_secs_f64());
            let particles = world.particles().map_or(0, |bed| bed.centers().len());
            shots.push((*precision, shot, particles, cpu, wall));
        }
        let Some((_, finest, ..)) = shots.last() else {
            continue;
        };
        for (precision, shot, particles, cpu, wall) in &shots {
            println!(
                "{:<14} {:<9} {particles:>9} {:>7.2} {cpu:>8.2} {wall:>8.2} {:>9.3} {:>9.1}",
                format!("{trick:?}"),
                format!("{precision:?}"),
                shot.duration_secs(),
                way_m(shot),
                1e3 * difference_m(shot, finest),
            );
        }
    }
    Ok(())
}

/// From where the cue ball lay to where it comes to lie.
fn way_m(shot: &Shot) -> f64 {
    let place = |secs| shot.poses_at(secs)[0].position;
    place(0.0).distance(place(shot.duration_secs()))
}

/// The mean distance of two cue balls over the first second.
fn difference_m(a: &Shot, b: &Shot) -> f64 {
    let times = (0..60).map(|step| f64::from(step) / 60.0);
    let apart = times.map(|secs| {
        a.poses_at(secs)[0]
            .position
            .distance(b.poses_at(secs)[0].position)
    });
    apart.sum::<f64>() / 60.0
}
