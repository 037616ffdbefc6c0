// Data written by Rust: each struct has the layout of its namesake there, which a test checks.
// Padding is implied by the alignment of vec3f.

struct SphereData {
    center: vec3f,
    radius: f32,
    stripe_axis: vec3f,
    material: u32,
    number_axis: vec3f,
    allows_refracted_nee: u32,
}

struct BoxData {
    min: vec3f,
    material: u32,
    max: vec3f,
}

struct CsgBoxData {
    min: vec3f,
    first_face: u32,
    max: vec3f,
    face_count: u32,
}

struct CsgFaceData {
    a: vec3f,
    kind: u32,
    b: vec3f,
    material: u32,
}

struct DiscData {
    center: vec3f,
    radius: f32,
    normal: vec3f,
    material: u32,
}

struct RectangleData {
    center: vec3f,
    material: u32,
    half_u: vec3f,
    inv_u2: f32,
    half_v: vec3f,
    inv_v2: f32,
    normal: vec3f,
}

struct AreaLightData {
    center: vec3f,
    brightness: f32,
    axis_u: vec3f,
    length_u: f32,
    axis_v: vec3f,
    length_v: f32,
    normal: vec3f,
    radiance: vec3f,
    gradient: vec3f,
    slope: vec3f,
}

struct MaterialData {
    albedo: vec3f,
    ior: f32,
    stripe_albedo: vec3f,
    stripe_half_width: f32,
    diffuse_scale: f32,
    kind: u32,
    alpha: f32,
    sampling_density: f32,
    eta: vec3f,
    pattern: u32,
    k: vec3f,
    number: u32,
    extinction: vec3f,
    grain_axis: u32,
    scattering: vec3f,
    sheen_roughness: f32,
    sheen: vec3f,
    metallic: f32,
    sights: vec3f,
    scale: f32,
}

struct SphereBound {
    center: vec3f,
    power: f32,
}

struct BoxBound {
    center: vec3f,
    half: vec3f,
}

struct CameraFrame {
    eye: vec3f,
    lens_steps: f32,
    corner: vec3f,
    lens_film: f32,
    dx: vec3f,
    near_m: f32,
    dy: vec3f,
}

struct SceneHeader {
    camera: CameraFrame,
    environment: vec3f,
    zero: u32,
}

struct DispatchData {
    tile_count: u32,
    block_count: u32,
    sample_begin: u32,
    sample_end: u32,
    samples: u32,
    // Number of samples in the first half, whose mean is stored separately, after the pixels of the
    // second half's means; 0 if there is a single mean.
    first_half: u32,
    pixels: u32,
    first_sample: u32,
    seed: u32,
    max_depth: u32,
    // 1 if the tiles are single pixels, whose number is a counter; otherwise 0.
    is_list: u32,
}

struct TileEntry {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    first_block: u32,
    first_pixel: u32,
}
