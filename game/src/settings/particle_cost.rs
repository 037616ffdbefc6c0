//! The measured cost and error of each precision of particles that the settings offer.

use carom_billiards::physics::ParticlePrecision;
use carom_text::text;

/// A precision's row: the shot into the sand trap.
struct PrecisionCost {
    precision: ParticlePrecision,
    /// Particles of the trap.
    particles: u32,
    /// CPU time of the shot, s.
    shot_secs: &'static str,
    /// Mean distance of the cue ball from where it is at the finest, over the first second, mm.
    differs_mm: &'static str,
    /// Mean difference of how high sand lies behind it from the finest, mm.
    surface_mm: &'static str,
}

// `carom-bench particles --part precision`: rows of `tests/bench/MEASUREMENTS.md`.
const COSTS: [PrecisionCost; 3] = [
    PrecisionCost {
        precision: ParticlePrecision::Coarse,
        particles: 2560,
        shot_secs: "1.1",
        differs_mm: "40",
        surface_mm: "1.9",
    },
    PrecisionCost {
        precision: ParticlePrecision::Standard,
        particles: 4000,
        shot_secs: "1.1",
        differs_mm: "11",
        surface_mm: "2.0",
    },
    PrecisionCost {
        precision: ParticlePrecision::Fine,
        particles: 8640,
        shot_secs: "5.3",
        differs_mm: "0",
        surface_mm: "0",
    },
];

/// The cost and error of one precision, in a sentence.
pub fn particle_cost(precision: ParticlePrecision) -> String {
    let row = COSTS.iter().find(|cost| cost.precision == precision);
    row.map_or(String::new(), |cost| {
        text!(
            "particle-cost",
            particles = cost.particles,
            time = cost.shot_secs,
            differs = cost.differs_mm,
            surface = cost.surface_mm
        )
    })
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
        let ours = |of: fn(&PrecisionCost) -> String| COSTS.iter().map(of).collect::<Vec<_>>();
        let particles = ours(|cost| cost.particles.to_string());
        assert_eq!(measured(TIME, 3), particles);
        assert_eq!(measured(TIME, 4), ours(|cost| cost.shot_secs.to_owned()));
        let path = measured("| the cue ball's mean distance from the finest", 4);
        assert_eq!(path, ours(|cost| cost.differs_mm.to_owned()));
        let surface = measured("| how high sand lies behind it", 4);
        assert_eq!(surface, ours(|cost| cost.surface_mm.to_owned()));
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
