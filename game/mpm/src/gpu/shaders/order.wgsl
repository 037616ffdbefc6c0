// Counting sort of particles by block. The order within a block and of the blocks varies from run to run,
// which changes no result, as sums are of integers.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> control: Control;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(3) var<storage, read> chunks: array<Chunk>;
@group(0) @binding(4) var<storage, read> particles: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read> balls: array<Ball>;
@group(0) @binding(12) var<storage, read_write> table: array<TableRow>;
// Block and rank of each particle.
@group(0) @binding(13) var<storage, read_write> keys: array<vec2<u32>>;
@group(0) @binding(14) var<storage, read_write> nodes: array<u32>;
@group(0) @binding(15) var<storage, read_write> next_chunks: array<Chunk>;
@group(0) @binding(16) var<storage, read_write> next_particles: array<vec4<u32>>;
// Indirect dispatch sizes over chunks, then over blocks of nodes.
@group(0) @binding(17) var<storage, read_write> dispatch_sizes: array<u32, 6>;

fn table_len() -> u32 {
    return params.blocks.x * params.blocks.y * params.blocks.z;
}

@compute @workgroup_size(256)
fn clear_table(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let row = (group.x + group.y * groups.x) * 256u + lane;
    if (row < table_len()) {
        atomicStore(&table[row].count, 0u);
        atomicStore(&table[row].reach, 0u);
        atomicStore(&table[row].is_active, 0u);
    }
    if (row == 0u) {
        atomicStore(&counters.particles, 0u);
        atomicStore(&counters.chunks, 0u);
        atomicStore(&counters.nodes, 0u);
        for (var axis = 0u; axis < 3u; axis++) {
            atomicStore(&counters.low[axis], 0x7fffffff);
            atomicStore(&counters.high[axis], -0x7fffffff);
        }
    }
}

// Offset from a particle's old block to its new one, in blocks.
fn shift_of(local: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(clamp(floor(local / 4.0), vec3(-1.0), vec3(1.0)));
}

fn moved_local(local: vec3<f32>) -> vec3<f32> {
    // The subtraction may round up to the edge, which is outside the block.
    return clamp(local - vec3<f32>(shift_of(local) * 4), vec3(0.0), vec3(3.9999998));
}

// One bit for each of the 27 blocks whose nodes a particle can reach until the next sorting.
fn reach_of(local: vec3<f32>) -> u32 {
    let low = vec3<i32>(floor((local - DRIFT_MAX) / 4.0));
    let high = vec3<i32>(floor((local + DRIFT_MAX + 2.0) / 4.0));
    var bits = 0u;
    for (var x = low.x; x <= high.x; x++) {
        for (var y = low.y; y <= high.y; y++) {
            for (var z = low.z; z <= high.z; z++) {
                bits |= 1u << u32((x + 1) * 9 + (y + 1) * 3 + z + 1);
            }
        }
    }
    return bits;
}

@compute @workgroup_size(CHUNK)
fn count_particles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let chunk = chunks[group.x + group.y * groups.x];
    if (lane >= chunk.len) {
        return;
    }
    let index = chunk.start + lane;
    let local = bitcast<vec3<f32>>(particles[index].xyz);
    // The outermost blocks of the region are reserved for the nodes around particles.
    let in_region = chunk.block + shift_of(local) - params.origin;
    let last = vec3<i32>(params.blocks) - 2;
    let block = clamp(in_region, vec3(1), last);
    if (any(block != in_region)) {
        atomicOr(&counters.faults, LEFT_REGION);
    }
    let row = block_index(vec3<u32>(block), params.blocks);
    let reach = reach_of(moved_local(local));
    // Usually all bits are set already; the load avoids a contended atomic.
    if ((atomicLoad(&table[row].reach) & reach) != reach) {
        atomicOr(&table[row].reach, reach);
    }
    keys[index] = vec2(row, atomicAdd(&table[row].count, 1u));
}

@compute @workgroup_size(64)
fn allocate_chunks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let row = (group.x + group.y * groups.x) * 64u + lane;
    if (row >= table_len()) {
        return;
    }
    let count = atomicLoad(&table[row].count);
    if (count == 0u) {
        return;
    }
    let start = atomicAdd(&counters.particles, count);
    table[row].start = start;
    let in_region = vec3(
        row / (params.blocks.z * params.blocks.y),
        row / params.blocks.z % params.blocks.y,
        row % params.blocks.z,
    );
    let block = params.origin + vec3<i32>(in_region);
    for (var axis = 0u; axis < 3u; axis++) {
        atomicMin(&counters.low[axis], block[axis]);
        atomicMax(&counters.high[axis], block[axis]);
    }
    let parts = (count + CHUNK - 1u) / CHUNK;
    let first = atomicAdd(&counters.chunks, parts);
    var from_particle = 0u;
    for (var part = 0u; part < parts; part++) {
        // Even parts, so that none is nearly empty.
        let len = (count - from_particle) / (parts - part);
        next_chunks[first + part] = Chunk(block, start + from_particle, len, 0u, 0u, 0u);
        from_particle += len;
    }
    let reach = atomicLoad(&table[row].reach);
    for (var side = 0u; side < 27u; side++) {
        if ((reach >> side & 1u) != 0u) {
            let offset = vec3<i32>(vec3(side / 9u, side / 3u % 3u, side % 3u)) - 1;
            let node = block_index(vec3<u32>(vec3<i32>(in_region) + offset), params.blocks);
            // Only the thread that sets the flag lists the block of nodes.
            if (atomicExchange(&table[node].is_active, 1u) == 0u) {
                nodes[atomicAdd(&counters.nodes, 1u)] = node;
            }
        }
    }
}

// Stores the columns and rows of an indirect dispatch of at least `count` workgroups, and returns their
// number. The caller fills the surplus at the end with empty work.
fn set_dispatch(at: u32, count: u32) -> u32 {
    let rows = max((count + GROUPS_X_MAX - 1u) / GROUPS_X_MAX, 1u);
    let columns = (count + rows - 1u) / rows;
    dispatch_sizes[at] = columns;
    dispatch_sizes[at + 1u] = rows;
    dispatch_sizes[at + 2u] = 1u;
    return rows * columns;
}

@compute @workgroup_size(1)
fn finish_ordering() {
    let chunk_count = atomicLoad(&counters.chunks);
    let node_count = atomicLoad(&counters.nodes);
    let chunk_end = set_dispatch(0u, chunk_count);
    for (var i = chunk_count; i < chunk_end; i++) {
        next_chunks[i] = Chunk(params.origin, 0u, 0u, 0u, 0u, 0u);
    }
    let node_end = set_dispatch(3u, node_count);
    for (var i = node_count; i < node_end; i++) {
        // Block 0, a corner of the region, which no particle reaches.
        nodes[i] = 0u;
    }
    var c = control;
    c.drift = 0.0;
    c.gather = 0u;
    c.group_left = params.group;
    c.orderings += 1u;
    control = plan(c);
}

@compute @workgroup_size(CHUNK)
fn move_particles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let chunk = chunks[group.x + group.y * groups.x];
    if (lane >= chunk.len) {
        return;
    }
    let index = chunk.start + lane;
    let key = keys[index];
    let to = table[key.x].start + key.y;
    let place = particles[index];
    next_particles[to] = vec4(bitcast<vec3<u32>>(moved_local(bitcast<vec3<f32>>(place.xyz))), place.w);
    for (var part = 1u; part < 7u; part++) {
        next_particles[to + part * params.particles] = particles[index + part * params.particles];
    }
}
