// Frustum culling: the candidates of a block of 8 × 8 pixels are the primitives that its camera
// rays may hit.

// Bit i of a shape's words is set if its primitive i is a candidate.
var<workgroup> block_candidates: array<atomic<u32>, CANDIDATE_WORDS * WORKGROUP_BLOCKS>;

// Unit normals of four planes through the eye; all rays are on the positive sides.
struct Frustum {
    left: vec3f,
    right: vec3f,
    top: vec3f,
    bottom: vec3f,
}

// Bounds of a primitive, and the position of its candidate bit.
struct CandidateBound {
    center: vec3f,
    half: vec3f,
    word: u32,
    bit: u32,
}

// The frustum of the block whose first pixel is (`x`, `y`), enlarged by a quarter of a pixel on
// each side.
fn block_frustum(x: u32, y: u32) -> Frustum {
    let camera = scene.header.camera;
    // Samples lie within their pixels; the quarter absorbs the rounding of the planes.
    let first = vec2f(f32(x), f32(y)) - 0.25;
    let last = first + f32(BLOCK_EDGE) + 0.5;
    // The direction of the cross products depends on the handedness of the film's axes.
    let side = sign(dot(cross(camera.corner, camera.dy), camera.dx));
    return Frustum(
        side * normalize(cross(camera.corner + first.x * camera.dx, camera.dy)),
        -side * normalize(cross(camera.corner + last.x * camera.dx, camera.dy)),
        -side * normalize(cross(camera.corner + first.y * camera.dy, camera.dx)),
        side * normalize(cross(camera.corner + last.y * camera.dy, camera.dx)),
    );
}

// Whether a part of a box may lie in a frustum.
fn may_lie_in(frustum: Frustum, center: vec3f, half: vec3f) -> bool {
    let to_center = center - scene.header.camera.eye;
    let slack = FRUSTUM_SLACK * (largest(abs(to_center)) + largest(half));
    let is_outside = reach(frustum.left, to_center, half) < -slack
        || reach(frustum.right, to_center, half) < -slack
        || reach(frustum.top, to_center, half) < -slack
        || reach(frustum.bottom, to_center, half) < -slack;
    return !is_outside;
}

// Signed distance from the plane of the box's farthest point.
fn reach(normal: vec3f, center: vec3f, half: vec3f) -> f32 {
    // That is the corner farthest along the normal. If even this one is behind the plane, the whole
    // box is.
    return dot(normal, center) + dot(abs(normal), half);
}

// Finds the candidates of a block; its threads share the work. Must be called by all threads of a
// workgroup.
fn find_block_candidates(place: Place, thread: u32) {
    let local = thread % BLOCK_PIXELS;
    let frustum = block_frustum(place.x - local % BLOCK_EDGE, place.y - local / BLOCK_EDGE);
    // The rays of a lens have no common origin, so nothing is culled.
    let has_lens = scene.header.camera.lens_steps > 0.0;
    let first_word = CANDIDATE_WORDS * (thread / BLOCK_PIXELS);
    for (var i = local; i < CULLED_COUNT; i += BLOCK_PIXELS) {
        let bound = candidate_bound(i);
        if (has_lens || may_lie_in(frustum, bound.center, bound.half)) {
            // Workgroup memory is zero-initialised in WGSL, and each block has words of its own.
            atomicOr(&block_candidates[first_word + bound.word], 1u << bound.bit);
        }
    }
    workgroupBarrier();
}

// One word of a block's candidates.
fn candidates_of_block(block: u32, word: u32) -> u32 {
    return atomicLoad(&block_candidates[CANDIDATE_WORDS * block + word]);
}
