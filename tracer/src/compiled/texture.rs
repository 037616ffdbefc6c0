//! Image textures as read by back ends: mip levels, and texture filtering.
//!
//! Each mip level halves the previous one by the mean of the texels that it covers, in linear light
//! (Williams, "Pyramidal Parametrics", SIGGRAPH 1983). Camera rays interpolate between the two levels whose
//! texels are about as wide as their pixel's footprint (Akenine-Möller et al., "Improved Shader and Texture
//! Level of Detail Using Ray Cones", JCGT 10(1), 2021, equation 34, without the slope of the surface:
//! across it the samples of a pixel do the filtering). Later vertices use the finest level. Colours are
//! converted to linear light before interpolation.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use super::layer_texture::LayerTextureData;
use crate::Error;
#[cfg(feature = "image-io")]
use crate::scene::{ColorSpace, Wrap, levels};
use crate::scene::{ImageTexture, Material, MaterialTextures, halved};
use crate::tonemap::SRGB_LINEAR;

/// Textures of a scene, shared between copies.
#[derive(Clone, Debug, Default)]
pub struct CompiledTextures {
    /// One per texture, then views of those whose alpha is read as a number.
    pub images: Arc<Vec<TextureData>>,
    /// Per material of the scene; empty if none has a texture.
    pub materials: Arc<Vec<MaterialTextureData>>,
    /// Textures of layers and specular reflection, per material; empty if no material has any.
    pub layers: Arc<Vec<LayerTextureData>>,
    /// Transmission texture per material, or [`MaterialTextureData::NONE`]; empty if no thin wall has one.
    pub transmission: Arc<Vec<u32>>,
    /// RGBA texels, red in the lowest byte, level by level, row by row.
    pub texels: Arc<Vec<u32>>,
}

/// Location and format of a texture.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct TextureData {
    /// Index of its first texel.
    pub first: u32,
    /// Width of the finest level, texels.
    pub width: u32,
    /// Height of the finest level, texels.
    pub height: u32,
    /// Number of mip levels; the last is a single texel.
    pub levels: u32,
    /// 1 if its red, green and blue are sRGB, 0 if they are linear, [`TextureData::ALPHA`] if they are
    /// replaced by alpha.
    pub is_srgb: u32,
    /// Horizontal wrap mode: [`WRAP_REPEAT`], [`WRAP_CLAMP`] or [`WRAP_MIRROR`].
    pub wrap_u: u32,
    /// Vertical wrap mode.
    pub wrap_v: u32,
}

impl TextureData {
    /// [`TextureData::is_srgb`] of a view that has a texture's alpha as red, green and blue.
    pub const ALPHA: u32 = 2;
}

/// [`TextureData::wrap_u`] of [`Wrap::Repeat`].
pub const WRAP_REPEAT: u32 = 0;
/// [`TextureData::wrap_u`] of [`Wrap::Clamp`].
pub const WRAP_CLAMP: u32 = 1;
/// [`TextureData::wrap_u`] of [`Wrap::Mirror`].
pub const WRAP_MIRROR: u32 = 2;

/// A material's textures, as indices into [`CompiledTextures::images`].
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MaterialTextureData {
    /// See [`MaterialTextures::base_color`].
    pub base_color: u32,
    /// See [`MaterialTextures::metallic_roughness`].
    pub metallic_roughness: u32,
    /// See [`MaterialTextures::normal`].
    pub normal: u32,
    /// See [`MaterialTextures::emission`].
    pub emission: u32,
    /// See [`MaterialTextures::clearcoat`].
    pub clearcoat: u32,
    /// See [`MaterialTextures::clearcoat_roughness`].
    pub clearcoat_roughness: u32,
    /// See [`MaterialTextures::normal_scale`].
    pub normal_scale: f32,
}

impl MaterialTextureData {
    /// Index that stands for no texture.
    pub const NONE: u32 = LayerTextureData::NONE;

    fn new(textures: MaterialTextures) -> Self {
        let index = |texture: Option<u32>| texture.unwrap_or(Self::NONE);
        Self {
            base_color: index(textures.base_color),
            metallic_roughness: index(textures.metallic_roughness),
            normal: index(textures.normal),
            emission: index(textures.emission),
            clearcoat: index(textures.clearcoat),
            clearcoat_roughness: index(textures.clearcoat_roughness),
            normal_scale: textures.normal_scale,
        }
    }
}

impl CompiledTextures {
    /// Decodes the textures of valid materials; `materials` are those of the scene in its order.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] if a file is broken.
    pub(super) fn new<'a>(
        textures: &[ImageTexture],
        materials: impl Iterator<Item = &'a Material> + Clone,
    ) -> Result<Self, Error> {
        let mut used = materials.clone();
        if !used.any(Material::has_textures) {
            return Ok(Self::default());
        }
        let (mut images, mut texels) = (Vec::new(), Vec::new());
        for (index, texture) in textures.iter().enumerate() {
            let image = push_image(texture, &mut texels);
            images.push(image.map_err(|why| Error::InvalidScene(texture.fault(index, why)))?);
        }
        let layers = materials.clone();
        let layers = layers
            .map(|material| LayerTextureData::new(material, |image| alpha_of(&mut images, image)));
        let mut layers: Vec<_> = layers.collect();
        if !layers.iter().any(LayerTextureData::is_some) {
            layers.clear();
        }
        let mut transmission: Vec<u32> = materials.clone().map(transmission_texture).collect();
        if transmission
            .iter()
            .all(|image| *image == MaterialTextureData::NONE)
        {
            transmission.clear();
        }
        let materials = materials.map(|material| MaterialTextureData::new(material.textures()));
        Ok(Self {
            images: Arc::new(images),
            materials: Arc::new(materials.collect()),
            layers: Arc::new(layers),
            transmission: Arc::new(transmission),
            texels: Arc::new(texels),
        })
    }

    /// Whether no material has a texture.
    pub fn is_empty(&self) -> bool {
        self.materials.is_empty()
    }

    /// Linear RGBA of a texture at texture coordinates and a mip level, trilinearly interpolated; level 0
    /// is the finest.
    pub fn sample(&self, image: u32, uv: [f32; 2], level: f32) -> [f32; 4] {
        let data = &self.images[image as usize];
        let level = level.clamp(0.0, (data.levels - 1) as f32);
        let finer = level.floor();
        let share = level - finer;
        let mut sampled = self.bilinear(data, uv, finer as u32);
        if share > 0.0 {
            let coarser = self.bilinear(data, uv, finer as u32 + 1);
            for (channel, coarser) in sampled.iter_mut().zip(coarser) {
                *channel += share * (coarser - *channel);
            }
        }
        sampled
    }

    /// Mean of linear red, green and blue over a texture, from the finest level, as the coarsest is rounded
    /// to bytes.
    pub(super) fn mean(&self, image: u32) -> Vec3 {
        let data = &self.images[image as usize];
        let texels = data.first..data.first + data.width * data.height;
        let count = texels.len() as f64;
        let mut sum = DVec3::ZERO;
        for place in texels {
            let [r, g, b, _] = self.texel(data, place).map(f64::from);
            sum += DVec3::new(r, g, b);
        }
        (sum / count).as_vec3()
    }

    fn bilinear(&self, data: &TextureData, [u, v]: [f32; 2], level: u32) -> [f32; 4] {
        let Level {
            first,
            width,
            height,
        } = Level::of(data, level);
        let x = Taps::new(u, width, data.wrap_u);
        let y = Taps::new(v, height, data.wrap_v);
        let texel = |x: u32, y: u32| self.texel(data, first + y * width + x);
        let mut sum = [0.0; 4];
        for (y, share_y) in [(y.before, 1.0 - y.share), (y.after, y.share)] {
            let (left, right) = (texel(x.before, y), texel(x.after, y));
            for channel in 0..4 {
                let between = left[channel] + x.share * (right[channel] - left[channel]);
                sum[channel] += share_y * between;
            }
        }
        sum
    }

    fn texel(&self, data: &TextureData, place: u32) -> [f32; 4] {
        let [r, g, b, a] = self.texels[place as usize].to_le_bytes();
        let linear = |byte: u8| f32::from(byte) * (1.0 / 255.0);
        match data.is_srgb {
            0 => [r, g, b, a].map(linear),
            TextureData::ALPHA => [linear(a); 4],
            _ => {
                let [r, g, b] = [r, g, b].map(|byte| SRGB_LINEAR[usize::from(byte)]);
                [r, g, b, linear(a)]
            }
        }
    }
}

fn transmission_texture(material: &Material) -> u32 {
    let texture = material.textures().transmission;
    let texture = texture.filter(|_| material.is_thin_wall());
    texture.unwrap_or(MaterialTextureData::NONE)
}

/// Index of the view of a texture's alpha as colour, which is added if there is none.
fn alpha_of(images: &mut Vec<TextureData>, texture: u32) -> u32 {
    let view = TextureData {
        is_srgb: TextureData::ALPHA,
        ..images[texture as usize]
    };
    let known = images.iter().position(|known| *known == view);
    known.unwrap_or_else(|| {
        images.push(view);
        images.len() - 1
    }) as u32
}

/// Location of a mip level.
struct Level {
    first: u32,
    width: u32,
    height: u32,
}

impl Level {
    fn of(data: &TextureData, level: u32) -> Self {
        let mut of = Self {
            first: data.first,
            width: data.width,
            height: data.height,
        };
        for _ in 0..level {
            of.first += of.width * of.height;
            of.width = halved(of.width);
            of.height = halved(of.height);
        }
        of
    }
}

/// The two texels adjacent to a coordinate, and the weight of the second.
struct Taps {
    before: u32,
    after: u32,
    share: f32,
}

impl Taps {
    fn new(coordinate: f32, count: u32, wrap: u32) -> Self {
        // The integer part is removed before scaling, where it would cost the fraction's precision.
        let turn = match wrap {
            WRAP_REPEAT => coordinate - coordinate.floor(),
            WRAP_CLAMP => coordinate.clamp(0.0, 1.0),
            _ => {
                // Triangle wave of period 2.
                let half = 0.5 * coordinate;
                1.0 - (2.0 * (half - half.floor()) - 1.0).abs()
            }
        };
        let at = turn * count as f32 - 0.5;
        let before = at.floor();
        // −1 and `count` are beyond the edges. A mirrored texture continues with the texel at its edge,
        // like a clamped one.
        let wrapped = |place: f32| match (place < 0.0, place as u32 >= count) {
            (false, false) => place as u32,
            (true, _) if wrap == WRAP_REPEAT => count - 1,
            (true, _) => 0,
            (_, true) if wrap == WRAP_REPEAT => 0,
            (_, true) => count - 1,
        };
        Self {
            before: wrapped(before),
            after: wrapped(before + 1.0),
            share: at - before,
        }
    }
}

#[cfg(not(feature = "image-io"))]
fn push_image(_: &ImageTexture, _: &mut Vec<u32>) -> Result<TextureData, String> {
    Err(
        "this program was built without image files: build it with the feature `image-io`"
            .to_owned(),
    )
}

#[cfg(feature = "image-io")]
fn push_image(texture: &ImageTexture, texels: &mut Vec<u32>) -> Result<TextureData, String> {
    let file = texture.image.bytes().ok_or("its file has not been read")?;
    let picture = crate::texture_file::decode(file)?;
    let is_srgb = texture.color_space == ColorSpace::Srgb;
    let [wrap_u, wrap_v] = texture.wrap.map(|wrap| match wrap {
        Wrap::Repeat => WRAP_REPEAT,
        Wrap::Clamp => WRAP_CLAMP,
        Wrap::Mirror => WRAP_MIRROR,
    });
    let [width, height] = picture.size;
    let data = TextureData {
        first: texels.len() as u32,
        width,
        height,
        levels: levels(width, height),
        is_srgb: u32::from(is_srgb),
        wrap_u,
        wrap_v,
    };
    let mut level = picture;
    for _ in 1..data.levels {
        texels.extend(level.texels.iter().map(|texel| u32::from_le_bytes(*texel)));
        level = mip::halve(&level, is_srgb);
    }
    texels.extend(level.texels.iter().map(|texel| u32::from_le_bytes(*texel)));
    Ok(data)
}

#[cfg(feature = "image-io")]
mod mip {
    use crate::scene::halved;
    use crate::texture_file::Texels;
    use crate::tonemap::SRGB_LINEAR;

    /// Computes the next mip level.
    pub(super) fn halve(level: &Texels, is_srgb: bool) -> Texels {
        let [width, height] = level.size;
        let size = [halved(width), halved(height)];
        let columns: Vec<Cover> = (0..size[0])
            .map(|x| Cover::new(x, width, size[0]))
            .collect();
        let mut texels = Vec::with_capacity(size[0] as usize * size[1] as usize);
        for y in 0..size[1] {
            let rows = Cover::new(y, height, size[1]);
            for columns in &columns {
                let mut sum = [0.0; 4];
                for (y, share_y) in rows.shares() {
                    for (x, share_x) in columns.shares() {
                        let texel = level.texels[y * width as usize + x];
                        for (sum, value) in sum.iter_mut().zip(linear(texel, is_srgb)) {
                            *sum += share_x * share_y * value;
                        }
                    }
                }
                texels.push(bytes(sum, is_srgb));
            }
        }
        Texels { size, texels }
    }

    /// Texels of a finer level that one texel of the next covers, along one axis.
    struct Cover {
        first: usize,
        shares: [f32; 3],
    }

    impl Cover {
        fn new(place: u32, finer: u32, coarser: u32) -> Self {
            // An odd size is halved rounding down: the scale is above 2, at most 3 (from 3 texels to 1), so
            // that a texel covers parts of up to three.
            let scale = finer as f32 / coarser as f32;
            let (begin, end) = (place as f32 * scale, (place + 1) as f32 * scale);
            let first = begin as usize;
            let shares = std::array::from_fn(|i| {
                let texel = (first + i) as f32;
                ((texel + 1.0).min(end) - texel.max(begin)).max(0.0) / scale
            });
            Self { first, shares }
        }

        fn shares(&self) -> impl Iterator<Item = (usize, f32)> {
            let places = (self.first..).zip(self.shares);
            places.filter(|(_, share)| *share > 1e-3)
        }
    }

    fn linear([r, g, b, a]: [u8; 4], is_srgb: bool) -> [f32; 4] {
        let plain = |byte: u8| f32::from(byte) / 255.0;
        let color = |byte: u8| match is_srgb {
            true => SRGB_LINEAR[usize::from(byte)],
            false => plain(byte),
        };
        [color(r), color(g), color(b), plain(a)]
    }

    fn bytes([r, g, b, a]: [f32; 4], is_srgb: bool) -> [u8; 4] {
        let plain = |share: f32| (share * 255.0 + 0.5) as u8;
        let color = |share: f32| match is_srgb {
            true => srgb_byte(share),
            false => plain(share),
        };
        [color(r), color(g), color(b), plain(a)]
    }

    /// sRGB byte of nearest linear value.
    fn srgb_byte(share: f32) -> u8 {
        let above = SRGB_LINEAR
            .partition_point(|linear| *linear < share)
            .min(255);
        let below = above.saturating_sub(1);
        let is_below = share - SRGB_LINEAR[below] < SRGB_LINEAR[above] - share;
        if is_below { below as u8 } else { above as u8 }
    }
}

#[cfg(all(test, feature = "image-io"))]
mod tests {
    use super::*;
    use crate::texture_file::{Texels, encode_png};

    fn texture(size: [u32; 2], texel: impl Fn(u32, u32) -> [u8; 4]) -> ImageTexture {
        let places = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
        let texels = places.map(|(x, y)| texel(x, y)).collect();
        ImageTexture::new("test", encode_png(&Texels { size, texels }).unwrap())
    }

    fn compiled(texture: ImageTexture) -> CompiledTextures {
        let used = MaterialTextures {
            base_color: Some(0),
            ..MaterialTextures::default()
        };
        let material = Material::rough([1.0; 3], 1.0).textured(used);
        CompiledTextures::new(&[texture], std::iter::once(&material)).unwrap()
    }

    #[test]
    fn centres_of_texels_have_their_colour() {
        let textures = compiled(texture([3, 2], |x, y| {
            [80 * x as u8, 100 * y as u8, 9, 255]
        }));
        for (x, y) in [(0, 0), (2, 0), (1, 1), (2, 1)] {
            for turns in [-2.0, 0.0, 5.0] {
                let uv = [(x as f32 + 0.5) / 3.0 + turns, (y as f32 + 0.5) / 2.0];
                let sampled = textures.sample(0, uv, 0.0);
                let expected = [80 * x, 100 * y, 9].map(|byte| SRGB_LINEAR[byte as usize]);
                for channel in 0..3 {
                    let off = (sampled[channel] - expected[channel]).abs();
                    assert!(off < 1e-5, "{x} {y}: {sampled:?}, {expected:?}");
                }
            }
        }
    }

    #[test]
    fn wraps_differ_beyond_the_edges() {
        let ramp = texture([4, 1], |x, _| [85 * x as u8; 4]).linear();
        let at = |wrap, u: f32| compiled(ramp.clone().wrapped(wrap)).sample(0, [u, 0.5], 0.0)[0];
        let close = |a: f32, b: f32| assert!((a - b).abs() < 1e-5, "{a} {b}");
        close(at(Wrap::Repeat, 1.125), 0.0);
        close(at(Wrap::Repeat, 0.0), 0.5);
        close(at(Wrap::Clamp, 1.5), 1.0);
        close(at(Wrap::Clamp, -7.0), 0.0);
        close(at(Wrap::Mirror, 1.125), 1.0);
        close(at(Wrap::Mirror, -0.375), 1.0 / 3.0);
    }

    #[test]
    fn every_level_keeps_the_mean() {
        for size in [[8, 8], [7, 5], [13, 1], [1, 6]] {
            let checks = texture(size, |x, y| [255 * ((x + y) % 2) as u8, 200, 0, 255]).linear();
            let textures = compiled(checks);
            let data = textures.images[0];
            let mean = |level: u32| {
                let Level {
                    first,
                    width,
                    height,
                } = Level::of(&data, level);
                let count = width * height;
                let sum: f64 = (first..first + count)
                    .map(|place| f64::from(textures.texel(&data, place)[0]))
                    .sum();
                sum / f64::from(count)
            };
            for level in 1..data.levels {
                let off = (mean(level) - mean(0)).abs();
                assert!(off < 0.01, "{size:?}, level {level}: off by {off}");
            }
            let all = u64::from(Level::of(&data, data.levels).first);
            assert_eq!(all, crate::scene::texels_with_levels(size));
            assert_eq!(all, textures.texels.len() as u64);
        }
    }

    #[test]
    fn the_mean_of_a_nearly_black_texture_is_not_rounded_away() {
        let texture = texture([64, 64], |x, y| {
            [if (x, y) == (17, 40) { 255 } else { 0 }, 0, 0, 255]
        });
        let mean = compiled(texture).mean(0);
        assert!((mean.x * 4096.0 - 1.0).abs() < 1e-6, "{mean}");
        assert_eq!([mean.y, mean.z], [0.0; 2]);
    }

    #[test]
    fn levels_in_between_are_interpolated() {
        let checks = texture([2, 2], |x, y| [255 * ((x + y) % 2) as u8; 4]).linear();
        let textures = compiled(checks);
        let at = |level| textures.sample(0, [0.25, 0.25], level)[0];
        assert_eq!((at(-3.0), at(0.0)), (0.0, 0.0));
        assert!((at(0.5) - 0.25).abs() < 3e-3 && (at(9.0) - 0.5).abs() < 3e-3);
    }
}
