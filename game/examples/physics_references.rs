//! Plays every reference shot of a directory and prints how far each is from its reference:
//! `cargo run --example physics_references -- tests/references/physics`.

use std::{env, fs, path::PathBuf, process::ExitCode, time::Instant};

#[path = "../tests/reference/mod.rs"]
mod reference;

use reference::Reference;

fn main() -> ExitCode {
    let Some(directory) = env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("Give the directory of the reference shots.");
        return ExitCode::FAILURE;
    };
    let entries = match fs::read_dir(&directory) {
        Ok(entries) => entries,
        Err(error) => {
            eprintln!("{}: {error}", directory.display());
            return ExitCode::FAILURE;
        }
    };
    let mut paths: Vec<_> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "json")
        })
        .filter(|path| path.file_stem().is_some_and(|stem| stem != "index"))
        .collect();
    paths.sort();

    println!(
        "shot                        max mm      rms mm  events       ms  1 mm off at  pots off"
    );
    let mut maxima = Vec::new();
    let mut times = Vec::new();
    for path in paths {
        let reference = Reference::read(&path);
        let mut best_ms = f64::INFINITY;
        for _ in 0..RUNS {
            let start = Instant::now();
            std::hint::black_box(reference.play());
            best_ms = best_ms.min(start.elapsed().as_secs_f64() * 1e3);
        }
        let shot = reference.play();
        let deviation = reference.deviation(&shot);
        println!(
            "{:24} {:9.4}   {:9.4}  {:6}  {:7.2}  {:>11}  {:8}",
            reference.name,
            deviation.max_m * 1e3,
            deviation.rms_m * 1e3,
            shot.events().len(),
            best_ms,
            deviation
                .parts_at_secs
                .map_or("never".to_owned(), |t| format!("{t:.2} s")),
            deviation.pocketed_differently,
        );
        maxima.push(deviation.max_m * 1e3);
        times.push(best_ms);
    }
    println!(
        "median: {:.4} mm, {:.2} ms",
        median(&mut maxima),
        median(&mut times)
    );
    ExitCode::SUCCESS
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The best of so many is printed.
const RUNS: u32 = 3;
