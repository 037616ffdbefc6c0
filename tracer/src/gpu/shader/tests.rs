//! Tests of kernels' source: it is valid, its structs have the layout of those in Rust, and it
//! contains nothing that a scene does not need.

use std::mem::offset_of;

use glam::Vec3;
use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::*;
use crate::bvh::Bounds;
use crate::compiled::clusters::Clusters;
use crate::compiled::{
    AreaLightData, BoxData, CameraFrame, CsgBoxData, CsgFaceData, DiscData, EmissiveSurfaceData,
    LayerTextureData, MaterialData, MaterialTextureData, PunctualLightData, RectangleData,
    ShapeKind, SphereData, TextureData, TriangleColors, TriangleData, TriangleNormals, TriangleUvs,
};
use crate::gpu::features::{KernelOutput, SceneMemory};
use crate::gpu::layout::{
    BoxBound, BvhNodeData, DispatchData, SceneHeader, SphereBound, SphereLeaf, TileEntry,
    mesh_bytes_len, scene_bytes_len,
};

const ALL: Features = Features {
    counts: [16, 6, 6, 8, 9, 12],
    csg_boxes: 2,
    area_lights: 3,
    materials: 20,
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
    has_rough_coat: true,
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
    area_lights_graded: true,
    area_lights_occlude: true,
    area_lights_scaled: true,
    memory: SceneMemory::Uniform,
    workgroup_blocks: 16,
};

/// Counts of emissive surfaces, for shapes of which [`variants`] has some.
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

/// Counts of primitives in the `i`th variant.
fn counts(i: u32) -> [u32; 6] {
    let count = |bit: u32, count: u32| count * (i >> bit & 1);
    [
        count(0, 3 + 7 * (i % 5)),
        count(1, 1 + 7 * (i % 3)),
        count(2, 2 + 3 * (i % 7)),
        count(3, 1 + i % 11),
        5 * (i / 2 % 2),
        if i % 4 < 2 { 5 + i % 7 } else { 0 },
    ]
}

/// All combinations of parts; other features alternate.
fn variants() -> impl Iterator<Item = Features> {
    (0..16 * 3 * 2 * 2_u32).map(|i| {
        let is_textured = i % 4 < 2 && i % 5 == 3;
        let textured = |count: u32| if is_textured { count } else { 0 };
        Features {
            counts: counts(i),
            bvhs: [
                i & 1 == 1 && i % 5 > 0,
                i >> 1 & 1 == 1 && i % 3 > 1,
                i >> 2 & 1 == 1 && i % 7 > 3,
                i >> 3 & 1 == 1 && i % 11 > 5,
                false,
                i % 4 < 2 && i % 9 > 3,
            ],
            csg_boxes: i / 2 % 2,
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
            has_rough_coat: i >> 4 & 1 == 1 && i % 3 > 0,
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
            area_lights_graded: i % 3 > 1,
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

/// Features with clusters of boxes and of CSG boxes.
fn clustered() -> Features {
    let far = |x: u8| Bounds {
        min: Vec3::new(50.0, f32::from(x), 0.0),
        max: Vec3::new(51.0, f32::from(x) + 1.0, 1.0),
    };
    let boxes: Vec<_> = (0..45).map(far).collect();
    let clusters = Clusters::new(&boxes, Vec3::ZERO);
    assert_eq!(clusters.len(), 2);
    Features {
        counts: [16, 45, 6, 8, 9, 12],
        box_clusters: clusters,
        csg_boxes: 45,
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
        if features.count(ShapeKind::Triangle) > 0 {
            let (_, span) = structure(&module, "MeshData");
            assert_eq!(u64::from(span), mesh_bytes_len(&features), "{features:?}");
        }
    }
}

#[test]
fn kernels_of_scenes_without_meshes_have_nothing_of_them() {
    for features in variants().filter(|features| features.count(ShapeKind::Triangle) == 0) {
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
            center brightness axis_u length_u axis_v length_v normal radiance gradient slope),
        layout!(PunctualLightData,
            center is_distant direction cone_scale strength cone_offset),
        layout!(MaterialData,
            albedo ior stripe_albedo stripe_half_width diffuse_scale kind alpha sampling_density
            eta pattern k number extinction grain_axis scattering sheen_roughness sheen
            metallic sights scale),
        layout!(SphereBound, center power),
        layout!(BvhNodeData,
            left_center left left_half right right_center right_half),
        layout!(SphereLeaf, balls indices),
        layout!(BoxBound, center half),
        layout!(CameraFrame, eye lens_steps corner lens_film dx near_m dy),
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
