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
    /// In order of submission, before all background frames.
    #[default]
    Interactive,
    /// Traced where nothing interactive waits, some milliseconds of a node at a time: for refinement, or
    /// files written beside an interactive view.
    Background,
}

/// Terms on which a frame is submitted.
#[derive(Clone, Debug, Default)]
pub struct Submission {
    /// Its priority among other frames.
    pub priority: Priority,
    /// Time from the submission by which it must be shown. It is then delivered as it is, with
    /// [`crate::Frame::missing`] tiles, and again once complete. From then on, earlier frames with
    /// deadlines are no longer delivered. Background frames have none.
    pub deadline: Option<Duration>,
    /// Whether pixels are transmitted exactly, however slow a link is: for files. Otherwise sRGB pixels
    /// have the precision of [`crate::FarmConfig::precision`].
    pub exact: bool,
    /// Its scene; absent, the one set last.
    pub scene: Option<SceneHandle>,
}

/// A scene that a farm holds: its frames can be submitted even after [`crate::Farm::set_scene`] has been
/// called with another.
#[derive(Clone, Debug)]
pub struct SceneHandle {
    pub(crate) scene: Arc<Scene>,
    /// Its encoding for the nodes.
    pub(crate) encoded: Arc<EncodedScene>,
    /// Compiled form, for the validation of updates.
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

    /// Validates a frame of the scene. The error is the first rule that it breaks.
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
