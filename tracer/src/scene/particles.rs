//! Particles: clouds of small balls that come with an update, not with the scene.

use glam::{U16Vec3, Vec3};
use serde::{Deserialize, Serialize};

use super::Material;

/// Balls of one material and size, many and elsewhere in each frame: dust, grains, drops.
///
/// Their centres lie on a lattice of [`ParticleCloud::STEPS`] steps along each edge of a box, so that a particle is
/// 6 bytes, in memory and on the wire, and every node sees the same. A box that stays the same from frame to frame
/// makes small differences of places that move little.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticleCloud {
    /// Of all particles; without a pattern, which needs an object.
    pub material: Material,
    /// Of every particle, in metres, above 0.
    pub radius_m: f32,
    /// Corner of the box of the smallest coordinates, in metres.
    pub min: Vec3,
    /// Corner of the largest.
    pub max: Vec3,
    /// Centres: 0 lies at `min`, [`ParticleCloud::STEPS`] at `max`. Particles keep their order from frame to frame.
    pub places: Vec<U16Vec3>,
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
