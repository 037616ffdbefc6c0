//! WGSL constants of a kernel, whose values are defined in Rust.

use std::fmt::Write as _;

use crate::bvh::{DEPTH_MAX, LEAF, SLACK};
use crate::compiled::{
    AreaLightData, CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z,
    CSG_FACE_CYLINDER, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, KIND_CONDUCTOR, KIND_DIELECTRIC,
    KIND_LAYERED, KIND_METALLIC_ROUGHNESS, PATTERN_BRICKS, PATTERN_CLOTH, PATTERN_CUE,
    PATTERN_NUMBER, PATTERN_PLANKS, PATTERN_PRINT, PATTERN_SCOREBOARD, PATTERN_WOOD, SphereData,
};
use crate::gpu::features::{Features, KernelOutput};
use crate::gpu::layout::{BVH_LEAF, COUNTERS_BEFORE_TILES, LISTED_PIXELS, SPHERE_SLACK};
use crate::gpu::shader::BLOCK_EDGE;
use crate::regularisation::{ALPHA_MIN, CONE_COSINE, CONE_DENSITY, KEY_MASK};
use crate::sampling::{
    BELOW_1, BLOCK_CAMERA, BLOCK_LENS, COAT_BLOCKS, ROULETTE_DEPTH, SCRAMBLE,
    SURVIVAL_PER_THROUGHPUT,
};
use crate::scalar::metallic_roughness::{ALPHA_LEAST, CLEARCOAT_F0};
use crate::scene::validate::CSG_MARGIN_M;
use crate::texture;

/// All constants of a kernel as WGSL.
pub(super) fn constants(features: &Features) -> String {
    let mut text = String::new();
    for (name, is_set) in [
        ("COMPENSATED", features.is_compensated),
        ("DISCS_COPLANAR", features.discs_coplanar),
        ("AREA_LIGHTS_COPLANAR", features.area_lights_coplanar),
        ("AREA_LIGHTS_GRADED", features.area_lights_graded),
        ("AREA_LIGHTS_SCALED", features.area_lights_scaled),
        ("HAS_COAT", features.has_coat),
        ("HAS_STRIPE", features.has_stripe),
        ("HAS_DIELECTRIC", features.has_dielectric),
        ("HAS_REFRACTED_NEE", features.has_refracted_nee),
        ("HAS_METALLIC_ROUGHNESS", features.has_metallic_roughness),
        ("HAS_LAYERS", features.has_layers),
        ("HAS_EMISSION", features.has_emission),
        ("HAS_ENVIRONMENT_MAP", features.has_environment_map()),
        (
            "SAMPLES_LIGHT",
            features.area_lights > 0 || features.shares_light_sampling(),
        ),
        ("HAS_NUMBER", features.has_number),
        ("HAS_NUMBER_DISC", features.has_number_disc),
        ("HAS_WOOD", features.has_wood),
        ("HAS_CSG_CONE", features.has_csg_cone),
    ] {
        _ = writeln!(text, "const {name}: bool = {is_set};");
    }
    _ = writeln!(text, "const OUTPUT: u32 = {}u;", features.output as u32);
    for output in KernelOutput::ALL {
        _ = writeln!(
            text,
            "const {}: u32 = {}u;",
            output.constant(),
            output as u32
        );
    }
    text += &numbers();
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

/// Constants of traversal and shading.
fn numbers() -> String {
    format!(
        "const SOLID_ANGLE_MIN: f32 = {};\n\
         const REFRACTED_NEE_STEPS: u32 = {}u;\n\
         const SPHERE_SLACK: f32 = {SPHERE_SLACK:e};\n\
         const BVH_DEPTH_MAX: u32 = {DEPTH_MAX}u;\n\
         const BVH_LEAF: u32 = {BVH_LEAF}u;\n\
         const LEAF: u32 = {LEAF}u;\n\
         const BVH_SLACK: f32 = {SLACK:e};\n\
         const ALPHA_LEAST: f32 = {ALPHA_LEAST:?};\n\
         const CLEARCOAT_F0: f32 = {CLEARCOAT_F0:?};\n\
         const CSG_MARGIN_M: f32 = {CSG_MARGIN_M:?};\n\
         const REGULARISED_KEY_MASK: u32 = {KEY_MASK}u;\n\
         const CONE_COSINE: f32 = {CONE_COSINE:?};\n\
         const CONE_DENSITY: f32 = {CONE_DENSITY:?};\n\
         const ALPHA_MIN: f32 = {ALPHA_MIN:?};\n",
        AreaLightData::SOLID_ANGLE_MIN,
        SphereData::REFRACTED_NEE_STEPS
    )
}

/// First number and count of the primitives of each shape; area lights come last.
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

/// Probabilities with which light sampling selects each kind of light.
fn light_sampling_constants(features: &Features) -> String {
    let punctual = 0.5 * features.punctual_halves as f32;
    // Without lights of other kinds any positive value will do; 1 avoids a division by 0.
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

/// Pixels along a block's edge, blocks per workgroup, and indices of counters.
pub(crate) fn dispatch_constants(workgroup_blocks: u32) -> String {
    format!(
        "const BLOCK_EDGE: u32 = {BLOCK_EDGE}u;\n\
         const WORKGROUP_BLOCKS: u32 = {workgroup_blocks}u;\n\
         const COUNTERS_BEFORE_TILES: u32 = {COUNTERS_BEFORE_TILES}u;\n\
         const LISTED_PIXELS: u32 = {LISTED_PIXELS}u;\n"
    )
}

/// Constants of [`crate::sampling`].
fn sampling_constants() -> String {
    let [a, b, c] = SCRAMBLE;
    format!(
        "const SCRAMBLE: vec3u = vec3u({a}u, {b}u, {c}u);\n\
         const BELOW_1: f32 = {BELOW_1};\n\
         const BLOCK_CAMERA: u32 = {BLOCK_CAMERA}u;\n\
         const BLOCK_LENS: u32 = {BLOCK_LENS}u;\n\
         const COAT_BLOCKS: u32 = {COAT_BLOCKS}u;\n\
         const ROULETTE_DEPTH: u32 = {ROULETTE_DEPTH}u;\n\
         const SURVIVAL_PER_THROUGHPUT: f32 = {SURVIVAL_PER_THROUGHPUT:?};\n"
    )
}

/// Values of enumerations: patterns, CSG faces and kinds of materials.
fn kinds() -> String {
    format!(
        "const PATTERN_NUMBER: u32 = {PATTERN_NUMBER}u;\n\
         const PATTERN_WOOD: u32 = {PATTERN_WOOD}u;\n\
         const PATTERN_PLANKS: u32 = {PATTERN_PLANKS}u;\n\
         const PATTERN_CLOTH: u32 = {PATTERN_CLOTH}u;\n\
         const PATTERN_CUE: u32 = {PATTERN_CUE}u;\n\
         const PATTERN_BRICKS: u32 = {PATTERN_BRICKS}u;\n\
         const PATTERN_SCOREBOARD: u32 = {PATTERN_SCOREBOARD}u;\n\
         const PATTERN_PRINT: u32 = {PATTERN_PRINT}u;\n\
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
