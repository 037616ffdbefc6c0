//! Convergence of the material point method: a standing wave in a bar of jelly, at several resolutions
//! of the grid.

use std::f64::consts::PI;
use std::path::PathBuf;

use anyhow::Context as _;
use carom_mpm::{Bodies, Jelly, Material, Region, Settings, Simulation};
use carom_tracer::glam::Vec3;

use crate::BenchError;
use crate::chart::{Axis, Chart, Series};

#[derive(clap::Args)]
pub(super) struct ConvergenceArgs {
    /// Write the errors of the part convergence as a chart (SVG).
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

pub(super) fn run(args: &ConvergenceArgs) -> Result<(), BenchError> {
    println!(
        "cells of the bar  error against the wave  against a run of {FINER} times the cells  order"
    );
    let mut against_wave = Vec::new();
    let mut against_finer = Vec::new();
    for cells in CELLS {
        let coarse = displacements(cells).context("a bar")?;
        let finer = displacements(FINER * cells).context("a bar")?;
        let wave_error = mean(coarse.iter().map(|&(x, moved)| (moved - exact(x)).abs()));
        let finer_error = mean(
            coarse
                .iter()
                .map(|&(x, moved)| (moved - at(&finer, x)).abs()),
        );
        let order = against_finer
            .last()
            .map(|&(_, before): &(f64, f64)| (before / finer_error).log2());
        let order = order.map_or("-".to_owned(), |order| format!("{order:.2}"));
        println!("{cells:17}  {wave_error:22.5}  {finer_error:36.5}  {order}");
        against_wave.push((f64::from(cells), wave_error));
        against_finer.push((f64::from(cells), finer_error));
    }
    if let Some(path) = &args.plot {
        let first = against_finer[0];
        let slope = |&(cells, _): &(f64, f64)| (cells, first.1 * first.0 / cells);
        let chart = Chart::new(
            "Standing wave in a bar of jelly: error by the grid's resolution",
            Axis::logarithmic("cells along the bar"),
            Axis::logarithmic("mean error of the displacement, of the amplitude"),
            vec![
                Series::line("first order", against_finer.iter().map(slope).collect()),
                Series::dots("against the wave", against_wave),
                Series::dots(format!("against {FINER} times the cells"), against_finer),
            ],
        );
        let written = std::fs::write(path, chart.svg());
        written.with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// A free bar in its first longitudinal vibration, after 1.3 periods: rest positions in m and
/// displacements over the amplitude, by position.
fn displacements(cells: u32) -> carom_mpm::Result<Vec<(f64, f64)>> {
    let cell = LENGTH_M / cells as f32;
    let mut simulation = Simulation::new(Settings {
        cell_size_m: cell,
        gravity: Vec3::ZERO,
        rest_speed_m_s: 0.0,
        ..Settings::default()
    })?;
    for slice in 0..2 * cells {
        let min = Vec3::new(slice as f32 * cell / 2.0, 0.0, 0.0);
        let max = min + Vec3::new(cell / 2.0, 2.0 * cell, 2.0 * cell);
        let speed = SPEED_M_S * phase(f64::from(min.x + cell / 4.0)).cos();
        let region = Region::Cuboid { min, max };
        let material = Material::Jelly(jelly());
        simulation.fill(&region, material, Vec3::new(speed as f32, 0.0, 0.0))?;
    }
    let start = places(&simulation);
    simulation.step(duration_secs(), &mut Bodies::default())?;
    let amplitude = SPEED_M_S / omega();
    let end = places(&simulation);
    let moved = start.iter().zip(end);
    let mut moved: Vec<_> = moved
        .map(|(&start, end)| (start, (end - start) / amplitude))
        .collect();
    moved.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(moved)
}

/// x of all particles, in the order of their ids.
fn places(simulation: &Simulation) -> Vec<f64> {
    let mut particles: Vec<_> = simulation.particles().collect();
    particles.sort_by_key(|particle| particle.id);
    let places = particles.iter().map(|particle| particle.position.x.into());
    places.collect()
}

/// Displacement at a place by linear theory, over the amplitude.
fn exact(x: f64) -> f64 {
    (omega() * duration_secs()).sin() * phase(x).cos()
}

/// Displacement at a place, interpolated between the mean displacements of the two nearest slices of
/// particles.
fn at(finer: &[(f64, f64)], x: f64) -> f64 {
    let above = finer.partition_point(|&(place, _)| place < x);
    let (below, above) = (above.max(1) - 1, above.min(finer.len() - 1));
    let slice = |place: f64| {
        let same = finer.iter().filter(|(at, _)| (at - place).abs() < 1e-7);
        mean(same.map(|&(_, moved)| moved))
    };
    let (left, right) = (finer[below].0, finer[above].0);
    if right - left < 1e-7 {
        return slice(left);
    }
    let part = ((x - left) / (right - left)).clamp(0.0, 1.0);
    slice(left) + part * (slice(right) - slice(left))
}

fn jelly() -> Jelly {
    Jelly {
        poisson: 0.0,
        ..Jelly::default()
    }
}

fn phase(x: f64) -> f64 {
    PI * x / f64::from(LENGTH_M)
}

fn omega() -> f64 {
    PI * f64::from(Material::Jelly(jelly()).sound_speed_m_s()) / f64::from(LENGTH_M)
}

fn duration_secs() -> f64 {
    1.3 * 2.0 * PI / omega()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count.max(1))
}

const CELLS: [u32; 4] = [8, 16, 32, 64];
const FINER: u32 = 8;
const LENGTH_M: f32 = 0.4;
/// Largest initial speed: the bar is strained by two thousandths.
const SPEED_M_S: f64 = 0.05;
