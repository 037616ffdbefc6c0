//! Charts of one scenario: deviation and maximum of the response times by frame, a line per
//! algorithm.

use std::path::Path;

use crate::chart::{Axis, Chart, Series};
use carom_farm::{Frame, FrameStats};

use super::BalanceRun;

/// Writes two SVG files into `folder`.
pub(super) fn write(folder: &Path, runs: &[BalanceRun]) -> std::io::Result<()> {
    let Some(first) = runs.first() else {
        return Ok(());
    };
    let scenario = first.scenario;
    let title = format!(
        "{} nodes, {}, {}, seed {}",
        scenario.nodes,
        scenario.network.name(),
        scenario.mode.name(),
        scenario.seed
    );
    let charts: [(&str, &str, FrameValue); 2] = [
        (
            "deviation",
            "deviation of response times",
            FrameStats::response_deviation_secs,
        ),
        (
            "maximum",
            "longest response time",
            FrameStats::response_max_secs,
        ),
    ];
    for (name, what, value) in charts {
        let file = format!(
            "response-{name}-{}-{}-{}-{}.svg",
            scenario.nodes,
            scenario.network.name(),
            scenario.mode.name(),
            scenario.seed
        );
        let events = scenario.events();
        let name = |run: &BalanceRun| run.balancing.to_string();
        let series = runs
            .iter()
            .map(|run| Series::line(name(run), line(run, value)));
        let chart = Chart {
            title: format!("{title}: {what}"),
            x: Axis::linear("frame"),
            y: Axis::logarithmic("milliseconds"),
            series: series.collect(),
            events: vec![
                (events[0] as f64, "the best node slows down"),
                (events[1] as f64, "a node falls silent"),
                (events[2] as f64, "a node joins"),
            ],
        };
        std::fs::write(folder.join(file), chart.svg())?;
    }
    Ok(())
}

/// The value of a frame that a chart shows, in seconds.
type FrameValue = fn(&FrameStats) -> f64;

/// Points of frame and milliseconds, each the mean of [`WINDOW`] frames.
fn line(run: &BalanceRun, value: FrameValue) -> Vec<(f64, f64)> {
    let milliseconds = |frame: &Frame| 1e3 * value(&frame.stats);
    let values: Vec<f64> = run.report.frames.iter().map(milliseconds).collect();
    let mean = |window: &[f64]| (window.iter().sum::<f64>() / window.len() as f64).max(LOWEST);
    let middle = |first: usize| first as f64 + 0.5 * WINDOW as f64;
    let windows = values.windows(WINDOW).enumerate();
    windows
        .map(|(first, window)| (middle(first), mean(window)))
        .collect()
}

/// Length of the moving average in frames.
const WINDOW: usize = 8;
/// Minimum in milliseconds of the drawn values.
const LOWEST: f64 = 0.01;
