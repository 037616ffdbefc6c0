//! The kernel as text: parts joined from a table, with only what a scene requires.

use std::fmt::Write as _;

use crate::bvh::{self, DEPTH_MAX, LEAF, SLACK};
use crate::compiled::{
    AreaLightData, CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z,
    CSG_FACE_CYLINDER, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, EMISSIVE_SURFACE_REACH, KIND_CONDUCTOR,
    KIND_DIELECTRIC, KIND_LAYERED, KIND_METALLIC_ROUGHNESS, MaterialTextureData, OPACITY_MASK,
    OPACITY_OPAQUE, PATTERN_CLOTH, PATTERN_CUE, PATTERN_NUMBER, PATTERN_PLANKS, PATTERN_WOOD,
    ShapeKind, SphereData, TextureData, TriangleData, WRAP_CLAMP, WRAP_REPEAT,
};
use crate::gpu::features::{Features, KernelOutput, SceneMemory};
use crate::gpu::frustum;
use crate::gpu::layout::{
    BVH_LEAF, COUNTERS_BEFORE_TILES, ENVIRONMENT_BINDING, LISTED_PIXELS, MESH_BINDING,
    SPHERE_SLACK, TEXTURE_BINDING,
};
use crate::regularisation::{ALPHA_MIN, CONE_COSINE, CONE_DENSITY, KEY_MASK};
use crate::sampling::{
    BELOW_1, BLOCK_CAMERA, BLOCK_LENS, ROULETTE_DEPTH, SCRAMBLE, SURVIVAL_PER_THROUGHPUT,
};
use crate::scalar::metallic_roughness::{ALPHA_LEAST, CLEARCOAT_F0};
use crate::scalar::triangle::{POINT_ROUNDING, REFLECTION_SINE_MIN};
use crate::scene::validate::{CSG_MARGIN_M, SHEEN_ROUGHNESS};
use crate::sheen::{SHEEN_REFLECTANCES, SHEEN_ROOT_MIN};
use crate::texture;

/// Pixels along the edge of a block, of which a workgroup traces one or some.
pub(crate) const BLOCK_EDGE: u32 = 8;

/// The kernel for scenes of `features`.
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
            let (read, copied) = (
                format!("{}[", copy.source),
                format!("copied_{}[", copy.array),
            );
            part.replace(&read, &copied)
        });
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

/// An array of the scene that a workgroup keeps in its own memory.
struct WorkgroupCopy {
    /// What the parts of a kernel read it as.
    source: &'static str,
    array: &'static str,
    element: &'static str,
    count: u32,
}

/// The arrays that threads of a workgroup read at different indices: its own memory serves them at once, constants
/// one after the other.
fn workgroup_copies(features: &Features) -> Vec<WorkgroupCopy> {
    let copy = |source, array, element, count| WorkgroupCopy {
        source,
        array,
        element,
        count,
    };
    let (faces, boxes) = (features.csg_faces, features.csg_boxes);
    let mut copies = match features.copies_primitives() {
        true => vec![
            copy("scene.csg_faces", "csg_faces", "CsgFaceData", faces),
            copy("scene.csg_boxes", "csg_boxes", "CsgBoxData", boxes),
            copy("scene_storage.boxes", "boxes", "BoxData", features.boxes),
            copy(
                "scene_storage.spheres",
                "spheres",
                "SphereData",
                features.spheres,
            ),
        ],
        false => Vec::new(),
    };
    copies.retain(|copy| copy.count > 0);
    copies
}

/// The copies, and how a workgroup's threads make them.
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

/// The parts that a kernel is joined from, each once.
fn parts(features: &Features) -> Vec<&'static str> {
    let mut parts = vec![
        include_str!("shaders/structs.wgsl"),
        include_str!("shaders/sampling.wgsl"),
        include_str!("shaders/geometry.wgsl"),
        include_str!("shaders/bsdf.wgsl"),
        include_str!("shaders/fresnel.wgsl"),
    ];
    parts.extend(features.shapes().map(shape_part));
    if features.bvhs.contains(&true) {
        parts.push(include_str!("shaders/bvh.wgsl"));
    }
    parts.extend(match features.area_lights {
        0 => &[include_str!("shaders/area_light_stub.wgsl")][..],
        _ => &[
            include_str!("shaders/area_light.wgsl"),
            include_str!("shaders/area_light_sample.wgsl"),
        ],
    });
    if features.area_lights > 0 || features.has_environment_map() {
        parts.push(include_str!("shaders/argument.wgsl"));
    }
    parts.push(match features.has_environment_map() {
        true => ENVIRONMENT_MAP,
        false => include_str!("shaders/environment_stub.wgsl"),
    });
    if features.punctual_lights > 0 {
        parts.push(PUNCTUAL_LIGHT);
    }
    parts.push(match features.has_coat {
        true => include_str!("shaders/bsdf_plastic.wgsl"),
        false => include_str!("shaders/bsdf_diffuse.wgsl"),
    });
    parts.push(match features.has_microfacet {
        true => include_str!("shaders/microfacet.wgsl"),
        false => include_str!("shaders/bsdf_layered.wgsl"),
    });
    if features.has_microfacet || features.has_metallic_roughness {
        parts.push(include_str!("shaders/ggx.wgsl"));
    }
    parts.extend(metallic_roughness_parts(features));
    parts.push(match features.has_sheen {
        true => include_str!("shaders/sheen.wgsl"),
        false => include_str!("shaders/sheen_stub.wgsl"),
    });
    parts.push(match features.has_number || features.has_wood {
        true => include_str!("shaders/texture.wgsl"),
        false => include_str!("shaders/texture_stub.wgsl"),
    });
    parts.push(match features.has_dielectric {
        true => include_str!("shaders/medium.wgsl"),
        false => include_str!("shaders/medium_stub.wgsl"),
    });
    parts.push(match features.has_refracted_nee {
        true => include_str!("shaders/refracted_nee.wgsl"),
        false => include_str!("shaders/refracted_nee_stub.wgsl"),
    });
    if features.triangles > 0 {
        parts.extend(triangle_normal_parts(features));
    }
    parts.push(AOV);
    parts.push(include_str!("shaders/path.wgsl"));
    parts.push(include_str!("shaders/block.wgsl"));
    parts.push(include_str!("shaders/kernel.wgsl"));
    parts
}

fn metallic_roughness_parts(features: &Features) -> Vec<&'static str> {
    if !features.has_metallic_roughness {
        return Vec::new();
    }
    let factors = include_str!("shaders/texture_factors.wgsl");
    let textures = match features.textures {
        0 => include_str!("shaders/texture_factors_stub.wgsl"),
        _ => IMAGE_TEXTURE,
    };
    let layers = match features.has_layers {
        true => LAYERS,
        false => include_str!("shaders/layers_stub.wgsl"),
    };
    let mut parts = vec![METALLIC_ROUGHNESS, factors, textures, layers];
    if features.has_layer_textures() {
        parts.push(LAYER_TEXTURES);
    }
    if features.has_layers {
        parts.push(match features.has_layer_factors {
            true => include_str!("shaders/sheen_texture.wgsl"),
            false => include_str!("shaders/sheen_texture_stub.wgsl"),
        });
        parts.push(match features.has_coat_normals {
            true => COAT_NORMAL,
            false => include_str!("shaders/coat_normal_stub.wgsl"),
        });
    }
    if features.has_thin_walls {
        parts.extend(thin_wall_parts(features));
    }
    if !features.has_shading_normals() {
        parts.push(include_str!("shaders/own_normal_stub.wgsl"));
    }
    parts.extend(emissive_surface_parts(features));
    parts
}

fn emissive_surface_parts(features: &Features) -> Vec<&'static str> {
    if !features.has_emissive_surfaces() {
        return vec![include_str!("shaders/emissive_surface_stub.wgsl")];
    }
    let mut parts = vec![EMISSIVE_SURFACE];
    parts.extend(features.emissive_kinds().map(|shape| match shape {
        ShapeKind::Sphere => include_str!("shaders/emissive_sphere.wgsl"),
        ShapeKind::Disc => include_str!("shaders/emissive_disc.wgsl"),
        ShapeKind::Rectangle => include_str!("shaders/emissive_rectangle.wgsl"),
        ShapeKind::Triangle => include_str!("shaders/emissive_triangle.wgsl"),
        ShapeKind::Box | ShapeKind::CsgFace => unreachable!("light sampling leaves them to chance"),
    }));
    if features.emissive_triangles() > 0 {
        parts.push(match features.textures {
            0 => include_str!("shaders/emission_texture_stub.wgsl"),
            _ => include_str!("shaders/emission_texture.wgsl"),
        });
        if !features.has_opacity {
            parts.push(include_str!("shaders/opacity_stub.wgsl"));
        }
    }
    parts
}

fn thin_wall_parts(features: &Features) -> Vec<&'static str> {
    let mut parts = vec![THIN_WALL];
    parts.push(match features.has_layers {
        true => include_str!("shaders/thin_wall_layers.wgsl"),
        false => include_str!("shaders/thin_wall_layers_stub.wgsl"),
    });
    if !features.has_coat_normals {
        parts.push(include_str!("shaders/lit_cosine_stub.wgsl"));
    }
    parts.push(match features.has_transmission_textures {
        true => TRANSMISSION_TEXTURE,
        false => include_str!("shaders/transmission_texture_stub.wgsl"),
    });
    parts
}

fn triangle_normal_parts(features: &Features) -> Vec<&'static str> {
    let mut parts = Vec::new();
    if features.has_dielectric_mesh {
        parts.push(include_str!("shaders/dielectric_mesh.wgsl"));
    }
    if features.colored_triangles > 0 {
        parts.push(VERTEX_COLOR);
    }
    if features.has_opacity {
        parts.extend(opacity_parts(features));
    }
    if !features.has_shading_normals() {
        parts.push(include_str!("shaders/triangle_flat.wgsl"));
        return parts;
    }
    parts.push(SHADING_NORMAL);
    parts.push(match features.smooth_triangles {
        0 => include_str!("shaders/triangle_facets.wgsl"),
        _ => include_str!("shaders/triangle_smooth.wgsl"),
    });
    if features.uv_triangles == 0 {
        parts.push(include_str!("shaders/triangle_unmapped.wgsl"));
    }
    parts
}

fn opacity_parts(features: &Features) -> Vec<&'static str> {
    let mut parts = vec![OPACITY];
    parts.push(match features.textures {
        0 => include_str!("shaders/opacity_texture_stub.wgsl"),
        _ => include_str!("shaders/opacity_texture.wgsl"),
    });
    if features.colored_triangles == 0 {
        parts.push(include_str!("shaders/vertex_color_stub.wgsl"));
    }
    parts
}

const EMISSIVE_SURFACE: &str = include_str!("shaders/emissive_surface.wgsl");
const LAYERS: &str = include_str!("shaders/layers.wgsl");
const IMAGE_TEXTURE: &str = include_str!("shaders/image_texture.wgsl");
const LAYER_TEXTURES: &str = include_str!("shaders/layer_textures.wgsl");
const COAT_NORMAL: &str = include_str!("shaders/coat_normal.wgsl");
const THIN_WALL: &str = include_str!("shaders/thin_wall.wgsl");
const TRANSMISSION_TEXTURE: &str = include_str!("shaders/transmission_texture.wgsl");
const AOV: &str = include_str!("shaders/aov.wgsl");
const OPACITY: &str = include_str!("shaders/opacity.wgsl");
const VERTEX_COLOR: &str = include_str!("shaders/vertex_color.wgsl");
const ENVIRONMENT_MAP: &str = include_str!("shaders/environment_map.wgsl");
const PUNCTUAL_LIGHT: &str = include_str!("shaders/punctual_light.wgsl");
const SHADING_NORMAL: &str = include_str!("shaders/shading_normal.wgsl");
const METALLIC_ROUGHNESS: &str = include_str!("shaders/metallic_roughness.wgsl");

fn shape_part(shape: ShapeKind) -> &'static str {
    match shape {
        ShapeKind::Sphere => include_str!("shaders/sphere.wgsl"),
        ShapeKind::Box => include_str!("shaders/box.wgsl"),
        ShapeKind::Disc => include_str!("shaders/disc.wgsl"),
        ShapeKind::Rectangle => include_str!("shaders/rectangle.wgsl"),
        ShapeKind::CsgFace => include_str!("shaders/csg.wgsl"),
        ShapeKind::Triangle => include_str!("shaders/triangle.wgsl"),
    }
}

/// How rays find the primitives of a shape.
fn find_part(shape: ShapeKind, has_bvh: bool) -> String {
    if has_bvh {
        let leaf = match shape {
            ShapeKind::Sphere => include_str!("shaders/sphere_leaf.wgsl"),
            _ => include_str!("shaders/shape_leaf.wgsl"),
        };
        return [leaf, include_str!("shaders/shape_bvh.wgsl")]
            .concat()
            .replace("scene.SHAPE", &format!("{}.SHAPE", shape.buffer()))
            .replace("SHAPE_FIRST", &format!("{}_FIRST", shape.constant()))
            .replace("SHAPE", shape.function());
    }
    let each = match shape {
        ShapeKind::Sphere => include_str!("shaders/sphere_linear.wgsl"),
        ShapeKind::Box => include_str!("shaders/box_linear.wgsl"),
        ShapeKind::Disc => include_str!("shaders/disc_linear.wgsl"),
        ShapeKind::Rectangle => include_str!("shaders/rectangle_linear.wgsl"),
        // Its part has that too.
        ShapeKind::CsgFace => "",
        ShapeKind::Triangle => include_str!("shaders/triangle_linear.wgsl"),
    };
    each.to_owned()
}

/// Numbers that Rust owns.
fn constants(features: &Features) -> String {
    let mut text = format!(
        "const SOLID_ANGLE_MIN: f32 = {};\n\
         const COMPENSATED: bool = {};\n\
         const DISCS_COPLANAR: bool = {};\n\
         const AREA_LIGHTS_COPLANAR: bool = {};\n\
         const AREA_LIGHTS_SCALED: bool = {};\n\
         const SPHERE_SLACK: f32 = {SPHERE_SLACK:e};\n\
         const BVH_DEPTH_MAX: u32 = {DEPTH_MAX}u;\n\
         const BVH_LEAF: u32 = {BVH_LEAF}u;\n\
         const LEAF: u32 = {LEAF}u;\n\
         const BVH_SLACK: f32 = {SLACK:e};\n\
         const HAS_COAT: bool = {};\n\
         const HAS_STRIPE: bool = {};\n\
         const HAS_DIELECTRIC: bool = {};\n\
         const HAS_REFRACTED_NEE: bool = {};\n\
         const HAS_METALLIC_ROUGHNESS: bool = {};\n\
         const HAS_LAYERS: bool = {};\n\
         const HAS_EMISSION: bool = {};\n\
         const HAS_ENVIRONMENT_MAP: bool = {};\n\
         const SAMPLES_LIGHT: bool = {};\n\
         const ALPHA_LEAST: f32 = {ALPHA_LEAST:?};\n\
         const CLEARCOAT_F0: f32 = {CLEARCOAT_F0:?};\n\
         const REFRACTED_NEE_STEPS: u32 = {}u;\n\
         const HAS_NUMBER: bool = {};\n\
         const HAS_NUMBER_DISC: bool = {};\n\
         const HAS_WOOD: bool = {};\n\
         const HAS_CSG_CONE: bool = {};\n\
         const CSG_MARGIN_M: f32 = {CSG_MARGIN_M:?};\n\
         const REGULARISED_KEY_MASK: u32 = {KEY_MASK}u;\n\
         const CONE_COSINE: f32 = {CONE_COSINE:?};\n\
         const CONE_DENSITY: f32 = {CONE_DENSITY:?};\n\
         const ALPHA_MIN: f32 = {ALPHA_MIN:?};\n",
        AreaLightData::SOLID_ANGLE_MIN,
        features.is_compensated,
        features.discs_coplanar,
        features.area_lights_coplanar,
        features.area_lights_scaled,
        features.has_coat,
        features.has_stripe,
        features.has_dielectric,
        features.has_refracted_nee,
        features.has_metallic_roughness,
        features.has_layers,
        features.has_emission,
        features.has_environment_map(),
        features.area_lights > 0 || features.shares_light_sampling(),
        SphereData::REFRACTED_NEE_STEPS,
        features.has_number,
        features.has_number_disc,
        features.has_wood,
        features.has_csg_cone
    );
    _ = writeln!(text, "const OUTPUT: u32 = {}u;", features.output as u32);
    for output in KernelOutput::ALL {
        _ = writeln!(
            text,
            "const {}: u32 = {}u;",
            output.constant(),
            output as u32
        );
    }
    text += &dispatch_constants(features.workgroup_blocks);
    text += &light_sampling_constants(features);
    text += &sampling_constants();
    text += &kinds();
    let floats = KernelOutput::Aovs.floats();
    _ = writeln!(text, "const AOV_FLOATS: u32 = {floats}u;");
    _ = writeln!(text, "const FIRST_HITS: u32 = {}u;", features.first_hits());
    text += &texture::wgsl();
    text + &primitive_numbers(features)
}

/// Numbers of primitives, area lights last.
fn primitive_numbers(features: &Features) -> String {
    let (mut text, mut first) = (String::new(), 0);
    for shape in features.numbered_shapes() {
        let (name, count) = (shape.constant(), features.count(shape));
        _ = writeln!(
            text,
            "const {name}_FIRST: u32 = {first}u;\nconst {name}_COUNT: u32 = {count}u;"
        );
        first += count;
    }
    let lights = features.area_lights;
    _ = writeln!(text, "const CSG_BOX_COUNT: u32 = {}u;", features.csg_boxes);
    _ = writeln!(
        text,
        "const AREA_LIGHT_FIRST: u32 = {first}u;\nconst AREA_LIGHT_COUNT: u32 = {lights}u;"
    );
    text
}

/// How light sampling is divided among kinds of lights.
fn light_sampling_constants(features: &Features) -> String {
    let punctual = 0.5 * features.punctual_halves as f32;
    // Where there are no others, so that nothing is divided by 0.
    let others = if punctual < 1.0 { 1.0 - punctual } else { 1.0 };
    let emissive = features.emissive_surface_sixteenths as f32 / 16.0;
    let lamps = if emissive < 1.0 { 1.0 - emissive } else { 1.0 };
    let others = others * lamps;
    format!(
        "const SHARES_LIGHT_SAMPLING: bool = {};\n\
         const PUNCTUAL_LIGHT_COUNT: u32 = {}u;\n\
         const PUNCTUAL_SHARE: f32 = {punctual:?};\n\
         const OTHERS_SHARE: f32 = {others:?};\n\
         const LAMP_SHARE: f32 = {lamps:?};\n",
        features.shares_light_sampling(),
        features.punctual_lights
    )
}

/// Pixels of a block, blocks of a workgroup, and places among the counters.
pub(crate) fn dispatch_constants(workgroup_blocks: u32) -> String {
    format!(
        "const BLOCK_EDGE: u32 = {BLOCK_EDGE}u;\n\
         const WORKGROUP_BLOCKS: u32 = {workgroup_blocks}u;\n\
         const COUNTERS_BEFORE_TILES: u32 = {COUNTERS_BEFORE_TILES}u;\n\
         const LISTED_PIXELS: u32 = {LISTED_PIXELS}u;\n"
    )
}

/// Numbers of [`crate::sampling`].
fn sampling_constants() -> String {
    let [a, b, c] = SCRAMBLE;
    format!(
        "const SCRAMBLE: vec3u = vec3u({a}u, {b}u, {c}u);\n\
         const BELOW_1: f32 = {BELOW_1};\n\
         const BLOCK_CAMERA: u32 = {BLOCK_CAMERA}u;\n\
         const BLOCK_LENS: u32 = {BLOCK_LENS}u;\n\
         const ROULETTE_DEPTH: u32 = {ROULETTE_DEPTH}u;\n\
         const SURVIVAL_PER_THROUGHPUT: f32 = {SURVIVAL_PER_THROUGHPUT:?};\n"
    )
}

/// Numbers that stand for kinds.
fn kinds() -> String {
    format!(
        "const PATTERN_NUMBER: u32 = {PATTERN_NUMBER}u;\n\
         const PATTERN_WOOD: u32 = {PATTERN_WOOD}u;\n\
         const PATTERN_PLANKS: u32 = {PATTERN_PLANKS}u;\n\
         const PATTERN_CLOTH: u32 = {PATTERN_CLOTH}u;\n\
         const PATTERN_CUE: u32 = {PATTERN_CUE}u;\n\
         const CSG_FACE_OUTER_BOX: u32 = {CSG_FACE_OUTER_BOX}u;\n\
         const CSG_FACE_PLANE: u32 = {CSG_FACE_PLANE}u;\n\
         const CSG_FACE_CYLINDER: u32 = {CSG_FACE_CYLINDER}u;\n\
         const CSG_FACE_CONE_X: u32 = {CSG_FACE_CONE_X}u;\n\
         const CSG_FACE_CONE_Y: u32 = {CSG_FACE_CONE_Y}u;\n\
         const CSG_FACE_CONE_Z: u32 = {CSG_FACE_CONE_Z}u;\n\
         const CSG_FACE_APEX_CONE: u32 = {CSG_FACE_APEX_CONE}u;\n\
         const KIND_LAYERED: u32 = {KIND_LAYERED}u;\n\
         const KIND_CONDUCTOR: u32 = {KIND_CONDUCTOR}u;\n\
         const KIND_DIELECTRIC: u32 = {KIND_DIELECTRIC}u;\n\
         const KIND_METALLIC_ROUGHNESS: u32 = {KIND_METALLIC_ROUGHNESS}u;\n"
    )
}

/// The scene's arrays as one buffer, in the order of [`crate::gpu::layout::scene_bytes`].
fn scene_declaration(features: &Features) -> String {
    let mut text = String::from("struct SceneData {\n    header: SceneHeader,\n");
    for shape in features.shapes_of_scene() {
        let (field, ty, count) = (shape.array(), shape.type_name(), features.count(shape));
        _ = writeln!(text, "    {field}: array<{ty}, {count}>,");
    }
    if features.csg_boxes > 0 {
        let count = features.csg_boxes;
        _ = writeln!(text, "    csg_boxes: array<CsgBoxData, {count}>,");
    }
    if features.area_lights > 0 {
        _ = writeln!(
            text,
            "    area_lights: array<AreaLightData, {}>,",
            features.area_lights
        );
    }
    if features.punctual_lights > 0 {
        let count = features.punctual_lights;
        _ = writeln!(
            text,
            "    punctual_lights: array<PunctualLightData, {count}>,"
        );
    }
    if features.emissive_shapes() > 0 {
        let count = features.emissive_shapes();
        _ = writeln!(
            text,
            "    emissive_shapes: array<EmissiveSurfaceData, {count}>,"
        );
    }
    _ = writeln!(
        text,
        "    materials: array<MaterialData, {}>,",
        features.materials
    );
    for shape in features.shapes_of_scene() {
        text += &finders_declaration(features, shape);
    }
    let space = match features.memory {
        SceneMemory::Uniform => "uniform",
        SceneMemory::Storage => "storage, read",
    };
    _ = writeln!(
        text,
        "}}\n\
         @group(0) @binding(0) var<{space}> scene: SceneData;\n\
         // The same bytes, for reads whose place differs from thread to thread: constant memory\n\
         // serves those one after the other.\n\
         @group(0) @binding(6) var<storage, read> scene_storage: SceneData;"
    );
    text
}

/// The function that tests the bounds of 32 boxes or CSG boxes, and those of clusters before their own.
fn candidates(features: &Features, shape: ShapeKind) -> String {
    let (name, constant, count) = match shape {
        ShapeKind::Box if !features.has_bvh(shape) => ("box", "BOX", features.boxes),
        ShapeKind::CsgFace => ("csg_box", "CSG_BOX", features.csg_boxes),
        _ => return String::new(),
    };
    let mut text = format!(
        "// Bit i is set if the ray may meet box `first + i` before `t_max`.\n\
         fn {name}_candidates(prepared: PreparedRay, first: u32, t_max: f32) -> u32 {{\n    \
         var candidates = 0u;\n    \
         if (prepared.block != NO_BLOCK) {{\n        \
         var left = listed(prepared.block, {constant}_WORD + first / 32u);\n        \
         while (left != 0u) {{\n            \
         let i = firstTrailingBit(left);\n            \
         left &= left - 1u;\n            \
         let may_meet = may_meet_box(prepared, scene.{name}_bounds[first + i], t_max);\n            \
         candidates |= select(0u, 1u << i, may_meet);\n        }}\n        \
         return candidates;\n    }}\n"
    );
    let each = |from: &str, to: &str| {
        format!(
            "    for (var i = {from}; i < {to}; i++) {{\n        \
             let may_meet = may_meet_box(prepared, scene.{name}_bounds[first + i], t_max);\n        \
             candidates |= select(0u, 1u << i, may_meet);\n    }}\n"
        )
    };
    let clusters = features.clusters(shape);
    let mut next = 0;
    for (index, range) in clusters.ranges().enumerate() {
        let bound = count as usize + index;
        text += &each(&format!("{next}u"), &format!("{}u", range.start));
        _ = writeln!(
            text,
            "    if (may_meet_box(prepared, scene.{name}_bounds[{bound}], t_max)) {{"
        );
        text += &each(&format!("{}u", range.start), &format!("{}u", range.end));
        text += "    }\n";
        next = range.end;
    }
    text += &each(&format!("{next}u"), &format!("min({count}u - first, 32u)"));
    text + "    return candidates;\n}\n"
}

/// What rays find the primitives of a shape by.
fn finders_declaration(features: &Features, shape: ShapeKind) -> String {
    let (name, count) = (shape.function(), features.count(shape));
    if features.has_bvh(shape) {
        let leaves = bvh::leaves(count as usize);
        let nodes = leaves - 1;
        let leaf = shape.leaf();
        return format!(
            "    {name}_nodes: array<BvhNodeData, {nodes}>,\n    \
             {name}_leaves: array<{leaf}, {leaves}>,\n"
        );
    }
    let clusters = features.clusters(shape).len() as u32;
    if shape == ShapeKind::CsgFace {
        let count = features.csg_boxes + clusters;
        return format!("    csg_box_bounds: array<BoxBound, {count}>,\n");
    }
    let (bound, count) = (shape.bound(), count + clusters);
    bound.map_or_else(String::new, |bound| {
        format!("    {name}_bounds: array<{bound}, {count}>,\n")
    })
}

/// The triangles of the scene, in the order of [`crate::gpu::layout::mesh_bytes`]; nothing without any.
fn mesh_declaration(features: &Features) -> String {
    let (triangles, normals) = (features.triangles, features.smooth_triangles);
    if triangles == 0 {
        return String::new();
    }
    let mut text = format!(
        "const FLAT: u32 = {}u;\n\
         const COLORED_TRIANGLE_COUNT: u32 = {}u;\n\
         const OPACITY_OPAQUE: f32 = {OPACITY_OPAQUE:?};\n\
         const OPACITY_MASK: f32 = {OPACITY_MASK:?};\n\
         const POINT_ROUNDING: f32 = {POINT_ROUNDING:e};\n\
         const REFLECTION_SINE_MIN: f32 = {REFLECTION_SINE_MIN:e};\n\
         const HAS_DIELECTRIC_MESH: bool = {};\n\
         struct MeshData {{\n    triangles: array<TriangleData, {triangles}>,\n",
        TriangleData::FLAT,
        features.colored_triangles,
        features.has_dielectric_mesh
    );
    if normals > 0 {
        _ = writeln!(text, "    normals: array<TriangleNormals, {normals}>,");
    }
    if features.uv_triangles > 0 {
        let count = features.uv_triangles;
        _ = writeln!(text, "    uvs: array<TriangleUvs, {count}>,");
    }
    if features.colored_triangles > 0 {
        let count = features.colored_triangles;
        _ = writeln!(text, "    colors: array<TriangleColors, {count}>,");
    }
    if features.emissive_triangles() > 0 {
        let count = features.emissive_triangles();
        _ = writeln!(text, "    lights: array<EmissiveSurfaceData, {count}>,");
    }
    text += &finders_declaration(features, ShapeKind::Triangle);
    text + "}\n@group(0) @binding("
        + &MESH_BINDING.to_string()
        + ") var<storage, read> mesh: MeshData;\n"
}

/// The image textures of the scene, as [`crate::gpu::image_buffers`] lays them out; nothing without any.
fn texture_declaration(features: &Features) -> String {
    let Features {
        textures,
        textured_materials,
        ..
    } = features;
    if *textures == 0 {
        return String::new();
    }
    let layers = match features.has_layer_textures() {
        true => format!("    layers: array<LayerTextureData, {textured_materials}>,\n"),
        false => String::new(),
    };
    let transmission = match features.has_transmission_textures {
        true => format!("    transmission: array<u32, {textured_materials}>,\n"),
        false => String::new(),
    };
    let text = format!(
        "const NO_TEXTURE: u32 = {}u;\n\
         const WRAP_REPEAT: u32 = {WRAP_REPEAT}u;\n\
         const WRAP_CLAMP: u32 = {WRAP_CLAMP}u;\n\
         struct TextureMemory {{\n    \
         images: array<TextureData, {textures}>,\n    \
         materials: array<MaterialTextureData, {textured_materials}>,\n\
         {layers}{transmission}    srgb: array<f32, 256>,\n    \
         texels: array<u32>,\n}}\n\
         @group(0) @binding({TEXTURE_BINDING}) var<storage, read> textures: TextureMemory;\n",
        MaterialTextureData::NONE
    );
    match features.has_layer_textures() {
        true => text + &layer_texture_constants(features),
        false => text,
    }
}

/// Numbers that textures of layers need.
fn layer_texture_constants(features: &Features) -> String {
    let last = SHEEN_REFLECTANCES.len() - 1;
    let halves = SHEEN_REFLECTANCES.as_flattened().chunks(3);
    let halves = halves.map(|half| format!("vec3f({:?}, {:?}, {:?})", half[0], half[1], half[2]));
    let halves: Vec<String> = halves.collect();
    format!(
        "const TEXTURE_ALPHA: u32 = {}u;\n\
         const HAS_LAYER_FACTORS: bool = {};\n\
         const HAS_COAT_NORMALS: bool = {};\n\
         const SHEEN_WIDTH_MIN: f32 = {:?};\n\
         const SHEEN_ROOT_MIN: f32 = {SHEEN_ROOT_MIN:?};\n\
         const SHEEN_ROWS_PER_ROOT: f32 = {:?};\n\
         const SHEEN_ROW_LAST: u32 = {last}u;\n\
         const SHEEN_REFLECTANCES = array<vec3f, {}>({});\n",
        TextureData::ALPHA,
        features.has_layer_factors,
        features.has_coat_normals,
        SHEEN_ROUGHNESS.start(),
        last as f32 / (1.0 - SHEEN_ROOT_MIN),
        halves.len(),
        halves.join(", ")
    )
}

/// The environment map, as [`crate::gpu::image_buffers`] lays it out; nothing without.
fn environment_declaration(features: &Features) -> String {
    if !features.has_environment_map() {
        return String::new();
    }
    let [width, height] = features.environment_map;
    format!(
        "const ENVIRONMENT_WIDTH: u32 = {width}u;\n\
         const ENVIRONMENT_HEIGHT: u32 = {height}u;\n\
         struct EnvironmentMemory {{\n    \
         turn: f32,\n    \
         probability: f32,\n    \
         numbers: array<f32>,\n}}\n\
         @group(0) @binding({ENVIRONMENT_BINDING}) var<storage, read> environment_map: EnvironmentMemory;\n"
    )
}

/// A part of a kernel with functions of other parts around its own: those of `shading_normal.wgsl`, and within those of
/// `metallic_roughness.wgsl`, of `punctual_light.wgsl` and of `environment_map.wgsl`; those of `layers.wgsl`, of
/// `opacity.wgsl` and of `vertex_color.wgsl`; and around those of all lights those of `emissive_surface.wgsl`.
fn with_wrappers(features: &Features, part: &str) -> String {
    let mut text = part.to_owned();
    if features.has_thin_walls {
        text = with_thin_walls(features, part, text);
    }
    if features.has_layers && part == METALLIC_ROUGHNESS {
        for name in ["metallic_roughness_at", "mean_passed", "reflected_share"] {
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
            "first_hit",
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

/// A part of a kernel with the functions of each kind of lights around those of the others.
fn with_lights(features: &Features, part: &str, mut text: String) -> String {
    // The innermost first.
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

/// A part of a kernel where some surfaces are thin walls: functions of `thin_wall.wgsl` and `transmission_texture.wgsl` are round
/// those of other parts.
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

/// A part of a kernel where clear coats have normals of their own: light falls in at the cosine to either.
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

/// A part of a kernel where light falls in at other cosines than those to the normal of the surface.
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

/// The nearest surface along a ray, and whether anything is in the way of one to an area light.
fn traverse(features: &Features) -> String {
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

fn surface_at(features: &Features) -> String {
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
            if (HAS_WOOD) { surface.albedo = textured(surface); }\n    \
            return surface;\n}\n"
}

/// The table of surfaces that emit, a point on one, and what of it a solid angle is seen of; nothing where light sampling aims at
/// none.
fn emissive_surface_functions(features: &Features) -> String {
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

/// The size of the table of surfaces that emit, how often light sampling aims at them, and [`ShapeKind::area_factor`].
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

/// The material of a solid.
fn material_of(features: &Features) -> String {
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

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use glam::Vec3;
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;
    use crate::bvh::Bounds;
    use crate::compiled::clusters::Clusters;
    use crate::compiled::{
        AreaLightData, BoxData, CameraFrame, CsgBoxData, CsgFaceData, DiscData,
        EmissiveSurfaceData, LayerTextureData, MaterialData, PunctualLightData, RectangleData,
        SphereData, TextureData, TriangleColors, TriangleNormals, TriangleUvs,
    };
    use crate::gpu::layout::{
        BoxBound, BvhNodeData, DispatchData, SceneHeader, SphereBound, SphereLeaf, TileEntry,
        mesh_bytes_len, scene_bytes_len,
    };

    const ALL: Features = Features {
        spheres: 16,
        boxes: 6,
        discs: 6,
        rectangles: 8,
        csg_faces: 9,
        csg_boxes: 2,
        area_lights: 3,
        materials: 20,
        triangles: 12,
        smooth_triangles: 7,
        has_dielectric_mesh: true,
        environment_map: [16, 8],
        punctual_lights: 2,
        punctual_halves: 1,
        uv_triangles: 5,
        textures: 3,
        textured_materials: 18,
        has_layer_factors: true,
        has_coat_normals: true,
        colored_triangles: 4,
        has_opacity: true,
        has_layers: true,
        has_thin_walls: true,
        has_transmission_textures: true,
        emissive_surfaces: [2, 0, 1, 3, 0, 3],
        emissive_surface_sixteenths: 7,
        has_emission: true,
        bvhs: [true, false, true, true, false, true],
        has_coat: true,
        has_stripe: true,
        has_number: true,
        has_number_disc: true,
        box_clusters: Clusters::NONE,
        csg_clusters: Clusters::NONE,
        has_csg_cone: true,
        has_wood: true,
        has_sheen: true,
        has_microfacet: true,
        has_dielectric: true,
        has_metallic_roughness: true,
        has_refracted_nee: true,
        output: KernelOutput::Radiance,
        is_compensated: true,
        discs_coplanar: true,
        area_lights_coplanar: true,
        area_lights_occlude: true,
        area_lights_scaled: true,
        memory: SceneMemory::Uniform,
        workgroup_blocks: 16,
    };

    /// Of shapes that [`variants`] has some of.
    fn emissive_surfaces(i: u32) -> [u32; 6] {
        match i % 5 > 2 {
            true => [
                i & i >> 4 & 1,
                0,
                i >> 2 & i >> 5 & 1,
                i >> 3 & i & 1,
                0,
                match i % 4 < 2 {
                    true => i % 3,
                    false => 0,
                },
            ],
            false => [0; 6],
        }
    }

    /// Every choice of parts; constants alternate.
    fn variants() -> impl Iterator<Item = Features> {
        (0..16 * 3 * 2 * 2_u32).map(|i| {
            let count = |bit: u32, count: u32| count * (i >> bit & 1);
            let is_textured = i % 4 < 2 && i % 5 == 3;
            let textured = |count: u32| if is_textured { count } else { 0 };
            Features {
                spheres: count(0, 3 + 7 * (i % 5)),
                bvhs: [
                    i & 1 == 1 && i % 5 > 0,
                    i >> 1 & 1 == 1 && i % 3 > 1,
                    i >> 2 & 1 == 1 && i % 7 > 3,
                    i >> 3 & 1 == 1 && i % 11 > 5,
                    false,
                    i % 4 < 2 && i % 9 > 3,
                ],
                boxes: count(1, 1 + 7 * (i % 3)),
                discs: count(2, 2 + 3 * (i % 7)),
                rectangles: count(3, 1 + i % 11),
                csg_faces: 5 * (i / 2 % 2),
                csg_boxes: i / 2 % 2,
                triangles: if i % 4 < 2 { 5 + i % 7 } else { 0 },
                smooth_triangles: if i % 4 < 2 { i % 3 } else { 0 },
                has_dielectric_mesh: i % 4 < 2 && i % 7 < 2,
                uv_triangles: textured(1 + i % 2),
                textures: textured(1 + i % 4),
                textured_materials: textured(1 + i % 5),
                has_layer_factors: is_textured && i % 3 < 2,
                // A clear coat is a layer.
                has_coat_normals: is_textured && i % 13 > 5 && i % 7 > 2,
                colored_triangles: if i % 4 < 2 { i / 4 % 3 } else { 0 },
                has_opacity: i % 4 < 2 && i % 5 > 2 && i % 7 > 1,
                has_layers: i % 5 > 2 && i % 13 > 5,
                has_thin_walls: i % 5 > 2 && i % 3 < 2,
                has_transmission_textures: is_textured && i % 3 < 1,
                emissive_surfaces: emissive_surfaces(i),
                emissive_surface_sixteenths: match (emissive_surfaces(i).iter().sum(), i % 7) {
                    (0, _) => 0,
                    (1.., part) => 16 - part,
                },
                has_emission: i % 5 > 2 && (i % 3 > 0 || i % 2 == 1),
                has_coat: i >> 4 & 1 == 1,
                memory: [SceneMemory::Uniform, SceneMemory::Storage][(i >> 5 & 1) as usize],
                area_lights: i >> 6,
                materials: 1 + i % 5,
                has_stripe: i % 3 == 0,
                has_number: i % 11 < 6,
                has_number_disc: i % 11 < 3,
                box_clusters: Clusters::NONE,
                csg_clusters: Clusters::NONE,
                has_csg_cone: i % 7 < 3,
                has_wood: i % 13 < 7,
                has_sheen: i % 17 < 8,
                has_microfacet: i % 7 < 4,
                environment_map: [i % 3 * 4, i % 3 * 2],
                punctual_lights: i / 3 % 3,
                punctual_halves: match (i / 3 % 3, i >> 6, i % 3) {
                    (0, ..) => 0,
                    (_, 0, 0) => 2,
                    _ => 1,
                },
                has_dielectric: i % 7 < 2,
                has_metallic_roughness: i % 5 > 2,
                has_refracted_nee: i & 1 == 1 && i >> 6 > 0 && i % 7 == 1,
                output: KernelOutput::ALL[i as usize % 3],
                is_compensated: i % 5 < 2,
                discs_coplanar: i % 11 < 5,
                area_lights_coplanar: i % 13 < 6,
                area_lights_occlude: i >> 6 > 1 && i % 3 == 1,
                area_lights_scaled: i % 19 < 9,
                workgroup_blocks: [1, 4, 16][i as usize % 3],
            }
        })
    }

    fn validated(features: &Features) -> naga::Module {
        let text = source(features);
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{features:?}: {}", error.emit_to_string(&text)));
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        if let Err(error) = validator.validate(&module) {
            panic!("{features:?}: {}", error.emit_to_string(&text));
        }
        module
    }

    fn structure<'a>(module: &'a naga::Module, name: &str) -> (&'a [naga::StructMember], u32) {
        let mut types = module.types.iter().map(|(_, ty)| ty);
        let ty = types.find(|ty| ty.name.as_deref() == Some(name));
        match ty.map(|ty| &ty.inner) {
            Some(naga::TypeInner::Struct { members, span }) => (members, *span),
            other => panic!("{name} is {other:?} in the kernel"),
        }
    }

    /// With clusters of boxes and of CSG boxes.
    fn clustered() -> Features {
        let far = |x: u8| Bounds {
            min: Vec3::new(50.0, f32::from(x), 0.0),
            max: Vec3::new(51.0, f32::from(x) + 1.0, 1.0),
        };
        let boxes: Vec<_> = (0..9).map(far).collect();
        let clusters = Clusters::new(&boxes, Vec3::ZERO);
        assert_eq!(clusters.len(), 1);
        Features {
            boxes: 9,
            box_clusters: clusters,
            csg_boxes: 9,
            csg_clusters: clusters,
            ..ALL
        }
    }

    #[test]
    fn kernels_are_valid_and_scenes_have_their_size() {
        for features in variants().chain([clustered()]) {
            let module = validated(&features);
            let (_, span) = structure(&module, "SceneData");
            assert_eq!(u64::from(span), scene_bytes_len(&features), "{features:?}");
            if features.triangles > 0 {
                let (_, span) = structure(&module, "MeshData");
                assert_eq!(u64::from(span), mesh_bytes_len(&features), "{features:?}");
            }
        }
    }

    #[test]
    fn kernels_of_scenes_without_meshes_have_nothing_of_them() {
        for features in variants().filter(|features| features.triangles == 0) {
            let text = source(&features).to_lowercase();
            for word in [
                "triangle",
                "mesh",
                "geometric_normal",
                "image_texture",
                "texel",
            ] {
                assert!(!text.contains(word), "{word}: {features:?}");
            }
        }
    }

    #[test]
    fn kernels_of_scenes_without_thin_walls_have_nothing_of_them() {
        for features in variants().filter(|features| !features.has_thin_walls) {
            let text = source(&features);
            for word in ["thin wall", "thin_wall", "lets_light_pass", "transmission"] {
                assert!(!text.contains(word), "{word}: {features:?}");
            }
        }
    }

    type Layout = (&'static str, usize, Vec<(&'static str, usize)>);

    /// A struct's name, size, and the offset of each field that is not padding.
    macro_rules! layout {
        ($ty:ident, $($field:ident)*) => {
            (
                stringify!($ty),
                size_of::<$ty>(),
                vec![$((stringify!($field), offset_of!($ty, $field))),*],
            )
        };
    }

    #[rustfmt::skip]
    fn layouts_in_rust() -> [Layout; 25] {
        [
            layout!(SphereData, center radius stripe_axis material number_axis allows_refracted_nee),
            layout!(BoxData, min material max),
            layout!(CsgBoxData, min first_face max face_count),
            layout!(CsgFaceData, a kind b material),
            layout!(DiscData, center radius normal material),
            layout!(RectangleData, center material half_u inv_u2 half_v inv_v2 normal),
            layout!(TriangleData, a material b normals c uvs),
            layout!(TriangleNormals, a b c),
            layout!(TriangleUvs, a b c density),
            layout!(TriangleColors, a b c padding),
            layout!(EmissiveSurfaceData, index before probability shape),
            layout!(TextureData, first width height levels is_srgb wrap_u wrap_v),
            layout!(MaterialTextureData,
                base_color metallic_roughness normal emission clearcoat clearcoat_roughness
                normal_scale),
            layout!(LayerTextureData,
                sheen sheen_roughness specular specular_color clearcoat_normal
                clearcoat_normal_scale has_coat_normal),
            layout!(AreaLightData,
                center brightness axis_u length_u axis_v length_v normal radiance),
            layout!(PunctualLightData,
                center is_distant direction cone_scale strength cone_offset),
            layout!(MaterialData,
                albedo ior stripe_albedo stripe_half_width diffuse_scale kind alpha majorant
                eta pattern k number extinction grain_axis scattering sheen_roughness sheen
                metallic sights scale),
            layout!(SphereBound, center power),
            layout!(BvhNodeData,
                left_center left left_half right right_center right_half),
            layout!(SphereLeaf, balls indices),
            layout!(BoxBound, center half),
            layout!(CameraFrame, eye lens_steps corner lens_film dx dy),
            layout!(SceneHeader, camera environment zero),
            layout!(DispatchData,
                tile_count block_count sample_begin sample_end samples first_half pixels
                first_sample seed max_depth is_list),
            layout!(TileEntry, x y width height first_block first_pixel),
        ]
    }

    #[test]
    fn structs_lie_in_the_kernel_as_in_rust() {
        let module = validated(&ALL);
        for (name, size, fields) in layouts_in_rust() {
            let (members, span) = structure(&module, name);
            assert_eq!(span as usize, size, "{name}");
            let reflected: Vec<_> = members
                .iter()
                .map(|member| (member.name.as_deref().unwrap(), member.offset as usize))
                .collect();
            assert_eq!(reflected, fields, "{name}");
        }
    }
}
