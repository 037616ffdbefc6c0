// Coefficient of friction of nodes: the mean of the particles' materials weighted by mass, for materials of
// different coefficients. Sums are of friction times mass, whose quantum is 16 of mass so that coefficients
// above 1 fit.

@group(0) @binding(8) var<storage, read_write> friction_sums: array<atomic<i32>>;

var<workgroup> friction_tile: array<atomic<i32>, 512>;

fn scatter_friction(kernel: Kernel, load: Load) {
    var weights = kernel.weights;
    let friction = load.mass * load.friction / 16.0;
    for (var i = 0u; i < 3u; i++) {
        for (var j = 0u; j < 3u; j++) {
            for (var k = 0u; k < 3u; k++) {
                let node = kernel.first + i * TILE_X + j * TILE_Y + k;
                let weight = weights[i].x * weights[j].y * weights[k].z;
                atomicAdd(&friction_tile[node], i32(round(friction * weight)));
            }
        }
    }
}

fn clear_friction(lane: u32) {
    for (var index = lane; index < 512u; index += CHUNK) {
        atomicStore(&friction_tile[index], 0);
    }
}

fn flush_friction(index: u32, node: u32) {
    atomicAdd(&friction_sums[node], atomicLoad(&friction_tile[index]));
}
