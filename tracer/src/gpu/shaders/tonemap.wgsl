// Tone mapping from radiance to display values: see `tonemap.rs` for curve, table and sources.

@group(0) @binding(12) var<storage, read> steps: array<u32>;

fn srgb8(light: vec3f) -> u32 {
    let peak = max(max(light.x, light.y), light.z);
    var rgb = light;
    if (peak > SHOULDER) {
        let range = 1.0 - SHOULDER;
        let high = 1.0 - range * range / (peak + (range - SHOULDER));
        let white = 1.0 - 1.0 / (DESATURATION * (peak - high) + 1.0);
        let channels = max(light, vec3f(0.0)) * (high / peak);
        rgb = channels + white * (high - channels);
    }
    return srgb_step(rgb.x) | (srgb_step(rgb.y) << 8u) | (srgb_step(rgb.z) << 16u);
}

fn srgb_step(x: f32) -> u32 {
    // The table is indexed by the upper bits, and the lower bits carry into the level at a
    // threshold. A power function would round differently between devices.
    let bits = bitcast<u32>(clamp(x, STEP_MIN, STEP_MAX));
    return (steps[(bits >> 16u) - FIRST_BUCKET] + (bits & 0xffffu)) >> 16u;
}
