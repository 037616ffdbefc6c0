//! Surface reconstruction: the surface of the liquid or soft body that a cloud's particles fill, as a
//! closed mesh.
//!
//! Each particle is moved towards the mean of its neighbours, which smooths the bumps of single particles
//! (Yu and Turk, "Reconstructing Surfaces of Particle-Based Fluids Using Anisotropic Kernels", ACM TOG
//! 32(1), 2013, section 3.2), and adds a kernel, normalised by the density of the particles around it: so
//! the density is about 1 inside, and the isovalue ½ bounds a pool as well as a single drop, whose kernel
//! is narrower (section 3.3). The isosurface is extracted by surface nets ([`nets`]), closed by a plane at
//! the floor.
//!
//! Only additions, products, quotients and square roots of f32 in a fixed order are used, so that every
//! node computes the same bits.

mod density;
mod nets;

use glam::{IVec3, Vec3};

use self::density::DensityGrid;
use crate::SceneError;
use crate::scene::ParticleCloud;

/// Maximum number of blocks, of 512 nodes, of a grid: 67 MB of densities, and as much of indices.
pub(crate) const BLOCKS_MAX: usize = 1 << 15;
/// Nodes of the grid along the smoothing radius. Costs grow with the cube; with fewer, small drops are
/// lost.
const NODES_PER_RADIUS: f32 = 4.0;
/// Kernel radius of an isolated particle relative to that of one among many.
const LONE_RADIUS: f32 = 0.7;
/// Density, relative to that at an isolated particle, from which the full kernel radius is used: that of a
/// film one particle thick.
const FILM_DENSITY: f32 = 4.5;
/// Fraction by which particles are moved to the mean of their neighbours.
const CENTERING: f32 = 0.9;
/// Maximum number of particles that are evaluated per cell of the smoothing radius; fuller cells are
/// subsampled with a stride.
const NEIGHBOURS_MAX: usize = 64;

/// A triangle mesh with vertex normals.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SurfaceMesh {
    pub(crate) positions: Vec<Vec3>,
    /// Unit vectors, outwards.
    pub(crate) normals: Vec<Vec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A particle as a density kernel.
#[derive(Clone, Copy, Debug)]
struct Drop {
    center: Vec3,
    /// Radius of its kernel's support, metres.
    radius_m: f32,
    /// Kernel value at its centre: the reciprocal of the density of particles there.
    weight: f32,
}

impl SurfaceMesh {
    /// Surface of a valid cloud. Particles whose centres are below `floor_m` are omitted, and nothing
    /// extends below it.
    ///
    /// # Errors
    /// [`SceneError::Rule`] if particles are so far apart that the grid would take too much memory.
    pub(crate) fn new(
        cloud: &ParticleCloud,
        smoothing_m: f32,
        floor_m: f32,
    ) -> Result<Self, SceneError> {
        if cloud.places.is_empty() {
            return Ok(Self::default());
        }
        // A floor far below the particles has no effect; the bound keeps coordinates of blocks small.
        let floor_m = floor_m.max(cloud.min.z - 2.0 * smoothing_m);
        let cell_m = smoothing_m / NODES_PER_RADIUS;
        let mut origin = cloud.min - 2.0 * smoothing_m;
        origin.z = floor_m - 1.5 * cell_m;
        let mut drops = drops(cloud, smoothing_m);
        drops.retain(|drop| drop.center.z >= floor_m);
        let grid = DensityGrid::new(&drops, origin, cell_m)?;
        Ok(nets::surface(&grid))
    }
}

/// Kernels of the particles, sorted by cells of the smoothing radius, so that neighbours are near each
/// other in memory.
fn drops(cloud: &ParticleCloud, smoothing_m: f32) -> Vec<Drop> {
    let cell = |center: Vec3| ((center - cloud.min) / smoothing_m).as_ivec3();
    let mut centers: Vec<(u64, Vec3)> = (cloud.places.iter())
        .map(|place| {
            let center = cloud.center(*place);
            (key(cell(center)), center)
        })
        .collect();
    centers.sort_by_key(|(key, _)| *key);
    let mut cells: Vec<(u64, u32)> = Vec::new();
    for ((key, _), index) in centers.iter().zip(0u32..) {
        if cells.last().is_none_or(|(last, _)| last != key) {
            cells.push((*key, index));
        }
    }
    let members = |key: u64| {
        let at = cells.binary_search_by_key(&key, |(key, _)| *key).ok()?;
        let end = cells
            .get(at + 1)
            .map_or(centers.len(), |(_, first)| *first as usize);
        Some(&centers[cells[at].1 as usize..end])
    };
    let mut drops = Vec::with_capacity(centers.len());
    for (index, (first_key, first)) in cells.iter().enumerate() {
        let end = cells
            .get(index + 1)
            .map_or(centers.len(), |(_, first)| *first as usize);
        let own = &centers[*first as usize..end];
        let place = unkey(*first_key);
        let around = (-1..=1)
            .flat_map(|z| (-1..=1).flat_map(move |y| (-1..=1).map(move |x| IVec3::new(x, y, z))));
        let around: Vec<&[(u64, Vec3)]> = around
            .map(|step| place + step)
            .filter(|place| place.cmpge(IVec3::ZERO).all())
            .filter_map(|place| members(key(place)))
            .collect();
        drops.extend(
            own.iter()
                .map(|(_, center)| drop_among(*center, &around, smoothing_m)),
        );
    }
    drops
}

/// Kernel of a particle, given the particles in the cells around it.
fn drop_among(center: Vec3, around: &[&[(u64, Vec3)]], smoothing_m: f32) -> Drop {
    let inverse_square = 1.0 / (smoothing_m * smoothing_m);
    let (mut density, mut offset) = (0.0, Vec3::ZERO);
    for cell in around {
        let stride = cell.len().div_ceil(NEIGHBOURS_MAX);
        for (_, other) in cell.iter().step_by(stride) {
            let way = *other - center;
            let left = 1.0 - way.length_squared() * inverse_square;
            if left > 0.0 {
                // Each evaluated particle represents `stride` particles of its cell.
                let weight = stride as f32 * left * left * left;
                density += weight;
                offset += weight * way;
            }
        }
    }
    // In a subsampled cell the particle itself, whose weight is 1, may not be among those evaluated.
    let density = density.max(1.0);
    // 0 for an isolated particle, whose density is its own weight of 1.
    let share = ((density - 1.0) / (FILM_DENSITY - 1.0)).min(1.0);
    Drop {
        center: center + offset * (CENTERING / density),
        radius_m: smoothing_m * (LONE_RADIUS + (1.0 - LONE_RADIUS) * share),
        weight: 1.0 / density,
    }
}

/// Packs coordinates in [0, 2²¹) into one sortable number.
fn key(place: IVec3) -> u64 {
    let [x, y, z] = place.to_array().map(|at| at as u64 & KEY_MASK);
    z << 42 | y << 21 | x
}

/// Inverse of [`key`].
fn unkey(key: u64) -> IVec3 {
    let at = |shift: u32| (key >> shift & KEY_MASK) as i32;
    IVec3::new(at(0), at(21), at(42))
}

const KEY_MASK: u64 = (1 << 21) - 1;

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::Material;
    use crate::sampling::uniforms;
    use crate::scene::ParticleForm;

    const SPACING_M: f32 = 6.25e-3;
    const SMOOTHING_M: f32 = 2.5 * SPACING_M;

    fn cloud(centers: impl IntoIterator<Item = Vec3>) -> ParticleCloud {
        let mut cloud = ParticleCloud {
            material: Material::grey(0.5),
            radius_m: SPACING_M,
            form: ParticleForm::Balls,
            min: Vec3::new(-1.0, -1.0, -0.01),
            max: Vec3::new(1.0, 1.0, 0.5),
            places: Vec::new(),
        };
        let places = centers.into_iter().map(|center| cloud.place(center));
        cloud.places = places.collect();
        cloud
    }

    /// Particles in a box on the floor, slightly off a lattice.
    fn heap(count: [u32; 3], shift: Vec3) -> Vec<Vec3> {
        let [nx, ny, nz] = count;
        let indices = (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny]);
        let place = |[x, y, z]: [u32; 3]| {
            let [a, b, c, _] = uniforms(x + 1000 * y, z, 3, 1);
            let at = Vec3::new(x as f32, y as f32, z as f32) + 0.5;
            shift + SPACING_M * (at + 0.3 * (Vec3::new(a, b, c) - 0.5))
        };
        indices.map(place).collect()
    }

    fn surface(centers: Vec<Vec3>, floor_m: f32) -> SurfaceMesh {
        SurfaceMesh::new(&cloud(centers), SMOOTHING_M, floor_m).unwrap()
    }

    fn volume_m3(mesh: &SurfaceMesh) -> f64 {
        let volumes = mesh.triangles.iter().map(|corners| {
            let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize].as_dvec3());
            a.dot(b.cross(c)) / 6.0
        });
        volumes.sum()
    }

    /// A closed mesh has as many triangles along each edge in one direction as in the other.
    fn assert_closed(mesh: &SurfaceMesh) {
        let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let way = if from < to { 1 } else { -1 };
                *edges.entry([*from.min(to), *from.max(to)]).or_default() += way;
            }
        }
        let open = edges.iter().find(|(_, balance)| **balance != 0);
        assert_eq!(open, None);
    }

    #[test]
    fn surfaces_are_closed_and_wound_outwards() {
        let scattered = (0..500).map(|i| {
            let [x, y, z, _] = uniforms(i, 1, 2, 3);
            Vec3::new(x, y, z) * 0.1 - Vec3::new(0.0, 0.0, 0.005)
        });
        for (centers, floor_m) in [
            (vec![Vec3::new(0.1, 0.2, 0.3)], -1e6),
            (heap([10, 8, 4], Vec3::ZERO), 0.0),
            (scattered.clone().collect(), 0.0),
            (scattered.collect(), -1e6),
        ] {
            let mesh = surface(centers, floor_m);
            assert!(!mesh.triangles.is_empty());
            assert_closed(&mesh);
            assert!(volume_m3(&mesh) > 0.0);
            for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
                assert!(position.z >= floor_m, "{position}");
                assert!((normal.length() - 1.0).abs() < 1e-5, "{normal}");
            }
        }
    }

    /// An isolated particle gives a ball of about its own volume.
    #[test]
    fn lone_particles_are_small_drops() {
        let mesh = surface(vec![Vec3::new(0.1, 0.2, 0.3)], 0.0);
        let share = volume_m3(&mesh) / f64::from(SPACING_M).powi(3);
        assert!((0.5..1.5).contains(&share), "{share}");
        // So far apart that they are isolated.
        let many = (0..40).map(|i| Vec3::new(0.04 * i as f32 - 0.8, 0.0, 0.2));
        let all = volume_m3(&surface(many.collect(), 0.0)) / f64::from(SPACING_M).powi(3);
        assert!((0.5..1.5).contains(&(all / 40.0)), "{all}");
    }

    /// Two layers of particles slightly off a lattice give a flat film of their volume.
    #[test]
    fn a_lying_pool_is_flat() {
        let mesh = surface(heap([40, 40, 2], Vec3::new(-0.125, -0.125, 0.0)), 0.0);
        let inner = mesh.positions.iter().zip(&mesh.normals);
        let inner = inner.filter(|(p, _)| p.truncate().abs().max_element() < 0.09 && p.z > 1e-3);
        let (mut lowest, mut highest, mut steepest) = (f32::MAX, 0.0f32, 1.0f32);
        for (position, normal) in inner {
            (lowest, highest) = (lowest.min(position.z), highest.max(position.z));
            steepest = steepest.min(normal.z);
        }
        assert!(highest - lowest < 0.35 * SPACING_M, "{lowest} to {highest}");
        assert!(steepest > 0.995, "{steepest}");
        assert!(
            (0.8..1.2).contains(&(lowest / (2.0 * SPACING_M))),
            "{lowest}"
        );
        let share = volume_m3(&mesh) / (3200.0 * f64::from(SPACING_M).powi(3));
        assert!((0.8..1.25).contains(&share), "{share}");
    }

    #[test]
    fn the_order_of_particles_in_far_places_does_not_matter() {
        let (one, other) = (
            heap([6, 5, 4], Vec3::ZERO),
            heap([5, 4, 3], Vec3::splat(0.3)),
        );
        let together =
            |parts: [&Vec<Vec3>; 2]| surface(parts.into_iter().flatten().copied().collect(), 0.0);
        assert_eq!(together([&one, &other]), together([&other, &one]));
    }

    #[test]
    fn particles_that_are_too_far_apart_are_refused() {
        let far = (0..60_000).map(|i| {
            let [x, y, z, _] = uniforms(i, 1, 2, 3);
            Vec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, 0.5 * z)
        });
        let refused = SurfaceMesh::new(&cloud(far), 1e-3, 0.0)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("at most 32768"), "{refused}");
    }
}
