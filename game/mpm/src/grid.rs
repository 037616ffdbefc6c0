//! Grid update: momentum becomes velocity, gravity acts, and obstacles bound velocities.

use glam::{DVec3, Vec3};

use crate::body::{Bodies, Grip, Obstacle};
use crate::coupling::Contact;
use crate::storage::{ABSENT, BLOCK_EDGE, BLOCK_NODES, NodeBlock, ParticleBlock};
use crate::tile::for_each_row;
use crate::touch::{PARTING, PARTING_MAX_M_S, add_touches};

/// Mass of a node below which it counts as empty, in kg: its momentum is mere rounding error.
const NODE_MASS_MIN: f32 = 1e-30;

/// Distance from an obstacle's surface, in cells, up to which a node counts as inside. With half a cell the
/// material ends at the surface, averaged over all positions of the surface between nodes.
pub(crate) const SURFACE_CELLS: f64 = 0.499;

/// Distance from the centre of a node block's nodes within which an obstacle can touch one of them, in
/// cells: half of the diagonal of the nodes, 1.5·√3, and half a cell, rounded up.
pub(crate) const REACH_CELLS: f64 = 3.2;

/// Input of the grid update of a substep.
#[derive(Clone, Copy)]
pub(crate) struct GridStep<'a> {
    pub(crate) blocks: &'a [ParticleBlock],
    pub(crate) bodies: &'a Bodies,
    pub(crate) cell_size_m: f64,
    /// Duration of the substep, in s.
    pub(crate) dt: f64,
    /// Change of velocity by gravity over the substep, in m/s.
    pub(crate) fall: Vec3,
}

/// Adds up the tiles around a node block, and computes its nodes' velocities after the substep but for
/// balls, and the contacts of nodes whose particles touch balls.
#[inline(always)]
pub(crate) fn update(node: &mut NodeBlock, step: GridStep) {
    // The centre of nodes 0 to 3 is at 1.5, which is 3/8 of the edge.
    let center = (node.coordinate.as_dvec3() + 0.375) * f64::from(BLOCK_EDGE) * step.cell_size_m;
    let reach = REACH_CELLS * step.cell_size_m;
    let is_near = |obstacle: &&Obstacle| obstacle.distance(center).0 < reach;
    let obstacles: Vec<&Obstacle> = step.bodies.obstacles.iter().filter(is_near).collect();
    let touches = add_touches(node, step.blocks);
    let friction = add_tiles(
        node,
        step.blocks,
        !obstacles.is_empty() || !touches.is_empty(),
    );
    node.contacts.clear();
    for index in 0..BLOCK_NODES {
        let [x, y, z, mass] = node.values[index];
        if mass < NODE_MASS_MIN {
            node.values[index] = [0.0; 4];
            continue;
        }
        let mut velocity = Vec3::new(x, y, z) / mass + step.fall;
        if !obstacles.is_empty() || !touches.is_empty() {
            let place = place(node, index, step.cell_size_m);
            let friction = friction[index] / mass;
            for obstacle in &obstacles {
                velocity = stop(obstacle, place, velocity, friction, step.cell_size_m);
            }
            for touch in &touches {
                if let Some((normal, depth)) = touch.at(index, mass) {
                    let arm = place - step.bodies.balls[touch.ball].position;
                    let parting = f64::from(PARTING * depth) * step.cell_size_m / step.dt;
                    let parting = parting.min(PARTING_MAX_M_S.into());
                    let way = (arm, normal, parting);
                    node.contacts
                        .push(Contact::new(index, touch.ball, way, mass, friction));
                }
            }
        }
        // The fourth number is gathered into the particles' velocities, where `p2g` expects 0.
        node.values[index] = velocity.extend(0.0).into();
    }
}

/// Position of a node, in m.
pub(crate) fn place(node: &NodeBlock, index: usize, cell_size_m: f64) -> DVec3 {
    let local = [index / 16, index / 4 % 4, index % 4].map(|i| i as f64);
    (node.coordinate.as_dvec3() * f64::from(BLOCK_EDGE) + DVec3::from(local)) * cell_size_m
}

/// Velocity of a node after contact with an obstacle, by Coulomb's law (Stomakhin et al. 2013, section 8):
/// the normal impulse times the coefficient of friction bounds the tangential one.
pub(crate) fn stop(
    obstacle: &Obstacle,
    place: DVec3,
    velocity: Vec3,
    friction: f32,
    cell_size_m: f64,
) -> Vec3 {
    let (distance, normal) = obstacle.distance(place);
    if distance > SURFACE_CELLS * cell_size_m {
        return velocity;
    }
    if obstacle.grip == Grip::Bonded {
        return Vec3::ZERO;
    }
    let normal = normal.as_vec3();
    let approach = velocity.dot(normal);
    if approach >= 0.0 {
        return velocity;
    }
    // The normal component is removed, and friction takes at most μ times it off the tangential speed.
    let along = velocity - normal * approach;
    let speed = along.length();
    let lost = -friction * approach;
    if speed <= lost {
        Vec3::ZERO
    } else {
        along * (1.0 - lost / speed)
    }
}

/// Sums momentum and mass over the tiles around a node block into it. Returns sums of friction times mass,
/// or zeros without `with_friction`.
#[inline(always)]
fn add_tiles(
    node: &mut NodeBlock,
    blocks: &[ParticleBlock],
    with_friction: bool,
) -> [f32; BLOCK_NODES] {
    let mut friction = [0.0; BLOCK_NODES];
    node.values = [[0.0; 4]; BLOCK_NODES];
    for (side, source) in node.sources.iter().enumerate() {
        if *source == ABSENT {
            continue;
        }
        let block = &blocks[*source as usize];
        for_each_row(side, |row, start, len| {
            let terms = &block.tile[start..start + len];
            for (sum, term) in node.values[row..row + len].iter_mut().zip(terms) {
                for axis in 0..4 {
                    sum[axis] += term[axis];
                }
            }
            if with_friction {
                for (sum, term) in friction[row..row + len].iter_mut().zip(terms) {
                    *sum += term[3] * block.friction;
                }
            }
        });
    }
    friction
}
