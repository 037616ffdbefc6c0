//! Frames that must be shown at a certain time: handed over then as they are, and again when they
//! are whole.

use std::time::Duration;

use carom_protocol::FrameId;

use super::frame_queue::FrameInFlight;
use super::{Coordinator, CoordinatorAction};
use crate::Frame;

impl Coordinator {
    /// Hands the frame over at `at` as it is, if it is not whole by then. Deadlines of later frames
    /// must not be earlier.
    pub fn set_deadline(&mut self, id: FrameId, at: Duration) {
        if let Some(frame) = self.frames.by_id(id) {
            frame.deadline = Some(at.as_secs_f64());
            frame.perishes = true;
        }
    }

    /// Hands over the newest frame whose deadline has passed; those before it will not be shown any
    /// more, and what is still asked of nodes for them is taken back.
    pub(super) fn show_due(&mut self, now: f64) {
        let due = |frame: &&FrameInFlight| frame.deadline.is_some_and(|at| at <= now);
        let Some(newest) = self.frames.iter().filter(due).map(|frame| frame.id).last() else {
            return;
        };
        let frames = self.frames.iter();
        let stale = frames.filter(|frame| frame.id < newest && frame.perishes);
        let stale: Vec<FrameId> = stale.map(|frame| frame.id).collect();
        for id in stale {
            self.release(now, id);
            self.frames.remove(id);
        }
        let Some(frame) = self.frames.by_id(newest) else {
            return;
        };
        frame.deadline = None;
        let handed_over = match frame.finished.take() {
            Some(whole) => {
                self.frames.remove(newest);
                whole
            }
            None => match frame.as_it_is(now) {
                Some(parts) => parts,
                None => return,
            },
        };
        self.actions
            .push_back(CoordinatorAction::Deliver(Box::new(handed_over)));
        self.advance(now);
    }
}

impl FrameInFlight {
    /// What is there of it; nothing if it is finished.
    fn as_it_is(&mut self, now: f64) -> Option<Frame> {
        let film = self.film.as_ref()?;
        let late = film.missing(self.passes.all(), |_| true);
        self.stats.late_tiles = late.iter().map(|run| run.count).sum();
        let mut stats = self.stats.clone();
        stats.makespan_secs = now - self.submitted;
        Some(Frame {
            id: self.id,
            size: self.spec.size,
            pixels: film.pixels(),
            missing: film.lacking(),
            stats,
        })
    }
}
