//! The bytes that a kernel reads: what [`crate::compiled`] holds, one array behind another.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};
use glam::Vec3;

use crate::bvh::Bounds;
use crate::bvh::{BvhNode, LEAF, leaves};
use crate::compiled::all_bounds;
use crate::compiled::clusters::Clusters;
use crate::compiled::{
    AreaLightData, BoxData, CameraFrame, CompiledScene, CsgBoxData, CsgFaceData, DiscData,
    EmissiveSurfaceData, MaterialData, PunctualLightData, RectangleData, ShapeKind, SphereData,
    TriangleColors, TriangleData, TriangleNormals, TriangleUvs,
};
use crate::gpu::coplanar;
use crate::gpu::features::{self, Features, SceneMemory};
use crate::{Error, ImageSize, SceneError};

/// What stands before the scene's arrays.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SceneHeader {
    pub(crate) camera: CameraFrame,
    pub(crate) environment: [f32; 3],
    /// 0, which the shader's compiler cannot know.
    pub(crate) zero: u32,
}

/// What one dispatch does: samples `sample_begin..sample_end` of `samples` in blocks of pixels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct DispatchData {
    pub(crate) tile_count: u32,
    pub(crate) block_count: u32,
    pub(crate) sample_begin: u32,
    pub(crate) sample_end: u32,
    pub(crate) samples: u32,
    pub(crate) first_half: u32,
    pub(crate) pixels: u32,
    pub(crate) first_sample: u32,
    pub(crate) seed: u32,
    pub(crate) max_depth: u32,
    /// Whether the tiles are single pixels, as many as [`LISTED_PIXELS`] says.
    pub(crate) is_list: u32,
}

/// Words of the counters before those of the tiles: rays, low and high, and the length of the list of edges.
pub(crate) const COUNTERS_BEFORE_TILES: u64 = 3;
/// Which of them is that length.
pub(crate) const LISTED_PIXELS: u64 = 2;

/// A tile, and how many blocks and pixels come before it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct TileEntry {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) first_block: u32,
    pub(crate) first_pixel: u32,
}

/// A ball for the test of whether a ray may meet it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SphereBound {
    pub(crate) center: [f32; 3],
    /// `(1 − SLACK) |center|² − radius²`.
    pub(crate) power: f32,
}

/// A box for the test of whether a ray may meet it: its middle and half its extent.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct BoxBound {
    pub(crate) center: [f32; 3],
    padding0: u32,
    /// Larger than the box by what rounding can be.
    pub(crate) half: [f32; 3],
    padding1: u32,
}

/// Both halves of a part of a BVH. Boxes are widened by its slack; each ray widens them by that of its origin.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct BvhNodeData {
    pub(crate) left_center: [f32; 3],
    /// A node, or with [`BVH_LEAF`] a leaf.
    pub(crate) left: u32,
    pub(crate) left_half: [f32; 3],
    pub(crate) right: u32,
    pub(crate) right_center: [f32; 3],
    padding0: u32,
    pub(crate) right_half: [f32; 3],
    padding1: u32,
}

/// Balls of a leaf, the last one repeated.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SphereLeaf {
    /// Centre and radius.
    pub(crate) balls: [[f32; 4]; LEAF],
    pub(crate) indices: [u32; LEAF],
}

/// The binding of [`mesh_bytes`].
pub(crate) const MESH_BINDING: u32 = 9;
/// The binding of a scene's image textures.
pub(crate) const TEXTURE_BINDING: u32 = 10;
/// The binding of a scene's environment map.
pub(crate) const ENVIRONMENT_BINDING: u32 = 11;
/// Set in the number of a leaf.
pub(crate) const BVH_LEAF: u32 = 1 << 31;

/// How much a box's bounds are wider than the box, over the largest coordinate of the scene. The
/// quick test and the exact one together err by 12 · 2⁻²⁴ of it.
const BOX_SLACK: f32 = 16.0 * 0.5 * f32::EPSILON;
/// With |o| and |c| the distances of a ray's origin and a ball's centre from the world's origin,
/// rounding moves the quick test's `b² − q` by less than 38 · 2⁻²⁴ (|o|² + |c|²).
pub(crate) const SPHERE_SLACK: f32 = 4e-6;

impl SphereBound {
    fn new(sphere: &SphereData) -> Self {
        let center = Vec3::from(sphere.center).as_dvec3();
        let radius = f64::from(sphere.radius);
        let power = center.length_squared() * (1.0 - f64::from(SPHERE_SLACK)) - radius * radius;
        Self {
            center: sphere.center,
            power: power as f32,
        }
    }
}

impl BvhNodeData {
    fn new([left, right]: &[BvhNode; 2], slack: f32) -> Self {
        let center = |part: &BvhNode| 0.5 * (part.min + part.max);
        let half = |part: &BvhNode| {
            let center = center(part);
            ((part.max - center).max(center - part.min) + slack).to_array()
        };
        let number = |part: &BvhNode| match part.is_leaf() {
            true => BVH_LEAF | (part.first / LEAF as u32),
            false => part.node,
        };
        Self {
            left_center: center(left).to_array(),
            left: number(left),
            left_half: half(left),
            right: number(right),
            right_center: center(right).to_array(),
            right_half: half(right),
            ..Self::zeroed()
        }
    }
}

impl SphereLeaf {
    fn new(indices: [u32; LEAF], spheres: &[SphereData]) -> Self {
        let balls = indices.map(|index| {
            let sphere = &spheres[index as usize];
            let [x, y, z] = sphere.center;
            [x, y, z, sphere.radius]
        });
        Self { balls, indices }
    }
}

impl BoxBound {
    fn new(Bounds { min, max }: Bounds, farthest: f32) -> Self {
        let center = 0.5 * (min + max);
        let half = (max - center).max(center - min) + BOX_SLACK * farthest;
        Self {
            center: center.to_array(),
            half: half.to_array(),
            ..Self::zeroed()
        }
    }
}

/// What `scene` requires on a device whose uniform buffers hold `uniform_bytes_max`.
pub(crate) fn features(scene: &CompiledScene, uniform_bytes_max: u64) -> Features {
    let mut features = Features::new(scene);
    // Rays of a group take different paths down a BVH, and a device reads constants for them in turn:
    // twice the time for 256 balls.
    // That of triangles lies in a buffer of its own.
    let has_bvh = features
        .shapes_of_scene()
        .any(|shape| features.has_bvh(shape));
    if has_bvh || scene_bytes_len(&features) > uniform_bytes_max {
        features.memory = SceneMemory::Storage;
    }
    features
}

/// Length of [`scene_bytes`].
pub(crate) fn scene_bytes_len(features: &Features) -> u64 {
    let shapes = features
        .shapes_of_scene()
        .map(|shape| features.count(shape) as usize * element_bytes(shape));
    let arrays = shapes.sum::<usize>()
        + features
            .shapes_of_scene()
            .map(|shape| finders_bytes(features, shape))
            .sum::<usize>()
        + features.csg_boxes as usize * size_of::<CsgBoxData>()
        + features.area_lights as usize * size_of::<AreaLightData>()
        + features.punctual_lights as usize * size_of::<PunctualLightData>()
        + features.emissive_shapes() as usize * size_of::<EmissiveSurfaceData>()
        + features.materials as usize * size_of::<MaterialData>();
    (size_of::<SceneHeader>() + arrays) as u64
}

/// Of what rays find the primitives of a shape by.
fn finders_bytes(features: &Features, shape: ShapeKind) -> usize {
    let count = match shape {
        ShapeKind::CsgFace => features.csg_boxes,
        _ => features.count(shape),
    } as usize;
    if features.has_bvh(shape) {
        let leaves = leaves(count);
        let leaf_bytes = match shape {
            ShapeKind::Sphere => size_of::<SphereLeaf>(),
            _ => size_of::<[u32; LEAF]>(),
        };
        return (leaves - 1) * size_of::<BvhNodeData>() + leaves * leaf_bytes;
    }
    (count + features.clusters(shape).len())
        * match shape {
            ShapeKind::Sphere => size_of::<SphereBound>(),
            ShapeKind::Box | ShapeKind::CsgFace => size_of::<BoxBound>(),
            ShapeKind::Disc | ShapeKind::Rectangle | ShapeKind::Triangle => 0,
        }
}

fn element_bytes(shape: ShapeKind) -> usize {
    match shape {
        ShapeKind::Sphere => size_of::<SphereData>(),
        ShapeKind::Box => size_of::<BoxData>(),
        ShapeKind::Disc => size_of::<DiscData>(),
        ShapeKind::Rectangle => size_of::<RectangleData>(),
        ShapeKind::CsgFace => size_of::<CsgFaceData>(),
        ShapeKind::Triangle => size_of::<TriangleData>(),
    }
}

/// The scene as the kernel's `SceneData`.
///
/// # Errors
/// [`Error::InvalidScene`] if a primitive's material does not exist: the kernel does not check.
pub(crate) fn scene_bytes(scene: &CompiledScene, size: ImageSize) -> Result<Vec<u8>, Error> {
    check_materials(scene)?;
    let header = SceneHeader {
        camera: scene.camera_frame(size),
        environment: scene.environment.to_array(),
        zero: 0,
    };
    let mut bytes = bytes_of(&header).to_vec();
    bytes.extend_from_slice(cast_slice(&scene.spheres));
    bytes.extend_from_slice(cast_slice(&scene.boxes));
    bytes.extend_from_slice(cast_slice(&scene.discs));
    bytes.extend_from_slice(cast_slice(&scene.rectangles));
    bytes.extend_from_slice(cast_slice(&scene.csg_faces));
    bytes.extend_from_slice(cast_slice(&scene.csg_boxes));
    bytes.extend_from_slice(cast_slice(&scene.area_lights));
    bytes.extend_from_slice(cast_slice(&scene.punctual_lights));
    let (emissive_shapes, _) = scene.emissive_surfaces.shapes_and_triangles();
    bytes.extend_from_slice(cast_slice(emissive_shapes));
    bytes.extend_from_slice(cast_slice(&scene.materials));
    if scene.materials.is_empty() {
        bytes.extend_from_slice(bytes_of(&MaterialData::zeroed()));
    }
    let shapes = ShapeKind::ALL.into_iter();
    for shape in shapes.filter(|shape| *shape != ShapeKind::Triangle) {
        bytes.extend(finders(scene, shape));
    }
    Ok(bytes)
}

/// Length of [`mesh_bytes`].
pub(crate) fn mesh_bytes_len(features: &Features) -> u64 {
    let triangles = features.triangles as usize * size_of::<TriangleData>();
    let normals = features.smooth_triangles as usize * size_of::<TriangleNormals>();
    let uvs = features.uv_triangles as usize * size_of::<TriangleUvs>();
    let colors = features.colored_triangles as usize * size_of::<TriangleColors>();
    let lights = features.emissive_triangles() as usize * size_of::<EmissiveSurfaceData>();
    (triangles + normals + uvs + colors + lights + finders_bytes(features, ShapeKind::Triangle))
        as u64
}

/// The scene's triangles as the kernel's `MeshData`.
pub(crate) fn mesh_bytes(scene: &CompiledScene) -> Vec<u8> {
    let meshes = &scene.meshes;
    let triangles: &[u8] = cast_slice(&meshes.triangles);
    let finders = finders(scene, ShapeKind::Triangle);
    let uvs: &[u8] = match scene.textures.is_empty() {
        true => &[],
        false => cast_slice(&meshes.uvs),
    };
    let colors = cast_slice(&meshes.colors);
    let (_, lights) = scene.emissive_surfaces.shapes_and_triangles();
    let lights = cast_slice(lights);
    let normals = cast_slice(&meshes.normals);
    [triangles, normals, uvs, colors, lights, &finders].concat()
}

/// What rays find the primitives of a shape by.
fn finders(scene: &CompiledScene, shape: ShapeKind) -> Vec<u8> {
    if let Some(bvh) = features::bvh(scene, shape) {
        let nodes = bvh.nodes.iter();
        let nodes: Vec<_> = nodes
            .map(|halves| BvhNodeData::new(halves, bvh.slack()))
            .collect();
        let leaves = bvh.order.chunks(LEAF).map(|indices| {
            let last = indices.len() - 1;
            std::array::from_fn(|i| indices[i.min(last)])
        });
        let leaves: Vec<[u32; LEAF]> = leaves.collect();
        if shape == ShapeKind::Sphere {
            let leaves = leaves.into_iter();
            let leaves: Vec<_> = leaves
                .map(|indices| SphereLeaf::new(indices, &scene.spheres))
                .collect();
            return [cast_slice(&nodes), cast_slice::<_, u8>(&leaves)].concat();
        }
        return [cast_slice(&nodes), cast_slice::<_, u8>(&leaves)].concat();
    }
    match shape {
        ShapeKind::Sphere => {
            let bounds: Vec<_> = scene.spheres.iter().map(SphereBound::new).collect();
            cast_slice(&bounds).to_vec()
        }
        ShapeKind::Box => box_bounds(scene, all_bounds(&scene.boxes), scene.box_clusters),
        ShapeKind::CsgFace => box_bounds(scene, all_bounds(&scene.csg_boxes), scene.csg_clusters),
        ShapeKind::Disc | ShapeKind::Rectangle | ShapeKind::Triangle => Vec::new(),
    }
}

/// The [`BoxBound`]s of boxes, and those of their clusters.
fn box_bounds(scene: &CompiledScene, boxes: Vec<Bounds>, clusters: Clusters) -> Vec<u8> {
    let farthest = coplanar::farthest(scene);
    let of_clusters = clusters.bounds(&boxes);
    let all = boxes.into_iter().chain(of_clusters);
    let bounds: Vec<_> = all.map(|of| BoxBound::new(of, farthest)).collect();
    cast_slice(&bounds).to_vec()
}

fn check_materials(scene: &CompiledScene) -> Result<(), Error> {
    let spheres = scene.spheres.iter().map(|sphere| sphere.material);
    let boxes = scene.boxes.iter().map(|solid| solid.material);
    let discs = scene.discs.iter().map(|disc| disc.material);
    let rectangles = scene.rectangles.iter().map(|rectangle| rectangle.material);
    let faces = scene.csg_faces.iter().map(|face| face.material);
    let materials = spheres.chain(boxes).chain(discs).chain(rectangles);
    let triangles = scene
        .meshes
        .triangles
        .iter()
        .map(|triangle| triangle.material);
    let highest = materials.chain(faces).chain(triangles).max();
    match highest {
        Some(material) if material as usize >= scene.materials.len() => {
            Err(Error::InvalidScene(SceneError::rule(format!(
                "a surface has material {material}, but there are {}",
                scene.materials.len()
            ))))
        }
        _ => Ok(()),
    }
}
