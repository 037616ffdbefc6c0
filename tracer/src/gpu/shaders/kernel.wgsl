// One thread per pixel of a run of tiles, in blocks of 8 x 8.

@group(0) @binding(1) var<uniform> job: DispatchData;
// The mean of each pixel's samples: red, green, blue, or its `Aovs`, whose sum lies here before.
@group(0) @binding(3) var<storage, read_write> film: array<f32>;
// Rays (low and high word), then the dropped samples of each tile.
@group(0) @binding(4) var<storage, read_write> counters: array<atomic<u32>>;
// Of each pixel whose samples are cut: their sum so far, and what that has lost to rounding.
@group(0) @binding(5) var<storage, read_write> film_sums: array<f32>;

var<workgroup> group_rays: atomic<u32>;

@compute @workgroup_size(BLOCK_EDGE * BLOCK_EDGE)
fn trace(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    if (block < job.block_count) {
        let place = place_of(block, local);
        if (OUTPUT == OUTPUT_AOVS) {
            if (place.is_inside) {
                trace_aovs(place.x, place.y, place.pixel);
            }
        } else {
            var mean = vec3f(0.0);
            if (place.is_inside) {
                mean = trace_pixel(place.x, place.y, place.pixel, place.tile);
            }
            if (job.sample_end == job.samples) {
                set_block(place, local, mean);
            }
        }
    }
    workgroupBarrier();
    if (local == 0u) {
        count_rays(atomicLoad(&group_rays));
    }
}

// Takes the samples in order and returns their mean after the last. A thread whose path has ended begins its next
// sample while its neighbours go on with theirs, so that long paths keep no lanes idle.
fn trace_pixel(x: u32, y: u32, pixel: u32, tile: u32) -> vec3f {
    var sum = Sum(vec3f(0.0), vec3f(0.0));
    if (job.sample_begin > 0u) {
        sum = Sum(sums_at(6u * pixel), sums_at(6u * pixel + 3u));
    }
    var rays = 0u;
    var dropped = 0u;
    var index = job.sample_begin;
    var path = camera_path(x, y, job.first_sample + index);
    var hit = Hit(T_MISS, NO_PRIMITIVE);
    var state = TRACE;
    while (index < job.sample_end) {
        // Most paths have a ray to an area light and one that goes on; then all that have met a surface shade
        // together. The bound is not known to the compiler, which so makes one copy of the traversal.
        for (var turn = 0u; turn < RAYS_PER_TURN + scene.header.zero; turn++) {
            if (state == DONE && !has_shadow_ray(path)) {
                if (is_finite(path.radiance)) {
                    sum = add(sum, path.radiance);
                } else {
                    dropped += 1u;
                }
                index += 1u;
                path = camera_path(x, y, job.first_sample + index);
                state = TRACE;
            }
            if (index < job.sample_end && (state == TRACE || has_shadow_ray(path))) {
                state = trace_ray(&path, &hit, state, &rays);
            }
        }
        if (state == SHADE && !has_shadow_ray(path)) {
            state = shade(&path, hit);
        }
    }
    atomicAdd(&group_rays, rays);
    if (dropped > 0u) {
        atomicAdd(&counters[2u + tile], dropped);
    }
    if (job.sample_end == job.samples) {
        return sum.value / f32(job.samples);
    }
    set_sums(6u * pixel, sum.value);
    set_sums(6u * pixel + 3u, sum.lost);
    return vec3f(0.0);
}

// Of 1, 2 and 3 the fastest on an H200, by 1.05 to 1.3.
const RAYS_PER_TURN: u32 = 3u;

// A sum of up to 65,536 samples: plain f32 would be off by 1 in 1000.
struct Sum {
    value: vec3f,
    lost: vec3f,
}

// Kahan, "Further remarks on reducing truncation errors", CACM 8(1), 1965.
fn add(sum: Sum, term: vec3f) -> Sum {
    let whole = term - sum.lost;
    let value = sum.value + whole;
    return Sum(value, rounded(rounded(value) - sum.value) - whole);
}

fn film_numbers(first: u32) -> vec3f {
    return vec3f(film[first], film[first + 1u], film[first + 2u]);
}

fn set_film_numbers(first: u32, v: vec3f) {
    film[first] = v.x;
    film[first + 1u] = v.y;
    film[first + 2u] = v.z;
}

fn sums_at(first: u32) -> vec3f {
    return vec3f(film_sums[first], film_sums[first + 1u], film_sums[first + 2u]);
}

fn set_sums(first: u32, v: vec3f) {
    film_sums[first] = v.x;
    film_sums[first + 1u] = v.y;
    film_sums[first + 2u] = v.z;
}

// A 64-bit sum in two words.
fn count_rays(rays: u32) {
    let before = atomicAdd(&counters[0], rays);
    if (before + rays < before) {
        atomicAdd(&counters[1], 1u);
    }
}
