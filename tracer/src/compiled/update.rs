//! Updates of compiled scenes: poses, camera and particles.

use std::sync::OnceLock;

use glam::{Quat, U16Vec3, Vec3};

use super::cone::Cone;
use super::construction::ball;
use super::material::material_data;
use super::{CompiledScene, Primitive, ShapeKind, SphereData};
use crate::scene::{ObjectPose, ParticleCloud, ParticleForm, SceneUpdate};
use crate::{Error, SceneError};

/// Least number of spheres for an update's particles, so that a shrinking cloud keeps its kernel.
const PARTICLE_SLOTS_MIN: usize = 1024;

impl CompiledScene {
    /// Applies camera, poses and particles of `update`; everything that it does not name returns to
    /// its state in the scene, so that updates may be applied in any order.
    ///
    /// # Errors
    /// [`Error::InvalidUpdate`] if a pose names no sphere, truncated cone or mesh of the scene, names one
    /// twice, or contains a number that is not finite, the camera is degenerate, or particles are out of
    /// range; the scene then is in its original state.
    pub fn apply(&mut self, update: &SceneUpdate) -> Result<(), Error> {
        self.reset();
        let applied = self.try_apply(update);
        if applied.is_err() {
            self.reset();
            self.place_meshes(&[]);
            let _ = self.push_particles(&[]);
        }
        applied.map_err(Error::InvalidUpdate)
    }

    /// Restores spheres, cones, materials and camera of the scene.
    fn reset(&mut self) {
        self.spheres.clone_from(&self.base_spheres);
        self.materials.truncate(self.base_materials);
        self.bvhs[ShapeKind::Sphere as usize] = OnceLock::new();
        for index in 0..self.cones.len() {
            self.place_cone(index, &self.cones[index].1.clone());
        }
        self.camera = self.base_camera;
    }

    fn try_apply(&mut self, update: &SceneUpdate) -> Result<(), SceneError> {
        if let Some(camera) = update.camera {
            camera.validate()?;
            self.camera = camera;
        }
        let mut posed_before = vec![false; self.primitives.len()];
        let mut of_meshes = Vec::new();
        for pose in &update.poses {
            pose.validate()?;
            match self.meshes.has(pose.object) {
                true => of_meshes.push(*pose),
                false => self.apply_pose(pose)?,
            }
            if std::mem::replace(&mut posed_before[pose.object as usize], true) {
                let sentence = format!("object {} is posed twice", pose.object);
                return Err(SceneError::rule(sentence));
            }
        }
        self.place_meshes(&of_meshes);
        update.validate_particles()?;
        self.push_particles(&update.particles)
    }

    /// Adds particles, surfaces first, so that their materials keep their indices when balls appear or
    /// vanish.
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

    /// Appends balls to the scene's own spheres, padded with hidden ones to a power of two: kernels are
    /// specialised for the number of primitives, and need not be rebuilt for each frame of a growing cloud.
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
            let unplaced = ball(Vec3::ZERO, cloud.radius_m, Quat::IDENTITY, material);
            let sphere = |place: &U16Vec3| SphereData {
                center: cloud.center(*place).to_array(),
                ..unplaced
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

    fn apply_pose(&mut self, pose: &ObjectPose) -> Result<(), SceneError> {
        let cone_of = |(_, base): &(Cone, ObjectPose)| base.object == pose.object;
        match self.primitives.get(pose.object as usize) {
            Some(Primitive::Sphere(sphere)) => {
                let sphere = *sphere as usize;
                let base = &self.base_spheres[sphere];
                let radius = if pose.visible { base.radius } else { 0.0 };
                self.spheres[sphere] = ball(pose.position, radius, pose.rotation, base.material);
                self.spheres[sphere].allows_refracted_nee = self.allows_refracted_nee(sphere);
            }
            Some(_) => match self.cones.iter().position(cone_of) {
                Some(cone) => self.place_cone(cone, pose),
                None => return Err(SceneError::immovable(pose.object)),
            },
            None => {
                return Err(SceneError::rule(format!(
                    "object {} is posed, but the scene has {} objects",
                    pose.object,
                    self.primitives.len()
                )));
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
}
