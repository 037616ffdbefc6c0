// Boxes with faces parallel to the axes, by slabs (Kay and Kajiya 1986).

struct Slabs {
    near: vec3f,
    far: vec3f,
}

fn box_slabs(origin: vec3f, inverse: vec3f, index: u32) -> Slabs {
    let a = (scene.boxes[index].min - origin) * inverse;
    let b = (scene.boxes[index].max - origin) * inverse;
    return Slabs(min(a, b), max(a, b));
}

fn largest(v: vec3f) -> f32 {
    return max(max(v.x, v.y), v.z);
}

fn smallest(v: vec3f) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn box_t(origin: vec3f, inverse: vec3f, index: u32) -> f32 {
    let slabs = box_slabs(origin, inverse, index);
    let enter = largest(slabs.near);
    let leave = smallest(slabs.far);
    let t = select(leave, enter, enter > 0.0);
    return select(T_MISS, t, enter <= leave && leave > 0.0);
}

fn nearest_box(ray: Ray, skip: u32, hit: ptr<function, Hit>) {
    let inverse = inverse_direction(ray.direction);
    if (HAS_CLEAR) {
        let inside = (skip & ~INSIDE) - BOX_FIRST;
        if ((skip & INSIDE) != 0u && inside < BOX_COUNT) {
            let t = max(0.0, smallest(box_slabs(ray.origin, inverse, inside).far));
            if (t < (*hit).t) {
                *hit = Hit(t, skip & ~INSIDE);
            }
        }
    }
    for (var i = 0u; i < BOX_COUNT; i++) {
        if (HAS_CLEAR && BOX_FIRST + i == (skip & ~INSIDE)) {
            continue;
        }
        let t = box_t(ray.origin, inverse, i);
        if (t < (*hit).t && BOX_FIRST + i != skip) {
            *hit = Hit(t, BOX_FIRST + i);
        }
    }
}

fn box_occludes(ray: Ray, skip: u32, t_max: f32) -> bool {
    let inverse = inverse_direction(ray.direction);
    for (var i = 0u; i < BOX_COUNT; i++) {
        if (box_t(ray.origin, inverse, i) < t_max && BOX_FIRST + i != skip) {
            return true;
        }
    }
    return false;
}

fn box_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let slabs = box_slabs(ray.origin, inverse_direction(ray.direction), index);
    let enter = largest(slabs.near);
    let is_outside = enter > 0.0 && !is_within;
    let leaves = slabs.far == vec3f(smallest(slabs.far));
    let face = select(leaves, slabs.near == vec3f(enter), is_outside);
    // On an edge two faces are met at once; the first axis wins.
    let axis = vec3<bool>(face.x, face.y && !face.x, !face.x && !face.y);
    let backward = select(vec3f(1.0), vec3f(-1.0), ray.direction > vec3f(0.0));
    // The face itself rather than a point near it.
    let is_min = (backward < vec3f(0.0)) == vec3<bool>(is_outside);
    let plane = select(scene.boxes[index].max, scene.boxes[index].min, is_min);
    let material = scene.boxes[index].material;
    return Surface(
        select(fma(vec3f(t), ray.direction, ray.origin), plane, axis),
        select(vec3f(0.0), backward, axis),
        scene.materials[material].albedo,
        material,
        !is_outside,
    );
}
