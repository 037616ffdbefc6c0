// Sampling of emissive spheres, uniformly in the cone of directions that they subtend.

fn sphere_point(index: u32, origin: vec3f, u: vec2f) -> EmissivePoint {
    let to_center = scene_storage.spheres[index].center - origin;
    let radius = scene_storage.spheres[index].radius;
    let material = scene_storage.spheres[index].material;
    let squared = dot(to_center, to_center);
    let area_per_angle = sphere_area_per_angle(squared, radius);
    if (area_per_angle == 0.0) {
        return NO_EMISSIVE_POINT;
    }
    let angle_per_area = 1.0 / area_per_angle;
    // 1 − cos θ, since the difference would lose the digits of small angles.
    let within = u.x * 2.0 * radius * radius * angle_per_area;
    let sine2 = within * (2.0 - within);
    let distance = sqrt(squared);
    let axis = to_center / distance;
    let frame = basis(axis);
    let across = sqrt(sine2) * circle(u.y);
    // Distance to the near intersection with the sphere: the projected distance minus half the
    // chord.
    let half_chord = sqrt(max(0.0, radius * radius - squared * sine2));
    return EmissivePoint(
        across.x * frame.t + across.y * frame.b + (1.0 - within) * axis,
        distance * (1.0 - within) - half_chord,
        angle_per_area,
        SPHERE_AREA_FACTOR * radius * radius,
        material,
        scene_storage.materials[material].k,
    );
}

// Area over solid angle (4πr² over that of the cone), for a point at the squared distance `squared`
// from the centre; 0 for points inside.
fn sphere_area_per_angle(squared: f32, radius: f32) -> f32 {
    // 2r² / (1 − cos θ) = 2d² (1 + cos θ), which does not cancel.
    let beyond = squared - radius * radius;
    return select(0.0, 2.0 * (squared + sqrt(squared * max(0.0, beyond))), beyond > 0.0);
}
