// State machine of one path, from the camera to a light or the environment.

struct Path {
    ray: Ray,
    // The primitive that the ray starts on; as all are convex, the ray cannot hit it again. With
    // the flag `INSIDE`, the dielectric that the ray is inside of.
    start: u32,
    beta: vec3f,
    radiance: vec3f,
    // Density of the ray's direction times the area lights' `light_weight_sum` at its origin, for
    // the MIS weight of an area light that it hits, with the flag `SPREAD`; or `SPECULAR` or
    // `SCATTERED`.
    pdf: f32,
    depth: u32,
    pixel: u32,
    sample: u32,
    // Shadow rays from the last vertex, which is also the origin of `ray`; their light is already
    // multiplied by `beta`.
    direct: ShadowRay,
    coat: ShadowRay,
}

// Lowest bit of a density: the path comes from a diffuse surface, possibly via coats and metals,
// and the next mirror is regularised (see `regularisation`).
const SPREAD: u32 = 1u;

fn camera_path(x: u32, y: u32, sample: u32) -> Path {
    let pixel = pixel_key(x, y);
    let key = sample_key(sample);
    let u = pair(pixel, key, BLOCK_CAMERA, job.seed);
    let camera = scene.header.camera;
    var film = vec2f(f32(x) + u.x, f32(y) + u.y);
    var eye = camera.eye;
    if (camera.lens_steps > 0.0) {
        let v = pair(pixel, key, BLOCK_LENS, job.seed);
        // Uniform point on the lens. The film position is shifted against it such that points at
        // the focus distance stay fixed.
        let lens = sqrt(v.x) * circle(v.y);
        let steps = camera.lens_steps * lens;
        eye += steps.x * camera.dx + steps.y * camera.dy;
        film -= camera.lens_film * lens;
    }
    let direction = camera.corner + film.x * camera.dx + film.y * camera.dy;
    let ray = Ray(fma(vec3f(camera.near_m), direction, eye), direction / length(direction));
    note_density(SPECULAR);
    return Path(
        ray,
        NO_PRIMITIVE,
        vec3f(1.0),
        vec3f(0.0),
        SPECULAR,
        0u,
        pixel,
        key,
        NO_SHADOW_RAY,
        NO_SHADOW_RAY,
    );
}

// The next step of a path: trace its ray, shade the surface that it hit, or none.
const TRACE: u32 = 0u;
const SHADE: u32 = 1u;
const DONE: u32 = 2u;

fn has_shadow_ray(path: Path) -> bool {
    return SAMPLES_LIGHT && (path.direct.distance > 0.0 || (HAS_COAT && path.coat.distance > 0.0));
}

// Traces one ray of a path. Shadow rays come first, so that rays of both kinds use the same
// traversal and threads stay converged.
fn trace_ray(path: ptr<function, Path>, hit: ptr<function, Hit>, state: u32, rays: ptr<function, u32>) -> u32 {
    let is_shadow = has_shadow_ray(*path);
    let is_direct = (*path).direct.distance > 0.0;
    var shadow = (*path).coat;
    if (!HAS_COAT || is_direct) {
        shadow = (*path).direct;
    }
    var ray = (*path).ray;
    var start = (*path).start;
    var t_max = T_MISS;
    if (is_shadow) {
        ray.direction = shadow.direction;
        // Shadow rays leave outwards, wherever the path continues.
        start &= ~INSIDE;
        t_max = shadow.distance;
    }
    *rays += 1u;
    let met = traverse(prepare_ray(ray), start, t_max, is_shadow, shadow.target_light);
    if (!is_shadow) {
        *hit = met;
        return extend(path, met, rays);
    }
    // The traversal began with `t_max`, so any hit before it occludes.
    if (met.t >= t_max) {
        (*path).radiance += shadow.light;
    }
    if (is_direct) {
        (*path).direct.distance = 0.0;
    } else {
        (*path).coat.distance = 0.0;
    }
    return state;
}

// Handles the hit of a path's ray: scattering in a medium, light, or a surface to shade.
fn extend(path: ptr<function, Path>, met: Hit, rays: ptr<function, u32>) -> u32 {
    let ray = (*path).ray;
    if (HAS_DIELECTRIC && ((*path).start & INSIDE) != 0u && (*path).start != NO_PRIMITIVE) {
        let u = scatter_numbers(path);
        let flight = sample_distance(material_of((*path).start & ~INSIDE), met.t, u.w);
        (*path).beta *= flight.weight;
        if (flight.is_scattered) {
            let origin = fma(vec3f(flight.distance), ray.direction, ray.origin);
            if (HAS_REFRACTED_NEE && (*path).depth + 2u <= job.max_depth) {
                let v = pair((*path).pixel, (*path).sample, block_light((*path).depth), job.seed);
                // Traced at once, unlike other shadow rays: only paths inside of such balls get
                // here.
                let light = sample_light_through_boundary((*path).start & ~INSIDE, origin, v, rays);
                (*path).radiance += (*path).beta * light;
            }
            (*path).ray = Ray(origin, uniform_direction(u.y, u.z));
            (*path).pdf = SCATTERED;
            // Scattering inside a body counts as a scattering event.
            let is_last = (*path).depth == job.max_depth;
            (*path).depth += 1u;
            return select(TRACE, DONE, is_last || all((*path).beta == vec3f(0.0)));
        }
    }
    if (met.primitive >= AREA_LIGHT_FIRST && is_emission(*path)) {
        return DONE;
    }
    if (met.primitive == NO_PRIMITIVE) {
        (*path).radiance += (*path).beta * environment_with_mis(ray.direction);
        return DONE;
    }
    if (met.primitive >= AREA_LIGHT_FIRST) {
        (*path).radiance += (*path).beta * emission_with_mis(ray, met, (*path).pdf);
        return DONE;
    }
    if ((*path).depth == job.max_depth) {
        return DONE;
    }
    return SHADE;
}

// Whether the light that ends a path belongs to the emission of first hits, which is traced
// separately: it was found by the camera ray or by a mirror, either `SPECULAR` or a coat's.
fn is_emission(path: Path) -> bool {
    let is_inside = (path.start & INSIDE) != 0u && path.start != NO_PRIMITIVE;
    return OUTPUT == OUTPUT_REFLECTED && path.depth <= 1u && path.pdf <= 0.0 && !is_inside;
}

// Width of a pixel at a distance of 1 m, for texture filtering at camera rays' hits; 0 at later
// ones.
var<private> pixel_width: f32;

fn set_pixel_width(depth: u32) {
    pixel_width = select(0.0, length(scene.header.camera.dx), depth == 0u);
}

// Width of a pixel at the end of its camera ray.
fn texture_footprint(t: f32) -> f32 {
    return pixel_width * (t + scene.header.camera.near_m);
}

// Scatters a path at the surface that its ray has hit.
fn shade(path: ptr<function, Path>, hit: Hit) -> u32 {
    let primitive = hit.primitive;
    let is_within = HAS_DIELECTRIC && (*path).start == (primitive | INSIDE);
    let depth = (*path).depth;
    set_pixel_width(depth);
    let surface = surface_at((*path).ray, hit, is_within);
    let wo = -(*path).ray.direction;
    let is_spread = (bitcast<u32>((*path).pdf) & SPREAD) != 0u;
    let is_regularised = is_spread && ((*path).sample & REGULARISED_KEY_MASK) == 0u;
    draw_coat_facet(surface, wo, (*path).pixel, (*path).sample, depth);
    let is_rough = has_rough_coat(surface.material);
    var bsdf = bsdf_at(surface, wo);
    if (is_regularised) {
        bsdf = bsdf_regularised(bsdf);
    }
    var light_weight_sum = 0.0;
    if (SAMPLES_LIGHT) {
        let u = pair((*path).pixel, (*path).sample, block_light(depth), job.seed);
        var cone_density = 0.0;
        if (is_regularised) {
            cone_density = CONE_DENSITY;
        }
        (*path).direct = direct_light(surface, bsdf, wo, u, cone_density, &light_weight_sum);
        // Now, as `beta` changes before the shadow ray is traced.
        (*path).direct.light *= (*path).beta;
        if (HAS_COAT && !is_regularised && (OUTPUT != OUTPUT_REFLECTED || depth > 0u || is_rough)) {
            (*path).coat = coat_reflected_light(surface, bsdf, wo);
            (*path).coat.light *= (*path).beta;
        }
    }
    let next = bsdf_sample(bsdf, surface.normal, wo, scatter_numbers(path).xyz);
    note_density(next.pdf);
    let was_scattered = HAS_REFRACTED_NEE && (*path).pdf == SCATTERED;
    (*path).ray = Ray(surface.position, next.wi);
    (*path).start = primitive;
    if (HAS_DIELECTRIC && bsdf_is_transmissive(bsdf)) {
        let is_passed = dot(next.wi, surface.normal) < 0.0;
        (*path).start = select(primitive, primitive | INSIDE, surface.is_inside != is_passed);
    }
    (*path).beta *= next.weight;
    (*path).pdf = next.pdf;
    let is_diffuse = next.pdf > 0.0 && bsdf_is_layered(bsdf);
    if (next.pdf > 0.0 || (next.pdf == 0.0 && (is_regularised || is_rough))) {
        // The lower bound keeps it from being 0, which marks a smooth coat, where there is no
        // light; its influence is negligible.
        let density = bitcast<u32>(max(next.pdf * light_weight_sum, 1e-37));
        (*path).pdf = bitcast<f32>(insertBits(density, u32(is_diffuse || is_regularised), 0u, 1u));
    }
    // Refracted next-event estimation has accounted for area lights found this way: a density of 0
    // makes them count nothing.
    if (was_scattered && ((*path).start & INSIDE) == 0u
        && exits_by_nee_hemisphere(primitive, hit.t, dot(surface.normal, wo))) {
        (*path).pdf = 0.0;
    }
    (*path).depth = depth + 1u;
    let survival = SURVIVAL_PER_THROUGHPUT * largest((*path).beta);
    // Nothing more can be contributed: weights are 0 for directions below the surface and for black
    // bodies.
    if (survival <= 0.0) {
        return DONE;
    }
    // Russian roulette, outside of bodies only.
    if (survival < 1.0 && depth >= ROULETTE_DEPTH && ((*path).start & INSIDE) == 0u) {
        // Uses the random number that flight through a body would take.
        let u = pair((*path).pixel, (*path).sample, block_choice(depth + 1u), job.seed).y;
        if (u >= survival) {
            return DONE;
        }
        (*path).beta /= survival;
    }
    return TRACE;
}

// Random numbers of a scattering event: direction in `yz`, choice of a lobe (dielectrics and glTF's
// material) in `x`, flight through a medium in `w`.
fn scatter_numbers(path: ptr<function, Path>) -> vec4f {
    let direction = pair((*path).pixel, (*path).sample, block_scatter((*path).depth), job.seed);
    var choice = vec2f(0.0);
    if (HAS_DIELECTRIC || HAS_METALLIC_ROUGHNESS) {
        choice = pair((*path).pixel, (*path).sample, block_choice((*path).depth), job.seed);
    }
    return vec4f(choice.x, direction, choice.y);
}
