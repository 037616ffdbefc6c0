// CSG boxes: a ray enters the box and then leaves each subtraction that it is inside of, in turn
// (see `scalar::csg`).

struct Met {
    t: f32,
    face: u32,
}

// Distances at which a ray enters and leaves a box.
fn box_span(ray: Ray, inverse: vec3f, low: vec3f, high: vec3f) -> vec2f {
    let a = (low - ray.origin) * inverse;
    let b = (high - ray.origin) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    return vec2f(max(max(near.x, near.y), near.z), min(min(far.x, far.y), far.z));
}

// The margin enlarges subtractions, so that a surface right at a subtraction counts as removed.
fn subtraction_contains(face: u32, p: vec3f) -> bool {
    let a = scene.csg_faces[face].a;
    let b = scene.csg_faces[face].b;
    switch scene.csg_faces[face].kind {
        case CSG_FACE_PLANE: { return dot(p, a) > b.x - CSG_MARGIN_M; }
        case CSG_FACE_CYLINDER: {
            let q = p.xy - a.xy;
            let radius = b.x + CSG_MARGIN_M;
            return dot(q, q) < radius * radius;
        }
        case CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z: {
            if (HAS_CSG_CONE) {
                return cone_exterior_contains(a, b, axis_last(scene.csg_faces[face].kind, p));
            }
            return false;
        }
        case CSG_FACE_APEX_CONE: {
            if (HAS_CSG_CONE) {
                let q = about_axis(b, p - a);
                let radius = length(b) * q.along - CSG_MARGIN_M;
                return dot(q.aside, q.aside) > radius * radius || radius < 0.0;
            }
            return false;
        }
        default: { return all(p > a - CSG_MARGIN_M) && all(p < b + CSG_MARGIN_M); }
    }
}

// Components of a vector along a cone's axis and perpendicular to it.
struct AboutAxis {
    along: f32,
    aside: vec3f,
}

fn about_axis(b: vec3f, v: vec3f) -> AboutAxis {
    let axis = normalize(b);
    let along = dot(v, axis);
    return AboutAxis(along, v - along * axis);
}

// See `scalar::csg`.
fn cone_exterior_contains(a: vec3f, b: vec3f, p: vec3f) -> bool {
    let q = p.xy - a.xy;
    let radius = fma(p.z, b.x, a.z - CSG_MARGIN_M);
    let beyond = length(b.yz);
    return (dot(q, q) > radius * radius || radius < 0.0)
        && dot(q, b.yz) >= beyond * (beyond - CSG_MARGIN_M);
}

// Distance at which a ray that is outside of a cone at `t` enters it, from the quadratic
// |q + t d|² = (radius + growth t)².
fn meet_cone(q: vec3f, d: vec3f, radius: f32, growth: f32, t: f32) -> f32 {
    let d2 = dot(d, d);
    let along = dot(q, d);
    // The discriminant with a cross product instead of d²q² − (q·d)², which would cancel.
    let miss = cross(q, d);
    let square = d2 - growth * growth;
    let half_linear = along - growth * radius;
    let quarter = d2 * (radius * radius) - dot(miss, miss)
        + growth * (growth * dot(q, q) - 2.0 * along * radius);
    let is_ahead = square < 0.0 || fma(square, t, half_linear) < 0.0;
    if (quarter >= 0.0 && square != 0.0 && is_ahead) {
        let met = -(half_linear + sqrt(quarter)) / square;
        if (fma(met, growth, radius) > 0.0) {
            return met;
        }
    }
    return T_MISS;
}

fn exit_cone_exterior(kind: u32, a: vec3f, b: vec3f, ray: Ray, t: f32) -> f32 {
    // Relative to the point at `t`, which is close: squares of a distant ray's origin are too large
    // for a thin cone.
    let direction = axis_last(kind, ray.direction);
    let start = fma(vec3f(t), direction, axis_last(kind, ray.origin));
    let q = start.xy - a.xy;
    let d = direction.xy;
    let radius = fma(start.z, b.x, a.z);
    let met = meet_cone(vec3f(q, 0.0), vec3f(d, 0.0), radius, direction.z * b.x, 0.0);
    let slope = dot(d, b.yz);
    let back = select(T_MISS, (dot(b.yz, b.yz) - dot(q, b.yz)) / slope, slope < 0.0);
    let leaves = min(met, back);
    return select(T_MISS, t + leaves, leaves < T_MISS);
}

// Permutes coordinates so that the axis of a cone exterior of this kind is the third.
fn axis_last(kind: u32, v: vec3f) -> vec3f {
    return select(select(v, v.zxy, kind == CSG_FACE_CONE_Y), v.yzx, kind == CSG_FACE_CONE_X);
}

// The inverse of `axis_last`.
fn axis_in_place(kind: u32, v: vec3f) -> vec3f {
    return select(select(v, v.yzx, kind == CSG_FACE_CONE_Y), v.zxy, kind == CSG_FACE_CONE_X);
}

fn exit_subtraction(face: u32, ray: Ray, inverse: vec3f, t: f32) -> f32 {
    let a = scene.csg_faces[face].a;
    let b = scene.csg_faces[face].b;
    switch scene.csg_faces[face].kind {
        case CSG_FACE_PLANE: {
            let slope = dot(ray.direction, a);
            if (slope >= 0.0) {
                return T_MISS;
            }
            return (b.x - dot(ray.origin, a)) / slope;
        }
        case CSG_FACE_CYLINDER: {
            let q = ray.origin.xy - a.xy;
            let d = ray.direction.xy;
            let d2 = dot(d, d);
            if (d2 == 0.0) {
                return T_MISS;
            }
            let miss = q.x * d.y - q.y * d.x;
            return (sqrt(max(0.0, d2 * b.x * b.x - miss * miss)) - dot(q, d)) / d2;
        }
        case CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z: {
            if (HAS_CSG_CONE) {
                return exit_cone_exterior(scene.csg_faces[face].kind, a, b, ray, t);
            }
            return T_MISS;
        }
        case CSG_FACE_APEX_CONE: {
            if (HAS_CSG_CONE) {
                let slope = length(b);
                let q = about_axis(b, ray.origin - a);
                let d = about_axis(b, ray.direction);
                return meet_cone(q.aside, d.aside, slope * q.along, slope * d.along, t);
            }
            return T_MISS;
        }
        default: { return box_span(ray, inverse, a, b).y; }
    }
}

fn intersect_csg_box(ray: Ray, inverse: vec3f, index: u32, start: u32, limit: f32) -> Met {
    let miss = Met(T_MISS, 0u);
    let span = box_span(ray, inverse, scene.csg_boxes[index].min, scene.csg_boxes[index].max);
    let first = scene.csg_boxes[index].first_face;
    let count = scene.csg_boxes[index].face_count;
    // In unsigned arithmetic, numbers below the first face wrap around and are not less than the
    // count.
    let is_left = (start - CSG_FACE_FIRST) - first < count;
    let end = min(span.y, limit);
    var t = max(span.x, select(0.0, CSG_MARGIN_M, is_left));
    var face = first;
    if (t >= end) {
        return miss;
    }
    // Cycles through the subtractions until the ray is outside of all of them since the last one it
    // left. Each is left for good, except for cone exteriors: a ray may pass through their round
    // body and out of what remains. In exact arithmetic the walk ends without the bound; it keeps
    // rounding from trapping a GPU in the loop.
    let rounds = select(count, 2u * count, HAS_CSG_CONE);
    var subtraction = first;
    var others = count - 1u;
    for (var turn = 0u; others > 0u && turn < rounds * count; turn++) {
        subtraction = select(subtraction + 1u, first + 1u, subtraction + 1u == first + count);
        others -= 1u;
        if (!subtraction_contains(subtraction, fma(vec3f(t), ray.direction, ray.origin))) {
            continue;
        }
        // If rounding has put the point just outside, the exit is not beyond `t`, which then stays
        // the same.
        let leaves = exit_subtraction(subtraction, ray, inverse, t);
        if (leaves > t) {
            t = leaves;
            face = subtraction;
            others = count - 2u;
        }
        if (t >= end) {
            return miss;
        }
    }
    if ((face == first && (is_left || span.x <= 0.0)) || t <= 0.0) {
        return miss;
    }
    return Met(t, face);
}

// Each thread walks through the few CSG boxes that its own ray may hit.
fn nearest_csg_face(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    for (var first = 0u; first < CSG_BOX_COUNT; first += 64u) {
        // Both halves in one loop, so that threads with candidates in either stay converged.
        var candidates = vec2u(csg_box_candidates(prepared, first, (*hit).t), 0u);
        if (first + 32u < CSG_BOX_COUNT) {
            candidates.y = csg_box_candidates(prepared, first + 32u, (*hit).t);
        }
        while ((candidates.x | candidates.y) != 0u) {
            var i = first;
            if (candidates.x != 0u) {
                i += firstTrailingBit(candidates.x);
                candidates.x &= candidates.x - 1u;
            } else {
                i += 32u + firstTrailingBit(candidates.y);
                candidates.y &= candidates.y - 1u;
            }
            let met = intersect_csg_box(prepared.ray, prepared.inverse, i, start, (*hit).t);
            if (met.t < (*hit).t) {
                *hit = Hit(met.t, CSG_FACE_FIRST + met.face);
            }
        }
    }
}

fn csg_face_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let a = scene_storage.csg_faces[index].a;
    let b = scene_storage.csg_faces[index].b;
    let kind = scene_storage.csg_faces[index].kind;
    let material = scene_storage.csg_faces[index].material;
    var position = fma(vec3f(t), ray.direction, ray.origin);
    var normal = a;
    if (kind == CSG_FACE_CYLINDER) {
        normal = vec3f(-normalize(position.xy - a.xy), 0.0);
    } else if (HAS_CSG_CONE && (kind == CSG_FACE_CONE_X || kind == CSG_FACE_CONE_Y || kind == CSG_FACE_CONE_Z)) {
        let p = axis_last(kind, position);
        let from_axis = p.xy - a.xy;
        // Whichever of the cone and the plane is nearer to the point.
        let off_cone = length(from_axis) - fma(p.z, b.x, a.z);
        let off_plane = dot(from_axis, b.yz) - dot(b.yz, b.yz);
        let is_plane = off_plane * off_plane < off_cone * off_cone * dot(b.yz, b.yz);
        let n = select(vec3f(normalize(from_axis), -b.x), vec3f(b.yz, 0.0), is_plane);
        normal = axis_in_place(kind, normalize(n));
    } else if (HAS_CSG_CONE && kind == CSG_FACE_APEX_CONE) {
        normal = normalize(normalize(about_axis(b, position - a).aside) - b);
    } else if (kind != CSG_FACE_PLANE) {
        // The box's outer faces are hit on entry, a hollow's faces on exit.
        let inverse = inverse_direction(ray.direction);
        let from_low = (a - ray.origin) * inverse;
        let from_high = (b - ray.origin) * inverse;
        let is_outside = kind == CSG_FACE_OUTER_BOX;
        let span = box_span(ray, inverse, a, b);
        let leaves = max(from_low, from_high) == vec3f(span.y);
        let face = select(leaves, min(from_low, from_high) == vec3f(span.x), is_outside);
        // On an edge two faces are hit at once; the first axis wins.
        let axis = vec3<bool>(face.x, face.y && !face.x, !face.x && !face.y);
        let backward = select(vec3f(1.0), vec3f(-1.0), ray.direction > vec3f(0.0));
        let is_low = (backward < vec3f(0.0)) == vec3<bool>(is_outside);
        position = select(position, select(b, a, is_low), axis);
        normal = select(vec3f(0.0), backward, axis);
    }
    var albedo = scene_storage.materials[material].albedo;
    if (HAS_CSG_CONE && scene_storage.materials[material].pattern == PATTERN_CUE) {
        albedo = scene_storage.materials[material].stripe_albedo;
        if (kind == CSG_FACE_APEX_CONE) {
            // The next face is the plane of the narrow end.
            albedo = cue(material, dot(position, normalize(b)) + scene_storage.csg_faces[index + 1u].b.x);
        }
    }
    return Surface(position, normal, albedo, material, false);
}
