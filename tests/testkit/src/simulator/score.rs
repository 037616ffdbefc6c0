//! Score of a run in which nodes slow down, die and join.

use carom_protocol::limits::FRAMES_IN_FLIGHT_MAX;

use super::SimulationReport;

/// Frame times as multiples of the clairvoyant optimum's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Score {
    /// Ratio of each frame; NaN where there is no optimum.
    pub ratios: Vec<f64>,
    /// Ratios of the settled frames in ascending order, without NaN.
    pub settled: Vec<f64>,
    /// Mean over the settled frames; NaN if the run has none.
    pub mean: f64,
    /// 99th percentile of the settled frames; NaN if the run has none.
    pub p99: f64,
    /// Number of frames after each event until eight in a row are, on average, within a tenth of what
    /// they settle to; all remaining frames if that never happens; absent where there is no optimum.
    pub recovery_frames: [Option<usize>; 3],
    /// Share of tiles that were traced more than once.
    pub duplicates: f64,
    /// Largest ratio of the frames in flight at the death and of the 50 after it; NaN if there is no
    /// optimum.
    pub worst_after_death: f64,
    /// Mean over the settled frames of the standard deviation of the nodes' response times, in seconds.
    pub response_deviation_secs: f64,
    /// Frames that were not delivered, or not submitted because too many were in flight.
    pub lost: u64,
}

impl Score {
    /// Score of a run of `frames` frames whose optimum is `optimum_secs`, submitted `period_secs` apart
    /// if they are pipelined. Before the frames `events` a node slowed down, one died and one joined:
    /// `frames` or more for an event that did not happen.
    pub fn new(
        frames: u64,
        period_secs: Option<f64>,
        events: [u64; 3],
        report: &SimulationReport,
        optimum_secs: &[f64],
    ) -> Self {
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
        let hit = events.map(|event| first_in_flight(event, period_secs, report));
        let settled = settled(quarter, hit, ratios.len());
        let mut sorted: Vec<f64> = settled.iter().map(|index| ratios[*index]).collect();
        sorted.retain(|ratio| ratio.is_finite());
        sorted.sort_by(f64::total_cmp);
        let deviations = settled
            .iter()
            .map(|index| report.frames[*index].stats.response_deviation_secs());
        let tiles = u64::from(report.tiles_per_frame) * report.frames.len() as u64;
        let until = events[1] + AFTER_DEATH;
        let worst = ratios.iter().take(until).skip(hit[1]);
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
            settled: sorted,
            ratios,
        }
    }
}

/// First frame that was not complete when `event` was submitted: the event has affected it too.
fn first_in_flight(event: usize, period_secs: Option<f64>, report: &SimulationReport) -> usize {
    let Some(period_secs) = period_secs else {
        return event;
    };
    let in_flight = |index: &usize| {
        let ago_secs = (event - index) as f64 * period_secs;
        report.frames[*index].stats.makespan_secs > ago_secs
    };
    let before = event.saturating_sub(FRAMES_IN_FLIGHT_MAX)..event.min(report.frames.len());
    before.into_iter().find(in_flight).unwrap_or(event)
}

/// Indices of the frames that are well after the start and after each event.
fn settled(quarter: usize, events: [usize; 3], frames: usize) -> Vec<usize> {
    // A sixteenth of the frames after an event, an eighth after the start.
    let is_settled = |index: &usize| match events.iter().filter(|event| *event <= index).max() {
        Some(event) => index - event >= quarter / 4,
        None => *index >= quarter / 2,
    };
    (0..frames).filter(is_settled).collect()
}

/// Frames from `event` until the moving average is within a tenth of the mean of the later half.
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
        .or(Some(after.len()))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value;
        count += 1.0;
    }
    if count > 0.0 { sum / count } else { f64::NAN }
}

/// Length of the moving average in frames.
const WINDOW: usize = 8;
/// Number of frames in which a death may show.
const AFTER_DEATH: usize = 50;

#[cfg(test)]
mod tests {
    use carom_protocol::FrameId;
    use carom_tracer::ImageSize;

    use super::*;
    use crate::simulator::PERIOD_SECS;
    use carom_farm::{Frame, FrameStats, Pixels};

    /// Frames of three periods each, of which the one before the death takes two seconds.
    fn report() -> SimulationReport {
        let frame = |id| Frame {
            id: FrameId(id),
            size: ImageSize::new(1, 1),
            pixels: Pixels::Linear(Vec::new()),
            missing: Vec::new(),
            stats: FrameStats {
                makespan_secs: if id == 198 { 2.0 } else { 3.0 * PERIOD_SECS },
                ..FrameStats::default()
            },
        };
        SimulationReport {
            frames: (0..400).map(frame).collect(),
            tiles_per_frame: 1,
            ..SimulationReport::default()
        }
    }

    #[test]
    fn a_death_hits_the_frames_that_are_in_flight_then() {
        let optimum = [PERIOD_SECS; 400];
        let score = |period| Score::new(400, period, [400, 200, 400], &report(), &optimum);
        let pipelined = score(Some(PERIOD_SECS));
        assert!((pipelined.worst_after_death - 120.0).abs() < 1e-9);
        assert!((pipelined.mean - 3.0).abs() < 1e-9, "{}", pipelined.mean);
        let closed = score(None);
        assert!((closed.worst_after_death - 3.0).abs() < 1e-9);
        assert!(closed.mean > 3.1, "{}", closed.mean);
    }
}
