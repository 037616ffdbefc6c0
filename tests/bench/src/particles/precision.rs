//! The trade-off of the particles' precision: time against the ball's path and the surface that it
//! leaves.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use anyhow::Context as _;
use carom::play::tricks::TrickTable;
use carom_billiards::physics::{ParticleMaterial, ParticlePatch, ParticlePrecision, Shot, Table};
use clap::ValueEnum as _;
use cpu_time::ProcessTime;

use crate::BenchError;

pub(super) fn run() -> Result<(), BenchError> {
    let table = Table::nine_foot();
    println!(
        "{:<14} {:<9} {:>9} {:>7} {:>8} {:>8} {:>9} {:>10} {:>10}",
        "trick",
        "precision",
        "particles",
        "shot s",
        "CPU s",
        "wall s",
        "way m",
        "differs mm",
        "surface mm"
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
        let Some((finest_precision, finest, ..)) = shots.last() else {
            continue;
        };
        let finest_surface = surface(finest, *finest_precision);
        for (precision, shot, particles, cpu, wall) in &shots {
            println!(
                "{:<14} {:<9} {particles:>9} {:>7.2} {cpu:>8.2} {wall:>8.2} {:>9.3} {:>10.1} {:>10.1}",
                format!("{trick:?}"),
                format!("{precision:?}"),
                shot.duration_secs(),
                way_m(shot),
                1e3 * difference_m(shot, finest),
                1e3 * surface_difference_m(&surface(shot, *precision), &finest_surface),
            );
        }
    }
    Ok(())
}

/// Distance of the cue ball's final from its initial position, in m.
fn way_m(shot: &Shot) -> f64 {
    let place = |secs| shot.poses_at(secs)[0].position;
    place(0.0).distance(place(shot.duration_secs()))
}

/// Mean distance of two cue balls over the first second, in m.
fn difference_m(a: &Shot, b: &Shot) -> f64 {
    let times = (0..60).map(|step| f64::from(step) / 60.0);
    let apart = times.map(|secs| {
        a.poses_at(secs)[0]
            .position
            .distance(b.poses_at(secs)[0].position)
    });
    apart.sum::<f64>() / 60.0
}

/// Height of the particles at the end of a shot in m, by squares of the size of a patch.
fn surface(shot: &Shot, precision: ParticlePrecision) -> BTreeMap<(i32, i32), f64> {
    let mut heights = BTreeMap::new();
    let Some(track) = shot.particles() else {
        return heights;
    };
    let [min, max] = track.bounds();
    let has_marbles = track
        .groups()
        .iter()
        .any(|group| group.material == ParticleMaterial::Marbles);
    let extent_m = match has_marbles {
        true => ParticleMaterial::MARBLE_RADIUS_M,
        false => 0.25 * precision.cell_size_m(),
    };
    for place in track.places_at(shot.duration_secs()) {
        let center = (min + place.as_vec3() / 65_535.0 * (max - min)).as_dvec3();
        let square = (center.truncate() / ParticlePatch::EDGE_M)
            .floor()
            .as_ivec2();
        let top = center.z + extent_m;
        let height = heights.entry((square.x, square.y)).or_insert(top);
        *height = top.max(*height);
    }
    heights
}

/// Mean difference in m over squares where either has particles.
fn surface_difference_m(a: &BTreeMap<(i32, i32), f64>, b: &BTreeMap<(i32, i32), f64>) -> f64 {
    let all: BTreeSet<(i32, i32)> = a.keys().chain(b.keys()).copied().collect();
    let height = |of: &BTreeMap<(i32, i32), f64>, square| of.get(square).copied().unwrap_or(0.0);
    let apart = all.iter();
    let apart = apart.map(|square| (height(a, square) - height(b, square)).abs());
    apart.sum::<f64>() / all.len().max(1) as f64
}
