//! WGSL for traversal (finding the nearest intersection along a ray) and for the surface at a hit.

use std::fmt::Write as _;
use std::ops::Range;

use crate::compiled::ShapeKind;
use crate::compiled::clusters::Clusters;
use crate::gpu::features::Features;

/// The functions by which rays find the primitives of a shape: by a BVH or linearly.
pub(super) fn find_part(shape: ShapeKind, has_bvh: bool) -> String {
    if has_bvh {
        let leaf = match shape {
            ShapeKind::Sphere => include_str!("../shaders/sphere_leaf.wgsl"),
            _ => include_str!("../shaders/shape_leaf.wgsl"),
        };
        return [leaf, include_str!("../shaders/shape_bvh.wgsl")]
            .concat()
            .replace("scene.SHAPE", &format!("{}.SHAPE", shape.buffer()))
            .replace("SHAPE_FIRST", &format!("{}_FIRST", shape.constant()))
            .replace("SHAPE", shape.function());
    }
    let each = match shape {
        ShapeKind::Sphere => include_str!("../shaders/sphere_linear.wgsl"),
        ShapeKind::Box => include_str!("../shaders/box_linear.wgsl"),
        ShapeKind::Disc => include_str!("../shaders/disc_linear.wgsl"),
        ShapeKind::Rectangle => include_str!("../shaders/rectangle_linear.wgsl"),
        // The linear search is in `csg.wgsl`.
        ShapeKind::CsgFace => "",
        ShapeKind::Triangle => include_str!("../shaders/triangle_linear.wgsl"),
    };
    each.to_owned()
}

/// A function that tests the bounds of a group of 32 boxes or CSG boxes; members of a cluster only
/// if the ray may hit the cluster's bounds.
pub(super) fn candidates(features: &Features, shape: ShapeKind) -> String {
    let (name, constant, count) = match shape {
        ShapeKind::Box if !features.has_bvh(shape) => ("box", "BOX", features.count(shape)),
        ShapeKind::CsgFace => ("csg_box", "CSG_BOX", features.csg_boxes),
        _ => return String::new(),
    };
    let mut text = format!(
        "// Bit i is set if the ray may meet box `first + i` before `t_max`.\n\
         fn {name}_candidates(prepared: PreparedRay, first: u32, t_max: f32) -> u32 {{\n    \
         var candidates = 0u;\n    \
         if ({constant}_IS_CULLED && prepared.block != NO_BLOCK) {{\n        \
         var left = candidates_of_block(prepared.block, {constant}_WORD + first / 32u);\n        \
         while (left != 0u) {{\n            \
         let i = firstTrailingBit(left);\n            \
         left &= left - 1u;\n            \
         let may_meet = may_meet_box(prepared, scene.{name}_bounds[first + i], t_max);\n            \
         candidates |= select(0u, 1u << i, may_meet);\n        }}\n        \
         return candidates;\n    }}\n"
    );
    // Bounds at constant addresses are direct operands of instructions; at other addresses they
    // have to be loaded.
    let each = |first: &str, start: usize, end: &str| {
        format!(
            "    for (var i = {start}u; i < {end}; i++) {{\n        \
             let may_meet = may_meet_box(prepared, scene.{name}_bounds[{first} + i], t_max);\n        \
             candidates |= select(0u, 1u << i, may_meet);\n    }}\n"
        )
    };
    let (count, clusters) = (count as usize, features.clusters(shape));
    let groups = count.div_ceil(Clusters::GROUP);
    for group in 0..groups.min(Clusters::GROUPS_MAX) {
        let first = group * Clusters::GROUP;
        let literal = format!("{first}u");
        _ = writeln!(text, "    if (first == {literal}) {{");
        let end = (count - first).min(Clusters::GROUP);
        // Bits of this group's boxes; those of clusters are removed below, and what remains is
        // tested without a cluster.
        let mut single = u64::from(u32::MAX >> (u32::BITS as usize - end)) << first;
        for (index, members) in clusters.members().enumerate() {
            if members.trailing_zeros() as usize / Clusters::GROUP != group {
                continue;
            }
            single &= !members;
            let bound = count + index;
            _ = writeln!(
                text,
                "    if (may_meet_box(prepared, scene.{name}_bounds[{bound}], t_max)) {{"
            );
            for run in runs(members >> first) {
                text += &each(&literal, run.start, &format!("{}u", run.end));
            }
            text += "    }\n";
        }
        for run in runs(single >> first) {
            text += &each(&literal, run.start, &format!("{}u", run.end));
        }
        text += "    return candidates;\n    }\n";
    }
    if groups > Clusters::GROUPS_MAX {
        text += &each("first", 0, &format!("min({count}u - first, 32u)"));
    }
    text + "    return candidates;\n}\n"
}

/// The set bits of a mask, as ranges of consecutive bits.
fn runs(mut mask: u64) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    while mask != 0 {
        let start = mask.trailing_zeros() as usize;
        let end = start + (mask >> start).trailing_ones() as usize;
        runs.push(start..end);
        mask &= u64::MAX.checked_shl(end as u32).unwrap_or(0);
    }
    runs
}

/// Functions for the nearest surface along a ray, and for the occlusion of a shadow ray.
pub(super) fn traverse(features: &Features) -> String {
    // A shadow ray begins with primitive 0, the lowest number: at equal distances the lowest number
    // wins, so no surface at exactly `t_max`, beyond which nothing occludes, takes its place.
    let mut text = String::from(
        "fn traverse(prepared: PreparedRay, start: u32, t_max: f32, is_shadow: bool, target_light: u32) -> Hit {\n    \
         var hit = Hit(t_max, select(NO_PRIMITIVE, 0u, is_shadow));\n",
    );
    for shape in features.shapes() {
        let name = shape.function();
        _ = writeln!(
            text,
            "    nearest_{name}(prepared, start, &hit);\n    \
             if (is_shadow && hit.t < t_max) {{ return hit; }}"
        );
    }
    text += match features.area_lights {
        0 => "",
        _ if features.area_lights_occlude => {
            "    nearest_area_light(prepared, select(NO_PRIMITIVE, target_light, is_shadow), &hit);\n"
        }
        _ => "    if (!is_shadow) { nearest_area_light(prepared, NO_PRIMITIVE, &hit); }\n",
    };
    text + "    return hit;\n}\n\
            fn nearest(ray: Ray, start: u32) -> Hit {\n    \
            return traverse(prepare_ray(ray), start, T_MISS, false, 0u);\n}\n\
            fn nearest_of_camera_ray(ray: Ray, block: u32) -> Hit {\n    \
            return traverse(prepare_camera_ray(ray, block), NO_PRIMITIVE, T_MISS, false, 0u);\n}\n\
            fn occluded(ray: Ray, start: u32, target_light: u32, t_max: f32) -> bool {\n    \
            return traverse(prepare_ray(ray), start, t_max, true, target_light).t < t_max;\n}\n"
}

pub(super) fn surface_at(features: &Features) -> String {
    let mut text =
        String::from("fn bare_surface_at(ray: Ray, hit: Hit, is_within: bool) -> Surface {\n");
    if features.has_shading_normals() {
        text += "    geometric_normal = vec3f(0.0);\n";
    }
    if features.textures > 0 {
        text += "    texture_factors = NO_TEXTURES;\n";
    }
    if features.has_transmission_textures {
        text += "    transmission_factor = 1.0;\n";
    }
    if features.has_layer_textures() {
        text += "    layer_factors = NO_LAYER_TEXTURES;\n    coat_normal = vec3f(0.0);\n";
    }
    for shape in features.shapes() {
        let (name, constant) = (shape.function(), shape.constant());
        _ = writeln!(
            text,
            "    if (hit.primitive < {constant}_FIRST + {constant}_COUNT) {{\n        \
             return {name}_surface(ray, hit.t, hit.primitive - {constant}_FIRST, is_within);\n    }}"
        );
    }
    text += "    return Surface(vec3f(0.0), vec3f(0.0), vec3f(0.0), 0u, false);\n}\n";
    text + "fn surface_at(ray: Ray, hit: Hit, is_within: bool) -> Surface {\n    \
            var surface = bare_surface_at(ray, hit, is_within);\n    \
            if (HAS_WOOD) { surface.albedo = textured(surface, texture_footprint(hit.t)); }\n    \
            return surface;\n}\n"
}

/// A function that returns the material of a primitive.
pub(super) fn material_of(features: &Features) -> String {
    let mut text = String::from("fn material_of(primitive: u32) -> u32 {\n");
    for shape in features.shapes_of_scene() {
        let (array, constant) = (shape.array(), shape.constant());
        _ = writeln!(
            text,
            "    if (primitive < {constant}_FIRST + {constant}_COUNT) {{\n        \
             return scene_storage.{array}[primitive - {constant}_FIRST].material;\n    }}"
        );
    }
    if features.has_dielectric_mesh {
        text += "    if (primitive - TRIANGLE_FIRST < TRIANGLE_COUNT) {\n        \
                 return mesh.triangles[primitive - TRIANGLE_FIRST].material;\n    }\n";
    }
    text + "    return 0u;\n}\n"
}
