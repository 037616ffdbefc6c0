//! Generation of a kernel's WGSL source, with only the parts that a scene requires.

mod buffers;
mod constants;
mod emissive_surfaces;
mod frustum;
mod parts;
mod traversal;
mod wrappers;

#[cfg(test)]
mod tests;

use std::fmt::Write as _;

use buffers::{environment_declaration, mesh_declaration, scene_declaration, texture_declaration};
use constants::constants;
pub(crate) use constants::dispatch_constants;
use emissive_surfaces::emissive_surface_functions;
use parts::parts;
use traversal::{candidates, find_part, material_of, surface_at, traverse};
use wrappers::with_wrappers;

use crate::gpu::features::Features;

/// Pixels along the edge of a block; a workgroup traces one or more blocks.
pub(crate) const BLOCK_EDGE: u32 = 8;

/// WGSL source of the kernel for scenes with these features.
pub(crate) fn source(features: &Features) -> String {
    let mut text = constants(features);
    text += &scene_declaration(features);
    text += &mesh_declaration(features);
    text += &texture_declaration(features);
    text += &environment_declaration(features);
    let copies = workgroup_copies(features);
    for part in parts(features) {
        let part = with_wrappers(features, part);
        let part = copies.iter().fold(part, |part, copy| {
            let (buffer, array) = (copy.buffer, copy.array);
            part.replace(&format!("{buffer}.{array}["), &format!("copied_{array}["))
        });
        // Rays that pass through a triangle of a dielectric mesh start on its other side.
        text += &match features.has_dielectric_mesh {
            true => part.replace(
                "Ray(surface.position, next.wi)",
                "Ray(origin_towards(surface, primitive, next.wi), next.wi)",
            ),
            false => part,
        };
    }
    for shape in features.shapes() {
        text += &find_part(shape, features.has_bvh(shape));
        text += &candidates(features, shape);
    }
    text += &frustum::declaration(features);
    text += &copies_declaration(&copies);
    text += &traverse(features);
    text += &surface_at(features);
    text += &material_of(features);
    text += &emissive_surface_functions(features);
    text
}

/// An array of the scene of which each workgroup keeps a copy in workgroup memory.
struct WorkgroupCopy {
    /// Name of the buffer that the kernel's parts read the array from.
    buffer: &'static str,
    array: &'static str,
    element: &'static str,
    count: u32,
}

/// The arrays that the threads of a workgroup index differently: workgroup memory serves such reads
/// in parallel, constant memory one after another.
fn workgroup_copies(features: &Features) -> Vec<WorkgroupCopy> {
    if !features.copies_primitives() {
        return Vec::new();
    }
    let copy = |buffer, array, element, count| WorkgroupCopy {
        buffer,
        array,
        element,
        count,
    };
    let [spheres, boxes, _, _, faces, _] = features.counts;
    let mut copies = vec![
        copy("scene", "csg_faces", "CsgFaceData", faces),
        copy("scene", "csg_boxes", "CsgBoxData", features.csg_boxes),
        copy("scene_storage", "boxes", "BoxData", boxes),
        copy("scene_storage", "spheres", "SphereData", spheres),
    ];
    copies.retain(|copy| copy.count > 0);
    copies
}

/// Declarations of the copies, and the function in which a workgroup's threads fill them.
fn copies_declaration(copies: &[WorkgroupCopy]) -> String {
    let mut text = String::new();
    for copy in copies {
        let (array, element, count) = (copy.array, copy.element, copy.count);
        _ = writeln!(
            text,
            "var<workgroup> copied_{array}: array<{element}, {count}>;"
        );
    }
    text += "fn copy_primitives(thread: u32) {\n";
    for copy in copies {
        let (array, count) = (copy.array, copy.count);
        _ = writeln!(
            text,
            "    for (var i = thread; i < {count}u; i += BLOCK_PIXELS * WORKGROUP_BLOCKS) {{\n        \
             copied_{array}[i] = scene_storage.{array}[i];\n    }}"
        );
    }
    if !copies.is_empty() {
        text += "    workgroupBarrier();\n";
    }
    text + "}\n"
}
