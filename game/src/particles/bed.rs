//! Particles on the table for the tracer: sand and snow as grains, marbles as balls, jelly and water as
//! surfaces.

use std::sync::Arc;

use carom_billiards::physics::{ParticleBed, ParticleMaterial, ParticleTrack};
use carom_tracer::{Material, ParticleCloud, ParticleForm};
use glam::Vec3;

/// The particles of a table at a moment.
#[derive(Clone, Debug)]
pub enum BedMoment {
    /// At rest.
    Lying(Arc<ParticleBed>),
    /// During a shot, at a time in s since the stroke.
    Moving(Arc<ParticleTrack>, f64),
}

impl BedMoment {
    /// The clouds to be traced, on a cloth of this albedo: one for each material of the tracer.
    pub fn clouds(&self, cloth: Vec3) -> Vec<ParticleCloud> {
        match self {
            Self::Lying(bed) => clouds(&ParticleTrack::new(bed), 0.0, cloth),
            Self::Moving(track, secs) => clouds(track, *secs, cloth),
        }
    }
}

fn clouds(track: &ParticleTrack, secs: f64, cloth: Vec3) -> Vec<ParticleCloud> {
    let places = track.places_at(secs);
    let mut rest = &places[..];
    let mut clouds = Vec::new();
    for group in track.groups() {
        let (grains, others) = rest.split_at(group.count as usize);
        rest = others;
        let [min, max] = track.bounds();
        let spacing_m = track.spacing_m();
        let grains_of = looks(group.material, cloth, spacing_m);
        for (first, look) in grains_of.iter().enumerate() {
            let places = grains.iter().skip(first).step_by(grains_of.len());
            clouds.push(ParticleCloud {
                material: look.material,
                radius_m: look.radius * spacing_m,
                form: match look.smoothing {
                    None => ParticleForm::Balls,
                    Some(smoothing) => ParticleForm::Surface {
                        smoothing_m: smoothing * spacing_m,
                        floor_m: FLOOR_M,
                    },
                },
                min,
                max,
                places: places.copied().collect(),
            });
        }
    }
    clouds.retain(|cloud| !cloud.places.is_empty());
    clouds
}

/// Smoothing radius of surfaces over the particles' spacing; greater for jelly, which has no thin parts.
const SMOOTHING_OF_JELLY: f32 = 3.0;
const SMOOTHING_OF_WATER: f32 = 2.5;
/// Lower end of surfaces, in m: below the cloth, so that there is no visible gap.
const FLOOR_M: f32 = -2e-4;

/// Appearance of particles.
struct ParticleLook {
    /// Radius of each as a ball, over the particles' spacing.
    radius: f32,
    material: Material,
    /// Smoothing radius of their common surface over the particles' spacing; none for grains.
    smoothing: Option<f32>,
}

/// Appearances that successive particles of a material cycle through. Sand and snow have seven, of
/// different sizes: no edge of a patch is a multiple of seven, so that they form no stripes.
///
/// Water is a smooth coating with the tinted cloth as its base, which describes a thin clear layer on a
/// diffuse ground with internal reflection. As a dielectric above the cloth, light paths would find the
/// small lamps by chance only: the picture is then mostly noise at 64 samples, and the wet cloth dark at
/// 16.
fn looks(material: ParticleMaterial, cloth: Vec3, spacing_m: f32) -> Vec<ParticleLook> {
    let grains = |size: f32, albedos: [[f32; 3]; 7]| -> Vec<ParticleLook> {
        let radii = [0.52, 0.4, 0.6, 0.36, 0.47, 0.56, 0.43];
        let grains = radii.into_iter().zip(albedos.map(Material::diffuse));
        let grains = grains.map(|(radius, material)| ParticleLook {
            radius: size * radius,
            material,
            smoothing: None,
        });
        grains.collect()
    };
    let body = |smoothing: f32, ior: f32, albedo: Vec3| {
        vec![ParticleLook {
            radius: 0.62,
            material: Material::SmoothPlastic {
                albedo,
                ior,
                internal_reflectance: None,
                stripe: None,
            },
            smoothing: Some(smoothing),
        }]
    };
    match material {
        ParticleMaterial::Sand => grains(
            1.0,
            [
                [0.58, 0.45, 0.28],
                [0.45, 0.33, 0.2],
                [0.63, 0.52, 0.35],
                [0.3, 0.22, 0.14],
                [0.52, 0.41, 0.26],
                [0.6, 0.47, 0.29],
                [0.4, 0.3, 0.19],
            ],
        ),
        ParticleMaterial::Snow => grains(1.25, [[0.87, 0.9, 0.94]; 7]),
        ParticleMaterial::Jelly => body(SMOOTHING_OF_JELLY, 1.35, JELLY),
        ParticleMaterial::Water => body(SMOOTHING_OF_WATER, 1.33, DRINK * cloth),
        ParticleMaterial::Marbles => {
            let marble = |albedo: [f32; 3]| ParticleLook {
                // The simulated radius less the rounding of positions.
                radius: 0.99 * ParticleMaterial::MARBLE_RADIUS_M as f32 / spacing_m,
                material: Material::plastic(albedo),
                smoothing: None,
            };
            MARBLES.map(marble).into()
        }
    }
}

/// Albedos of marbles of coloured glass.
const MARBLES: [[f32; 3]; 5] = [
    [0.03, 0.16, 0.5],
    [0.55, 0.05, 0.03],
    [0.04, 0.36, 0.12],
    [0.75, 0.45, 0.05],
    [0.7, 0.72, 0.75],
];
/// Albedo of jelly.
const JELLY: Vec3 = Vec3::new(0.42, 0.012, 0.022);
/// Transmittance of the spilt drink on the way to the cloth and back.
const DRINK: Vec3 = Vec3::new(0.9, 0.75, 0.55);

#[cfg(test)]
mod tests {
    use carom_billiards::physics::{ParticlePatch, ParticlePrecision, Table};
    use carom_tracer::scene::validate::CLOUDS_MAX;

    use super::*;
    use crate::particles::chalk::CLOUDS;

    #[test]
    fn all_materials_but_marbles_and_dust_together_are_an_update() {
        let patch = |(material, column)| ParticlePatch {
            material,
            column,
            row: 0,
        };
        let materials = ParticleMaterial::ALL.into_iter();
        let materials = materials.filter(|material| *material != ParticleMaterial::Marbles);
        let patches = materials.zip(0..).map(patch);
        let patches: Vec<_> = patches.collect();
        let table = Table::nine_foot();
        let precision = ParticlePrecision::Standard;
        let bed = ParticleBed::new(&table, &[], &patches, precision).unwrap();
        let particles = bed.centers().len();
        let clouds = BedMoment::Lying(Arc::new(bed)).clouds(Vec3::splat(0.1));
        assert!(clouds.len() + CLOUDS <= CLOUDS_MAX, "{}", clouds.len());
        let drawn: usize = clouds.iter().map(|cloud| cloud.places.len()).sum();
        assert_eq!(drawn, particles);
        for cloud in &clouds {
            cloud.validate().unwrap();
        }
    }
}
