//! A scene as flat plain-old-data arrays: the bytes that both back ends read.

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
    /// The camera that the next picture is taken with.
    pub camera: Camera,
    /// Radiance of rays that leave the scene where there is no environment map.
    pub environment: Vec3,
    /// Its environment map.
    pub environment_map: CompiledEnvironment,
    /// Balls: the scene's, then particles of the update.
    pub spheres: Vec<SphereData>,
    /// Axis-aligned boxes.
    pub boxes: Vec<BoxData>,
    /// Round discs.
    pub discs: Vec<DiscData>,
    /// Rectangles.
    pub rectangles: Vec<RectangleData>,
    /// Boxes with solids subtracted.
    pub csg_boxes: Vec<CsgBoxData>,
    /// Surfaces of CSG boxes: each one's box, then its subtractions.
    pub csg_faces: Vec<CsgFaceData>,
    /// Triangle meshes.
    pub meshes: CompiledMeshes,
    /// Emitting rectangles; rays end on them.
    pub area_lights: Vec<AreaLightData>,
    /// Surfaces that emit.
    pub emissive_surfaces: EmissiveSurfaces,
    /// Lights without extent.
    pub punctual_lights: Vec<PunctualLightData>,
    /// Probability with which light sampling aims at one of them.
    pub punctual_probability: f32,
    /// Materials; primitives hold indices.
    pub materials: Vec<MaterialData>,
    /// Image textures of the materials.
    pub textures: CompiledTextures,
    /// Per object of the scene: its shape's array and its place in it.
    pub primitives: Vec<Primitive>,
    /// When rays find primitives by a BVH.
    pub bvh_use: BvhUse,
    /// Of each shape as it is now, once somebody has asked for it.
    bvhs: [OnceLock<Option<Bvh>>; ShapeKind::ALL.len()],
    /// Of the boxes.
    pub(crate) box_clusters: Clusters,
    /// Of the CSG boxes.
    pub(crate) csg_clusters: Clusters,
    /// The spheres as the scene has them: what an update starts from.
    base_spheres: Vec<SphereData>,
    /// How many materials the scene has; those of an update's particles follow.
    base_materials: usize,
    /// The truncated cones among the CSG boxes, and the scene's poses of them.
    cones: Vec<(Cone, ObjectPose)>,
    base_camera: Camera,
}

/// When rays find primitives of a shape by a [`Bvh`] instead of meeting each of them: pictures are the same
/// but where a ray that grazes a flat shape is rounded to its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BvhUse {
    /// Where that is faster: each back end knows from how many on.
    #[default]
    WhereFaster,
    /// Never.
    Never,
    /// Whenever there is a BVH.
    Always,
}

/// A shape's array in the scene, in the order in which back ends number primitives.
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
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Sphere,
        Self::Box,
        Self::Disc,
        Self::Rectangle,
        Self::CsgFace,
        Self::Triangle,
    ];

    /// A primitive of the shape.
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

/// Where an object's data lies, and what a ray hit.
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
    /// Index into [`CompiledScene::csg_faces`]; for an object its first face.
    CsgFace(u32),
    /// Index into [`CompiledMeshes::triangles`]; for an object its first triangle.
    Triangle(u32),
    /// Index into [`CompiledScene::area_lights`].
    AreaLight(u32),
}

impl CompiledScene {
    /// Memory that it takes, in bytes: that of textures, triangles with a BVH, and other primitives. What back ends
    /// make of it is not counted.
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
        // Once more for the BVH over them.
        let triangles = 2 * size_of_val(&meshes.triangles[..]);
        let triangles = triangles
            + size_of_val(&meshes.normals[..])
            + size_of_val(&meshes.uvs[..])
            + size_of_val(&meshes.colors[..]);
        (spheres + flat + textures + environment + triangles) as u64
    }

    /// Unit axis of the truncated cone that a face of a CSG box is the side of, and how far along it the
    /// narrow end lies.
    pub(crate) fn cone_axis(&self, face: u32) -> Option<(DVec3, f64)> {
        let side = &self.csg_faces[face as usize];
        if side.kind != CSG_FACE_APEX_CONE {
            return None;
        }
        let narrow_end = &self.csg_faces[face as usize + 1];
        let axis = DVec3::from(side.b.map(f64::from)).normalize();
        Some((axis, -f64::from(narrow_end.b[0])))
    }

    /// The probability with which light sampling aims at an area light rather than at others.
    pub(crate) fn area_light_probability(&self) -> f64 {
        match self.area_lights.is_empty() {
            true => 1.0,
            false => {
                let others = self.environment_map.probability + self.punctual_probability;
                1.0 - f64::from(others + self.emissive_surfaces.probability())
            }
        }
    }

    /// Whether some surface emits.
    pub(crate) fn has_emission(&self) -> bool {
        let emits = |m: &MaterialData| m.kind == KIND_METALLIC_ROUGHNESS && m.k != [0.0; 3];
        self.materials.iter().any(emits)
    }

    /// Whether some mesh is of a dielectric.
    pub(crate) fn has_dielectric_mesh(&self) -> bool {
        let mut materials = self.meshes.materials();
        materials.any(|material| {
            let material = self.materials.get(material as usize);
            material.is_some_and(|material| material.kind == KIND_DIELECTRIC)
        })
    }

    /// How many primitives of a shape there are.
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

    /// The number of a shape's first primitive, where back ends number all of them.
    pub(crate) fn first_id(&self, shape: ShapeKind) -> u32 {
        let before = ShapeKind::ALL.into_iter().take_while(|kind| *kind != shape);
        before.map(|kind| self.count(kind) as u32).sum()
    }

    /// The BVH by which a back end finds the primitives of a shape that is faster so from `least` of them
    /// on; made when first asked for, that of balls again after [`CompiledScene::apply`], that of
    /// triangles after one that moves some. None where rays
    /// are to meet each of them, and for the faces of CSG boxes, which are few
    /// ([`crate::scene::validate::SUBTRACTIONS_TOTAL_MAX`]).
    pub fn bvh(&self, shape: ShapeKind, least: usize) -> Option<&Bvh> {
        let is_wanted = match self.bvh_use {
            BvhUse::WhereFaster => self.count(shape) >= least,
            BvhUse::Never => false,
            BvhUse::Always => true,
        };
        let bvh = || self.bvhs[shape as usize].get_or_init(|| self.build_bvh(shape));
        is_wanted.then(bvh)?.as_ref()
    }

    /// The BVH of a shape's primitives, made anew; none if they are no more than a leaf.
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

    /// The material of a primitive; none for an area light.
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

    /// Points of everything that can be met but area lights and triangles, and how far it reaches from them; `length`
    /// is an upper bound of an edge's.
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

    /// The current camera's rays for an image of `size`.
    pub fn camera_frame(&self, size: ImageSize) -> CameraFrame {
        camera_frame(&self.camera, size)
    }
}

/// The bounds of primitives.
pub(crate) fn all_bounds<T>(all: &[T]) -> Vec<Bounds>
where
    for<'a> Bounds: From<&'a T>,
{
    all.iter().map(Bounds::from).collect()
}
