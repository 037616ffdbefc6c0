//! Wrapping of WGSL functions: a part of a kernel replaces a function of another part, which it
//! calls under a new name. The wrapped definition is renamed by text replacement; calls keep the
//! name and so reach the wrapper.

use super::parts::{
    AOV, COAT_NORMAL, EMISSIVE_SURFACE, ENVIRONMENT_MAP, IMAGE_TEXTURE, LAYER_TEXTURES, LAYERS,
    METALLIC_ROUGHNESS, OPACITY, PUNCTUAL_LIGHT, SHADING_NORMAL, THIN_WALL, VERTEX_COLOR,
};
use crate::gpu::features::Features;

/// A part of a kernel, with those of its functions renamed that other parts wrap. From the outside
/// in: `shading_normal.wgsl`, and within it `metallic_roughness.wgsl`, `punctual_light.wgsl` and
/// `environment_map.wgsl`; `layers.wgsl`, `opacity.wgsl` and `vertex_color.wgsl`; and, around the
/// functions of all other lights, those of `emissive_surface.wgsl`.
pub(super) fn with_wrappers(features: &Features, part: &str) -> String {
    let mut text = part.to_owned();
    if features.has_thin_walls {
        text = with_thin_walls(features, part, text);
    }
    if features.has_layers && part == METALLIC_ROUGHNESS {
        for name in ["metallic_roughness_at", "mean_passed", "reflected_share"] {
            // Only definitions follow an `fn`: calls keep their name and so reach the wrapper.
            text = text.replace(&format!("fn {name}("), &format!("fn base_{name}("));
        }
    }
    if features.has_layer_factors && part == METALLIC_ROUGHNESS {
        let numbers = [("f0", "eta"), ("specular", "diffuse_scale")];
        for (name, field) in numbers {
            let plain = format!("let {name} = scene_storage.materials[material].{field};");
            let textured = format!("let {name} = textured_{name}(material);");
            text = text.replace(&plain, &textured);
        }
    }
    if features.has_layer_textures() && part == IMAGE_TEXTURE {
        text = text
            .replace(
                "fn triangle_shading_normal(",
                "fn base_triangle_shading_normal(",
            )
            .replace("fn texel(", "fn color_texel(");
    }
    if features.has_coat_normals {
        text = with_coat_normals(part, text);
    }
    if features.has_coat_normals || features.has_thin_walls {
        text = with_lit_cosine(part, text);
    }
    if features.has_opacity && part != OPACITY {
        text = text.replace("fn triangle_t(", "fn solid_triangle_t(");
    }
    if features.colored_triangles > 0 && part != VERTEX_COLOR {
        text = text.replace("fn triangle_surface(", "fn plain_triangle_surface(");
    }
    let is_outer = [METALLIC_ROUGHNESS, SHADING_NORMAL, COAT_NORMAL, THIN_WALL].contains(&part);
    if features.has_metallic_roughness && !is_outer {
        for name in [
            "bsdf_at",
            "bsdf_regularised",
            "bsdf_is_layered",
            "bsdf_albedo",
            "bsdf_mirror",
            "bsdf_eval",
            "bsdf_sample",
            "shade",
            "extend",
        ] {
            text = text.replace(&format!("fn {name}("), &format!("fn plain_{name}("));
        }
    }
    text = with_lights(features, part, text);
    if features.has_emissive_surfaces() && part != EMISSIVE_SURFACE {
        text = text.replace("fn note_density(", "fn lamp_note_density(");
    }
    if features.has_shading_normals() && part != SHADING_NORMAL {
        for name in ["direct_light", "bsdf_sample"] {
            text = text.replace(&format!("fn {name}("), &format!("fn bare_{name}("));
        }
    }
    text
}

/// A part of a kernel, with the functions that sample each kind of light wrapped around those of
/// the others.
fn with_lights(features: &Features, part: &str, mut text: String) -> String {
    // From the innermost to the outermost.
    let wrappers = [
        (features.has_environment_map(), ENVIRONMENT_MAP, "area"),
        (features.punctual_lights > 0, PUNCTUAL_LIGHT, "other"),
        (features.has_emissive_surfaces(), EMISSIVE_SURFACE, "lamp"),
    ];
    for (place, (is_there, _, name)) in wrappers.iter().enumerate() {
        let mut outer = wrappers[place..].iter().map(|(_, part, _)| *part);
        if *is_there && part != SHADING_NORMAL && !outer.any(|outer| outer == part) {
            text = text.replace("fn direct_light(", &format!("fn {name}_direct_light("));
        }
    }
    text
}

/// A part of a kernel for scenes with thin walls: functions of `thin_wall.wgsl` and
/// `transmission_texture.wgsl` wrap those of other parts.
fn with_thin_walls(features: &Features, part: &str, text: String) -> String {
    let outermost =
        |is_wrapped: bool, wrapper: &'static str, wrapped: &'static str| match is_wrapped {
            true => wrapper,
            false => wrapped,
        };
    let lookup = outermost(features.has_layer_textures(), LAYER_TEXTURES, IMAGE_TEXTURE);
    let material = outermost(features.has_layers, LAYERS, METALLIC_ROUGHNESS);
    let evaluation = outermost(features.has_coat_normals, COAT_NORMAL, METALLIC_ROUGHNESS);
    let mut renamed = vec![
        (material, "metallic_roughness_at"),
        (evaluation, "bsdf_eval"),
        (METALLIC_ROUGHNESS, "bsdf_sample"),
        (METALLIC_ROUGHNESS, "bsdf_mirror"),
        (METALLIC_ROUGHNESS, "bsdf_albedo"),
        (COAT_NORMAL, "lit_cosine"),
    ];
    if features.has_transmission_textures {
        renamed.push((lookup, "triangle_shading_normal"));
    }
    let names = renamed.iter().filter(|(wrapped, _)| *wrapped == part);
    let text = names.fold(text, |text, (_, name)| {
        text.replace(&format!("fn {name}("), &format!("fn opaque_{name}("))
    });
    match part {
        THIN_WALL if features.has_layer_factors => text.replace(
            "scene_storage.materials[material].diffuse_scale",
            "textured_specular(material)",
        ),
        SHADING_NORMAL => text.replace(
            "HAS_DIELECTRIC && bsdf_is_transmissive(bsdf) &&",
            "(lets_light_pass() || bsdf_is_transmissive(bsdf)) &&",
        ),
        AOV => text
            .replace(
                "bsdf_mirror(bsdf, cos_o)",
                "bsdf_mirror(bsdf, surface.normal, wo)",
            )
            .replace(
                "2.0 * cos_o * surface.normal - wo",
                "mirror_direction(surface.normal, wo)",
            ),
        _ => text,
    }
}

/// A part of a kernel for scenes in which clear coats have normals of their own: the cosine of
/// incident light is taken to either normal.
fn with_coat_normals(part: &str, text: String) -> String {
    const REFLECTED: &str = "reflected_by(sample_visible(";
    match part {
        METALLIC_ROUGHNESS => text
            .replace("fn bsdf_eval(", "fn base_bsdf_eval(")
            .replace(REFLECTED, "reflected_above(n, sample_visible(")
            .replace(
                "(dot(n, wi) / evaluated.pdf)",
                "(lit_cosine(n, wi) / evaluated.pdf)",
            ),
        LAYERS => text
            .replace("fn with_layers(", "fn coaxial_layers(")
            .replace(REFLECTED, "reflected_above(coat_n, sample_visible("),
        _ => text,
    }
}

/// A part of a kernel in which the cosine of incident light is not always that to the surface's
/// normal.
fn with_lit_cosine(part: &str, text: String) -> String {
    if [METALLIC_ROUGHNESS, LAYERS].contains(&part) {
        return text;
    }
    text.replace(
        "let cos_i = dot(surface.normal, ",
        "let cos_i = lit_cosine(surface.normal, ",
    )
    .replace(
        "dot(wi, surface.normal) < 0.0",
        "lit_cosine(surface.normal, wi) < 0.0",
    )
}
