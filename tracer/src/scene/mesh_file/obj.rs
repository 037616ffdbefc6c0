//! Wavefront OBJ: text with one statement per line.

use std::collections::HashMap;
use std::str::SplitAsciiWhitespace;

use glam::{Vec2, Vec3};

use super::{Refusal, limit, push_face, push_vertex};
use crate::scene::Mesh;
use crate::scene::validate::{MATERIALS_MAX, TRIANGLES_MAX};

/// Statements that are ignored, as they do not affect a mesh's surface.
const PASSED_OVER: [&str; 6] = ["g", "o", "s", "l", "p", "mg"];

/// The contents of a file while it is read.
pub(super) struct ObjReader {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    /// Faces by material; a single entry if materials are ignored.
    faces: Vec<Faces>,
    /// Index of the entry that faces are added to.
    current: usize,
    is_by_material: bool,
    /// Files of materials, each with the line number that refers to it.
    pub(super) libraries: Vec<(String, usize)>,
}

/// Faces with the same material.
#[derive(Default)]
struct Faces {
    /// Name of the material and the line where it is first used; `None` for faces before any
    /// `usemtl`.
    material: Option<(String, usize)>,
    triangles: Vec<[u32; 3]>,
    /// Indices of position, texture coordinates and normal of each distinct vertex, if faces have
    /// more than positions.
    vertices: Vec<[u32; 3]>,
    numbers: HashMap<[u32; 3], u32>,
    has_normals: Option<bool>,
    /// Whether the first corner has texture coordinates; `None` before it.
    has_uvs: Option<bool>,
    /// Whether a later corner has none, so that the mesh gets none.
    lacks_uvs: bool,
}

/// Faces with the same material, as a mesh.
pub(super) struct ObjFaces {
    /// Name of the material and the line where it is first used.
    pub(super) material: Option<(String, usize)>,
    pub(super) mesh: Mesh,
}

/// Reads all faces as one mesh, ignoring materials.
pub(super) fn read(bytes: &[u8]) -> Result<Mesh, Refusal> {
    let mut parts = ObjReader::read(bytes, false)?.finish()?;
    Ok(parts.swap_remove(0).mesh)
}

impl ObjReader {
    /// Reads a file, dividing its faces by material if `is_by_material`.
    pub(super) fn read(bytes: &[u8], is_by_material: bool) -> Result<Self, Refusal> {
        let mut reader = Self {
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            faces: vec![Faces::default()],
            current: 0,
            is_by_material,
            libraries: Vec::new(),
        };
        for (number, line) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
            let text = String::from_utf8_lossy(line);
            let statement = text.split('#').next().unwrap_or_default().trim();
            let mut words = statement.split_ascii_whitespace();
            let Some(keyword) = words.next() else {
                continue;
            };
            let rest = statement[keyword.len()..].trim();
            let taken = match keyword {
                "mtllib" | "usemtl" => reader.take_material(keyword, rest, number),
                _ => reader.take(keyword, words),
            };
            taken.map_err(|why| format!("line {number}: {why}"))?;
        }
        Ok(reader)
    }

    fn take_material(&mut self, keyword: &str, name: &str, line: usize) -> Result<(), Refusal> {
        if !self.is_by_material {
            return Ok(());
        }
        if name.is_empty() {
            return Err(format!("a name must follow `{keyword}`"));
        }
        if keyword == "mtllib" {
            self.libraries.push((name.to_owned(), line));
            return limit("files of materials", self.libraries.len(), LIBRARIES_MAX);
        }
        let of = |faces: &Faces| faces.material.as_ref().is_some_and(|(of, _)| of == name);
        self.current = match self.faces.iter().position(of) {
            Some(known) => known,
            None => {
                self.faces.push(Faces {
                    material: Some((name.to_owned(), line)),
                    ..Faces::default()
                });
                self.faces.len() - 1
            }
        };
        limit("materials", self.faces.len() - 1, MATERIALS_MAX)
    }

    fn take(&mut self, keyword: &str, words: SplitAsciiWhitespace<'_>) -> Result<(), Refusal> {
        match keyword {
            "v" => push_vertex(&mut self.positions, numbers(words)?.into()),
            "vn" => {
                self.normals.push(numbers(words)?.into());
                Ok(())
            }
            "vt" => {
                // OBJ's v points up from the lower left corner.
                let [u, v] = match words.clone().count() {
                    1 => numbers(words).map(|[u]| [u, 0.0])?,
                    _ => numbers(words)?,
                };
                self.uvs.push(Vec2::new(u, 1.0 - v));
                Ok(())
            }
            "f" => {
                let corners = words.map(|word| self.corner(word));
                let corners = corners.collect::<Result<Vec<u32>, Refusal>>()?;
                push_face(&mut self.faces[self.current].triangles, &corners)?;
                let triangles = self.faces.iter().map(|faces| faces.triangles.len());
                limit("triangles", triangles.sum(), TRIANGLES_MAX)
            }
            _ if PASSED_OVER.contains(&keyword) => Ok(()),
            _ => Err(format!("`{keyword}` is not a statement that is known here")),
        }
    }

    /// The index of a vertex given as `position`, `position/texture`, `position//normal` or
    /// `position/texture/normal`.
    fn corner(&mut self, word: &str) -> Result<u32, Refusal> {
        let mut parts = word.split('/');
        let position = parts.next().unwrap_or_default();
        let position = index(position, self.positions.len(), "positions")?;
        // An invalid index counts as missing, as some files refer to texture coordinates that they
        // do not contain.
        let uv = parts
            .next()
            .and_then(|part| index(part, self.uvs.len(), "").ok());
        let faces = &mut self.faces[self.current];
        let has_uvs = *faces.has_uvs.get_or_insert(uv.is_some());
        faces.lacks_uvs |= uv.is_none();
        let normal = parts
            .next()
            .map(|part| index(part, self.normals.len(), "normals"));
        let normal = normal.transpose()?;
        if *faces.has_normals.get_or_insert(normal.is_some()) != normal.is_some() {
            let sentence =
                "the corner `{}` differs from those before it: all have a normal or none";
            return Err(sentence.replace("{}", word));
        }
        if normal.is_none() && !has_uvs && !self.is_by_material {
            return Ok(position);
        }
        let (uv, normal) = (uv.filter(|_| has_uvs), normal.unwrap_or_default());
        let (vertices, vertex) = (
            &mut faces.vertices,
            [position, uv.unwrap_or_default(), normal],
        );
        Ok(*faces.numbers.entry(vertex).or_insert_with(|| {
            vertices.push(vertex);
            vertices.len() as u32 - 1
        }))
    }

    /// One mesh per material that has faces.
    pub(super) fn finish(mut self) -> Result<Vec<ObjFaces>, Refusal> {
        let faces = std::mem::take(&mut self.faces);
        let faces = faces
            .into_iter()
            .filter(|faces| !faces.triangles.is_empty());
        let parts: Vec<ObjFaces> = faces.map(|faces| self.part(faces)).collect();
        match parts.is_empty() {
            true => Err("it has no face".to_owned()),
            false => Ok(parts),
        }
    }

    fn part(&mut self, faces: Faces) -> ObjFaces {
        let (has_normals, has_uvs) = (faces.has_normals == Some(true), faces.has_uvs == Some(true));
        // Corners have neither normals nor texture coordinates, so their numbers are indices into
        // the positions.
        if faces.vertices.is_empty() {
            let positions = std::mem::take(&mut self.positions);
            return ObjFaces {
                material: faces.material,
                mesh: Mesh::new(positions, faces.triangles),
            };
        }
        let vertices = faces.vertices.iter();
        let positions = vertices
            .clone()
            .map(|vertex| self.positions[vertex[0] as usize]);
        let mut mesh = Mesh::new(positions.collect(), faces.triangles);
        if has_uvs && !faces.lacks_uvs {
            let uvs = vertices.clone().map(|vertex| self.uvs[vertex[1] as usize]);
            mesh = mesh.uvs(uvs.collect());
        }
        if has_normals {
            let normals = vertices.map(|vertex| self.normals[vertex[2] as usize]);
            mesh = mesh.normals(normals.collect());
        }
        ObjFaces {
            material: faces.material,
            mesh,
        }
    }
}

/// Maximum number of material files of an OBJ file.
const LIBRARIES_MAX: usize = 64;

/// Converts an index, which counts from 1, or backwards from the last element as −1, −2, …
fn index(word: &str, count: usize, what: &str) -> Result<u32, Refusal> {
    let number: i64 = word
        .parse()
        .map_err(|_| format!("`{word}` is not a number of {what}"))?;
    let place = match number {
        1.. => number - 1,
        _ => count as i64 + number,
    };
    let is_there = number != 0 && (0..count as i64).contains(&place);
    match is_there {
        true => Ok(place as u32),
        false => Err(format!("{number} is not among the {count} {what} so far")),
    }
}

/// The first N numbers of a line; further ones are ignored.
fn numbers<const N: usize>(mut words: SplitAsciiWhitespace<'_>) -> Result<[f32; N], Refusal> {
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        let count = if N == 3 { "three" } else { "two" };
        let word = words.next();
        let word = word.ok_or_else(|| format!("{count} numbers must follow"))?;
        *number = word
            .parse()
            .map_err(|_| format!("`{word}` is not a number"))?;
    }
    Ok(numbers)
}
