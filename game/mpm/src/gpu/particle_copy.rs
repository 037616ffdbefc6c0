//! Conversion of particles between the CPU's storage and the GPU's, seven vectors of four 32-bit words a
//! particle.
//!
//! | vector | contents |
//! |---|---|
//! | 0 | position in cells from the block's first node, less one half; state variable |
//! | 1, 2 | deformation gradient by columns, entries 0 to 7 |
//! | 3 | entry 8; volume in m³; indices of material (8 bits) and particle (24); rounding error of momentum |
//! | 4, 5, 6 | velocity in m/s; affine velocity by columns |

use std::collections::HashMap;

use glam::{IVec3, Vec3};

use crate::gpu::layout::Chunk;
use crate::material::Material;
use crate::packet::{Packet, room_in};
use crate::storage::{BLOCK_EDGE, Storage};

/// Number of vectors of a particle.
pub(super) const PARTS: usize = 7;

/// Mask of a particle's index.
const INDEX: u32 = (1 << 24) - 1;

/// Largest number of particles that those bits can index.
pub(super) const INDICES_MAX: usize = 1 << 24;

/// All particles in chunks of one block each, as a structure of arrays: all first vectors, all second ones,
/// and so on.
pub(super) struct ParticleCopy {
    /// Ids by the particles' GPU indices.
    pub(super) ids: Vec<u32>,
    pub(super) chunks: Vec<Chunk>,
    pub(super) parts: Vec<[u32; 4]>,
}

impl ParticleCopy {
    /// Copies a storage of `count` particles, in chunks of at most `chunk_len`.
    pub(super) fn of_storage(storage: &Storage, count: usize, chunk_len: usize) -> Self {
        let mut copy = Self {
            ids: Vec::with_capacity(count),
            chunks: Vec::new(),
            parts: vec![[0; 4]; count * PARTS],
        };
        let mut start = 0;
        for block in &storage.blocks {
            let first = start;
            for (packet, lane) in block.lanes() {
                let vectors = vectors(packet, lane, start as u32);
                copy.ids.push(packet.id[lane]);
                for (part, vector) in vectors.into_iter().enumerate() {
                    copy.parts[part * count + start] = vector;
                }
                start += 1;
            }
            for from in (first..start).step_by(chunk_len) {
                copy.chunks.push(Chunk {
                    block: block.coordinate.into(),
                    start: from as u32,
                    len: (start - from).min(chunk_len) as u32,
                    padding: [0; 3],
                });
            }
        }
        copy
    }

    /// Converts to a storage with particles in the order of ids, so that it does not depend on the GPU's
    /// order; [`Storage::put_in_order`] must follow.
    pub(super) fn into_storage(self, cell_size_m: f32, materials: &[Material]) -> Storage {
        let count = self.parts.len() / PARTS;
        let mut places: Vec<(u32, IVec3, usize)> = self
            .chunks
            .iter()
            .flat_map(|chunk| {
                let block = IVec3::from(chunk.block);
                (chunk.start..chunk.start + chunk.len).map(move |index| (block, index as usize))
            })
            .map(|(block, index)| {
                let [_, _, packed, _] = self.parts[3 * count + index];
                (self.ids[(packed & INDEX) as usize], block, index)
            })
            .collect();
        places.sort_unstable_by_key(|place| place.0);
        let mut storage = Storage::new(cell_size_m);
        for (id, block, index) in places {
            let vectors = std::array::from_fn(|part| self.parts[part * count + index]);
            let packet = packet(&vectors, id, materials);
            let block = storage.block_index(block) as usize;
            let packets = &mut storage.blocks[block].packets;
            room_in(packets, packet.material, || 0.0).push(&packet, 0);
        }
        storage
    }
}

fn vectors(packet: &Packet, lane: usize, index: u32) -> [[u32; 4]; PARTS] {
    let [x, y, z, _] = packet.position[lane];
    let f = |row: usize, column: usize| packet.deformation[3 * row + column][lane];
    let [vx, vy, vz, _] = packet.velocity[lane];
    let [a, b, c] = packet.affine.map(|column| column[lane]);
    let numbers = [
        [x, y, z, packet.state[lane]],
        [f(0, 0), f(1, 0), f(2, 0), f(0, 1)],
        [f(1, 1), f(2, 1), f(0, 2), f(1, 2)],
        [f(2, 2), packet.volume[lane], 0.0, 0.0],
        [vx, vy, vz, a[0]],
        [a[1], a[2], b[0], b[1]],
        [b[2], c[0], c[1], c[2]],
    ];
    let mut vectors = numbers.map(|vector| vector.map(f32::to_bits));
    vectors[3][2] = u32::from(packet.material) << 24 | index;
    vectors
}

/// Largest mass of the particles of one cell, in kg.
pub(super) fn fullest_cell_kg(storage: &Storage) -> f64 {
    let mut cells: HashMap<IVec3, f64> = HashMap::new();
    for block in &storage.blocks {
        for (packet, lane) in block.lanes() {
            let local = Vec3::from_slice(&packet.position[lane]);
            let cell = block.coordinate * BLOCK_EDGE + local.floor().as_ivec3();
            *cells.entry(cell).or_default() += f64::from(packet.mass[lane]);
        }
    }
    cells.into_values().fold(0.0, f64::max)
}

/// A packet of one particle.
fn packet(vectors: &[[u32; 4]; PARTS], id: u32, materials: &[Material]) -> Packet {
    let material = (vectors[3][2] >> 24) as usize;
    let [place, f, g, constants, v, a, b] = vectors.map(|vector| vector.map(f32::from_bits));
    let mut packet = Packet::new(material as u16, place[3]);
    packet.len = 1;
    packet.position[0] = [place[0], place[1], place[2], 0.0];
    // From the kernels' column-major order to the packet's row-major one.
    let columns = [f[0], f[1], f[2], f[3], g[0], g[1], g[2], g[3], constants[0]];
    for (entry, value) in columns.into_iter().enumerate() {
        packet.deformation[entry % 3 * 3 + entry / 3][0] = value;
    }
    packet.volume[0] = constants[1];
    packet.mass[0] = constants[1] * materials[material].density_kg_m3();
    packet.id[0] = id;
    packet.velocity[0] = [v[0], v[1], v[2], 0.0];
    packet.affine[0][0] = [v[3], a[0], a[1], 0.0];
    packet.affine[1][0] = [a[2], a[3], b[0], 0.0];
    packet.affine[2][0] = [b[1], b[2], b[3], 0.0];
    packet
}
