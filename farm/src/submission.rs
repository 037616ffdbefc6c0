//! Terms on which frames are submitted: priority, deadline and scene.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use carom_protocol::limits::POSES_MAX;
use carom_protocol::{EncodedScene, SceneHash};
use carom_tracer::{CompiledScene, Scene, SceneError, SettingsError};

use crate::error::Error;
use crate::frame::FrameSpec;
use crate::lock::lock;

/// Order in which frames are served.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Priority {
    /// In the order of submission, before all others.
    #[default]
    Interactive,
    /// Traced where nothing interactive waits, some milliseconds of a node at a time: what is refined
    /// or written to files beside an interactive view.
    Background,
}

/// Terms on which a frame is submitted.
#[derive(Clone, Debug, Default)]
pub struct Submission {
    /// Its place among other frames.
    pub priority: Priority,
    /// Time from now by which it has to be shown. Then it comes as it is, with [`crate::Frame::missing`]
    /// tiles, and again when it is whole. As soon as it has had to be shown, earlier ones with
    /// deadlines do not come any more. Frames in the background have none.
    pub deadline: Option<Duration>,
    /// Whether pixels come exactly, however slow a link is: for files. Otherwise sRGB pixels come as
    /// [`crate::FarmConfig::precision`] has it.
    pub exact: bool,
    /// Its scene; absent, the one that was set last.
    pub scene: Option<SceneHandle>,
}

/// A scene that a farm has been given: frames of it can be submitted also after
/// [`crate::Farm::set_scene`] has been called with another.
#[derive(Clone, Debug)]
pub struct SceneHandle {
    pub(crate) scene: Arc<Scene>,
    /// What nodes are sent of it.
    pub(crate) encoded: Arc<EncodedScene>,
    /// Only to check updates with.
    compiled: Arc<Mutex<CompiledScene>>,
}

impl SceneHandle {
    pub(crate) fn new(scene: &Scene) -> Result<Self, Error> {
        let compiled = CompiledScene::new(scene)?;
        Ok(Self {
            scene: Arc::new(scene.clone()),
            encoded: EncodedScene::new(scene)?,
            compiled: Arc::new(Mutex::new(compiled)),
        })
    }

    pub(crate) fn hash(&self) -> SceneHash {
        self.encoded.hash()
    }

    /// The first rule that a frame of the scene breaks.
    pub(crate) fn check(&self, spec: &FrameSpec) -> Result<(), Error> {
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
        let checked = spec.format.validate();
        let checked = checked.map_err(|why| SettingsError(why.to_string()));
        checked.map_err(carom_tracer::Error::InvalidSettings)?;
        let mut compiled = lock(&self.compiled);
        compiled.apply(&spec.update)?;
        Ok(())
    }
}
