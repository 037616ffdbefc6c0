// Structures of the kernels' buffers, mirrored by `layout.rs`.

struct Params {
    // Coordinate of the region's first block, in blocks from the origin.
    origin: vec3<i32>,
    particles: u32,
    // Number of blocks of the region along each axis.
    blocks: vec3<u32>,
    balls: u32,
    // Acceleration of gravity, in m/s².
    gravity: vec3<f32>,
    // Edge of a cell, in m.
    cell_size: f32,
    courant: f32,
    // Fixed-point quanta of mass in a kilogram.
    mass_scale: f32,
    // Distance that particles may travel before the region must be fitted again, in cells.
    margin: f32,
    // Substeps between two sortings.
    group: u32,
    obstacles: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Control {
    // Duration of the present substep, in s.
    dt: f32,
    // Remaining time of the step, in s.
    left: f32,
    // Bound on the distance that any particle has moved along an axis since the last sorting, in cells.
    drift: f32,
    // The same bound since the region was fitted.
    travelled: f32,
    // Fixed-point quanta of momentum in 1 kg·m/s, in the present substep and in the one before.
    momentum_scale: f32,
    gather_scale: f32,
    // Largest component of a velocity, in m/s.
    speed: f32,
    // Largest speed of sound, in m/s.
    sound: f32,
    // Substeps until the next sorting.
    group_left: u32,
    // Whether particles have not yet gathered velocities from the grid.
    gather: u32,
    // Whether a substep is in progress.
    scatter: u32,
    substeps: u32,
    orderings: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Counters {
    // Allocated so far by the present sorting; `nodes` counts blocks of nodes.
    particles: atomic<u32>,
    chunks: atomic<u32>,
    nodes: atomic<u32>,
    // Bits of the largest velocity component of a node, as f32.
    speed: atomic<u32>,
    // Bits of the largest speed of sound, as f32.
    sound: atomic<u32>,
    // One bit for each ball that particles touch.
    touched: atomic<u32>,
    // One bit for each kind of fault.
    faults: atomic<u32>,
    padding: u32,
    // Least and greatest coordinates of blocks with particles, in blocks from the origin.
    low: array<atomic<i32>, 4>,
    high: array<atomic<i32>, 4>,
}

// Range of particles of one block, processed by one workgroup.
struct Chunk {
    // Coordinate of the block, in blocks from the origin.
    block: vec3<i32>,
    start: u32,
    len: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Material {
    kind: u32,
    density: f32,
    friction: f32,
    // Speed of sound at rest, in m/s.
    sound: f32,
    lambda: f32,
    mu: f32,
    viscosity: f32,
    // Water: ρ₀c²/7, in Pa.
    stiffness: f32,
    // Sand: the yield slope times (3λ + 2μ)/2μ.
    bulk: f32,
    // Snow: range of the elastic stretches, and hardening.
    stretch_low: f32,
    stretch_high: f32,
    hardening: f32,
}

struct Ball {
    // Position of the centre at the batch's start, in cells from the region's first node.
    position: vec3<f32>,
    // Radius, in cells.
    radius: f32,
    // Velocity, in m/s.
    velocity: vec3<f32>,
    // Mass, in kg.
    mass: f32,
    // Angular velocity times radius, in m/s.
    spin: vec3<f32>,
    // Least height of its centre, in cells from the region's first node.
    floor_height: f32,
    // Acceleration by all forces but those of particles, in m/s².
    acceleration: vec3<f32>,
    padding_1: f32,
    // Displacement since the batch's start, in cells; apart from the position, so that small ones are not
    // rounded off.
    moved: vec3<f32>,
    padding_2: f32,
    // Impulse by particles since the batch's start, in kg·m/s.
    impulse: vec3<f32>,
    padding_3: f32,
    // Angular impulse by particles since the batch's start over the radius, in kg·m/s.
    turn: vec3<f32>,
    padding_4: f32,
}

// A half-space (`half_size.x` negative) or a box.
struct Obstacle {
    // Box: its centre, in cells from the region's first node. Half-space: its unit normal.
    place: vec3<f32>,
    // Half-space: signed distance of the plane from the region's first node along the normal, in cells.
    offset: f32,
    // Half of the box's edges, in cells.
    half_size: vec3<f32>,
    is_bonded: u32,
    // Columns of `world_from_cuboid`.
    axis_x: vec3<f32>,
    padding_0: f32,
    axis_y: vec3<f32>,
    padding_1: f32,
    axis_z: vec3<f32>,
    padding_2: f32,
}

// Sorting state of a block of the region.
struct TableRow {
    // Number of its particles.
    count: atomic<u32>,
    // One bit for each of the 27 surrounding node blocks that its particles can reach.
    reach: atomic<u32>,
    // Index of its first particle after sorting.
    start: u32,
    // Whether its nodes are listed.
    is_active: atomic<u32>,
}

const NOT_FINITE: u32 = 1u;
const DRIFTED: u32 = 2u;
const TOO_HEAVY: u32 = 4u;
const LEFT_REGION: u32 = 8u;

// Whether no component is infinite or NaN. By the bits, as WGSL lets compilers assume that neither occurs
// and fold comparisons.
fn is_finite(v: vec3<f32>) -> bool {
    return all((bitcast<vec3<u32>>(v) & vec3(0x7f800000u)) != vec3(0x7f800000u));
}

fn block_index(block: vec3<u32>, blocks: vec3<u32>) -> u32 {
    return (block.x * blocks.y + block.y) * blocks.z + block.z;
}
