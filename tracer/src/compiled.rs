//! A scene as flat plain-old-data arrays: the bytes that both back ends read.

#[cfg(feature = "gpu")]
pub(crate) mod clusters;
mod cone;
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

use std::sync::OnceLock;

use bytemuck::Zeroable as _;
use glam::{DVec3, Quat, U16Vec3, Vec3, Vec3Swizzles as _};

#[cfg(feature = "gpu")]
use self::clusters::Clusters;
use self::cone::Cone;
pub use self::data::{
    AreaLightData, BoxData, CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z,
    CSG_FACE_CYLINDER, CSG_FACE_INNER_BOX, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, CameraFrame,
    CsgBoxData, CsgFaceData, DiscData, KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_LAYERED,
    KIND_METALLIC_ROUGHNESS, MaterialData, OPACITY_BLEND, OPACITY_MASK, OPACITY_OPAQUE,
    PATTERN_BRICKS, PATTERN_CLOTH, PATTERN_CUE, PATTERN_NONE, PATTERN_NUMBER, PATTERN_PLANKS,
    PATTERN_SCOREBOARD, PATTERN_WOOD, RectangleData, SphereData, TriangleColors, TriangleData,
    TriangleNormals, TriangleUvs,
};
pub use self::emissive_surface::{
    EMISSIVE_SURFACE_REACH, EMISSIVE_SURFACES_MAX, EmissiveSurfaceData, EmissiveSurfaces,
};
pub use self::environment::{CompiledEnvironment, EnvironmentSample};
pub use self::layer_texture::LayerTextureData;
use self::material::{material_data, with_number_discs};
pub use self::mesh::CompiledMeshes;
pub(crate) use self::opacity::{AlphaTest, corner_weights};
pub use self::punctual_light::PunctualLightData;
#[cfg(feature = "gpu")]
pub(crate) use self::texture::SRGB_LINEAR;
pub use self::texture::{
    CompiledTextures, MaterialTextureData, TextureData, WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT,
};
use crate::bvh::{Bounds, Bvh};
use crate::scene::{
    AreaLight, Axis, Camera, CsgSolid, ObjectPose, ParticleCloud, ParticleForm, Scene, SceneUpdate,
    Shape, Subtraction,
};
use crate::{Error, ImageSize, SceneError};

/// A validated scene, ready to trace. Primitives are sorted by shape; within a shape they keep
/// the order of [`Scene::objects`].
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
    #[cfg(feature = "gpu")]
    pub(crate) box_clusters: Clusters,
    /// Of the CSG boxes.
    #[cfg(feature = "gpu")]
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

    /// Checks `scene` against [`crate::scene::validate`] and lays it out.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with the first rule that the scene breaks.
    pub fn new(scene: &Scene) -> Result<Self, Error> {
        scene.validate()?;
        let materials = with_number_discs(scene);
        let mut compiled = Self {
            camera: scene.camera,
            environment: scene.environment.radiance,
            environment_map: CompiledEnvironment::new(
                scene.environment_map.as_ref(),
                scene.environment.radiance,
                !scene.area_lights.is_empty(),
            )?,
            spheres: Vec::new(),
            boxes: Vec::new(),
            discs: Vec::new(),
            rectangles: Vec::new(),
            csg_boxes: Vec::new(),
            csg_faces: Vec::new(),
            meshes: CompiledMeshes::default(),
            area_lights: area_lights(&scene.area_lights),
            emissive_surfaces: EmissiveSurfaces::default(),
            punctual_lights: scene.punctual_lights.iter().map(Into::into).collect(),
            punctual_probability: 0.0,
            base_materials: materials.len(),
            materials,
            textures: CompiledTextures::new(&scene.textures, scene.materials.values())?,
            primitives: Vec::with_capacity(scene.objects.len()),
            bvh_use: BvhUse::default(),
            bvhs: Default::default(),
            #[cfg(feature = "gpu")]
            box_clusters: Clusters::NONE,
            #[cfg(feature = "gpu")]
            csg_clusters: Clusters::NONE,
            base_spheres: Vec::new(),
            cones: Vec::new(),
            base_camera: scene.camera,
        };
        compiled.share_light_sampling();
        let names: Vec<&str> = scene.materials.keys().map(String::as_str).collect();
        let material = |name: &str| {
            let place = names.binary_search(&name);
            place.expect("validated: each object's material exists") as u32
        };
        for object in &scene.objects {
            let primitive = compiled.push(&object.shape, material(&object.material), &material);
            compiled.primitives.push(primitive);
        }
        compiled.find_emissive_surfaces();
        for index in 0..compiled.spheres.len() {
            compiled.spheres[index].allows_refracted_nee = compiled.allows_refracted_nee(index);
        }
        compiled.base_spheres.clone_from(&compiled.spheres);
        #[cfg(feature = "gpu")]
        compiled.find_clusters();
        Ok(compiled)
    }

    /// For rays from the middle of the spheres; without any, from what is looked at.
    #[cfg(feature = "gpu")]
    fn find_clusters(&mut self) {
        let centers = self.spheres.iter().map(|ball| Vec3::from(ball.center));
        let middle = match self.spheres.len() {
            0 => self.camera.target,
            count => centers.sum::<Vec3>() / count as f32,
        };
        self.box_clusters = Clusters::new(&all_bounds(&self.boxes), middle);
        self.csg_clusters = Clusters::new(&all_bounds(&self.csg_boxes), middle);
    }

    #[expect(clippy::too_many_lines, reason = "one arm for each shape")]
    fn push(&mut self, shape: &Shape, material: u32, named: &dyn Fn(&str) -> u32) -> Primitive {
        match *shape {
            Shape::Sphere {
                center,
                radius,
                rotation,
            } => {
                self.spheres.push(SphereData {
                    center: center.to_array(),
                    radius,
                    stripe_axis: ball_axis(rotation, DVec3::Z),
                    material,
                    number_axis: ball_axis(rotation, DVec3::X),
                    allows_refracted_nee: 0,
                });
                Primitive::Sphere(self.spheres.len() as u32 - 1)
            }
            Shape::Box { min, max } => {
                let (min, max) = (min.to_array(), max.to_array());
                self.boxes.push(BoxData {
                    min,
                    material,
                    max,
                    padding: 0,
                });
                Primitive::Box(self.boxes.len() as u32 - 1)
            }
            Shape::CsgBox {
                min,
                max,
                ref subtractions,
            } => self.push_csg_box([min, max], subtractions, material, named),
            Shape::TruncatedCone {
                center,
                rotation,
                length,
                radii,
            } => {
                let pose = ObjectPose {
                    object: self.primitives.len() as u32,
                    position: center,
                    rotation,
                    visible: true,
                };
                self.push_cone(pose, length, radii, material)
            }
            Shape::Disc {
                center,
                normal,
                radius,
            } => {
                let (center, normal) = (center.to_array(), unit(normal.as_dvec3()).to_array());
                self.discs.push(DiscData {
                    center,
                    radius,
                    normal,
                    material,
                });
                Primitive::Disc(self.discs.len() as u32 - 1)
            }
            Shape::Rectangle {
                center,
                half_u,
                half_v,
            } => {
                self.rectangles.push(RectangleData {
                    center: center.to_array(),
                    material,
                    half_u: half_u.to_array(),
                    inv_u2: 1.0 / half_u.length_squared(),
                    half_v: half_v.to_array(),
                    inv_v2: 1.0 / half_v.length_squared(),
                    normal: unit(half_u.as_dvec3().cross(half_v.as_dvec3())).to_array(),
                    padding: 0,
                });
                Primitive::Rectangle(self.rectangles.len() as u32 - 1)
            }
            Shape::Mesh(ref mesh) => {
                let object = self.primitives.len() as u32;
                Primitive::Triangle(self.meshes.push(object, mesh, material))
            }
        }
    }

    fn push_csg_box(
        &mut self,
        [min, max]: [Vec3; 2],
        subtractions: &[Subtraction],
        material: u32,
        named: &dyn Fn(&str) -> u32,
    ) -> Primitive {
        let first_face = self.csg_faces.len() as u32;
        let subtraction_faces = subtractions.iter().map(|subtraction| {
            let material = subtraction.material.as_deref().map_or(material, named);
            subtraction_face(&subtraction.solid, material)
        });
        let (min, max) = (min.to_array(), max.to_array());
        self.csg_boxes.push(CsgBoxData {
            min,
            first_face,
            max,
            face_count: 1 + subtractions.len() as u32,
        });
        self.csg_faces.push(CsgFaceData {
            a: min,
            kind: CSG_FACE_OUTER_BOX,
            b: max,
            material,
        });
        self.csg_faces.extend(subtraction_faces);
        Primitive::CsgFace(first_face)
    }

    fn push_cone(
        &mut self,
        pose: ObjectPose,
        length: f32,
        radii: [f32; 2],
        material: u32,
    ) -> Primitive {
        let cone = Cone {
            csg_box: self.csg_boxes.len() as u32,
            first_face: self.csg_faces.len() as u32,
            length,
            radii,
        };
        let (csg_box, faces) = cone.at(&pose, material);
        self.csg_boxes.push(csg_box);
        self.csg_faces.extend(faces);
        self.cones.push((cone, pose));
        Primitive::CsgFace(cone.first_face)
    }

    /// Puts camera and objects where `update` wants them; what it does not name goes back to
    /// where the scene has it, so that updates may come in any order.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if a pose names no sphere, truncated cone or mesh of the scene, one that another pose
    /// has named, or holds a number that is not finite, the camera is degenerate, or particles are out of range; the
    /// scene then is as if nothing had been applied.
    pub fn apply(&mut self, update: &SceneUpdate) -> Result<(), Error> {
        self.reset();
        let applied = self.try_apply(update);
        if applied.is_err() {
            self.reset();
            self.place_meshes(&[]);
            let _ = self.push_particles(&[]);
        }
        applied
    }

    fn reset(&mut self) {
        self.spheres.clone_from(&self.base_spheres);
        self.materials.truncate(self.base_materials);
        self.bvhs[ShapeKind::Sphere as usize] = OnceLock::new();
        for index in 0..self.cones.len() {
            self.place_cone(index, &self.cones[index].1.clone());
        }
        self.camera = self.base_camera;
    }

    fn try_apply(&mut self, update: &SceneUpdate) -> Result<(), Error> {
        if let Some(camera) = update.camera {
            camera.validate().map_err(Error::InvalidUpdate)?;
            self.camera = camera;
        }
        let mut posed_before = vec![false; self.primitives.len()];
        let mut of_meshes = Vec::new();
        for pose in &update.poses {
            pose.validate().map_err(Error::InvalidUpdate)?;
            match self.meshes.has(pose.object) {
                true => of_meshes.push(*pose),
                false => self.apply_pose(pose)?,
            }
            if std::mem::replace(&mut posed_before[pose.object as usize], true) {
                let sentence = format!("object {} is posed twice", pose.object);
                return Err(Error::InvalidUpdate(SceneError::rule(sentence)));
            }
        }
        self.place_meshes(&of_meshes);
        update.validate_particles().map_err(Error::InvalidUpdate)?;
        self.push_particles(&update.particles)
            .map_err(Error::InvalidUpdate)
    }

    /// Adds particles, surfaces first: so their materials keep their places when dust comes and goes.
    fn push_particles(&mut self, clouds: &[ParticleCloud]) -> Result<(), SceneError> {
        let is_surface = |cloud: &ParticleCloud| matches!(cloud.form, ParticleForm::Surface { .. });
        let surfaces = clouds
            .iter()
            .enumerate()
            .filter(|(_, cloud)| is_surface(cloud));
        let surfaces: Vec<_> = (self.base_materials as u32..)
            .zip(surfaces)
            .map(|(material, (index, cloud))| (material, index, cloud))
            .collect();
        let materials = surfaces
            .iter()
            .map(|(_, _, cloud)| material_data(&cloud.material));
        self.materials.extend(materials);
        let changed = self.meshes.set_surfaces(&surfaces);
        if !matches!(changed, Ok(false)) {
            self.bvhs[ShapeKind::Triangle as usize] = OnceLock::new();
        }
        changed?;
        let balls = clouds.iter().filter(|cloud| !is_surface(cloud));
        self.push_balls(&balls.collect::<Vec<_>>());
        Ok(())
    }

    /// Adds balls behind the scene's own spheres, and hidden ones up to a power of two: kernels are built for
    /// numbers of primitives, and so need not be built anew for each frame of a cloud that grows.
    fn push_balls(&mut self, clouds: &[&ParticleCloud]) {
        let particles: usize = clouds.iter().map(|cloud| cloud.places.len()).sum();
        if particles == 0 {
            return;
        }
        let slots = particles.next_power_of_two().max(PARTICLE_SLOTS_MIN);
        self.spheres.reserve(slots);
        for cloud in clouds {
            let material = self.materials.len() as u32;
            self.materials.push(material_data(&cloud.material));
            let sphere = |place: &U16Vec3| SphereData {
                center: cloud.center(*place).to_array(),
                radius: cloud.radius_m,
                stripe_axis: Vec3::Z.to_array(),
                material,
                number_axis: Vec3::X.to_array(),
                allows_refracted_nee: 0,
            };
            self.spheres.extend(cloud.places.iter().map(sphere));
        }
        if let Some(last) = self.spheres.last() {
            let hidden = SphereData {
                radius: 0.0,
                ..*last
            };
            let hidden = std::iter::repeat_n(hidden, slots - particles);
            self.spheres.extend(hidden);
        }
    }

    fn place_meshes(&mut self, poses: &[ObjectPose]) {
        if self.meshes.place(poses) {
            self.bvhs[ShapeKind::Triangle as usize] = OnceLock::new();
        }
    }

    fn apply_pose(&mut self, pose: &ObjectPose) -> Result<(), Error> {
        let cone_of = |(_, base): &(Cone, ObjectPose)| base.object == pose.object;
        match self.primitives.get(pose.object as usize) {
            Some(Primitive::Sphere(sphere)) => {
                let sphere = *sphere as usize;
                self.spheres[sphere] = sphere_at(self.base_spheres[sphere], pose);
                self.spheres[sphere].allows_refracted_nee = self.allows_refracted_nee(sphere);
            }
            Some(_) => match self.cones.iter().position(cone_of) {
                Some(cone) => self.place_cone(cone, pose),
                None => {
                    return Err(Error::InvalidUpdate(SceneError::immovable(pose.object)));
                }
            },
            None => {
                return Err(Error::InvalidUpdate(SceneError::rule(format!(
                    "object {} is posed, but the scene has {} objects",
                    pose.object,
                    self.primitives.len()
                ))));
            }
        }
        Ok(())
    }

    fn place_cone(&mut self, index: usize, pose: &ObjectPose) {
        let (cone, _) = self.cones[index];
        let first = cone.first_face as usize;
        let (csg_box, faces) = cone.at(pose, self.csg_faces[first].material);
        self.csg_boxes[cone.csg_box as usize] = csg_box;
        self.csg_faces[first..][..faces.len()].copy_from_slice(&faces);
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

    /// [`SphereData::allows_refracted_nee`].
    fn allows_refracted_nee(&self, sphere: usize) -> u32 {
        let sphere = &self.spheres[sphere];
        let material = &self.materials[sphere.material as usize];
        let center = Vec3::from_array(sphere.center);
        let mut heights = self.area_lights.iter().map(|light| {
            let from_light = center - Vec3::from_array(light.center);
            from_light.dot(Vec3::from_array(light.normal))
        });
        u32::from(
            material.kind == KIND_DIELECTRIC
                && material.alpha == 0.0
                && material.majorant > 0.0
                && material.ior >= 1.0
                && sphere.radius > 0.0
                && heights.all(|height| height >= 1.5 * sphere.radius),
        )
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

    /// Lights without extent are aimed at as often as all others together.
    fn share_light_sampling(&mut self) {
        let has_others = !self.area_lights.is_empty() || self.environment_map.probability > 0.0;
        self.punctual_probability = match (self.punctual_lights.is_empty(), has_others) {
            (true, _) => 0.0,
            (false, true) => 0.5,
            (false, false) => 1.0,
        };
        self.environment_map.probability *= 1.0 - self.punctual_probability;
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

    /// The current camera's rays for an image of `size`.
    pub fn camera_frame(&self, size: ImageSize) -> CameraFrame {
        camera_frame(&self.camera, size)
    }
}

/// A camera's orthonormal basis in f64: the one place where its angle of view becomes a length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraBasis {
    /// Position, m.
    pub eye: DVec3,
    /// Direction of view.
    pub forward: DVec3,
    /// To the right on the image.
    pub right: DVec3,
    /// Upwards on the image.
    pub up: DVec3,
    /// Half the width of the image at distance 1.
    pub half_width: f64,
}

impl CameraBasis {
    /// The basis of a valid camera.
    pub fn new(camera: &Camera) -> Self {
        let eye = camera.eye.as_dvec3();
        let forward = (camera.target.as_dvec3() - eye).normalize();
        let right = forward.cross(camera.up.as_dvec3()).normalize();
        Self {
            eye,
            forward,
            right,
            up: right.cross(forward),
            half_width: (f64::from(camera.fov_x_deg).to_radians() * 0.5).tan(),
        }
    }
}

/// The camera's rays for an image of `size`, computed in f64 and rounded once.
pub fn camera_frame(camera: &Camera, size: ImageSize) -> CameraFrame {
    let CameraBasis {
        forward,
        right,
        up,
        half_width,
        ..
    } = CameraBasis::new(camera);
    let pixel = 2.0 * half_width / f64::from(size.width);
    let corner = forward - right * half_width + up * (0.5 * pixel * f64::from(size.height));
    let array = |v: DVec3| v.as_vec3().to_array();
    let lens_steps = f64::from(camera.lens.aperture_radius_m) / pixel;
    CameraFrame {
        eye: camera.eye.to_array(),
        lens_steps: lens_steps as f32,
        corner: array(corner),
        lens_film: (lens_steps / f64::from(camera.lens.focus_distance_m)) as f32,
        dx: array(right * pixel),
        dy: array(-up * pixel),
        ..CameraFrame::zeroed()
    }
}

/// The fewest spheres that an update's particles take up: a cloud that thins out keeps its kernel.
const PARTICLE_SLOTS_MIN: usize = 1024;

/// The bounds of primitives.
#[cfg(feature = "gpu")]
pub(crate) fn all_bounds<T>(all: &[T]) -> Vec<Bounds>
where
    for<'a> Bounds: From<&'a T>,
{
    all.iter().map(Bounds::from).collect()
}

fn sphere_at(base: SphereData, pose: &ObjectPose) -> SphereData {
    SphereData {
        center: pose.position.to_array(),
        radius: if pose.visible { base.radius } else { 0.0 },
        stripe_axis: ball_axis(pose.rotation, DVec3::Z),
        material: base.material,
        number_axis: ball_axis(pose.rotation, DVec3::X),
        allows_refracted_nee: 0,
    }
}

fn ball_axis(world_from_ball: Quat, axis: DVec3) -> [f32; 3] {
    unit(world_from_ball.as_dquat().normalize() * axis).to_array()
}

fn subtraction_face(solid: &CsgSolid, material: u32) -> CsgFaceData {
    let (kind, a, b) = match *solid {
        CsgSolid::HalfSpace { point, normal } => {
            let n = normal.as_dvec3().normalize();
            let offset = n.dot(point.as_dvec3()) as f32;
            (CSG_FACE_PLANE, n.as_vec3(), Vec3::new(offset, 0.0, 0.0))
        }
        CsgSolid::Cylinder { center, radius } => {
            (CSG_FACE_CYLINDER, center, Vec3::new(radius, 0.0, 0.0))
        }
        CsgSolid::Box { min, max } => (CSG_FACE_INNER_BOX, min, max),
        CsgSolid::ConeExterior {
            axis,
            center,
            radius,
            taper,
            beyond,
        } => {
            let (kind, center, beyond) = match axis {
                Axis::X => (CSG_FACE_CONE_X, center.yzx(), beyond.yzx()),
                Axis::Y => (CSG_FACE_CONE_Y, center.zxy(), beyond.zxy()),
                Axis::Z => (CSG_FACE_CONE_Z, center, beyond),
            };
            (
                kind,
                center.truncate().extend(taper.mul_add(-center.z, radius)),
                Vec3::new(taper, beyond.x, beyond.y),
            )
        }
    };
    CsgFaceData {
        a: a.to_array(),
        kind,
        b: b.to_array(),
        material,
    }
}

fn unit(v: DVec3) -> Vec3 {
    v.normalize().as_vec3()
}

fn area_lights(area_lights: &[AreaLight]) -> Vec<AreaLightData> {
    let mean = |light: &AreaLight| light.radiance.as_dvec3().element_sum() / 3.0;
    let brightest = area_lights
        .iter()
        .map(mean)
        .fold(f64::MIN_POSITIVE, f64::max);
    area_lights
        .iter()
        .map(|light| area_light_data(light, (mean(light) / brightest) as f32))
        .collect()
}

fn area_light_data(light: &AreaLight, brightness: f32) -> AreaLightData {
    let [half_u, half_v] = [light.half_u, light.half_v].map(Vec3::as_dvec3);
    AreaLightData {
        center: light.center.to_array(),
        brightness,
        axis_u: unit(half_u).to_array(),
        length_u: half_u.length() as f32,
        axis_v: unit(half_v).to_array(),
        length_v: half_v.length() as f32,
        normal: unit(half_u.cross(half_v)).to_array(),
        radiance: light.radiance.to_array(),
        ..AreaLightData::zeroed()
    }
}
