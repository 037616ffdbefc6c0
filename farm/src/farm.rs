//! The handle of an application: plain calls that never block.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use carom_protocol::limits::{FRAMES_IN_FLIGHT_MAX, NODES_MAX, POSES_MAX, TILE_EDGE_MAX};
use carom_protocol::{FrameId, PixelFormat, SceneHash};
use carom_tracer::{CompiledScene, Scene, SceneError, SettingsError, Tracer};

use crate::driver::{Driver, DriverInput};
use crate::net::{Client, Credentials, NodeAddress, Role};
use crate::{
    Balancing, Distribution, Error, FarmConfig, Frame, FrameSpec, LocalNode, NodeStatus,
    local_devices,
};

/// Many nodes as one tracer.
///
/// A thread of its own runs the coordinator; calls hand it messages. Frames wait while there is no
/// node that can trace them, and [`Farm::nodes`] says why. Dropping the farm ends everything that
/// it has started.
pub struct Farm {
    inputs: mpsc::Sender<DriverInput>,
    frames: mpsc::Receiver<Frame>,
    statuses: Arc<Mutex<Vec<NodeStatus>>>,
    thread: Option<JoinHandle<()>>,
    frames_in_flight_max: usize,
    credentials: PathBuf,
    /// Whether nodes can be called.
    calls: bool,
    scene: Option<CompiledScene>,
    /// Submitted, and neither taken whole nor cancelled; and whether they have a deadline.
    in_flight: VecDeque<(FrameId, bool)>,
    next_frame: FrameId,
}

/// What remote nodes are called with.
struct RemoteNodes {
    client: Client,
    addresses: Vec<NodeAddress>,
}

impl RemoteNodes {
    /// `None` if there are no remote nodes.
    ///
    /// # Errors
    /// What is wrong with the configuration or with the credentials.
    fn of(config: &FarmConfig) -> Result<Option<Self>, Error> {
        validate(config)?;
        if config.nodes.is_empty() {
            return Ok(None);
        }
        let addresses = config.nodes.iter().map(|node| node.parse());
        let addresses = addresses.collect::<Result<_, _>>()?;
        let credentials = Credentials::load(&config.credentials, Role::Player)?;
        let client = Client::new(&credentials)?;
        Ok(Some(Self { client, addresses }))
    }
}

impl Farm {
    /// Starts the local node and calls the remote ones; waits for neither.
    ///
    /// # Errors
    /// [`Error::Config`] if a value is out of range, [`Error::NodeAddress`] if an address cannot be
    /// parsed, an error of the credentials or [`Error::Socket`] if there are remote nodes and they cannot be
    /// called, [`Error::Tracer`] if [`LocalNode::Gpu`] is asked for and there is none.
    pub fn new(config: FarmConfig) -> Result<Self, Error> {
        // Before any device is opened: a program that ends over a mistake while a driver is being
        // loaded in another thread is ended by the driver.
        let remotes = RemoteNodes::of(&config)?;
        let mut driver = Driver::new(&config);
        match config.local {
            LocalNode::None => {}
            LocalNode::Auto => driver.add_local_later(|| local_devices::auto(0)),
            LocalNode::Cpu => driver.add_local(local_devices::cpu(0)?),
            LocalNode::Gpu => driver.add_local(local_devices::gpu()?),
        }
        Self::start(&config, driver, remotes)
    }

    /// In-process nodes on given tracers, beside the remote nodes of `config`, whose
    /// [`FarmConfig::local`] is not looked at: for tests, benches and devices of one's own.
    ///
    /// # Errors
    /// As [`Farm::new`].
    pub fn with_tracers(config: FarmConfig, tracers: Vec<Arc<dyn Tracer>>) -> Result<Self, Error> {
        let remotes = RemoteNodes::of(&config)?;
        let mut driver = Driver::new(&config);
        for tracer in tracers {
            driver.add_local(tracer);
        }
        Self::start(&config, driver, remotes)
    }

    fn start(
        config: &FarmConfig,
        mut driver: Driver,
        remotes: Option<RemoteNodes>,
    ) -> Result<Self, Error> {
        let calls = remotes.is_some();
        if let Some(RemoteNodes { client, addresses }) = remotes {
            for (node, address) in config.nodes.iter().zip(addresses) {
                driver.add_remote(&client, node.clone(), address);
            }
            driver.keep(client);
        }
        let inputs = driver.inputs();
        let statuses = driver.statuses();
        let (sender, frames) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("carom-coordinator".into())
            .spawn(move || driver.run(&sender))
            .map_err(|source| Error::Socket {
                address: "the coordinator's thread".into(),
                source,
            })?;
        Ok(Self {
            inputs,
            frames,
            statuses,
            thread: Some(thread),
            frames_in_flight_max: config.frames_in_flight,
            credentials: config.credentials.clone(),
            calls,
            scene: None,
            in_flight: VecDeque::new(),
            next_frame: FrameId(0),
        })
    }

    /// Draws `scene` from the next frame on.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the first rule that the scene breaks; the scene before stays.
    pub fn set_scene(&mut self, scene: &Scene) -> Result<(), Error> {
        self.scene = Some(CompiledScene::new(scene)?);
        let scene = Arc::new(scene.clone());
        self.send(DriverInput::Scene(SceneHash::of(&scene), scene));
        Ok(())
    }

    /// Asks for a picture.
    ///
    /// # Errors
    /// [`Error::FramesInFlight`] if as many frames as the configuration allows have been submitted
    /// and not been taken, [`Error::NoScene`] before the first scene, [`Error::Tracer`] if the
    /// update does not fit the scene or a value is out of range.
    pub fn submit(&mut self, spec: FrameSpec) -> Result<FrameId, Error> {
        self.submit_by(spec, None)
    }

    /// Asks for a picture that is of use only if it is shown within `deadline` of now. Then it comes
    /// as it is, with [`Frame::missing`] tiles, and again when it is whole. As soon as a picture
    /// has had to be shown, those before it that have deadlines do not come any more.
    ///
    /// # Errors
    /// As [`Farm::submit`].
    pub fn submit_by(
        &mut self,
        spec: FrameSpec,
        deadline: Option<Duration>,
    ) -> Result<FrameId, Error> {
        let in_flight = self.in_flight.len();
        if in_flight >= self.frames_in_flight_max {
            return Err(Error::FramesInFlight { in_flight });
        }
        self.check(&spec)?;
        let id = self.next_frame;
        self.next_frame = FrameId(id.0 + 1);
        self.in_flight.push_back((id, deadline.is_some()));
        self.send(DriverInput::Submit(id, Box::new(spec), deadline));
        Ok(id)
    }

    /// The next finished frame in the order of submission, if there is one now; or one whose deadline
    /// has passed.
    pub fn poll_frame(&mut self) -> Option<Frame> {
        loop {
            let frame = self.frames.try_recv().ok()?;
            if let Some(frame) = self.take(frame) {
                return Some(frame);
            }
        }
    }

    /// The next frame, for programs without a loop of their own: waits until it is finished, but
    /// not longer than `patience`, and not at all if none is in flight.
    pub fn wait_frame(&mut self, patience: Duration) -> Option<Frame> {
        let deadline = Instant::now() + patience;
        while !self.in_flight.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.frames.recv_timeout(left) {
                Ok(frame) => {
                    if let Some(frame) = self.take(frame) {
                        return Some(frame);
                    }
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return None,
            }
        }
        None
    }

    /// Drops all frames before `id`, also finished ones that have not been taken.
    pub fn cancel_before(&mut self, id: FrameId) {
        self.in_flight.retain(|(frame, _)| *frame >= id);
        self.send(DriverInput::CancelBefore(id));
    }

    /// Frames that have been submitted and neither been taken whole nor cancelled.
    pub fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// How the nodes are, local ones first; at most 20 ms old.
    pub fn nodes(&self) -> Vec<NodeStatus> {
        let statuses = self.statuses.lock().unwrap_or_else(PoisonError::into_inner);
        statuses.clone()
    }

    /// Divides frames in another way from the next one on.
    pub fn set_balancer(&mut self, balancing: Balancing) {
        self.send(DriverInput::Balancing(balancing));
    }

    /// Divides frames by tiles or by samples from the next one on.
    pub fn set_distribution(&mut self, distribution: Distribution) {
        self.send(DriverInput::Distribution(distribution));
    }

    /// Calls another node, as `host:port`, while the farm is running; it takes part once it answers.
    ///
    /// # Errors
    /// [`Error::NodeAddress`] if the address cannot be parsed, [`Error::Config`] if there are as many
    /// nodes as a farm may have, an error of the credentials or [`Error::Socket`] if this is the first remote node and none can be
    /// called.
    pub fn add_node(&mut self, node: &str) -> Result<(), Error> {
        let address = node.parse()?;
        if self.nodes().len() >= NODES_MAX {
            return Err(Error::Config(format!(
                "{node} would be one node too many: at most {NODES_MAX} are allowed"
            )));
        }
        let client = if self.calls {
            None
        } else {
            let credentials = Credentials::load(&self.credentials, Role::Player)?;
            Some(Client::new(&credentials)?)
        };
        self.calls = true;
        self.send(DriverInput::AddRemote(node.to_owned(), address, client));
        Ok(())
    }

    /// Adds an in-process node on `tracer` while the farm is running.
    pub fn add_tracer(&mut self, tracer: Arc<dyn Tracer>) {
        self.send(DriverInput::AddLocal(tracer));
    }

    fn take(&mut self, frame: Frame) -> Option<Frame> {
        // A frame that is not in flight was cancelled while it was on its way here.
        let place = self.in_flight.iter().position(|(id, _)| *id == frame.id)?;
        let (_, has_deadline) = self.in_flight[place];
        if frame.missing.is_empty() {
            self.in_flight.remove(place);
        }
        if has_deadline {
            let comes = |(id, has_deadline): &(FrameId, bool)| *id >= frame.id || !has_deadline;
            self.in_flight.retain(comes);
        }
        Some(frame)
    }

    fn check(&mut self, spec: &FrameSpec) -> Result<(), Error> {
        let scene = self.scene.as_mut().ok_or(Error::NoScene)?;
        spec.size.validate()?;
        spec.settings.validate()?;
        if spec.update.poses.len() > POSES_MAX {
            let fault = SceneError::TooMany {
                what: "poses",
                count: spec.update.poses.len(),
                max: POSES_MAX,
            };
            return Err(carom_tracer::Error::InvalidUpdate(fault).into());
        }
        if let PixelFormat::Srgb8 { exposure } = spec.format
            && !(exposure > 0.0 && exposure.is_finite())
        {
            let fault = SettingsError::Exposure(exposure);
            return Err(carom_tracer::Error::InvalidSettings(fault).into());
        }
        scene.apply(&spec.update)?;
        Ok(())
    }

    fn send(&self, input: DriverInput) {
        // The thread ends only when this handle is dropped, or by a panic that has been reported.
        let _ = self.inputs.send(input);
    }
}

impl Drop for Farm {
    fn drop(&mut self) {
        self.send(DriverInput::Stop);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic has been reported where it happened
        }
    }
}

fn validate(config: &FarmConfig) -> Result<(), Error> {
    let edges = 8..=TILE_EDGE_MAX;
    if !edges.contains(&config.tile_edge) {
        return Err(Error::Config(format!(
            "tile_edge is {}: it must be from {} to {}",
            config.tile_edge,
            edges.start(),
            edges.end()
        )));
    }
    if !(1..=FRAMES_IN_FLIGHT_MAX).contains(&config.frames_in_flight) {
        return Err(Error::Config(format!(
            "frames_in_flight is {}: it must be from 1 to {FRAMES_IN_FLIGHT_MAX}",
            config.frames_in_flight
        )));
    }
    let precision = config.precision.validate();
    precision.map_err(|reason| Error::Config(reason.to_string()))?;
    if config.nodes.len() > NODES_MAX {
        return Err(Error::Config(format!(
            "there are {} nodes: at most {NODES_MAX} are allowed",
            config.nodes.len()
        )));
    }
    Ok(())
}
