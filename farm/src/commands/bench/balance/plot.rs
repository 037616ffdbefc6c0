//! Charts of one scenario: how far the nodes' response times are apart, and the longest of them,
//! by frame, a line for each algorithm.

use std::fmt::Write as _;
use std::path::Path;

use carom_farm::FrameStats;

use super::Run;

/// Writes two SVG files into `folder`.
pub(super) fn write(folder: &Path, runs: &[Run]) -> std::io::Result<()> {
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
    let charts: [(&str, &str, Value); 2] = [
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
        let lines: Vec<(String, Vec<f64>)> = runs
            .iter()
            .map(|run| (run.balancing.to_string(), line(run, value)))
            .collect();
        let events = scenario.events();
        let chart = Chart {
            title: &format!("{title}: {what}, ms"),
            lines: &lines,
            marks: &[
                (events[0], "the best node slows down"),
                (events[1], "a node falls silent"),
                (events[2], "a node joins"),
            ],
            frames: scenario.frames,
        };
        std::fs::write(folder.join(file), chart.svg())?;
    }
    Ok(())
}

/// What a chart shows of a frame, in seconds.
type Value = fn(&FrameStats) -> f64;

/// Milliseconds by frame, each the mean of [`WINDOW`] frames.
fn line(run: &Run, value: Value) -> Vec<f64> {
    let values: Vec<f64> = run
        .report
        .frames
        .iter()
        .map(|frame| 1e3 * value(&frame.stats))
        .collect();
    let mean = |window: &[f64]| window.iter().sum::<f64>() / window.len() as f64;
    values.windows(WINDOW).map(mean).collect()
}

struct Chart<'a> {
    title: &'a str,
    lines: &'a [(String, Vec<f64>)],
    marks: &'a [(u64, &'a str)],
    frames: u64,
}

impl Chart<'_> {
    fn svg(&self) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             width=\"{WIDTH}\" height=\"{HEIGHT}\" font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n\
             <text x=\"{LEFT}\" y=\"20\" font-size=\"15\">{}</text>\n",
            self.title
        );
        let range = self.range();
        self.grid(&mut svg, range);
        for (index, (name, values)) in self.lines.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            let points: Vec<String> = values
                .iter()
                .enumerate()
                .map(|(frame, value)| {
                    let frame = frame as f64 + 0.5 * WINDOW as f64;
                    format!("{:.1},{:.1}", self.x(frame), y(*value, range))
                })
                .collect();
            let points = points.join(" ");
            let at = TOP + 16.0 * index as f64;
            let beside = WIDTH - RIGHT + 10.0;
            // Writing to a string cannot fail.
            let _ = writeln!(
                svg,
                "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.4\" \
                 points=\"{points}\"/>\n\
                 <line x1=\"{beside}\" x2=\"{}\" y1=\"{at}\" y2=\"{at}\" stroke=\"{colour}\" \
                 stroke-width=\"3\"/>\n\
                 <text x=\"{}\" y=\"{}\">{name}</text>",
                beside + 16.0,
                beside + 22.0,
                at + 4.0
            );
        }
        svg.push_str("</svg>\n");
        svg
    }

    /// Powers of ten around all values.
    fn range(&self) -> (f64, f64) {
        let values = || self.lines.iter().flat_map(|(_, values)| values);
        let low = values()
            .copied()
            .filter(|value| *value > 0.0)
            .fold(f64::MAX, f64::min);
        let high = values().copied().fold(0.0, f64::max);
        if low > high {
            return (1.0, 10.0);
        }
        let low = 10f64.powf(low.max(LOWEST).log10().floor());
        (low, 10f64.powf(high.log10().ceil()).max(10.0 * low))
    }

    fn grid(&self, svg: &mut String, range: (f64, f64)) {
        let right = WIDTH - RIGHT;
        let mut tick = range.0;
        while tick <= range.1 * 1.001 {
            for (factor, colour) in [(1.0, "#999"), (2.0, "#e4e4e4"), (5.0, "#e4e4e4")] {
                let value = tick * factor;
                if value > range.1 * 1.001 {
                    continue;
                }
                let at = y(value, range);
                let _ = writeln!(
                    svg,
                    "<line x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\" \
                     stroke=\"{colour}\"/>\n\
                     <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                    LEFT - 6.0,
                    at + 4.0,
                    (value * 1e3).round() / 1e3
                );
            }
            tick *= 10.0;
        }
        let bottom = HEIGHT - BOTTOM;
        for eighth in 0..=8 {
            let frame = self.frames * eighth / 8;
            let _ = writeln!(
                svg,
                "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{frame}</text>",
                self.x(frame as f64),
                bottom + 16.0
            );
        }
        for (frame, what) in self.marks {
            let at = self.x(*frame as f64);
            let _ = writeln!(
                svg,
                "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{TOP}\" y2=\"{bottom}\" stroke=\"#555\" \
                 stroke-dasharray=\"4 3\"/>\n\
                 <text x=\"{:.1}\" y=\"{}\" fill=\"#555\">{what}</text>",
                at + 4.0,
                bottom - 6.0
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">frame</text>",
            0.5 * (LEFT + right),
            HEIGHT - 6.0
        );
    }

    fn x(&self, frame: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * frame / self.frames as f64
    }
}

fn y(value: f64, (low, high): (f64, f64)) -> f64 {
    let height = (value.max(low) / low).ln() / (high / low).ln();
    HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * height
}

/// Frames of which the mean is shown.
const WINDOW: usize = 8;
/// Milliseconds below which nothing is shown.
const LOWEST: f64 = 0.01;
const WIDTH: f64 = 1100.0;
const HEIGHT: f64 = 480.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 180.0;
const TOP: f64 = 36.0;
const BOTTOM: f64 = 40.0;
/// Told apart by most eyes: Paul Tol's muted scheme, and black.
const COLOURS: [&str; 10] = [
    "#88ccee", "#ddcc77", "#cc6677", "#aa4499", "#332288", "#117733", "#999933", "#882255",
    "#44aa99", "#000000",
];
