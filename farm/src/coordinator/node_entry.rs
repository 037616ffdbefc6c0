//! A node as the coordinator knows it: its connection, its scenes, back-off after failures, and its
//! [`Workload`].

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use carom_protocol::limits::REQUESTS_QUEUED_MAX;
use carom_protocol::{FrameId, NodeInfo, NodeLoad, RequestId, SceneHash};

use super::workload::Workload;
use crate::node_status::{NodeState, NodeStatus};
use crate::stats::LatencySplit;

/// State of one node. Times are seconds on the client's clock.
#[derive(Debug)]
pub(super) struct NodeEntry {
    address: String,
    /// Whether it runs in this process, so that its pixels are taken as correct.
    pub(super) is_local: bool,
    connection: ConnectionState,
    /// Scenes that it has reported ready.
    scenes: BTreeSet<SceneHash>,
    /// The scene that is being sent to it, its bytes received so far, and its total bytes.
    scene_progress: Option<(SceneHash, u64, u64)>,
    /// Scenes that it cannot use, with the reasons.
    scenes_refused: BTreeMap<SceneHash, String>,
    pub(super) workload: Workload,
    pause: Option<Pause>,
    /// Whether it is shutting down and gets no more requests.
    pub(super) leaving: bool,
    has_said_farewell: bool,
    /// Failures since it last sent valid tiles.
    failures: u32,
    tiles: u64,
    lost_tiles: u64,
    /// Its tiles that other nodes have traced again.
    checked_tiles: u64,
    /// The last undecided disagreement about pixels with other nodes.
    doubt: Option<String>,
    split: LatencySplit,
    /// Load by other clients, as of its last pong.
    load: NodeLoad,
    ping: PingState,
    pub(super) last_probe: Option<FrameId>,
    /// Latest time at which [`super::node_table::NodeTable::next_due`] will name it.
    pub(super) armed: Option<Duration>,
}

#[derive(Debug)]
pub(super) enum ConnectionState {
    /// Connecting; `lost` is the reason why the connection or attempt before has ended.
    Connecting {
        lost: Option<String>,
    },
    Open(NodeInfo),
    Lost {
        why: String,
        retry_at: Option<f64>,
    },
}

/// Back-off after a refusal, during which the node gets no requests.
#[derive(Debug)]
struct Pause {
    until: f64,
    /// Absent if the node was only busy.
    why: Option<String>,
}

#[derive(Debug, Default)]
struct PingState {
    number: u64,
    /// When the unanswered ping was sent.
    sent: Option<f64>,
    next: f64,
    round_trip_secs: Option<f64>,
}

impl NodeEntry {
    pub(super) fn new(address: String) -> Self {
        Self {
            address,
            is_local: false,
            connection: ConnectionState::Connecting { lost: None },
            scenes: BTreeSet::new(),
            scene_progress: None,
            scenes_refused: BTreeMap::new(),
            workload: Workload::default(),
            pause: None,
            leaving: false,
            has_said_farewell: false,
            failures: 0,
            tiles: 0,
            lost_tiles: 0,
            checked_tiles: 0,
            doubt: None,
            split: LatencySplit::default(),
            load: NodeLoad::default(),
            ping: PingState::default(),
            last_probe: None,
            armed: None,
        }
    }

    /// Begins a connection; the state of an earlier one is discarded.
    pub(super) fn open(&mut self, now: f64, info: NodeInfo) {
        self.reset(ConnectionState::Open(info));
        self.ping = PingState {
            next: now,
            ..PingState::default()
        };
    }

    /// Discards all state that belongs to a connection.
    pub(super) fn reset(&mut self, connection: ConnectionState) {
        self.connection = connection;
        self.scenes.clear();
        self.scene_progress = None;
        self.scenes_refused.clear();
        // The learned costs survive, as it is most likely the same node when it returns.
        self.lost_tiles += self.workload.clear();
        self.pause = None;
        self.leaving = false;
        self.has_said_farewell = false;
        self.failures = 0;
    }

    /// Whether it must be told, once, that everything has arrived: it is leaving, and no request is open.
    pub(super) fn says_farewell(&mut self) -> bool {
        let owes_nothing = self.leaving && self.workload.requests.is_empty();
        owes_nothing && !std::mem::replace(&mut self.has_said_farewell, true)
    }

    /// Records that it is ready for a scene. Returns whether it was not before.
    pub(super) fn scene_ready(&mut self, hash: SceneHash) -> bool {
        self.scenes_refused.remove(&hash);
        self.scenes.insert(hash)
    }

    pub(super) fn scene_coming(&mut self, hash: SceneHash, bytes: u64, of: u64) {
        self.scenes.remove(&hash);
        self.scene_progress = Some((hash, bytes, of));
    }

    pub(super) fn scene_refused(&mut self, hash: SceneHash, why: String) {
        if self.scenes_refused.len() >= SCENES_REFUSED_MAX {
            self.scenes_refused.pop_first();
        }
        self.scenes_refused.insert(hash, why);
    }

    /// Counts tiles that have arrived, and records where their time went.
    pub(super) fn count_tiles(&mut self, tiles: u32, split: LatencySplit) {
        self.split = split;
        self.tiles += u64::from(tiles);
    }

    /// Resets the failure count after valid tiles.
    pub(super) fn forgive(&mut self) {
        self.failures = 0;
    }

    /// Whether no failure has occurred since its last valid tiles.
    pub(super) fn is_trusted(&self) -> bool {
        self.failures == 0
    }

    /// Backs off after a refusal: exponentially if `why` names a fault of the node or its device, else
    /// briefly, as the node was only busy.
    pub(super) fn back_off(&mut self, now: f64, why: Option<String>) {
        // Exponential back-off; the shift is clamped against overflow.
        let secs = match why {
            Some(_) => (PAUSE_SECS * f64::from(1 << self.failures.min(10))).min(PAUSE_SECS_MAX),
            None => BUSY_PAUSE_SECS,
        };
        self.failures += u32::from(why.is_some());
        self.pause = Some(Pause {
            until: now + secs,
            why,
        });
    }

    /// Ends the back-off if its time has passed. Returns whether it did.
    pub(super) fn resume(&mut self, now: f64) -> bool {
        let over = self.pause.as_ref().is_some_and(|pause| pause.until <= now);
        if over {
            self.pause = None;
        }
        over
    }

    /// The number of the ping to send, if one is due.
    pub(super) fn ping(&mut self, now: f64) -> Option<u64> {
        if self.ping_due()? > now {
            return None;
        }
        self.ping.number += 1;
        self.ping.sent = Some(now);
        self.ping.next = now + PING_SECS;
        Some(self.ping.number)
    }

    pub(super) fn pong(&mut self, now: f64, number: u64, load: NodeLoad) {
        self.load = load;
        if number == self.ping.number
            && let Some(sent) = self.ping.sent.take()
        {
            self.ping.round_trip_secs = Some(now - sent);
        }
    }

    /// Marks a request as cancelled, and learns from its lateness.
    pub(super) fn cancel(&mut self, now: f64, id: RequestId) {
        self.workload.cancel(now, id, self.ping.round_trip_secs);
    }

    /// Learns provisionally from the first tiles of its first request.
    pub(super) fn observe_first(&mut self, id: RequestId) {
        let round_trip_secs = self.ping.round_trip_secs;
        if let Some(seen) = self.workload.observation(id, round_trip_secs) {
            self.workload.estimator.observe_first(&seen);
        }
    }

    /// Removes a request that the node has finished with. Returns whether that leaves unassigned tiles, or
    /// makes room for further requests.
    pub(super) fn close(&mut self, now: f64, id: RequestId) -> bool {
        let had_room = self.has_room();
        let Some(request) = self.workload.requests.remove(&id) else {
            return false;
        };
        self.lost_tiles += request.lost_tiles();
        let leaves_tiles = request.counts() && request.tiles_received < request.tiles.count;
        // An answer ends silence, an incomplete request leaves tiles, and a full queue gains room.
        self.workload.hear(now, id, request.frame) || leaves_tiles || !had_room
    }

    /// Marks the node as silent, or more of its requests as lost, if they are due. Returns whether any
    /// were.
    pub(super) fn time_out(&mut self, now: f64, hedged: bool) -> bool {
        let ConnectionState::Open(info) = &self.connection else {
            return false;
        };
        let lost_tiles = self.workload.time_out(now, hedged, info.device.kind);
        self.lost_tiles += lost_tiles.unwrap_or(0);
        lost_tiles.is_some()
    }

    pub(super) fn is_open(&self) -> bool {
        matches!(self.connection, ConnectionState::Open(_))
    }

    /// Why it cannot use a scene, if it has refused it.
    pub(super) fn scene_refusal(&self, hash: SceneHash) -> Option<&str> {
        self.scenes_refused.get(&hash).map(String::as_str)
    }

    /// The address that it is connected by.
    pub(super) fn address(&self) -> &str {
        &self.address
    }

    /// The name in its certificate with its address.
    pub(super) fn full_name(&self) -> String {
        match &self.connection {
            ConnectionState::Open(info) if !info.name.is_empty() => {
                format!("{} ({})", info.name, self.address)
            }
            _ => self.address.clone(),
        }
    }

    /// Counts a checked tile on which it and others agree.
    pub(super) fn agree(&mut self) {
        self.checked_tiles += 1;
        self.doubt = None;
    }

    /// Records an undecided disagreement with others about a tile. Returns whether it is new.
    pub(super) fn disagree(&mut self, others: &str) -> bool {
        self.checked_tiles += 1;
        let doubt = format!("its pixels differ from those of {others}");
        self.doubt.replace(doubt.clone()) != Some(doubt)
    }

    /// The connection state of a new attempt to connect.
    pub(super) fn connecting(&self) -> ConnectionState {
        let lost = match &self.connection {
            ConnectionState::Connecting { lost } => lost.clone(),
            ConnectionState::Lost { why, .. } => Some(why.clone()),
            ConnectionState::Open(_) => None,
        };
        ConnectionState::Connecting { lost }
    }

    /// Whether it will not be connected to again.
    pub(super) fn is_gone(&self) -> bool {
        matches!(
            self.connection,
            ConnectionState::Lost { retry_at: None, .. }
        )
    }

    /// Whether tiles of a scene can be requested from it.
    pub(super) fn is_usable(&self, scene: SceneHash) -> bool {
        self.workload.silent_since.is_none() && self.is_usable_if_it_answers(scene)
    }

    /// The same, but for silent nodes too.
    pub(super) fn is_usable_if_it_answers(&self, scene: SceneHash) -> bool {
        let may_be_asked = self.is_open() && !self.leaving && self.pause.is_none();
        may_be_asked && self.has_scene(scene) && self.has_room()
    }

    /// Whether it has reported ready for a scene.
    pub(super) fn has_scene(&self, scene: SceneHash) -> bool {
        self.scenes.contains(&scene)
    }

    /// Whether it holds a scene, is receiving it in chunks or has refused it.
    pub(super) fn knows_scene(&self, scene: SceneHash) -> bool {
        let is_coming = self.scene_progress.is_some_and(|(hash, ..)| hash == scene);
        is_coming || self.has_scene(scene) || self.scenes_refused.contains_key(&scene)
    }

    pub(super) fn has_room(&self) -> bool {
        self.workload.requests.len() < REQUESTS_QUEUED_MAX
    }

    pub(super) fn round_trip_secs(&self) -> Option<f64> {
        self.ping.round_trip_secs
    }

    /// When something next becomes due: a ping, the end of a back-off, or a timeout.
    pub(super) fn next_timeout(&self, hedged: bool) -> Option<f64> {
        let silence = match &self.connection {
            ConnectionState::Open(info) => self.workload.silence_due(hedged, info.device.kind),
            _ => None,
        };
        let pause = self.pause.as_ref().map(|pause| pause.until);
        [self.ping_due(), pause, silence]
            .into_iter()
            .flatten()
            .reduce(f64::min)
    }

    pub(super) fn status(&self, now: f64, scene: Option<SceneHash>) -> NodeStatus {
        let info = match &self.connection {
            ConnectionState::Open(info) => Some(info.clone()),
            _ => None,
        };
        let estimator = &self.workload.estimator;
        let (estimate, error) = (estimator.estimate(), estimator.error());
        let round_trip = self.round_trip_secs().map(|secs| secs.max(0.0));
        NodeStatus {
            address: self.address.clone(),
            info,
            state: self.state(now, scene),
            fixed_secs: estimate.map_or(0.0, |estimate| estimate.fixed_secs),
            fixed_error_secs: error.map_or(0.0, |error| error.fixed_secs),
            msamples_per_sec: estimate.map_or(0.0, |estimate| 1e-6 / estimate.secs_per_work),
            speed_error: error.map_or(0.0, |error| error.pace),
            tiles: self.tiles,
            lost_tiles: self.lost_tiles,
            checked_tiles: self.checked_tiles,
            doubt: self.doubt.clone(),
            round_trip: round_trip.map(Duration::from_secs_f64),
            split: self.split,
            load: self.load,
        }
    }

    fn state(&self, now: f64, scene: Option<SceneHash>) -> NodeState {
        let lost = |why: String, retry_at: Option<f64>| NodeState::Lost {
            why,
            retry_secs: retry_at.map(|at| (at - now).ceil().max(1.0) as u64),
        };
        let scene_refusal = scene.and_then(|scene| self.scene_refusal(scene));
        // The first that applies: a lost connection outweighs a refused scene, and that a back-off.
        match (&self.connection, scene_refusal, &self.pause) {
            (ConnectionState::Connecting { lost: None }, ..) => return NodeState::Starting,
            (ConnectionState::Connecting { lost: Some(why) }, ..) => {
                return lost(why.clone(), None);
            }
            (ConnectionState::Lost { why, retry_at }, ..) => {
                return lost(why.clone(), *retry_at);
            }
            (_, Some(why), _) => return lost(format!("it cannot use the scene: {why}"), None),
            (.., Some(Pause { why, until })) if why.is_some() => {
                return lost(why.clone().unwrap_or_default(), Some(*until));
            }
            _ => {}
        }
        if self.leaving {
            return NodeState::Draining;
        }
        let workload = &self.workload;
        if let Some(secs) = workload.silent_since.map(|since| now - since)
            && secs >= SILENCE_REPORTED_SECS
        {
            return lost(format!("it has not answered for {secs:.0} s"), None);
        }
        let Some(scene) = scene else {
            return NodeState::Paired;
        };
        if !self.scenes.contains(&scene) {
            let of_it = self.scene_progress.filter(|(hash, ..)| *hash == scene);
            let (bytes, of) = of_it.map_or((0, 0), |(_, bytes, of)| (bytes, of));
            return NodeState::Syncing { bytes, of };
        }
        let worked_lately = self.tiles > 0 && now - workload.last_heard < WORK_SECS;
        if !workload.requests.is_empty() || worked_lately {
            NodeState::Rendering
        } else {
            NodeState::Ready
        }
    }

    fn ping_due(&self) -> Option<f64> {
        (self.is_open() && self.ping.sent.is_none()).then_some(self.ping.next)
    }
}

/// Seconds of silence from which on it is shown in the status. Others take over a silent node's work much
/// earlier; most silent nodes are only late.
const SILENCE_REPORTED_SECS: f64 = 2.0;
/// Back-off after the first failure of a device, in seconds; it doubles with each further one.
const PAUSE_SECS: f64 = 0.1;
/// Maximum back-off in seconds.
const PAUSE_SECS_MAX: f64 = 5.0;
/// Back-off in seconds after a node has reported a full queue.
const BUSY_PAUSE_SECS: f64 = 0.02;
/// Seconds since its last message for which an idle node is still shown as rendering, so that the status
/// does not flicker between frames, 60 per second.
const WORK_SECS: f64 = 1.0;
/// Maximum number of refused scenes remembered per connection.
const SCENES_REFUSED_MAX: usize = 16;
/// Seconds between pings.
const PING_SECS: f64 = 1.0;
