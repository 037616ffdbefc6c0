//! A published rule or curve, compared with the simulation.

use std::fmt;

use serde::Serialize;

use crate::chart::Chart;

/// A published rule or curve, and the simulation's deviation from it.
#[derive(Clone, Debug, Serialize)]
pub struct PublishedCurve {
    /// Name of the rule or curve.
    pub name: &'static str,
    /// Author and title of the source.
    pub source: &'static str,
    /// Largest difference, in the unit of the chart, between the formula and the simulation with
    /// the formula's assumptions.
    pub error_max: f64,
    /// Maximum of that.
    pub bar: f64,
    #[serde(skip)]
    pub(super) chart: Chart,
}

impl PublishedCurve {
    /// A curve that the simulation meets except for rounding.
    pub(super) fn new(
        name: &'static str,
        source: &'static str,
        error_max: f64,
        chart: Chart,
    ) -> Self {
        Self {
            name,
            source,
            error_max,
            bar: 1e-9,
            chart,
        }
    }
}

impl fmt::Display for PublishedCurve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:34} {:10.2e} (bar {:.0e})  {}",
            self.name, self.error_max, self.bar, self.source
        )
    }
}
