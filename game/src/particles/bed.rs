//! Sand, snow, jelly and water on the table, as grains and drops.

use std::sync::Arc;

use carom_billiards::physics::{ParticleBed, ParticleMaterial, ParticleTrack};
use carom_tracer::{Material, ParticleCloud};

/// The particles of a table at a moment.
#[derive(Clone, Debug)]
pub enum BedMoment {
    /// As they lie.
    Lying(Arc<ParticleBed>),
    /// At a time of a shot, in s since the stroke.
    Moving(Arc<ParticleTrack>, f64),
}

impl BedMoment {
    /// What is traced of it: as many clouds as there are colours.
    pub fn clouds(&self) -> Vec<ParticleCloud> {
        match self {
            Self::Lying(bed) => clouds(&ParticleTrack::new(bed), 0.0),
            Self::Moving(track, secs) => clouds(track, *secs),
        }
    }
}

fn clouds(track: &ParticleTrack, secs: f64) -> Vec<ParticleCloud> {
    let places = track.places_at(secs);
    let mut rest = &places[..];
    let mut clouds = Vec::new();
    for group in track.groups() {
        let (grains, others) = rest.split_at(group.count as usize);
        rest = others;
        let [min, max] = track.bounds();
        let grains_of = looks(group.material);
        for (first, (radius, material)) in grains_of.iter().enumerate() {
            let places = grains.iter().skip(first).step_by(grains_of.len());
            clouds.push(ParticleCloud {
                material: *material,
                radius_m: radius * track.spacing_m(),
                min,
                max,
                places: places.copied().collect(),
            });
        }
    }
    clouds.retain(|cloud| !cloud.places.is_empty());
    clouds
}

/// Radii over the distance of particles, and materials, one after the other: of grains seven, which no edge of a patch
/// is a multiple of, so that they make no stripes. Grains of sand and snow are rough and of many sizes; jelly and water
/// are glossy beads that touch, without a surface of their own.
fn looks(material: ParticleMaterial) -> Vec<(f32, Material)> {
    let grains = |albedos: [[f32; 3]; 7]| {
        let radii = [0.52, 0.4, 0.6, 0.36, 0.47, 0.56, 0.43];
        let grains = radii.into_iter().zip(albedos.map(Material::diffuse));
        grains.collect()
    };
    match material {
        ParticleMaterial::Sand => grains([
            [0.58, 0.45, 0.28],
            [0.45, 0.33, 0.2],
            [0.63, 0.52, 0.35],
            [0.3, 0.22, 0.14],
            [0.52, 0.41, 0.26],
            [0.6, 0.47, 0.29],
            [0.4, 0.3, 0.19],
        ]),
        ParticleMaterial::Snow => grains([[0.87, 0.9, 0.94]; 7])
            .into_iter()
            .map(|(radius, snow): (f32, Material)| (1.25 * radius, snow))
            .collect(),
        ParticleMaterial::Jelly => vec![(0.75, Material::plastic([0.55, 0.03, 0.06]))],
        ParticleMaterial::Water => vec![(0.7, Material::plastic([0.12, 0.28, 0.36]))],
    }
}

#[cfg(test)]
mod tests {
    use carom_billiards::physics::{ParticlePatch, ParticlePrecision, Table};
    use carom_tracer::scene::validate::CLOUDS_MAX;

    use super::*;
    use crate::particles::chalk::CLOUDS;

    #[test]
    fn all_materials_and_dust_together_are_an_update() {
        let patch = |(material, column)| ParticlePatch {
            material,
            column,
            row: 0,
        };
        let patches = ParticleMaterial::ALL.into_iter().zip(0..).map(patch);
        let patches: Vec<_> = patches.collect();
        let table = Table::nine_foot();
        let precision = ParticlePrecision::Standard;
        let bed = ParticleBed::new(&table, &[], &patches, precision).unwrap();
        let particles = bed.centers().len();
        let clouds = BedMoment::Lying(Arc::new(bed)).clouds();
        assert!(clouds.len() + CLOUDS <= CLOUDS_MAX, "{}", clouds.len());
        let drawn: usize = clouds.iter().map(|cloud| cloud.places.len()).sum();
        assert_eq!(drawn, particles);
        for cloud in &clouds {
            cloud.validate().unwrap();
        }
    }
}
