// Structures that kernels share; `layout.rs` mirrors them.

struct Params {
    // The region's first block, in blocks from the origin.
    origin: vec3<i32>,
    particles: u32,
    // Of the region along each axis.
    blocks: vec3<u32>,
    balls: u32,
    // In m/s².
    gravity: vec3<f32>,
    // In m.
    cell_size: f32,
    courant: f32,
    // Quanta of mass in a kilogram.
    mass_scale: f32,
    // Cells that particles may travel before the region must be fitted again.
    margin: f32,
    // Substeps from one ordering to the next.
    group: u32,
    obstacles: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Control {
    // Of the substep under way, in s.
    dt: f32,
    // Time of the step that is left, in s.
    left: f32,
    // Cells that the fastest particle may have moved since the last ordering.
    drift: f32,
    // The same since the region was fitted.
    travelled: f32,
    // Quanta of momentum in a kg·m/s, and the same in the substep before.
    momentum_scale: f32,
    gather_scale: f32,
    // Largest component of a velocity, in m/s.
    speed: f32,
    // Fastest sound, in m/s.
    sound: f32,
    // Substeps until the next ordering.
    group_left: u32,
    // Whether particles have yet to take velocities from the grid.
    gather: u32,
    // Whether a substep is under way.
    scatter: u32,
    substeps: u32,
    orderings: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Counters {
    // Taken by the ordering under way.
    particles: atomic<u32>,
    chunks: atomic<u32>,
    nodes: atomic<u32>,
    // Bits of the fastest node's largest component.
    speed: atomic<u32>,
    // Bits of the fastest sound.
    sound: atomic<u32>,
    // A bit for each ball that particles touch.
    touched: atomic<u32>,
    // A bit for each fault.
    faults: atomic<u32>,
    padding: u32,
    // Least and greatest block with particles, in blocks from the origin.
    low: array<atomic<i32>, 4>,
    high: array<atomic<i32>, 4>,
}

// Particles of one block, for one workgroup.
struct Chunk {
    // In blocks from the origin.
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
    // At rest, in m/s.
    sound: f32,
    lambda: f32,
    mu: f32,
    viscosity: f32,
    // Of water: ρ₀c²/7.
    stiffness: f32,
    // Of sand: the yield slope times (3λ + 2μ)/2μ.
    bulk: f32,
    // Of snow.
    stretch_low: f32,
    stretch_high: f32,
    hardening: f32,
}

struct Ball {
    // In cells from the region's first node, at the batch's start.
    position: vec3<f32>,
    // In cells.
    radius: f32,
    // In m/s.
    velocity: vec3<f32>,
    // In kg.
    mass: f32,
    // Angular velocity times radius, in m/s.
    spin: vec3<f32>,
    // Height under which its centre does not sink, in cells from the region's first node.
    floor_height: f32,
    // In m/s².
    acceleration: vec3<f32>,
    padding_1: f32,
    // Since the batch's start, in cells.
    moved: vec3<f32>,
    padding_2: f32,
    // By particles since the batch's start, in kg·m/s.
    impulse: vec3<f32>,
    padding_3: f32,
    // The same about the centre, over the radius.
    turn: vec3<f32>,
    padding_4: f32,
}

// A half-space (`half_size.x` negative) or a box.
struct Obstacle {
    // Of a box: its centre, in cells from the region's first node. Of a half-space: its normal.
    place: vec3<f32>,
    // Of a half-space: the plane's distance from the region's first node, in cells.
    offset: f32,
    // In cells.
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

// A block of the region.
struct TableRow {
    // Particles in it.
    count: atomic<u32>,
    // A bit for each of the 27 node blocks around that they may touch.
    reach: atomic<u32>,
    // Their first place.
    start: u32,
    is_active: atomic<u32>,
}

const NOT_FINITE: u32 = 1u;
const DRIFTED: u32 = 2u;
const TOO_HEAVY: u32 = 4u;
const LEFT_REGION: u32 = 8u;

// Whether no component is infinite or NaN, by its bits: compilers may take comparisons for granted.
fn is_finite(v: vec3<f32>) -> bool {
    return all((bitcast<vec3<u32>>(v) & vec3(0x7f800000u)) != vec3(0x7f800000u));
}

fn block_index(block: vec3<u32>, blocks: vec3<u32>) -> u32 {
    return (block.x * blocks.y + block.y) * blocks.z + block.z;
}
