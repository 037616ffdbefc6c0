//! Compiled scenes: a scene as flat plain-old-data arrays, the bytes that all back ends read.

mod camera;
pub(crate) mod clusters;
mod cone;
mod construction;
mod data;
mod emissive_surface;
mod environment;
mod layer_texture;
mod material;
mod mesh;
mod opacity;
mod particle_surface;
mod punctual_light;
#[cfg(test)]
mod tests;
mod texture;
mod update;

use std::sync::OnceLock;

use glam::{DVec3, Vec3};

pub use self::camera::{CameraBasis, camera_frame};
use self::clusters::Clusters;
use self::cone::Cone;
pub use self::data::{
    AreaLightData, BoxData, CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z,
    CSG_FACE_CYLINDER, CSG_FACE_INNER_BOX, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, CameraFrame,
    CsgBoxData, CsgFaceData, DiscData, KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_LAYERED,
    KIND_METALLIC_ROUGHNESS, MaterialData, OPACITY_BLEND, OPACITY_MASK, OPACITY_OPAQUE,
    PATTERN_BRICKS, PATTERN_CLOTH, PATTERN_CUE, PATTERN_NONE, PATTERN_NUMBER, PATTERN_PLANKS,
    PATTERN_PRINT, PATTERN_SCOREBOARD, PATTERN_WOOD, RectangleData, SphereData, TriangleColors,
    TriangleData, TriangleNormals, TriangleUvs,
};
pub use self::emissive_surface::{
    EMISSIVE_SURFACE_REACH, EMISSIVE_SURFACES_MAX, EmissiveSurfaceData, EmissiveSurfaces,
};
pub use self::environment::{CompiledEnvironment, EnvironmentSample};
pub use self::layer_texture::LayerTextureData;
pub use self::mesh::CompiledMeshes;
pub(crate) use self::opacity::{AlphaTest, corner_weights};
pub use self::punctual_light::PunctualLightData;
pub use self::texture::{
    CompiledTextures, MaterialTextureData, TextureData, WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT,
};
use crate::ImageSize;
use crate::bvh::{Bounds, Bvh};
use crate::scene::{Camera, ObjectPose};

/// A validated scene, ready to trace. Primitives are sorted by shape; within a shape they keep
/// the order of [`objects`](crate::scene::Scene::objects).
#[derive(Clone, Debug)]
pub struct CompiledScene {
    /// Camera of the next image.
    pub camera: Camera,
    /// Radiance of rays that leave the scene if there is no environment map, W·sr⁻¹·m⁻².
    pub environment: Vec3,
    /// Environment map; empty if there is none.
    pub environment_map: CompiledEnvironment,
    /// Spheres: the scene's, then the particles of the last update.
    pub spheres: Vec<SphereData>,
    /// Axis-aligned boxes.
    pub boxes: Vec<BoxData>,
    /// Discs.
    pub discs: Vec<DiscData>,
    /// Rectangles.
    pub rectangles: Vec<RectangleData>,
    /// Boxes with subtracted solids (CSG).
    pub csg_boxes: Vec<CsgBoxData>,
    /// Faces of CSG boxes: for each the box itself, then its subtractions.
    pub csg_faces: Vec<CsgFaceData>,
    /// Triangle meshes.
    pub meshes: CompiledMeshes,
    /// Area lights: emitting rectangles; rays end on them.
    pub area_lights: Vec<AreaLightData>,
    /// Emissive surfaces for light sampling.
    pub emissive_surfaces: EmissiveSurfaces,
    /// Punctual lights.
    pub punctual_lights: Vec<PunctualLightData>,
    /// Probability with which light sampling chooses a punctual light.
    pub punctual_probability: f32,
    /// Materials; primitives refer to them by index.
    pub materials: Vec<MaterialData>,
    /// Image textures of the materials.
    pub textures: CompiledTextures,
    /// Per object of the scene: the array of its shape and its index there.
    pub primitives: Vec<Primitive>,
    /// When rays use a BVH.
    pub bvh_use: BvhUse,
    /// BVH per shape in its current state, built on first use.
    bvhs: [OnceLock<Option<Bvh>>; ShapeKind::ALL.len()],
    /// Clusters of the boxes.
    pub(crate) box_clusters: Clusters,
    /// Clusters of the CSG boxes.
    pub(crate) csg_clusters: Clusters,
    /// Spheres as in the scene, from which updates start.
    base_spheres: Vec<SphereData>,
    /// Number of the scene's materials; those of an update's particles follow.
    base_materials: usize,
    /// Truncated cones among the CSG boxes, with their poses in the scene.
    cones: Vec<(Cone, ObjectPose)>,
    /// Camera of the scene, from which updates start.
    base_camera: Camera,
}

/// When rays find primitives of a shape by a [`Bvh`] instead of a linear search. Images are the same except
/// where a ray that grazes a flat shape is rounded to its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BvhUse {
    /// Where it is faster: from a number of primitives that each back end specifies.
    #[default]
    WhereFaster,
    /// Never.
    Never,
    /// Whenever there are more primitives than fit in a leaf.
    Always,
}

/// Shapes, in the order in which back ends number primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShapeKind {
    /// [`CompiledScene::spheres`].
    Sphere,
    /// [`CompiledScene::boxes`].
    Box,
    /// [`CompiledScene::discs`].
    Disc,
    /// [`CompiledScene::rectangles`].
    Rectangle,
    /// [`CompiledScene::csg_faces`].
    CsgFace,
    /// [`CompiledMeshes::triangles`].
    Triangle,
}

impl ShapeKind {
    /// All shapes, in that order.
    pub const ALL: [Self; 6] = [
        Self::Sphere,
        Self::Box,
        Self::Disc,
        Self::Rectangle,
        Self::CsgFace,
        Self::Triangle,
    ];

    /// Primitive `index` of the shape.
    pub(crate) fn primitive(self, index: u32) -> Primitive {
        match self {
            Self::Sphere => Primitive::Sphere(index),
            Self::Box => Primitive::Box(index),
            Self::Disc => Primitive::Disc(index),
            Self::Rectangle => Primitive::Rectangle(index),
            Self::CsgFace => Primitive::CsgFace(index),
            Self::Triangle => Primitive::Triangle(index),
        }
    }
}

/// Reference to a primitive: of an object's data, or of what a ray has hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// Index into [`CompiledScene::spheres`].
    Sphere(u32),
    /// Index into [`CompiledScene::boxes`].
    Box(u32),
    /// Index into [`CompiledScene::discs`].
    Disc(u32),
    /// Index into [`CompiledScene::rectangles`].
    Rectangle(u32),
    /// Index into [`CompiledScene::csg_faces`]; for an object, that of its first face.
    CsgFace(u32),
    /// Index into [`CompiledMeshes::triangles`]; for an object, that of its first triangle.
    Triangle(u32),
    /// Index into [`CompiledScene::area_lights`].
    AreaLight(u32),
}

impl CompiledScene {
    /// Approximate memory of the scene in bytes: textures, triangles with a BVH, and other primitives. Data
    /// derived by back ends is not counted.
    pub fn memory_bytes(&self) -> u64 {
        let spheres = size_of_val(&self.spheres[..]) + size_of_val(&self.base_spheres[..]);
        let flat = size_of_val(&self.boxes[..])
            + size_of_val(&self.discs[..])
            + size_of_val(&self.rectangles[..])
            + size_of_val(&self.csg_boxes[..])
            + size_of_val(&self.csg_faces[..])
            + size_of_val(&self.materials[..])
            + size_of_val(&self.primitives[..]);
        let textures = size_of_val(&self.textures.texels[..]);
        let environment = size_of_val(&self.environment_map.numbers[..]);
        let meshes = &self.meshes;
        // Counted twice to account for the BVH over them.
        let triangles = 2 * size_of_val(&meshes.triangles[..]);
        let triangles = triangles
            + size_of_val(&meshes.normals[..])
            + size_of_val(&meshes.uvs[..])
            + size_of_val(&meshes.colors[..]);
        (spheres + flat + textures + environment + triangles) as u64
    }

    /// Unit axis of the truncated cone whose side a face of a CSG box is, and the coordinate of its
    /// narrow end along the axis, metres; `None` for other faces.
    pub(crate) fn cone_axis(&self, face: u32) -> Option<(DVec3, f64)> {
        let side = &self.csg_faces[face as usize];
        if side.kind != CSG_FACE_APEX_CONE {
            return None;
        }
        let narrow_end = &self.csg_faces[face as usize + 1];
        let axis = DVec3::from(side.b.map(f64::from)).normalize();
        Some((axis, -f64::from(narrow_end.b[0])))
    }

    /// Probability with which light sampling chooses an area light rather than another kind of light.
    pub(crate) fn area_light_probability(&self) -> f64 {
        match self.area_lights.is_empty() {
            true => 1.0,
            false => {
                let others = self.environment_map.probability + self.punctual_probability;
                1.0 - f64::from(others + self.emissive_surfaces.probability())
            }
        }
    }

    /// Whether any material emits.
    pub(crate) fn has_emission(&self) -> bool {
        let emits = |m: &MaterialData| m.kind == KIND_METALLIC_ROUGHNESS && m.k != [0.0; 3];
        self.materials.iter().any(emits)
    }

    /// Whether any mesh is of a dielectric.
    pub(crate) fn has_dielectric_mesh(&self) -> bool {
        let mut materials = self.meshes.materials();
        materials.any(|material| {
            let material = self.materials.get(material as usize);
            material.is_some_and(|material| material.kind == KIND_DIELECTRIC)
        })
    }

    /// Number of primitives of a shape.
    pub fn count(&self, shape: ShapeKind) -> usize {
        match shape {
            ShapeKind::Sphere => self.spheres.len(),
            ShapeKind::Box => self.boxes.len(),
            ShapeKind::Disc => self.discs.len(),
            ShapeKind::Rectangle => self.rectangles.len(),
            ShapeKind::CsgFace => self.csg_faces.len(),
            ShapeKind::Triangle => self.meshes.triangles.len(),
        }
    }

    /// Id of a shape's first primitive in the numbering of all primitives by back ends.
    pub(crate) fn first_id(&self, shape: ShapeKind) -> u32 {
        let before = ShapeKind::ALL.into_iter().take_while(|kind| *kind != shape);
        before.map(|kind| self.count(kind) as u32).sum()
    }

    /// BVH of a shape's primitives for a back end for which it is faster from `least` primitives on. Built
    /// on first use; that of spheres again after [`CompiledScene::apply`], that of triangles after an
    /// update that moves some. `None` where rays are to test each primitive, and for faces of CSG boxes,
    /// which are few ([`crate::scene::validate::SUBTRACTIONS_TOTAL_MAX`]).
    pub fn bvh(&self, shape: ShapeKind, least: usize) -> Option<&Bvh> {
        let is_wanted = match self.bvh_use {
            BvhUse::WhereFaster => self.count(shape) >= least,
            BvhUse::Never => false,
            BvhUse::Always => true,
        };
        let bvh = || self.bvhs[shape as usize].get_or_init(|| self.build_bvh(shape));
        is_wanted.then(bvh)?.as_ref()
    }

    /// Builds the BVH of a shape's primitives; `None` if they fit one leaf.
    pub fn build_bvh(&self, shape: ShapeKind) -> Option<Bvh> {
        match shape {
            ShapeKind::Sphere => Bvh::new(self.spheres.iter().map(Bounds::from)),
            ShapeKind::Box => Bvh::new(self.boxes.iter().map(Bounds::from)),
            ShapeKind::Disc => Bvh::new(self.discs.iter().map(Bounds::from)),
            ShapeKind::Rectangle => Bvh::new(self.rectangles.iter().map(Bounds::from)),
            ShapeKind::CsgFace => None,
            ShapeKind::Triangle => Bvh::new(self.meshes.triangles.iter().map(Bounds::from)),
        }
    }

    /// Material of a primitive; `None` for an area light.
    pub fn material_of(&self, primitive: Primitive) -> Option<&MaterialData> {
        let material = match primitive {
            Primitive::Sphere(i) => self.spheres[i as usize].material,
            Primitive::Box(i) => self.boxes[i as usize].material,
            Primitive::Disc(i) => self.discs[i as usize].material,
            Primitive::Rectangle(i) => self.rectangles[i as usize].material,
            Primitive::CsgFace(i) => self.csg_faces[i as usize].material,
            Primitive::Triangle(i) => self.meshes.triangles[i as usize].material,
            Primitive::AreaLight(_) => return None,
        };
        Some(&self.materials[material as usize])
    }

    /// Points of all primitives except area lights and triangles, each with a bound of the primitive's
    /// extent around it. `length` returns an upper bound of an edge's length.
    pub(crate) fn extents(
        &self,
        length: impl Fn([f32; 3]) -> f32,
    ) -> impl Iterator<Item = ([f32; 3], f32)> {
        let spheres = self.spheres.iter().map(|s| (s.center, s.radius));
        let boxes = self.boxes.iter().flat_map(|b| [b.min, b.max]);
        let csg_boxes = self.csg_boxes.iter().flat_map(|c| [c.min, c.max]);
        let corners = boxes.chain(csg_boxes).map(|corner| (corner, 0.0));
        let discs = self.discs.iter().map(|d| (d.center, d.radius));
        let rectangles = self.rectangles.iter();
        let rectangles = rectangles.map(move |r| (r.center, length(r.half_u) + length(r.half_v)));
        spheres.chain(corners).chain(discs).chain(rectangles)
    }

    /// Rays of the current camera for an image of `size`.
    pub fn camera_frame(&self, size: ImageSize) -> CameraFrame {
        camera_frame(&self.camera, size)
    }
}

/// Bounds of each primitive.
pub(crate) fn all_bounds<T>(all: &[T]) -> Vec<Bounds>
where
    for<'a> Bounds: From<&'a T>,
{
    all.iter().map(Bounds::from).collect()
}
