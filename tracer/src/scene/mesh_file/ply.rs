//! Stanford PLY: a text header, followed by elements as text or in binary.

use std::str::SplitAsciiWhitespace;

use glam::{Vec3, Vec4};

use super::{Refusal, push_face, push_vertex};
use crate::scene::Mesh;
use crate::tonemap::linear_from_srgb;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

struct Property {
    name: String,
    value: Scalar,
    /// Type of a list's length; `None` if the property is not a list.
    length: Option<Scalar>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// The structure of the file, from its header.
struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
}

/// The part of a file that has not been read.
struct Body<'a> {
    encoding: Encoding,
    rest: &'a [u8],
}

pub(super) fn read(bytes: &[u8]) -> Result<Mesh, Refusal> {
    let (header, rest) = header(bytes)?;
    let mut body = Body {
        encoding: header.encoding,
        rest,
    };
    let mut mesh = Mesh::new(Vec::new(), Vec::new());
    let elements = header.elements.iter();
    // Elements without properties take no bytes, so a huge count of them would not be stopped by
    // the end of the file.
    for element in elements.filter(|element| !element.properties.is_empty()) {
        for number in 0..element.count {
            let taken = body.element(element, &mut mesh);
            taken.map_err(|why| format!("{} {number}: {why}", element.name))?;
        }
    }
    let vertices = mesh.positions.len();
    let mut corners = mesh.triangles.iter().flatten();
    if let Some(corner) = corners.find(|corner| **corner as usize >= vertices) {
        return Err(format!(
            "a face has vertex {corner}, but there are {vertices}"
        ));
    }
    if mesh.triangles.is_empty() {
        return Err("it has no face".to_owned());
    }
    Ok(mesh)
}

fn header(bytes: &[u8]) -> Result<(Header, &[u8]), Refusal> {
    let mut rest = bytes;
    let mut header = Header {
        encoding: Encoding::Ascii,
        elements: Vec::new(),
    };
    for number in 1..=HEADER_LINES_MAX {
        let Some(end) = rest.iter().position(|&byte| byte == b'\n') else {
            return Err(format!(
                "line {number}: the header ends without `end_header`"
            ));
        };
        let line = String::from_utf8_lossy(&rest[..end]);
        rest = &rest[end + 1..];
        let mut words = line.split_ascii_whitespace();
        let keyword = words.next().unwrap_or_default();
        if number == 1 && keyword != "ply" {
            return Err("line 1: it does not begin with `ply`".to_owned());
        }
        if keyword == "end_header" {
            return Ok((header, rest));
        }
        let taken = header.take(keyword, &mut words);
        taken.map_err(|why| format!("line {number}: {why}"))?;
    }
    Err(format!("its header has more than {HEADER_LINES_MAX} lines"))
}

impl Header {
    fn take(&mut self, keyword: &str, words: &mut SplitAsciiWhitespace<'_>) -> Result<(), Refusal> {
        let mut word = || words.next().unwrap_or_default();
        match keyword {
            "ply" | "comment" | "obj_info" | "" => {}
            "format" => {
                self.encoding = match word() {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    other => return Err(format!("the format `{other}` is not known")),
                }
            }
            "element" => {
                let (name, count) = (word().to_owned(), word());
                let number = count.parse();
                self.elements.push(Element {
                    name,
                    count: number.map_err(|_| format!("`{count}` is not a count"))?,
                    properties: Vec::new(),
                });
            }
            "property" => {
                let first = word();
                let (length, value) = match first {
                    "list" => (Some(scalar(word())?), scalar(word())?),
                    _ => (None, scalar(first)?),
                };
                let name = word().to_owned();
                let element = self.elements.last_mut().ok_or("a property of no element")?;
                element.properties.push(Property {
                    name,
                    value,
                    length,
                });
            }
            other => return Err(format!("`{other}` is not known in a header")),
        }
        Ok(())
    }
}

fn scalar(name: &str) -> Result<Scalar, Refusal> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        other => return Err(format!("the type `{other}` is not known")),
    })
}

/// A vertex colour with channels in [0, 1], sRGB by convention (IEC 61966-2-1).
#[derive(Default)]
struct VertexColor {
    rgb: [Option<f32>; 3],
    alpha: Option<f32>,
}

impl VertexColor {
    /// Sets a channel if the property is one.
    fn set(&mut self, name: &str, value: f32, of: Scalar) -> Result<(), Refusal> {
        let channel = match name {
            "red" | "diffuse_red" => &mut self.rgb[0],
            "green" | "diffuse_green" => &mut self.rgb[1],
            "blue" | "diffuse_blue" => &mut self.rgb[2],
            "alpha" => &mut self.alpha,
            _ => return Ok(()),
        };
        let whole = match of {
            Scalar::F32 | Scalar::F64 => 1.0,
            Scalar::U16 => 65_535.0,
            _ => 255.0,
        };
        let share = value / whole;
        if !(0.0..=1.0).contains(&share) {
            return Err(format!(
                "its {name} is {value}: it must be from 0 to {whole}"
            ));
        }
        *channel = Some(share);
        Ok(())
    }

    /// The linear colour, if red, green and blue are all given.
    fn linear(&self) -> Option<Vec4> {
        let [r, g, b] = self.rgb;
        let [r, g, b] =
            [r?, g?, b?].map(|share| linear_from_srgb(f64::from(share)).min(1.0) as f32);
        Some(Vec3::new(r, g, b).extend(self.alpha.unwrap_or(1.0)))
    }
}

impl Body<'_> {
    fn element(&mut self, element: &Element, mesh: &mut Mesh) -> Result<(), Refusal> {
        let (mut position, mut normal, mut color) =
            (Vec3::NAN, None::<Vec3>, VertexColor::default());
        let is_vertex = element.name == "vertex";
        for property in &element.properties {
            let Some(length) = property.length else {
                let value = self.number(property.value)? as f32;
                match property.name.as_str() {
                    "x" => position.x = value,
                    "y" => position.y = value,
                    "z" => position.z = value,
                    "nx" => normal.get_or_insert(Vec3::ZERO).x = value,
                    "ny" => normal.get_or_insert(Vec3::ZERO).y = value,
                    "nz" => normal.get_or_insert(Vec3::ZERO).z = value,
                    name if is_vertex => color.set(name, value, property.value)?,
                    _ => {}
                }
                continue;
            };
            let list = self.list(length, property.value)?;
            let is_face = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
            if is_face && element.name == "face" {
                let corners: Vec<u32> = list
                    .into_iter()
                    .map(vertex_index)
                    .collect::<Result<_, _>>()?;
                push_face(&mut mesh.triangles, &corners)?;
            }
        }
        if is_vertex {
            push_vertex(&mut mesh.positions, position)?;
            mesh.normals.extend(normal);
            mesh.colors.extend(color.linear());
        }
        Ok(())
    }

    fn list(&mut self, length: Scalar, value: Scalar) -> Result<Vec<f64>, Refusal> {
        let length = self.number(length)?;
        if !(0.0..=LIST_MAX).contains(&length) {
            return Err(format!(
                "a list of {length}: at most {LIST_MAX} are allowed"
            ));
        }
        (0..length as usize).map(|_| self.number(value)).collect()
    }

    fn number(&mut self, scalar: Scalar) -> Result<f64, Refusal> {
        if self.encoding == Encoding::Ascii {
            return self.word();
        }
        let number = match scalar {
            Scalar::I8 => i8::from_le_bytes(self.bytes()?).into(),
            Scalar::U8 => u8::from_le_bytes(self.bytes()?).into(),
            Scalar::I16 => i16::from_le_bytes(self.bytes()?).into(),
            Scalar::U16 => u16::from_le_bytes(self.bytes()?).into(),
            Scalar::I32 => i32::from_le_bytes(self.bytes()?).into(),
            Scalar::U32 => u32::from_le_bytes(self.bytes()?).into(),
            Scalar::F32 => f32::from_le_bytes(self.bytes()?).into(),
            Scalar::F64 => f64::from_le_bytes(self.bytes()?),
        };
        Ok(number)
    }

    /// The next N bytes in little-endian order.
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Refusal> {
        let (bytes, rest) = self
            .rest
            .split_first_chunk()
            .ok_or("the file ends within it")?;
        self.rest = rest;
        let mut bytes = *bytes;
        if self.encoding == Encoding::BigEndian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn word(&mut self) -> Result<f64, Refusal> {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace);
        let (word, rest) = text.split_at(end.unwrap_or(text.len()));
        self.rest = rest;
        if word.is_empty() {
            return Err("the file ends within it".to_owned());
        }
        let word = String::from_utf8_lossy(word);
        word.parse()
            .map_err(|_| format!("`{word}` is not a number"))
    }
}

/// The index of a vertex. Values beyond u32 saturate, and are found out of range later.
fn vertex_index(number: f64) -> Result<u32, Refusal> {
    if number < 0.0 || number.fract() != 0.0 {
        return Err(format!("{number} is not the number of a vertex"));
    }
    Ok(number as u32)
}

/// A mesh encoded as a binary PLY file.
pub(super) fn bytes(mesh: &Mesh) -> Vec<u8> {
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    let properties = match mesh.normals.is_empty() {
        true => "",
        false => "property float nx\nproperty float ny\nproperty float nz\n",
    };
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
         property float z\n{properties}element face {triangles}\nproperty list uchar uint vertex_indices\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    for (index, position) in mesh.positions.iter().enumerate() {
        let normal = mesh.normals.get(index);
        let vectors = [Some(position), normal].into_iter().flatten();
        bytes.extend(
            vectors
                .flat_map(|v| v.to_array())
                .flat_map(f32::to_le_bytes),
        );
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().copied().flat_map(u32::to_le_bytes));
    }
    bytes
}

/// Maximum number of lines of a header.
const HEADER_LINES_MAX: u32 = 1000;
/// Maximum length of a list property.
const LIST_MAX: f64 = 1e5;
