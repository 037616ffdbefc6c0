//! Regions to be filled with particles.

use glam::{DVec3, Vec3};

use crate::error::{Result, check_finite, check_range};

/// Volume to be filled with particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Region {
    /// An axis-aligned box.
    Cuboid {
        /// Least corner, in m.
        min: Vec3,
        /// Greatest corner, in m.
        max: Vec3,
    },
    /// A ball.
    Ball {
        /// Centre, in m.
        center: Vec3,
        /// Radius, in m.
        radius_m: f32,
    },
    /// A cylinder along z.
    Cylinder {
        /// Centre of its lower end, in m.
        base: Vec3,
        /// Radius, in m.
        radius_m: f32,
        /// Height, in m.
        height_m: f32,
    },
}

impl Region {
    pub(crate) fn validate(&self) -> Result<()> {
        let (min, max) = self.bounds();
        check_finite("corner of a region", min.as_vec3())?;
        check_finite("corner of a region", max.as_vec3())?;
        let edge = (max - min).min_element();
        check_range("shortest edge of a region in m", edge, 1e-9, 1e6)
    }

    /// Volume, in m³.
    pub fn volume_m3(&self) -> f64 {
        let (min, max) = self.bounds();
        let box_m3 = (max - min).element_product();
        match self {
            Self::Cuboid { .. } => box_m3,
            Self::Ball { .. } => box_m3 * std::f64::consts::PI / 6.0,
            Self::Cylinder { .. } => box_m3 * std::f64::consts::FRAC_PI_4,
        }
    }

    /// Approximate number of particles that fill it.
    pub(crate) fn count(&self, spacing_m: f32) -> f64 {
        self.volume_m3() / f64::from(spacing_m).powi(3)
    }

    /// Positions in m of particles on a lattice of approximately a spacing in m, which divides the bounding
    /// box evenly.
    pub(crate) fn places(&self, spacing_m: f32) -> Vec<Vec3> {
        let (min, max) = self.bounds();
        let size = max - min;
        let counts = (size / f64::from(spacing_m)).round().max(DVec3::ONE);
        let spacing = size / counts;
        let [nx, ny, nz] = counts.to_array().map(|count| count as u32);
        let mut places = Vec::new();
        for x in 0..nx {
            for y in 0..ny {
                for z in 0..nz {
                    let steps = DVec3::new(x.into(), y.into(), z.into()) + 0.5;
                    let place = (min + steps * spacing).as_vec3();
                    if self.contains(place) {
                        places.push(place);
                    }
                }
            }
        }
        places
    }

    fn contains(&self, place: Vec3) -> bool {
        match *self {
            Self::Cuboid { .. } => true,
            Self::Ball { center, radius_m } => place.distance(center) < radius_m,
            Self::Cylinder { base, radius_m, .. } => {
                place.truncate().distance(base.truncate()) < radius_m
            }
        }
    }

    fn bounds(&self) -> (DVec3, DVec3) {
        match *self {
            Self::Cuboid { min, max } => (min.as_dvec3(), max.as_dvec3()),
            Self::Ball { center, radius_m } => {
                let (center, radius) = (center.as_dvec3(), f64::from(radius_m));
                (center - radius, center + radius)
            }
            Self::Cylinder {
                base,
                radius_m,
                height_m,
            } => {
                let (base, radius) = (base.as_dvec3(), f64::from(radius_m));
                let low = DVec3::new(radius, radius, 0.0);
                let high = DVec3::new(radius, radius, height_m.into());
                (base - low, base + high)
            }
        }
    }
}
