//! WGSL for frustum culling of camera rays: finds the primitives that the rays of a block of pixels
//! may hit.

use std::fmt::Write as _;

use crate::compiled::ShapeKind;
use crate::gpu::features::Features;

/// How far outside a frustum's planes a primitive may lie before it is culled, relative to its
/// distance from the eye. The rounding errors of the planes and of the ray tests are below a tenth
/// of this.
const SLACK: f32 = 1e-5;
/// Maximum number of primitives of a shape that are culled: 1024 bits for each of 16 blocks, 2 KiB
/// of the workgroup's 32.
const CULLED_MAX: u32 = 1024;

/// Declarations of a block's candidate bits, of the culling, and of the first word of each shape's
/// bits.
pub(super) fn declaration(features: &Features) -> String {
    let mut text = String::new();
    let mut bounds =
        String::from("fn candidate_bound(i: u32) -> CandidateBound {\n    var index = i;\n");
    let (mut words, mut primitives) = (0, 0);
    for shape in features.shapes().filter(|shape| !features.has_bvh(*shape)) {
        let (constant, count, [center, half]) = match shape {
            ShapeKind::Sphere => (
                "SPHERE",
                features.count(shape),
                ["spheres[index].center", "spheres[index].radius"],
            ),
            ShapeKind::Box => (
                "BOX",
                features.count(shape),
                ["box_bounds[index].center", "box_bounds[index].half"],
            ),
            ShapeKind::CsgFace => (
                "CSG_BOX",
                features.csg_boxes,
                ["csg_box_bounds[index].center", "csg_box_bounds[index].half"],
            ),
            // These have no bounds.
            ShapeKind::Disc | ShapeKind::Rectangle | ShapeKind::Triangle => continue,
        };
        let is_culled = count <= CULLED_MAX;
        _ = writeln!(
            text,
            "const {constant}_WORD: u32 = {words}u;\nconst {constant}_IS_CULLED: bool = {is_culled};"
        );
        if !is_culled {
            continue;
        }
        _ = writeln!(
            bounds,
            "    if (index < {count}u) {{\n        \
             let half = vec3f(scene_storage.{half});\n        \
             return CandidateBound(scene_storage.{center}, half, {constant}_WORD + index / 32u, index % 32u);\n    }}\n    \
             index -= {count}u;"
        );
        words += count.div_ceil(32);
        primitives += count;
    }
    _ = writeln!(
        text,
        "const CANDIDATE_WORDS: u32 = {}u;\n\
         const CULLED_COUNT: u32 = {primitives}u;\n\
         const FRUSTUM_SLACK: f32 = {SLACK:e};",
        // WGSL has no arrays of length 0.
        words.max(1)
    );
    text += include_str!("../shaders/frustum.wgsl");
    text + &bounds + "    return CandidateBound(vec3f(0.0), vec3f(0.0), 0u, 0u);\n}\n"
}
