//! Application's handle to a farm: plain calls that do not block unless they say so.

use std::path::PathBuf;
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

use carom_protocol::FrameId;
use carom_protocol::limits::{FRAMES_IN_FLIGHT_MAX, NODES_MAX, TILE_EDGE_MAX};
use carom_tracer::{Scene, Tracer};

use crate::balancer::Balancer;
use crate::config_fault::ConfigFault;
use crate::directory::{Directory, NodeSource};
use crate::driver::{Driver, DriverInput};
use crate::events::FarmEvents;
use crate::net::{Client, Credentials, NodeAddress, Role};
use crate::submitter::Submitter;
use crate::{
    Balancing, Distribution, Error, FarmConfig, Frame, FrameSpec, LocalNode, NodeStatus,
    SceneHandle, Submission, local_devices,
};

/// Many nodes used as one tracer.
///
/// A separate thread runs the coordinator; calls send it messages. Frames wait while no node can trace
/// them, and [`Farm::nodes`] states why. Dropping the farm ends everything that it has started.
pub struct Farm {
    inputs: mpsc::Sender<DriverInput>,
    submitter: Submitter,
    thread: Option<JoinHandle<()>>,
    credentials: PathBuf,
    /// Whether the coordinator has a network client.
    calls: bool,
    scene: Option<SceneHandle>,
}

/// Network client and addresses of the remote nodes of a configuration.
struct RemoteNodes {
    client: Client,
    /// Addresses with the text that names each.
    addresses: Vec<(String, NodeAddress)>,
    directories: Vec<Box<dyn Directory>>,
}

impl RemoteNodes {
    /// Opens what the remote nodes of a configuration need; `None` if it has none.
    ///
    /// # Errors
    /// Faults of the configuration or of the credentials.
    fn of(config: &FarmConfig) -> Result<Option<Self>, Error> {
        validate(config)?;
        if config.nodes.is_empty() {
            return Ok(None);
        }
        let mut addresses: Vec<(String, NodeAddress)> = Vec::new();
        let mut directories = Vec::new();
        for node in &config.nodes {
            let address = match node.parse()? {
                NodeSource::Node(address) => address,
                directory => {
                    directories.push(directory.open()?);
                    continue;
                }
            };
            if addresses.iter().any(|(_, known)| *known == address) {
                tracing::warn!("{node} is named twice: it counts as one node");
                continue;
            }
            addresses.push((node.clone(), address));
        }
        let credentials = Credentials::load(&config.credentials, Role::Player)?;
        let client = Client::new(&credentials)?;
        Ok(Some(Self {
            client,
            addresses,
            directories,
        }))
    }
}

impl Farm {
    /// Starts the local node and connects to the remote ones, without waiting for either.
    ///
    /// # Errors
    /// [`Error::Config`] if a value is out of range, [`Error::NodeAddress`] if an address cannot be parsed,
    /// an error of the credentials or [`Error::Socket`] if there are remote nodes and no connections can be
    /// made, [`Error::Tracer`] if [`LocalNode::Gpu`] is requested and there is none.
    pub fn new(config: FarmConfig) -> Result<Self, Error> {
        // Before any device is opened: a process that exits over a configuration error while another thread
        // loads a graphics driver may be killed by that driver.
        let remotes = RemoteNodes::of(&config)?;
        let mut driver = Driver::new(&config);
        let threads = usize::from(config.threads);
        match config.local {
            LocalNode::None => {}
            LocalNode::Auto => driver.add_local_later(move || local_devices::auto(threads)),
            LocalNode::Cpu => driver.add_local(local_devices::cpu(threads)?),
            LocalNode::Gpu => driver.add_local(local_devices::gpu()?),
        }
        Self::start(&config, driver, remotes)
    }

    /// The farm of the current environment, see [`FarmConfig::discover`]: without any set-up, all devices
    /// of this machine.
    ///
    /// # Errors
    /// As [`FarmConfig::discover`] and [`Farm::new`].
    pub fn auto() -> Result<Self, Error> {
        Self::new(FarmConfig::discover()?)
    }

    /// A farm with in-process nodes on the given tracers, beside the remote nodes of `config`;
    /// [`FarmConfig::local`] is ignored. For tests, benches and custom devices.
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
        if let Some(remotes) = remotes {
            for (node, address) in remotes.addresses {
                driver.call(&remotes.client, node, address);
            }
            driver.keep(remotes.client);
            for directory in remotes.directories {
                driver.add_directory(directory);
            }
        }
        let inputs = driver.inputs();
        let (in_flight, timeout_secs) = (config.frames_in_flight, config.timeout_secs);
        let submitter = Submitter::new(inputs.clone(), driver.board(), in_flight, timeout_secs);
        let thread = std::thread::Builder::new()
            .name("carom-coordinator".into())
            .spawn(move || driver.run())
            .map_err(Error::Thread)?;
        Ok(Self {
            inputs,
            submitter,
            thread: Some(thread),
            credentials: config.credentials.clone(),
            calls,
            scene: None,
        })
    }

    /// Traces `scene` from the next frame on.
    ///
    /// # Errors
    /// [`Error::Tracer`] with the first rule that the scene breaks, [`Error::Protocol`] if it has more than
    /// 128 MiB; the previous scene then stays.
    pub fn set_scene(&mut self, scene: &Scene) -> Result<(), Error> {
        self.scene = Some(self.send_scene(scene)?);
        Ok(())
    }

    /// The scene set last.
    pub fn scene(&self) -> Option<&SceneHandle> {
        self.scene.as_ref()
    }

    /// Submits a frame of the highest priority, without a deadline.
    ///
    /// # Errors
    /// As [`Farm::submit_with`].
    pub fn submit(&mut self, spec: FrameSpec) -> Result<FrameId, Error> {
        self.submit_with(spec, Submission::default())
    }

    /// Submits a frame on the given terms. Frames of different priorities are counted separately.
    ///
    /// # Errors
    /// [`Error::FramesInFlight`] if as many frames of its priority as the configuration allows, or
    /// [`FRAMES_IN_FLIGHT_MAX`] background frames, have been submitted and not been taken,
    /// [`Error::NoScene`] before the first scene, [`Error::Tracer`] if the update does not fit the scene or
    /// a value is out of range.
    pub fn submit_with(
        &mut self,
        spec: FrameSpec,
        mut submission: Submission,
    ) -> Result<FrameId, Error> {
        let scene = submission.scene.take().or_else(|| self.scene.clone());
        let scene = scene.ok_or(Error::NoScene)?;
        self.submitter.submit(spec, submission, scene)
    }

    /// The next finished frame, in the order of submission within a priority, if there is one now; or one
    /// whose deadline has passed.
    pub fn poll_frame(&mut self) -> Option<Frame> {
        self.submitter.poll_frame()
    }

    /// The next frame, for programs without a main loop: waits until it is finished, at most for
    /// `patience`, and not at all if none is in flight.
    pub fn wait_frame(&mut self, patience: Duration) -> Option<Frame> {
        self.submitter.wait_frame(patience)
    }

    /// Drops all interactive frames before `id`, including finished ones that have not been taken.
    pub fn cancel_before(&mut self, id: FrameId) {
        self.submitter.cancel_before(id);
    }

    /// Drops a frame.
    pub fn cancel(&mut self, id: FrameId) {
        self.submitter.cancel(id);
    }

    /// Number of interactive frames that have been submitted and neither been taken complete nor cancelled.
    pub fn in_flight(&self) -> usize {
        self.submitter.in_flight()
    }

    /// Status of the nodes, local ones first; at most 20 ms old.
    pub fn nodes(&self) -> Vec<NodeStatus> {
        self.submitter.nodes()
    }

    /// Checks for nodes, for programs that wait for them: to be called now and then while no frame comes.
    /// After three seconds without a node, a warning with the reasons is logged.
    ///
    /// # Errors
    /// [`Error::NoNodes`] when none has answered for [`FarmConfig::timeout_secs`]; [`Error::FrameRefused`]
    /// once after every node has refused a frame, which is no longer in flight then.
    pub fn check_nodes(&mut self) -> Result<(), Error> {
        self.submitter.check_nodes()
    }

    /// Events from now on: nodes that come and go, frames that are finished.
    pub fn events(&self) -> FarmEvents {
        let (sender, events) = FarmEvents::new();
        self.send(DriverInput::Watch(sender));
        events
    }

    /// Sets the balancing of the frames from the next one on.
    pub fn set_balancing(&mut self, balancing: Balancing) {
        self.send(DriverInput::Balancing(balancing));
    }

    /// Divides frames with an application's own algorithm from the next one on, with hedging;
    /// [`Farm::set_balancing`] with an unhedged [`crate::Algorithm::Own`] turns the hedging off.
    pub fn set_balancer(&mut self, balancer: impl Balancer + Send + 'static) {
        self.send(DriverInput::Balancer(Box::new(balancer)));
    }

    /// Divides frames by tiles or by samples from the next one on.
    pub fn set_distribution(&mut self, distribution: Distribution) {
        self.send(DriverInput::Distribution(distribution));
    }

    /// Connects to another node, or those of a directory, named as in [`FarmConfig::nodes`], while the farm
    /// is running; it takes part once it answers.
    ///
    /// # Errors
    /// [`Error::NodeAddress`] if the address cannot be parsed, [`Error::Config`] if there are as many nodes
    /// as a farm may have, an error of the credentials or [`Error::Socket`] if this is the first remote
    /// node and no connections can be made.
    pub fn add_node(&mut self, node: &str) -> Result<(), Error> {
        let address = match node.parse()? {
            NodeSource::Node(address) => address,
            directory => return self.add_directory(directory.open()?),
        };
        nodes_fit(self.nodes().len() + 1)?;
        let client = self.first_client()?;
        self.send(DriverInput::AddRemote(node.to_owned(), address, client));
        Ok(())
    }

    /// Connects to the nodes that a directory lists, now and later; they take part once they answer.
    ///
    /// # Errors
    /// An error of the credentials or [`Error::Socket`] if these are the first remote nodes and no
    /// connections can be made.
    pub fn add_directory(&mut self, directory: Box<dyn Directory>) -> Result<(), Error> {
        let client = self.first_client()?;
        self.send(DriverInput::AddDirectory(directory, client));
        Ok(())
    }

    /// A new network client, unless the coordinator has one.
    fn first_client(&mut self) -> Result<Option<Client>, Error> {
        if self.calls {
            return Ok(None);
        }
        let credentials = Credentials::load(&self.credentials, Role::Player)?;
        let client = Client::new(&credentials)?;
        self.calls = true;
        Ok(Some(client))
    }

    /// Adds an in-process node on `tracer` while the farm is running.
    pub fn add_tracer(&mut self, tracer: Arc<dyn Tracer>) {
        self.send(DriverInput::AddLocal(tracer));
    }

    /// A submitter to this farm that sees only its own frames.
    pub(crate) fn submitter(&self) -> Submitter {
        self.submitter.another()
    }

    /// Announces a scene to the nodes, for frames that name it.
    pub(crate) fn announce(&self, scene: &Scene) -> Result<SceneHandle, Error> {
        scene.validate_visible()?;
        match &self.scene {
            Some(known) if *known.scene == *scene => Ok(known.clone()),
            _ => self.send_scene(scene),
        }
    }

    fn send_scene(&self, scene: &Scene) -> Result<SceneHandle, Error> {
        let scene = SceneHandle::new(scene)?;
        self.send(DriverInput::Scene(Arc::clone(&scene.encoded)));
        Ok(scene)
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

fn nodes_fit(count: usize) -> Result<(), ConfigFault> {
    match count {
        0..=NODES_MAX => Ok(()),
        _ => Err(ConfigFault::TooManyNodes {
            count,
            max: NODES_MAX,
        }),
    }
}

fn validate(config: &FarmConfig) -> Result<(), Error> {
    let in_range = |field, value: usize, min: usize, max: usize| match value {
        value if (min..=max).contains(&value) => Ok(()),
        value => Err(ConfigFault::OutOfRange {
            field,
            value,
            min,
            max,
        }),
    };
    let (edge, edge_max) = (config.tile_edge.into(), TILE_EDGE_MAX.into());
    in_range("tile_edge", edge, TILE_EDGE_MIN, edge_max)?;
    let in_flight = config.frames_in_flight;
    in_range("threads", config.threads.into(), 0, THREADS_MAX)?;
    in_range("frames_in_flight", in_flight, 1, FRAMES_IN_FLIGHT_MAX)?;
    config
        .precision
        .validate()
        .map_err(ConfigFault::Precision)?;
    nodes_fit(config.nodes.len())?;
    Ok(())
}

/// Maximum CPU threads of the local node: more than machines have cores, and fewer than systems refuse.
const THREADS_MAX: usize = 1024;
/// Minimum tile edge in pixels: of smaller tiles, the message overhead outweighs the pixels.
const TILE_EDGE_MIN: usize = 8;
