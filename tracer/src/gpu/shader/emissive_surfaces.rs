//! WGSL functions for light sampling of emissive surfaces, specialised for the shapes in the scene.

use std::fmt::Write as _;

use crate::compiled::{EMISSIVE_SURFACE_REACH, ShapeKind};
use crate::gpu::features::Features;

/// Functions that look up an emissive surface, sample a point on one, and convert densities from
/// area to solid angle; empty if light sampling does not include emissive surfaces.
pub(super) fn emissive_surface_functions(features: &Features) -> String {
    if !features.has_emissive_surfaces() {
        return String::new();
    }
    let (shapes, triangles) = (features.emissive_shapes(), features.emissive_triangles());
    let mut text = emissive_surface_constants(features);
    text += "fn emissive_surface(index: u32) -> EmissiveSurfaceData {\n";
    let shape = "return scene_storage.emissive_shapes[index];";
    let triangle = format!("return mesh.lights[index - {shapes}u];");
    text += &match (shapes, triangles) {
        (_, 0) => format!("    {shape}\n"),
        (0, _) => format!("    {triangle}\n"),
        _ => format!("    if (index < {shapes}u) {{ {shape} }}\n    {triangle}\n"),
    };
    text += "}\nfn emissive_point(light: EmissiveSurfaceData, origin: vec3f, u: vec2f) -> EmissivePoint {\n    \
             switch (light.shape) {\n";
    for shape in features.emissive_kinds() {
        let (number, name) = (shape as u32, shape.function());
        _ = writeln!(
            text,
            "        case {number}u: {{ return {name}_point(light.index, origin, u); }}"
        );
    }
    text += "        default: { return NO_EMISSIVE_POINT; }\n    }\n}\n\
             fn area_per_angle(primitive: u32, origin: vec3f, t: f32, cosine: f32) -> f32 {\n";
    for shape in features.emissive_kinds() {
        let constant = shape.constant();
        let of_shape = match shape {
            ShapeKind::Sphere => {
                "        let sphere = scene_storage.spheres[primitive - SPHERE_FIRST];\n        \
                 let to_center = sphere.center - origin;\n        \
                 return sphere_area_per_angle(dot(to_center, to_center), sphere.radius);"
            }
            _ => "        return t * t / cosine;",
        };
        _ = writeln!(
            text,
            "    if (primitive - {constant}_FIRST < {constant}_COUNT) {{\n{of_shape}\n    }}"
        );
    }
    text + "    return 0.0;\n}\n"
}

/// Constants: the number of emissive surfaces, the probability of sampling them, and
/// [`ShapeKind::area_factor`].
fn emissive_surface_constants(features: &Features) -> String {
    let count: u32 = features.emissive_surfaces.iter().sum();
    let mut text = format!(
        "const EMISSIVE_SURFACE_SHARE: f32 = {:?};\n\
         const EMISSIVE_SURFACE_REACH: f32 = {EMISSIVE_SURFACE_REACH:?};\n\
         const EMISSIVE_SURFACE_COUNT: u32 = {count}u;\n\
         const EMISSIVE_SURFACE_STEPS: u32 = {}u;\n",
        features.emissive_surface_sixteenths as f32 / 16.0,
        count.next_power_of_two().ilog2()
    );
    for shape in features.emissive_kinds() {
        if let Some(factor) = shape.area_factor() {
            let constant = shape.constant();
            _ = writeln!(text, "const {constant}_AREA_FACTOR: f32 = {factor:?};");
        }
    }
    text
}
