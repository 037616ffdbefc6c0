// What fills dielectrics: free flight, by the exponential law of the clearest channel.

struct Flight {
    distance: f32,
    is_scattered: bool,
    weight: vec3f,
}

fn fly(material: u32, boundary: f32, u: f32) -> Flight {
    let rate = scene.materials[material].flight_rate;
    let beyond = scene.materials[material].extinction - rate;
    if (rate > 0.0) {
        let distance = -log(1.0 - u) / rate;
        if (distance < boundary) {
            let left = exp(-beyond * distance);
            return Flight(distance, true, scene.materials[material].scattering * left);
        }
    }
    return Flight(boundary, false, exp(-beyond * boundary));
}

fn uniform_direction(u1: f32, u2: f32) -> vec3f {
    let z = 1.0 - 2.0 * u1;
    return vec3f(sqrt(max(0.0, 1.0 - z * z)) * circle(u2), z);
}
