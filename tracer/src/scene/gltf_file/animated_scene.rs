//! Animated scenes of glTF files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::animation::{self, Animation};
use super::container::Files;
use super::material::{self, MaterialEntry};
use super::node::NodeCamera;
use super::pose::{Hierarchy, Pose};
use super::{Document, Fault, Refusal, node};
use crate::scene::{Camera, Scene, SceneUpdate};
use crate::text::{SENTENCE_BYTES_MAX, printable};
use crate::{Error, SceneError};

/// A glTF 2.0 file with its animations, from which the scene at any time is available without
/// reading the file again.
///
/// Nodes, cameras and lights move; skins and morph targets deform meshes. A quantity is constant
/// before its first key frame and after its last one.
#[derive(Debug)]
pub struct AnimatedScene {
    path: Option<PathBuf>,
    document: Document,
    materials: Vec<MaterialEntry>,
    hierarchy: Hierarchy,
    animations: Vec<Animation>,
    cameras: Vec<NodeCamera>,
    rest: Arc<Scene>,
}

/// A time in an [`AnimatedScene`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnimationTime {
    /// The file's scene without animations.
    Rest,
    /// Index of an animation in [`AnimatedScene::animations`], and the time in seconds from its
    /// start.
    At(usize, f64),
}

impl AnimatedScene {
    /// Reads and checks a glTF 2.0 file, `.gltf` or `.glb`, and the files beside it that it refers
    /// to.
    ///
    /// # Errors
    /// As for [`Scene::load_gltf`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let mut files = Files::beside(path);
        let bytes = files.read(path)?;
        Self::read(&bytes, &mut files, Some(path))
    }

    /// Reads and checks self-contained glTF 2.0: the bytes of a `.glb`, or JSON with `data:` URIs.
    ///
    /// # Errors
    /// As for [`Scene::from_gltf`].
    pub fn from_gltf(bytes: &[u8]) -> Result<Self, Error> {
        Self::read(bytes, &mut Files::none(), None)
    }

    fn read(bytes: &[u8], files: &mut Files, path: Option<&Path>) -> Result<Self, Error> {
        let refused = |refusal| refused(path, refusal);
        let of_fault = |fault| match fault {
            Fault::File(error) => error,
            Fault::Refused(refusal) => refused(refusal),
        };
        let document = Document::read(bytes, files).map_err(of_fault)?;
        let mut rest = Scene::new();
        let materials = material::read(&document, files, &mut rest).map_err(of_fault)?;
        let hierarchy = Hierarchy::read(&document).map_err(refused)?;
        let pose = hierarchy.pose(&document, None);
        let camera = node::read(&document, &materials, &hierarchy, &pose, &mut rest);
        let camera = camera.map_err(refused)?;
        rest.camera = camera.unwrap_or_else(|| node::framed(&rest));
        validate(path, &rest)?;
        let animations = animation::read(&document).map_err(refused)?;
        let cameras = node::cameras(&document, &hierarchy).map_err(refused)?;
        Ok(Self {
            path: path.map(Path::to_owned),
            document,
            materials,
            hierarchy,
            animations,
            cameras,
            rest: Arc::new(rest),
        })
    }

    /// The animations, in the order of the file.
    pub fn animations(&self) -> &[Animation] {
        &self.animations
    }

    /// The index of the animation with this name, or else with this index as a decimal number.
    ///
    /// # Errors
    /// [`Error::Format`] with the names of the existing animations.
    pub fn find_animation(&self, name: &str) -> Result<usize, Error> {
        let mut animations = self.animations.iter();
        let by_name = animations.position(|animation| animation.name() == name);
        let by_number = || {
            let number: Option<usize> = name.parse().ok();
            number.filter(|number| *number < self.animations.len())
        };
        by_name.or_else(by_number).ok_or_else(|| {
            let names = self.animations.iter().enumerate();
            let names = names.map(|(index, animation)| format!("{index} `{}`", animation.name()));
            let names: Vec<_> = names.collect();
            self.refused(match names.as_slice() {
                [] => format!("it has no animation `{name}`, nor any other"),
                names => format!("it has no animation `{name}`, but {}", names.join(", ")),
            })
        })
    }

    /// Names of the perspective cameras of the file's scene, in the order of its nodes; the first
    /// one is [`Scene::camera`]. A camera without a name has its node's, which may be empty.
    pub fn cameras(&self) -> impl ExactSizeIterator<Item = &str> {
        self.cameras.iter().map(|camera| camera.name.as_str())
    }

    /// The camera with this index in [`AnimatedScene::cameras`] at a time.
    ///
    /// # Errors
    /// [`Error::Format`] if there is no such camera or animation, the time is not finite, or the
    /// camera is invalid at that time.
    pub fn camera(&self, index: usize, time: AnimationTime) -> Result<Camera, Error> {
        let count = self.cameras.len();
        let camera = self.cameras.get(index).ok_or_else(|| {
            self.refused(format!("it has no camera {index}, but {count} cameras"))
        })?;
        let pose = self.pose(time)?;
        let camera = node::camera_of(&self.document, &pose, camera.node);
        let camera = camera.map_err(|refusal| self.refused(refusal))?;
        let checked = camera.validate();
        checked.map_err(|fault| self.refused(format!("camera {index}: {fault}")))?;
        Ok(camera)
    }

    /// BLAKE3 hash of the file's JSON and buffers, on which everything but its images depends.
    pub fn content_hash(&self) -> [u8; 32] {
        self.document.hash
    }

    /// The file's scene without animations.
    pub fn rest(&self) -> &Arc<Scene> {
        &self.rest
    }

    pub(super) fn into_rest(self) -> Scene {
        Arc::unwrap_or_clone(self.rest)
    }

    /// The scene at a time. If the file has no camera, that of the scene at rest is used.
    ///
    /// # Errors
    /// [`Error::Format`] if there is no such animation, the time is not finite, or the scene breaks
    /// a rule of [`crate::scene::validate`] at that time.
    pub fn scene(&self, time: AnimationTime) -> Result<Scene, Error> {
        if time == AnimationTime::Rest {
            return Ok(Scene::clone(&self.rest));
        }
        let pose = self.pose(time)?;
        let rest = &self.rest;
        let mut scene = Scene::new();
        scene.camera = rest.camera;
        scene.materials.clone_from(&rest.materials);
        scene.textures.clone_from(&rest.textures);
        let (document, materials) = (&self.document, &self.materials);
        let camera = node::read(document, materials, &self.hierarchy, &pose, &mut scene);
        let camera = camera.map_err(|refusal| self.refused(refusal))?;
        scene.camera = camera.unwrap_or(rest.camera);
        validate(self.path.as_deref(), &scene)?;
        Ok(scene)
    }

    /// The update that takes the scene at time `from` to that at time `to`; `None` if more differs
    /// than the poses of objects and the camera, so that [`AnimatedScene::scene`] is needed.
    ///
    /// # Errors
    /// As for [`AnimatedScene::scene`].
    pub fn update(
        &self,
        from: AnimationTime,
        to: AnimationTime,
    ) -> Result<Option<SceneUpdate>, Error> {
        let (before, after) = (self.pose(from)?, self.pose(to)?);
        node::update(&self.document, &self.hierarchy, &before, &after)
            .map_err(|refusal| self.refused(refusal))
    }

    fn pose(&self, time: AnimationTime) -> Result<Pose, Error> {
        let at = match time {
            AnimationTime::Rest => None,
            AnimationTime::At(index, secs) => {
                let animation = self.animations.get(index);
                let count = self.animations.len();
                let animation = animation.ok_or_else(|| {
                    self.refused(format!(
                        "it has no animation {index}, but {count} animations"
                    ))
                })?;
                if !secs.is_finite() {
                    return Err(self.refused(format!("the time is {secs} s: it must be finite")));
                }
                Some((animation, secs))
            }
        };
        Ok(self.hierarchy.pose(&self.document, at))
    }

    fn refused(&self, refusal: Refusal) -> Error {
        refused(self.path.as_deref(), refusal)
    }
}

fn refused(path: Option<&Path>, refusal: Refusal) -> Error {
    match path {
        Some(path) => Error::format(path, printable(&refusal, SENTENCE_BYTES_MAX)),
        None => Error::InvalidScene(SceneError::rule(refusal)),
    }
}

fn validate(path: Option<&Path>, scene: &Scene) -> Result<(), Error> {
    let checked = scene.validate();
    checked.map_err(|error| match path {
        Some(path) => error.in_file(path),
        None => error,
    })
}
