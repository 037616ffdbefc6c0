//! Measured cost and error of each precision of particles in the settings.

use carom_billiards::physics::ParticlePrecision;
use carom_text::text;

/// Figures of the shot into the sand trap: number of particles; CPU time in s; mean difference from the
/// finest precision, in mm, of the cue ball's position over the first second, and of the height of the sand
/// behind it.
const fn figures(precision: ParticlePrecision) -> [&'static str; 4] {
    // Measured by `carom-bench particles --part precision`; also in `tests/bench/MEASUREMENTS.md`.
    match precision {
        ParticlePrecision::Coarse => ["2560", "1.1", "40", "1.9"],
        ParticlePrecision::Standard => ["4000", "1.1", "11", "2.0"],
        ParticlePrecision::Fine => ["8640", "5.3", "0", "0"],
    }
}

/// Cost and error of a precision, in a sentence.
pub fn particle_cost(precision: ParticlePrecision) -> String {
    let [particles, time, differs, surface] = figures(precision);
    text!(
        "particle-cost",
        particles = particles,
        time = time,
        differs = differs,
        surface = surface
    )
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum as _;

    use super::*;

    /// The three figures of a row of the measurements.
    fn measured(row: &str, column: usize) -> Vec<String> {
        let text = include_str!("../../../tests/bench/MEASUREMENTS.md");
        let line = text.lines().find(|line| line.starts_with(row));
        let cell = line.expect("a row").split('|').nth(column).expect("a cell");
        let is_apart = |c: char| !c.is_ascii_digit() && c != '.';
        let figures = cell.replace(',', if column == 3 { "" } else { " " });
        let figures = figures.split(is_apart).filter(|part| !part.is_empty());
        figures.map(str::to_owned).collect()
    }

    #[test]
    fn figures_are_those_of_the_measurements() {
        const TIME: &str = "| CPU time of a shot into the sand trap |";
        let precisions = || ParticlePrecision::value_variants().iter();
        let ours = |figure: usize| precisions().map(move |p| figures(*p)[figure].to_owned());
        assert!(ours(0).eq(measured(TIME, 3)));
        assert!(ours(1).eq(measured(TIME, 4)));
        let path = measured("| the cue ball's mean distance from the finest", 4);
        assert!(ours(2).eq(path));
        let surface = measured("| how high sand lies behind it", 4);
        assert!(ours(3).eq(surface));
    }

    #[test]
    fn every_precision_has_its_figures() {
        for precision in ParticlePrecision::value_variants() {
            let sentence = particle_cost(*precision);
            assert!(
                sentence.contains("particles") && sentence.contains("mm"),
                "{sentence}"
            );
        }
    }
}
