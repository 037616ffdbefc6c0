// Clear coats and sheens on thin walls.

// Transmittance of the layers on both sides; both directions are on one side.
fn layers_passed(n: vec3f, wo: vec3f, wi: vec3f) -> f32 {
    let coat_n = coat_normal_beside(n);
    let coats = (1.0 - coat_reflected(dot(coat_n, wo))) * (1.0 - coat_reflected(dot(coat_n, wi)));
    let sheen = max(sheen_reflected(dot(n, wo)), sheen_reflected(dot(n, wi)));
    return coats * max(1.0 - sheen, 0.0);
}

fn coat_share_reflected(n: vec3f, wo: vec3f) -> f32 {
    return coat_reflected(dot(coat_normal_beside(n), wo));
}

// Energy sent on by the reflection, base and sheen.
fn weight_above(cos_o: f32) -> f32 {
    let weights = weights_below(cos_o);
    return weights.x + weights.y;
}
