// One path: from the camera over scatterings to a lamp or the environment.

struct Path {
    ray: Ray,
    // The primitive the ray starts on: all are convex, so it cannot be met again. With `INSIDE` the
    // clear body that it is inside of.
    skip: u32,
    throughput: vec3f,
    radiance: vec3f,
    // Density of the ray's direction times the lamps' `light_sum` where it began, which weighs a lamp
    // that it finds; or `SPECULAR`.
    pdf: f32,
    bounce: u32,
    pixel: u32,
    sample: u32,
}

fn camera_path(x: u32, y: u32, sample: u32) -> Path {
    let pixel = pixel_key(x, y);
    let key = sample_key(sample);
    let u = pair(pixel, key, BLOCK_CAMERA, job.seed);
    let camera = scene.header.camera;
    let film = vec2f(f32(x) + u.x, f32(y) + u.y);
    let direction = camera.corner + film.x * camera.dx + film.y * camera.dy;
    let ray = Ray(camera.eye, direction / length(direction));
    return Path(ray, NO_PRIMITIVE, vec3f(1.0), vec3f(0.0), SPECULAR, 0u, pixel, key);
}

// Follows the path along one edge; false when it has ended.
fn advance(path: ptr<function, Path>, rays: ptr<function, u32>) -> bool {
    let ray = (*path).ray;
    *rays += 1u;
    let hit = nearest(ray, (*path).skip);
    if (HAS_CLEAR && ((*path).skip & INSIDE) != 0u && (*path).skip != NO_PRIMITIVE) {
        let u = scatter_numbers(path);
        let flight = fly(material_of((*path).skip & ~INSIDE), hit.t, u.w);
        (*path).throughput *= flight.weight;
        if (flight.is_scattered) {
            let origin = fma(vec3f(flight.distance), ray.direction, ray.origin);
            (*path).ray = Ray(origin, uniform_direction(u.y, u.z));
            (*path).pdf = SPECULAR;
            let is_last = (*path).bounce == job.scatterings_max;
            (*path).bounce += 1u;
            return !is_last && any((*path).throughput != vec3f(0.0));
        }
    }
    if (hit.primitive >= LAMP_FIRST && is_emission(*path)) {
        return false;
    }
    if (hit.primitive == NO_PRIMITIVE) {
        (*path).radiance += (*path).throughput * scene.header.environment;
        return false;
    }
    if (hit.primitive >= LAMP_FIRST) {
        (*path).radiance += (*path).throughput * lamp_found(ray, hit, (*path).pdf);
        return false;
    }
    if ((*path).bounce == job.scatterings_max) {
        return false;
    }
    let is_within = HAS_CLEAR && (*path).skip == (hit.primitive | INSIDE);
    return scatter(path, surface_at(ray, hit, is_within), hit.primitive, rays);
}

// Whether the light that a path ends in belongs to the emission of first hits, where that is traced
// apart: it was found by the camera or by a mirror, `SPECULAR` or a coat's.
fn is_emission(path: Path) -> bool {
    let is_inside = (path.skip & INSIDE) != 0u && path.skip != NO_PRIMITIVE;
    return OUTPUT == OUTPUT_REFLECTED && path.bounce <= 1u && path.pdf <= 0.0 && !is_inside;
}

fn scatter(
    path: ptr<function, Path>,
    surface: Surface,
    primitive: u32,
    rays: ptr<function, u32>,
) -> bool {
    let bounce = (*path).bounce;
    let wo = -(*path).ray.direction;
    let bsdf = bsdf_at(surface, wo);
    var light_sum = 0.0;
    if (LAMP_COUNT > 0u) {
        let u = pair((*path).pixel, (*path).sample, block_light(bounce), job.seed);
        var light = direct_light(surface, bsdf, wo, primitive, u, rays, &light_sum);
        if (OUTPUT != OUTPUT_REFLECTED || bounce > 0u) {
            light += mirrored_light(surface, bsdf, wo, primitive, rays);
        }
        (*path).radiance += (*path).throughput * light;
    }
    let next = bsdf_sample(bsdf, surface.normal, wo, scatter_numbers(path).xyz);
    (*path).ray = Ray(surface.position, next.wi);
    (*path).skip = primitive;
    if (HAS_CLEAR && bsdf_is_clear(bsdf)) {
        let is_passed = dot(next.wi, surface.normal) < 0.0;
        (*path).skip = select(primitive, primitive | INSIDE, surface.is_inside != is_passed);
    }
    (*path).throughput *= next.weight;
    (*path).pdf = next.pdf;
    if (next.pdf > 0.0) {
        // Not 0 where there is no light: that is a coat's.
        (*path).pdf = max(next.pdf * light_sum, 1e-37);
    }
    (*path).bounce = bounce + 1u;
    return any((*path).throughput != vec3f(0.0));
}

// Direction in `yz`; choice of a clear body's lobe in `x` and flight through it in `w`.
fn scatter_numbers(path: ptr<function, Path>) -> vec4f {
    let direction = pair((*path).pixel, (*path).sample, block_scatter((*path).bounce), job.seed);
    var choice = vec2f(0.0);
    if (HAS_CLEAR) {
        choice = pair((*path).pixel, (*path).sample, block_choice((*path).bounce), job.seed);
    }
    return vec4f(choice.x, direction, choice.y);
}
