// Media inside dielectrics: free-flight sampling, exponentially with the rate of the clearest
// channel.

struct FreeFlight {
    distance: f32,
    is_scattered: bool,
    weight: vec3f,
}

fn sample_distance(material: u32, boundary: f32, u: f32) -> FreeFlight {
    let rate = scene_storage.materials[material].sampling_density;
    // At least 0 in every channel, so that no weight of a flight exceeds 1.
    let beyond = scene_storage.materials[material].extinction - rate;
    if (rate > 0.0) {
        let distance = -log(1.0 - u) / rate;
        if (distance < boundary) {
            // σs exp(−σt d) over the density rate · exp(−rate d); `scattering` is σs / rate.
            let left = exp(-beyond * distance);
            return FreeFlight(distance, true, scene_storage.materials[material].scattering * left);
        }
    }
    return FreeFlight(boundary, false, exp(-beyond * boundary));
}

fn uniform_direction(u1: f32, u2: f32) -> vec3f {
    let z = 1.0 - 2.0 * u1;
    return vec3f(sqrt(max(0.0, 1.0 - z * z)) * circle(u2), z);
}
