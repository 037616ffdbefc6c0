//! Particles: clouds that come with an update, not with the scene, drawn as small balls or as the surface of what they fill.

use glam::{U16Vec3, Vec3};
use serde::{Deserialize, Serialize};

use super::Material;

/// Particles of one material and size, many and elsewhere in each frame: dust, grains, drops, a liquid.
///
/// Their centres lie on a lattice of [`ParticleCloud::STEPS`] steps along each edge of a box, so that a particle is
/// 6 bytes, in memory and on the wire, and every node sees the same. A box that stays the same from frame to frame
/// makes small differences of places that move little.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticleCloud {
    /// Of all particles; without a pattern, which needs an object.
    pub material: Material,
    /// Of every particle's ball, in metres, above 0.
    pub radius_m: f32,
    /// How they are drawn.
    pub form: ParticleForm,
    /// Corner of the box of the smallest coordinates, in metres.
    pub min: Vec3,
    /// Corner of the largest.
    pub max: Vec3,
    /// Centres: 0 lies at `min`, [`ParticleCloud::STEPS`] at `max`. Particles keep their order from frame to frame.
    pub places: Vec<U16Vec3>,
}

/// How particles are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ParticleForm {
    /// Each as a ball.
    #[default]
    Balls,
    /// All together as the closed surface of a liquid or a soft body, whose density is smoothed: a lone particle becomes a
    /// drop whose radius is a quarter of the smoothing radius. Each node makes it anew for each frame in which particles have
    /// moved, as some six triangles a particle (`carom-bench particles --part surface` says what that costs).
    Surface {
        /// Radius within which particles make one surface, in metres: about 2.5 times their distance. A larger one makes it
        /// smoother and rounds edges off, a smaller one shows single particles.
        smoothing_m: f32,
        /// Height of a plane that the surface ends on, in metres; particles below are left out. A little below what
        /// they lie on leaves no gap.
        floor_m: f32,
    },
}

impl ParticleCloud {
    /// Steps of the lattice along an edge of the box.
    pub const STEPS: u16 = u16::MAX;

    /// Centre of a place, in metres.
    pub fn center(&self, place: U16Vec3) -> Vec3 {
        let share = place.as_vec3() / f32::from(Self::STEPS);
        self.min + share * (self.max - self.min)
    }

    /// The place nearest to a point in metres; of one outside the box, that nearest on its surface.
    pub fn place(&self, center: Vec3) -> U16Vec3 {
        let share = (center - self.min) / (self.max - self.min);
        // Casts cut off at both ends, and send what is no number to 0.
        (share * f32::from(Self::STEPS) + 0.5).as_u16vec3()
    }

    /// The farthest that a particle in the box can lie from its place, in metres: half a step along each edge.
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
            // An ulp of a coordinate besides.
            assert!(found.distance(point) <= cloud.error_m() + 1e-7, "{point}");
        }
        let outside = cloud.place(Vec3::new(9.0, f32::NAN, -9.0));
        assert_eq!(outside, U16Vec3::new(u16::MAX, 0, 0));
    }
}
