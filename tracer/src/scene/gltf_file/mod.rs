//! Scenes from glTF 2.0 files (Khronos Group, "glTF 2.0 Specification", ISO/IEC 12113:2022).
//!
//! Supported are the nodes of the file's scene with their meshes, as one object per primitive;
//! materials with their textures, alpha modes and vertex colours (`COLOR_0`); lights
//! (`KHR_lights_punctual`); and the first perspective camera. The file's +y axis becomes +z. The
//! extensions `KHR_materials_clearcoat`, `KHR_materials_emissive_strength`, `KHR_materials_ior`,
//! `KHR_materials_sheen`, `KHR_materials_specular` and `KHR_texture_transform` are supported too.
//! Animations, skins and morph targets are evaluated at a given time ([`AnimatedScene`]). Surfaces
//! of a transmissive material (`KHR_materials_transmission`) are thin walls, whose base colour
//! tints the transmitted light. Closed meshes of a material that also has a thickness
//! (`KHR_materials_volume`) and transmits at least half of its light, averaged over its texture,
//! are dielectrics instead, which absorb light as the volume specifies and are not tinted by the
//! base colour.
//!
//! All meshes are visible from both sides, as in Blender and Mitsuba. `doubleSided` is ignored,
//! since a path tracer's light also reaches the back of a wall, and a wall that is transparent to
//! the camera only would still cast a shadow. `occlusionTexture` is ignored too, as occlusion is
//! traced. Files that require other extensions, contain points or lines, or use several sets of
//! texture coordinates in one material are refused.
//!
//! The file's JSON is parsed by the crate `gltf-json`; buffers and images are read here.

mod accessor;
mod animated_scene;
mod animation;
#[cfg(test)]
mod animation_tests;
mod container;
mod deformation;
mod layers;
mod material;
#[cfg(test)]
mod material_tests;
mod node;
mod pose;
#[cfg(test)]
mod tests;
mod track;

use std::fmt::Display;
use std::path::Path;

use gltf_json::Root;
use gltf_json::validation::Checked;

pub use self::animated_scene::{AnimatedScene, AnimationTime};
pub use self::animation::Animation;
use self::container::Files;
use super::Scene;
use crate::Error;

/// Maximum total size in bytes of a glTF file and the files that it refers to: ten million
/// triangles take 0.7 GB, and textures may take as much again.
pub const GLTF_BYTES_MAX: u64 = 2 << 30;
/// Maximum size in bytes of a glTF file's JSON, including embedded data.
pub const GLTF_JSON_BYTES_MAX: usize = 256 << 20;

/// The reason why a file is refused.
type Refusal = String;

/// The element at an index that the file refers to.
fn find<T>(list: &[T], place: usize, what: impl Display) -> Result<&T, Refusal> {
    let found = list.get(place);
    found.ok_or_else(|| format!("{what} {place} does not exist"))
}

/// The value of an enumeration of the file, or an error if glTF does not define it.
fn known<T: Copy>(word: &Checked<T>, refusal: impl FnOnce() -> Refusal) -> Result<T, Refusal> {
    match word {
        Checked::Valid(known) => Ok(*known),
        Checked::Invalid => Err(refusal()),
    }
}

impl Scene {
    /// Reads and checks a glTF 2.0 file, `.gltf` or `.glb`, and the files beside it that it refers
    /// to.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be read; [`Error::Format`] with the place and the value if it
    /// is not glTF, needs an unsupported feature, is larger than [`GLTF_BYTES_MAX`] or breaks a
    /// rule of [`super::validate`].
    pub fn load_gltf(path: impl AsRef<Path>) -> Result<Self, Error> {
        AnimatedScene::load(path).map(AnimatedScene::into_rest)
    }

    /// Reads and checks self-contained glTF 2.0: the bytes of a `.glb`, or JSON with `data:` URIs.
    ///
    /// # Errors
    /// [`Error::InvalidScene`], for the same reasons as [`Scene::load_gltf`].
    pub fn from_gltf(bytes: &[u8]) -> Result<Self, Error> {
        AnimatedScene::from_gltf(bytes).map(AnimatedScene::into_rest)
    }
}

/// The reason why a file cannot be read as a scene.
enum Fault {
    Refused(Refusal),
    /// An error of a file that it refers to.
    File(Error),
}

impl From<Refusal> for Fault {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// A parsed file with its buffers.
#[derive(Debug)]
struct Document {
    root: Root,
    buffers: Vec<Vec<u8>>,
    /// Number of morph targets of each mesh.
    targets: Vec<usize>,
    /// BLAKE3 hash of its JSON and buffers.
    hash: [u8; 32],
}

impl Document {
    fn read(bytes: &[u8], files: &mut Files) -> Result<Self, Fault> {
        let (json, binary) = container::split(bytes)?;
        if json.len() > GLTF_JSON_BYTES_MAX {
            let max = GLTF_JSON_BYTES_MAX;
            return Err(format!("its JSON is longer than {max} bytes").into());
        }
        let root =
            Root::from_slice(json).map_err(|error| format!("its JSON is no glTF 2.0: {error}"))?;
        check(&root)?;
        let buffers = container::buffers(&root, binary, files)?;
        let targets = pose::targets(&root)?;
        let mut hash = blake3::Hasher::new();
        hash.update(json);
        for buffer in &buffers {
            hash.update(buffer);
        }
        Ok(Self {
            root,
            buffers,
            targets,
            hash: hash.finalize().into(),
        })
    }
}

const EXTENSIONS: [&str; 9] = [
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_texture_transform",
];

fn check(root: &Root) -> Result<(), Refusal> {
    let version = &root.asset.version;
    if !version.starts_with("2.") {
        return Err(format!("it is of glTF {version}: it must be of version 2"));
    }
    let mut required = root.extensions_required.iter();
    match required.find(|name| !EXTENSIONS.contains(&name.as_str())) {
        Some(name) => Err(format!(
            "it requires the extension {name}, which is not read"
        )),
        None => Ok(()),
    }
}
