//! Deserialisation of a scene's lists with limits: elements are counted as they are read, and a
//! list that is too long is refused at the first excess element, before it fills memory.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use glam::{Vec2, Vec3, Vec4};
use serde::de::{Error as _, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::validate::{
    AREA_LIGHTS_MAX, MATERIALS_MAX, OBJECTS_MAX, PUNCTUAL_LIGHTS_MAX, SUBTRACTIONS_MAX,
    SUBTRACTIONS_TOTAL_MAX, TEXTURES_MAX, TRIANGLES_MAX, VERTICES_MAX, count,
};
use super::{AreaLight, ImageTexture, Material, Object, PunctualLight, Shape, Subtraction};
use crate::SceneError;

pub(super) fn objects<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Object>, D::Error> {
    let (mut subtractions, mut triangles) = (0, 0);
    list(from, "objects", OBJECTS_MAX, |object: &Object| {
        match &object.shape {
            Shape::CsgBox {
                subtractions: more, ..
            } => subtractions += more.len(),
            Shape::Mesh(mesh) => triangles += mesh.triangles.len(),
            _ => {}
        }
        count("triangles", triangles, TRIANGLES_MAX)?;
        count("subtractions", subtractions, SUBTRACTIONS_TOTAL_MAX)
    })
}

pub(super) fn positions<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec3>, D::Error> {
    list(from, "vertices", VERTICES_MAX, |_| Ok(()))
}

pub(super) fn normals<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec3>, D::Error> {
    list(from, "normals", VERTICES_MAX, |_| Ok(()))
}

pub(super) fn uvs<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec2>, D::Error> {
    list(from, "texture coordinates", VERTICES_MAX, |_| Ok(()))
}

pub(super) fn colors<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Vec4>, D::Error> {
    list(from, "vertex colours", VERTICES_MAX, |_| Ok(()))
}

pub(super) fn textures<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<ImageTexture>, D::Error> {
    list(from, "textures", TEXTURES_MAX, |_| Ok(()))
}

pub(super) fn triangles<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<[u32; 3]>, D::Error> {
    list(from, "triangles", TRIANGLES_MAX, |_| Ok(()))
}

pub(super) fn area_lights<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<AreaLight>, D::Error> {
    list(from, "area lights", AREA_LIGHTS_MAX, |_| Ok(()))
}

pub(super) fn punctual_lights<'de, D>(from: D) -> Result<Vec<PunctualLight>, D::Error>
where
    D: Deserializer<'de>,
{
    list(from, "punctual lights", PUNCTUAL_LIGHTS_MAX, |_| Ok(()))
}

pub(super) fn subtractions<'de, D>(from: D) -> Result<Vec<Subtraction>, D::Error>
where
    D: Deserializer<'de>,
{
    list(from, "subtractions", SUBTRACTIONS_MAX, |_| Ok(()))
}

/// Also refuses duplicate names, of which serde would keep the last one.
pub(super) fn materials<'de, D>(from: D) -> Result<BTreeMap<String, Material>, D::Error>
where
    D: Deserializer<'de>,
{
    struct Materials;
    impl<'de> Visitor<'de> for Materials {
        type Value = BTreeMap<String, Material>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("materials by name")
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            let mut materials = BTreeMap::new();
            while let Some((name, material)) = map.next_entry::<String, Material>()? {
                if materials.contains_key(&name) {
                    let twice = format!("the material `{name}` is given twice");
                    return Err(A::Error::custom(twice));
                }
                materials.insert(name, material);
                count("materials", materials.len(), MATERIALS_MAX).map_err(A::Error::custom)?;
            }
            Ok(materials)
        }
    }
    from.deserialize_map(Materials)
}

/// Reads a list of at most `max` elements, each of which must pass `check`.
fn list<'de, D, T>(
    from: D,
    what: &'static str,
    max: usize,
    check: impl FnMut(&T) -> Result<(), SceneError>,
) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    struct List<T, F> {
        what: &'static str,
        max: usize,
        check: F,
        element: PhantomData<T>,
    }
    impl<'de, T, F> Visitor<'de> for List<T, F>
    where
        T: Deserialize<'de>,
        F: FnMut(&T) -> Result<(), SceneError>,
    {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a list of {}", self.what)
        }

        fn visit_seq<A: SeqAccess<'de>>(mut self, mut seq: A) -> Result<Self::Value, A::Error> {
            let mut elements = Vec::new();
            while let Some(element) = seq.next_element()? {
                (self.check)(&element).map_err(A::Error::custom)?;
                elements.push(element);
                count(self.what, elements.len(), self.max).map_err(A::Error::custom)?;
            }
            Ok(elements)
        }
    }
    let element = PhantomData;
    from.deserialize_seq(List {
        what,
        max,
        check,
        element,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A JSON list of `elements` valid elements, followed by an invalid one.
    fn broken_after(element: &str, elements: usize) -> String {
        format!("[{}null]", format!("{element},").repeat(elements))
    }

    fn fault<T>(read: Result<T, serde_json::Error>) -> String {
        read.err().expect("the list is broken").to_string()
    }

    #[test]
    fn lists_are_counted_while_they_are_read() {
        let light = r#"{"name": "", "center": [0, 0, 2], "half_u": [1, 0, 0],
            "half_v": [0, 1, 0], "radiance": [1, 1, 1]}"#;
        let read = |elements| {
            let text = broken_after(light, elements);
            fault(area_lights(&mut serde_json::Deserializer::from_str(&text)))
        };
        assert!(
            read(AREA_LIGHTS_MAX).contains("null"),
            "{}",
            read(AREA_LIGHTS_MAX)
        );
        let sentence = "it has 65 area lights: at most 64 are allowed";
        assert!(read(AREA_LIGHTS_MAX + 1).contains(sentence));
    }
}
