// Meshes whose shading normals differ from their geometric normals.

// The geometric normal on the viewer's side if it differs from the shading normal; otherwise 0.
var<private> geometric_normal: vec3f;

// The geometric normal of a surface.
fn own_normal(surface: Surface) -> vec3f {
    return select(surface.normal, geometric_normal, any(geometric_normal != vec3f(0.0)));
}

// The `shading` normal (on the side of `normal`), bent until the viewer's mirror direction is above
// the surface.
fn visible_normal(shading: vec3f, normal: vec3f, wo: vec3f) -> vec3f {
    let reflected = fma(vec3f(2.0 * dot(wo, shading)), shading, -wo);
    let lift = REFLECTION_SINE_MIN - dot(reflected, normal);
    if (lift <= 0.0) {
        return shading;
    }
    return normalize(wo + normalize(fma(vec3f(lift), normal, reflected)));
}

// Whether a direction lies on different sides of the surface according to the geometric and the
// shading normal.
fn is_below(bsdf: Bsdf, normal: vec3f, wi: vec3f) -> bool {
    let height = dot(wi, geometric_normal);
    if (HAS_DIELECTRIC && bsdf_is_transmissive(bsdf) && dot(wi, normal) < 0.0) {
        return height > 0.0;
    }
    return height < 0.0;
}

// Rejects light from below the surface, which shading normals would let leak.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    let ray = bare_direct_light(surface, bsdf, wo, u, cone_density, light_weight_sum);
    if (is_below(bsdf, surface.normal, ray.direction)) {
        return NO_SHADOW_RAY;
    }
    return ray;
}

// Rejects sampled directions below the surface.
fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    var next = bare_bsdf_sample(bsdf, n, wo, u);
    if (is_below(bsdf, n, next.wi)) {
        next.weight = vec3f(0.0);
    }
    return next;
}
