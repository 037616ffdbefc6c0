// Contact of nodes with obstacles, in cells from the region's first node.

// The unit normal and the signed distance of a point from the surface in cells, negative inside.
fn obstacle_distance(obstacle: Obstacle, at: vec3<f32>) -> vec4<f32> {
    if (obstacle.half_size.x < 0.0) {
        return vec4(obstacle.place, dot(obstacle.place, at) - obstacle.offset);
    }
    let axes = mat3x3(obstacle.axis_x, obstacle.axis_y, obstacle.axis_z);
    let local = (at - obstacle.place) * axes;
    let outside = abs(local) - obstacle.half_size;
    let most = max(max(outside.x, outside.y), outside.z);
    var normal = max(outside, vec3(0.0));
    if (most <= 0.0) {
        normal = vec3(0.0);
        if (most == outside.x) {
            normal.x = 1.0;
        } else if (most == outside.y) {
            normal.y = 1.0;
        } else {
            normal.z = 1.0;
        }
    }
    let side = select(vec3(-1.0), vec3(1.0), local >= vec3(0.0));
    let distance = length(max(outside, vec3(0.0))) + min(most, 0.0);
    return vec4(axes * (normalize(normal) * side), distance);
}

// Velocity of a node after contact with an obstacle, by Coulomb's law (Stomakhin et al. 2013, section 8).
fn stop(obstacle: Obstacle, at: vec3<f32>, velocity: vec3<f32>, friction: f32) -> vec3<f32> {
    let surface = obstacle_distance(obstacle, at);
    if (surface.w > SURFACE_CELLS) {
        return velocity;
    }
    if (obstacle.is_bonded != 0u) {
        return vec3(0.0);
    }
    let approach = dot(velocity, surface.xyz);
    if (approach >= 0.0) {
        return velocity;
    }
    let along = velocity - surface.xyz * approach;
    let speed = length(along);
    let lost = -friction * approach;
    if (speed <= lost) {
        return vec3(0.0);
    }
    return along * (1.0 - lost / speed);
}

fn stop_all(at: vec3<f32>, velocity: vec3<f32>, friction: f32) -> vec3<f32> {
    var stopped = velocity;
    for (var i = 0u; i < params.obstacles; i++) {
        stopped = stop(obstacles[i], at, stopped, friction);
    }
    return stopped;
}
