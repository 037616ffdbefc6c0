//! Contact detection between particles and balls: a particle extends by half the edge of a cube of its
//! volume, and those that reach a ball mark the nodes on which they act.
//!
//! Nodes near a ball without a touching particle stay free. So material that rests on a ball or carries it
//! has no gap to it, however wide cells are, and a ball displaces its own volume (after Bardenhagen et al.
//! 2001, "An improved contact algorithm for the material point method", with the particles' extents as
//! contact criterion).

use glam::{DVec3, Vec3};

use crate::body::Ball;
use crate::p2g::{STRIDE_X, STRIDE_Y, Substep};
use crate::packet::Packet;
use crate::storage::{BLOCK_EDGE, BLOCK_NODES, NodeBlock, ParticleBlock, TILE_NODES};
use crate::tile::for_each_row;

/// Particles of a block that touch a ball, scattered to the nodes of its tile.
#[derive(Clone)]
pub(crate) struct Touch {
    /// Index of the ball.
    pub(crate) ball: usize,
    /// For each node of the tile the sums over touching particles of `w m n`, with n the unit normal away
    /// from the ball, and of `w m d`, with d the depth of overlap in cells.
    tile: Box<[[f32; 4]; TILE_NODES]>,
}

/// Share of a node's mass that must touch a ball for the node to be in contact with it.
pub(crate) const SHARE_MIN: f32 = 0.05;

/// Share of an overlap by which a ball and touching particles separate in a substep, so that particles placed
/// inside a ball leave it.
pub(crate) const PARTING: f32 = 0.02;

/// Largest speed of that separation, in m/s: so slow that particles and balls that cannot separate come to
/// rest.
pub(crate) const PARTING_MAX_M_S: f32 = 0.004;

/// Gap that still counts as contact, in cells: contacts that have just separated neither chatter nor creep.
pub(crate) const MARGIN_CELLS: f32 = 0.01;

/// Largest distance of a particle from its block's centre, in cells: half of the diagonal after a drift of
/// a cell on each side, 3·√3, rounded up.
const BLOCK_REACH_CELLS: f64 = 5.2;

/// Largest distance from a ball at which a particle can touch it, in cells: a particle extends by half a cell
/// at most and approaches by less than 1.4 cells a substep, half a cell for each component of its velocity
/// and for the ball.
const TOUCH_REACH_CELLS: f64 = 2.0;

/// Finds the particles of a block that touch balls, after they have moved in `p2g`.
pub(crate) fn find_touches(block: &mut ParticleBlock, balls: &[Ball], substep: Substep) {
    block.touches.clear();
    let cell_size_m = f64::from(substep.cell_size_m);
    let corner = block.coordinate.as_dvec3() * f64::from(BLOCK_EDGE);
    for (index, ball) in balls.iter().enumerate() {
        let center = ball.position / cell_size_m - corner;
        let radius = ball.radius_m / cell_size_m;
        let reach = radius + TOUCH_REACH_CELLS + BLOCK_REACH_CELLS;
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
    /// Centre in cells from the block's first node, less one half.
    center: Vec3,
    /// Radius, in cells.
    radius: f32,
    /// Velocity of the centre, in m/s.
    velocity: Vec3,
}

impl LocalBall {
    /// The unit normal towards a particle that touches the ball, or will at the end of the substep at its
    /// present velocity, and the depth of overlap in cells, 0 or more.
    #[inline]
    fn touched_by(&self, packet: &Packet, lane: usize, substep: Substep) -> Option<(Vec3, f32)> {
        let arm = Vec3::from_slice(&packet.position[lane]) - self.center;
        let distance_squared = arm.length_squared();
        // Beyond this none touches, and the root is saved.
        let far = self.radius + TOUCH_REACH_CELLS as f32;
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

/// Cube root within 1e-6 and with the same bits on every machine, unlike the standard library's. The
/// argument, a particle's volume over a cell's, is clamped to 1e-9..=1.
fn cube_root(value: f32) -> f32 {
    let value = value.clamp(1e-9, 1.0);
    // Kahan's initial value: a third of the bits divides the exponent by 3, the constant restores its bias
    // and spreads the error of the mantissa. Three Newton iterations follow.
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

/// Sums of [`Touch`] for a ball at the nodes of a block.
pub(crate) struct NodeTouch {
    pub(crate) ball: usize,
    sums: [[f32; 4]; BLOCK_NODES],
}

impl NodeTouch {
    /// The mean unit normal away from the ball and the mean depth of overlap in cells at a node of a mass
    /// in kg; none if less than [`SHARE_MIN`] of that mass touches.
    pub(crate) fn at(&self, node: usize, mass: f32) -> Option<(DVec3, f32)> {
        let [x, y, z, depth] = self.sums[node];
        let normal = Vec3::new(x, y, z).as_dvec3();
        // The length of the sum is the touching mass, less where normals differ, as between opposite sides
        // of a ball.
        let touching = normal.length();
        let is_enough = touching > f64::from(SHARE_MIN * mass);
        is_enough.then(|| (normal / touching, depth / touching as f32))
    }
}

/// Sums the tiles around a node block, for each ball that particles touch.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::storage::{Particle, Storage};

    #[test]
    fn a_ball_is_met_by_the_farthest_particle_of_a_block_that_nears_it() {
        let substep = Substep {
            dt: 1e-4,
            cell_size_m: 0.01,
        };
        let mut storage = Storage::new(substep.cell_size_m);
        let particle = Particle {
            id: 0,
            position: Vec3::splat(0.006),
            velocity: Vec3::ZERO,
            mass_kg: 1e-3,
            volume_m3: 1e-6,
            material: 0,
        };
        storage.add(&particle, 0.0).unwrap();
        let block = &mut storage.blocks[0];
        assert_eq!(block.coordinate, glam::IVec3::ZERO);
        let local = Vec3::splat(-0.99);
        block.packets[0].position[0] = local.extend(0.0).into();
        let (diagonal, radius_m) = (Vec3::ONE.normalize().as_dvec3(), 0.05);
        let place = (local + 0.5).as_dvec3() * 0.01;
        for (gap_m, is_met) in [(0.0139, true), (0.0145, false)] {
            let mut ball = Ball::new(place - (radius_m + gap_m) * diagonal, radius_m, 0.2);
            ball.velocity = 0.9 * 0.01 / 1e-4 * diagonal;
            find_touches(block, &[ball], substep);
            assert_eq!(!block.touches.is_empty(), is_met, "{gap_m}");
        }
    }
}
