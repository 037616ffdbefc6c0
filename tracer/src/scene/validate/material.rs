//! Validation of materials.

use glam::Vec3;

use super::layers::{check_layers, check_normal_scales, check_opacity};
use super::{
    COORDINATE_M_MAX, Check, EXTINCTION_PER_M_MAX, EXTINCTION_RATIO_MAX, INTERNAL_REFLECTANCE_MAX,
    IOR, SHARE, SHEEN_ROUGHNESS, TEXTURE_SCALE, channels, check_albedo, extent, in_range,
    is_within, radiance, require,
};
use crate::SceneError;
use crate::scene::{ClothMarks, Material, Medium, ProceduralTexture, Stripe};

#[expect(clippy::too_many_lines, reason = "one arm for each material")]
pub(super) fn check_material(material: &Material) -> Check {
    match *material {
        Material::Diffuse { albedo } => check_albedo("its albedo", albedo),
        Material::SmoothPlastic {
            albedo,
            ior,
            internal_reflectance,
            stripe,
        } => {
            check_albedo("its albedo", albedo)?;
            check_ior(ior)?;
            let internal = internal_reflectance.unwrap_or(0.0);
            let range = 0.0..=INTERNAL_REFLECTANCE_MAX;
            in_range("its internal_reflectance", internal, range)?;
            stripe.map_or(Ok(()), |stripe| check_stripe(&stripe))
        }
        Material::Coated {
            ior,
            alpha,
            texture,
        } => {
            check_ior(ior)?;
            check_alpha(alpha)?;
            check_texture(&texture)
        }
        Material::Cloth {
            albedo,
            sheen,
            sheen_roughness,
            marks,
        } => {
            check_albedo("its albedo", albedo)?;
            check_albedo("its sheen", sheen)?;
            in_range("its sheen_roughness", sheen_roughness, SHEEN_ROUGHNESS)?;
            marks.map_or(Ok(()), |marks| check_marks(&marks))
        }
        Material::Conductor {
            eta,
            k,
            alpha,
            number,
        } => {
            check_alpha(alpha)?;
            check_number(number)?;
            let max = *IOR.end();
            require(
                eta.cmpgt(Vec3::ZERO).all() && is_within(eta, 0.0, max),
                || {
                    let range = format!("each channel must be above 0 and at most {max}");
                    SceneError::value("its eta", eta, range)
                },
            )?;
            channels("its k", k, max)
        }
        Material::Dielectric {
            ior,
            alpha,
            medium,
            number,
        } => {
            check_ior(ior)?;
            check_alpha(alpha)?;
            check_number(number)?;
            medium.map_or(Ok(()), |medium| check_medium(&medium))
        }
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
            check_albedo("its base_color", base_color)?;
            in_range("its metallic", metallic, SHARE)?;
            in_range("its roughness", roughness, SHARE)?;
            check_ior(ior)?;
            radiance("material", emission)?;
            check_normal_scales(&textures)?;
            check_opacity(opacity)?;
            check_layers(&layers)
        }
    }
}

fn check_stripe(stripe: &Stripe) -> Check {
    check_albedo("its stripe's albedo", stripe.albedo)?;
    let half_width = stripe.half_width;
    require(half_width > 0.0 && half_width <= 1.0, || {
        let range = "it must be above 0 and at most 1";
        SceneError::value("its stripe's half_width", half_width, range)
    })
}

fn check_marks(marks: &ClothMarks) -> Check {
    let within = 0.0..=COORDINATE_M_MAX;
    in_range("the line_x of its marks", marks.line_x, within.clone())?;
    in_range("the d_radius of its marks", marks.d_radius, within)?;
    let mut spots = marks.spots_x.into_iter();
    spots.try_for_each(|x| along("a spot of its marks", x))
}

fn along(what: &str, coordinate: f32) -> Check {
    in_range(what, coordinate, -COORDINATE_M_MAX..=COORDINATE_M_MAX)
}

fn check_texture(texture: &ProceduralTexture) -> Check {
    match *texture {
        ProceduralTexture::Ball {
            albedo,
            stripe,
            number,
        } => {
            check_albedo("its albedo", albedo)?;
            check_number(number)?;
            stripe.map_or(Ok(()), |stripe| check_stripe(&stripe))
        }
        ProceduralTexture::Wood {
            light,
            dark,
            sights,
            scale,
            ..
        } => {
            check_albedo("its light albedo", light)?;
            check_albedo("its dark albedo", dark)?;
            in_range("the scale of its texture", scale, TEXTURE_SCALE)?;
            let Some(sights) = sights else { return Ok(()) };
            if sights.spacing != 0.0 {
                extent("the spacing of its sights", sights.spacing)?;
            }
            extent("the end_x of its sights", sights.end_x)?;
            extent("the side_y of its sights", sights.side_y)
        }
        ProceduralTexture::Cue { shaft, butt } => {
            check_albedo("the albedo of its shaft", shaft)?;
            check_albedo("the albedo of its butt", butt)
        }
        ProceduralTexture::Planks { light, dark, .. } => {
            check_albedo("its light albedo", light)?;
            check_albedo("its dark albedo", dark)
        }
        ProceduralTexture::Bricks {
            light,
            dark,
            mortar,
        } => {
            check_albedo("its light albedo", light)?;
            check_albedo("its dark albedo", dark)?;
            check_albedo("the albedo of its mortar", mortar)
        }
        ProceduralTexture::Scoreboard {
            face,
            ink,
            center,
            radius,
        } => {
            check_albedo("the albedo of its dials", face)?;
            check_albedo("the albedo of its ink", ink)?;
            let mut center = center.into_iter();
            center.try_for_each(|at| along("the centre of its dials", at))?;
            extent("the radius of its dials", radius)
        }
        ProceduralTexture::Print {
            sky,
            hills,
            center,
            half_height,
        } => {
            check_albedo("the albedo of its sky", sky)?;
            check_albedo("the albedo of its hills", hills)?;
            let mut center = center.to_array().into_iter();
            center.try_for_each(|at| along("the centre of its print", at))?;
            extent("the half_height of its print", half_height)
        }
    }
}

fn check_ior(ior: f32) -> Check {
    in_range("its ior", ior, IOR)
}

fn check_alpha(alpha: f32) -> Check {
    in_range("its alpha", alpha, SHARE)
}

fn check_medium(medium: &Medium) -> Check {
    check_albedo("its medium's albedo", medium.albedo)?;
    let extinction = medium.extinction;
    let fault = |range: String| SceneError::value("its medium's extinction", extinction, range);
    require(is_within(extinction, 0.0, EXTINCTION_PER_M_MAX), || {
        fault(format!(
            "each channel must be from 0 to {EXTINCTION_PER_M_MAX:e} per metre"
        ))
    })?;
    let (least, largest) = (extinction.min_element(), extinction.max_element());
    let is_even = least > 0.0 && largest <= EXTINCTION_RATIO_MAX * least;
    require(medium.albedo == Vec3::ZERO || is_even, || {
        fault(format!(
            "where it scatters, each channel must be above 0 and none more than {EXTINCTION_RATIO_MAX} times another"
        ))
    })
}

fn check_number(number: u8) -> Check {
    require(number <= 99, || {
        SceneError::value("its number", number, "it must be from 0 to 99")
    })
}
