// Axis-aligned boxes, intersected by slabs (Kay and Kajiya 1986).

struct Slabs {
    near: vec3f,
    far: vec3f,
}

fn box_slabs(origin: vec3f, inverse: vec3f, index: u32) -> Slabs {
    let a = (scene_storage.boxes[index].min - origin) * inverse;
    let b = (scene_storage.boxes[index].max - origin) * inverse;
    // A ray that lies exactly in the plane of a face where its slab would end never leaves the slab.
    let is_within = (abs(inverse) >= vec3f(INVERSE_MAX)) & (max(a, b) == vec3f(0.0));
    return Slabs(min(a, b), select(max(a, b), vec3f(T_MISS), is_within));
}

fn box_t(prepared: PreparedRay, index: u32) -> f32 {
    let slabs = box_slabs(prepared.ray.origin, prepared.inverse, index);
    let enter = largest(slabs.near);
    let leave = smallest(slabs.far);
    let t = select(leave, enter, enter > 0.0);
    return select(T_MISS, t, enter <= leave && leave > 0.0);
}

// The primitive that the ray starts on, whose near side it cannot hit. If the ray is inside a
// dielectric box, the far side of that box is recorded as the first hit.
fn own_box(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) -> u32 {
    if (!HAS_DIELECTRIC) {
        return start;
    }
    let own = start & ~INSIDE;
    let inside = own - BOX_FIRST;
    if ((start & INSIDE) != 0u && inside < BOX_COUNT) {
        let slabs = box_slabs(prepared.ray.origin, prepared.inverse, inside);
        let t = max(0.0, smallest(slabs.far));
        if (t < (*hit).t) {
            *hit = Hit(t, own);
        }
    }
    return own;
}

fn box_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let slabs = box_slabs(ray.origin, inverse_direction(ray.direction), index);
    let enter = largest(slabs.near);
    let is_outside = enter > 0.0 && !is_within;
    let leaves = slabs.far == vec3f(smallest(slabs.far));
    let face = select(leaves, slabs.near == vec3f(enter), is_outside);
    // On an edge two faces are hit at once; the first axis wins.
    let axis = vec3<bool>(face.x, face.y && !face.x, !face.x && !face.y);
    let backward = select(vec3f(1.0), vec3f(-1.0), ray.direction > vec3f(0.0));
    // The coordinate of the face itself, without rounding error.
    let is_min = (backward < vec3f(0.0)) == vec3<bool>(is_outside);
    let plane = select(scene_storage.boxes[index].max, scene_storage.boxes[index].min, is_min);
    let material = scene_storage.boxes[index].material;
    return Surface(
        select(fma(vec3f(t), ray.direction, ray.origin), plane, axis),
        select(vec3f(0.0), backward, axis),
        scene_storage.materials[material].albedo,
        material,
        !is_outside,
    );
}
