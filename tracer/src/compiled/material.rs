//! Conversion of materials to the form read by back ends.

use bytemuck::Zeroable as _;
use glam::Vec3;

use super::{
    KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_LAYERED, KIND_METALLIC_ROUGHNESS, MaterialData,
    OPACITY_BLEND, OPACITY_MASK, OPACITY_OPAQUE, PATTERN_BRICKS, PATTERN_CLOTH, PATTERN_CUE,
    PATTERN_NONE, PATTERN_NUMBER, PATTERN_PLANKS, PATTERN_PRINT, PATTERN_SCOREBOARD, PATTERN_WOOD,
};
use crate::fresnel::internal_diffuse_reflectance;
use crate::scene::validate::{ALPHA_SMOOTH_MAX, SHEEN_ROUGHNESS};
use crate::scene::{ClothMarks, Layers, Material, Medium, Opacity, ProceduralTexture, Scene};
use crate::sheen::{sheen_reflectance_max, sheen_reflectances};
use crate::texture::CIRCLE_ALBEDO;

/// Materials of a scene in its order, then those of the discs behind the numbers of metals and dielectrics.
pub(super) fn with_number_discs(scene: &Scene) -> Vec<MaterialData> {
    let mut all: Vec<_> = scene.materials.values().map(material_data).collect();
    for (index, material) in scene.materials.values().enumerate() {
        if let Material::Conductor { number, .. } | Material::Dielectric { number, .. } = *material
            && number > 0
        {
            all[index].number = all.len() as u32;
            all.push(material_data(&Material::Coated {
                ior: DISC_IOR,
                alpha: 0.0,
                texture: ProceduralTexture::Ball {
                    albedo: Vec3::from(CIRCLE_ALBEDO),
                    stripe: None,
                    number,
                },
            }));
        }
    }
    all
}

/// Index of refraction of the discs: phenolic resin.
const DISC_IOR: f32 = 1.5;

/// Converts a material.
#[expect(clippy::too_many_lines, reason = "one arm for each material")]
pub(super) fn material_data(material: &Material) -> MaterialData {
    match *material {
        Material::Diffuse { albedo } => MaterialData {
            albedo: albedo.to_array(),
            diffuse_scale: 1.0,
            ..MaterialData::zeroed()
        },
        Material::SmoothPlastic {
            albedo,
            ior,
            internal_reflectance,
            stripe,
        } => {
            // Internal reflections form a geometric series with the sum 1 / (1 − F_dr,int); radiance that
            // leaves is lower by η².
            let eta = f64::from(ior);
            let internal =
                internal_reflectance.map_or_else(|| internal_diffuse_reflectance(eta), f64::from);
            MaterialData {
                albedo: albedo.to_array(),
                ior,
                stripe_albedo: stripe.map_or(Vec3::ZERO, |stripe| stripe.albedo).to_array(),
                stripe_half_width: stripe.map_or(0.0, |stripe| stripe.half_width),
                diffuse_scale: (1.0 / (eta * eta * (1.0 - internal))) as f32,
                ..MaterialData::zeroed()
            }
        }
        Material::Coated {
            ior,
            alpha,
            texture,
        } => {
            let coat = Material::SmoothPlastic {
                albedo: Vec3::ZERO,
                ior,
                internal_reflectance: None,
                stripe: None,
            };
            let coat = MaterialData {
                alpha: rough_alpha(alpha),
                ..material_data(&coat)
            };
            textured(coat, &texture)
        }
        Material::Cloth {
            albedo,
            sheen,
            sheen_roughness,
            marks,
        } => cloth_data(albedo, sheen, sheen_roughness, marks),
        Material::Conductor {
            eta,
            k,
            alpha,
            number: _,
        } => MaterialData {
            kind: KIND_CONDUCTOR,
            alpha: rough_alpha(alpha),
            eta: eta.to_array(),
            k: k.to_array(),
            ..MaterialData::zeroed()
        },
        Material::Dielectric {
            ior,
            alpha,
            medium,
            number: _,
        } => MaterialData {
            kind: KIND_DIELECTRIC,
            ior,
            alpha: rough_alpha(alpha),
            ..medium.map_or_else(MaterialData::zeroed, |medium| medium_data(&medium))
        },
        Material::MetallicRoughness {
            base_color,
            metallic,
            roughness,
            ior,
            emission,
            textures,
            opacity,
            layers,
        } => {
            // Fresnel reflectance at normal incidence.
            let f0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
            let mut f0 = f0 * layers.specular_color;
            // With textures the product is clamped where they are looked up.
            if textures.specular.or(textures.specular_color).is_none() {
                f0 = f0.min(Vec3::ONE);
            }
            let f0 = f0 * layers.specular;
            with_layers(
                MaterialData {
                    kind: KIND_METALLIC_ROUGHNESS,
                    albedo: base_color.to_array(),
                    metallic,
                    alpha: roughness * roughness,
                    eta: f0.to_array(),
                    diffuse_scale: layers.specular,
                    k: emission.to_array(),
                    sights: match opacity {
                        Opacity::Opaque => [1.0, 0.0, OPACITY_OPAQUE],
                        Opacity::Mask { alpha, cutoff } => [alpha, cutoff, OPACITY_MASK],
                        Opacity::Blend { alpha } => [alpha, 0.0, OPACITY_BLEND],
                    },
                    ..MaterialData::zeroed()
                },
                &layers,
            )
        }
    }
}

impl MaterialData {
    /// Whether it has a rough coat over a diffuse base.
    pub(crate) fn has_rough_coat(&self) -> bool {
        self.kind == KIND_LAYERED && self.ior > 0.0 && self.alpha > 0.0
    }

    /// Index of the material of the discs with a ball's number, for a metal or dielectric that has any.
    pub(crate) fn number_disc(&self) -> Option<u32> {
        let is_body = matches!(self.kind, KIND_CONDUCTOR | KIND_DIELECTRIC);
        (is_body && self.number > 0).then_some(self.number)
    }

    /// Whether it is glTF's material with a clear coat or a sheen.
    pub(crate) fn has_layers(&self) -> bool {
        let has_some = self.stripe_albedo[0] > 0.0 || self.sheen != [0.0; 3];
        self.kind == KIND_METALLIC_ROUGHNESS && has_some
    }

    /// Whether it is glTF's material with transmission through a thin wall.
    pub(crate) fn is_thin_wall(&self) -> bool {
        self.kind == KIND_METALLIC_ROUGHNESS && self.stripe_albedo[2] > 0.0
    }
}

/// Adds the parameters of clear coat, sheen and transmission to glTF's material.
fn with_layers(base: MaterialData, layers: &Layers) -> MaterialData {
    let alpha = layers.clearcoat_roughness * layers.clearcoat_roughness;
    let (least, most) = (*SHEEN_ROUGHNESS.start(), *SHEEN_ROUGHNESS.end());
    let width = (layers.sheen_roughness * layers.sheen_roughness).clamp(least, most);
    let reflected = match layers.sheen == Vec3::ZERO {
        true => [0.0; 6],
        false => {
            let strength = layers.sheen.max_element();
            sheen_reflectances(f64::from(width)).map(|share| strength * share as f32)
        }
    };
    let [a, b, c, d, e, f] = reflected;
    MaterialData {
        stripe_albedo: [layers.clearcoat, alpha, layers.transmission],
        sheen: (layers.sheen / (2.0 * std::f32::consts::PI)).to_array(),
        sheen_roughness: width,
        extinction: [a, b, c],
        scattering: [d, e, f],
        ..base
    }
}

fn cloth_data(
    albedo: Vec3,
    sheen: Vec3,
    sheen_roughness: f32,
    marks: Option<ClothMarks>,
) -> MaterialData {
    let most = sheen_reflectance_max(f64::from(sheen_roughness)) as f32;
    // A strong sheen of small width would reflect more light than arrives at grazing angles.
    let sheen = sheen / (sheen.max_element() * most).max(1.0);
    let left = (1.0 - sheen.max_element() * most).max(0.0);
    let pattern = marks.map_or(PATTERN_NONE, |_| PATTERN_CLOTH);
    let marks = marks.unwrap_or_default();
    MaterialData {
        albedo: (albedo * left).to_array(),
        pattern,
        sights: [marks.line_x, marks.d_radius, 0.0],
        stripe_albedo: marks.spots_x,
        scale: left,
        diffuse_scale: 1.0,
        sheen: (sheen / (2.0 * std::f32::consts::PI)).to_array(),
        sheen_roughness,
        ..MaterialData::zeroed()
    }
}

fn textured(coat: MaterialData, texture: &ProceduralTexture) -> MaterialData {
    let two_tone = |albedo: Vec3, other: Vec3, pattern| MaterialData {
        albedo: albedo.to_array(),
        stripe_albedo: other.to_array(),
        pattern,
        ..coat
    };
    match *texture {
        ProceduralTexture::Ball {
            albedo,
            stripe,
            number,
        } => MaterialData {
            stripe_half_width: stripe.map_or(0.0, |stripe| stripe.half_width),
            number: u32::from(number),
            ..two_tone(
                albedo,
                stripe.map_or(Vec3::ZERO, |stripe| stripe.albedo),
                if number > 0 {
                    PATTERN_NUMBER
                } else {
                    PATTERN_NONE
                },
            )
        },
        ProceduralTexture::Wood {
            light,
            dark,
            grain,
            sights,
            scale,
        } => MaterialData {
            grain_axis: grain as u32,
            sights: sights.map_or([0.0; 3], |s| [s.spacing, s.end_x, s.side_y]),
            scale: 1.0 / scale,
            ..two_tone(light, dark, PATTERN_WOOD)
        },
        ProceduralTexture::Cue { shaft, butt } => two_tone(shaft, butt, PATTERN_CUE),
        ProceduralTexture::Planks { light, dark, grain } => MaterialData {
            grain_axis: grain as u32,
            scale: 1.0,
            ..two_tone(light, dark, PATTERN_PLANKS)
        },
        ProceduralTexture::Bricks {
            light,
            dark,
            mortar,
        } => MaterialData {
            sights: mortar.to_array(),
            ..two_tone(light, dark, PATTERN_BRICKS)
        },
        ProceduralTexture::Scoreboard {
            face,
            ink,
            center: [y, z],
            radius,
        } => MaterialData {
            sights: [y, z, radius],
            ..two_tone(face, ink, PATTERN_SCOREBOARD)
        },
        ProceduralTexture::Print {
            sky,
            hills,
            center,
            half_height,
        } => MaterialData {
            sights: center.to_array(),
            scale: 1.0 / half_height,
            ..two_tone(sky, hills, PATTERN_PRINT)
        },
    }
}

fn rough_alpha(alpha: f32) -> f32 {
    if alpha < ALPHA_SMOOTH_MAX { 0.0 } else { alpha }
}

/// Parameters of an interior medium. Distances are drawn by the channel of least extinction, so that no
/// channel's weight exceeds 1.
fn medium_data(medium: &Medium) -> MaterialData {
    let Medium { extinction, albedo } = *medium;
    let data = MaterialData {
        extinction: extinction.to_array(),
        ..MaterialData::zeroed()
    };
    if albedo == Vec3::ZERO {
        return data;
    }
    let sampling_density = extinction.min_element();
    MaterialData {
        sampling_density,
        scattering: (albedo * extinction / sampling_density).to_array(),
        ..data
    }
}
