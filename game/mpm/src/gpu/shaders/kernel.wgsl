// Quadratic B-splines over the 3x3x3 nodes around a particle.

struct Kernel {
    // Index in the tile of the first node.
    first: u32,
    // From the particle to the first node, in cells.
    distance: vec3<f32>,
    // Weights of the three nodes along each axis.
    weights: array<vec3<f32>, 3>,
}

// The kernel of a particle at a position in cells from its block's first node, less one half. The tile
// begins one node before the block.
fn kernel_at(local: vec3<f32>) -> Kernel {
    let base = clamp(floor(local), vec3(-1.0), vec3(4.0));
    // From the first node to the particle, 0.5 to 1.5 cells.
    let x = local - base + 0.5;
    let a = 1.5 - x;
    let b = x - 1.0;
    let c = x - 0.5;
    let start = vec3<u32>(vec3<i32>(base) + 1);
    let first = start.x * TILE_X + start.y * TILE_Y + start.z;
    return Kernel(first, -x, array(0.5 * a * a, 0.75 - b * b, 0.5 * c * c));
}
