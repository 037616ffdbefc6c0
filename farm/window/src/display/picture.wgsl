// Stretches the picture over the window.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var linear: sampler;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

// One triangle that covers the window: corners at uv (0, 0), (2, 0), (0, 2).
@vertex
fn cover(@builtin(vertex_index) index: u32) -> Corner {
    let uv = vec2<f32>(f32(index & 1u), f32(index >> 1u)) * 2.0;
    return Corner(vec4<f32>(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, 0.0, 1.0), uv);
}

// The texture holds sRGB bytes, and so does a window format without "Srgb" in its name.
@fragment
fn show(corner: Corner) -> @location(0) vec4<f32> {
    return vec4<f32>(textureSample(picture, linear, corner.uv).rgb, 1.0);
}

// A window format that encodes by itself gets linear values.
@fragment
fn show_decoded(corner: Corner) -> @location(0) vec4<f32> {
    let c = textureSample(picture, linear, corner.uv).rgb;
    let high = pow((c + 0.055) / 1.055, vec3<f32>(2.4));
    return vec4<f32>(select(high, c / 12.92, c <= vec3<f32>(0.04045)), 1.0);
}
