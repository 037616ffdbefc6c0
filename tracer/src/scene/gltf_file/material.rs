//! Materials and textures of a glTF file.

use std::collections::BTreeMap;

use glam::{Mat2, Vec2, Vec3, Vec4};
use gltf_json::extensions::material::Volume;
use gltf_json::extensions::texture::TextureTransform;
use gltf_json::material::NormalTexture;
use gltf_json::root::Index;
use gltf_json::texture::{Info, Texture, WrappingMode};
use gltf_json::validation::Checked;
use serde::Deserialize as _;

use super::container::{self, Files};
use super::{Document, Fault, Refusal, find, layers};
use crate::scene::validate::NAME_BYTES_MAX;
use crate::scene::{ColorSpace, ImageTexture, Material, MaterialTextures, Medium, Scene, Wrap};
use crate::text::printable;

/// A material of the file, with its name in the scene.
#[derive(Debug)]
pub(super) struct MaterialEntry {
    pub(super) name: String,
    /// Name of the material for closed meshes, if this one transmits light and has a volume.
    pub(super) body: Option<String>,
    /// The texture coordinates of its textures, if it has any.
    pub(super) uvs: Option<UvSet>,
}

/// A set of a mesh's texture coordinates with an affine transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvSet {
    pub(super) index: u32,
    offset: Vec2,
    turn_and_scale: Mat2,
}

impl UvSet {
    pub(super) fn apply(&self, uv: Vec2) -> Vec2 {
        self.offset + self.turn_and_scale * uv
    }
}

/// Textures and images that have been read so far.
struct Textures<'a> {
    document: &'a Document,
    files: &'a mut Files,
    scene: &'a mut Scene,
    known: BTreeMap<(usize, ColorSpace), u32>,
    images: BTreeMap<usize, Vec<u8>>,
}

/// Adds all materials and their textures to `scene`; the default material is the last entry.
pub(super) fn read(
    document: &Document,
    files: &mut Files,
    scene: &mut Scene,
) -> Result<Vec<MaterialEntry>, Fault> {
    let mut textures = Textures {
        document,
        files,
        scene,
        known: BTreeMap::new(),
        images: BTreeMap::new(),
    };
    let mut entries = Vec::new();
    for (index, material) in document.root.materials.iter().enumerate() {
        let given = material.name.as_deref().unwrap_or("material");
        let name = printable(&format!("{index} {given}"), NAME_BYTES_MAX);
        let what = format!("material {index} `{given}`");
        let body = match volume(material) {
            Some(volume) if textures.transmission(material, &what)? >= TRANSMISSION_MIN => {
                Some(dielectric(material, volume, &what)?)
            }
            _ => None,
        };
        let mut surface = SurfaceReader {
            textures: &mut textures,
            what: &what,
            uvs: None,
        };
        let (material, uvs) = (surface.read(material)?, surface.uvs);
        let materials = &mut textures.scene.materials;
        materials.insert(name.clone(), material);
        let body = body.map(|material| {
            let name = printable(&format!("{index} body of {given}"), NAME_BYTES_MAX);
            materials.insert(name.clone(), material);
            name
        });
        entries.push(MaterialEntry { name, body, uvs });
    }
    let name = "default".to_owned();
    let material = Material::rough([1.0; 3], 1.0);
    scene.materials.insert(name.clone(), material);
    entries.push(MaterialEntry {
        name,
        body: None,
        uvs: None,
    });
    Ok(entries)
}

/// The index of refraction. 0 is allowed and stands for a surface that reflects everything, for use
/// with other material models.
fn index_of_refraction(from: &gltf_json::Material) -> f32 {
    let extensions = from.extensions.as_ref();
    let ior = extensions.and_then(|all| all.ior.as_ref());
    ior.map_or(1.5, |ior| ior.ior.0)
}

fn emitted(from: &gltf_json::Material) -> Vec3 {
    let extensions = from.extensions.as_ref();
    let strength = extensions.and_then(|all| all.emissive_strength.as_ref());
    let strength = strength.map_or(1.0, |strength| strength.emissive_strength.0);
    strength * Vec3::from(from.emissive_factor.0)
}

/// The volume of a material, if its thickness is not 0; otherwise its surfaces are thin walls.
fn volume(from: &gltf_json::Material) -> Option<&Volume> {
    let volume = from.extensions.as_ref()?.volume.as_ref();
    volume.filter(|volume| volume.thickness_factor.0 > 0.0)
}

/// The material that fills a closed mesh of a transmissive material.
fn dielectric(
    from: &gltf_json::Material,
    volume: &Volume,
    what: &str,
) -> Result<Material, Refusal> {
    let (distance_m, color) = (volume.attenuation_distance.0, volume.attenuation_color.0);
    if !(distance_m > 0.0 && color.iter().all(|channel| (0.0..=1.0).contains(channel))) {
        return Err(format!(
            "{what}: it attenuates light to {color:?} in {distance_m} m: they must be from 0 to 1, and above 0"
        ));
    }
    let color = Vec3::from(color).max(Vec3::splat(ATTENUATION_MIN));
    // The maximum turns the −0 of a white colour into +0.
    // Beer–Lambert law: exp(−extinction · distance) = colour.
    let extinction = (Vec3::from(color.to_array().map(f32::ln)) / -distance_m).max(Vec3::ZERO);
    let medium = Medium {
        extinction,
        albedo: Vec3::ZERO,
    };
    let roughness = from.pbr_metallic_roughness.roughness_factor.0;
    Ok(Material::Dielectric {
        ior: index_of_refraction(from),
        alpha: roughness * roughness,
        medium: (extinction != Vec3::ZERO).then_some(medium),
        number: 0,
    })
}

/// Smallest transmission for which a closed mesh is filled with a dielectric; otherwise its
/// surfaces are thin walls.
const TRANSMISSION_MIN: f32 = 0.5;
/// Lower bound on the attenuation colour, as its logarithm must be finite.
const ATTENUATION_MIN: f32 = 1e-6;

impl<'a> Textures<'a> {
    /// The fraction of light that a material transmits, averaged over its texture.
    fn transmission(&mut self, from: &gltf_json::Material, what: &str) -> Result<f32, Fault> {
        let extensions = from.extensions.as_ref();
        let Some(transmission) = extensions.and_then(|all| all.transmission.as_ref()) else {
            return Ok(0.0);
        };
        let mean = match &transmission.transmission_texture {
            Some(info) => {
                let source = self.source(info.index, what)?.source;
                let mean = mean_red(self.image(source)?);
                mean.map_err(|fault| format!("{what}: its transmissionTexture: {fault}"))?
            }
            None => 1.0,
        };
        Ok(mean * transmission.transmission_factor.0)
    }

    /// The index of a texture in the scene, to which it is added if needed.
    fn texture(
        &mut self,
        index: Index<Texture>,
        color_space: ColorSpace,
        what: &str,
    ) -> Result<u32, Fault> {
        let place = index.value();
        if let Some(known) = self.known.get(&(place, color_space)) {
            return Ok(*known);
        }
        let texture = self.source(index, what)?;
        let image = texture.source.value();
        let bytes = self.image(texture.source)?.to_vec();
        let given = self.document.root.images.get(image);
        let given = given.and_then(|image| image.name.as_deref().or(image.uri.as_deref()));
        let given = given
            .filter(|name| !name.starts_with("data:"))
            .unwrap_or("image");
        let name = printable(&format!("{image} {given}"), NAME_BYTES_MAX);
        let added = ImageTexture {
            color_space,
            wrap: self.wrap(texture, what)?,
            ..ImageTexture::new(name, bytes)
        };
        let added = self.scene.add_texture(added);
        self.known.insert((place, color_space), added);
        Ok(added)
    }

    /// The texture with this index.
    fn source(&self, index: Index<Texture>, what: &str) -> Result<&'a Texture, Refusal> {
        let place = index.value();
        let textures = &self.document.root.textures;
        find(textures, place, format_args!("{what}: texture"))
    }

    /// The contents of an image file, which is read only once.
    fn image(&mut self, index: Index<gltf_json::Image>) -> Result<&[u8], Fault> {
        let image = index.value();
        if !self.images.contains_key(&image) {
            let bytes = container::image(self.document, index, self.files)?;
            self.images.insert(image, bytes);
        }
        Ok(&self.images[&image])
    }

    fn wrap(&self, texture: &Texture, what: &str) -> Result<[Wrap; 2], Refusal> {
        let Some(index) = texture.sampler else {
            return Ok([Wrap::Repeat; 2]);
        };
        let place = index.value();
        let samplers = &self.document.root.samplers;
        let sampler = find(samplers, place, format_args!("{what}: sampler"))?;
        let wrap = |mode: &Checked<WrappingMode>| match mode {
            Checked::Valid(WrappingMode::ClampToEdge) => Ok(Wrap::Clamp),
            Checked::Valid(WrappingMode::MirroredRepeat) => Ok(Wrap::Mirror),
            Checked::Valid(WrappingMode::Repeat) => Ok(Wrap::Repeat),
            Checked::Invalid => Err(format!("{what}: sampler {place} wraps in no way of glTF")),
        };
        Ok([wrap(&sampler.wrap_s)?, wrap(&sampler.wrap_t)?])
    }
}

/// Reads the surface properties of one material.
struct SurfaceReader<'t, 'a> {
    textures: &'t mut Textures<'a>,
    what: &'t str,
    /// Texture coordinates used by the textures so far.
    uvs: Option<UvSet>,
}

impl SurfaceReader<'_, '_> {
    fn read(&mut self, from: &gltf_json::Material) -> Result<Material, Fault> {
        let base = &from.pbr_metallic_roughness;
        let (layers, coat, sheen) = layers::layers(from, self.what)?;
        let extensions = from.extensions.as_ref();
        let specular = extensions.and_then(|all| all.specular.as_ref());
        let transmission = extensions.and_then(|all| all.transmission.as_ref());
        let color = specular.and_then(|part| part.specular_color_texture.as_ref());
        let specular = specular.and_then(|part| part.specular_texture.as_ref());
        let transmission = transmission.and_then(|part| part.transmission_texture.as_ref());
        let (colors, numbers) = (ColorSpace::Srgb, ColorSpace::Linear);
        let rough = coat.clearcoat_roughness_texture.as_ref();
        let mut textures = MaterialTextures {
            base_color: self.texture(base.base_color_texture.as_ref(), colors)?,
            emission: self.texture(from.emissive_texture.as_ref(), colors)?,
            metallic_roughness: self.texture(base.metallic_roughness_texture.as_ref(), numbers)?,
            clearcoat: self.texture(coat.clearcoat_texture.as_ref(), numbers)?,
            clearcoat_roughness: self.texture(rough, numbers)?,
            // The colour space does not affect alpha, so an image with both colour and roughness
            // can be one texture.
            sheen_roughness: self.texture(sheen.sheen_roughness_texture.as_ref(), colors)?,
            sheen: self.texture(sheen.sheen_color_texture.as_ref(), colors)?,
            specular: self.texture(specular, colors)?,
            specular_color: self.texture(color, colors)?,
            transmission: self.texture(transmission, numbers)?,
            ..MaterialTextures::NONE
        };
        (textures.normal, textures.normal_scale) =
            self.normals(from.normal_texture.as_ref(), "normalTexture")?;
        let coat_normals = coat.clearcoat_normal_texture.as_ref();
        (textures.clearcoat_normal, textures.clearcoat_normal_scale) =
            self.normals(coat_normals, "clearcoatNormalTexture")?;
        Ok(Material::MetallicRoughness {
            base_color: Vec4::from(base.base_color_factor.0).truncate(),
            metallic: base.metallic_factor.0,
            roughness: base.roughness_factor.0,
            ior: index_of_refraction(from),
            emission: emitted(from),
            textures,
            opacity: layers::opacity(from, self.what)?,
            layers,
        })
    }

    fn texture(&mut self, info: Option<&Info>, space: ColorSpace) -> Result<Option<u32>, Fault> {
        let Some(info) = info else {
            return Ok(None);
        };
        self.lay(uv_set(info))?;
        let texture = self.textures.texture(info.index, space, self.what)?;
        Ok(Some(texture))
    }

    /// A normal map and its scale.
    fn normals(
        &mut self,
        map: Option<&NormalTexture>,
        name: &str,
    ) -> Result<(Option<u32>, f32), Fault> {
        let Some(map) = map else {
            return Ok((None, 1.0));
        };
        self.lay(normals_uv_set(map, name, self.what)?)?;
        let texture = (self.textures).texture(map.index, ColorSpace::Linear, self.what)?;
        Ok((Some(texture), map.scale))
    }

    /// Checks that all textures of a material use the same texture coordinates.
    fn lay(&mut self, next: UvSet) -> Result<(), Refusal> {
        match self.uvs.replace(next) {
            Some(before) if before != next => Err(format!(
                "{}: its textures use different texture coordinates, {before:?} and {next:?}: all must be laid in one way",
                self.what
            )),
            _ => Ok(()),
        }
    }
}

impl UvSet {
    const fn plain(index: u32) -> Self {
        Self {
            index,
            offset: Vec2::ZERO,
            turn_and_scale: Mat2::IDENTITY,
        }
    }
}

/// `KHR_texture_transform`: scale, then rotation, then translation.
fn uv_set(info: &Info) -> UvSet {
    let transform = info
        .extensions
        .as_ref()
        .and_then(|all| all.texture_transform.as_ref());
    uv_set_of(info.tex_coord, transform)
}

/// The same for normal maps, whose extensions `gltf-json` does not parse.
fn normals_uv_set(map: &NormalTexture, name: &str, what: &str) -> Result<UvSet, Refusal> {
    let others = map.extensions.as_ref().map(|all| &all.others);
    let transform = others.and_then(|others| others.get("KHR_texture_transform"));
    let transform = transform.map(|value| {
        TextureTransform::deserialize(value)
            .map_err(|error| format!("{what}: its {name}'s transform: {error}"))
    });
    Ok(uv_set_of(map.tex_coord, transform.transpose()?.as_ref()))
}

fn uv_set_of(index: u32, transform: Option<&TextureTransform>) -> UvSet {
    let Some(TextureTransform {
        offset,
        rotation,
        scale,
        tex_coord,
        ..
    }) = transform
    else {
        return UvSet::plain(index);
    };
    let (sine, cosine) = rotation.0.sin_cos();
    let turn = Mat2::from_cols(Vec2::new(cosine, -sine), Vec2::new(sine, cosine));
    UvSet {
        index: tex_coord.unwrap_or(index),
        offset: Vec2::from(offset.0),
        turn_and_scale: turn * Mat2::from_diagonal(Vec2::from(scale.0)),
    }
}

/// The mean of an image's red channel, in [0, 1].
fn mean_red(file: &[u8]) -> Result<f32, Refusal> {
    let texels = crate::texture_file::decode(file)?.texels;
    let sum: u64 = texels.iter().map(|[red, ..]| u64::from(*red)).sum();
    Ok((sum as f64 / (255.0 * texels.len() as f64)) as f32)
}
