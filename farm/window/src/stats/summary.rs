//! Summary for the panels, computed from the history a few times a second: figures that change at frame rate
//! cannot be read, and percentiles need not be computed as often.

use std::sync::Arc;

use carom_farm::{NodeState, NodeStatus};
use carom_text::text;

use super::StatsInput;
use super::frame_rate::{FrameRate, Rates};
use super::frame_record::{FrameRecord, NodeRecord, mean_and_deviation};
use super::glossary;
use super::history::{History, name_of};
use crate::notifications::megabytes;

/// Figures over the whole history, and of the inspected picture.
#[derive(Debug, Default)]
pub struct StatsSummary {
    /// Redraws per second.
    pub rates: Rates,
    /// Pictures per second.
    pub pictures_per_sec: f64,
    /// The inspected picture.
    pub record: Option<Arc<FrameRecord>>,
    /// The nodes, by index.
    pub nodes: Vec<NodeSummary>,
    /// Number of nodes that are ready to trace.
    pub ready: usize,
    /// Megabits of pixels per second.
    pub mbit_per_sec: f64,
    /// Ratio of raw bytes to bytes on the wire.
    pub ratio: f64,
    /// Tiles requested again because they would have been late.
    pub late: u64,
    /// Tiles requested again because their node was lost.
    pub lost: u64,
    /// Tiles that arrived twice.
    pub twice: u64,
    /// Samples that were not finite and count as black.
    pub dropped: u64,
}

/// Figures of a node over the whole history.
#[derive(Clone, Debug, Default)]
pub struct NodeSummary {
    /// Its name, or else its address.
    pub name: String,
    /// Its device.
    pub device: String,
    /// Its state in a word.
    pub state: String,
    /// Its state in a sentence.
    pub state_sentence: String,
    /// Whether it is ready to trace.
    pub is_ready: bool,
    /// Mean response time in seconds.
    pub mean_secs: f64,
    /// Standard deviation of the response time in seconds.
    pub deviation_secs: f64,
    /// 99th percentile of the response time in seconds.
    pub p99_secs: f64,
    /// Maximum response time in seconds.
    pub max_secs: f64,
    /// Tiles that arrived well after their prediction.
    pub late: u64,
    /// Tiles lost by this node since the program began.
    pub lost: u64,
    /// Tiles that another node had delivered before.
    pub twice: u64,
}

impl StatsSummary {
    /// The summary of `history`, and of `record` in it.
    pub fn new(
        history: &History,
        redraws: &FrameRate,
        record: Option<Arc<FrameRecord>>,
        input: &StatsInput<'_>,
    ) -> Self {
        let records = history.records();
        let sum = |value: fn(&FrameRecord) -> u64| records.iter().map(|record| value(record)).sum();
        let (bytes, raw): (u64, u64) = (sum(|r| r.payload_bytes), sum(|r| r.raw_bytes));
        let per_picture = bytes as f64 / records.len().max(1) as f64;
        let pictures_per_sec = history.rate();
        let nodes = NodeSummary::all(history, input);
        Self {
            rates: redraws.rates(),
            pictures_per_sec,
            record,
            ready: nodes.iter().filter(|node| node.is_ready).count(),
            nodes,
            mbit_per_sec: per_picture * pictures_per_sec * 8e-6,
            ratio: if bytes > 0 {
                raw as f64 / bytes as f64
            } else {
                1.0
            },
            late: sum(|r| u64::from(r.reissued_tiles.saturating_sub(r.lost_tiles))),
            lost: sum(|r| u64::from(r.lost_tiles)),
            twice: sum(|r| u64::from(r.duplicate_tiles)),
            dropped: sum(|r| r.dropped_samples),
        }
    }

    /// A sentence about the picture's worst problem.
    pub fn diagnosis(&self) -> String {
        let Some(record) = &self.record else {
            return text!("stats-diagnosis-no-frame").to_owned();
        };
        let Some((index, node)) = straggler(record) else {
            return text!("stats-diagnosis-no-tile").to_owned();
        };
        let name = &*node.name;
        let time = stage(node);
        if record.took_part().count() == 1 {
            return text!(
                "stats-diagnosis-alone",
                node = index,
                name = name,
                time = time
            );
        }
        if record.efficiency() > GOOD {
            let unused = self.nodes.iter().filter(|node| !node.is_ready).count();
            return text!("stats-diagnosis-balanced", unused = unused);
        }
        text!(
            "stats-diagnosis-straggler",
            node = index,
            name = name,
            time = time
        )
    }
}

impl NodeSummary {
    /// Summaries of all nodes in a single pass over the long history.
    fn all(history: &History, input: &StatsInput<'_>) -> Vec<Self> {
        let mut nodes: Vec<Self> = input.nodes.iter().map(Self::of_status).collect();
        let mut responses = vec![Vec::with_capacity(history.records().len()); nodes.len()];
        for record in history.records() {
            let of_record = record
                .nodes
                .iter()
                .zip(nodes.iter_mut().zip(&mut responses));
            for (seen, (node, responses)) in of_record.filter(|(seen, _)| seen.tiles > 0) {
                responses.push(seen.response_secs);
                node.late += u64::from(seen.late_tiles);
                node.twice += u64::from(seen.duplicate_tiles);
            }
        }
        for (node, responses) in nodes.iter_mut().zip(&mut responses) {
            (node.mean_secs, node.deviation_secs) = mean_and_deviation(responses);
            node.max_secs = responses.iter().copied().fold(0.0, f64::max);
            if !responses.is_empty() {
                let place = (responses.len() - 1) * 99 / 100;
                node.p99_secs = *responses.select_nth_unstable_by(place, f64::total_cmp).1;
            }
        }
        nodes
    }

    fn of_status(status: &NodeStatus) -> Self {
        let state = match &status.state {
            NodeState::Syncing { bytes, of } if *of > 0 => text!(
                "stats-state-syncing-bytes",
                bytes = megabytes(*bytes),
                of = megabytes(*of)
            ),
            NodeState::Lost {
                why,
                retry_secs: Some(secs),
            } => text!("stats-state-lost-retried", why = why, seconds = secs),
            NodeState::Lost { why, .. } => text!("stats-state-lost-why", why = why),
            state => text!(&format!("stats-state-{}", state.word())).to_owned(),
        };
        let state_sentence = match &status.doubt {
            Some(doubt) => text!("stats-state-doubted", state = state, doubt = doubt),
            None => state,
        };
        let device = status.info.as_ref().map(|info| info.device.name.clone());
        Self {
            name: name_of(status).to_owned(),
            device: device.unwrap_or_default(),
            state: match status.state {
                NodeState::Lost { .. } => text!("stats-state-lost").to_owned(),
                _ => state_sentence.clone(),
            },
            state_sentence,
            is_ready: status.state.is_ready(),
            lost: status.lost_tiles,
            ..Self::default()
        }
    }
}

fn straggler(record: &FrameRecord) -> Option<(usize, &NodeRecord)> {
    let index = record.straggler?;
    Some((index, record.nodes.get(index)?))
}

/// A phrase about the longest latency stage of a node's last tile.
fn stage(node: &NodeRecord) -> String {
    let longest = glossary::stages(&node.split)
        .into_iter()
        .max_by(|a, b| a.1.total_cmp(&b.1));
    longest.map_or_else(String::new, |(term, secs)| {
        let [part, whole] = [secs, node.response_secs].map(|secs| format!("{:.1}", secs * 1e3));
        text!(
            "stats-diagnosis-time",
            stage = term.id,
            part = part,
            whole = whole
        )
    })
}

/// Efficiency above which a picture counts as balanced.
const GOOD: f64 = 0.9;

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use carom_farm::LatencySplit;

    use super::*;

    #[test]
    fn each_stage_is_named_in_words_of_its_own() {
        let named = |(term, _): (&glossary::Term, f64)| {
            text!(
                "stats-diagnosis-time",
                stage = term.id,
                part = "",
                whole = ""
            )
        };
        let stages = glossary::stages(&LatencySplit::default());
        let texts: BTreeSet<String> = stages.into_iter().map(named).collect();
        assert_eq!(texts.len(), stages.len());
    }
}
