//! What a run is worth in which nodes slow down, die and join.

use super::Report;

/// Frame times as multiples of the clairvoyant optimum's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Score {
    /// Each frame's time; NaN where there is no optimum.
    pub ratios: Vec<f64>,
    /// Mean over the settled frames; NaN if the run has none.
    pub mean: f64,
    /// 99th percentile of the settled frames; NaN if the run has none.
    pub p99: f64,
    /// Frames after each event until eight in a row are, on average, within a tenth of what they
    /// settle to; absent if that never happens.
    pub recovery_frames: [Option<usize>; 3],
    /// Tiles that were traced more than once, of all.
    pub duplicates: f64,
    /// The worst frame of the 50 after the death; NaN if there is no optimum.
    pub worst_after_death: f64,
    /// Mean over the settled frames of the deviation of the nodes' response times, in seconds.
    pub response_deviation_secs: f64,
    /// Frames that did not come, or were not submitted because too many were in flight.
    pub lost: u64,
}

impl Score {
    /// Of a run of `frames` frames whose optimum is `optimum_secs`; before the frames `events` a
    /// node slowed down, one died and one joined: `frames` or more for what did not happen.
    pub fn new(frames: u64, events: [u64; 3], report: &Report, optimum_secs: &[f64]) -> Self {
        let times = report.frames.iter().map(|frame| frame.stats.makespan_secs);
        let ratio = |(time, best): (f64, &f64)| {
            if best.is_finite() {
                time / best
            } else {
                f64::NAN
            }
        };
        let ratios: Vec<f64> = times.zip(optimum_secs).map(ratio).collect();
        let events = events.map(|event| event as usize);
        let quarter = (frames / 4) as usize;
        let settled = settled(quarter, events, ratios.len());
        let mut sorted: Vec<f64> = settled.iter().map(|index| ratios[*index]).collect();
        sorted.retain(|ratio| ratio.is_finite());
        sorted.sort_by(f64::total_cmp);
        let deviations = settled
            .iter()
            .map(|index| report.frames[*index].stats.response_deviation_secs());
        let tiles = u64::from(report.tiles_per_frame) * report.frames.len() as u64;
        let worst = ratios.iter().skip(events[1]).take(AFTER_DEATH);
        Self {
            mean: mean(sorted.iter().copied()),
            p99: sorted
                .get((0.99 * sorted.len() as f64) as usize)
                .map_or(f64::NAN, |ratio| *ratio),
            recovery_frames: events.map(|event| recovery(&ratios, event, quarter)),
            duplicates: report.tiles_traced as f64 / tiles.max(1) as f64 - 1.0,
            worst_after_death: worst.fold(f64::NAN, |worst, ratio| worst.max(*ratio)),
            response_deviation_secs: mean(deviations),
            lost: frames - report.frames.len() as u64 + report.skipped,
            ratios,
        }
    }
}

/// Frames that are well after the start and after each event.
fn settled(quarter: usize, events: [usize; 3], frames: usize) -> Vec<usize> {
    let is_settled = |index: &usize| match events.iter().filter(|event| *event <= index).max() {
        Some(event) => index - event >= quarter / 4,
        None => *index >= quarter / 2,
    };
    (0..frames).filter(is_settled).collect()
}

fn recovery(ratios: &[f64], event: usize, quarter: usize) -> Option<usize> {
    let after = ratios.get(event..ratios.len().min(event + quarter))?;
    let settled = mean(after[after.len() / 2..].iter().copied());
    let window = |start: &usize| mean(after[*start..*start + WINDOW].iter().copied());
    let windows = 0..(after.len() + 1).saturating_sub(WINDOW);
    if settled.is_nan() {
        return None;
    }
    windows
        .into_iter()
        .find(|start| window(start) <= 1.1 * settled)
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value;
        count += 1.0;
    }
    if count > 0.0 { sum / count } else { f64::NAN }
}

/// Frames that are looked at together.
const WINDOW: usize = 8;
/// Frames in which a death may show.
const AFTER_DEATH: usize = 50;
