//! Image textures, which are mapped to meshes by texture coordinates.

use std::fmt;

use serde::de::{Error as _, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// An image for meshes, with at most [`TEXTURE_EDGE_MAX`] texels along each edge.
///
/// Texture coordinate (0, 0) is the top left corner and (1, 1) the bottom right one. Colours are
/// interpolated between the centres of texels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageTexture {
    /// Name for messages; need not be unique.
    pub name: String,
    /// Interpretation of the texels.
    #[serde(default)]
    pub color_space: ColorSpace,
    /// Extension beyond the edges, horizontally and vertically.
    #[serde(default)]
    pub wrap: [Wrap; 2],
    /// A PNG or JPEG file.
    pub image: ImageSource,
}

/// Maximum width and height of a texture in texels.
pub const TEXTURE_EDGE_MAX: u32 = 16_384;

/// Interpretation of a texture's values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// sRGB colours (IEC 61966-2-1): base colours, emission.
    #[default]
    Srgb,
    /// Linear values: roughness, normals.
    Linear,
}

/// How a texture is extended beyond its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Wrap {
    /// Repeated.
    #[default]
    Repeat,
    /// The nearest texel at the edge.
    Clamp,
    /// Repeated, every other time mirrored.
    Mirror,
}

/// Source of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageSource {
    /// The contents of an image file; base64 (RFC 4648) in JSON.
    Encoded(FileBytes),
    /// The name of an image file beside the scene file. [`super::Scene::load`] replaces it by the
    /// file's contents; elsewhere it is refused, as a scene from an untrusted source must not
    /// access files.
    File(String),
}

/// The contents of a file.
#[derive(Clone, PartialEq, Eq)]
pub struct FileBytes(pub Vec<u8>);

impl ImageTexture {
    /// A repeated sRGB image from the contents of a PNG or JPEG file.
    pub fn new(name: impl Into<String>, file: Vec<u8>) -> Self {
        Self {
            name: name.into(),
            color_space: ColorSpace::Srgb,
            wrap: [Wrap::Repeat; 2],
            image: ImageSource::Encoded(FileBytes(file)),
        }
    }

    /// Sets the colour space to linear.
    #[must_use]
    pub fn linear(self) -> Self {
        Self {
            color_space: ColorSpace::Linear,
            ..self
        }
    }

    /// Sets the extension beyond the edges.
    #[must_use]
    pub fn wrapped(self, wrap: Wrap) -> Self {
        let wrap = [wrap; 2];
        Self { wrap, ..self }
    }
}

impl ImageSource {
    /// The contents of the file; `None` for a file name.
    pub fn bytes(&self) -> Option<&[u8]> {
        match self {
            Self::Encoded(FileBytes(bytes)) => Some(bytes),
            Self::File(_) => None,
        }
    }
}

/// The textures of a material, as indices into [`super::Scene::textures`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialTextures {
    /// The base colour is multiplied by red, green and blue, the alpha of the material's
    /// [`super::Opacity`] by alpha.
    pub base_color: Option<u32>,
    /// As in glTF 2.0, roughness is multiplied by green and metalness by blue; must be
    /// [`ColorSpace::Linear`].
    pub metallic_roughness: Option<u32>,
    /// Tangent-space normals as in glTF 2.0: `2·rgb − 1`, with x along increasing u, y along
    /// decreasing v and z out of the surface; must be [`ColorSpace::Linear`].
    pub normal: Option<u32>,
    /// Factor for x and y of the normals, in ±[`super::validate::NORMAL_SCALE_MAX`]: 0 is flat, 1
    /// the map itself.
    pub normal_scale: f32,
    /// The emission is multiplied by red, green and blue.
    pub emission: Option<u32>,
    /// The strength of the clear coat is multiplied by red; must be [`ColorSpace::Linear`].
    pub clearcoat: Option<u32>,
    /// The roughness of the clear coat is multiplied by green; must be [`ColorSpace::Linear`].
    pub clearcoat_roughness: Option<u32>,
    /// Normals of the clear coat, as [`MaterialTextures::normal`]; without them the coat has the
    /// mesh's normals, whatever those of the base. Must be [`ColorSpace::Linear`].
    pub clearcoat_normal: Option<u32>,
    /// Factor for x and y of the clear coat's normals, as [`MaterialTextures::normal_scale`].
    pub clearcoat_normal_scale: f32,
    /// The colour of the sheen is multiplied by red, green and blue.
    pub sheen: Option<u32>,
    /// The roughness of the sheen is multiplied by alpha.
    pub sheen_roughness: Option<u32>,
    /// The strength of the specular reflection of non-metals is multiplied by alpha.
    pub specular: Option<u32>,
    /// The colour at normal incidence of that reflection is multiplied by red, green and blue.
    pub specular_color: Option<u32>,
    /// The transmission is multiplied by red; must be [`ColorSpace::Linear`].
    pub transmission: Option<u32>,
}

impl Default for MaterialTextures {
    fn default() -> Self {
        Self::NONE
    }
}

impl MaterialTextures {
    /// No textures.
    pub const NONE: Self = Self {
        base_color: None,
        metallic_roughness: None,
        normal: None,
        normal_scale: 1.0,
        emission: None,
        clearcoat: None,
        clearcoat_roughness: None,
        clearcoat_normal: None,
        clearcoat_normal_scale: 1.0,
        sheen: None,
        sheen_roughness: None,
        specular: None,
        specular_color: None,
        transmission: None,
    };

    fn slots(&mut self) -> [&mut Option<u32>; 12] {
        [
            &mut self.base_color,
            &mut self.metallic_roughness,
            &mut self.normal,
            &mut self.emission,
            &mut self.clearcoat,
            &mut self.clearcoat_roughness,
            &mut self.clearcoat_normal,
            &mut self.sheen,
            &mut self.sheen_roughness,
            &mut self.specular,
            &mut self.specular_color,
            &mut self.transmission,
        ]
    }

    /// The same textures after `by` others have been put before them.
    pub(crate) fn shifted(mut self, by: u32) -> Self {
        for index in self.slots().into_iter().flatten() {
            *index += by;
        }
        self
    }

    /// The indices of all textures.
    pub fn indices(mut self) -> impl Iterator<Item = u32> + use<> {
        let all = self.slots().map(|slot| *slot);
        all.into_iter().flatten()
    }
}

/// Edge length of the next mip level.
pub(crate) const fn halved(edge: u32) -> u32 {
    if edge < 2 { 1 } else { edge / 2 }
}

/// Number of mip levels of a texture, down to a single texel.
#[cfg(feature = "image-io")]
pub(crate) const fn levels(width: u32, height: u32) -> u32 {
    let edge = if width > height { width } else { height };
    1 + edge.ilog2()
}

/// Number of texels of a texture with all of its mip levels.
#[cfg(feature = "image-io")]
pub(crate) fn texels_with_levels([width, height]: [u32; 2]) -> u64 {
    let (mut width, mut height, mut texels) = (width, height, 0);
    for _ in 0..levels(width, height) {
        texels += u64::from(width) * u64::from(height);
        (width, height) = (halved(width), halved(height));
    }
    texels
}

impl fmt::Debug for FileBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "FileBytes({} bytes)", self.0.len())
    }
}

/// Serialised as base64 in human-readable formats, as bytes in others.
impl Serialize for FileBytes {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        match to.is_human_readable() {
            true => to.serialize_str(&base64(&self.0)),
            false => to.serialize_bytes(&self.0),
        }
    }
}

impl<'de> Deserialize<'de> for FileBytes {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Bytes;
        impl Visitor<'_> for Bytes {
            type Value = FileBytes;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the bytes of a file as base64")
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<FileBytes, E> {
                from_base64(text).map(FileBytes).map_err(E::custom)
            }

            fn visit_bytes<E: serde::de::Error>(self, bytes: &[u8]) -> Result<FileBytes, E> {
                Ok(FileBytes(bytes.to_vec()))
            }
        }
        if from.is_human_readable() {
            return from.deserialize_str(Bytes);
        }
        from.deserialize_bytes(Bytes).map_err(D::Error::custom)
    }
}

const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

fn base64(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    // Three bytes make four digits of 6 bits; a last group of n bytes makes n + 1 digits.
    for three in bytes.chunks(3) {
        let byte = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let word = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let value = (word >> (18 - 6 * digit)) & 63;
            let is_padding = digit > three.len();
            text.push(if is_padding {
                '='
            } else {
                char::from(DIGITS[value as usize])
            });
        }
    }
    text
}

/// Decodes base64 with or without padding.
pub(crate) fn from_base64(text: &str) -> Result<Vec<u8>, String> {
    let digits = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    for (chunk, four) in digits.chunks(4).enumerate() {
        let mut word = 0;
        for (place, digit) in four.iter().enumerate() {
            let value = match digit {
                b'A'..=b'Z' => digit - b'A',
                b'a'..=b'z' => digit - b'a' + 26,
                b'0'..=b'9' => digit - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => {
                    let place = 4 * chunk + place;
                    return Err(format!(
                        "character {place} of the base64 is none of its digits"
                    ));
                }
            };
            word |= u32::from(value) << (18 - 6 * place);
        }
        // A single digit has 6 bits, less than a byte.
        if four.len() == 1 {
            return Err(format!(
                "the base64 has {} digits, one too many",
                digits.len()
            ));
        }
        let [_, first, second, third] = word.to_be_bytes();
        bytes.extend(&[first, second, third][..four.len() - 1]);
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As needed when scenes are combined.
    #[test]
    fn all_textures_of_a_material_are_counted_and_shifted() {
        let mut json = serde_json::to_value(MaterialTextures::NONE).unwrap();
        let fields = json.as_object_mut().unwrap();
        let textures = fields.values_mut().filter(|value| value.is_null());
        let count = textures
            .zip(0u32..)
            .map(|(value, index)| *value = index.into())
            .count() as u32;
        let textures: MaterialTextures = serde_json::from_value(json).unwrap();
        let sorted = |textures: MaterialTextures| {
            let mut indices: Vec<u32> = textures.indices().collect();
            indices.sort_unstable();
            indices
        };
        assert!(sorted(textures).into_iter().eq(0..count));
        assert!(sorted(textures.shifted(9)).into_iter().eq(9..9 + count));
    }

    #[test]
    fn base64_reads_back() {
        for length in 0..70_u8 {
            let bytes: Vec<u8> = (0..length).map(|i| i.wrapping_mul(37) ^ length).collect();
            let text = base64(&bytes);
            assert_eq!(text.len() % 4, 0);
            assert_eq!(from_base64(&text).as_ref(), Ok(&bytes));
            assert_eq!(from_base64(text.trim_end_matches('=')), Ok(bytes));
        }
        assert_eq!(base64(b"Carom"), "Q2Fyb20=");
        for wrong in ["Q2F*", "Q2Fyb", "Q2=yb20=", "é234"] {
            assert!(from_base64(wrong).is_err(), "{wrong}");
        }
    }
}
