// Grid-to-particle and particle-to-grid transfer in one kernel: a particle gathers the velocities of nodes
// at the end of one substep, moves and strains in the next, and scatters momentum and mass to the nodes
// around it. One workgroup processes one chunk. Sums are of fixed-point integers, so that they do not
// depend on order.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> control: Control;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(4) var<storage, read_write> particles: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> sums: array<atomic<i32>>;
@group(0) @binding(6) var<storage, read> velocities: array<vec4<f32>>;
@group(0) @binding(7) var<uniform> materials: array<Material, MATERIALS>;

// Number of nodes of a tile, 8 along each axis: a block, the two further nodes of the quadratic kernel, and
// a margin of one cell on each side. The strides follow.
const TILE_NODES: u32 = 512u;
const TILE_X: u32 = 64u;
const TILE_Y: u32 = 8u;

// Planes of one number a node: bits of the velocity's components during the gather; quanta of momentum and
// mass during the scatter.
var<workgroup> tile: array<atomic<i32>, 2048>;
var<workgroup> sound_max: atomic<u32>;
var<workgroup> chunk: Chunk;
var<workgroup> substep: Control;

// Index in the grid of a node of the tile.
fn grid_node(index: u32) -> u32 {
    let in_tile = vec3<i32>(vec3(index / TILE_X, index / TILE_Y % 8u, index % 8u));
    let node = vec3<u32>((chunk.block - params.origin) * 4 + in_tile - 1);
    let in_block = node & vec3(3u);
    return block_index(node / 4u, params.blocks) * 64u + (in_block.x * 4u + in_block.y) * 4u + in_block.z;
}

struct Motion {
    velocity: vec3<f32>,
    // Change of velocity over a cell along each axis, in m/s.
    affine: mat3x3<f32>,
}

fn load_tile(lane: u32) {
    for (var index = lane; index < TILE_NODES; index += CHUNK) {
        let velocity = bitcast<vec3<i32>>(velocities[grid_node(index)].xyz);
        atomicStore(&tile[index], velocity.x);
        atomicStore(&tile[index + 512u], velocity.y);
        atomicStore(&tile[index + 1024u], velocity.z);
    }
}

// APIC gather (Jiang et al. 2015): `v = Σ w v`, and the affine matrix `4 Σ w v dᵀ` with d in cells.
fn gather(local: vec3<f32>) -> Motion {
    let kernel = kernel_at(local);
    var weights = kernel.weights;
    var velocity = vec3(0.0);
    var affine = mat3x3<f32>();
    for (var i = 0u; i < 3u; i++) {
        for (var j = 0u; j < 3u; j++) {
            let row = kernel.first + i * TILE_X + j * TILE_Y;
            let weight = weights[i].x * weights[j].y;
            for (var k = 0u; k < 3u; k++) {
                let node = row + k;
                let bits = vec3(
                    atomicLoad(&tile[node]),
                    atomicLoad(&tile[node + 512u]),
                    atomicLoad(&tile[node + 1024u]),
                );
                let term = bitcast<vec3<f32>>(bits) * (weight * weights[k].z);
                let d = kernel.distance + vec3(f32(i), f32(j), f32(k));
                velocity += term;
                affine[0] += term * d.x;
                affine[1] += term * d.y;
                affine[2] += term * d.z;
            }
        }
    }
    return Motion(velocity, affine * 4.0);
}

fn load_part(index: u32, part: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(particles[index + part * params.particles]);
}

fn store_part(index: u32, part: u32, value: vec4<f32>) {
    particles[index + part * params.particles] = bitcast<vec4<u32>>(value);
}

fn load_motion(index: u32) -> Motion {
    let a = load_part(index, 4u);
    let b = load_part(index, 5u);
    let c = load_part(index, 6u);
    return Motion(a.xyz, mat3x3(vec3(a.w, b.xy), vec3(b.zw, c.x), c.yzw));
}

fn store_motion(index: u32, motion: Motion) {
    let affine = motion.affine;
    store_part(index, 4u, vec4(motion.velocity, affine[0].x));
    store_part(index, 5u, vec4(affine[0].yz, affine[1].xy));
    store_part(index, 6u, vec4(affine[1].z, affine[2]));
}

// Mass and momentum that a particle scatters, in quanta.
struct Load {
    local: vec3<f32>,
    mass: f32,
    momentum: vec3<f32>,
    friction: f32,
    // Change of momentum over a cell along each axis, with that by stress.
    affine: mat3x3<f32>,
}

// Packs the rounding error of a particle's momentum, in 1024ths of a quantum and 10 bits a component. It is
// added to the next gathered velocity, so that momentum is conserved to the precision of f32.
fn pack_rest(rest: vec3<f32>) -> u32 {
    let bits = vec3<u32>(clamp(vec3<i32>(round(rest * 1024.0)), vec3(-511), vec3(511)) + 512);
    return bits.x | bits.y << 10u | bits.z << 20u;
}

// Velocity that corresponds to the packed rounding error of the substep before.
fn rest_velocity(index: u32) -> vec3<f32> {
    let constants = particles[index + 3u * params.particles];
    let bits = vec3(constants.w, constants.w >> 10u, constants.w >> 20u) & vec3(1023u);
    let mass = bitcast<f32>(constants.y) * materials[constants.z >> 24u].density;
    return (vec3<f32>(bits) - 512.0) / (1024.0 * mass * substep.gather_scale);
}

// Moves and strains a particle by a substep, and returns what it scatters.
fn advance_particle(index: u32, motion: Motion) -> Load {
    let place = load_part(index, 0u);
    var constants = particles[index + 3u * params.particles];
    let material = materials[constants.z >> 24u];
    let scale = substep.dt / params.cell_size;
    let local = place.xyz + motion.velocity * scale;
    // All three nodes of a kernel along each axis are in the tile for positions from −1 to below 5.
    if (any(local < vec3(-1.0)) || any(local >= vec3(5.0))) {
        atomicOr(&counters.faults, DRIFTED);
    }
    var strain = Strain(mat3x3<f32>(), place.w, motion.affine * scale, substep.dt);
    if (HAS_DEFORMATION) {
        let a = load_part(index, 1u);
        let b = load_part(index, 2u);
        strain.deformation = mat3x3(a.xyz, vec3(a.w, b.xy), vec3(b.zw, bitcast<f32>(constants.x)));
    }
    let response = advance_material(material, strain);
    if (HAS_DEFORMATION) {
        let f = response.deformation;
        store_part(index, 1u, vec4(f[0], f[1].x));
        store_part(index, 2u, vec4(f[1].yz, f[2].xy));
        constants.x = bitcast<u32>(f[2].z);
    }
    store_part(index, 0u, vec4(local, response.state));
    // Non-negative f32 have the same order as their bits.
    atomicMax(&sound_max, bitcast<u32>(material.sound * response.stiffening));
    // Stress impulse per cell of distance: `−dt V₀ (4/Δx²) τ Δx` (Hu et al. 2018, equation 16).
    let volume = bitcast<f32>(constants.y);
    let factor = -4.0 * scale * volume * substep.momentum_scale;
    let stress = mat3x3(
        vec3(response.diagonal.x, response.shear.xy),
        vec3(response.shear.x, response.diagonal.y, response.shear.z),
        vec3(response.shear.yz, response.diagonal.z),
    );
    let mass = volume * material.density;
    let momentum_scale = mass * substep.momentum_scale;
    let affine = motion.affine * momentum_scale + stress * factor;
    let momentum = motion.velocity * momentum_scale;
    constants.w = pack_rest(momentum - round(momentum));
    particles[index + 3u * params.particles] = constants;
    if (!(is_finite(affine[0]) && is_finite(affine[1]) && is_finite(affine[2]))) {
        atomicOr(&counters.faults, NOT_FINITE);
    }
    return Load(local, mass * params.mass_scale, momentum, material.friction, affine);
}

// Adds a particle to the tile. The centre node gets the rounding errors of the others, so that the sums
// over all 27 nodes are exactly the particle's rounded momentum and mass.
fn scatter(load: Load) {
    let kernel = kernel_at(load.local);
    var weights = kernel.weights;
    let whole = vec4<i32>(round(vec4(load.momentum, load.mass)));
    var rest = whole;
    for (var i = 0u; i < 3u; i++) {
        for (var j = 0u; j < 3u; j++) {
            let row = kernel.first + i * TILE_X + j * TILE_Y;
            let weight = weights[i].x * weights[j].y;
            let d = kernel.distance.xy + vec2(f32(i), f32(j));
            let momentum = load.momentum + load.affine[0] * d.x + load.affine[1] * d.y;
            for (var k = 0u; k < 3u; k++) {
                if (i == 1u && j == 1u && k == 1u) {
                    continue;
                }
                let dz = kernel.distance.z + f32(k);
                let terms = vec4(momentum + load.affine[2] * dz, load.mass) * (weight * weights[k].z);
                let quanta = vec4<i32>(round(terms));
                rest -= quanta;
                add_quanta(row + k, quanta);
            }
        }
    }
    add_quanta(kernel.first + TILE_X + TILE_Y + 1u, rest);
    scatter_friction(kernel, load);
}

fn add_quanta(node: u32, quanta: vec4<i32>) {
    atomicAdd(&tile[node], quanta.x);
    atomicAdd(&tile[node + 512u], quanta.y);
    atomicAdd(&tile[node + 1024u], quanta.z);
    atomicAdd(&tile[node + 1536u], quanta.w);
}

fn clear_tile(lane: u32) {
    for (var index = lane; index < 2048u; index += CHUNK) {
        atomicStore(&tile[index], 0);
    }
    clear_friction(lane);
}

fn flush_tile(lane: u32) {
    for (var index = lane; index < TILE_NODES; index += CHUNK) {
        let quanta = vec4(
            atomicLoad(&tile[index]),
            atomicLoad(&tile[index + 512u]),
            atomicLoad(&tile[index + 1024u]),
            atomicLoad(&tile[index + 1536u]),
        );
        // Skips empty nodes, as most of the margin is, to save global atomics.
        if (any(quanta != vec4(0))) {
            let node = grid_node(index);
            atomicAdd(&sums[4u * node], quanta.x);
            atomicAdd(&sums[4u * node + 1u], quanta.y);
            atomicAdd(&sums[4u * node + 2u], quanta.z);
            atomicAdd(&sums[4u * node + 3u], quanta.w);
            flush_friction(index, node);
        }
    }
}

@compute @workgroup_size(CHUNK)
fn transfer(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    if (lane == 0u) {
        chunk = chunks[group.x + group.y * groups.x];
        substep = control;
        atomicStore(&sound_max, 0u);
    }
    let now = workgroupUniformLoad(&substep);
    let particle_count = workgroupUniformLoad(&chunk).len;
    if (now.gather == 0u && now.scatter == 0u) {
        return;
    }
    let is_particle = lane < particle_count;
    let index = chunk.start + lane;
    var motion: Motion;
    if (now.gather != 0u) {
        load_tile(lane);
    }
    workgroupBarrier();
    if (is_particle) {
        if (now.gather != 0u) {
            motion = gather(load_part(index, 0u).xyz);
            motion.velocity += rest_velocity(index);
            if (!is_finite(motion.velocity)) {
                atomicOr(&counters.faults, NOT_FINITE);
                // Keeps positions finite.
                motion = Motion(vec3(0.0), mat3x3<f32>());
            }
        } else {
            motion = load_motion(index);
        }
        if (now.scatter == 0u) {
            store_motion(index, motion);
        }
    }
    workgroupBarrier();
    if (now.scatter == 0u) {
        return;
    }
    clear_tile(lane);
    workgroupBarrier();
    if (is_particle) {
        let load = advance_particle(index, motion);
        scatter(load);
        if (params.balls > 0u) {
            let volume = bitcast<f32>(particles[index + 3u * params.particles].y);
            scatter_touch(load.local, motion.velocity, volume, load.mass);
        }
    }
    workgroupBarrier();
    flush_tile(lane);
    if (lane == 0u) {
        atomicMax(&counters.sound, atomicLoad(&sound_max));
    }
}
