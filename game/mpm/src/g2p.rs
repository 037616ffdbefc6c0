//! Grid-to-particle transfer: velocities and affine velocity matrices from the nodes around each particle.

use fearless_simd::{f32x4, prelude::*};

use crate::lanes::Lanes;
use crate::p2g::{Kernel, STRIDE_X, STRIDE_Y};
use crate::packet::Packet;
use crate::storage::{ABSENT, NodeBlock, ParticleBlock, TILE_NODES};
use crate::tile::for_each_row;

/// Sets the velocities and affine matrices of a block's particles, and the block's largest velocity
/// component.
#[inline(always)]
pub(crate) fn g2p<S: Simd>(simd: S, block: &mut ParticleBlock, nodes: &[NodeBlock]) {
    for (side, node) in block.nodes.iter().enumerate() {
        if *node == ABSENT {
            continue;
        }
        let values = &nodes[*node as usize].values;
        // Rows are enumerated from the node block, for which this block lies at the opposite offset, 26 -
        // side.
        for_each_row(26 - side, |row, start, len| {
            let nodes = &mut block.tile[start..start + len];
            nodes.copy_from_slice(&values[row..row + len]);
        });
    }
    let mut largest = f32x4::splat(simd, 0.0);
    let mut poison = f32x4::splat(simd, 0.0);
    for packet in &mut block.packets {
        for lane in 0..packet.len {
            let velocity = gather(simd, packet, lane, &block.tile);
            largest = largest.max(velocity.abs());
            // A maximum may drop NaN. 0 times NaN or ∞ is NaN, which a sum keeps.
            poison += velocity * 0.0;
        }
    }
    block.speed_max = largest.reduce_max() + poison.reduce_sum();
}

/// Gathers `v = Σ w v` and `C Δx = 4 Σ w v dᵀ`, d in cells, over the nodes around a particle (APIC: Jiang
/// et al. 2015, "The affine particle-in-cell method"; 4 is the inverse second moment of the quadratic
/// B-spline). Returns v.
#[inline(always)]
fn gather<S: Simd>(
    simd: S,
    packet: &mut Packet,
    lane: usize,
    tile: &[[f32; 4]; TILE_NODES],
) -> f32x4<S> {
    let kernel = Kernel::new(simd, &packet.position[lane]);
    let zero = Lanes::splat(simd, 0.0);
    // Weights along z are applied once at the end: they are the same for all nine rows.
    let (mut sum, mut sum_x, mut sum_y) = (zero, zero, zero);
    for i in 0..3 {
        let dx = Lanes::splat(simd, kernel.distance[0] + i as f32);
        let mut plane = zero;
        for j in 0..3 {
            let dy = Lanes::splat(simd, kernel.distance[1] + j as f32);
            let start = kernel.start + i * STRIDE_X + j * STRIDE_Y;
            let weight = kernel.weights[0][i] * kernel.weights[1][j];
            let row = Lanes::from_slice(simd, tile[start..start + 4].as_flattened()) * weight;
            plane += row;
            sum_y = row.mul_add(dy, sum_y);
        }
        sum += plane;
        sum_x = plane.mul_add(dx, sum_x);
    }
    let sum = sum * kernel.weights_z;
    let velocity = add_nodes(sum);
    velocity.store_array(&mut packet.velocity[lane]);
    let moments = [
        sum_x * kernel.weights_z,
        sum_y * kernel.weights_z,
        sum * kernel.distance_z,
    ];
    for (column, moment) in packet.affine.iter_mut().zip(moments) {
        (add_nodes(moment) * 4.0).store_array(&mut column[lane]);
    }
    velocity
}

/// The sum of the four nodes of a row.
#[inline(always)]
fn add_nodes<S: Simd>(row: Lanes<S>) -> f32x4<S> {
    let (low, high) = row.split();
    let (a, b) = (low + high).split();
    a + b
}
