// What a camera ray meets first, as one of the kernel's outputs: see `Layers`.

fn layers(ray: Ray) -> vec3f {
    let hit = nearest(ray, NO_PRIMITIVE);
    if (hit.primitive >= LAMP_FIRST) {
        return select(vec3f(0.0), emission(ray, hit), OUTPUT == OUTPUT_EMISSION);
    }
    if (OUTPUT == OUTPUT_INVERSE_DEPTH) {
        let axis = normalize(cross(scene.header.camera.dx, scene.header.camera.dy));
        return vec3f(1.0 / (hit.t * dot(ray.direction, axis)), 0.0, 0.0);
    }
    let surface = surface_at(ray, hit, false);
    let wo = -ray.direction;
    let bsdf = bsdf_at(surface, wo);
    switch OUTPUT {
        case OUTPUT_ALBEDO: {
            return bsdf_albedo(bsdf, surface);
        }
        case OUTPUT_NORMAL: {
            return surface.normal;
        }
        default: {
            let cos_o = dot(surface.normal, wo);
            let mirror = bsdf_mirror(bsdf, cos_o);
            if (all(mirror == vec3f(0.0))) {
                return vec3f(0.0);
            }
            let mirrored = Ray(surface.position, 2.0 * cos_o * surface.normal - wo);
            let met = nearest(mirrored, hit.primitive);
            return mirror * emission(mirrored, met);
        }
    }
}

// Light of the lamp or the environment that a ray ends in.
fn emission(ray: Ray, hit: Hit) -> vec3f {
    if (hit.primitive == NO_PRIMITIVE) {
        return scene.header.environment;
    }
    if (hit.primitive >= LAMP_FIRST) {
        return lamp_found(ray, hit, SPECULAR);
    }
    return vec3f(0.0);
}
