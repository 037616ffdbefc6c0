//! Thread of the coordinator: gives the state machine its clock, its links and its caller.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::{FrameId, PrecisionRange, SceneHash};
use carom_tracer::{Scene, Tracer};

use crate::coordinator::{Coordinator, CoordinatorAction};
use crate::link::{LinkCommand, LinkEvent};
use crate::memory_link::MemoryLink;
use crate::net::{Client, NodeAddress, NodeLink};
use crate::node::Node;
use crate::node_status::NodeIndex;
use crate::{Balancing, Distribution, FarmConfig, Frame, FrameSpec, NodeStatus};

/// Message to the thread. The queue is bounded by those who send: a link hands on no more than the
/// answers to `REQUESTS_QUEUED_MAX` open requests, [`crate::Farm`] counts the frames in flight, and the
/// rest are calls of the application, each of which the thread handles in microseconds.
pub(crate) enum DriverInput {
    Link(NodeIndex, Vec<LinkEvent>),
    Scene(SceneHash, Arc<Scene>),
    Submit {
        id: FrameId,
        spec: Box<FrameSpec>,
        scene: (SceneHash, Arc<Scene>),
        deadline: Option<Duration>,
    },
    CancelBefore(FrameId),
    Cancel(FrameId),
    Balancing(Balancing),
    Distribution(Distribution),
    AddLocal(Arc<dyn Tracer>),
    /// With what to call it, if it is the first.
    AddRemote(String, NodeAddress, Option<Client>),
    /// The tracer that [`Driver::add_local_later`] has been waiting for.
    Local(NodeIndex, Result<Arc<dyn Tracer>, carom_tracer::Error>),
    Stop,
}

/// Everything that the thread owns.
pub(crate) struct Driver {
    coordinator: Coordinator,
    links: Vec<DriverLink>,
    tile_edge: u16,
    started: Instant,
    /// Of remote nodes.
    precision: PrecisionRange,
    inputs: Sender<DriverInput>,
    receiver: Receiver<DriverInput>,
    statuses: Arc<Mutex<Vec<NodeStatus>>>,
    statuses_at: Duration,
    statuses_stale: bool,
    /// Tracers that are being opened.
    opening: usize,
    /// After the links, which end first.
    client: Option<Client>,
}

enum DriverLink {
    Memory {
        link: MemoryLink,
        /// Dropped after the link, whose thread uses it: fields are dropped in the order of declaration.
        /// Ends its workers, and waits a second for them.
        _node: Arc<Node>,
    },
    Remote(NodeLink),
    /// A tracer that is still being opened, or could not be.
    None,
}

impl Driver {
    pub(crate) fn new(config: &FarmConfig) -> Self {
        let (inputs, receiver) = mpsc::channel();
        let mut coordinator = Coordinator::new(config.balancer);
        coordinator.set_distribution(config.distribution);
        Self {
            coordinator,
            links: Vec::new(),
            tile_edge: config.tile_edge,
            started: Instant::now(),
            precision: config.precision,
            inputs,
            receiver,
            statuses: Arc::default(),
            statuses_at: Duration::ZERO,
            statuses_stale: false,
            opening: 0,
            client: None,
        }
    }

    pub(crate) fn inputs(&self) -> Sender<DriverInput> {
        self.inputs.clone()
    }

    pub(crate) fn statuses(&self) -> Arc<Mutex<Vec<NodeStatus>>> {
        self.publish();
        Arc::clone(&self.statuses)
    }

    pub(crate) fn add_local(&mut self, tracer: Arc<dyn Tracer>) {
        let index = self.coordinator.add_node("local".into());
        let link = self.memory_link(index, tracer);
        self.links.push(link);
    }

    /// Adds a local node whose tracer takes a while to open.
    pub(crate) fn add_local_later(
        &mut self,
        open: fn() -> Result<Arc<dyn Tracer>, carom_tracer::Error>,
    ) {
        let index = self.coordinator.add_node("local".into());
        self.links.push(DriverLink::None);
        self.opening += 1;
        let inputs = self.inputs.clone();
        std::thread::spawn(move || {
            // A farm that has lost its patience needs no tracer.
            let _ = inputs.send(DriverInput::Local(index, open()));
        });
    }

    pub(crate) fn add_remote(&mut self, client: &Client, name: String, address: NodeAddress) {
        let index = self.coordinator.add_node(name);
        let link = client.link(address, self.precision, self.events(index));
        self.links.push(DriverLink::Remote(link));
    }

    /// Keeps the network threads of remote links.
    pub(crate) fn keep(&mut self, client: Client) {
        self.client = Some(client);
    }

    /// Runs until it is told to stop, and until no tracer is being opened any more: a driver must
    /// not be set up in a process that is exiting meanwhile.
    pub(crate) fn run(mut self, frames: &Sender<Frame>) {
        self.run_until_stop(frames);
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

    fn run_until_stop(&mut self, frames: &Sender<Frame>) {
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
                    CoordinatorAction::Deliver(frame) => drop(frames.send(*frame)),
                }
            }
            self.refresh_statuses(now);
        }
    }

    fn handle(&mut self, input: DriverInput) {
        let now = self.now();
        self.statuses_stale = true;
        match input {
            DriverInput::Link(node, events) => {
                for event in events {
                    self.coordinator.handle(now, node, event);
                }
            }
            DriverInput::Scene(hash, scene) => self.coordinator.set_scene(hash, scene),
            DriverInput::Submit {
                id,
                spec,
                scene,
                deadline,
            } => {
                let edge = self.tile_edge;
                self.coordinator.submit(now, id, *spec, scene, edge);
                if let Some(deadline) = deadline {
                    self.coordinator.set_deadline(id, now + deadline);
                }
            }
            DriverInput::CancelBefore(id) => self.coordinator.cancel_before(now, id),
            DriverInput::Cancel(id) => self.coordinator.cancel(now, id),
            DriverInput::Balancing(balancing) => self.coordinator.set_balancing(balancing),
            DriverInput::Distribution(what) => self.coordinator.set_distribution(what),
            DriverInput::AddLocal(tracer) => self.add_local(tracer),
            DriverInput::AddRemote(name, address, client) => {
                if let Some(client) = client.or_else(|| self.client.take()) {
                    self.add_remote(&client, name, address);
                    self.client = Some(client);
                }
            }
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
            DriverInput::Stop => {}
        }
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
        move |events| drop(inputs.send(DriverInput::Link(index, events)))
    }

    /// How long to wait for the next input; `None` for ever.
    fn patience(&self) -> Option<Duration> {
        let refresh = self
            .statuses_stale
            .then(|| self.statuses_at + STATUS_AGE_MAX);
        let due = self
            .coordinator
            .next_timeout()
            .into_iter()
            .chain(refresh)
            .min()?;
        Some(due.saturating_sub(self.now()))
    }

    fn refresh_statuses(&mut self, now: Duration) {
        if self.statuses_stale && now >= self.statuses_at + STATUS_AGE_MAX {
            self.statuses_stale = false;
            self.statuses_at = now;
            self.publish();
        }
    }

    fn publish(&self) {
        let nodes = self.coordinator.nodes(self.now());
        *self.statuses.lock().unwrap_or_else(PoisonError::into_inner) = nodes;
    }

    fn now(&self) -> Duration {
        self.started.elapsed()
    }
}

impl DriverLink {
    /// A command that cannot be delivered is void: the link is gone and says so.
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

/// How long a tracer may take to open when the farm is dropped; a GPU needs 0.1 to 1.2 s.
const OPENING_PATIENCE: Duration = Duration::from_secs(3);
/// How old [`crate::Farm::nodes`] may be.
const STATUS_AGE_MAX: Duration = Duration::from_millis(20);
