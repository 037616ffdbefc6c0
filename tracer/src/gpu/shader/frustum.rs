//! Frustum culling of camera rays: the primitives that those of a block of pixels may meet, as text of a kernel.

use std::fmt::Write as _;

use crate::compiled::ShapeKind;
use crate::gpu::features::Features;

/// How much farther out than a frustum's planes a primitive may lie, over its distance from the eye: rounding of the
/// planes and of the tests of rays errs by less than a tenth of it.
const SLACK: f32 = 1e-5;

/// The list of each block, how it is made, and where each shape's primitives lie in it.
pub(super) fn declaration(features: &Features) -> String {
    let mut text = String::new();
    let mut bounds = String::from("fn listed_bound(i: u32) -> ListedBound {\n    var index = i;\n");
    let (mut words, mut primitives) = (0, 0);
    for shape in features
        .shapes()
        .filter(|shape| is_listed(features, *shape))
    {
        let (name, constant, count) = match shape {
            ShapeKind::CsgFace => ("csg_box", "CSG_BOX", features.csg_boxes),
            _ => (shape.function(), shape.constant(), features.count(shape)),
        };
        let [center, half] = match shape {
            ShapeKind::Sphere => {
                ["spheres[index].center", "spheres[index].radius"].map(str::to_owned)
            }
            _ => ["center", "half"].map(|field| format!("{name}_bounds[index].{field}")),
        };
        _ = writeln!(text, "const {constant}_WORD: u32 = {words}u;");
        _ = writeln!(
            bounds,
            "    if (index < {count}u) {{\n        \
             let half = vec3f(scene_storage.{half});\n        \
             return ListedBound(scene_storage.{center}, half, {constant}_WORD + index / 32u, index % 32u);\n    }}\n    \
             index -= {count}u;"
        );
        words += count.div_ceil(32);
        primitives += count;
    }
    _ = writeln!(
        text,
        "const LIST_WORDS: u32 = {}u;\n\
         const LISTED_PRIMITIVES: u32 = {primitives}u;\n\
         const FRUSTUM_SLACK: f32 = {SLACK:e};",
        words.max(1)
    );
    text += include_str!("../shaders/frustum.wgsl");
    text + &bounds + "    return ListedBound(vec3f(0.0), vec3f(0.0), 0u, 0u);\n}\n"
}

/// Whether primitives of a shape are listed: where there are few, each of which is tested by its bounds.
fn is_listed(features: &Features, shape: ShapeKind) -> bool {
    let has_bounds = matches!(
        shape,
        ShapeKind::Sphere | ShapeKind::Box | ShapeKind::CsgFace
    );
    has_bounds && !features.has_bvh(shape)
}
