//! The nodes: where each stands, what it has been asked, what is known of it.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use carom_protocol::limits::REQUESTS_QUEUED_MAX;
use carom_protocol::{FrameId, NodeInfo, RequestId, SceneHash};
use carom_tracer::DeviceKind;

use super::arrival_model::{Drift, Rhythm, begins_after};
use super::open_request::Run;
use crate::balancer::{Estimate, Estimator};
use crate::{LatencySplit, NodeState, NodeStatus};

/// Times are seconds on the client's clock.
#[derive(Debug)]
pub(super) struct Node {
    address: String,
    pub(super) connection: Connection,
    /// Scenes that it has said it is ready for.
    scenes: BTreeSet<SceneHash>,
    /// The scene that is on its way to it, and how much of it has come, in per cent.
    scene_coming: Option<(SceneHash, u8)>,
    scene_refused: Option<(SceneHash, String)>,
    pub(super) runs: BTreeMap<RequestId, Run>,
    pub(super) estimator: Estimator,
    pub(super) rhythm: Rhythm,
    /// The most work that came for one frame, and what has come for the last one.
    pub(super) proven_work: f64,
    proving: (FrameId, f64),
    /// The last frame of which something was given up.
    pub(super) late_of: Option<FrameId>,
    pub(super) drift: Drift,
    /// When it was last asked while nothing was open, or last answered.
    heard: f64,
    /// Whether it has been asked for work and has not been heard for longer than it should need.
    pub(super) silent_since: Option<f64>,
    rest: Option<Rest>,
    failures: u32,
    tiles: u64,
    lost_tiles: u64,
    split: LatencySplit,
    ping: Ping,
    pub(super) last_probe: Option<FrameId>,
    /// When the coordinator will look at it, at the latest.
    pub(super) armed: Option<Duration>,
}

#[derive(Debug)]
pub(super) enum Connection {
    Connecting,
    Open(NodeInfo),
    Lost { why: String, retry_at: Option<f64> },
}

/// A pause after a refusal.
#[derive(Debug)]
struct Rest {
    until: f64,
    /// Absent if the node was merely busy.
    why: Option<String>,
}

#[derive(Debug, Default)]
struct Ping {
    number: u64,
    /// When the one that has no answer yet was sent.
    sent: Option<f64>,
    next: f64,
    round_trip_secs: Option<f64>,
}

impl Node {
    pub(super) fn new(address: String) -> Self {
        Self {
            address,
            connection: Connection::Connecting,
            scenes: BTreeSet::new(),
            scene_coming: None,
            scene_refused: None,
            runs: BTreeMap::new(),
            estimator: Estimator::default(),
            rhythm: Rhythm::default(),
            proven_work: 0.0,
            proving: (FrameId(0), 0.0),
            late_of: None,
            drift: Drift::default(),
            heard: 0.0,
            silent_since: None,
            rest: None,
            failures: 0,
            tiles: 0,
            lost_tiles: 0,
            split: LatencySplit::default(),
            ping: Ping::default(),
            last_probe: None,
            armed: None,
        }
    }

    /// Begins a connection; what was known of another one is void.
    pub(super) fn open(&mut self, now: f64, info: NodeInfo) {
        self.reset(Connection::Open(info));
        self.ping = Ping {
            next: now,
            ..Ping::default()
        };
    }

    /// Forgets all that a connection held; the estimates stay, for the node is most likely the
    /// same when it comes back, but it has to prove them again.
    pub(super) fn reset(&mut self, connection: Connection) {
        self.connection = connection;
        self.scenes.clear();
        self.scene_coming = None;
        self.scene_refused = None;
        let runs = std::mem::take(&mut self.runs);
        runs.values().for_each(|run| self.lose(run));
        self.silent_since = None;
        self.proven_work = 0.0;
        self.rest = None;
        self.failures = 0;
    }

    /// `true` if it was not ready for that scene before.
    pub(super) fn scene_ready(&mut self, hash: SceneHash) -> bool {
        self.scene_refused = None;
        self.scenes.insert(hash)
    }

    pub(super) fn scene_coming(&mut self, hash: SceneHash, percent: u8) {
        self.scene_coming = Some((hash, percent));
    }

    pub(super) fn scene_refused(&mut self, hash: SceneHash, why: String) {
        self.scene_refused = Some((hash, why));
    }

    /// Adds a run that is being asked for.
    pub(super) fn ask(&mut self, now: f64, id: RequestId, mut run: Run) {
        if self.runs.is_empty() {
            self.heard = now;
        }
        run.lost = self.silent_since.is_some();
        self.runs.insert(id, run);
    }

    /// Takes note that it delivers, or says that it will not. `true` if it was silent.
    /// What it has been asked for later than that run, or of a later frame, has waited meanwhile.
    pub(super) fn hear(&mut self, now: f64, about: RequestId, of: FrameId) -> bool {
        self.heard = now;
        for (id, run) in &mut self.runs {
            if *id > about || run.frame > of {
                run.others_until = now;
            }
        }
        let was_silent = self.silent_since.take().is_some();
        if was_silent {
            self.rhythm.false_alarm();
            self.runs.values_mut().for_each(|run| run.lost = false);
        }
        was_silent
    }

    /// Takes note of how late a message about a run is, if it is the one that was expected.
    pub(super) fn observe_lateness(&mut self, now: f64, id: RequestId) {
        let (Some(expected), Some(line)) = (self.next_message(None), self.delivered()) else {
            return;
        };
        let Some((_, run)) = self.next_run(line).filter(|(next, _)| *next == id) else {
            return;
        };
        let secs = now - expected;
        // Such a message was expected some time after the one before it, which had its own lateness.
        let follows = run.tiles_received > 0 || run.others_until > run.issued + line.fixed_secs;
        let frame = run.frame;
        self.rhythm.observe(secs, self.begins_with(frame));
        self.drift.observe(frame, secs, follows);
    }

    /// Whether what it has sent last was of another frame.
    pub(super) fn begins_with(&self, frame: FrameId) -> bool {
        self.proving.0 != frame
    }

    /// Takes note of work that came for a frame.
    pub(super) fn prove(&mut self, frame: FrameId, work: f64) {
        let before = if self.proving.0 == frame {
            self.proving.1
        } else {
            0.0
        };
        self.proving = (frame, before + work);
        self.proven_work = self.proven_work.max(before + work);
    }

    pub(super) fn deliver(&mut self, tiles: u32, split: LatencySplit) {
        self.split = split;
        self.tiles += u64::from(tiles);
    }

    /// Takes note that what it sends is right.
    pub(super) fn trust(&mut self) {
        self.failures = 0;
    }

    /// Counts what is still missing of a run that has ended, if it was wanted.
    pub(super) fn lose(&mut self, run: &Run) {
        if run.counts() {
            self.lost_tiles += u64::from(run.tiles.count.saturating_sub(run.tiles_received));
        }
    }

    /// Whether nothing has failed since it was last right.
    pub(super) fn is_trusted(&self) -> bool {
        self.failures == 0
    }

    /// Pauses after a refusal: `why` if it was the node's or its device's fault.
    pub(super) fn rest(&mut self, now: f64, why: Option<String>) {
        let secs = match why {
            Some(_) => (REST_SECS * f64::from(1 << self.failures.min(10))).min(REST_SECS_MAX),
            None => BUSY_REST_SECS,
        };
        self.failures += u32::from(why.is_some());
        self.rest = Some(Rest {
            until: now + secs,
            why,
        });
    }

    /// Whether a pause has just ended.
    pub(super) fn wake(&mut self, now: f64) -> bool {
        let over = self.rest.as_ref().is_some_and(|rest| rest.until <= now);
        if over {
            self.rest = None;
        }
        over
    }

    /// The number of a ping to send, if it is time.
    pub(super) fn ping(&mut self, now: f64) -> Option<u64> {
        if self.ping_due()? > now {
            return None;
        }
        self.ping.number += 1;
        self.ping.sent = Some(now);
        self.ping.next = now + PING_SECS;
        Some(self.ping.number)
    }

    pub(super) fn pong(&mut self, now: f64, number: u64) {
        if number == self.ping.number
            && let Some(sent) = self.ping.sent.take()
        {
            self.ping.round_trip_secs = Some(now - sent);
        }
    }

    /// Whether runs have just been lost: it has been asked for work, and nothing has come for far
    /// longer than predicted. Then it is silent. What it should not have come to even now is not lost
    /// yet.
    pub(super) fn falls_silent(&mut self, now: f64, hedged: bool) -> bool {
        if self.silence_due(hedged).is_none_or(|due| due > now) {
            return false;
        }
        let ends = self.patience_ends_by_frame().filter(|_| hedged);
        let is_lost = |run: &Run| match &ends {
            Some(ends) => ends.get(&run.frame).is_none_or(|end| *end <= now),
            None => true,
        };
        let mut runs = std::mem::take(&mut self.runs);
        for run in runs.values_mut().filter(|run| is_lost(run)) {
            self.lose(run);
            run.lost = true;
        }
        self.runs = runs;
        self.silent_since = self.silent_since.or(Some(self.heard));
        true
    }

    pub(super) fn is_open(&self) -> bool {
        matches!(self.connection, Connection::Open(_))
    }

    /// Whether it can be asked for tiles of that scene.
    pub(super) fn is_usable(&self, scene: SceneHash) -> bool {
        self.silent_since.is_none() && self.is_usable_if_it_answers(scene)
    }

    /// The same of a node that may be silent.
    pub(super) fn is_usable_if_it_answers(&self, scene: SceneHash) -> bool {
        self.is_open() && self.scenes.contains(&scene) && self.rest.is_none() && self.has_room()
    }

    pub(super) fn has_room(&self) -> bool {
        self.runs.len() < REQUESTS_QUEUED_MAX
    }

    pub(super) fn round_trip_secs(&self) -> Option<f64> {
        self.ping.round_trip_secs
    }

    /// What work is divided by.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        self.estimator.estimate()
    }

    /// What work is waited for by.
    pub(super) fn delivered(&self) -> Option<Estimate> {
        self.estimator.delivered()
    }

    /// Seconds that a request for a frame would wait for others: longer by as much again as these are
    /// late.
    pub(super) fn wait_secs(&self, now: f64, frame: FrameId) -> f64 {
        let Some(line) = self.delivered() else {
            return 0.0;
        };
        let asked = now + line.fixed_secs + self.drift.of(frame);
        begins_after(&self.prospects(now, None), frame, asked) - asked
    }

    /// When something has to be done about this node.
    pub(super) fn next_timeout(&self, hedged: bool) -> Option<f64> {
        let rest = self.rest.as_ref().map(|rest| rest.until);
        [self.ping_due(), rest, self.silence_due(hedged)]
            .into_iter()
            .flatten()
            .reduce(f64::min)
    }

    pub(super) fn status(&self, now: f64, scene: Option<SceneHash>) -> NodeStatus {
        let info = match &self.connection {
            Connection::Open(info) => Some(info.clone()),
            _ => None,
        };
        let (estimate, error) = (self.estimate(), self.estimator.error());
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
            round_trip: round_trip.map(Duration::from_secs_f64),
            split: self.split,
        }
    }

    fn state(&self, now: f64, scene: Option<SceneHash>) -> NodeState {
        let lost = |why: String, retry_at: Option<f64>| NodeState::Lost {
            why,
            retry_secs: retry_at.map(|at| (at - now).ceil().max(1.0) as u64),
        };
        match (&self.connection, &self.scene_refused, &self.rest) {
            (Connection::Connecting, ..) => return NodeState::Starting,
            (Connection::Lost { why, retry_at }, ..) => return lost(why.clone(), *retry_at),
            (_, Some((hash, why)), _) if Some(*hash) == scene => {
                return lost(format!("it cannot use the scene: {why}"), None);
            }
            (.., Some(Rest { why, until })) if why.is_some() => {
                return lost(why.clone().unwrap_or_default(), Some(*until));
            }
            _ => {}
        }
        if let Some(secs) = self.silent_since.map(|since| now - since)
            && secs >= SILENCE_TOLD_SECS
        {
            return lost(format!("it has not answered for {secs:.0} s"), None);
        }
        let Some(scene) = scene else {
            return NodeState::Paired;
        };
        if !self.scenes.contains(&scene) {
            let of_it = self.scene_coming.filter(|(hash, _)| *hash == scene);
            let percent = of_it.map_or(0, |(_, percent)| percent);
            return NodeState::Syncing { percent };
        }
        let had_work = !self.runs.is_empty() || self.tiles > 0 && now - self.heard < WORK_SECS;
        if had_work {
            NodeState::Rendering
        } else {
            NodeState::Ready
        }
    }

    /// Work that it has been asked for and that is still wanted.
    pub(super) fn outstanding(&self) -> f64 {
        self.runs.values().map(Run::outstanding).sum()
    }

    fn ping_due(&self) -> Option<f64> {
        (self.is_open() && self.ping.sent.is_none()).then_some(self.ping.next)
    }

    fn silence_due(&self, hedged: bool) -> Option<f64> {
        if self.silent_since.is_some() {
            let ends = self.patience_ends_by_frame().filter(|_| hedged)?;
            return ends.into_values().reduce(f64::min);
        }
        // A run that has been cancelled must be answered too.
        if self.runs.is_empty() {
            return None;
        }
        if hedged && let Some(due) = self.patience_ends() {
            return Some(due);
        }
        let outstanding = self.outstanding();
        let patience = match (self.delivered(), &self.connection) {
            (Some(line), Connection::Open(info)) => {
                let predicted = line.fixed_secs + SILENCE_FACTOR * line.secs_per_work * outstanding;
                predicted + silence_margin_secs(info.device.kind)
            }
            _ => NEWCOMER_PATIENCE_SECS,
        };
        Some(self.heard + patience)
    }
}

/// A processor that also runs the client is late whenever the system gives its cores to others.
fn silence_margin_secs(kind: DeviceKind) -> f64 {
    match kind {
        DeviceKind::Gpu => 0.03,
        DeviceKind::Cpu | DeviceKind::Scalar => 0.25,
    }
}

/// How many times its predicted work a node may take before it counts as silent.
const SILENCE_FACTOR: f64 = 6.0;
/// Seconds from which on silence is told. Others take a silent node's work much earlier; most are only
/// late.
const SILENCE_TOLD_SECS: f64 = 2.0;
/// Seconds that a node may take for its very first tiles, of unknown cost.
const NEWCOMER_PATIENCE_SECS: f64 = 5.0;
/// Seconds of pause after the first failure of a device; it doubles with each further one.
const REST_SECS: f64 = 0.1;
/// The longest pause.
const REST_SECS_MAX: f64 = 5.0;
/// Seconds of pause after a node said that its queue is full.
const BUSY_REST_SECS: f64 = 0.02;
/// Seconds since its last answer that a node still counts as rendering: at 60 pictures a second the
/// pauses between them would tell nobody anything.
const WORK_SECS: f64 = 1.0;
/// Seconds between pings.
const PING_SECS: f64 = 1.0;
