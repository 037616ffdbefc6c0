// The passes of the denoiser; see `denoise/filter.rs` for the algorithm and its parameters.
//
// Traced pixels are stored tile by tile; guides and light are stored row by row for the region that
// encloses the tiles.

struct FilterData {
    // The region in image coordinates.
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    tile_count: u32,
    block_count: u32,
    samples: u32,
    // Distance of taps in pixels.
    step: i32,
    // Factor of the variance in the distance of light.
    variances: f32,
    // Factors of squared differences.
    normal_factor: f32,
    albedo_factor: f32,
    depth_factor: f32,
    // Weights of taps at the sides and at the corners.
    side_weight: f32,
    corner_weight: f32,
    // The first half's fraction of the samples.
    half_share: f32,
    half_ratio: f32,
    // Fraction of the camera rays of an edge pixel that are in `further_hits`; 0 if there are none.
    further_share: f32,
    // Number of traced pixels.
    pixels: u32,
    // Exposure of tone-mapped frames.
    exposure: f32,
}

@group(0) @binding(0) var<uniform> job: FilterData;
@group(0) @binding(4) var<storage, read_write> counters: array<atomic<u32>>;
// Means of the second half of the samples of all traced pixels, then of the first half; of a single
// sample only the former.
@group(0) @binding(3) var<storage, read> halves: array<f32>;
// AOVs of first hits, as `Aovs`.
@group(0) @binding(5) var<storage, read> hits: array<f32>;
@group(0) @binding(6) var<storage, read> further_hits: array<f32>;
// Two vectors per pixel: albedo and inverse depth; normal and 1 plus the sum of its emission. All 0
// where nothing was traced.
@group(0) @binding(7) var<storage, read_write> guides: array<vec4f>;
// Light divided by albedo, and its variance.
@group(0) @binding(8) var<storage, read> light_from: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> light_to: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> film: array<f32>;
// sRGB of each pixel with one byte per channel, in the film's buffer.
@group(0) @binding(11) var<storage, read_write> shown: array<u32>;
// Pixels at edges, in arbitrary order.
@group(0) @binding(13) var<storage, read_write> edges: array<TileEntry>;

fn is_inside(p: vec2i) -> bool {
    return all(p >= vec2i(0)) && all(vec2u(p) < vec2u(job.width, job.height));
}

fn index_of(p: vec2i) -> u32 {
    return u32(p.y) * job.width + u32(p.x);
}

// The pixel of a thread in a workgroup of one block; there may be more workgroups than blocks.
fn place_in_job(group: vec3u, groups: vec3u, local: u32) -> Place {
    let block = group.y * groups.x + group.x;
    var place = place_of(min(block, job.block_count - 1u), local);
    place.is_inside = place.is_inside && block < job.block_count;
    return place;
}

fn place_in_region(place: Place) -> vec2i {
    return vec2i(vec2u(place.x, place.y)) - vec2i(vec2u(job.x, job.y));
}

fn is_traced(i: u32) -> bool {
    return guides[2u * i + 1u].w > 0.0;
}

@compute @workgroup_size(BLOCK_EDGE * BLOCK_EDGE)
fn take_in(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let place = place_in_job(group, groups, local);
    let p = place_in_region(place);
    if (!place.is_inside || !is_inside(p)) {
        return;
    }
    let i = index_of(p);
    let first = AOV_FLOATS * place.pixel;
    let albedo = vec3f(hits[first], hits[first + 1u], hits[first + 2u]);
    let normal = vec3f(hits[first + 3u], hits[first + 4u], hits[first + 5u]);
    guides[2u * i] = vec4f(albedo, hits[first + 6u]);
    let brightness = hits[first + 7u] + hits[first + 8u] + hits[first + 9u];
    // The 1 distinguishes traced pixels from those that clearing has left at 0.
    guides[2u * i + 1u] = vec4f(normal, 1.0 + brightness);
    var light = half_at(place.pixel);
    // Light divided by albedo is smooth across textures, so the filter need not preserve their
    // detail. At the end it is multiplied by the same sum, so black surfaces lose no light.
    let divisor = albedo + ALBEDO_MIN;
    var variance = 0.0;
    if (job.samples > 1u) {
        let early = half_at(job.pixels + place.pixel);
        light += job.half_share * (early - light);
        // The difference of the means of two halves estimates the standard error of the overall
        // mean, scaled by `half_ratio`.
        let apart = job.half_ratio * (early - light) / divisor;
        variance = dot(apart, apart);
    }
    light_to[i] = vec4f(light / divisor, variance);
}

fn half_at(pixel: u32) -> vec3f {
    return vec3f(halves[3u * pixel], halves[3u * pixel + 1u], halves[3u * pixel + 2u]);
}

// Lists the pixels that differ from a neighbour, as tiles for the kernel that traces first hits.
@compute @workgroup_size(BLOCK_EDGE * BLOCK_EDGE)
fn list_edges(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let place = place_in_job(group, groups, local);
    if (place.is_inside && is_edge(place_in_region(place))) {
        // The order depends on timing, but images do not, as each entry contains its own position.
        let index = atomicAdd(&counters[LISTED_PIXELS], 1u);
        edges[index] = TileEntry(place.x, place.y, 1u, 1u, 0u, place.pixel);
    }
}

@compute @workgroup_size(BLOCK_EDGE, BLOCK_EDGE)
fn estimate_variance(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!is_inside(p)) {
        return;
    }
    var count = 0.0;
    var sum = vec3f(0.0);
    var squares = 0.0;
    for (var dy = -1; dy <= 1; dy++) {
        for (var dx = -1; dx <= 1; dx++) {
            let at = p + vec2i(dx, dy);
            if (is_inside(at) && is_traced(index_of(at))) {
                let light = light_from[index_of(at)];
                count += 1.0;
                if (job.samples == 1u) {
                    sum += light.xyz;
                    squares += dot(light.xyz, light.xyz);
                } else {
                    squares += light.w;
                }
            }
        }
    }
    let mean = sum / max(count, 1.0);
    let variance = max(squares / max(count, 1.0) - dot(mean, mean), 0.0);
    let i = index_of(p);
    // An outlier is as uncertain as its own variance says, not as that of its neighbours.
    light_to[i] = vec4f(light_from[i].xyz, max(variance, light_from[i].w));
}

// Features of a pixel that taps are weighted by, and the sums over taps so far.
struct Look {
    albedo: vec3f,
    normal: vec3f,
    inverse_depth: f32,
    depth_factor: f32,
    light: vec3f,
    light_factor: f32,
    sum: vec3f,
    weights: f32,
    // Sum of squared weights.
    squares: f32,
}

@compute @workgroup_size(BLOCK_EDGE, BLOCK_EDGE)
fn smooth_light(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    if (!is_inside(p) || !is_traced(index_of(p))) {
        return;
    }
    let i = index_of(p);
    let light = light_from[i];
    let depth = guides[2u * i].w;
    // Relative to the pixel's depth, as the footprint of a pixel grows with distance.
    let depth_factor = job.depth_factor / max(depth * depth, 1e-20);
    let normal = guides[2u * i + 1u].xyz;
    let variance = mean_variance(p, light.w);
    let light_factor = 1.0 / (variance * job.variances + 1e-10);
    var here = Look(
        guides[2u * i].xyz, normal, depth, depth_factor, light.xyz, light_factor, light.xyz, 1.0, 1.0,
    );
    add_taps(p, &here);
    let inverse = 1.0 / here.weights;
    // Variance of a weighted mean of independent values of equal variance: Σw² / (Σw)² times
    // theirs.
    light_to[i] = vec4f(here.sum * inverse, variance * here.squares * (inverse * inverse));
}

// Mean of a pixel's variance and those of its taps. In the first pass the variances are such means
// already.
fn mean_variance(p: vec2i, own: f32) -> f32 {
    if (job.step == FIRST_STEP) {
        return own;
    }
    var sum = 0.0;
    var count = 0.0;
    for (var n = 0; n < 9; n++) {
        let at = p + job.step * (vec2i(n % 3, n / 3) - 1);
        if (is_inside(at) && is_traced(index_of(at))) {
            sum += light_from[index_of(at)].w;
            count += 1.0;
        }
    }
    return sum / count;
}

fn add_tap(p: vec2i, tap_weight: f32, here: ptr<function, Look>) {
    if (!is_inside(p) || !is_traced(index_of(p))) {
        return;
    }
    let i = index_of(p);
    let light = light_from[i].xyz;
    let by_light = (*here).light - light;
    let by_albedo = (*here).albedo - guides[2u * i].xyz;
    let by_normal = (*here).normal - guides[2u * i + 1u].xyz;
    let by_depth = (*here).inverse_depth - guides[2u * i].w;
    var distance = dot(by_light, by_light) * (*here).light_factor;
    distance += dot(by_albedo, by_albedo) * job.albedo_factor;
    distance += dot(by_normal, by_normal) * job.normal_factor;
    distance += by_depth * by_depth * (*here).depth_factor;
    // A kernel of finite support: it needs no exponential, and taps across an edge have a weight of
    // exactly 0.
    if (distance < 1.0) {
        let weight = (1.0 - distance) * (1.0 - distance) * tap_weight;
        (*here).weights += weight;
        (*here).squares += weight * weight;
        (*here).sum += light * weight;
    }
}

@compute @workgroup_size(BLOCK_EDGE * BLOCK_EDGE)
fn resolve(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    if (block >= job.block_count) {
        return;
    }
    let place = place_of(block, local);
    var light = vec3f(0.0);
    if (place.is_inside) {
        light = result(place_in_region(place), place.pixel);
    }
    set_block(place, true, local, light);
}

@compute @workgroup_size(BLOCK_EDGE * BLOCK_EDGE)
fn resolve_srgb8(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let place = place_in_job(group, groups, local);
    if (place.is_inside) {
        shown[place.pixel] = srgb8(job.exposure * result(place_in_region(place), place.pixel));
    }
}

fn result(p: vec2i, pixel: u32) -> vec3f {
    let light = radiance_at(index_of(p));
    let first = AOV_FLOATS * pixel + 7u;
    let emission = vec3f(hits[first], hits[first + 1u], hits[first + 2u]);
    if (job.further_share == 0.0 || !is_edge(p)) {
        return light + emission;
    }
    let further = vec3f(further_hits[first], further_hits[first + 1u], further_hits[first + 2u]);
    return mixed(p, pixel, light) + emission + job.further_share * (further - emission);
}

// Whether a pixel differs from one of its four neighbours.
fn is_edge(p: vec2i) -> bool {
    return differs(p, vec2i(-1, 0)) || differs(p, vec2i(1, 0)) || differs(p, vec2i(0, -1))
        || differs(p, vec2i(0, 1));
}

fn differs(p: vec2i, step: vec2i) -> bool {
    if (!is_inside(p + step) || !is_traced(index_of(p + step))) {
        return false;
    }
    let here = index_of(p);
    let there = index_of(p + step);
    let apart = difference(appearance(here), appearance(there));
    let bright = vec2f(guides[2u * here + 1u].w, guides[2u * there + 1u].w) - 1.0;
    return product(apart, apart) > EDGE_MIN
        || abs(bright.x - bright.y) > BRIGHTNESS_SHARE * max(bright.x, bright.y);
}

fn radiance_at(i: u32) -> vec3f {
    return light_from[i].xyz * (guides[2u * i].xyz + ALBEDO_MIN);
}

// Features by which edges are detected: albedo and half the normal.
struct Appearance {
    albedo: vec3f,
    half_normal: vec3f,
}

fn appearance(i: u32) -> Appearance {
    return Appearance(guides[2u * i].xyz, 0.5 * guides[2u * i + 1u].xyz);
}

fn product(a: Appearance, b: Appearance) -> f32 {
    return dot(a.albedo, b.albedo) + dot(a.half_normal, b.half_normal);
}

fn difference(a: Appearance, b: Appearance) -> Appearance {
    return Appearance(a.albedo - b.albedo, a.half_normal - b.half_normal);
}

// The mixture with a neighbour whose appearance is nearest to that seen by all rays.
fn mixed(p: vec2i, pixel: u32, light: vec3f) -> vec3f {
    let first = AOV_FLOATS * pixel;
    let albedo = vec3f(further_hits[first], further_hits[first + 1u], further_hits[first + 2u]);
    let normal = vec3f(further_hits[first + 3u], further_hits[first + 4u], further_hits[first + 5u]);
    let here = appearance(index_of(p));
    let further = difference(Appearance(albedo, 0.5 * normal), here);
    let wanted = Appearance(job.further_share * further.albedo, job.further_share * further.half_normal);
    var nearest = product(wanted, wanted);
    var best = light;
    if (nearest <= MIXED_MIN) {
        return best;
    }
    for (var n = 0; n < 9; n++) {
        let at = p + vec2i(n % 3, n / 3) - 1;
        if (n == 4 || !is_inside(at) || !is_traced(index_of(at))) {
            continue;
        }
        let i = index_of(at);
        let other = difference(appearance(i), here);
        // Orthogonal projection of the appearance seen by all rays onto the line between the two
        // pixels' appearances.
        let share = clamp(product(wanted, other) / (product(other, other) + 1e-4), 0.0, 1.0);
        let nearer = Appearance(other.albedo * share, other.half_normal * share);
        let missing = difference(wanted, nearer);
        let distance = product(missing, missing);
        // The margin keeps rounding, in which CPU and GPU differ, from deciding between equally
        // near neighbours.
        if (distance < nearest * 0.999) {
            nearest = distance;
            best = light + share * (radiance_at(i) - light);
        }
    }
    return best;
}
