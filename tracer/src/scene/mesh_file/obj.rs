//! Wavefront OBJ: text, a statement a line.

use std::collections::HashMap;
use std::str::SplitAsciiWhitespace;

use glam::Vec3;

use super::{Refusal, push_face, push_vertex};
use crate::scene::Mesh;

/// Statements of no concern to a mesh's surface.
const PASSED_OVER: [&str; 9] = ["vt", "g", "o", "s", "usemtl", "mtllib", "l", "p", "mg"];

/// A file so far.
#[derive(Default)]
struct ObjReader {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    /// Of all faces.
    triangles: Vec<[u32; 3]>,
    /// Position and normal of each vertex that a face has named, where faces have normals.
    vertices: Vec<[u32; 2]>,
    numbers: HashMap<[u32; 2], u32>,
    has_normals: Option<bool>,
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
            "v" => push_vertex(&mut self.positions, triple(words)?),
            "vn" => {
                self.normals.push(triple(words)?);
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
        let normal = parts
            .nth(1)
            .map(|part| index(part, self.normals.len(), "normals"));
        let normal = normal.transpose()?;
        if *self.has_normals.get_or_insert(normal.is_some()) != normal.is_some() {
            let sentence =
                "the corner `{}` differs from those before it: all have a normal or none";
            return Err(sentence.replace("{}", word));
        }
        let Some(normal) = normal else {
            return Ok(position);
        };
        let (vertices, vertex) = (&mut self.vertices, [position, normal]);
        Ok(*self.numbers.entry(vertex).or_insert_with(|| {
            vertices.push(vertex);
            vertices.len() as u32 - 1
        }))
    }

    fn finish(self) -> Result<Mesh, Refusal> {
        if self.triangles.is_empty() {
            return Err("it has no face".to_owned());
        }
        if self.has_normals != Some(true) {
            return Ok(Mesh::new(self.positions, self.triangles));
        }
        let [positions, normals] = [&self.positions, &self.normals];
        let vertices = self.vertices.iter();
        let (positions, normals) = vertices
            .map(|&[position, normal]| (positions[position as usize], normals[normal as usize]))
            .unzip();
        Ok(Mesh::new(positions, self.triangles).normals(normals))
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

fn triple(mut words: SplitAsciiWhitespace<'_>) -> Result<Vec3, Refusal> {
    let mut numbers = [0.0; 3];
    for number in &mut numbers {
        let word = words.next().ok_or("three numbers must follow")?;
        *number = word
            .parse()
            .map_err(|_| format!("`{word}` is not a number"))?;
    }
    Ok(numbers.into())
}
