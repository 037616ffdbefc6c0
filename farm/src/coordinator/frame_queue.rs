//! Queue of the frames in flight in order of service, with their arrival period and deadlines.
//!
//! Background frames come after all others, and their ids are above those of all others, so that nodes,
//! which serve the oldest frame first, serve them last as well.

use std::collections::VecDeque;
use std::time::Duration;

use carom_protocol::FrameId;

use super::frame_in_flight::FrameInFlight;
use super::frame_refusals::FrameRefusal;
use super::node_table::{NodeTable, timer};
use crate::frame::Frame;

/// Frames in flight. Their number is bounded by [`crate::Farm::submit`].
#[derive(Debug, Default)]
pub(super) struct FrameQueue {
    frames: VecDeque<FrameInFlight>,
    last_submit: Option<f64>,
    period_secs: Option<f64>,
}

impl FrameQueue {
    pub(super) fn push(&mut self, frame: FrameInFlight) {
        if frame.id.is_background() {
            self.frames.push_back(frame);
            return;
        }
        let is_interactive = |earlier: &FrameInFlight| !earlier.id.is_background();
        let overlaps = self.unfinished().any(is_interactive);
        let interval = self.last_submit.map(|last| frame.submitted - last);
        self.last_submit = Some(frame.submitted);
        // Frames that do not overlap leave the nodes idle in between: no period bounds their work.
        self.period_secs = match (overlaps, interval, self.period_secs) {
            (false, ..) => None,
            (true, Some(new), Some(old)) => Some(old + PERIOD_GAIN * (new - old)),
            (true, new, None) => new,
            (true, None, old) => old,
        };
        let place = self.oldest(true).unwrap_or(self.frames.len());
        self.frames.insert(place, frame);
    }

    /// The oldest interactive frame if it is finished, else the oldest background frame if that is.
    pub(super) fn pop_finished(&mut self) -> Option<Frame> {
        self.pop_oldest(false).or_else(|| self.pop_oldest(true))
    }

    fn pop_oldest(&mut self, is_background: bool) -> Option<Frame> {
        // A frame that finishes before an older one waits for it: clients rely on the order.
        let place = self.oldest(is_background)?;
        let finished = self.frames[place].finished.take()?;
        self.frames.remove(place);
        Some(finished)
    }

    /// Whether there are unfinished background frames.
    pub(super) fn has_background(&self) -> bool {
        self.unfinished().any(|frame| frame.id.is_background())
    }

    /// Position of the oldest background or interactive frame.
    fn oldest(&self, is_background: bool) -> Option<usize> {
        let mut frames = self.frames.iter();
        frames.position(|frame| frame.id.is_background() == is_background)
    }

    pub(super) fn remove(&mut self, id: FrameId) {
        self.frames.retain(|frame| frame.id != id);
    }

    /// Mean seconds between interactive frames while they overlap, else infinite.
    pub(super) fn period_secs(&self) -> f64 {
        self.period_secs
            .filter(|secs| *secs > 0.0)
            .unwrap_or(f64::INFINITY)
    }

    /// The frame, unless it has been delivered or cancelled.
    pub(super) fn get_mut(&mut self, id: FrameId) -> Option<&mut FrameInFlight> {
        self.frames.iter_mut().find(|frame| frame.id == id)
    }

    /// The unfinished frames in order of service.
    pub(super) fn unfinished(&self) -> impl Iterator<Item = &FrameInFlight> {
        self.frames.iter().filter(|frame| frame.buffer.is_some())
    }

    /// The same, mutable.
    pub(super) fn unfinished_mut(&mut self) -> impl Iterator<Item = &mut FrameInFlight> {
        let frames = self.frames.iter_mut();
        frames.filter(|frame| frame.buffer.is_some())
    }

    /// The refusal of the oldest frame that no node will trace, if there is one.
    pub(super) fn hopeless(&mut self, now: f64, nodes: &NodeTable) -> Option<FrameRefusal> {
        self.unfinished_mut().find_map(|frame| {
            let (id, scene) = (frame.id, frame.scene.hash());
            frame.refusals.give_up(now, id, scene, nodes)
        })
    }

    /// The next deadline or evaluation of a frame.
    pub(super) fn next_timeout(&self) -> Option<Duration> {
        let frames = self.frames.iter();
        let times = frames.flat_map(|frame| [frame.evaluate_at, frame.deadline]);
        times.flatten().reduce(f64::min).map(timer)
    }

    /// Sets the time at which the frame is delivered as it is, unless it is complete before. Deadlines must
    /// not decrease from frame to frame.
    pub(super) fn set_deadline(&mut self, id: FrameId, at: f64) {
        if let Some(frame) = self.get_mut(id) {
            frame.deadline = Some(at);
            frame.perishes = true;
        }
    }

    /// The newest frame whose deadline has passed.
    pub(super) fn newest_due(&self, now: f64) -> Option<FrameId> {
        let is_due = |frame: &&FrameInFlight| frame.deadline.is_some_and(|at| at <= now);
        let mut newest_first = self.frames.iter().rev();
        newest_first.find(is_due).map(|frame| frame.id)
    }

    /// Removes the frames with a deadline before `newest`, which will not be shown any more, and returns
    /// their ids.
    pub(super) fn remove_stale(&mut self, newest: FrameId) -> Vec<FrameId> {
        let is_stale = |frame: &FrameInFlight| frame.id < newest && frame.perishes;
        let frames = self.frames.iter();
        let stale = frames.filter(|frame| is_stale(frame)).map(|frame| frame.id);
        let stale = stale.collect();
        self.frames.retain(|frame| !is_stale(frame));
        stale
    }

    /// Takes a frame at its deadline: for the last time if it is complete, else a partial copy.
    pub(super) fn take_due(&mut self, now: f64, id: FrameId) -> Option<Frame> {
        let frame = self.get_mut(id)?;
        frame.deadline = None;
        match frame.finished.take() {
            Some(whole) => {
                self.remove(id);
                Some(whole)
            }
            None => frame.partial_frame(now),
        }
    }
}

/// Gain of the period's moving average.
const PERIOD_GAIN: f64 = 0.1;

#[cfg(test)]
mod tests {
    use carom_protocol::tile_codec::TilePixels;
    use carom_protocol::{EncodedScene, NodeTimes, PixelFormat};
    use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate, TileGrid};

    use super::super::frame_in_flight::TileArrival;
    use super::super::open_request::OpenRequest;
    use super::super::partition::WorkMap;
    use super::super::sample_passes::SamplePasses;
    use super::*;
    use crate::frame::{FrameSpec, Pixels};
    use crate::node_status::NodeIndex;

    const GRID: TileGrid = TileGrid::new(ImageSize::new(2, 1), 1);

    fn frame(id: u64, submitted: f64) -> FrameInFlight {
        let scene = include_str!("../../../assets/scenes/pool.json");
        let scene = EncodedScene::new(&Scene::from_json(scene).unwrap()).unwrap();
        let spec = FrameSpec {
            update: SceneUpdate::default(),
            size: GRID.size,
            settings: RenderSettings::default(),
            format: PixelFormat::LinearF32,
        };
        let passes = SamplePasses::one(GRID, 1);
        let work = WorkMap::new(passes, &[1.0; 2]);
        FrameInFlight::new(submitted, FrameId(id), spec, scene, passes, work)
    }

    /// Delivers tiles of a frame.
    fn deliver(queue: &mut FrameQueue, id: u64, first: u32, count: u32) {
        deliver_from(queue, NodeIndex(0), id, first, count);
    }

    fn deliver_from(queue: &mut FrameQueue, node: NodeIndex, id: u64, first: u32, count: u32) {
        let frame = queue.get_mut(FrameId(id)).unwrap();
        let tiles = carom_tracer::TileRange { first, count };
        let request = OpenRequest::new(0.0, frame.id, frame.passes, tiles, f64::from(count));
        let arrival = TileArrival {
            tiles,
            pixels: &TilePixels::Linear(vec![[1.0; 3]; count as usize]),
            dropped_samples: 0,
            payload_bytes: 1,
            times: NodeTimes::default(),
            is_lossy: false,
        };
        frame.add_tiles(1.0, node, 2, &request, &arrival);
        frame.finish(1.0);
    }

    #[test]
    fn finished_frames_leave_in_order_of_submission() {
        let mut queue = FrameQueue::default();
        (0..3).for_each(|id| queue.push(frame(id, 0.0)));
        deliver(&mut queue, 1, 0, 2);
        assert!(queue.pop_finished().is_none());
        deliver(&mut queue, 0, 0, 2);
        let ids = [0; 2].map(|_| queue.pop_finished().unwrap().id.0);
        assert_eq!(ids, [0, 1]);
        assert_eq!(queue.unfinished().count(), 1);
    }

    #[test]
    fn tiles_of_a_node_that_is_dropped_are_asked_for_again() {
        let mut queue = FrameQueue::default();
        queue.push(frame(0, 0.0));
        deliver(&mut queue, 0, 0, 1);
        let frame = queue.get_mut(FrameId(0)).unwrap();
        frame.retract(NodeIndex(1));
        let missing = |frame: &FrameInFlight| frame.buffer.as_ref().unwrap().missing_count();
        assert_eq!((missing(frame), frame.stats.deliveries.len()), (1, 1));
        frame.retract(NodeIndex(0));
        assert_eq!((missing(frame), frame.stats.tiles_by_node[0]), (2, 0));
        deliver(&mut queue, 0, 0, 2);
        assert!(queue.pop_finished().is_some());
    }

    #[test]
    fn tiles_that_a_dropped_node_has_sent_after_another_stay() {
        let mut queue = FrameQueue::default();
        queue.push(frame(0, 0.0));
        for node in [0, 1].map(NodeIndex) {
            deliver_from(&mut queue, node, 0, 0, 1);
        }
        let frame = queue.get_mut(FrameId(0)).unwrap();
        frame.retract(NodeIndex(1));
        let missing = frame.buffer.as_ref().unwrap().missing_count();
        assert_eq!((missing, frame.stats.deliveries.len()), (1, 1));
    }

    #[test]
    fn background_frames_are_served_last() {
        let mut queue = FrameQueue::default();
        let first = FrameId::BACKGROUND_FIRST.0;
        for (id, submitted) in [
            (0, 0.0),
            (first, 0.01),
            (1, 0.1),
            (first + 1, 0.15),
            (2, 0.2),
        ] {
            queue.push(frame(id, submitted));
        }
        let order: Vec<u64> = queue.unfinished().map(|frame| frame.id.0).collect();
        assert_eq!(order, [0, 1, 2, first, first + 1]);
        assert!((queue.period_secs() - 0.1).abs() < 1e-12);
        deliver(&mut queue, first + 1, 0, 2);
        assert!(queue.pop_finished().is_none());
        deliver(&mut queue, first, 0, 2);
        let ids = [0; 2].map(|_| queue.pop_finished().unwrap().id.0);
        assert_eq!(ids, [first, first + 1]);
        queue.remove(FrameId(1));
        assert_eq!(queue.unfinished().count(), 2);
    }

    #[test]
    fn period_follows_frames_that_overlap() {
        let mut queue = FrameQueue::default();
        queue.push(frame(0, 0.0));
        assert_eq!(queue.period_secs(), f64::INFINITY);
        queue.push(frame(1, 0.1));
        assert_eq!(queue.period_secs(), 0.1);
        queue.push(frame(2, 0.3));
        assert!((queue.period_secs() - 0.11).abs() < 1e-12);
        (0..3).for_each(|id| queue.remove(FrameId(id)));
        queue.push(frame(9, 0.4));
        assert_eq!(queue.period_secs(), f64::INFINITY);
    }

    #[test]
    fn due_frame_comes_in_part_and_ends_older_ones() {
        let mut queue = FrameQueue::default();
        (0..3).for_each(|id| queue.push(frame(id, 0.0)));
        (1..3).for_each(|id| queue.set_deadline(FrameId(id), id as f64));
        queue.set_deadline(FrameId(0), 0.5);
        deliver(&mut queue, 1, 1, 1);
        assert_eq!(queue.next_timeout(), Some(timer(0.5)));
        let due = queue.newest_due(1.5).unwrap();
        assert_eq!(
            (due, queue.remove_stale(due)),
            (FrameId(1), vec![FrameId(0)])
        );
        let part = queue.take_due(1.5, due).unwrap();
        assert_eq!(part.pixels, Pixels::Linear(vec![[0.0; 3], [1.0; 3]]));
        assert_eq!((part.missing.len(), part.stats.late_tiles), (1, 1));
        // It is delivered again when it is complete, even before frames that have not been shown.
        deliver(&mut queue, 1, 0, 1);
        assert!(
            queue
                .pop_finished()
                .is_some_and(|whole| whole.missing.is_empty())
        );
        assert_eq!(queue.newest_due(1.9), None);
    }
}
