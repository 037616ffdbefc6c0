//! Touch: particles that reach a ball, as wide as the cube of their volume, and the nodes on which they push.
//!
//! Nodes that are near a ball but have nothing that touches it stay free, so that what rests on a ball or carries it
//! has no gap to it however wide cells are, and what a ball displaces is its own volume (after Bardenhagen et al. 2001,
//! "An improved contact algorithm for the material point method", with extents of particles as the criterion of contact).

use glam::{DVec3, Vec3};

use crate::body::Ball;
use crate::p2g::{STRIDE_X, STRIDE_Y, Substep};
use crate::packet::Packet;
use crate::storage::{BLOCK_EDGE, BLOCK_NODES, NodeBlock, ParticleBlock, TILE_NODES};
use crate::tile::for_each_row;

/// What of a block touches a ball.
#[derive(Clone)]
pub(crate) struct Touch {
    pub(crate) ball: usize,
    /// Of each node of the tile: sums over particles that touch of `w m n`, with n away from the ball, and of `w m d`
    /// with the depth d of overlap in cells.
    tile: Box<[[f32; 4]; TILE_NODES]>,
}

/// Share of a node's mass that must touch a ball.
pub(crate) const SHARE_MIN: f32 = 0.05;

/// Share of an overlap by which a ball and what touches it part in a substep: what was laid inside of a ball leaves it.
pub(crate) const PARTING: f32 = 0.02;

/// At most, in m/s: slower than what counts as calm, so that what cannot part comes to rest.
pub(crate) const PARTING_MAX_M_S: f32 = 0.004;

/// A gap of this many cells touches, too: what has just parted is still held, and neither chatters nor creeps.
pub(crate) const MARGIN_CELLS: f32 = 0.01;

/// From a block's middle to the farthest particle of it, in cells: half of its diagonal and a cell of drift.
const BLOCK_REACH_CELLS: f64 = 5.2;

/// Finds what touches balls, of particles that have moved.
pub(crate) fn find_touches(block: &mut ParticleBlock, balls: &[Ball], substep: Substep) {
    block.touches.clear();
    let cell_size_m = f64::from(substep.cell_size_m);
    let corner = block.coordinate.as_dvec3() * f64::from(BLOCK_EDGE);
    for (index, ball) in balls.iter().enumerate() {
        let center = ball.position / cell_size_m - corner;
        let radius = ball.radius_m / cell_size_m;
        let reach = radius + BLOCK_REACH_CELLS;
        if center.distance_squared(DVec3::splat(0.5 * f64::from(BLOCK_EDGE))) > reach * reach {
            continue;
        }
        let ball = LocalBall {
            center: (center - 0.5).as_vec3(),
            radius: radius as f32,
            velocity: ball.velocity.as_vec3(),
        };
        let mut tile = None;
        for packet in &block.packets {
            for lane in 0..packet.len {
                if let Some((normal, depth)) = ball.touched_by(packet, lane, substep) {
                    let tile = tile.get_or_insert_with(|| Box::new([[0.0; 4]; TILE_NODES]));
                    let position = Vec3::from_slice(&packet.position[lane]);
                    let load = normal.extend(depth) * packet.mass[lane];
                    scatter(position, load.into(), tile);
                }
            }
        }
        if let Some(tile) = tile {
            block.touches.push(Touch { ball: index, tile });
        }
    }
}

/// A ball in the coordinates of a block's particles.
struct LocalBall {
    /// In cells from the block's first node, less one half.
    center: Vec3,
    /// In cells.
    radius: f32,
    /// In m/s.
    velocity: Vec3,
}

impl LocalBall {
    /// The direction to a particle that reaches the ball, or will after the substep at its present velocity, and how
    /// deep it is inside, in cells.
    #[inline]
    fn touched_by(&self, packet: &Packet, lane: usize, substep: Substep) -> Option<(Vec3, f32)> {
        let arm = Vec3::from_slice(&packet.position[lane]) - self.center;
        let distance_squared = arm.length_squared();
        let far = self.radius + 2.0;
        if distance_squared > far * far {
            return None;
        }
        let distance = distance_squared.sqrt();
        let normal = if distance > 1e-6 {
            arm / distance
        } else {
            Vec3::Z
        };
        let cell_m3 = substep.cell_size_m * substep.cell_size_m * substep.cell_size_m;
        let extent = 0.5 * cube_root(packet.volume[lane] / cell_m3);
        let relative = Vec3::from_slice(&packet.velocity[lane]) - self.velocity;
        let nearing = -relative.dot(normal) * substep.dt / substep.cell_size_m;
        let depth = self.radius + extent - distance;
        (depth + nearing.max(0.0) > -MARGIN_CELLS).then_some((normal, depth.max(0.0)))
    }
}

/// Within 1e-6, with the same bits on every machine; the argument is that of a particle's volume over a cell's, up to 1.
fn cube_root(value: f32) -> f32 {
    let value = value.clamp(1e-9, 1.0);
    // A third of the exponent (Kahan), then Newton's method.
    let mut root = f32::from_bits(value.to_bits() / 3 + 0x2a51_19f2);
    for _ in 0..3 {
        root -= (root - value / (root * root)) / 3.0;
    }
    root
}

/// Adds a load to the 27 nodes around a particle by its quadratic B-spline.
fn scatter(position: Vec3, load: [f32; 4], tile: &mut [[f32; 4]; TILE_NODES]) {
    let base = position.floor();
    let x = position - base + 0.5;
    let (a, b, c) = (1.5 - x, x - 1.0, x - 0.5);
    let weights = [0.5 * a * a, 0.75 - b * b, 0.5 * c * c];
    let first = base.as_ivec3() + 1;
    let start = first.x as usize * STRIDE_X + first.y as usize * STRIDE_Y + first.z as usize;
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                let weight = weights[i].x * weights[j].y * weights[k].z;
                let node = &mut tile[start + i * STRIDE_X + j * STRIDE_Y + k];
                for (sum, term) in node.iter_mut().zip(load) {
                    *sum += weight * term;
                }
            }
        }
    }
}

/// The touched nodes of a block with a ball.
pub(crate) struct NodeTouch {
    pub(crate) ball: usize,
    sums: [[f32; 4]; BLOCK_NODES],
}

impl NodeTouch {
    /// The direction away from the ball at a node of a mass, and how deep what touches is inside in cells, if enough of
    /// it touches.
    pub(crate) fn at(&self, node: usize, mass: f32) -> Option<(DVec3, f32)> {
        let [x, y, z, depth] = self.sums[node];
        let normal = Vec3::new(x, y, z).as_dvec3();
        let touching = normal.length();
        let is_enough = touching > f64::from(SHARE_MIN * mass);
        is_enough.then(|| (normal / touching, depth / touching as f32))
    }
}

/// Sums over the tiles around a node block, a ball each.
pub(crate) fn add_touches(node: &NodeBlock, blocks: &[ParticleBlock]) -> Vec<NodeTouch> {
    let mut found: Vec<NodeTouch> = Vec::new();
    for (side, source) in node.sources.iter().enumerate() {
        let Some(block) = blocks.get(*source as usize) else {
            continue;
        };
        for touch in &block.touches {
            let known = found.iter().position(|sum| sum.ball == touch.ball);
            let index = known.unwrap_or_else(|| {
                found.push(NodeTouch {
                    ball: touch.ball,
                    sums: [[0.0; 4]; BLOCK_NODES],
                });
                found.len() - 1
            });
            let sums = &mut found[index].sums;
            for_each_row(side, |row, start, len| {
                let terms = &touch.tile[start..start + len];
                for (sum, term) in sums[row..row + len].iter_mut().zip(terms) {
                    for axis in 0..4 {
                        sum[axis] += term[axis];
                    }
                }
            });
        }
    }
    found
}
