//! Files of others: pictures, environment maps, glTF.

use std::sync::atomic::AtomicBool;

use carom_tracer::glam::Vec3;
use carom_tracer::scene::gltf_file::{AnimatedScene, AnimationTime};
use carom_tracer::texture_file::{Texels, encode_png};
use carom_tracer::{
    CompiledScene, ImageSize, RadianceImage, RenderSettings, ScalarTracer, Scene, TileGrid,
    TileRadiance, TraceJob, Tracer, environment_file, texture_file,
};

/// A file is a sentence, or a picture of the size that its header tells.
pub fn texture(bytes: &[u8]) {
    let Ok(size) = texture_file::size(bytes) else {
        assert!(texture_file::decode(bytes).is_err());
        return;
    };
    // Decoding the largest takes a second.
    if u64::from(size[0]) * u64::from(size[1]) > 1 << 20 {
        return;
    }
    if let Ok(picture) = texture_file::decode(bytes) {
        assert_eq!(picture.size, size);
        assert_eq!(
            picture.texels.len() as u64,
            u64::from(size[0]) * u64::from(size[1])
        );
    }
}

/// A file is a sentence, or radiance that is finite and at least 0.
pub fn environment(bytes: &[u8]) {
    let Ok(size) = environment_file::size(bytes) else {
        return;
    };
    if size.pixels() > 1 << 20 {
        return;
    }
    if let Ok(picture) = environment_file::decode(bytes) {
        assert_eq!(picture.size, size);
        let channels = picture.pixels.as_flattened().iter();
        channels.for_each(|channel| assert!(channel.is_finite() && *channel >= 0.0));
    }
}

/// A file is a sentence, or a scene that compiles or says why not, and reads back from JSON as the same. At any time of its
/// animations it is a sentence or a scene too, and what an update moves are meshes that it has. A small one is traced: each
/// sample is finite and at least 0, or counted as dropped.
pub fn gltf(bytes: &[u8]) {
    let Ok(animated) = AnimatedScene::from_gltf(bytes) else {
        return;
    };
    for (index, animation) in animated.animations().iter().enumerate().take(4) {
        let end_secs = animation.duration_secs();
        assert!(end_secs.is_finite() && end_secs >= 0.0);
        let middle = AnimationTime::At(index, 0.4 * end_secs);
        let moved = animated.scene(middle);
        let update = animated.update(AnimationTime::Rest, middle);
        let update = update.expect("a scene that was read has poses");
        if let (Ok(moved), Some(update)) = (moved, update) {
            assert_eq!(moved.objects.len(), animated.rest().objects.len());
            for pose in update.poses {
                assert!((pose.object as usize) < moved.objects.len());
                assert!((pose.rotation.length() - 1.0).abs() < 1e-5);
            }
        }
    }
    let scene = animated.rest();
    let json = scene.to_json().expect("a scene that was read is valid");
    assert_eq!(
        Scene::from_json(&json).expect("a written scene is right"),
        **scene
    );
    if scene.texture_bytes().is_ok_and(|bytes| bytes < 1 << 22)
        && let Ok(compiled) = CompiledScene::new(scene)
        && compiled.meshes.triangles.len() < 1000
    {
        trace(&compiled);
    }
}

/// Traces a few samples of a scene.
fn trace(scene: &CompiledScene) {
    let size = ImageSize::new(3, 2);
    let grid = TileGrid::new(size, 4);
    let job = TraceJob {
        size,
        tiles: &grid.tiles(grid.all()).collect::<Vec<_>>(),
        settings: RenderSettings {
            samples: 2,
            max_depth: 4,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    let sink = |tile: TileRadiance| {
        let channels = tile.radiance.as_flattened().iter();
        channels.for_each(|channel| assert!(channel.is_finite() && *channel >= 0.0));
    };
    let traced = ScalarTracer.trace(scene, &job, &sink);
    traced.expect("the processor is there");
}

/// A PNG file.
pub fn texture_seeds() -> Vec<Vec<u8>> {
    let texels = (0..35).map(|i: u8| [i, 7 * i, 255 - i, 200]).collect();
    let size = [7, 5];
    vec![encode_png(&Texels { size, texels }).expect("its size is right")]
}

/// An OpenEXR file, and Radiance HDR files with runs and without.
pub fn environment_seeds() -> Vec<Vec<u8>> {
    let mut picture = RadianceImage::black(ImageSize::new(6, 3));
    for (index, pixel) in picture.pixels.iter_mut().enumerate() {
        *pixel = (Vec3::new(0.5, 1.0, 20.0) * index as f32).to_array();
    }
    let exr = environment_file::encode_exr(&picture).expect("memory can be written");
    let header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 9\n";
    let runs = [
        2, 2, 0, 9, 137, 128, 5, 1, 2, 3, 4, 5, 132, 9, 137, 0, 137, 129,
    ];
    let plain = [100; 36];
    vec![
        exr,
        [&header[..], &runs].concat(),
        [&header[..], &plain].concat(),
    ]
}

/// Triangles of two materials with most of what these have, as `.glb` and as text, and one that a skin, morph targets and an animation move.
pub fn gltf_seeds() -> Vec<Vec<u8>> {
    let corners: [f32; 15] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.];
    let mut binary: Vec<u8> = corners.into_iter().flat_map(f32::to_le_bytes).collect();
    let image = texture_seeds().remove(0);
    let image_bytes = image.len();
    binary.extend(image);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"children":[1]}},
        {{"mesh":0,"translation":[0,1,0],"scale":[1,-2,1]}}],"meshes":[{{"primitives":[{{"material":0,"attributes":
        {{"POSITION":0,"TEXCOORD_0":1,"COLOR_0":0}}}},{{"material":1,"attributes":{{"POSITION":0,"TEXCOORD_0":1}}}}]}}],
        "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}},"baseColorFactor":[1,1,1,0.5]}},
        "alphaMode":"BLEND","normalTexture":{{"index":0,"scale":0.5}},"extensions":{{"KHR_materials_clearcoat":
        {{"clearcoatFactor":1,"clearcoatRoughnessFactor":0.3,"clearcoatTexture":{{"index":0}}}}}}}},{{"alphaMode":"MASK",
        "alphaCutoff":0.5,"emissiveFactor":[1,0.5,0],"extensions":{{"KHR_materials_sheen":{{"sheenColorFactor":[1,1,0.5],
        "sheenRoughnessFactor":0.5}},"KHR_materials_specular":{{"specularFactor":0.5,"specularColorFactor":[1,0,2]}},
        "KHR_materials_emissive_strength":{{"emissiveStrength":9}}}}}}],"textures":[{{"source":0}}],"images":[{{"mimeType":
        "image/png","bufferView":1}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":0,"byteOffset":36,"componentType":5126,"count":3,"type":"VEC2"}}],"bufferViews":
        [{{"buffer":0,"byteLength":60}},{{"buffer":0,"byteOffset":60,"byteLength":{image_bytes}}}],"buffers":
        [{{"byteLength":{}}}]}}"#,
        binary.len()
    );
    vec![glb(&json, &binary), json.into_bytes(), moving_triangle()]
}

/// A triangle that follows two joints and has a morph target; all move.
fn moving_triangle() -> Vec<u8> {
    let corners = [0., 0., 0., 1., 0., 0., 0., 1., 0.];
    let joints = [0., 1., 0., 0., 0., 1., 0., 0., 1., 0., 0., 0.];
    let weights = [0.5, 0.5, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.];
    let (times, turns) = ([0., 1.], [0., 0., 0., 1., 0., 0., 1., 0.]);
    let slide = [
        0., 0., 0., 0., 0., 0., 1., 0., 0., 0., 1., 0., 2., 0., 0., 0., 0., 0.,
    ];
    let parts: [(&str, &[f32]); 6] = [
        ("VEC3", &corners),
        ("VEC4", &joints),
        ("VEC4", &weights),
        ("SCALAR", &times),
        ("VEC4", &turns),
        ("VEC3", &slide),
    ];
    let (mut binary, mut accessors) = (Vec::new(), Vec::new());
    for (kind, numbers) in parts {
        let width = kind.as_bytes().last().map_or(1, |digit| match digit {
            b'3' => 3,
            b'4' => 4,
            _ => 1,
        });
        accessors.push(format!(
            r#"{{"bufferView":0,"byteOffset":{},"componentType":5126,"count":{},"type":"{kind}"}}"#,
            binary.len(),
            numbers.len() / width
        ));
        binary.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0,1]}}],"nodes":[{{"mesh":0,"skin":0}},{{"children":[2]}},
        {{"mesh":1}}],"skins":[{{"joints":[1,2]}}],"meshes":[{{"weights":[0.5],"primitives":[{{"attributes":
        {{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}},"targets":[{{"POSITION":0}}]}}]}},{{"primitives":[{{"attributes":
        {{"POSITION":0}}}}]}}],"animations":[{{"channels":[{{"sampler":0,"target":{{"node":2,"path":"rotation"}}}},
        {{"sampler":1,"target":{{"node":1,"path":"translation"}}}},{{"sampler":2,"target":{{"node":0,"path":"weights"}}}}],
        "samplers":[{{"input":3,"output":4}},{{"input":3,"output":5,"interpolation":"CUBICSPLINE"}},
        {{"input":3,"output":3,"interpolation":"STEP"}}]}}],"accessors":[{}],"bufferViews":[{{"buffer":0,"byteLength":
        {length}}}],"buffers":[{{"byteLength":{length}}}]}}"#,
        accessors.join(","),
        length = binary.len()
    );
    glb(&json, &binary)
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8], bytes: &[u8]| {
        let length = (bytes.len() as u32).to_le_bytes();
        [&length[..], kind, bytes].concat()
    };
    let header = b"glTF\x02\0\0\0\0\0\0\0";
    [
        &header[..],
        &chunk(b"JSON", json.as_bytes()),
        &chunk(b"BIN\0", binary),
    ]
    .concat()
}
