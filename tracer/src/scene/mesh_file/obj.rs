//! Wavefront OBJ: text, a statement a line.

use std::collections::HashMap;
use std::str::SplitAsciiWhitespace;

use glam::{Vec2, Vec3};

use super::{Refusal, push_face, push_vertex};
use crate::scene::Mesh;

/// Statements of no concern to a mesh's surface.
const PASSED_OVER: [&str; 8] = ["g", "o", "s", "usemtl", "mtllib", "l", "p", "mg"];

/// A file so far.
#[derive(Default)]
struct ObjReader {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    /// Of all faces.
    triangles: Vec<[u32; 3]>,
    /// Position, texture coordinates and normal of each vertex that a face has named, where faces have more than positions.
    vertices: Vec<[u32; 3]>,
    numbers: HashMap<[u32; 3], u32>,
    has_normals: Option<bool>,
    /// Whether the first corner has texture coordinates.
    has_uvs: Option<bool>,
    /// Whether a later one has none, so that the mesh has none.
    lacks_uvs: bool,
}

pub(super) fn read(bytes: &[u8]) -> Result<Mesh, Refusal> {
    let mut reader = ObjReader::default();
    for (number, line) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
        let text = String::from_utf8_lossy(line);
        let statement = text.split('#').next().unwrap_or_default();
        let mut words = statement.split_ascii_whitespace();
        let Some(keyword) = words.next() else {
            continue;
        };
        let taken = reader.take(keyword, words);
        taken.map_err(|why| format!("line {number}: {why}"))?;
    }
    reader.finish()
}

impl ObjReader {
    fn take(&mut self, keyword: &str, words: SplitAsciiWhitespace<'_>) -> Result<(), Refusal> {
        match keyword {
            "v" => push_vertex(&mut self.positions, numbers(words)?.into()),
            "vn" => {
                self.normals.push(numbers(words)?.into());
                Ok(())
            }
            "vt" => {
                // Theirs is the lower left corner.
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
                push_face(&mut self.triangles, &corners)
            }
            _ if PASSED_OVER.contains(&keyword) => Ok(()),
            _ => Err(format!("`{keyword}` is not a statement that is known here")),
        }
    }

    /// The number of a vertex: `position`, `position/texture`, `position//normal` or all three.
    fn corner(&mut self, word: &str) -> Result<u32, Refusal> {
        let mut parts = word.split('/');
        let position = parts.next().unwrap_or_default();
        let position = index(position, self.positions.len(), "positions")?;
        // Files name texture coordinates that they do not have.
        let uv = parts
            .next()
            .and_then(|part| index(part, self.uvs.len(), "").ok());
        let has_uvs = *self.has_uvs.get_or_insert(uv.is_some());
        self.lacks_uvs |= uv.is_none();
        let normal = parts
            .next()
            .map(|part| index(part, self.normals.len(), "normals"));
        let normal = normal.transpose()?;
        if *self.has_normals.get_or_insert(normal.is_some()) != normal.is_some() {
            let sentence =
                "the corner `{}` differs from those before it: all have a normal or none";
            return Err(sentence.replace("{}", word));
        }
        if normal.is_none() && !has_uvs {
            return Ok(position);
        }
        let (uv, normal) = (uv.filter(|_| has_uvs), normal.unwrap_or_default());
        let (vertices, vertex) = (
            &mut self.vertices,
            [position, uv.unwrap_or_default(), normal],
        );
        Ok(*self.numbers.entry(vertex).or_insert_with(|| {
            vertices.push(vertex);
            vertices.len() as u32 - 1
        }))
    }

    fn finish(self) -> Result<Mesh, Refusal> {
        if self.triangles.is_empty() {
            return Err("it has no face".to_owned());
        }
        let (has_normals, has_uvs) = (self.has_normals == Some(true), self.has_uvs == Some(true));
        if !has_normals && !has_uvs {
            return Ok(Mesh::new(self.positions, self.triangles));
        }
        let vertices = self.vertices.iter();
        let positions = vertices
            .clone()
            .map(|vertex| self.positions[vertex[0] as usize]);
        let mut mesh = Mesh::new(positions.collect(), self.triangles);
        if has_uvs && !self.lacks_uvs {
            let uvs = vertices.clone().map(|vertex| self.uvs[vertex[1] as usize]);
            mesh = mesh.uvs(uvs.collect());
        }
        if has_normals {
            let normals = vertices.map(|vertex| self.normals[vertex[2] as usize]);
            mesh = mesh.normals(normals.collect());
        }
        Ok(mesh)
    }
}

/// Counted from 1, or from the last one backwards as −1, −2, …
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

/// The first N of a line; there may be more.
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
