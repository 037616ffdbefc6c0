//! Particles: clouds that are part of an update rather than of the scene, rendered as small balls
//! or as the surface of what they fill.

use glam::{U16Vec3, Vec3};
use serde::{Deserialize, Serialize};

use super::Material;

/// Particles of one material and size, which are many and move in every frame: dust, grains, drops,
/// a liquid.
///
/// Their centres are quantised to [`ParticleCloud::STEPS`] steps along each edge of a box, so that
/// a particle takes 6 bytes in memory and on the wire, and all nodes have the same values. If the
/// box stays the same, positions that move little have small differences between frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticleCloud {
    /// Material of all particles; must not have a pattern.
    pub material: Material,
    /// Radius of each particle's ball in metres, above 0.
    pub radius_m: f32,
    /// How the particles are rendered.
    pub form: ParticleForm,
    /// Corner of the box with the smallest coordinates, in metres.
    pub min: Vec3,
    /// Corner of the box with the largest coordinates, in metres.
    pub max: Vec3,
    /// Quantised centres: 0 is at `min`, [`ParticleCloud::STEPS`] at `max`. Particles keep their
    /// order from frame to frame.
    pub places: Vec<U16Vec3>,
}

/// How particles are rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ParticleForm {
    /// Each particle as a ball.
    #[default]
    Balls,
    /// All particles as the closed surface of a liquid or a soft body, an isosurface of their
    /// smoothed density; an isolated particle becomes a drop with a quarter of the smoothing
    /// radius. Each node computes it again for each frame in which particles have moved, as about
    /// six triangles per particle (`carom-bench particles --part surface` measures the cost).
    Surface {
        /// Radius in metres within which particles form one surface: about 2.5 times their spacing.
        /// A larger one makes it smoother and rounds edges, a smaller one shows individual
        /// particles.
        smoothing_m: f32,
        /// Height in metres of a plane at which the surface ends; particles below are omitted.
        /// Slightly below the floor it leaves no gap.
        floor_m: f32,
    },
}

impl ParticleCloud {
    /// Number of quantisation steps along an edge of the box.
    pub const STEPS: u16 = u16::MAX;

    /// Centre in metres of quantised coordinates.
    pub fn center(&self, place: U16Vec3) -> Vec3 {
        let share = place.as_vec3() / f32::from(Self::STEPS);
        self.min + share * (self.max - self.min)
    }

    /// The quantised coordinates nearest to a point in metres; points outside the box are clamped
    /// to its surface.
    pub fn place(&self, center: Vec3) -> U16Vec3 {
        let share = (center - self.min) / (self.max - self.min);
        // Casts saturate at both ends and turn NaN into 0.
        (share * f32::from(Self::STEPS) + 0.5).as_u16vec3()
    }

    /// Maximum quantisation error in metres of a point in the box: half a step along each edge.
    pub fn error_m(&self) -> f32 {
        0.5 * (self.max - self.min).length() / f32::from(Self::STEPS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_as_near_as_half_a_step() {
        let cloud = ParticleCloud {
            material: Material::grey(0.5),
            radius_m: 1e-3,
            form: ParticleForm::Balls,
            min: Vec3::new(-0.3, 0.1, 0.0),
            max: Vec3::new(0.2, 0.4, 0.05),
            places: Vec::new(),
        };
        for index in 0..1000 {
            let [x, y, z, _] = crate::sampling::uniforms(index, 1, 2, 3);
            let point = cloud.min + Vec3::new(x, y, z) * (cloud.max - cloud.min);
            let found = cloud.center(cloud.place(point));
            // Plus one ULP of a coordinate.
            assert!(found.distance(point) <= cloud.error_m() + 1e-7, "{point}");
        }
        let outside = cloud.place(Vec3::new(9.0, f32::NAN, -9.0));
        assert_eq!(outside, U16Vec3::new(u16::MAX, 0, 0));
    }
}
