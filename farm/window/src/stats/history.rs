//! History of the last pictures, in bounded memory.

use std::collections::VecDeque;
use std::sync::Arc;

use carom_farm::{Balancing, NodeStatus};

use super::frame_record::{FrameRecord, FrameSample};

/// History of the last [`History::FRAMES_MAX`] pictures, and the results of each balancing so far.
#[derive(Debug, Default)]
pub struct History {
    records: VecDeque<Arc<FrameRecord>>,
    detail_bytes: usize,
    /// Index of the first record that still has its detail.
    detailed_from: usize,
    names: Vec<Arc<str>>,
    tallies: Vec<AlgorithmSummary>,
}

/// Results of a balancing since the program began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlgorithmSummary {
    /// The balancing.
    pub balancing: Balancing,
    /// Number of pictures.
    pub frames: u64,
    efficiency_sum: f64,
    deviation_sum: f64,
    max_sum: f64,
}

impl AlgorithmSummary {
    fn of(balancing: Balancing) -> Self {
        Self {
            balancing,
            frames: 0,
            efficiency_sum: 0.0,
            deviation_sum: 0.0,
            max_sum: 0.0,
        }
    }

    /// Mean balance efficiency.
    pub fn efficiency(&self) -> f64 {
        self.mean(self.efficiency_sum)
    }

    /// Mean of the standard deviations of response times, in seconds.
    pub fn deviation_secs(&self) -> f64 {
        self.mean(self.deviation_sum)
    }

    /// Mean of the longest response times, in seconds.
    pub fn max_secs(&self) -> f64 {
        self.mean(self.max_sum)
    }

    fn mean(&self, sum: f64) -> f64 {
        sum / self.frames.max(1) as f64
    }
}

impl History {
    /// Maximum number of pictures: ten seconds at 60 a second.
    pub const FRAMES_MAX: usize = 600;
    /// Maximum bytes of the details of pictures; the newest picture always keeps its detail.
    pub const DETAIL_BYTES_MAX: usize = 16 << 20;

    /// Adds a finished picture and returns its record.
    pub fn push(&mut self, seen: FrameSample<'_>) -> Arc<FrameRecord> {
        self.follow_names(seen.nodes);
        let record = Arc::new(FrameRecord::new(seen, &self.names));
        self.tally(&record);
        self.detail_bytes += detail_bytes(&record);
        self.records.push_back(Arc::clone(&record));
        if self.records.len() > Self::FRAMES_MAX
            && let Some(oldest) = self.records.pop_front()
        {
            self.detail_bytes -= detail_bytes(&oldest);
            self.detailed_from = self.detailed_from.saturating_sub(1);
        }
        while self.detail_bytes > Self::DETAIL_BYTES_MAX
            && self.detailed_from + 1 < self.records.len()
        {
            let record = &mut self.records[self.detailed_from];
            self.detail_bytes -= detail_bytes(record);
            // This clones the record if it is held elsewhere, as by frozen charts or a recorder.
            Arc::make_mut(record).detail = None;
            self.detailed_from += 1;
        }
        record
    }

    /// All records, the oldest first.
    pub fn records(&self) -> &VecDeque<Arc<FrameRecord>> {
        &self.records
    }

    /// The newest record.
    pub fn newest(&self) -> Option<&Arc<FrameRecord>> {
        self.records.back()
    }

    /// The results of each balancing that has been used, in the order of first use.
    pub fn tallies(&self) -> &[AlgorithmSummary] {
        &self.tallies
    }

    /// Pictures per second over the history; 0 with fewer than two.
    pub fn rate(&self) -> f64 {
        let ends = self.records.front().zip(self.records.back());
        let secs = ends.map_or(0.0, |(first, last)| last.at_secs - first.at_secs);
        if secs <= 0.0 {
            return 0.0;
        }
        // n records delimit n − 1 intervals.
        (self.records.len() - 1) as f64 / secs
    }

    fn tally(&mut self, record: &FrameRecord) {
        let is_it = |tally: &AlgorithmSummary| tally.balancing == record.balancing;
        let place = self.tallies.iter().position(is_it).unwrap_or_else(|| {
            self.tallies.push(AlgorithmSummary::of(record.balancing));
            self.tallies.len() - 1
        });
        let tally = &mut self.tallies[place];
        tally.frames += 1;
        tally.efficiency_sum += record.efficiency();
        tally.deviation_sum += record.response_mean_and_deviation().1;
        let responses = record.took_part().map(|(_, node)| node.response_secs);
        tally.max_sum += responses.fold(0.0, f64::max);
    }

    /// Updates the nodes' names; one is only allocated when it changes.
    fn follow_names(&mut self, nodes: &[NodeStatus]) {
        self.names.truncate(nodes.len());
        for (index, node) in nodes.iter().enumerate() {
            let name = name_of(node);
            match self.names.get_mut(index) {
                Some(known) if **known == *name => {}
                Some(known) => *known = name.into(),
                None => self.names.push(name.into()),
            }
        }
    }
}

/// Name of a node, or its address while the name is unknown or empty.
pub fn name_of(node: &NodeStatus) -> &str {
    let name = node.info.as_ref().map(|info| info.name.as_str());
    name.filter(|name| !name.is_empty())
        .unwrap_or(&node.address)
}

fn detail_bytes(record: &FrameRecord) -> usize {
    record
        .detail
        .as_ref()
        .map_or(0, super::frame_record::Detail::bytes)
}

#[cfg(test)]
mod tests {
    use carom_farm::{Algorithm, FrameStats};
    use carom_tracer::ImageSize;

    use super::*;

    fn push(history: &mut History, frame: u64, tiles: usize, balancing: Balancing) {
        history.push(FrameSample {
            frame,
            at_secs: frame as f64 / 50.0,
            size: ImageSize::new(1920, 1080),
            samples: 1,
            stats: FrameStats {
                balancing,
                tile_edge: 16,
                tile_work: vec![1.0; tiles],
                ..FrameStats::default()
            },
            nodes: &[],
        });
    }

    #[test]
    fn memory_is_bounded_by_pictures_and_by_bytes() {
        let mut history = History::default();
        for frame in 0..2000 {
            push(&mut history, frame, 8160, Balancing::default());
            let records = history.records();
            let bytes: usize = records.iter().map(|record| detail_bytes(record)).sum();
            assert_eq!(bytes, history.detail_bytes);
            assert!(bytes <= History::DETAIL_BYTES_MAX);
            assert!(records.len() <= History::FRAMES_MAX);
            assert!(records.back().unwrap().detail.is_some());
        }
        let detailed = history
            .records()
            .iter()
            .filter(|record| record.detail.is_some());
        // As many details are kept as fit, those of the newest pictures.
        assert_eq!(detailed.count(), History::DETAIL_BYTES_MAX / (8160 * 4));
        assert_eq!(history.records().len(), History::FRAMES_MAX);
        assert_eq!(history.newest().unwrap().frame, 1999);
        assert!((history.rate() - 50.0).abs() < 1e-9);
    }

    #[test]
    fn the_newest_frame_is_kept_whatever_its_size() {
        let mut history = History::default();
        for frame in 0..3 {
            push(
                &mut history,
                frame,
                History::DETAIL_BYTES_MAX,
                Balancing::default(),
            );
            let detailed = history
                .records()
                .iter()
                .filter(|record| record.detail.is_some());
            assert_eq!(detailed.count(), 1);
        }
    }

    #[test]
    fn each_way_of_dividing_is_counted_by_itself() {
        let mut history = History::default();
        let ways = [
            Algorithm::Equal.unhedged(),
            Algorithm::Ab.hedged(),
            Algorithm::Equal.unhedged(),
        ];
        ways.iter()
            .zip(0..)
            .for_each(|(way, frame)| push(&mut history, frame, 4, *way));
        let tallies = history
            .tallies()
            .iter()
            .map(|tally| (tally.balancing, tally.frames));
        assert_eq!(tallies.collect::<Vec<_>>(), [(ways[0], 2), (ways[1], 1)]);
    }
}
