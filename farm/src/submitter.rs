//! Client of the coordinator's thread: submits frames and receives them. A farm has its own, and so has
//! each render that runs on it; none sees the frames of another.

use std::collections::VecDeque;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use carom_protocol::FrameId;
use carom_protocol::limits::FRAMES_IN_FLIGHT_MAX;

use crate::coordinator::FrameRefusal;
use crate::driver::{DriverInput, FarmBoard, FrameReply};
use crate::lock::lock;
use crate::{Error, Frame, FrameSpec, NodeState, NodeStatus, Priority, SceneHandle, Submission};

/// Handle for submitting frames, see the [module](self).
pub(crate) struct Submitter {
    inputs: Sender<DriverInput>,
    board: Arc<Mutex<FarmBoard>>,
    ids: Arc<Mutex<FrameIds>>,
    replies: Sender<FrameReply>,
    frames: Receiver<FrameReply>,
    frames_in_flight_max: usize,
    timeout_secs: Option<u32>,
    /// Frames submitted and neither taken complete nor cancelled, and whether they have a deadline.
    in_flight: VecDeque<(FrameId, bool)>,
    /// The last frame that every node has refused, until [`Submitter::check_nodes`] reports it.
    refusal: Option<FrameRefusal>,
    /// Since when [`Submitter::check_nodes`] has found no node that could trace.
    idle_since: Option<Instant>,
    /// Whether that has been logged.
    idle_reported: bool,
}

/// The next ids of all clients by priority, increasing in the order of submission.
struct FrameIds {
    interactive: FrameId,
    background: FrameId,
}

impl Submitter {
    pub(crate) fn new(
        inputs: Sender<DriverInput>,
        board: Arc<Mutex<FarmBoard>>,
        frames_in_flight_max: usize,
        timeout_secs: Option<u32>,
    ) -> Self {
        let ids = FrameIds {
            interactive: FrameId(0),
            background: FrameId::BACKGROUND_FIRST,
        };
        let (replies, frames) = mpsc::channel();
        Self {
            inputs,
            board,
            ids: Arc::new(Mutex::new(ids)),
            replies,
            frames,
            frames_in_flight_max,
            timeout_secs,
            in_flight: VecDeque::new(),
            refusal: None,
            idle_since: None,
            idle_reported: false,
        }
    }

    /// Another client of the same farm.
    pub(crate) fn another(&self) -> Self {
        let (replies, frames) = mpsc::channel();
        Self {
            inputs: self.inputs.clone(),
            board: Arc::clone(&self.board),
            ids: Arc::clone(&self.ids),
            replies,
            frames,
            in_flight: VecDeque::new(),
            refusal: None,
            idle_since: None,
            ..*self
        }
    }

    pub(crate) fn submit(
        &mut self,
        spec: FrameSpec,
        submission: Submission,
        scene: SceneHandle,
    ) -> Result<FrameId, Error> {
        let is_background = submission.priority == Priority::Background;
        let most = match submission.priority {
            Priority::Interactive => self.frames_in_flight_max,
            Priority::Background => FRAMES_IN_FLIGHT_MAX,
        };
        let is_equal = |(id, _): &&(FrameId, bool)| id.is_background() == is_background;
        let in_flight = self.in_flight.iter().filter(is_equal).count();
        if in_flight >= most {
            return Err(Error::FramesInFlight { in_flight });
        }
        scene.check(&spec)?;
        let deadline = submission.deadline.filter(|_| !is_background);
        // Locked until the frame is sent: the coordinator expects increasing ids.
        let mut ids = lock(&self.ids);
        let next = match submission.priority {
            Priority::Interactive => &mut ids.interactive,
            Priority::Background => &mut ids.background,
        };
        let id = *next;
        let sent = self.inputs.send(DriverInput::Submit {
            id,
            spec: Box::new(spec),
            scene: scene.encoded,
            deadline,
            exact: submission.exact,
            replies: self.replies.clone(),
        });
        sent.map_err(|_| Error::FarmClosed)?;
        *next = FrameId(id.0 + 1);
        self.in_flight.push_back((id, deadline.is_some()));
        Ok(id)
    }

    pub(crate) fn poll_frame(&mut self) -> Option<Frame> {
        loop {
            let reply = self.frames.try_recv().ok()?;
            if let Some(frame) = self.take(reply) {
                return Some(frame);
            }
        }
    }

    pub(crate) fn wait_frame(&mut self, patience: Duration) -> Option<Frame> {
        let deadline = Instant::now() + patience;
        while !self.in_flight.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.frames.recv_timeout(left) {
                Ok(reply) => {
                    if let Some(frame) = self.take(reply) {
                        return Some(frame);
                    }
                    if self.refusal.is_some() {
                        return None;
                    }
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return None,
            }
        }
        None
    }

    pub(crate) fn cancel_before(&mut self, id: FrameId) {
        let earlier = self.in_flight.iter().map(|(frame, _)| *frame);
        let earlier: Vec<FrameId> = earlier.filter(|frame| *frame < id).collect();
        earlier.into_iter().for_each(|frame| self.cancel(frame));
    }

    pub(crate) fn cancel(&mut self, id: FrameId) {
        self.in_flight.retain(|(frame, _)| *frame != id);
        // A farm that has ended traces nothing anyway.
        let _ = self.inputs.send(DriverInput::Cancel(id));
    }

    pub(crate) fn in_flight(&self) -> usize {
        let is_interactive = |(id, _): &&(FrameId, bool)| !id.is_background();
        self.in_flight.iter().filter(is_interactive).count()
    }

    pub(crate) fn nodes(&self) -> Vec<NodeStatus> {
        let board = lock(&self.board);
        board.nodes.clone()
    }

    /// Tiles of this client's frames that have arrived, and all of them.
    pub(crate) fn tiles_in_flight(&self) -> (u32, u32) {
        let board = lock(&self.board);
        let own = |id: &FrameId| self.in_flight.iter().any(|(frame, _)| frame == id);
        let frames = board.frames.iter().filter(|(id, ..)| own(id));
        frames.fold((0, 0), |(done, all), (_, more, of)| (done + more, all + of))
    }

    /// As [`crate::Farm::check_nodes`], plus [`Error::FarmClosed`] if the farm has ended.
    pub(crate) fn check_nodes(&mut self) -> Result<(), Error> {
        if let Some(refusal) = self.refusal.take() {
            return Err(Error::FrameRefused(refusal));
        }
        let alive = self.inputs.send(DriverInput::Nothing);
        alive.map_err(|_| Error::FarmClosed)?;
        let nodes = self.nodes();
        let is_idle =
            |node: &NodeStatus| matches!(node.state, NodeState::Starting | NodeState::Lost { .. });
        if !nodes.iter().all(is_idle) {
            self.idle_since = None;
            self.idle_reported = false;
            return Ok(());
        }
        // A node that is only silent is still connected, and may be tracing a long tile.
        let is_gone =
            |node: &NodeStatus| node.info.is_none() && matches!(node.state, NodeState::Lost { .. });
        let patience = match (self.timeout_secs, nodes.iter().all(is_gone)) {
            (Some(0), _) => Duration::MAX,
            (Some(secs), _) => Duration::from_secs(secs.into()),
            (None, true) => LOST_PATIENCE,
            (None, false) => START_PATIENCE,
        };
        let since = self.idle_since.get_or_insert_with(Instant::now).elapsed();
        let silence = Error::NoNodes { since, nodes };
        if since >= patience {
            return Err(silence);
        }
        if since >= REPORT_AFTER && !self.idle_reported {
            self.idle_reported = true;
            tracing::warn!("waiting for nodes: {silence}");
        }
        Ok(())
    }

    fn take(&mut self, reply: FrameReply) -> Option<Frame> {
        let frame = match reply {
            Ok(frame) => frame,
            Err(refusal) => {
                self.in_flight.retain(|(id, _)| *id != refusal.frame);
                self.refusal = Some(refusal);
                return None;
            }
        };
        self.idle_since = None;
        // A frame that is not in flight has been cancelled while it was being delivered.
        let place = self.in_flight.iter().position(|(id, _)| *id == frame.id)?;
        let (_, has_deadline) = self.in_flight[place];
        if frame.missing.is_empty() {
            self.in_flight.remove(place);
        }
        if has_deadline {
            // At its deadline, a frame ends the earlier ones with deadlines: the coordinator has dropped
            // them.
            let comes = |(id, has_deadline): &(FrameId, bool)| *id >= frame.id || !has_deadline;
            self.in_flight.retain(comes);
        }
        Some(frame)
    }
}

/// Cancels the frames that nobody will take.
impl Drop for Submitter {
    fn drop(&mut self) {
        while let Some((id, _)) = self.in_flight.front().copied() {
            self.cancel(id);
        }
    }
}

/// Timeout for the first node: a GPU takes a second to start, a failing connection some seconds.
const START_PATIENCE: Duration = Duration::from_secs(60);
/// Wait after which the reasons are logged.
const REPORT_AFTER: Duration = Duration::from_secs(3);
/// Timeout for nodes when no connection is left.
const LOST_PATIENCE: Duration = Duration::from_secs(10);
