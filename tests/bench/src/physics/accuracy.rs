//! Accuracy: every reference shot, simulated and compared.

use std::fmt;

use serde::Serialize;

use super::deviation::Deviation;
use super::reference::{ReferenceKind, ReferenceShot};
use crate::timing::{best_ms, median};

/// Accuracy over a folder of references.
#[derive(Clone, Debug, Serialize)]
pub struct Accuracy {
    /// The shots, by name.
    pub shots: Vec<ShotAccuracy>,
    /// Median of the largest distances of all shots with comparable positions.
    pub median_max_mm: f64,
    /// Largest distance of those shots.
    pub worst_max_mm: f64,
}

/// Accuracy of one shot.
#[derive(Clone, Debug, Serialize)]
pub struct ShotAccuracy {
    /// Name of the reference.
    pub name: String,
    /// Largest distance of a ball from its reference, in mm.
    pub max_mm: f64,
    /// Root of the mean square of the distances, in mm.
    pub rms_mm: f64,
    /// CPU time to simulate the whole shot once: the best of several runs.
    pub cpu_ms: f64,
    /// `shot`, `airborne` (until the first cushion), or `cluster` or `break`, whose positions are not
    /// comparable.
    pub kind: &'static str,
    /// Length of the shot, in s.
    pub duration_secs: f64,
    /// Number of contacts and phase changes.
    pub events: usize,
    /// For a cluster: difference of velocity of the ball that takes the impact, in m/s.
    pub fastest_off_m_s: f64,
    /// For a cluster: largest difference of velocity of any ball, in m/s.
    pub velocity_off_m_s: f64,
    /// Time at which a ball is first over 1 mm off.
    pub parts_at_secs: Option<f64>,
    /// Number of balls that were pocketed in one simulation and not in the other.
    pub pocketed_differently: usize,
}

impl Accuracy {
    /// Simulates all shots.
    ///
    /// # Errors
    /// A sentence with the shot that cannot be played.
    pub fn measure(references: &[ReferenceShot]) -> anyhow::Result<Self> {
        let shots = references
            .iter()
            .map(ShotAccuracy::measure)
            .collect::<anyhow::Result<Vec<_>>>()?;
        let comparable = || shots.iter().filter(|shot| shot.is_comparable());
        Ok(Self {
            median_max_mm: median(comparable().map(|shot| shot.max_mm)),
            worst_max_mm: comparable().map(|shot| shot.max_mm).fold(0.0, f64::max),
            shots,
        })
    }
}

impl ShotAccuracy {
    fn measure(reference: &ReferenceShot) -> anyhow::Result<Self> {
        let shot = reference.play()?;
        let cpu_ms = best_ms(RUNS, || {
            std::hint::black_box(reference.play().is_ok());
        });
        let deviation = Deviation::between(reference, &shot);
        Ok(Self {
            name: reference.name.clone(),
            max_mm: deviation.max_m * 1e3,
            rms_mm: deviation.rms_m * 1e3,
            cpu_ms,
            kind: match reference.kind {
                ReferenceKind::Shot => "shot",
                ReferenceKind::Airborne => "airborne",
                ReferenceKind::Cluster => "cluster",
                ReferenceKind::Break => "break",
            },
            duration_secs: shot.duration_secs(),
            events: shot.events().len(),
            fastest_off_m_s: deviation.fastest_m_s,
            velocity_off_m_s: deviation.velocity_m_s,
            parts_at_secs: deviation.parts_at_secs,
            pocketed_differently: deviation.pocketed_differently,
        })
    }

    /// Whether its positions are comparable to the reference's.
    pub fn is_comparable(&self) -> bool {
        !matches!(self.kind, "break" | "cluster")
    }
}

impl fmt::Display for Accuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:24} {:>10} {:>10} {:>8} {:>7}  notes",
            "shot", "max mm", "rms mm", "CPU ms", "events"
        )?;
        for shot in &self.shots {
            write!(
                f,
                "{:24} {:10.4} {:10.4} {:8.3} {:7}",
                shot.name, shot.max_mm, shot.rms_mm, shot.cpu_ms, shot.events
            )?;
            match shot.kind {
                "shot" => {}
                "cluster" => write!(
                    f,
                    "  cluster: parts {:.4} m/s off, the ball that takes the blow {:.4} m/s",
                    shot.velocity_off_m_s, shot.fastest_off_m_s
                )?,
                "break" => match shot.parts_at_secs {
                    Some(t) => write!(f, "  break: parts by 1 mm at {t:.2} s")?,
                    None => write!(f, "  break: never parts by 1 mm")?,
                },
                kind => write!(f, "  {kind}")?,
            }
            if shot.pocketed_differently > 0 && shot.is_comparable() {
                write!(
                    f,
                    "  {} balls POCKETED DIFFERENTLY",
                    shot.pocketed_differently
                )?;
            }
            writeln!(f)?;
        }
        let count = self
            .shots
            .iter()
            .filter(|shot| shot.is_comparable())
            .count();
        writeln!(
            f,
            "{count} shots without breaks and clusters: median {:.4} mm (bar {MEDIAN_MAX_MM}), worst \
             {:.4} mm (bar {WORST_MAX_MM})",
            self.median_max_mm, self.worst_max_mm
        )
    }
}

/// Maximum of the median distance, in mm.
pub const MEDIAN_MAX_MM: f64 = 0.05;
/// Maximum distance of any shot, in mm.
pub const WORST_MAX_MM: f64 = 1.0;
/// Repetitions, of which the best counts.
const RUNS: u32 = 3;
