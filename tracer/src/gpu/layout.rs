//! Memory layout of the buffers that a kernel reads: the arrays of [`crate::compiled`] one after
//! another.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};
use glam::Vec3;

use crate::bvh::Bounds;
use crate::bvh::{BvhNode, LEAF, leaves as leaf_count};
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

/// The data before the scene's arrays.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SceneHeader {
    pub(crate) camera: CameraFrame,
    pub(crate) environment: [f32; 3],
    /// Always 0; the shader compiler cannot know this, which keeps it from simplifying certain
    /// expressions.
    pub(crate) zero: u32,
}

/// Uniforms of one dispatch: samples `sample_begin..sample_end` of `samples`, in blocks of pixels.
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
    /// 1 if the tiles are single pixels, whose number is the counter at [`LISTED_PIXELS`];
    /// otherwise 0.
    pub(crate) is_list: u32,
}

/// Number of 32-bit counters before those of the tiles: low and high word of the number of rays,
/// and length of the list of edge pixels.
pub(crate) const COUNTERS_BEFORE_TILES: u64 = 3;
/// Index of the counter that holds the length of the list of edge pixels.
pub(crate) const LISTED_PIXELS: u64 = 2;

/// A tile, and the numbers of blocks and pixels before it.
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

/// A ball, prepared for a conservative test of whether a ray may hit it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SphereBound {
    pub(crate) center: [f32; 3],
    /// `(1 − SLACK) |center|² − radius²`.
    pub(crate) power: f32,
}

/// A box, prepared for a conservative test of whether a ray may hit it: centre and half extents.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct BoxBound {
    pub(crate) center: [f32; 3],
    padding0: u32,
    /// Half extents, enlarged by a bound on the rounding error.
    pub(crate) half: [f32; 3],
    padding1: u32,
}

/// The two children of a BVH node. Their boxes are enlarged by the BVH's slack; each ray enlarges
/// them further by the slack of its origin.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct BvhNodeData {
    pub(crate) left_center: [f32; 3],
    /// Index of a node, or of a leaf if [`BVH_LEAF`] is set.
    pub(crate) left: u32,
    pub(crate) left_half: [f32; 3],
    pub(crate) right: u32,
    pub(crate) right_center: [f32; 3],
    padding0: u32,
    pub(crate) right_half: [f32; 3],
    padding1: u32,
}

/// The balls of a leaf; the last one is repeated to fill it.
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
/// Flag that marks the index of a leaf.
pub(crate) const BVH_LEAF: u32 = 1 << 31;

/// Enlargement of a box's bounds relative to the scene's largest coordinate. The combined error of
/// the conservative test and the exact one is 12 · 2⁻²⁴ of that coordinate.
const BOX_SLACK: f32 = 16.0 * 0.5 * f32::EPSILON;
/// Slack of the conservative sphere test: with |o| and |c| the distances of a ray's origin and a
/// ball's centre from the world's origin, rounding changes the test's `b² − q` by less than 38 ·
/// 2⁻²⁴ (|o|² + |c|²).
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
            // The larger of the two differences: as the centre is rounded, the half extent has to
            // reach the farther corner.
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

/// Features of `scene` for a device whose uniform buffers hold up to `uniform_bytes_max` bytes.
pub(crate) fn features(scene: &CompiledScene, uniform_bytes_max: u64) -> Features {
    let mut features = Features::new(scene);
    // Uniform memory serves differing addresses one after another, and the threads of a workgroup
    // take different paths through a BVH: for 256 balls it took twice the time. The BVH of
    // triangles does not matter here, as it lies in a buffer of its own.
    let has_bvh = features
        .shapes_of_scene()
        .any(|shape| features.has_bvh(shape));
    if has_bvh || scene_bytes_len(&features) > uniform_bytes_max {
        features.memory = SceneMemory::Storage;
    }
    features
}

/// An array in a buffer, as the kernel declares it.
pub(crate) struct ArrayLayout {
    pub(crate) name: String,
    pub(crate) element: &'static str,
    element_bytes: usize,
    pub(crate) count: u32,
}

impl ArrayLayout {
    fn of<T>(name: impl Into<String>, element: &'static str, count: u32) -> Self {
        Self {
            name: name.into(),
            element,
            element_bytes: size_of::<T>(),
            count,
        }
    }

    fn of_shape(features: &Features, shape: ShapeKind) -> Self {
        let (name, count) = (shape.array(), features.count(shape));
        match shape {
            ShapeKind::Sphere => Self::of::<SphereData>(name, "SphereData", count),
            ShapeKind::Box => Self::of::<BoxData>(name, "BoxData", count),
            ShapeKind::Disc => Self::of::<DiscData>(name, "DiscData", count),
            ShapeKind::Rectangle => Self::of::<RectangleData>(name, "RectangleData", count),
            ShapeKind::CsgFace => Self::of::<CsgFaceData>(name, "CsgFaceData", count),
            ShapeKind::Triangle => Self::of::<TriangleData>(name, "TriangleData", count),
        }
    }

    fn bytes(&self) -> usize {
        self.count as usize * self.element_bytes
    }
}

/// The arrays after the header of the scene's buffer, in the order of [`scene_bytes`]. Empty arrays
/// are not declared.
pub(crate) fn scene_arrays(features: &Features) -> Vec<ArrayLayout> {
    let shapes = || features.shapes_of_scene();
    let (csg_boxes, lights) = (features.csg_boxes, features.area_lights);
    let (punctual, emissive) = (features.punctual_lights, features.emissive_shapes());
    let others = [
        ArrayLayout::of::<CsgBoxData>("csg_boxes", "CsgBoxData", csg_boxes),
        ArrayLayout::of::<AreaLightData>("area_lights", "AreaLightData", lights),
        ArrayLayout::of::<PunctualLightData>("punctual_lights", "PunctualLightData", punctual),
        ArrayLayout::of::<EmissiveSurfaceData>("emissive_shapes", "EmissiveSurfaceData", emissive),
        ArrayLayout::of::<MaterialData>("materials", "MaterialData", features.materials),
    ];
    let primitives = shapes().map(|shape| ArrayLayout::of_shape(features, shape));
    let finders = shapes().flat_map(|shape| finder_arrays(features, shape));
    let arrays = primitives.chain(others).chain(finders);
    arrays.filter(|array| array.count > 0).collect()
}

/// The arrays of the triangles' buffer, in the order of [`mesh_bytes`].
pub(crate) fn mesh_arrays(features: &Features) -> Vec<ArrayLayout> {
    let (normals, uvs) = (features.smooth_triangles, features.uv_triangles);
    let (colors, lights) = (features.colored_triangles, features.emissive_triangles());
    let arrays = [
        ArrayLayout::of_shape(features, ShapeKind::Triangle),
        ArrayLayout::of::<TriangleNormals>("normals", "TriangleNormals", normals),
        ArrayLayout::of::<TriangleUvs>("uvs", "TriangleUvs", uvs),
        ArrayLayout::of::<TriangleColors>("colors", "TriangleColors", colors),
        ArrayLayout::of::<EmissiveSurfaceData>("lights", "EmissiveSurfaceData", lights),
    ];
    let finders = finder_arrays(features, ShapeKind::Triangle);
    let arrays = arrays.into_iter().chain(finders);
    arrays.filter(|array| array.count > 0).collect()
}

/// The acceleration structure of a shape: nodes and leaves of a BVH, or else bounds for a
/// conservative intersection test.
fn finder_arrays(features: &Features, shape: ShapeKind) -> Vec<ArrayLayout> {
    let (name, count) = (shape.function(), features.count(shape));
    if features.has_bvh(shape) {
        let (nodes, leaves) = (format!("{name}_nodes"), format!("{name}_leaves"));
        let leaf_count = leaf_count(count as usize) as u32;
        return vec![
            ArrayLayout::of::<BvhNodeData>(nodes, "BvhNodeData", leaf_count - 1),
            match shape {
                ShapeKind::Sphere => {
                    ArrayLayout::of::<SphereLeaf>(leaves, "SphereLeaf", leaf_count)
                }
                _ => ArrayLayout::of::<[u32; LEAF]>(leaves, "vec4u", leaf_count),
            },
        ];
    }
    let clusters = features.clusters(shape).len() as u32;
    match shape {
        ShapeKind::Sphere => vec![ArrayLayout::of::<SphereBound>(
            "sphere_bounds",
            "SphereBound",
            count,
        )],
        ShapeKind::Box => vec![ArrayLayout::of::<BoxBound>(
            "box_bounds",
            "BoxBound",
            count + clusters,
        )],
        ShapeKind::CsgFace => vec![ArrayLayout::of::<BoxBound>(
            "csg_box_bounds",
            "BoxBound",
            features.csg_boxes + clusters,
        )],
        ShapeKind::Disc | ShapeKind::Rectangle | ShapeKind::Triangle => Vec::new(),
    }
}

/// Length of [`scene_bytes`] in bytes.
pub(crate) fn scene_bytes_len(features: &Features) -> u64 {
    let arrays = scene_arrays(features);
    let arrays = arrays.iter().map(ArrayLayout::bytes);
    (size_of::<SceneHeader>() + arrays.sum::<usize>()) as u64
}

/// Length of [`mesh_bytes`] in bytes.
pub(crate) fn mesh_bytes_len(features: &Features) -> u64 {
    let arrays = mesh_arrays(features);
    arrays.iter().map(ArrayLayout::bytes).sum::<usize>() as u64
}

/// The contents of the kernel's `SceneData`.
///
/// # Errors
/// [`Error::InvalidScene`] if a primitive's material does not exist, which the kernel does not
/// check.
pub(crate) fn scene_bytes(scene: &CompiledScene, size: ImageSize) -> Result<Vec<u8>, Error> {
    check_materials(scene)?;
    let header = SceneHeader {
        camera: scene.camera_frame(size),
        environment: scene.environment.to_array(),
        zero: 0,
    };
    let (emissive_shapes, _) = scene.emissive_surfaces.shapes_and_triangles();
    let no_material = [MaterialData::zeroed()];
    let materials = match scene.materials.is_empty() {
        true => &no_material[..],
        false => &scene.materials,
    };
    let mut bytes = [
        bytes_of(&header),
        cast_slice(&scene.spheres),
        cast_slice(&scene.boxes),
        cast_slice(&scene.discs),
        cast_slice(&scene.rectangles),
        cast_slice(&scene.csg_faces),
        cast_slice(&scene.csg_boxes),
        cast_slice(&scene.area_lights),
        cast_slice(&scene.punctual_lights),
        cast_slice(emissive_shapes),
        cast_slice(materials),
    ]
    .concat();
    let shapes = ShapeKind::ALL.into_iter();
    for shape in shapes.filter(|shape| *shape != ShapeKind::Triangle) {
        bytes.extend(finders(scene, shape));
    }
    Ok(bytes)
}

/// The contents of the kernel's `MeshData`.
pub(crate) fn mesh_bytes(scene: &CompiledScene) -> Vec<u8> {
    let meshes = &scene.meshes;
    let triangles: &[u8] = cast_slice(&meshes.triangles);
    let finders = finders(scene, ShapeKind::Triangle);
    // As in `Features::new`, texture coordinates are left out if there are no textures.
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

/// The acceleration structure of a shape, in the order of [`finder_arrays`].
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
        let leaves: Vec<u8> = match shape {
            ShapeKind::Sphere => {
                let leaf = |indices| SphereLeaf::new(indices, &scene.spheres);
                cast_slice(&leaves.map(leaf).collect::<Vec<_>>()).to_vec()
            }
            _ => cast_slice(&leaves.collect::<Vec<[u32; LEAF]>>()).to_vec(),
        };
        return [cast_slice(&nodes), &leaves[..]].concat();
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

/// The [`BoxBound`]s of boxes, followed by those of their clusters.
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
    let triangles = scene.meshes.triangles.iter();
    let triangles = triangles.map(|triangle| triangle.material);
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
