//! Output of results as JSON, and words of tables.

use anyhow::Context as _;
use serde::Serialize;

use crate::BenchError;

/// Prints results on standard output, on one line.
pub(crate) fn print_json(results: &impl Serialize) -> Result<(), BenchError> {
    let json = serde_json::to_string(results).context("results as JSON")?;
    println!("{json}");
    Ok(())
}

/// Whether a criterion is met.
pub(crate) fn met(is_met: bool) -> &'static str {
    if is_met { "met" } else { "missed" }
}
