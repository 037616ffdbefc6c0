// One path: from the camera over its vertices to an area light or the environment.

struct Path {
    ray: Ray,
    // The primitive the ray starts on: all are convex, so it cannot be met again. With `INSIDE` the
    // dielectric that it is inside of.
    start: u32,
    beta: vec3f,
    radiance: vec3f,
    // Density of the ray's direction times the area lights' `light_weight_sum` where it began, which weighs an area light
    // that it finds, with the bit `SPREAD`; or `SPECULAR` or `SCATTERED`.
    pdf: f32,
    depth: u32,
    pixel: u32,
    sample: u32,
    // From the last vertex, where `ray` begins too; times `beta` there.
    direct: ShadowRay,
    coat: ShadowRay,
}

// The lowest bit of a density: the path comes from a diffuse surface, or by way of coats and metals
// from one, and the next mirror is mollified: see `regularisation`.
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

// What is to be done next with a path: trace its ray, scatter it where that met a surface, or nothing.
const TRACE: u32 = 0u;
const SHADE: u32 = 1u;
const DONE: u32 = 2u;

fn has_shadow_ray(path: Path) -> bool {
    return SAMPLES_LIGHT && (path.direct.distance > 0.0 || (HAS_COAT && path.coat.distance > 0.0));
}

// Traces one ray of a path that has one: those to area lights first, so that rays of either kind go through one
// traversal, side by side with those of other threads.
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
        // Shadow rays leave outwards, whatever the path does after them.
        start &= ~INSIDE;
        t_max = shadow.distance;
    }
    *rays += 1u;
    let met = traverse(prepare_ray(ray), start, t_max, is_shadow, shadow.target_light);
    if (!is_shadow) {
        *hit = met;
        return extend(path, met, rays);
    }
    // The traversal began with `t_max`, so that anything nearer is in the way.
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

// What becomes of a path whose ray meets `met`.
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
                // Traced on the spot, unlike other shadow rays: only paths inside of such balls come
                // here.
                let light = sample_light_through_boundary((*path).start & ~INSIDE, origin, v, rays);
                (*path).radiance += (*path).beta * light;
            }
            (*path).ray = Ray(origin, uniform_direction(u.y, u.z));
            (*path).pdf = SCATTERED;
            // Scattering inside a body counts as an event, as a surface does.
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

// Whether the light that a path ends in belongs to the emission of first hits, where that is traced
// apart: it was found by the camera or by a mirror, `SPECULAR` or a coat's.
fn is_emission(path: Path) -> bool {
    let is_inside = (path.start & INSIDE) != 0u && path.start != NO_PRIMITIVE;
    return OUTPUT == OUTPUT_REFLECTED && path.depth <= 1u && path.pdf <= 0.0 && !is_inside;
}

// How wide a pixel is at a distance of 1 m, for textures of what its camera rays meet; 0 for what paths meet later.
var<private> pixel_width: f32;

fn set_pixel_width(depth: u32) {
    pixel_width = select(0.0, length(scene.header.camera.dx), depth == 0u);
}

// How wide a pixel is where its ray ends.
fn texture_footprint(t: f32) -> f32 {
    return pixel_width * (t + scene.header.camera.near_m);
}

// At the surface that the path's ray has met.
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
        // Multiplied now, as `beta` is overwritten before the ray is traced.
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
        // Not 0 where there is no light: that is a smooth coat's. Of so little no light counts either.
        let density = bitcast<u32>(max(next.pdf * light_weight_sum, 1e-37));
        (*path).pdf = bitcast<f32>(insertBits(density, u32(is_diffuse || is_regularised), 0u, 1u));
    }
    if (was_scattered && ((*path).start & INSIDE) == 0u
        && exits_by_nee_hemisphere(primitive, hit.t, dot(surface.normal, wo))) {
        (*path).pdf = 0.0;
    }
    (*path).depth = depth + 1u;
    let survival = SURVIVAL_PER_THROUGHPUT * largest((*path).beta);
    // Nothing more can come of it: weights of 0 are directions below a surface, and black bodies.
    if (survival <= 0.0) {
        return DONE;
    }
    if (survival < 1.0 && depth >= ROULETTE_DEPTH && ((*path).start & INSIDE) == 0u) {
        // The number that a body's flight would take.
        let u = pair((*path).pixel, (*path).sample, block_choice(depth + 1u), job.seed).y;
        if (u >= survival) {
            return DONE;
        }
        (*path).beta /= survival;
    }
    return TRACE;
}

// Direction in `yz`; choice of the lobe of a dielectric or of glTF's material in `x` and flight through it in `w`.
fn scatter_numbers(path: ptr<function, Path>) -> vec4f {
    let direction = pair((*path).pixel, (*path).sample, block_scatter((*path).depth), job.seed);
    var choice = vec2f(0.0);
    if (HAS_DIELECTRIC || HAS_METALLIC_ROUGHNESS) {
        choice = pair((*path).pixel, (*path).sample, block_choice((*path).depth), job.seed);
    }
    return vec4f(choice.x, direction, choice.y);
}
