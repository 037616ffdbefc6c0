//! Mesh files: Wavefront OBJ and Stanford PLY.
//!
//! Both are read here and by no library, for the sake of messages that name the line and the value. Read are positions,
//! normals and faces, which are cut into triangles that share their first corner, and of OBJ texture coordinates, if all corners
//! have them; materials and groups are passed over.

mod obj;
mod ply;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::Path;

use glam::Vec3;

use super::Mesh;
use super::validate::{TRIANGLES_MAX, VERTICES_MAX};
use crate::Error;

/// The longest mesh file in bytes: ten million triangles as text have 0.7 GB.
pub const MESH_BYTES_MAX: u64 = 1 << 30;

impl Mesh {
    /// Reads an OBJ or PLY file, which its name ends with.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Format`] with the place and the value if it is none of these,
    /// is longer than [`MESH_BYTES_MAX`], or holds what no mesh can be made of.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let format = |message| Error::Format {
            path: path.to_owned(),
            message,
        };
        let extension = path.extension().and_then(|extension| extension.to_str());
        let read = match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("obj") => obj::read,
            Some("ply") => ply::read,
            _ => return Err(format("its name must end with .obj or .ply".to_owned())),
        };
        let bytes = read_limited(path).map_err(|source| Error::Io {
            path: path.to_owned(),
            source,
        })?;
        if bytes.len() as u64 > MESH_BYTES_MAX {
            let sentence = "it is longer than {} bytes, the most that a mesh file may hold";
            return Err(format(sentence.replace("{}", &MESH_BYTES_MAX.to_string())));
        }
        read(&bytes).map_err(|message| {
            format(crate::text::printable(
                &message,
                crate::text::SENTENCE_BYTES_MAX,
            ))
        })
    }

    /// Writes the mesh in its own frame as a binary PLY file, which reads back bit by bit.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn save_ply(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let written = File::create(path).and_then(|mut file| file.write_all(&ply::bytes(self)));
        written.map_err(|source| Error::Io {
            path: path.to_owned(),
            source,
        })
    }
}

/// At most one byte more than the limit.
fn read_limited(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?
        .take(MESH_BYTES_MAX + 1)
        .read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Why a file is refused.
type Refusal = String;

/// Adds the triangles of a face that share its first corner.
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
