//! A chart of FLIP against time, from the JSON of `carom-farm bench tradeoff`.

use std::path::PathBuf;

use anyhow::Context;
use serde::Deserialize;

use crate::BenchError;
use crate::chart::{Axis, Chart, Series};

/// Draw the results of `carom-farm bench tradeoff --json` as FLIP against time.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The results, as JSON.
    results: PathBuf,
    /// The SVG file to write.
    chart: PathBuf,
}

#[derive(Deserialize)]
struct Tradeoff {
    scene: String,
    width: u32,
    height: u32,
    rows: Vec<TradeoffRow>,
}

#[derive(Deserialize)]
struct TradeoffRow {
    backend: String,
    denoise: bool,
    preset: Option<String>,
    milliseconds: f64,
    flip: f64,
    pareto: bool,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let shown = args.results.display();
    let text = std::fs::read_to_string(&args.results)
        .map_err(|why| BenchError::Input(format!("cannot read {shown}: {why}")))?;
    let tradeoff: Tradeoff = serde_json::from_str(&text).map_err(|why| {
        BenchError::Input(format!("{shown} holds no results of the bench: {why}"))
    })?;
    std::fs::write(&args.chart, tradeoff.chart().svg())
        .with_context(|| format!("cannot write {}", args.chart.display()))?;
    Ok(())
}

impl Tradeoff {
    fn chart(&self) -> Chart {
        let mut backends: Vec<&str> = self.rows.iter().map(|row| &*row.backend).collect();
        backends.dedup();
        let series = backends.into_iter().flat_map(|name| self.series(name));
        Chart::new(
            format!("{}, {}x{}", self.scene, self.width, self.height),
            Axis::logarithmic("time of a frame, ms"),
            Axis::logarithmic("FLIP"),
            series.collect(),
        )
    }

    /// Series of one back end, with the line of its Pareto front.
    fn series(&self, backend: &str) -> [Series; 4] {
        let points = |wanted: fn(&TradeoffRow) -> bool| -> Vec<(f64, f64)> {
            let rows = self.rows.iter();
            let rows = rows.filter(|row| row.backend == backend && wanted(row));
            rows.map(|row| (row.milliseconds, row.flip)).collect()
        };
        let mut front = points(|row| row.pareto);
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        [
            Series::dots(format!("{backend}, noisy"), points(|row| !row.denoise)),
            Series::dots(format!("{backend}, denoised"), points(|row| row.denoise)),
            Series::dots(
                format!("{backend}, presets"),
                points(|row| row.preset.is_some()),
            ),
            Series::line(format!("{backend}, best"), front),
        ]
    }
}
