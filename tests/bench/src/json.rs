//! Results as JSON, for programs.

use anyhow::Context as _;
use serde::Serialize;

use crate::BenchError;

/// Prints them on standard output, in a line.
pub(crate) fn print_json(results: &impl Serialize) -> Result<(), BenchError> {
    let json = serde_json::to_string(results).context("results as JSON")?;
    println!("{json}");
    Ok(())
}
