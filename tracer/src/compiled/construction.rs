//! Construction of a [`CompiledScene`] from a scene description.

use bytemuck::Zeroable as _;
use glam::{DVec3, Quat, Vec3, Vec3Swizzles as _};

use super::all_bounds;
use super::clusters::Clusters;
use super::cone::Cone;
use super::material::with_number_discs;
use super::{
    AreaLightData, BoxData, BvhUse, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z,
    CSG_FACE_CYLINDER, CSG_FACE_INNER_BOX, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, CompiledEnvironment,
    CompiledMeshes, CompiledScene, CompiledTextures, CsgBoxData, CsgFaceData, DiscData,
    EmissiveSurfaces, KIND_DIELECTRIC, Primitive, RectangleData, SphereData,
};
use crate::Error;
use crate::scene::{AreaLight, Axis, CsgSolid, ObjectPose, Scene, Shape, Subtraction};

impl CompiledScene {
    /// Validates `scene` by [`crate::scene::validate`] and lays it out as arrays.
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
            box_clusters: Clusters::NONE,
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
        compiled.find_clusters();
        Ok(compiled)
    }

    /// Finds clusters for rays from the mean of the sphere centres, or from the camera's target without
    /// spheres.
    fn find_clusters(&mut self) {
        let centers = self.spheres.iter().map(|ball| Vec3::from(ball.center));
        let middle = match self.spheres.len() {
            0 => self.camera.target,
            count => centers.sum::<Vec3>() / count as f32,
        };
        self.box_clusters = Clusters::new(&all_bounds(&self.boxes), middle);
        self.csg_clusters = Clusters::new(&all_bounds(&self.csg_boxes), middle);
    }

    fn push(&mut self, shape: &Shape, material: u32, named: &dyn Fn(&str) -> u32) -> Primitive {
        match *shape {
            Shape::Sphere {
                center,
                radius,
                rotation,
            } => {
                let sphere = ball(center, radius, rotation, material);
                Primitive::Sphere(add(&mut self.spheres, sphere))
            }
            Shape::Box { min, max } => {
                let data = BoxData {
                    min: min.to_array(),
                    material,
                    max: max.to_array(),
                    padding: 0,
                };
                Primitive::Box(add(&mut self.boxes, data))
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
            } => self.push_cone((center, rotation), length, radii, material),
            Shape::Disc {
                center,
                normal,
                radius,
            } => {
                let disc = DiscData {
                    center: center.to_array(),
                    radius,
                    normal: unit(normal.as_dvec3()).to_array(),
                    material,
                };
                Primitive::Disc(add(&mut self.discs, disc))
            }
            Shape::Rectangle {
                center,
                half_u,
                half_v,
            } => {
                let rectangle = RectangleData {
                    center: center.to_array(),
                    material,
                    half_u: half_u.to_array(),
                    inv_u2: 1.0 / half_u.length_squared(),
                    half_v: half_v.to_array(),
                    inv_v2: 1.0 / half_v.length_squared(),
                    normal: unit(half_u.as_dvec3().cross(half_v.as_dvec3())).to_array(),
                    padding: 0,
                };
                Primitive::Rectangle(add(&mut self.rectangles, rectangle))
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
        let (min, max) = (min.to_array(), max.to_array());
        let outer = CsgFaceData {
            a: min,
            kind: CSG_FACE_OUTER_BOX,
            b: max,
            material,
        };
        let first_face = add(&mut self.csg_faces, outer);
        self.csg_boxes.push(CsgBoxData {
            min,
            first_face,
            max,
            face_count: 1 + subtractions.len() as u32,
        });
        for Subtraction {
            solid,
            material: own,
        } in subtractions
        {
            let material = own.as_deref().map_or(material, named);
            self.csg_faces.push(subtraction_face(solid, material));
        }
        Primitive::CsgFace(first_face)
    }

    fn push_cone(
        &mut self,
        (position, rotation): (Vec3, Quat),
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
        let pose = ObjectPose {
            object: self.primitives.len() as u32,
            position,
            rotation,
            visible: true,
        };
        let (csg_box, faces) = cone.at(&pose, material);
        self.csg_boxes.push(csg_box);
        self.csg_faces.extend(faces);
        self.cones.push((cone, pose));
        Primitive::CsgFace(cone.first_face)
    }

    /// Value of [`SphereData::allows_refracted_nee`].
    pub(super) fn allows_refracted_nee(&self, sphere: usize) -> u32 {
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
                && material.sampling_density > 0.0
                && material.ior >= 1.0
                && sphere.radius > 0.0
                // Half a radius above the whole ball, that is 1.5 radii above its centre.
                && heights.all(|height| height >= 1.5 * sphere.radius),
        )
    }

    /// Gives punctual lights the same probability as all other lights together.
    fn share_light_sampling(&mut self) {
        let has_others = !self.area_lights.is_empty() || self.environment_map.probability > 0.0;
        self.punctual_probability = match (self.punctual_lights.is_empty(), has_others) {
            (true, _) => 0.0,
            (false, true) => 0.5,
            (false, false) => 1.0,
        };
        self.environment_map.probability *= 1.0 - self.punctual_probability;
    }
}

/// Appends `one` and returns its index.
fn add<T>(all: &mut Vec<T>, one: T) -> u32 {
    all.push(one);
    all.len() as u32 - 1
}

/// A sphere without refracted next-event estimation.
pub(super) fn ball(center: Vec3, radius: f32, rotation: Quat, material: u32) -> SphereData {
    let axis = |axis: DVec3| unit(rotation.as_dquat().normalize() * axis).to_array();
    SphereData {
        center: center.to_array(),
        radius,
        stripe_axis: axis(DVec3::Z),
        material,
        number_axis: axis(DVec3::X),
        allows_refracted_nee: 0,
    }
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
                // Radius at coordinate 0 along the axis, so that it is linear in the coordinate.
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
    // Relative to the brightest light, so that sampling weights stay in the range of f32.
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
        gradient: (light.radiance * light.gradient).to_array(),
        slope: (half_u / half_u.length_squared()).as_vec3().to_array(),
        ..AreaLightData::zeroed()
    }
}
