//! Particle-to-grid transfer: particles move and strain, then scatter momentum and mass to their block's
//! tile.
//!
//! Positions and deformations are advanced here, at the start of a substep, with the velocities that `g2p`
//! gathered at the end of the one before.

use fearless_simd::{f32x4, i32x4, prelude::*};

use crate::lanes::{LANES, Lanes, Mat3x, each};
use crate::material::{Material, Strain, Stress};
use crate::packet::Packet;
use crate::storage::{ParticleBlock, TILE_EDGE, TILE_NODES};

/// Constants of a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Substep {
    /// Duration, in s.
    pub(crate) dt: f32,
    pub(crate) cell_size_m: f32,
}

/// Strides of a tile along x and y, in nodes; along z it is 1.
pub(crate) const STRIDE_X: usize = TILE_EDGE * TILE_EDGE;
pub(crate) const STRIDE_Y: usize = TILE_EDGE;

/// Moves and strains the particles of a block, and scatters them to its tile.
#[inline(always)]
pub(crate) fn p2g<S: Simd>(
    simd: S,
    block: &mut ParticleBlock,
    materials: &[Material],
    substep: Substep,
) {
    block.tile.fill([0.0; 4]);
    block.sound_max = 0.0;
    for packet in &mut block.packets {
        let material = &materials[usize::from(packet.material)];
        advance_positions(simd, packet, substep.dt / substep.cell_size_m);
        let (stress, stiffening) = advance_strain(simd, packet, material, substep);
        let sound = material.sound_speed_m_s() * stiffening.reduce_max();
        block.sound_max = block.sound_max.max(sound);
        let impulses = stress_impulses(simd, packet, stress, substep);
        for lane in 0..packet.len {
            scatter(simd, packet, lane, &impulses, &mut block.tile);
        }
    }
}

#[inline(always)]
fn advance_positions<S: Simd>(simd: S, packet: &mut Packet, dt_over_cell: f32) {
    let positions = packet.position.as_chunks_mut::<4>().0;
    let velocities = packet.velocity.as_chunks::<4>().0;
    for (position, velocity) in positions.iter_mut().zip(velocities) {
        let moved = Lanes::from_slice(simd, velocity.as_flattened()) * dt_over_cell
            + Lanes::from_slice(simd, position.as_flattened());
        moved.store_slice(position.as_flattened_mut());
    }
}

/// Advances a packet's deformation by its affine velocity matrix, which in MLS-MPM serves as the velocity
/// gradient. Returns the stress and the speed of sound over that at rest.
#[inline(always)]
fn advance_strain<S: Simd>(
    simd: S,
    packet: &mut Packet,
    material: &Material,
    substep: Substep,
) -> (Stress<S>, Lanes<S>) {
    let scale = substep.dt / substep.cell_size_m;
    let columns = each(
        #[inline(always)]
        |axis| transpose(simd, &packet.affine[axis]),
    );
    let mut strain = Strain {
        deformation: Mat3x::load(simd, &packet.deformation),
        state: Lanes::load_array_ref(simd, &packet.state),
        increment: Mat3x::from_fn(
            #[inline(always)]
            |i, j| Lanes::load_array_ref(simd, &columns[j][i]) * scale,
        ),
        dt: substep.dt,
    };
    let result = material.advance(simd, &mut strain);
    strain.deformation.store(&mut packet.deformation);
    strain.state.store_array(&mut packet.state);
    result
}

/// Sixteen vectors from array of structures to structure of arrays: x, y and z, each as lanes.
#[inline(always)]
fn transpose<S: Simd>(simd: S, vectors: &[[f32; 4]; LANES]) -> [[f32; LANES]; 3] {
    let mut out = [[0.0; LANES]; 3];
    for (four, vectors) in vectors.as_chunks::<4>().0.iter().enumerate() {
        let parts = f32x4::load_four_interleaved(simd, vectors.as_flattened());
        for axis in 0..3 {
            parts[axis].store_slice(&mut out[axis][4 * four..4 * four + 4]);
        }
    }
    out
}

/// Columns of each particle's stress impulse matrix `−dt V₀ (4/Δx²) τ Δx`, which times a node's distance in
/// cells changes the node's momentum: equation 16 of Hu et al. 2018, "A moving least squares material point
/// method".
#[inline(always)]
fn stress_impulses<S: Simd>(
    simd: S,
    packet: &Packet,
    stress: Stress<S>,
    substep: Substep,
) -> [[[f32; 4]; LANES]; 3] {
    let volume = Lanes::load_array_ref(simd, &packet.volume);
    let factor = volume * (-4.0 * substep.dt / substep.cell_size_m);
    let mut rows = [[0.0; LANES]; 6];
    for entry in 0..6 {
        (stress[entry] * factor).store_array(&mut rows[entry]);
    }
    let mut out = [[[0.0; 4]; LANES]; 3];
    let zero = f32x4::splat(simd, 0.0);
    // Columns of the symmetric tensor as indices of its six stored entries xx, yy, zz, xy, xz and yz.
    for (column, entries) in out.iter_mut().zip([[0, 3, 4], [3, 1, 5], [4, 5, 2]]) {
        for (four, vectors) in column.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let [x, y, z] = each(
                #[inline(always)]
                |i| f32x4::from_slice(simd, &rows[entries[i]][4 * four..4 * four + 4]),
            );
            f32x4::store_four_interleaved([x, y, z, zero], vectors.as_flattened_mut());
        }
    }
    out
}

/// A particle's quadratic B-spline over the 3x3x3 nodes around it. Along z it spans four nodes, the last of
/// weight 0, of four lanes each: a row of nodes along z with their four numbers is one vector of 16 lanes.
pub(crate) struct Kernel<S: Simd> {
    /// Index in the tile of the first of the 27 nodes.
    pub(crate) start: usize,
    /// From the particle to the first node along x and y, in cells.
    pub(crate) distance: [f32; 2],
    /// Weights of the three nodes along x and along y.
    pub(crate) weights: [[f32; 3]; 2],
    /// From the particle to the four nodes along z, in cells.
    pub(crate) distance_z: Lanes<S>,
    /// Weights of the four nodes along z.
    pub(crate) weights_z: Lanes<S>,
}

/// Index along z of each lane's node.
const NODE_Z: [f32; LANES] = [
    0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0,
];

impl<S: Simd> Kernel<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, position: &[f32; 4]) -> Self {
        let position = f32x4::load_array_ref(simd, position);
        let base = position.floor();
        // From the first node to the particle, 0.5 to 1.5 cells: positions are stored less one half, so that
        // `floor` gives the first of the three nodes.
        let x = position - base + 0.5;
        // The quadratic B-spline: 3/4 − d² within half a cell, ½ (3/2 − |d|)² beyond.
        let (a, b, c) = (-x + 1.5, x - 1.0, x - 0.5);
        let [w0, w1, w2] = [a * a * 0.5, -(b * b) + 0.75, c * c * 0.5];
        // 1 more: the tile has a margin of one node before the block.
        let [bx, by, bz, _] = <[i32; 4]>::from(base.to_int::<i32x4<S>>());
        let start = ((bx + 1) * TILE_EDGE as i32 + by + 1) * TILE_EDGE as i32 + bz + 1;
        let distance_z = Lanes::load_array_ref(simd, &NODE_Z) - x[2];
        let far = (-distance_z.abs() + 1.5).max(0.0);
        let near = -(distance_z * distance_z) + 0.75;
        let is_near = distance_z.abs().simd_lt(0.5);
        Self {
            start: start as usize,
            distance: [-x[0], -x[1]],
            weights: [[w0[0], w1[0], w2[0]], [w0[1], w1[1], w2[1]]],
            distance_z,
            weights_z: is_near.select(near, far * far * 0.5),
        }
    }
}

/// Adds a particle's momentum and mass to the nodes around it: `w (m v + (m C + impulse) d)`.
#[inline(always)]
fn scatter<S: Simd>(
    simd: S,
    packet: &Packet,
    lane: usize,
    impulses: &[[[f32; 4]; LANES]; 3],
    tile: &mut [[f32; 4]; TILE_NODES],
) {
    let kernel = Kernel::new(simd, &packet.position[lane]);
    let mass = packet.mass[lane];
    let load = |v: &[f32; 4]| f32x4::load_array_ref(simd, v);
    // The fourth number of a node is its mass: a fourth velocity component of 1 adds it up in the same
    // operations.
    let momentum = (load(&packet.velocity[lane]) + load(&[0.0, 0.0, 0.0, 1.0])) * mass;
    let columns = each(
        #[inline(always)]
        |axis| {
            let affine = load(&packet.affine[axis][lane]) * mass + load(&impulses[axis][lane]);
            Lanes::block_splat(affine)
        },
    );
    let wz = kernel.weights_z;
    // The term along z is common to all nine rows, those along x and y are scaled by a row's distance: each
    // row costs two fused multiply-adds.
    let along_z = columns[2].mul_add(kernel.distance_z, Lanes::block_splat(momentum)) * wz;
    let (along_x, along_y) = (columns[0] * wz, columns[1] * wz);
    for i in 0..3 {
        let dx = Lanes::splat(simd, kernel.distance[0] + i as f32);
        let row_x = along_x.mul_add(dx, along_z);
        for j in 0..3 {
            let dy = Lanes::splat(simd, kernel.distance[1] + j as f32);
            let weight = Lanes::splat(simd, kernel.weights[0][i] * kernel.weights[1][j]);
            let start = kernel.start + i * STRIDE_X + j * STRIDE_Y;
            let nodes = tile[start..start + 4].as_flattened_mut();
            let sum = along_y
                .mul_add(dy, row_x)
                .mul_add(weight, Lanes::from_slice(simd, nodes));
            sum.store_slice(nodes);
        }
    }
}
