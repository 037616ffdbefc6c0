// Contact detection between particles and balls, as in `touch.rs`. Sums of each node, in quanta of mass: of
// `w m n`, with n the unit normal away from the ball, and of `w m d`, with d the depth of overlap in cells.
// A particle touches at most one ball, the one with the deepest overlap.

@group(0) @binding(10) var<storage, read> balls: array<Ball>;
@group(0) @binding(18) var<storage, read_write> touches: array<atomic<i32>>;

// Cube root of a particle's volume over a cell's, clamped to 1e-9..=1, as in `touch.rs`.
fn cube_root(volume: f32) -> f32 {
    let value = clamp(volume, 1e-9, 1.0);
    // Kahan's initial value, an exponent divided by 3, then Newton's method.
    var root = bitcast<f32>(bitcast<u32>(value) / 3u + 0x2a5119f2u);
    for (var i = 0u; i < 3u; i++) {
        root -= (root - value / (root * root)) / 3.0;
    }
    return root;
}

// Finds the ball that a particle touches and adds its sums. `local` is in cells from the first node of the
// chunk's block, less one half; `velocity` in m/s, `volume` in m³ and `mass` in quanta.
fn scatter_touch(local: vec3<f32>, velocity: vec3<f32>, volume: f32, mass: f32) {
    let at = vec3<f32>((chunk.block - params.origin) * 4) + local + 0.5;
    let cell = params.cell_size;
    let extent = 0.5 * cube_root(volume / (cell * cell * cell));
    var deepest = -1e9;
    var ball = 0u;
    var normal = vec3(0.0, 0.0, 1.0);
    for (var i = 0u; i < params.balls; i++) {
        let arm = at - (balls[i].position + balls[i].moved);
        let distance = length(arm);
        let depth = balls[i].radius + extent - distance;
        let away = select(arm / distance, vec3(0.0, 0.0, 1.0), distance < 1e-6);
        let nearing = -dot(velocity - balls[i].velocity, away) * substep.dt / cell;
        if (depth + max(nearing, 0.0) > -MARGIN_CELLS && depth > deepest) {
            deepest = depth;
            ball = i;
            normal = away;
        }
    }
    if (deepest == -1e9) {
        return;
    }
    atomicOr(&counters.touched, 1u << ball);
    let kernel = kernel_at(local);
    var weights = kernel.weights;
    let load = vec4(normal, clamp(deepest, 0.0, 1.0)) * mass;
    for (var i = 0u; i < 27u; i++) {
        let step = vec3(i / 9u, i / 3u % 3u, i % 3u);
        let weight = weights[step.x].x * weights[step.y].y * weights[step.z].z;
        let quanta = vec4<i32>(round(load * weight));
        let node = 4u * grid_node(kernel.first + step.x * TILE_X + step.y * TILE_Y + step.z);
        atomicAdd(&touches[node], quanta.x);
        atomicAdd(&touches[node + 1u], quanta.y);
        atomicAdd(&touches[node + 2u], quanta.z);
        atomicAdd(&touches[node + 3u], quanta.w);
    }
}
