//! Construction of scenes in code: shapes, materials and lights with defaults, and a handle of each
//! object that is added.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Quat, Vec3};

use super::{
    AreaLight, Axis, Camera, Environment, EnvironmentMap, ImageTexture, Lens, Material, Mesh,
    Object, ObjectPose, PunctualLight, Scene, Shape,
};
use crate::{Error, SceneError};

/// Which scene a handle belongs to. It is no part of a scene's content: all compare as equal, files and
/// the wire leave it out, and a clone has that of its original.
#[derive(Clone, Copy, Debug)]
pub struct SceneIdentity(u64);

/// One that no scene has had.
impl Default for SceneIdentity {
    fn default() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Self(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

impl PartialEq for SceneIdentity {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// An object of a scene, by which it is moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ObjectHandle {
    scene: u64,
    index: u32,
}

impl Default for Scene {
    fn default() -> Self {
        Self::new()
    }
}

impl Scene {
    /// Nothing yet, under a sky that lights it, seen from four metres away.
    pub fn new() -> Self {
        Self {
            camera: Camera::looking_at([0.0, -4.0, 2.0], [0.0; 3]),
            environment: Environment::default(),
            materials: Default::default(),
            objects: Vec::new(),
            area_lights: Vec::new(),
            textures: Vec::new(),
            environment_map: None,
            punctual_lights: Vec::new(),
            identity: SceneIdentity::default(),
        }
    }

    /// Seen by this camera.
    #[must_use]
    pub fn camera(self, camera: Camera) -> Self {
        Self { camera, ..self }
    }

    /// Under a sky of this radiance, in W·sr⁻¹·m⁻² per channel; 0 for none.
    #[must_use]
    pub fn sky(self, radiance: impl Into<Vec3>) -> Self {
        let radiance = radiance.into();
        let environment = Environment { radiance };
        Self {
            environment,
            ..self
        }
    }

    /// Among the surroundings that a picture shows, as bright as it is.
    #[must_use]
    pub fn surroundings(self, map: EnvironmentMap) -> Self {
        Self {
            environment_map: Some(map),
            ..self.sky(Vec3::ONE)
        }
    }

    /// Adds an object, named after its shape.
    pub fn add(&mut self, shape: impl Into<Shape>, material: Material) -> ObjectHandle {
        let shape = shape.into();
        let name = match shape {
            Shape::Sphere { .. } => "sphere",
            Shape::Box { .. } => "cuboid",
            Shape::CsgBox { .. } => "csg box",
            Shape::TruncatedCone { .. } => "cone",
            Shape::Disc { .. } => "disc",
            Shape::Rectangle { .. } => "rectangle",
            Shape::Mesh(_) => "mesh",
        };
        self.add_named(name, shape, material)
    }

    /// Adds an object that messages call `name`.
    pub fn add_named(
        &mut self,
        name: impl Into<String>,
        shape: impl Into<Shape>,
        material: Material,
    ) -> ObjectHandle {
        let index = u32::try_from(self.objects.len()).unwrap_or(u32::MAX);
        let material = self.material_name(material);
        self.objects.push(Object {
            name: name.into(),
            material,
            shape: shape.into(),
        });
        ObjectHandle {
            scene: self.identity.0,
            index,
        }
    }

    /// Adds a texture; returns its index for [`super::MaterialTextures`].
    pub fn add_texture(&mut self, texture: ImageTexture) -> u32 {
        self.textures.push(texture);
        self.textures.len() as u32 - 1
    }

    /// Adds a light.
    pub fn add_light(&mut self, light: AreaLight) {
        self.area_lights.push(light);
    }

    /// Adds a light without extent.
    pub fn add_punctual_light(&mut self, light: PunctualLight) {
        self.punctual_lights.push(light);
    }

    /// The pose of an object, for a [`super::SceneUpdate`]: `position` in metres.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if the handle is of another scene.
    pub fn pose(
        &self,
        handle: ObjectHandle,
        position: impl Into<Vec3>,
        rotation: Quat,
    ) -> Result<ObjectPose, Error> {
        let count = self.objects.len();
        if handle.scene != self.identity.0 || handle.index as usize >= count {
            return Err(Error::InvalidUpdate(SceneError::rule(format!(
                "the handle of object {} is of another scene than this one of {count} objects: use one that this \
                 scene's `add` returned",
                handle.index
            ))));
        }
        Ok(ObjectPose {
            object: handle.index,
            position: position.into(),
            rotation,
            visible: true,
        })
    }

    /// Where the scene has an object that can move.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if the handle is of another scene or the object cannot move.
    pub fn base_pose(&self, handle: ObjectHandle) -> Result<ObjectPose, Error> {
        let pose = self.pose(handle, Vec3::ZERO, Quat::IDENTITY)?;
        match &self.objects[handle.index as usize].shape {
            Shape::Sphere {
                center, rotation, ..
            }
            | Shape::TruncatedCone {
                center, rotation, ..
            }
            | Shape::Mesh(Mesh {
                center, rotation, ..
            }) => Ok(ObjectPose {
                position: *center,
                rotation: *rotation,
                ..pose
            }),
            _ => Err(Error::InvalidUpdate(SceneError::immovable(handle.index))),
        }
    }

    /// Checks every rule, and that there is something to see and light to see it by.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with the place, the value and the rule.
    pub fn validate_visible(&self) -> Result<(), Error> {
        self.validate()?;
        if self.objects.is_empty() && self.area_lights.is_empty() {
            let sentence = "it has 0 objects and 0 area lights: add at least one of either";
            return Err(Error::InvalidScene(SceneError::rule(sentence)));
        }
        let sky = self.environment.radiance;
        if sky == Vec3::ZERO && !self.has_light() {
            let lights = self.area_lights.len();
            return Err(Error::InvalidScene(SceneError::rule(format!(
                "it has no light: the radiance of its sky is {sky} and none of its {lights} area lights emits; \
                 brighten one of them"
            ))));
        }
        Ok(())
    }

    /// Whether anything but the environment shines.
    fn has_light(&self) -> bool {
        let glows = |material: &Material| match material {
            Material::MetallicRoughness { emission, .. } => *emission != Vec3::ZERO,
            _ => false,
        };
        let areas = self.area_lights.iter().map(|light| light.radiance);
        let points = self.punctual_lights.iter().map(PunctualLight::strength);
        areas.chain(points).any(|strength| strength != Vec3::ZERO)
            || self.materials.values().any(glows)
    }

    /// The name of a material of the scene; it is added if there is none like it.
    fn material_name(&mut self, material: Material) -> String {
        let mut known = self.materials.iter();
        if let Some((name, _)) = known.find(|(_, known)| **known == material) {
            return name.clone();
        }
        let kind = match material {
            Material::Diffuse { .. } => "diffuse",
            Material::SmoothPlastic { .. } => "plastic",
            Material::Coated { .. } => "coated",
            Material::Cloth { .. } => "cloth",
            Material::Conductor { .. } => "metal",
            Material::Dielectric { .. } => "glass",
            Material::MetallicRoughness { .. } => "metallic roughness",
        };
        let names = (self.materials.len()..).map(|number| format!("{kind} {number}"));
        let mut free = names.filter(|name| !self.materials.contains_key(name));
        let name = free.next().unwrap_or_default();
        self.materials.insert(name.clone(), material);
        name
    }
}

impl Camera {
    /// From `eye` to `target`, in metres, with 45° across and z upright, or y if the view is along z.
    pub fn looking_at(eye: impl Into<Vec3>, target: impl Into<Vec3>) -> Self {
        let (eye, target) = (eye.into(), target.into());
        let is_upright = (target - eye).cross(Vec3::Z).length() < 1e-3 * (target - eye).length();
        Self {
            eye,
            target,
            up: if is_upright { Vec3::Y } else { Vec3::Z },
            fov_x_deg: 45.0,
            lens: Lens::default(),
            near_m: 0.0,
        }
    }

    /// With this full horizontal field of view in degrees.
    #[must_use]
    pub fn fov_deg(self, fov_x_deg: f32) -> Self {
        Self { fov_x_deg, ..self }
    }

    /// Without what lies before a plane at this distance from the eye in metres.
    #[must_use]
    pub fn near_m(self, near_m: f32) -> Self {
        Self { near_m, ..self }
    }

    /// With a lens whose aperture has this radius in metres, focused on the target.
    #[must_use]
    pub fn aperture_radius_m(self, aperture_radius_m: f32) -> Self {
        let lens = Lens {
            aperture_radius_m,
            focus_distance_m: self.eye.distance(self.target),
        };
        Self { lens, ..self }
    }

    /// With this direction upright in the image.
    #[must_use]
    pub fn upright(self, up: impl Into<Vec3>) -> Self {
        let up = up.into();
        Self { up, ..self }
    }
}

/// A bright, slightly blue sky.
impl Default for Environment {
    fn default() -> Self {
        let radiance = Vec3::new(0.85, 0.93, 1.0);
        Self { radiance }
    }
}

/// A ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    center: Vec3,
    radius: f32,
    rotation: Quat,
}

impl Sphere {
    /// Round the origin, with a radius in metres.
    pub const fn new(radius: f32) -> Self {
        Self {
            center: Vec3::ZERO,
            radius,
            rotation: Quat::IDENTITY,
        }
    }

    /// With its centre here, in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }

    /// Turned by `world_from_ball`, a unit quaternion.
    #[must_use]
    pub const fn rotated(self, rotation: Quat) -> Self {
        Self { rotation, ..self }
    }
}

impl From<Sphere> for Shape {
    fn from(sphere: Sphere) -> Self {
        Self::Sphere {
            center: sphere.center,
            radius: sphere.radius,
            rotation: sphere.rotation,
        }
    }
}

/// A plane across an axis of the world, as a square of [`Plane::EDGE_M`]: to the eye it has no end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    axis: Axis,
    offset: f32,
}

impl Plane {
    /// Length of an edge in metres.
    pub const EDGE_M: f32 = 2e4;

    /// Where x is `offset` metres.
    pub const fn x(offset: f32) -> Self {
        let axis = Axis::X;
        Self { axis, offset }
    }

    /// Where y is `offset` metres.
    pub const fn y(offset: f32) -> Self {
        let axis = Axis::Y;
        Self { axis, offset }
    }

    /// Where z is `offset` metres: a floor.
    pub const fn z(offset: f32) -> Self {
        let axis = Axis::Z;
        Self { axis, offset }
    }
}

impl From<Plane> for Shape {
    fn from(Plane { axis, offset }: Plane) -> Self {
        let (normal, half_u, half_v) = match axis {
            Axis::X => (Vec3::X, Vec3::Y, Vec3::Z),
            Axis::Y => (Vec3::Y, Vec3::Z, Vec3::X),
            Axis::Z => (Vec3::Z, Vec3::X, Vec3::Y),
        };
        Self::Rectangle {
            center: offset * normal,
            half_u: 0.5 * Plane::EDGE_M * half_u,
            half_v: 0.5 * Plane::EDGE_M * half_v,
        }
    }
}

/// A solid box with faces parallel to the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cuboid {
    size: Vec3,
    center: Vec3,
}

impl Cuboid {
    /// Round the origin, with edges in metres.
    pub fn new(size: impl Into<Vec3>) -> Self {
        Self {
            size: size.into(),
            center: Vec3::ZERO,
        }
    }

    /// With its centre here, in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }
}

impl From<Cuboid> for Shape {
    fn from(Cuboid { size, center }: Cuboid) -> Self {
        Self::Box {
            min: center - 0.5 * size,
            max: center + 0.5 * size,
        }
    }
}

impl AreaLight {
    /// A rectangle of these edges in metres round the origin, that shines downward with a radiance of 1.
    pub fn new(width_m: f32, depth_m: f32) -> Self {
        Self {
            name: "light".to_owned(),
            center: Vec3::ZERO,
            half_u: 0.5 * width_m * Vec3::X,
            half_v: -0.5 * depth_m * Vec3::Y,
            radiance: Vec3::ONE,
            gradient: Vec3::ZERO,
        }
    }

    /// With its centre here, in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }

    /// Turned so that it shines from where it is towards `target`.
    #[must_use]
    pub fn facing(self, target: impl Into<Vec3>) -> Self {
        let normal = (target.into() - self.center).normalize_or(Vec3::NEG_Z);
        let u = normal.any_orthonormal_vector();
        Self {
            half_u: self.half_u.length() * u,
            half_v: self.half_v.length() * normal.cross(u),
            ..self
        }
    }

    /// With this radiance, in W·sr⁻¹·m⁻² per channel.
    #[must_use]
    pub fn radiance(self, radiance: impl Into<Vec3>) -> Self {
        let radiance = radiance.into();
        Self { radiance, ..self }
    }

    /// Emitting this many watts in each channel.
    #[must_use]
    pub fn power(self, watts: f32) -> Self {
        let area = 4.0 * self.half_u.length() * self.half_v.length();
        Self {
            radiance: Vec3::splat(watts / (PI * area)),
            ..self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CompiledScene, SceneUpdate};

    fn ball_on_floor() -> (Scene, ObjectHandle) {
        let mut scene = Scene::new();
        let ball = scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::grey(0.5));
        scene.add(Plane::z(0.0), Material::grey(0.5));
        (scene, ball)
    }

    #[test]
    fn equal_materials_are_one() {
        let (mut scene, _) = ball_on_floor();
        scene.add(Cuboid::new([1.0; 3]), Material::diffuse([0.5; 3]));
        scene.add(Cuboid::new([1.0; 3]), Material::glass());
        assert_eq!(scene.materials.len(), 2);
        scene.validate_visible().unwrap();
    }

    #[test]
    fn handles_move_objects_of_their_own_scene_alone() {
        let (scene, ball) = ball_on_floor();
        let copy = Scene::from_json(&scene.to_json().unwrap()).unwrap();
        let pose = scene.pose(ball, [1.0, 0.0, 0.5], Quat::IDENTITY).unwrap();
        let update = SceneUpdate {
            camera: None,
            poses: vec![pose],
            ..SceneUpdate::default()
        };
        CompiledScene::new(&scene).unwrap().apply(&update).unwrap();
        let why = copy.pose(ball, Vec3::ZERO, Quat::IDENTITY).unwrap_err();
        assert!(why.to_string().contains("of another scene"), "{why}");
        assert_eq!(copy, scene);
    }

    #[test]
    fn faults_name_the_object_and_the_value() {
        let fault = |change: &dyn Fn(&mut Scene)| {
            let (mut scene, _) = ball_on_floor();
            change(&mut scene);
            scene.validate_visible().unwrap_err().to_string()
        };
        let red = fault(&|scene| {
            scene.add(Sphere::new(1.0), Material::diffuse([2.0, 0.0, 0.0]));
        });
        assert!(
            red.contains("material `diffuse 1`: its albedo is [2, 0, 0]"),
            "{red}"
        );
        let flat = fault(&|scene| {
            scene.add_named("pea", Sphere::new(0.0), Material::grey(0.5));
        });
        assert!(flat.contains("object 2 `pea`: its radius is 0 m"), "{flat}");
        let blind = fault(&|scene| scene.camera.eye.x = f32::NAN);
        assert!(blind.contains("the camera's eye is [NaN"), "{blind}");
        let dark = fault(&|scene| scene.environment.radiance = Vec3::ZERO);
        assert!(
            dark.contains("no light") && dark.contains("[0, 0, 0]"),
            "{dark}"
        );
        let empty = fault(&|scene| scene.objects.clear());
        assert!(empty.contains("0 objects"), "{empty}");
    }

    #[test]
    fn lights_shine_where_they_face() {
        let light = AreaLight::new(2.0, 1.0)
            .at([1.0, 2.0, 3.0])
            .facing([1.0, 2.0, 0.0]);
        let normal = light.half_u.cross(light.half_v).normalize();
        assert!(normal.distance(Vec3::NEG_Z) < 1e-6, "{normal}");
        let down = AreaLight::new(2.0, 1.0);
        assert!(down.half_u.cross(down.half_v).z < 0.0);
        // 2 m² · π sr · 10 W/(sr m²)
        let power = down.power(20.0 * PI).radiance;
        assert!(power.distance(Vec3::splat(10.0)) < 1e-5, "{power}");
    }
}
