//! The measured cost and error of each precision of particles that the settings offer.

use carom_billiards::physics::ParticlePrecision;
use carom_text::text;

/// A precision's row: a shot of 1.8 m/s into the sand trap.
struct PrecisionCost {
    precision: ParticlePrecision,
    /// Particles of the trap.
    particles: u32,
    /// CPU time of the shot, s.
    shot_secs: &'static str,
    /// Mean distance of the cue ball from where it is at the finest, over the first second, mm.
    differs_mm: &'static str,
}

// `carom-bench particles --part precision`, on 2026-11-24, two cores of an AMD EPYC with other work, a development build.
const COSTS: [PrecisionCost; 3] = [
    PrecisionCost {
        precision: ParticlePrecision::Coarse,
        particles: 2560,
        shot_secs: "2.2",
        differs_mm: "50",
    },
    PrecisionCost {
        precision: ParticlePrecision::Standard,
        particles: 4000,
        shot_secs: "3.4",
        differs_mm: "6",
    },
    PrecisionCost {
        precision: ParticlePrecision::Fine,
        particles: 8640,
        shot_secs: "8.1",
        differs_mm: "0",
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
            differs = cost.differs_mm
        )
    })
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum as _;

    use super::*;

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
