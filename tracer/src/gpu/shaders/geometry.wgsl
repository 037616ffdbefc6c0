// Definitions shared by all shapes.

// `direction` has unit length.
struct Ray {
    origin: vec3f,
    direction: vec3f,
}

// A ray with precomputed values shared by its intersection tests.
struct PreparedRay {
    ray: Ray,
    // 1 / direction, with finite components.
    inverse: vec3f,
    inverse_abs: vec3f,
    origin_inverse: vec3f,
    // origin · direction
    along: f32,
    // (1 − SPHERE_SLACK) |origin|²
    power: f32,
    // For a camera ray, the index of its block in the workgroup, whose candidates alone it is
    // tested against; otherwise `NO_BLOCK`.
    block: u32,
}

const NO_BLOCK: u32 = 0xffffffffu;

fn prepare_ray(ray: Ray) -> PreparedRay {
    return prepare_camera_ray(ray, NO_BLOCK);
}

fn prepare_camera_ray(ray: Ray, block: u32) -> PreparedRay {
    let inverse = inverse_direction(ray.direction);
    return PreparedRay(
        ray,
        inverse,
        abs(inverse),
        ray.origin * inverse,
        dot(ray.origin, ray.direction),
        dot(ray.origin, ray.origin) * (1.0 - SPHERE_SLACK),
        block,
    );
}

// Whether a ray may hit a box before `t_max`. Products of the ray alone are precomputed, which
// increases the rounding error; the bounds are enlarged to account for it.
fn may_meet_box(prepared: PreparedRay, bound: BoxBound, t_max: f32) -> bool {
    let middle = fma(bound.center, prepared.inverse, -prepared.origin_inverse);
    let enter = largest(fma(-bound.half, prepared.inverse_abs, middle));
    let leave = smallest(fma(bound.half, prepared.inverse_abs, middle));
    return max(enter, 0.0) <= min(leave, t_max);
}

// Distance to a plane; negative, 0 or NaN if the ray leads away from it or is parallel to it.
fn plane_t(ray: Ray, point: vec3f, normal: vec3f) -> f32 {
    return dot(point - ray.origin, normal) / dot(ray.direction, normal);
}

// The nearest intersection of a ray. Primitives are numbered consecutively through all arrays of
// the scene.
struct Hit {
    t: f32,
    primitive: u32,
}

// A shadow ray to a light, and the radiance that it contributes if it is not occluded; with a
// distance of 0 there is none.
struct ShadowRay {
    direction: vec3f,
    distance: f32,
    light: vec3f,
    target_light: u32,
}

const NO_SHADOW_RAY: ShadowRay = ShadowRay(vec3f(0.0), 0.0, vec3f(0.0), 0u);

// A hit point, with the unit normal on the side of the ray's origin.
struct Surface {
    position: vec3f,
    normal: vec3f,
    albedo: vec3f,
    material: u32,
    // Hit from inside a body; the normal then points inwards.
    is_inside: bool,
}

const T_MISS: f32 = 3.0e38;
const NO_PRIMITIVE: u32 = 0xffffffffu;
// Flag of the primitive number of a ray inside that dielectric body, whose far side it hits.
const INSIDE: u32 = 0x80000000u;
const PI: f32 = 3.14159265358979;
const TWO_PI: f32 = 6.28318530717959;

// The same values, but certainly rounded to f32. In exact arithmetic (a + b) − a is b, and some
// compilers (Mesa) simplify it to that where the rounding error is wanted. An exclusive or with a 0
// that they do not know prevents this.
fn rounded(v: vec3f) -> vec3f {
    return bitcast<vec3f>(bitcast<vec3u>(v) ^ vec3u(scene.header.zero));
}

// 1 / direction with finite components, so that slabs never compute 0 · ∞.
fn inverse_direction(direction: vec3f) -> vec3f {
    let most = vec3f(INVERSE_MAX);
    let inverse = select(-most, most, direction >= vec3f(0.0));
    return select(1.0 / direction, inverse, abs(direction) < vec3f(1.0 / INVERSE_MAX));
}

fn largest(v: vec3f) -> f32 {
    return max(max(v.x, v.y), v.z);
}

fn smallest(v: vec3f) -> f32 {
    return min(min(v.x, v.y), v.z);
}

const INVERSE_MAX: f32 = 1e30;
