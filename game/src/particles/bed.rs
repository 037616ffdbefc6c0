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

/// Radii over the distance of particles, and materials, one after the other. Grains of sand and snow are rough and of
/// many sizes; jelly and water are glossy beads that touch, without a surface of their own.
fn looks(material: ParticleMaterial) -> Vec<(f32, Material)> {
    let grain = |radius, albedo: [f32; 3]| (radius, Material::diffuse(albedo));
    match material {
        ParticleMaterial::Sand => vec![
            grain(0.52, [0.58, 0.45, 0.28]),
            grain(0.4, [0.45, 0.33, 0.2]),
            grain(0.6, [0.63, 0.52, 0.35]),
            grain(0.47, [0.52, 0.41, 0.26]),
            grain(0.34, [0.3, 0.22, 0.14]),
        ],
        ParticleMaterial::Snow => vec![
            grain(0.6, [0.86, 0.89, 0.93]),
            grain(0.45, [0.9, 0.92, 0.95]),
            grain(0.7, [0.84, 0.88, 0.93]),
        ],
        ParticleMaterial::Jelly => vec![(0.75, Material::plastic([0.55, 0.03, 0.06]))],
        ParticleMaterial::Water => vec![(0.7, Material::plastic([0.12, 0.28, 0.36]))],
    }
}
