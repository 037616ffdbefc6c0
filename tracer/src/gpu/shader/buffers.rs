//! WGSL declarations of the buffers that a kernel reads: the scene, its triangles, image textures
//! and environment map.

use std::fmt::Write as _;

use crate::compiled::{
    MaterialTextureData, OPACITY_MASK, OPACITY_OPAQUE, ShapeKind, TextureData, TriangleData,
    WRAP_CLAMP, WRAP_REPEAT,
};
use crate::gpu::features::{Features, SceneMemory};
use crate::gpu::layout::{
    ArrayLayout, ENVIRONMENT_BINDING, MESH_BINDING, TEXTURE_BINDING, mesh_arrays, scene_arrays,
};
use crate::scalar::triangle::{POINT_ROUNDING, REFLECTION_SINE_MIN};
use crate::scene::validate::SHEEN_ROUGHNESS;
use crate::sheen::{SHEEN_REFLECTANCES, SHEEN_ROOT_MIN};

/// Declaration of the scene's arrays as one buffer, in the order of
/// [`crate::gpu::layout::scene_bytes`].
pub(super) fn scene_declaration(features: &Features) -> String {
    let arrays = declarations(&scene_arrays(features));
    let space = match features.memory {
        SceneMemory::Uniform => "uniform",
        SceneMemory::Storage => "storage, read",
    };
    format!(
        "struct SceneData {{\n    header: SceneHeader,\n{arrays}}}\n\
         @group(0) @binding(0) var<{space}> scene: SceneData;\n\
         // The same bytes, for reads whose place differs from thread to thread: constant memory\n\
         // serves those one after the other.\n\
         @group(0) @binding(6) var<storage, read> scene_storage: SceneData;\n"
    )
}

fn declarations(arrays: &[ArrayLayout]) -> String {
    let mut text = String::new();
    for array in arrays {
        let (name, element, count) = (&array.name, array.element, array.count);
        _ = writeln!(text, "    {name}: array<{element}, {count}>,");
    }
    text
}

/// Declaration of the scene's triangles, in the order of [`crate::gpu::layout::mesh_bytes`]; empty
/// without any.
pub(super) fn mesh_declaration(features: &Features) -> String {
    if features.count(ShapeKind::Triangle) == 0 {
        return String::new();
    }
    format!(
        "const FLAT: u32 = {}u;\n\
         const COLORED_TRIANGLE_COUNT: u32 = {}u;\n\
         const OPACITY_OPAQUE: f32 = {OPACITY_OPAQUE:?};\n\
         const OPACITY_MASK: f32 = {OPACITY_MASK:?};\n\
         const POINT_ROUNDING: f32 = {POINT_ROUNDING:e};\n\
         const REFLECTION_SINE_MIN: f32 = {REFLECTION_SINE_MIN:e};\n\
         const HAS_DIELECTRIC_MESH: bool = {};\n\
         struct MeshData {{\n{}}}\n\
         @group(0) @binding({MESH_BINDING}) var<storage, read> mesh: MeshData;\n",
        TriangleData::FLAT,
        features.colored_triangles,
        features.has_dielectric_mesh,
        declarations(&mesh_arrays(features))
    )
}

/// Declaration of the scene's image textures, in the layout of [`crate::gpu::image_buffers`]; empty
/// without any.
pub(super) fn texture_declaration(features: &Features) -> String {
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

/// Constants for textures of layers: sheen, specular reflection and the clear coat's normal.
fn layer_texture_constants(features: &Features) -> String {
    let last = SHEEN_REFLECTANCES.len() - 1;
    // Each row of six reflectances as two `vec3f`.
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

/// Declaration of the environment map, in the layout of [`crate::gpu::image_buffers`]; empty
/// without one.
pub(super) fn environment_declaration(features: &Features) -> String {
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
