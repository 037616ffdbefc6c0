//! Thread of the coordinator: provides the state machine with its clock, its links and its caller.

use std::collections::BTreeMap;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use carom_protocol::limits::NODES_MAX;
use carom_protocol::{EncodedScene, FrameId, PrecisionRange};
use carom_tracer::Tracer;

use crate::balancer::Balancer;
use crate::coordinator::{Coordinator, CoordinatorAction, FrameRefusal, SPOT_CHECK_TILES};
use crate::directory::Roster;
use crate::directory::watch::DirectoryWatch;
use crate::directory::{Directory, ListedNode};
use crate::events::EventSender;
use crate::link::{LinkCommand, LinkEvent};
use crate::lock::lock;
use crate::memory_link::MemoryLink;
use crate::net::{Client, NodeAddress, NodeLink};
use crate::node::Node;
use crate::node_status::{LOCAL_ADDRESS, NodeIndex};
use crate::{Balancing, Distribution, FarmConfig, Frame, FrameSpec, NodeState, NodeStatus};

/// Message to the coordinator's thread. The channel is bounded by its senders: a link passes on no more
/// than the answers to `REQUESTS_QUEUED_MAX` open requests, [`crate::Farm`] limits the frames in flight,
/// and the rest are calls of the application, each of which the thread handles in microseconds.
pub(crate) enum DriverInput {
    Link(NodeIndex, LinkId, Vec<LinkEvent>),
    Scene(Arc<EncodedScene>),
    Submit {
        id: FrameId,
        spec: Box<FrameSpec>,
        scene: Arc<EncodedScene>,
        deadline: Option<Duration>,
        exact: bool,
        replies: Sender<FrameReply>,
    },
    Cancel(FrameId),
    Balancing(Balancing),
    Balancer(Box<dyn Balancer + Send>),
    Distribution(Distribution),
    AddLocal(Arc<dyn Tracer>),
    /// Name and address of a node, with the network client if it is the first remote node.
    AddRemote(String, NodeAddress, Option<Client>),
    /// A directory, with the network client if its nodes are the first remote ones.
    AddDirectory(Box<dyn Directory>, Option<Client>),
    /// Index of a directory and the nodes that it lists.
    Listed(usize, Vec<ListedNode>),
    /// The tracer opened by [`Driver::add_local_later`].
    Local(NodeIndex, Result<Arc<dyn Tracer>, carom_tracer::Error>),
    Watch(EventSender),
    /// Sent by a client to test whether the thread still runs.
    Nothing,
    Stop,
}

/// Outcome of a submitted frame.
pub(crate) type FrameReply = Result<Frame, FrameRefusal>;

/// Number of a link, unique per driver: late events of a dropped link are recognised although another node
/// has its index.
type LinkId = u64;

/// State that the thread publishes.
#[derive(Debug, Default)]
pub(crate) struct FarmBoard {
    pub(crate) nodes: Vec<NodeStatus>,
    /// Unfinished frames, with the tiles that have arrived and all tiles.
    pub(crate) frames: Vec<(FrameId, u32, u32)>,
}

/// Receiver of a frame.
struct Route {
    replies: Sender<FrameReply>,
    has_deadline: bool,
}

/// State of the coordinator's thread.
pub(crate) struct Driver {
    coordinator: Coordinator,
    links: Vec<DriverLink>,
    link_ids: Vec<LinkId>,
    last_link: LinkId,
    roster: Roster,
    directories: Vec<DirectoryWatch>,
    tile_edge: u16,
    started: Instant,
    /// Precision range of remote nodes.
    precision: PrecisionRange,
    inputs: Sender<DriverInput>,
    receiver: Receiver<DriverInput>,
    board: Arc<Mutex<FarmBoard>>,
    board_at: Duration,
    board_stale: bool,
    routes: BTreeMap<FrameId, Route>,
    watchers: Vec<EventSender>,
    /// Number of tracers that are being opened.
    opening: usize,
    /// Declared after the links, so that it is dropped after them.
    client: Option<Client>,
}

enum DriverLink {
    Memory {
        link: MemoryLink,
        /// Declared after the link, whose thread uses it: fields are dropped in order of declaration. Its
        /// drop ends the workers and waits for them up to a second.
        _node: Arc<Node>,
    },
    Remote(NodeLink),
    /// The tracer is still being opened, or could not be.
    None,
}

impl Driver {
    pub(crate) fn new(config: &FarmConfig) -> Self {
        let (inputs, receiver) = mpsc::channel();
        let mut coordinator = Coordinator::new(config.balancer);
        coordinator.set_distribution(config.distribution);
        coordinator.set_spot_checks(SPOT_CHECK_TILES, secret_key());
        Self {
            coordinator,
            links: Vec::new(),
            link_ids: Vec::new(),
            last_link: 0,
            roster: Roster::default(),
            directories: Vec::new(),
            tile_edge: config.tile_edge,
            started: Instant::now(),
            precision: config.precision,
            inputs,
            receiver,
            board: Arc::default(),
            board_at: Duration::ZERO,
            board_stale: false,
            routes: BTreeMap::new(),
            watchers: Vec::new(),
            opening: 0,
            client: None,
        }
    }

    pub(crate) fn inputs(&self) -> Sender<DriverInput> {
        self.inputs.clone()
    }

    pub(crate) fn board(&mut self) -> Arc<Mutex<FarmBoard>> {
        self.publish();
        Arc::clone(&self.board)
    }

    pub(crate) fn add_local(&mut self, tracer: Arc<dyn Tracer>) {
        let index = self.add_local_node();
        self.links[index.0] = self.memory_link(index, tracer);
    }

    /// Adds a local node whose tracer `open` opens on another thread.
    pub(crate) fn add_local_later(
        &mut self,
        open: impl FnOnce() -> Result<Arc<dyn Tracer>, carom_tracer::Error> + Send + 'static,
    ) {
        let index = self.add_local_node();
        self.opening += 1;
        let inputs = self.inputs.clone();
        std::thread::spawn(move || {
            // A farm that has ended needs no tracer.
            let _ = inputs.send(DriverInput::Local(index, open()));
        });
    }

    /// Connects to the nodes that a directory lists, from now on.
    pub(crate) fn add_directory(&mut self, directory: Box<dyn Directory>) {
        let index = self.roster.add_directory();
        let inputs = self.inputs.clone();
        let listed = move |nodes| inputs.send(DriverInput::Listed(index, nodes)).is_ok();
        match DirectoryWatch::start(directory, listed) {
            Ok(watch) => self.directories.push(watch),
            Err(why) => tracing::error!("a directory's thread cannot be started: {why}"),
        }
    }

    /// Takes ownership of the network client of remote links.
    pub(crate) fn keep(&mut self, client: Client) {
        self.client = Some(client);
    }

    /// Runs until it is stopped and no tracer is being opened any more: a graphics driver must not be
    /// initialised while the process exits.
    pub(crate) fn run(mut self) {
        self.run_until_stop();
        let deadline = Instant::now() + OPENING_PATIENCE;
        while self.opening > 0 {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.receiver.recv_timeout(left) {
                Ok(DriverInput::Local(..)) => self.opening -= 1,
                Ok(_) => {}
                Err(_) => return,
            }
        }
    }

    fn run_until_stop(&mut self) {
        loop {
            let input = match self.patience() {
                Some(patience) => self.receiver.recv_timeout(patience),
                None => self
                    .receiver
                    .recv()
                    .map_err(|_| RecvTimeoutError::Disconnected),
            };
            match input {
                Ok(DriverInput::Stop) | Err(RecvTimeoutError::Disconnected) => return,
                Ok(input) => self.handle(input),
                Err(RecvTimeoutError::Timeout) => {}
            }
            let now = self.now();
            if self
                .coordinator
                .next_timeout()
                .is_some_and(|due| due <= now)
            {
                self.coordinator.handle_timeout(now);
            }
            while let Some(action) = self.coordinator.poll_action() {
                match action {
                    CoordinatorAction::Command { node, command } => {
                        self.links[node.0].send(command)
                    }
                    CoordinatorAction::Deliver(frame) => self.deliver(*frame),
                    CoordinatorAction::Refuse(refusal) => self.refuse(refusal),
                    CoordinatorAction::HangUp(node) => self.hang_up(node),
                    CoordinatorAction::Warn(sentence) => tracing::warn!("{sentence}"),
                }
            }
            self.refresh_board(now);
        }
    }

    fn handle(&mut self, input: DriverInput) {
        let now = self.now();
        self.board_stale = true;
        match input {
            DriverInput::Link(node, link, events) => {
                // Events of a dropped link may still be in the channel when its index has a new node.
                let is_current = self.link_ids[node.0] == link;
                for event in events.into_iter().filter(|_| is_current) {
                    let is_lost = matches!(event, LinkEvent::Lost { .. });
                    self.coordinator.handle(now, node, event);
                    if is_lost {
                        self.drop_left();
                    }
                }
            }
            DriverInput::Scene(scene) => self.coordinator.set_scene(scene),
            DriverInput::Submit {
                id,
                spec,
                scene,
                deadline,
                exact,
                replies,
            } => {
                let has_deadline = deadline.is_some();
                let route = Route {
                    replies,
                    has_deadline,
                };
                self.routes.insert(id, route);
                let edge = self.tile_edge;
                let coordinator = &mut self.coordinator;
                coordinator.submit(now, id, *spec, scene, edge, exact);
                if let Some(deadline) = deadline {
                    self.coordinator.set_deadline(id, now + deadline);
                }
            }
            DriverInput::Cancel(id) => {
                self.routes.remove(&id);
                self.coordinator.cancel(now, id);
            }
            DriverInput::Balancing(balancing) => self.coordinator.set_balancing(balancing),
            DriverInput::Balancer(balancer) => self.coordinator.set_balancer(balancer),
            DriverInput::Watch(watcher) => self.watchers.push(watcher),
            DriverInput::Distribution(what) => self.coordinator.set_distribution(what),
            DriverInput::AddLocal(tracer) => self.add_local(tracer),
            DriverInput::AddRemote(name, address, client) => {
                if let Some(client) = client.or_else(|| self.client.take()) {
                    self.call(&client, name, address);
                    self.client = Some(client);
                }
            }
            DriverInput::AddDirectory(directory, client) => {
                self.client = client.or_else(|| self.client.take());
                self.add_directory(directory);
            }
            DriverInput::Listed(directory, nodes) => self.listed(directory, nodes),
            DriverInput::Local(node, Ok(tracer)) => {
                self.opening -= 1;
                self.links[node.0] = self.memory_link(node, tracer);
            }
            DriverInput::Local(node, Err(why)) => {
                self.opening -= 1;
                let why = why.to_string();
                self.coordinator
                    .handle(now, node, LinkEvent::Lost { why, retry: None });
            }
            DriverInput::Nothing | DriverInput::Stop => {}
        }
    }

    /// Connects to nodes that are new in a directory, and drops links to nodes that have left all
    /// directories.
    fn listed(&mut self, directory: usize, nodes: Vec<ListedNode>) {
        let new = self.roster.update(directory, nodes);
        self.drop_left();
        // Taken out because `call` borrows all of `self`.
        let Some(client) = self.client.take() else {
            return;
        };
        let called = self.link_ids.iter().filter(|link| **link != VOID).count();
        let room = NODES_MAX.saturating_sub(called);
        if new.len() > room {
            tracing::warn!(
                "a directory lists {} nodes more than the {NODES_MAX} that a farm may have",
                new.len() - room
            );
        }
        for address in new.into_iter().take(room) {
            let index = self.call(&client, address.to_string(), address.clone());
            self.roster.call(index, address);
        }
        self.client = Some(client);
    }

    /// Stops connecting to nodes that have left all directories, once they are not connected.
    fn drop_left(&mut self) {
        let left = self.roster.left();
        if left.is_empty() {
            return;
        }
        let nodes = self.coordinator.nodes(self.now());
        for node in left {
            let is_idle =
                |state: &NodeState| matches!(state, NodeState::Starting | NodeState::Lost { .. });
            if nodes[node.0].info.is_none() && is_idle(&nodes[node.0].state) {
                self.hang_up(node);
                self.roster.forget(node);
                self.coordinator.remove_node(self.now(), node);
            }
        }
    }

    fn add_local_node(&mut self) -> NodeIndex {
        let index = self.coordinator.add_local_node(LOCAL_ADDRESS.into());
        self.add_link(index)
    }

    /// Prepares the link entry of a node, with a new link number.
    fn add_link(&mut self, index: NodeIndex) -> NodeIndex {
        if index.0 == self.links.len() {
            self.links.push(DriverLink::None);
            self.link_ids.push(VOID);
        }
        self.last_link += 1;
        self.link_ids[index.0] = self.last_link;
        index
    }

    /// Adds a remote node and starts its link, which keeps connecting to it.
    pub(crate) fn call(
        &mut self,
        client: &Client,
        name: String,
        address: NodeAddress,
    ) -> NodeIndex {
        let index = self.coordinator.add_node(name);
        self.add_link(index);
        let link = client.link(address, self.precision, self.events(index));
        self.links[index.0] = DriverLink::Remote(link);
        index
    }

    fn memory_link(&self, index: NodeIndex, tracer: Arc<dyn Tracer>) -> DriverLink {
        let node = Node::new("", tracer);
        DriverLink::Memory {
            link: MemoryLink::new(&node, self.events(index)),
            _node: node,
        }
    }

    fn events(&self, index: NodeIndex) -> impl Fn(Vec<LinkEvent>) + Send + 'static {
        let inputs = self.inputs.clone();
        let link = self.link_ids[index.0];
        move |events| drop(inputs.send(DriverInput::Link(index, link, events)))
    }

    /// How long to wait for the next input; `None` without limit.
    fn patience(&self) -> Option<Duration> {
        let refresh = self.board_stale.then(|| self.board_at + STATUS_AGE_MAX);
        let due = self
            .coordinator
            .next_timeout()
            .into_iter()
            .chain(refresh)
            .min()?;
        Some(due.saturating_sub(self.now()))
    }

    fn refresh_board(&mut self, now: Duration) {
        if self.board_stale && now >= self.board_at + STATUS_AGE_MAX {
            self.board_stale = false;
            self.board_at = now;
            self.publish();
        }
    }

    fn publish(&mut self) {
        let nodes = self.coordinator.nodes(self.now());
        let frames = self.coordinator.progress().collect();
        let mut board = lock(&self.board);
        let before = std::mem::replace(&mut *board, FarmBoard { nodes, frames });
        self.watchers
            .retain_mut(|watcher| watcher.compare(&before.nodes, &board.nodes));
    }

    /// Sends a frame to its submitter. A deadline ends the earlier frames with deadlines.
    fn deliver(&mut self, frame: Frame) {
        let id = frame.id;
        let is_whole = frame.missing.is_empty();
        if is_whole {
            self.watchers.retain_mut(|watcher| watcher.finished(&frame));
        }
        let Some(route) = self.routes.get(&id) else {
            return;
        };
        let has_deadline = route.has_deadline;
        // The submitter may be gone.
        let _ = route.replies.send(Ok(frame));
        if is_whole {
            self.routes.remove(&id);
        }
        if has_deadline {
            self.routes
                .retain(|earlier, route| *earlier >= id || !route.has_deadline);
        }
    }

    /// Drops the link to a node and voids its further events.
    fn hang_up(&mut self, node: NodeIndex) {
        self.links[node.0] = DriverLink::None;
        self.link_ids[node.0] = VOID;
    }

    /// Tells the submitter of a frame that it will not be delivered.
    fn refuse(&mut self, refusal: FrameRefusal) {
        if let Some(route) = self.routes.remove(&refusal.frame) {
            // The submitter may be gone.
            let _ = route.replies.send(Err(refusal));
        }
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }
}

impl DriverLink {
    /// Sends a command; it is dropped if the link is gone, which reports its loss separately.
    fn send(&self, command: LinkCommand) {
        let sent = match self {
            Self::Memory { link, .. } => link.send(command),
            Self::Remote(link) => link.send(command),
            Self::None => false,
        };
        if !sent {
            tracing::debug!("a command for a link that is gone was dropped");
        }
    }
}

/// A key that no node can guess. Without the system's random numbers, nodes can predict spot checks, which
/// is no reason not to render.
fn secret_key() -> [u8; 32] {
    #[cfg_attr(
        not(feature = "net"),
        expect(unused_mut, reason = "nobody need be checked")
    )]
    let mut key = [0; 32];
    #[cfg(feature = "net")]
    if ring::rand::SecureRandom::fill(&ring::rand::SystemRandom::new(), &mut key).is_err() {
        tracing::warn!("the system gives no random numbers: nodes can foretell spot checks");
    }
    key
}

/// The number of no link.
const VOID: LinkId = 0;
/// How long a dropped farm waits for a tracer that is being opened; a GPU needs 0.1 to 1.2 s.
const OPENING_PATIENCE: Duration = Duration::from_secs(3);
/// Maximum age of [`crate::Farm::nodes`].
const STATUS_AGE_MAX: Duration = Duration::from_millis(20);
