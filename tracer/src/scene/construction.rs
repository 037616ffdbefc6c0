//! Construction of scenes in code: shapes, materials and lights with defaults, and handles of the
//! objects added.

use std::f32::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Quat, Vec3};

use super::{
    AreaLight, Axis, Camera, Environment, EnvironmentMap, ImageTexture, Lens, Material, Mesh,
    Object, ObjectPose, PunctualLight, Scene, Shape,
};
use crate::{Error, SceneError};

/// Identity of a scene, which ties handles to it. It is not part of a scene's content: all
/// identities compare equal, serialisation omits them, and a clone has that of its original.
#[derive(Clone, Copy, Debug)]
pub struct SceneIdentity(u64);

/// A new, unique identity.
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

/// Reference to an object of a scene, for moving it.
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
    /// An empty scene under the default sky, seen from a distance of about 4 m.
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

    /// Sets the camera.
    #[must_use]
    pub fn camera(self, camera: Camera) -> Self {
        Self { camera, ..self }
    }

    /// Sets the radiance of a uniform sky in W·sr⁻¹·m⁻² per channel; 0 for none.
    #[must_use]
    pub fn sky(self, radiance: impl Into<Vec3>) -> Self {
        let radiance = radiance.into();
        let environment = Environment { radiance };
        Self {
            environment,
            ..self
        }
    }

    /// Sets the environment map, at its own brightness.
    #[must_use]
    pub fn surroundings(self, map: EnvironmentMap) -> Self {
        Self {
            environment_map: Some(map),
            ..self.sky(Vec3::ONE)
        }
    }

    /// Adds an object that is named after its shape.
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

    /// Adds an object with a name, which error messages use.
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

    /// Adds an area light.
    pub fn add_light(&mut self, light: AreaLight) {
        self.area_lights.push(light);
    }

    /// Adds a punctual light (without extent).
    pub fn add_punctual_light(&mut self, light: PunctualLight) {
        self.punctual_lights.push(light);
    }

    /// A pose of an object for a [`super::SceneUpdate`], with `position` in metres.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if the handle belongs to another scene.
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

    /// The pose that a movable object has in the scene.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if the handle belongs to another scene or the object is not
    /// movable.
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

    /// Checks all rules, and that there is something visible and a source of light.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with the part, the value and the rule.
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

    /// Whether anything other than the environment emits light.
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

    /// The name of a material in the scene, which is added unless an equal one exists.
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
    /// A camera at `eye` looking at `target`, in metres, with a horizontal field of view of 45°; up
    /// is z, or y if the view is along z.
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

    /// Sets the full horizontal field of view in degrees.
    #[must_use]
    pub fn fov_deg(self, fov_x_deg: f32) -> Self {
        Self { fov_x_deg, ..self }
    }

    /// Sets the distance in metres of the near plane, in front of which nothing is visible.
    #[must_use]
    pub fn near_m(self, near_m: f32) -> Self {
        Self { near_m, ..self }
    }

    /// Sets the radius in metres of the lens's aperture; the lens is focused on the target.
    #[must_use]
    pub fn aperture_radius_m(self, aperture_radius_m: f32) -> Self {
        let lens = Lens {
            aperture_radius_m,
            focus_distance_m: self.eye.distance(self.target),
        };
        Self { lens, ..self }
    }

    /// Sets the direction that is up in the image.
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

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    center: Vec3,
    radius: f32,
    rotation: Quat,
}

impl Sphere {
    /// A sphere around the origin with this radius in metres.
    pub const fn new(radius: f32) -> Self {
        Self {
            center: Vec3::ZERO,
            radius,
            rotation: Quat::IDENTITY,
        }
    }

    /// Sets the centre in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }

    /// Sets the rotation from object to world space, a unit quaternion.
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

/// A plane perpendicular to an axis of the world: a square with edges of [`Plane::EDGE_M`], which
/// looks infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    axis: Axis,
    offset: f32,
}

impl Plane {
    /// Length of the square's edges in metres.
    pub const EDGE_M: f32 = 2e4;

    /// The plane at x = `offset` metres.
    pub const fn x(offset: f32) -> Self {
        let axis = Axis::X;
        Self { axis, offset }
    }

    /// The plane at y = `offset` metres.
    pub const fn y(offset: f32) -> Self {
        let axis = Axis::Y;
        Self { axis, offset }
    }

    /// The plane at z = `offset` metres: a floor.
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
    /// A box around the origin with these edge lengths in metres.
    pub fn new(size: impl Into<Vec3>) -> Self {
        Self {
            size: size.into(),
            center: Vec3::ZERO,
        }
    }

    /// Sets the centre in metres.
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
    /// A rectangle with these edges in metres around the origin, which shines downwards with a
    /// radiance of 1.
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

    /// Sets the centre in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }

    /// Turns the light about its centre so that it shines towards `target`.
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

    /// Sets the radiance in W·sr⁻¹·m⁻² per channel.
    #[must_use]
    pub fn radiance(self, radiance: impl Into<Vec3>) -> Self {
        let radiance = radiance.into();
        Self { radiance, ..self }
    }

    /// Sets the emitted power in watts per channel.
    #[must_use]
    pub fn power(self, watts: f32) -> Self {
        let area = 4.0 * self.half_u.length() * self.half_v.length();
        Self {
            // A Lambertian emitter of area A emits a power of π A L.
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
