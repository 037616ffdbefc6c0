// AOVs of first hits (see `Aovs` in Rust), stored in the film in that type's order.

struct Aovs {
    albedo: vec3f,
    normal: vec3f,
    inverse_depth: f32,
    emission: vec3f,
}

// The pixel of the list entry `index`, if the list has as many: see `list_edges` in `denoise.wgsl`.
fn place_in_list(index: u32) -> Place {
    let is_inside = index < atomicLoad(&counters[LISTED_PIXELS]);
    let tile = tiles[select(0u, index, is_inside)];
    return Place(tile.x, tile.y, tile.first_pixel, 0u, is_inside);
}

// Computes the means over the pixel's samples.
fn trace_aovs(x: u32, y: u32, pixel: u32, block: u32) {
    var sum = Aovs(vec3f(0.0), vec3f(0.0), 0.0, vec3f(0.0));
    if (job.sample_begin > 0u) {
        sum = aovs_at(pixel);
    }
    for (var index = job.sample_begin; index < job.sample_end; index++) {
        let hit = first_hit(camera_path(x, y, job.first_sample + index).ray, block);
        sum.albedo += hit.albedo;
        sum.normal += hit.normal;
        sum.inverse_depth += hit.inverse_depth;
        sum.emission += hit.emission;
    }
    // The film holds sums until the last dispatch of the frame divides them.
    let share = select(1.0, 1.0 / f32(job.samples), job.sample_end == job.samples);
    let first = AOV_FLOATS * pixel;
    set_film_numbers(first, sum.albedo * share);
    set_film_numbers(first + 3u, sum.normal * share);
    film[first + 6u] = sum.inverse_depth * share;
    set_film_numbers(first + 7u, sum.emission * share);
}

fn aovs_at(pixel: u32) -> Aovs {
    let first = AOV_FLOATS * pixel;
    return Aovs(film_numbers(first), film_numbers(first + 3u), film[first + 6u], film_numbers(first + 7u));
}

fn first_hit(ray: Ray, block: u32) -> Aovs {
    var met = Aovs(vec3f(0.0), vec3f(0.0), 0.0, vec3f(0.0));
    let hit = nearest_of_camera_ray(ray, block);
    if (hit.primitive >= AREA_LIGHT_FIRST) {
        met.emission = emission(ray, hit);
        return met;
    }
    let axis = normalize(cross(scene.header.camera.dx, scene.header.camera.dy));
    met.inverse_depth = 1.0 / fma(hit.t, dot(ray.direction, axis), scene.header.camera.near_m);
    set_pixel_width(0u);
    let surface = surface_at(ray, hit, false);
    let wo = -ray.direction;
    // A rough coat's reflection is part of the paths: no mirror reflection is evaluated for it.
    draw_coat_facet(surface, wo, 0u, 0u, 0u);
    let bsdf = bsdf_at(surface, wo);
    met.albedo = bsdf_albedo(bsdf, surface);
    met.normal = surface.normal;
    let cos_o = dot(surface.normal, wo);
    var mirror = bsdf_mirror(bsdf, cos_o);
    if (has_rough_coat(surface.material)) {
        mirror = vec3f(0.0);
    }
    let mirrored = Ray(surface.position, 2.0 * cos_o * surface.normal - wo);
    // Occlusion matters only if there is light behind, so the ray is traced only then.
    if (any(mirror != vec3f(0.0)) && (environment_is_lit() || meets_area_light(mirrored))) {
        met.emission = mirror * emission(mirrored, nearest(mirrored, hit.primitive));
    }
    return met;
}

// Light of the area light or environment that a ray ends at.
fn emission(ray: Ray, hit: Hit) -> vec3f {
    if (hit.primitive == NO_PRIMITIVE) {
        return environment_radiance(ray.direction);
    }
    if (hit.primitive >= AREA_LIGHT_FIRST) {
        return emission_with_mis(ray, hit, SPECULAR);
    }
    return vec3f(0.0);
}
