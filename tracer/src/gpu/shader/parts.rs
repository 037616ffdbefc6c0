//! Parts of a kernel: the WGSL files that are concatenated for a set of features.

use crate::compiled::ShapeKind;
use crate::gpu::features::Features;

/// The parts that a kernel is made of, each once.
pub(super) fn parts(features: &Features) -> Vec<&'static str> {
    let mut parts = vec![
        include_str!("../shaders/structs.wgsl"),
        include_str!("../shaders/sampling.wgsl"),
        include_str!("../shaders/geometry.wgsl"),
        include_str!("../shaders/bsdf.wgsl"),
        include_str!("../shaders/fresnel.wgsl"),
    ];
    parts.extend(features.shapes().map(shape_part));
    if features.bvhs.contains(&true) {
        parts.push(include_str!("../shaders/bvh.wgsl"));
    }
    parts.extend(match features.area_lights {
        0 => &[include_str!("../shaders/area_light_stub.wgsl")][..],
        _ => &[
            include_str!("../shaders/area_light.wgsl"),
            include_str!("../shaders/area_light_sample.wgsl"),
        ],
    });
    if features.area_lights > 0 || features.has_environment_map() {
        parts.push(include_str!("../shaders/argument.wgsl"));
    }
    parts.push(match features.has_environment_map() {
        true => ENVIRONMENT_MAP,
        false => include_str!("../shaders/environment_stub.wgsl"),
    });
    if features.punctual_lights > 0 {
        parts.push(PUNCTUAL_LIGHT);
    }
    parts.push(match features.has_coat {
        true => include_str!("../shaders/bsdf_plastic.wgsl"),
        false => include_str!("../shaders/bsdf_diffuse.wgsl"),
    });
    parts.push(match features.has_microfacet {
        true => include_str!("../shaders/microfacet.wgsl"),
        false => include_str!("../shaders/bsdf_layered.wgsl"),
    });
    parts.push(match features.has_rough_coat {
        true => include_str!("../shaders/rough_coat.wgsl"),
        false => include_str!("../shaders/rough_coat_stub.wgsl"),
    });
    if features.has_microfacet || features.has_metallic_roughness || features.has_rough_coat {
        parts.push(include_str!("../shaders/ggx.wgsl"));
    }
    parts.extend(metallic_roughness_parts(features));
    parts.push(match features.has_sheen {
        true => include_str!("../shaders/sheen.wgsl"),
        false => include_str!("../shaders/sheen_stub.wgsl"),
    });
    parts.push(match features.has_number || features.has_wood {
        true => include_str!("../shaders/texture.wgsl"),
        false => include_str!("../shaders/texture_stub.wgsl"),
    });
    parts.push(match features.has_dielectric {
        true => include_str!("../shaders/medium.wgsl"),
        false => include_str!("../shaders/medium_stub.wgsl"),
    });
    parts.push(match features.has_refracted_nee {
        true => include_str!("../shaders/refracted_nee.wgsl"),
        false => include_str!("../shaders/refracted_nee_stub.wgsl"),
    });
    if features.count(ShapeKind::Triangle) > 0 {
        parts.extend(triangle_normal_parts(features));
    }
    parts.push(AOV);
    parts.push(include_str!("../shaders/integrator.wgsl"));
    parts.push(include_str!("../shaders/block.wgsl"));
    parts.push(include_str!("../shaders/kernel.wgsl"));
    parts
}

fn metallic_roughness_parts(features: &Features) -> Vec<&'static str> {
    if !features.has_metallic_roughness {
        return Vec::new();
    }
    let factors = include_str!("../shaders/texture_factors.wgsl");
    let textures = match features.textures {
        0 => include_str!("../shaders/texture_factors_stub.wgsl"),
        _ => IMAGE_TEXTURE,
    };
    let layers = match features.has_layers {
        true => LAYERS,
        false => include_str!("../shaders/layers_stub.wgsl"),
    };
    let mut parts = vec![METALLIC_ROUGHNESS, factors, textures, layers];
    if features.has_layer_textures() {
        parts.push(LAYER_TEXTURES);
    }
    if features.has_layers {
        parts.push(match features.has_layer_factors {
            true => include_str!("../shaders/sheen_texture.wgsl"),
            false => include_str!("../shaders/sheen_texture_stub.wgsl"),
        });
        parts.push(match features.has_coat_normals {
            true => COAT_NORMAL,
            false => include_str!("../shaders/coat_normal_stub.wgsl"),
        });
    }
    if features.has_thin_walls {
        parts.extend(thin_wall_parts(features));
    }
    if !features.has_shading_normals() {
        parts.push(include_str!("../shaders/own_normal_stub.wgsl"));
    }
    parts.extend(emissive_surface_parts(features));
    parts
}

fn emissive_surface_parts(features: &Features) -> Vec<&'static str> {
    if !features.has_emissive_surfaces() {
        return vec![include_str!("../shaders/emissive_surface_stub.wgsl")];
    }
    let mut parts = vec![EMISSIVE_SURFACE];
    parts.extend(features.emissive_kinds().map(|shape| match shape {
        ShapeKind::Sphere => include_str!("../shaders/emissive_sphere.wgsl"),
        ShapeKind::Disc => include_str!("../shaders/emissive_disc.wgsl"),
        ShapeKind::Rectangle => include_str!("../shaders/emissive_rectangle.wgsl"),
        ShapeKind::Triangle => include_str!("../shaders/emissive_triangle.wgsl"),
        ShapeKind::Box | ShapeKind::CsgFace => unreachable!("light sampling leaves them to chance"),
    }));
    if features.emissive_triangles() > 0 {
        parts.push(match features.textures {
            0 => include_str!("../shaders/emission_texture_stub.wgsl"),
            _ => include_str!("../shaders/emission_texture.wgsl"),
        });
        if !features.has_opacity {
            parts.push(include_str!("../shaders/opacity_stub.wgsl"));
        }
    }
    parts
}

fn thin_wall_parts(features: &Features) -> Vec<&'static str> {
    let mut parts = vec![THIN_WALL];
    parts.push(match features.has_layers {
        true => include_str!("../shaders/thin_wall_layers.wgsl"),
        false => include_str!("../shaders/thin_wall_layers_stub.wgsl"),
    });
    if !features.has_coat_normals {
        parts.push(include_str!("../shaders/lit_cosine_stub.wgsl"));
    }
    parts.push(match features.has_transmission_textures {
        true => TRANSMISSION_TEXTURE,
        false => include_str!("../shaders/transmission_texture_stub.wgsl"),
    });
    parts
}

fn triangle_normal_parts(features: &Features) -> Vec<&'static str> {
    let mut parts = Vec::new();
    if features.has_dielectric_mesh {
        parts.push(include_str!("../shaders/dielectric_mesh.wgsl"));
    }
    if features.colored_triangles > 0 {
        parts.push(VERTEX_COLOR);
    }
    if features.has_opacity {
        parts.extend(opacity_parts(features));
    }
    if !features.has_shading_normals() {
        parts.push(include_str!("../shaders/triangle_flat.wgsl"));
        return parts;
    }
    parts.push(SHADING_NORMAL);
    parts.push(match features.smooth_triangles {
        0 => include_str!("../shaders/triangle_facets.wgsl"),
        _ => include_str!("../shaders/triangle_smooth.wgsl"),
    });
    if features.uv_triangles == 0 {
        parts.push(include_str!("../shaders/triangle_unmapped.wgsl"));
    }
    parts
}

fn opacity_parts(features: &Features) -> Vec<&'static str> {
    let mut parts = vec![OPACITY];
    parts.push(match features.textures {
        0 => include_str!("../shaders/opacity_texture_stub.wgsl"),
        _ => include_str!("../shaders/opacity_texture.wgsl"),
    });
    if features.colored_triangles == 0 {
        parts.push(include_str!("../shaders/vertex_color_stub.wgsl"));
    }
    parts
}

pub(super) const EMISSIVE_SURFACE: &str = include_str!("../shaders/emissive_surface.wgsl");

pub(super) const LAYERS: &str = include_str!("../shaders/layers.wgsl");

pub(super) const IMAGE_TEXTURE: &str = include_str!("../shaders/image_texture.wgsl");

pub(super) const LAYER_TEXTURES: &str = include_str!("../shaders/layer_textures.wgsl");

pub(super) const COAT_NORMAL: &str = include_str!("../shaders/coat_normal.wgsl");

pub(super) const THIN_WALL: &str = include_str!("../shaders/thin_wall.wgsl");

const TRANSMISSION_TEXTURE: &str = include_str!("../shaders/transmission_texture.wgsl");

pub(super) const AOV: &str = include_str!("../shaders/aov.wgsl");

pub(super) const OPACITY: &str = include_str!("../shaders/opacity.wgsl");

pub(super) const VERTEX_COLOR: &str = include_str!("../shaders/vertex_color.wgsl");

pub(super) const ENVIRONMENT_MAP: &str = include_str!("../shaders/environment_map.wgsl");

pub(super) const PUNCTUAL_LIGHT: &str = include_str!("../shaders/punctual_light.wgsl");

pub(super) const SHADING_NORMAL: &str = include_str!("../shaders/shading_normal.wgsl");

pub(super) const METALLIC_ROUGHNESS: &str = include_str!("../shaders/metallic_roughness.wgsl");

fn shape_part(shape: ShapeKind) -> &'static str {
    match shape {
        ShapeKind::Sphere => include_str!("../shaders/sphere.wgsl"),
        ShapeKind::Box => include_str!("../shaders/box.wgsl"),
        ShapeKind::Disc => include_str!("../shaders/disc.wgsl"),
        ShapeKind::Rectangle => include_str!("../shaders/rectangle.wgsl"),
        ShapeKind::CsgFace => include_str!("../shaders/csg.wgsl"),
        ShapeKind::Triangle => include_str!("../shaders/triangle.wgsl"),
    }
}
