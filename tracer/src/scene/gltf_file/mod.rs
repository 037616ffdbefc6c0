//! Scenes from glTF 2.0 files (Khronos Group, "glTF 2.0 Specification", ISO/IEC 12113:2022).
//!
//! Read are the nodes of the file's scene with their meshes, as one object for each primitive of each; materials with
//! their textures, alpha modes and vertex colours (`COLOR_0`); lights (`KHR_lights_punctual`); and the first perspective
//! camera. Its +y is this tracer's +z. The extensions `KHR_materials_clearcoat`, `KHR_materials_emissive_strength`,
//! `KHR_materials_ior`, `KHR_materials_sheen`, `KHR_materials_specular` and `KHR_texture_transform` are read too. Animations,
//! skins and morph targets give the scene at a time ([`AnimatedScene`]). Surfaces of a material that transmits light
//! (`KHR_materials_transmission`) are thin walls, whose base colour tints what passes. Closed meshes of one that has a thickness too
//! (`KHR_materials_volume`) and transmits half of its light or more, on average over its texture, are dielectrics instead, which
//! absorb as the volume says and which the base colour does not tint.
//!
//! All meshes are seen from both sides, as Blender and Mitsuba have them: `doubleSided` is passed over, since a path tracer's
//! light comes to the back of a wall as well, and one that only the camera looks through would still cast its shadow. Passed
//! over is also `occlusionTexture`, which stands for what is traced here. A file that requires another extension, holds points or
//! lines, or lays the textures of one material in more than one way, is refused.
//!
//! The types of the file's JSON are those of the crate `gltf-json`; its buffers and images are read here.

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

/// The most bytes of a glTF file and the files that it names, together: ten million triangles have 0.7 GB, and as much
/// again may be textures.
pub const GLTF_BYTES_MAX: u64 = 2 << 30;
/// The longest JSON of a glTF file in bytes, data within it included.
pub const GLTF_JSON_BYTES_MAX: usize = 256 << 20;

/// Why a file is refused.
type Refusal = String;

/// The element of a list that a file refers to by its place.
fn find<T>(list: &[T], place: usize, what: impl Display) -> Result<&T, Refusal> {
    let found = list.get(place);
    found.ok_or_else(|| format!("{what} {place} does not exist"))
}

/// A word of a file, unless it is one that glTF does not know.
fn known<T: Copy>(word: &Checked<T>, refusal: impl FnOnce() -> Refusal) -> Result<T, Refusal> {
    match word {
        Checked::Valid(known) => Ok(*known),
        Checked::Invalid => Err(refusal()),
    }
}

impl Scene {
    /// Reads and checks a glTF 2.0 file, `.gltf` or `.glb`, and the files beside it that it names.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be read; [`Error::Format`] with the place and the value if it is no glTF, needs what
    /// is not read, has more than [`GLTF_BYTES_MAX`] or breaks a rule of [`super::validate`].
    pub fn load_gltf(path: impl AsRef<Path>) -> Result<Self, Error> {
        AnimatedScene::load(path).map(AnimatedScene::into_rest)
    }

    /// Reads and checks glTF 2.0 that holds all that it needs: the bytes of a `.glb`, or JSON with `data:` URIs.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] as [`Scene::load_gltf`].
    pub fn from_gltf(bytes: &[u8]) -> Result<Self, Error> {
        AnimatedScene::from_gltf(bytes).map(AnimatedScene::into_rest)
    }
}

/// Why no scene comes of a file.
enum Fault {
    Refused(Refusal),
    /// A file that it names.
    File(Error),
}

impl From<Refusal> for Fault {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// A file with its buffers.
#[derive(Debug)]
struct Document {
    root: Root,
    buffers: Vec<Vec<u8>>,
    /// Morph targets of each mesh.
    targets: Vec<usize>,
    /// Of its JSON and buffers.
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
