//! Mesh files: Wavefront OBJ and Stanford PLY.
//!
//! Both are parsed here rather than by a library, so that messages can name the line and the value.
//! Supported are positions, normals and faces (triangulated as fans from their first corner); of
//! OBJ texture coordinates, if all corners have them; and of PLY vertex colours (red, green, blue
//! and optionally alpha), which are sRGB. [`ObjScene`] reads an OBJ file with its MTL materials.
//! Groups are ignored.

mod mtl;
#[cfg(all(test, feature = "image-io"))]
mod mtl_tests;
mod obj;
mod ply;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Write as _;
use std::path::Path;

use glam::Vec3;

use super::file::read_limited;
use super::validate::{NAME_BYTES_MAX, TRIANGLES_MAX, VERTICES_MAX};
use super::{ImageTexture, Material, Mesh, Scene};
use crate::Error;
use crate::text::{SENTENCE_BYTES_MAX, printable};

/// Maximum size of a mesh file in bytes: ten million triangles take 0.7 GB as text.
pub const MESH_BYTES_MAX: u64 = 1 << 30;

/// An OBJ file with its materials.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjScene {
    /// One mesh per material, in the order in which the file first uses them.
    pub parts: Vec<ObjPart>,
    /// Textures, into which those of materials are indices.
    pub textures: Vec<ImageTexture>,
}

/// The faces of one material.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjPart {
    /// The material's name; empty for faces without one.
    pub name: String,
    /// The material; `None` for faces without one.
    pub material: Option<Material>,
    /// All faces with this material.
    pub mesh: Mesh,
}

impl ObjScene {
    /// Reads an OBJ file, the MTL files beside it that it refers to, and their textures.
    ///
    /// # Errors
    /// As for [`Mesh::load`]; also [`Error::Format`], with the file, the line and the value, if a
    /// referenced file does not exist or a material cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let bytes = read_mesh_file(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::read(&bytes, folder).map_err(|message| format(path, &message))
    }

    fn read(bytes: &[u8], folder: &Path) -> Result<Self, Refusal> {
        let reader = obj::ObjReader::read(bytes, true)?;
        let mut library = mtl::MaterialLibrary::default();
        for (file, line) in &reader.libraries {
            let read = library.read(folder, file);
            read.map_err(|why| format!("line {line}: {why}"))?;
        }
        let parts = reader.finish()?.into_iter().map(|faces| {
            let Some((name, line)) = faces.material else {
                return Ok(ObjPart {
                    name: String::new(),
                    material: None,
                    mesh: faces.mesh,
                });
            };
            let material = library.materials.get(&name).copied();
            let material = material.ok_or_else(|| {
                format!("line {line}: the material `{name}` is in none of its mtllib files")
            })?;
            if material.has_textures() && faces.mesh.uvs.is_empty() {
                return Err(format!(
                    "line {line}: the material `{name}` has textures, but not all corners of its faces have texture \
                     coordinates"
                ));
            }
            Ok(ObjPart {
                name,
                material: Some(material),
                mesh: faces.mesh,
            })
        });
        Ok(Self {
            parts: parts.collect::<Result<_, Refusal>>()?,
            textures: library.textures,
        })
    }

    /// Adds the parts to a scene; parts without a material get `otherwise`.
    pub fn add_to(self, scene: &mut Scene, otherwise: Material) {
        let first = scene.textures.len() as u32;
        for texture in self.textures {
            scene.add_texture(texture);
        }
        for part in self.parts {
            let material = part.material.unwrap_or(otherwise);
            let textures = material.textures().shifted(first);
            let name = printable(&part.name, NAME_BYTES_MAX);
            scene.add_named(name, part.mesh, material.textured(textures));
        }
    }
}

impl Mesh {
    /// Reads an OBJ or PLY file, as its file name's extension says.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Format`] with the place and the value if
    /// it is neither, is larger than [`MESH_BYTES_MAX`], or is not a valid mesh.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let extension = path.extension().and_then(|extension| extension.to_str());
        let read = match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("obj") => obj::read,
            Some("ply") => ply::read,
            _ => return Err(format(path, "its name must end with .obj or .ply")),
        };
        read(&read_mesh_file(path)?).map_err(|message| format(path, &message))
    }

    /// Writes positions, normals and triangles in object space as a binary PLY file, without loss
    /// of precision. Texture coordinates, colours and the pose are not written.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn save_ply(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let written = File::create(path).and_then(|mut file| file.write_all(&ply::bytes(self)));
        written.map_err(|source| Error::io(path, source))
    }
}

fn format(path: &Path, message: &str) -> Error {
    Error::format(path, printable(message, SENTENCE_BYTES_MAX))
}

fn read_mesh_file(path: &Path) -> Result<Vec<u8>, Error> {
    let bytes = read_limited(path, MESH_BYTES_MAX).map_err(|source| Error::io(path, source))?;
    if bytes.len() as u64 > MESH_BYTES_MAX {
        let message =
            format!("it is longer than {MESH_BYTES_MAX} bytes, the most that a mesh file may hold");
        return Err(format(path, &message));
    }
    Ok(bytes)
}

/// The reason why a file is refused.
type Refusal = String;

/// Adds the triangles of a face, as a fan around its first corner.
fn push_face(triangles: &mut Vec<[u32; 3]>, corners: &[u32]) -> Result<(), Refusal> {
    let [first, others @ ..] = corners else {
        return Err("a face has no corner".to_owned());
    };
    if others.len() < 2 {
        return Err(format!(
            "a face has {} corners: it must have at least 3",
            corners.len()
        ));
    }
    triangles.extend(others.windows(2).map(|pair| [*first, pair[0], pair[1]]));
    limit("triangles", triangles.len(), TRIANGLES_MAX)
}

fn push_vertex(positions: &mut Vec<Vec3>, position: Vec3) -> Result<(), Refusal> {
    if !position.is_finite() {
        return Err(format!("the position {position} is not finite"));
    }
    positions.push(position);
    limit("vertices", positions.len(), VERTICES_MAX)
}

fn limit(what: &str, count: usize, max: usize) -> Result<(), Refusal> {
    match count <= max {
        true => Ok(()),
        false => Err(format!(
            "it has more than {max} {what}, the most that are allowed"
        )),
    }
}
