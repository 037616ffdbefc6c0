//! Storage of particles and nodes in blocks of 4x4x4 cells.
//!
//! A particle's position is relative to its block and in cells, so that its precision does not depend on
//! the distance from the origin. Particles are sorted by block, material and cell, and may then move by
//! almost a cell before they must be sorted again: each block scatters into a tile of its own with a margin
//! of one cell, and nodes add up the tiles around them in a fixed order. No two threads write the same
//! memory, and no sum depends on the number of threads.

use std::collections::HashMap;

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::material::Material;
use crate::packet::{Packet, room_in};
use crate::totals::Totals;

/// Edge of a block, in cells.
pub(crate) const BLOCK_EDGE: i32 = 4;

/// Number of nodes of a block.
pub(crate) const BLOCK_NODES: usize = 64;

/// Edge of a tile, in nodes: a block, the two further nodes of the quadratic kernel, and a margin of one
/// cell on each side.
pub(crate) const TILE_EDGE: usize = 8;

/// Number of nodes of a tile, and one past the last: rows of three nodes are processed as four, the fourth
/// with a weight of zero.
pub(crate) const TILE_NODES: usize = TILE_EDGE * TILE_EDGE * TILE_EDGE + 1;

/// Distance along an axis, in cells, that a particle may move before particles must be sorted again: less
/// than the margin.
pub(crate) const DRIFT_MAX: f32 = 0.98;

/// Largest magnitude of a block's coordinate along an axis, in blocks.
pub(crate) const BLOCK_COORDINATE_MAX: f64 = (1 << 24) as f64;

/// The particles of a block of cells.
#[derive(Clone)]
pub(crate) struct ParticleBlock {
    /// Offset from the origin, in blocks.
    pub(crate) coordinate: IVec3,
    pub(crate) packets: Vec<Packet>,
    /// Momentum and mass of the nodes around after the scatter, their velocities for the gather.
    pub(crate) tile: Box<[[f32; 4]; TILE_NODES]>,
    /// Indices of the surrounding node blocks in the order of [`neighbours`], [`ABSENT`] where no particle
    /// reaches.
    pub(crate) nodes: [u32; 27],
    /// Particles in contact with balls, scattered to the tile, one entry a ball.
    pub(crate) touches: Vec<crate::touch::Touch>,
    /// Mean coefficient of friction of its particles, weighted by mass.
    pub(crate) friction: f32,
    /// Largest component of a velocity, in m/s; NaN when one is not finite.
    pub(crate) speed_max: f32,
    /// Largest speed of sound of its particles, in m/s.
    pub(crate) sound_max: f32,
}

impl ParticleBlock {
    fn new(coordinate: IVec3) -> Self {
        Self {
            coordinate,
            packets: Vec::new(),
            tile: Box::new([[0.0; 4]; TILE_NODES]),
            nodes: [ABSENT; 27],
            touches: Vec::new(),
            friction: 0.0,
            speed_max: 0.0,
            sound_max: 0.0,
        }
    }

    /// Its particles, each as a packet and a lane.
    pub(crate) fn lanes(&self) -> impl Iterator<Item = (&Packet, usize)> {
        let packets = self.packets.iter();
        packets.flat_map(|packet| (0..packet.len).map(move |lane| (packet, lane)))
    }
}

/// The grid nodes of a block.
#[derive(Clone)]
pub(crate) struct NodeBlock {
    /// Offset from the origin, in blocks.
    pub(crate) coordinate: IVec3,
    /// Indices of the surrounding particle blocks in the order of [`neighbours`], or [`ABSENT`].
    pub(crate) sources: [u32; 27],
    /// Momentum and mass of each node; after the grid update velocity and 0.
    pub(crate) values: [[f32; 4]; BLOCK_NODES],
    /// Contacts of its nodes with balls.
    pub(crate) contacts: Vec<crate::coupling::Contact>,
}

/// Index that stands for a missing block.
pub(crate) const ABSENT: u32 = u32::MAX;

/// Offsets from a block to itself and its 26 neighbours, in the order of their indices: the one at index
/// `i` is opposite to that at `26 - i`.
pub(crate) fn neighbours() -> impl Iterator<Item = IVec3> {
    (0..27).map(|index| IVec3::new(index / 9 - 1, index / 3 % 3 - 1, index % 3 - 1))
}

/// State of a particle as a simulation's caller sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Particle {
    /// Index in the order in which particles were added, from 0.
    pub id: u32,
    /// Position, in m.
    pub position: Vec3,
    /// Velocity, in m/s.
    pub velocity: Vec3,
    /// Mass, in kg.
    pub mass_kg: f32,
    /// Volume at rest, in m³.
    pub volume_m3: f32,
    /// Index of its material in [`crate::Simulation::materials`].
    pub material: usize,
}

/// Complete state of a particle. Its position is `local`, in cells from its block's first node less one half.
pub(crate) struct ParticleState {
    pub(crate) particle: Particle,
    pub(crate) local: Vec3,
    pub(crate) affine: [Vec3; 3],
    pub(crate) deformation: [f32; 9],
    pub(crate) state: f32,
}

/// All particles and grid nodes of a simulation.
#[derive(Clone)]
pub(crate) struct Storage {
    pub(crate) cell_size_m: f32,
    pub(crate) blocks: Vec<ParticleBlock>,
    pub(crate) nodes: Vec<NodeBlock>,
    index: HashMap<IVec3, u32>,
}

impl Storage {
    pub(crate) fn new(cell_size_m: f32) -> Self {
        Self {
            cell_size_m,
            blocks: Vec::new(),
            nodes: Vec::new(),
            index: HashMap::new(),
        }
    }

    /// The block that contains a position in m, and the position relative to it in cells.
    ///
    /// # Errors
    ///
    /// If the block's coordinate is over [`BLOCK_COORDINATE_MAX`].
    pub(crate) fn locate(&self, position: Vec3) -> Result<(IVec3, Vec3)> {
        let cells = position.as_dvec3() / f64::from(self.cell_size_m) - 0.5;
        let block = (cells / f64::from(BLOCK_EDGE)).floor();
        if block.abs().max_element() > BLOCK_COORDINATE_MAX {
            return Err(Error::OutOfReach {
                position_m: position,
            });
        }
        let local = cells - block * f64::from(BLOCK_EDGE);
        Ok((block.as_ivec3(), local.as_vec3()))
    }

    /// Position in m of a place that is relative to a block and in cells: the inverse of [`Self::locate`].
    pub(crate) fn position_m(&self, block: IVec3, local: [f32; 4]) -> DVec3 {
        let local = Vec3::from_slice(&local).as_dvec3();
        let cells = block.as_dvec3() * f64::from(BLOCK_EDGE) + local + 0.5;
        cells * f64::from(self.cell_size_m)
    }

    /// Sums over all particles.
    pub(crate) fn totals(&self) -> Totals {
        let mut totals = Totals::default();
        let cell_size_m = f64::from(self.cell_size_m);
        for block in &self.blocks {
            for (packet, lane) in block.lanes() {
                let position = self.position_m(block.coordinate, packet.position[lane]);
                let velocity = Vec3::from_slice(&packet.velocity[lane]);
                let columns = packet.affine_columns(lane).map(Vec3::as_dvec3);
                totals.add(packet.mass[lane], position, velocity, columns, cell_size_m);
            }
        }
        totals
    }

    /// Adds an undeformed particle; [`Self::put_in_order`] must follow.
    pub(crate) fn add(&mut self, particle: &Particle, state: f32) -> Result<()> {
        let (coordinate, local) = self.locate(particle.position)?;
        self.add_state(
            coordinate,
            &ParticleState {
                particle: *particle,
                local,
                affine: [Vec3::ZERO; 3],
                deformation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                state,
            },
        );
        Ok(())
    }

    /// Adds a particle to the block at a coordinate; [`Self::put_in_order`] must follow.
    pub(crate) fn add_state(&mut self, coordinate: IVec3, added: &ParticleState) {
        let ParticleState {
            particle, state, ..
        } = added;
        let index = self.block_index(coordinate) as usize;
        let material = particle.material as u16;
        let packet = room_in(&mut self.blocks[index].packets, material, || *state);
        packet.push(&Packet::new(material, *state), 0);
        let lane = packet.len - 1;
        packet.position[lane] = added.local.extend(0.0).into();
        for (column, entries) in packet.affine.iter_mut().zip(added.affine) {
            column[lane] = entries.extend(0.0).into();
        }
        for (entry, value) in packet.deformation.iter_mut().zip(added.deformation) {
            entry[lane] = value;
        }
        packet.velocity[lane] = particle.velocity.extend(0.0).into();
        packet.mass[lane] = particle.mass_kg;
        packet.volume[lane] = particle.volume_m3;
        packet.id[lane] = particle.id;
    }

    /// Every block's coordinate with the states of its particles.
    pub(crate) fn states(&self) -> impl Iterator<Item = (IVec3, Vec<ParticleState>)> + '_ {
        self.blocks.iter().map(|block| {
            let states = block.lanes().map(|(packet, lane)| ParticleState {
                particle: self.particle(block, packet, lane),
                local: Vec3::from_slice(&packet.position[lane]),
                affine: packet.affine_columns(lane),
                deformation: packet.deformation.map(|entry| entry[lane]),
                state: packet.state[lane],
            });
            (block.coordinate, states.collect())
        })
    }

    pub(crate) fn block_index(&mut self, coordinate: IVec3) -> u32 {
        let blocks = &mut self.blocks;
        *self.index.entry(coordinate).or_insert_with(|| {
            blocks.push(ParticleBlock::new(coordinate));
            (blocks.len() - 1) as u32
        })
    }

    /// Every particle, in the order of blocks.
    pub(crate) fn particles(&self) -> impl Iterator<Item = Particle> + '_ {
        self.blocks.iter().flat_map(move |block| {
            let lanes = block.lanes();
            lanes.map(move |(packet, lane)| self.particle(block, packet, lane))
        })
    }

    fn particle(&self, block: &ParticleBlock, packet: &Packet, lane: usize) -> Particle {
        let position = self.position_m(block.coordinate, packet.position[lane]);
        Particle {
            id: packet.id[lane],
            position: position.as_vec3(),
            velocity: Vec3::from_slice(&packet.velocity[lane]),
            mass_kg: packet.mass[lane],
            volume_m3: packet.volume[lane],
            material: packet.material.into(),
        }
    }

    /// Keeps the particles for which the function is true; [`Self::put_in_order`] must follow.
    pub(crate) fn retain(&mut self, mut keep: impl FnMut(&Particle) -> bool) {
        let kept: Vec<bool> = self.particles().map(|particle| keep(&particle)).collect();
        let mut kept = kept.into_iter();
        for block in &mut self.blocks {
            let old = std::mem::take(&mut block.packets);
            for packet in &old {
                let mut rest = packet.clone();
                rest.len = 0;
                for lane in 0..packet.len {
                    if kept.next() == Some(true) {
                        rest.push(packet, lane);
                    }
                }
                // `mean_friction` sums masses over whole packets, unused lanes included.
                rest.mass[rest.len..].fill(0.0);
                block.packets.push(rest);
            }
        }
    }

    /// Sorts particles by block, material and cell, and rebuilds the node blocks around them.
    ///
    /// # Errors
    ///
    /// If a particle's block is over [`BLOCK_COORDINATE_MAX`]; particles then stay as they are.
    pub(crate) fn put_in_order(&mut self, materials: &[Material]) -> Result<()> {
        let (coordinates, mut slots) = match self.slots() {
            Ok(sorted) => sorted,
            Err(error) => {
                // The index holds new blocks by then.
                let coordinates = self.blocks.iter().map(|block| block.coordinate);
                self.index = coordinates.zip(0..).collect();
                return Err(error);
            }
        };
        // Keys are unique, as each slot has a source of its own: an unstable sort then gives one order,
        // whatever the number of threads.
        slots.par_sort_unstable();
        // Prefix sums of the particles of each block.
        let mut starts = vec![0; coordinates.len() + 1];
        for slot in &slots {
            starts[slot.block() + 1] += 1;
        }
        for i in 0..coordinates.len() {
            starts[i + 1] += starts[i];
        }
        let old = &self.blocks;
        let blocks: Vec<ParticleBlock> = coordinates
            .par_iter()
            .enumerate()
            .map(|(i, coordinate)| {
                let mut block = ParticleBlock::new(*coordinate);
                for slot in &slots[starts[i]..starts[i + 1]] {
                    slot.move_into(&mut block, old, materials);
                }
                block.friction = mean_friction(&block.packets, materials);
                block
            })
            .collect();
        self.blocks = blocks;
        self.find_nodes();
        Ok(())
    }

    /// The coordinates of the new blocks, in the order in which particles first use them, and the slot of
    /// each particle.
    fn slots(&mut self) -> Result<(Vec<IVec3>, Vec<Slot>)> {
        self.index.clear();
        let mut coordinates = Vec::new();
        let mut slots = Vec::new();
        let mut last = (IVec3::MIN, 0);
        for (block_index, block) in self.blocks.iter().enumerate() {
            for (packet_index, packet) in block.packets.iter().enumerate() {
                for lane in 0..packet.len {
                    let local = Vec3::from_slice(&packet.position[lane]);
                    let shift = (local / BLOCK_EDGE as f32).floor();
                    let coordinate = block.coordinate + shift.as_ivec3();
                    // Particles are nearly sorted: most are in the block of the one before, which saves the
                    // look-up.
                    if coordinate != last.0 {
                        if coordinate.as_dvec3().abs().max_element() > BLOCK_COORDINATE_MAX {
                            let place = self.position_m(block.coordinate, packet.position[lane]);
                            let position_m = place.as_vec3();
                            return Err(Error::OutOfReach { position_m });
                        }
                        let index = *self.index.entry(coordinate).or_insert_with(|| {
                            coordinates.push(coordinate);
                            (coordinates.len() - 1) as u32
                        });
                        last = (coordinate, index);
                    }
                    let cell = (local - shift * BLOCK_EDGE as f32).as_ivec3();
                    // Rounding may give the block's end, one past its last cell; the clamp is harmless, as
                    // the cell is used for sorting only.
                    let cell = (cell.x * 4 + cell.y) * 4 + cell.z;
                    slots.push(Slot {
                        key: u64::from(last.1) << 32
                            | u64::from(packet.material) << 16
                            | u64::from(cell.clamp(0, 63) as u16),
                        source: (block_index as u32, packet_index as u32, lane as u32),
                    });
                }
            }
        }
        Ok((coordinates, slots))
    }

    /// Rebuilds the node blocks that particles can reach, and the links between particle and node blocks.
    fn find_nodes(&mut self) {
        self.nodes.clear();
        let mut index: HashMap<IVec3, u32> = HashMap::new();
        for (block_index, block) in self.blocks.iter_mut().enumerate() {
            let reach = reach(&block.packets);
            for (side, offset) in neighbours().enumerate() {
                block.nodes[side] = ABSENT;
                if offset.cmplt(reach[0]).any() || offset.cmpgt(reach[1]).any() {
                    continue;
                }
                let coordinate = block.coordinate + offset;
                let node = *index.entry(coordinate).or_insert_with(|| {
                    self.nodes.push(NodeBlock {
                        coordinate,
                        sources: [ABSENT; 27],
                        values: [[0.0; 4]; BLOCK_NODES],
                        contacts: Vec::new(),
                    });
                    (self.nodes.len() - 1) as u32
                });
                block.nodes[side] = node;
                // For the node block this block lies at the opposite offset.
                self.nodes[node as usize].sources[26 - side] = block_index as u32;
            }
        }
    }
}

/// Sort key of a particle and its source.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Slot {
    /// Index of the new block (32 bits), material (16 bits) and cell (16 bits).
    key: u64,
    /// Indices of the old block, packet and lane.
    source: (u32, u32, u32),
}

impl Slot {
    fn block(&self) -> usize {
        (self.key >> 32) as usize
    }

    fn move_into(&self, block: &mut ParticleBlock, old: &[ParticleBlock], materials: &[Material]) {
        let from_block = &old[self.source.0 as usize];
        let from = &from_block.packets[self.source.1 as usize];
        let material = from.material;
        let at_rest = || materials[usize::from(material)].state_at_rest();
        let packet = room_in(&mut block.packets, material, at_rest);
        packet.push(from, self.source.2 as usize);
        let shift = (block.coordinate - from_block.coordinate) * BLOCK_EDGE;
        let local = &mut packet.position[packet.len - 1];
        for (axis, shift) in shift.to_array().into_iter().enumerate() {
            // The subtraction may round up to the edge, which is outside the block.
            let below_end = (BLOCK_EDGE as f32).next_down();
            local[axis] = (local[axis] - shift as f32).clamp(0.0, below_end);
        }
    }
}

/// The least and the greatest offset of the node blocks that a block's particles can reach until they are
/// sorted again. A lone particle reaches 8 of the 27 blocks on average.
fn reach(packets: &[Packet]) -> [IVec3; 2] {
    let (mut min, mut max) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for packet in packets {
        for position in &packet.position[..packet.len] {
            min = min.min(Vec3::from_slice(position));
            max = max.max(Vec3::from_slice(position));
        }
    }
    // The first of a particle's three nodes is at the floor of its position, the last two nodes further.
    let low = min - DRIFT_MAX;
    let high = max + DRIFT_MAX + 2.0;
    let edge = BLOCK_EDGE as f32;
    [low, high].map(|end| (end / edge).floor().as_ivec3())
}

/// Mean coefficient of friction of particles, weighted by mass; 0 for none.
fn mean_friction(packets: &[Packet], materials: &[Material]) -> f32 {
    let (mut mass, mut friction) = (0.0, 0.0);
    for packet in packets {
        let sum: f32 = packet.mass.iter().sum();
        mass += sum;
        friction += sum * materials[usize::from(packet.material)].friction();
    }
    if mass > 0.0 { friction / mass } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Sand;

    #[test]
    fn a_particle_out_of_reach_leaves_the_blocks_indexed_as_they_are() {
        let mut storage = Storage::new(0.01);
        for (id, x) in [(0, 0.01), (1, 0.21)] {
            let particle = Particle {
                id,
                position: Vec3::new(x, 0.01, 0.01),
                velocity: Vec3::ZERO,
                mass_kg: 1e-3,
                volume_m3: 1e-6,
                material: 0,
            };
            storage.add(&particle, 0.0).unwrap();
        }
        // The first goes to a new block, which takes its place in the index; the second goes too far.
        for (block, cells) in storage.blocks.iter_mut().zip([100.0, 1e9]) {
            block.packets[0].position[0][0] = cells;
        }
        let materials = [Material::Sand(Sand::default())];
        let refused = storage.put_in_order(&materials);
        assert!(matches!(refused, Err(Error::OutOfReach { .. })));
        assert_eq!(storage.index.len(), 2);
        for (coordinate, index) in &storage.index {
            assert_eq!(storage.blocks[*index as usize].coordinate, *coordinate);
        }
    }
}
