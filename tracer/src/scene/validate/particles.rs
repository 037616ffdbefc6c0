//! Validation of an update's particles.

use glam::Vec3;

use super::shape::corners;
use super::{
    CLOUDS_MAX, Check, PARTICLES_MAX, SMOOTHING_RADII_MAX, check_material, count, extent, position,
    require,
};
use crate::SceneError;
use crate::scene::{Material, ParticleCloud, ParticleForm, SceneUpdate};

impl SceneUpdate {
    /// Checks the number of particles, and each cloud.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate_particles(&self) -> Check {
        count("clouds of particles", self.particles.len(), CLOUDS_MAX)?;
        let particles = self.particles.iter().map(|cloud| cloud.places.len());
        count("particles", particles.sum(), PARTICLES_MAX)?;
        for (index, cloud) in self.particles.iter().enumerate() {
            let checked = cloud.validate();
            checked.map_err(|fault| fault.of_cloud(index))?;
        }
        Ok(())
    }
}

impl SceneError {
    /// The fault as one of a cloud of particles.
    pub(crate) fn of_cloud(self, index: usize) -> Self {
        self.of(format!("cloud {index} of particles"))
    }
}

impl ParticleCloud {
    /// Checks material, radius, box and form.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate(&self) -> Check {
        check_material(&self.material)?;
        let is_patterned = matches!(
            self.material,
            Material::Coated { .. } | Material::Cloth { marks: Some(_), .. }
        );
        require(!is_patterned && !self.material.has_textures(), || {
            SceneError::rule(
                "its material has a pattern, which only objects can have: give it a plain one",
            )
        })?;
        extent("its radius", self.radius_m)?;
        corners(self.min, self.max)?;
        let ParticleForm::Surface {
            smoothing_m,
            floor_m,
        } = self.form
        else {
            return require(!self.material.is_thin_wall(), || {
                SceneError::rule(
                    "its material has transmission, which makes it a thin wall, but its particles are balls: make it \
                     a dielectric",
                )
            });
        };
        extent("its smoothing radius", smoothing_m)?;
        position("its floor", Vec3::Z * floor_m)?;
        let edge_m = (self.max - self.min).max_element();
        require(edge_m <= SMOOTHING_RADII_MAX * smoothing_m, || {
            SceneError::rule(format!(
                "an edge of its box is {edge_m} m, but its smoothing radius {smoothing_m} m: the edge may be at most \
                 {SMOOTHING_RADII_MAX} times that"
            ))
        })
    }
}
