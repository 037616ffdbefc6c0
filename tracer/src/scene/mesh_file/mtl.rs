//! Materials of OBJ files: Wavefront MTL with the statements of its extension for physically based
//! materials (Exocortex, 2012).
//!
//! A material becomes [`Material::MetallicRoughness`]. `Kd` is its base colour; `Ks` the colour of
//! its reflection, where 0.5 corresponds to the reflection of glass; `Ns` the exponent of a Phong
//! lobe, as wide as a GGX lobe of width `α² = 2 / (Ns + 2)` (Walter et al., "Microfacet Models for
//! Refraction through Rough Surfaces", EGSR 2007, section 5.2); `Ke` its emitted radiance; `d`, or
//! `Tr` as 1 − d, its alpha. `Pr`, `Pm`, `Pc`, `Pcr` and `Ps` are roughness, metalness, clear coat,
//! the coat's roughness and sheen. Of textures, `map_Kd`, `map_Ke` and `norm` are supported, and
//! `map_d` if it is the same file as `map_Kd`, whose alpha is then used. Other statements are
//! ignored.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::SplitAsciiWhitespace;

use glam::Vec3;

use super::Refusal;
use crate::scene::file::{lies_beside, read_named_file};
use crate::scene::validate::{MATERIALS_MAX, NAME_BYTES_MAX};
use crate::scene::{ColorSpace, ImageTexture, Layers, Material, MaterialTextures, Opacity, Wrap};
use crate::text::printable;

/// Maximum size of an MTL file in bytes.
const MTL_BYTES_MAX: u64 = 16 << 20;
/// Maximum total size of texture files in bytes, enough for 4 GiB of texels as PNG files that
/// hardly compress.
const TEXTURE_FILES_BYTES_MAX: u64 = 2 << 30;

/// Materials by name, and their textures.
#[derive(Default)]
pub(super) struct MaterialLibrary {
    pub(super) materials: BTreeMap<String, Material>,
    pub(super) textures: Vec<ImageTexture>,
    /// Indices of textures by file, colour space and whether they are clamped.
    known: BTreeMap<(String, ColorSpace, bool), u32>,
    texture_bytes: u64,
}

/// A material while its statements are read.
#[derive(Default)]
struct MtlMaterial {
    name: String,
    diffuse: Option<Vec3>,
    specular: Option<Vec3>,
    exponent: Option<f32>,
    emission: Option<Vec3>,
    alpha: Option<f32>,
    roughness: Option<f32>,
    metallic: Option<f32>,
    clearcoat: f32,
    clearcoat_roughness: f32,
    sheen: f32,
    textures: MaterialTextures,
    /// Files of `map_Kd` and `map_d`.
    color_file: Option<String>,
    alpha_file: Option<String>,
}

/// Position of a statement in a file.
struct Place<'a> {
    folder: &'a Path,
    file: &'a str,
    line: usize,
}

impl Place<'_> {
    fn refusal(&self, why: &str) -> Refusal {
        format!("{}, line {}: {why}", self.file, self.line)
    }
}

impl MaterialLibrary {
    /// Adds the materials of a file in `folder`.
    pub(super) fn read(&mut self, folder: &Path, file: &str) -> Result<(), Refusal> {
        let path = beside(folder, file)?;
        let bytes = read_named_file(&path, MTL_BYTES_MAX).map_err(|why| why.to_string())?;
        let mut current: Option<MtlMaterial> = None;
        for (line, text) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
            let place = Place { folder, file, line };
            let text = String::from_utf8_lossy(text);
            let statement = text.split('#').next().unwrap_or_default().trim();
            let Some(keyword) = statement.split_ascii_whitespace().next() else {
                continue;
            };
            let rest = statement[keyword.len()..].trim();
            let taken = match (keyword, &mut current) {
                ("newmtl", current) => {
                    let next = MtlMaterial {
                        name: rest.to_owned(),
                        ..MtlMaterial::default()
                    };
                    match current.replace(next) {
                        Some(whole) => self.add(whole),
                        None => Ok(()),
                    }
                }
                (_, Some(material)) => self.take(material, keyword, rest, &place),
                (_, None) => Err("a material must begin with `newmtl`".to_owned()),
            };
            taken.map_err(|why| place.refusal(&why))?;
        }
        match current {
            Some(last) => self.add(last).map_err(|why| format!("{file}: {why}")),
            None => Ok(()),
        }
    }

    fn add(&mut self, material: MtlMaterial) -> Result<(), Refusal> {
        let name = material.name.clone();
        self.materials.insert(name, material.finish());
        super::limit("materials", self.materials.len(), MATERIALS_MAX)
    }

    fn take(
        &mut self,
        material: &mut MtlMaterial,
        keyword: &str,
        rest: &str,
        place: &Place<'_>,
    ) -> Result<(), Refusal> {
        let words = rest.split_ascii_whitespace();
        let share = |what: &str| number(words.clone(), what);
        match keyword {
            "Kd" => material.diffuse = Some(color(words, keyword)?),
            "Ks" => material.specular = Some(color(words, keyword)?),
            "Ke" => material.emission = Some(radiance(words)?),
            "Ns" => material.exponent = Some(at_least_0(words, keyword)?),
            "d" => {
                // With the option `-halo`, alpha depends on the viewing angle, which is ignored.
                let words = words.filter(|word| *word != "-halo").collect::<Vec<_>>();
                material.alpha = Some(number(words.join(" ").split_ascii_whitespace(), keyword)?);
            }
            "Tr" => material.alpha = Some(1.0 - share(keyword)?),
            "Pr" => material.roughness = Some(share(keyword)?),
            "Pm" => material.metallic = Some(share(keyword)?),
            "Pc" => material.clearcoat = share(keyword)?,
            "Pcr" => material.clearcoat_roughness = share(keyword)?,
            "Ps" => material.sheen = share(keyword)?,
            "map_Kd" => {
                let map = TextureStatement::new(rest)?;
                material.textures.base_color = Some(self.texture(&map, ColorSpace::Srgb, place)?);
                material.color_file = Some(map.file);
            }
            "map_Ke" => {
                let map = TextureStatement::new(rest)?;
                material.textures.emission = Some(self.texture(&map, ColorSpace::Srgb, place)?);
            }
            "norm" => {
                let map = TextureStatement::new(rest)?;
                material.textures.normal = Some(self.texture(&map, ColorSpace::Linear, place)?);
                material.textures.normal_scale = map.multiplier;
            }
            "map_d" => material.alpha_file = Some(TextureStatement::new(rest)?.file),
            _ => {}
        }
        Ok(())
    }

    /// The index of a texture, which is read unless it is known.
    fn texture(
        &mut self,
        map: &TextureStatement,
        color_space: ColorSpace,
        place: &Place<'_>,
    ) -> Result<u32, Refusal> {
        let key = (map.file.clone(), color_space, map.is_clamped);
        if let Some(known) = self.known.get(&key) {
            return Ok(*known);
        }
        let path = beside(place.folder, &map.file)?;
        let left = TEXTURE_FILES_BYTES_MAX - self.texture_bytes;
        let bytes = read_named_file(&path, left).map_err(|why| why.to_string())?;
        self.texture_bytes += bytes.len() as u64;
        let wrap = if map.is_clamped {
            Wrap::Clamp
        } else {
            Wrap::Repeat
        };
        let name = printable(&map.file, NAME_BYTES_MAX);
        let texture = ImageTexture {
            color_space,
            ..ImageTexture::new(name, bytes).wrapped(wrap)
        };
        #[cfg(feature = "image-io")]
        if let Some(bytes) = texture.image.bytes() {
            crate::texture_file::size(bytes).map_err(|why| format!("{}: {why}", map.file))?;
        }
        self.textures.push(texture);
        let index = self.textures.len() as u32 - 1;
        self.known.insert(key, index);
        Ok(index)
    }
}

impl MtlMaterial {
    fn finish(self) -> Material {
        let is_physical = self.roughness.is_some() || self.metallic.is_some();
        let specular = match self.specular {
            Some(specular) => 2.0 * specular,
            None if is_physical => Vec3::ONE,
            None => Vec3::ZERO,
        };
        // The strength is at most 1; what exceeds it goes to the colour.
        let strength = specular.max_element().min(1.0);
        // α = roughness², so roughness = (α²)^¼.
        let by_exponent = |exponent: f32| (2.0 / (exponent + 2.0)).powf(0.25);
        let by_exponent = self.exponent.map_or(1.0, by_exponent);
        let has_alpha = self.alpha_file.is_some() && self.alpha_file == self.color_file;
        let alpha = self.alpha.unwrap_or(1.0);
        Material::MetallicRoughness {
            base_color: self.diffuse.unwrap_or(match self.textures.base_color {
                Some(_) => Vec3::ONE,
                None => Vec3::splat(0.8),
            }),
            metallic: self.metallic.unwrap_or(0.0),
            roughness: self.roughness.unwrap_or(by_exponent),
            ior: 1.5,
            emission: self.emission.unwrap_or(match self.textures.emission {
                Some(_) => Vec3::ONE,
                None => Vec3::ZERO,
            }),
            textures: self.textures,
            opacity: match has_alpha || alpha < 1.0 {
                true => Opacity::Blend { alpha },
                false => Opacity::Opaque,
            },
            layers: Layers {
                clearcoat: self.clearcoat,
                clearcoat_roughness: self.clearcoat_roughness,
                sheen: Vec3::splat(self.sheen),
                sheen_roughness: 0.5,
                specular: strength,
                specular_color: match strength > 0.0 {
                    true => specular / strength,
                    false => Vec3::ONE,
                },
                transmission: 0.0,
            },
        }
    }
}

/// Options and file of a texture statement.
struct TextureStatement {
    file: String,
    is_clamped: bool,
    multiplier: f32,
}

impl TextureStatement {
    fn new(statement: &str) -> Result<Self, Refusal> {
        let mut rest = statement.trim();
        let mut read = Self {
            file: String::new(),
            is_clamped: false,
            multiplier: 1.0,
        };
        while rest.starts_with('-') {
            let (option, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            rest = after.trim_start();
            let mut values = Vec::new();
            let (least, most) = match option {
                "-o" | "-s" | "-t" => (1, 3),
                "-mm" => (2, 2),
                _ => (1, 1),
            };
            while values.len() < most {
                let (value, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                if values.len() >= least && value.parse::<f32>().is_err() {
                    break;
                }
                values.push(value);
                rest = after.trim_start();
            }
            let is_all = |wanted: f32| values.iter().all(|value| value.parse() == Ok(wanted));
            let is_plain = match option {
                "-o" | "-t" => is_all(0.0),
                "-s" => is_all(1.0),
                _ => true,
            };
            if !is_plain {
                let values = values.join(" ");
                return Err(format!(
                    "the option `{option} {values}` of a texture is not read: lay its coordinates out in the mesh"
                ));
            }
            match option {
                "-clamp" => read.is_clamped = values == ["on"],
                "-bm" => read.multiplier = number(values.into_iter(), "-bm")?,
                _ => {}
            }
        }
        if rest.is_empty() {
            return Err("it names no texture".to_owned());
        }
        read.file = rest.replace('\\', "/");
        Ok(read)
    }
}

/// The path of a file in a folder or below.
fn beside(folder: &Path, file: &str) -> Result<PathBuf, Refusal> {
    let path = Path::new(file);
    match lies_beside(path) && !file.is_empty() {
        true => Ok(folder.join(path)),
        false => Err(format!(
            "the file `{file}` must lie beside the OBJ file or in a folder there"
        )),
    }
}

fn number<'a>(mut words: impl Iterator<Item = &'a str>, what: &str) -> Result<f32, Refusal> {
    let word = words
        .next()
        .ok_or_else(|| format!("a number must follow `{what}`"))?;
    let number: f32 = word
        .parse()
        .map_err(|_| format!("`{word}` is not a number"))?;
    match number.is_finite() {
        true => Ok(number),
        false => Err(format!("its {what} is {number}, which is not finite")),
    }
}

fn at_least_0(words: SplitAsciiWhitespace<'_>, what: &str) -> Result<f32, Refusal> {
    let number = number(words, what)?;
    match number >= 0.0 {
        true => Ok(number),
        false => Err(format!("its {what} is {number}: it must be at least 0")),
    }
}

/// Three numbers, or one that stands for all three.
fn triple(words: SplitAsciiWhitespace<'_>, what: &str) -> Result<Vec3, Refusal> {
    if words
        .clone()
        .next()
        .is_some_and(|word| ["spectral", "xyz"].contains(&word))
    {
        return Err(format!(
            "its {what} is `{}`: it must be red, green and blue",
            words.collect::<Vec<_>>().join(" ")
        ));
    }
    let count = words.clone().count();
    let mut words = words;
    let first = number(&mut words, what)?;
    if count == 1 {
        return Ok(Vec3::splat(first));
    }
    Ok(Vec3::new(
        first,
        number(&mut words, what)?,
        number(&mut words, what)?,
    ))
}

fn color(words: SplitAsciiWhitespace<'_>, what: &str) -> Result<Vec3, Refusal> {
    let color = triple(words, what)?;
    match color.cmpge(Vec3::ZERO).all() && color.cmple(Vec3::ONE).all() {
        true => Ok(color),
        false => Err(format!(
            "its {what} is {color}: each number must be from 0 to 1"
        )),
    }
}

fn radiance(words: SplitAsciiWhitespace<'_>) -> Result<Vec3, Refusal> {
    let color = triple(words, "Ke")?;
    match color.cmpge(Vec3::ZERO).all() {
        true => Ok(color),
        false => Err(format!("its Ke is {color}: each number must be at least 0")),
    }
}
