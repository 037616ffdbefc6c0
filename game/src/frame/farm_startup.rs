//! Life cycle of the window's farm: start in the background, operation, failure.

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;
use std::time::Duration;

use carom_farm::{Farm, FarmConfig, NodeStatus};
use carom_text::text;
use carom_tracer::Scene;

/// State of the farm. It starts on a thread beside the window, as opening a GPU takes about a second.
pub enum FarmState {
    /// It is starting.
    Starting {
        /// Receives the farm.
        receiver: Receiver<Result<Farm, carom_farm::Error>>,
        /// Scene that was set meanwhile.
        scene: Option<Box<Scene>>,
    },
    /// It is running.
    Ready(Box<Farm>),
    /// It has failed, with the reason.
    Failed(String),
}

impl FarmState {
    /// Starts a farm that traces `scene`.
    pub fn start(config: FarmConfig, scene: Scene) -> Self {
        let (sender, receiver) = channel();
        let start = move || {
            let farm = Farm::new(config).and_then(|mut farm| farm.set_scene(&scene).map(|()| farm));
            // The receiver is gone once the window is closed.
            let _ = sender.send(farm);
        };
        match thread::Builder::new()
            .name("farm-start".to_owned())
            .spawn(start)
        {
            Ok(_) => Self::Starting {
                receiver,
                scene: None,
            },
            Err(error) => Self::Failed(error.to_string()),
        }
    }

    /// Checks whether the farm has started, and returns it if it is ready.
    pub fn poll(&mut self) -> Option<&mut Farm> {
        if let Self::Starting { receiver, scene } = self {
            let started = match receiver.try_recv() {
                Ok(started) => started.map_err(|error| error.to_string()),
                Err(TryRecvError::Empty) => return None,
                Err(TryRecvError::Disconnected) => Err(text!("farm-not-started").to_owned()),
            };
            let scene = scene.take();
            let ready = started.and_then(|mut farm| {
                let set = scene.map_or(Ok(()), |scene| farm.set_scene(&scene));
                set.map(|()| farm).map_err(|error| error.to_string())
            });
            match ready {
                Ok(farm) => *self = Self::Ready(Box::new(farm)),
                Err(why) => self.fail(why),
            }
        }
        self.ready()
    }

    /// The farm, if it is ready.
    pub fn ready(&mut self) -> Option<&mut Farm> {
        match self {
            Self::Ready(farm) => Some(farm),
            Self::Starting { .. } | Self::Failed(_) => None,
        }
    }

    /// Switches to another scene, at once or when the farm has started.
    ///
    /// # Errors
    /// Those of [`Farm::set_scene`].
    pub fn set_scene(&mut self, new: &Scene) -> Result<(), carom_farm::Error> {
        match self {
            Self::Ready(farm) => farm.set_scene(new)?,
            Self::Starting { scene, .. } => *scene = Some(Box::new(new.clone())),
            Self::Failed(_) => {}
        }
        Ok(())
    }

    /// Drops the farm and records the reason.
    pub fn fail(&mut self, why: String) {
        tracing::error!("the farm: {why}");
        *self = Self::Failed(why);
    }

    /// Status of each node; none while the farm starts, or if it has failed.
    pub fn nodes(&self) -> Vec<NodeStatus> {
        match self {
            Self::Ready(farm) => farm.nodes(),
            Self::Starting { .. } | Self::Failed(_) => Vec::new(),
        }
    }
}

impl Drop for FarmState {
    /// Waits for a farm that is still starting: a process must not exit while a thread initialises a GPU
    /// driver.
    fn drop(&mut self) {
        if let Self::Starting { receiver, .. } = self {
            let _ = receiver.recv_timeout(START_SECS_MAX);
        }
    }
}

/// Longest wait for a starting farm when the window is closed; a GPU takes 0.1 to 1.2 s.
const START_SECS_MAX: Duration = Duration::from_secs(3);
