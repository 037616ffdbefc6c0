// Sheens with textures of colour or roughness: interpolates their reflectances in a table at each
// hit.

fn texture_sheen() {
    let roughness = layer_factors.sheen_roughness;
    layers.sheen_width = max(layers.sheen_width * roughness * roughness, SHEEN_WIDTH_MIN);
    layers.sheen *= layer_factors.sheen;
    let place = clamp((sqrt(layers.sheen_width) - SHEEN_ROOT_MIN) * SHEEN_ROWS_PER_ROOT, 0.0, f32(SHEEN_ROW_LAST));
    let row = min(u32(place), SHEEN_ROW_LAST - 1u);
    let share = vec3f(place - f32(row));
    let low = mix(SHEEN_REFLECTANCES[2u * row], SHEEN_REFLECTANCES[2u * row + 2u], share);
    let high = mix(SHEEN_REFLECTANCES[2u * row + 1u], SHEEN_REFLECTANCES[2u * row + 3u], share);
    let strength = TWO_PI * largest(layers.sheen);
    layers.sheen_reflected_low = strength * low;
    layers.sheen_reflected_high = strength * high;
}
