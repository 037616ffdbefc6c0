use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2};

use glam::{Quat, Vec2, Vec3};
use serde_json::{Value, json};

use super::*;
use crate::scene::{ColorSpace, Layers, Material, Mesh, Object, Opacity, Shape, Wrap};
use crate::texture_file::{Texels, encode_png};

/// A `.glb` of JSON and a binary chunk.
pub(super) fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    let length = file.len() as u32;
    file[8..12].copy_from_slice(&length.to_le_bytes());
    file
}

fn picture() -> Vec<u8> {
    let texels = vec![[200, 100, 50, 255]; 4];
    encode_png(&Texels {
        size: [2, 2],
        texels,
    })
    .unwrap()
}

/// A triangle with normals and texture coordinates in two nodes, the second one translated, rotated
/// and mirrored; and a camera.
pub(super) fn sample() -> (Value, Vec<u8>) {
    let mut binary = Vec::new();
    let positions = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let normals = [[0.0f32, 0.0, 1.0]; 3];
    let uvs = [[0.0f32, 1.0], [1.0, 1.0], [0.0, 0.0]];
    let floats = positions
        .as_flattened()
        .iter()
        .chain(normals.as_flattened());
    let floats = floats.chain(uvs.as_flattened());
    binary.extend(floats.flat_map(|number| number.to_le_bytes()));
    binary.extend([0u16, 1, 2, 0].into_iter().flat_map(u16::to_le_bytes));
    let image = picture();
    let image_bytes = image.len();
    binary.extend(image);
    binary.resize(binary.len().next_multiple_of(4), 0);
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 2] }],
        "nodes": [
            { "name": "group", "translation": [0, 2, 0], "children": [1, 3] },
            { "name": "a", "mesh": 0 },
            { "name": "eye", "camera": 0, "translation": [0, 0, 5] },
            { "name": "b", "mesh": 0, "scale": [-2, 1, 1], "translation": [1, 0, 0],
              "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2] }
        ],
        "cameras": [{ "type": "perspective", "perspective": {
            "aspectRatio": 2.0, "yfov": 0.9272952, "znear": 0.1 } }],
        "meshes": [{ "primitives": [{ "material": 0, "indices": 3, "attributes": {
            "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 } }] }],
        "materials": [{ "name": "paint",
            "pbrMetallicRoughness": { "baseColorFactor": [1, 0.5, 0.25, 1], "metallicFactor": 0.25,
                "roughnessFactor": 0.75, "baseColorTexture": { "index": 0 },
                "metallicRoughnessTexture": { "index": 0 } },
            "normalTexture": { "index": 0 },
            "emissiveFactor": [0, 1, 0],
            "extensions": { "KHR_materials_ior": { "ior": 1.4 },
                "KHR_materials_emissive_strength": { "emissiveStrength": 3.0 } } }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "wrapS": 33071, "wrapT": 33648 }],
        "images": [{ "name": "photo", "mimeType": "image/png", "bufferView": 2 }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
              "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 0, "byteOffset": 72, "componentType": 5126, "count": 3, "type": "VEC2" },
            { "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 96 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 8 },
            { "buffer": 0, "byteOffset": 104, "byteLength": image_bytes }
        ],
        "buffers": [{ "byteLength": binary.len() }]
    });
    (json, binary)
}

pub(super) fn mesh(object: &Object) -> &Mesh {
    match &object.shape {
        Shape::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

pub(super) fn close(a: Vec3, b: Vec3) {
    assert!((a - b).length() < 1e-5, "{a} {b}");
}

#[test]
fn nodes_meshes_materials_and_camera_are_read() {
    let (json, binary) = sample();
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    let [a, b] = &scene.objects[..] else {
        panic!("{} objects", scene.objects.len());
    };
    assert_eq!((a.name.as_str(), b.name.as_str()), ("1 a", "3 b"));
    // Two metres up, in the plane facing −y.
    let (first, second) = (mesh(a), mesh(b));
    close(first.center, Vec3::new(0.0, 0.0, 2.0));
    close(first.positions[2], Vec3::Z);
    close(first.normals[0], Vec3::NEG_Y);
    assert_eq!(first.uvs[1], Vec2::ONE);
    assert_eq!(first.triangles, [[0, 1, 2]]);
    // Its x axis is mirrored and scaled by 2, then rotated to the file's −z, which is +y here; the
    // winding still matches the normal.
    close(second.center, Vec3::new(1.0, 0.0, 2.0));
    close(second.positions[1], Vec3::new(0.0, -2.0, 0.0));
    close(second.normals[0].normalize(), Vec3::X);
    let [p, q, r] = second.triangles[0].map(|corner| second.positions[corner as usize]);
    close((q - p).cross(r - p).normalize(), Vec3::X);

    let Material::MetallicRoughness {
        base_color,
        metallic,
        roughness,
        ior,
        emission,
        textures,
        opacity: Opacity::Opaque,
        layers: Layers::NONE,
    } = scene.materials[&a.material]
    else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!(base_color, Vec3::new(1.0, 0.5, 0.25));
    assert_eq!((metallic, roughness, ior), (0.25, 0.75, 1.4));
    assert_eq!(emission, 3.0 * Vec3::Y);
    let [base, surface] = [textures.base_color, textures.metallic_roughness];
    let [base, surface] = [base, surface].map(|index| &scene.textures[index.unwrap() as usize]);
    assert_eq!(base.color_space, ColorSpace::Srgb);
    assert_eq!(surface.color_space, ColorSpace::Linear);
    assert_eq!(
        (textures.normal, textures.emission),
        (textures.metallic_roughness, None)
    );
    assert_eq!(base.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert_eq!(base.image.bytes(), Some(&picture()[..]));

    close(scene.camera.eye, Vec3::new(0.0, -5.0, 0.0));
    close(scene.camera.target, Vec3::new(0.0, -4.0, 0.0));
    close(scene.camera.up, Vec3::Z);
    assert!((scene.camera.fov_x_deg - 90.0).abs() < 1e-4);
}

#[test]
fn lights_shine_along_minus_z_of_their_nodes() {
    use crate::scene::PunctualEmitter;
    let (mut json, binary) = sample();
    json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "directional", "intensity": 3.0, "color": [1, 0.5, 0] },
        { "type": "point", "intensity": 40.0 },
        { "type": "spot", "spot": { "innerConeAngle": 0.5, "outerConeAngle": FRAC_PI_2 } }
    ] } });
    for node in [1, 2, 3] {
        json["nodes"][node]["extensions"] = json!({ "KHR_lights_punctual": { "light": node - 1 } });
    }
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    assert_eq!(scene.environment.radiance, Vec3::ZERO);
    // In the order in which nodes are visited: the group's children first.
    let [sun, spot, point] = &scene.punctual_lights[..] else {
        panic!("{:?}", scene.punctual_lights);
    };
    assert_eq!(sun.name, "1 a");
    let PunctualEmitter::Distant {
        direction,
        irradiance,
    } = sun.emitter
    else {
        panic!("{sun:?}");
    };
    close(direction, Vec3::Y);
    close(irradiance, Vec3::new(3.0, 1.5, 0.0));
    let PunctualEmitter::Point { center, intensity } = point.emitter else {
        panic!("{point:?}");
    };
    close(center, Vec3::new(0.0, -5.0, 0.0));
    close(intensity, Vec3::splat(40.0));
    let PunctualEmitter::Spot {
        direction,
        outer_deg,
        ..
    } = spot.emitter
    else {
        panic!("{spot:?}");
    };
    // Rotated by a right angle about the file's +y, −z becomes −x.
    close(direction, Vec3::NEG_X);
    assert_eq!(outer_deg, 90.0);
    json["nodes"][1]["extensions"]["KHR_lights_punctual"]["light"] = json!(3);
    let refusal = Scene::from_gltf(&glb(&json, &binary))
        .unwrap_err()
        .to_string();
    assert!(refusal.contains("light 3 does not exist"), "{refusal}");
}

#[test]
fn files_beside_a_gltf_are_read_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    let (mut json, binary) = sample();
    std::fs::write(folder.path().join("all data.bin"), &binary).unwrap();
    std::fs::write(folder.path().join("photo.png"), picture()).unwrap();
    json["buffers"][0]["uri"] = json!("all%20data.bin");
    json["images"][0] = json!({ "uri": "photo.png" });
    std::fs::write(&path, json.to_string()).unwrap();
    let scene = Scene::load(&path).unwrap();
    assert_eq!(scene.textures[0].image.bytes(), Some(&picture()[..]));
    let refusal = Scene::from_gltf(json.to_string().as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        refusal.contains("buffer 0 is in a file, `all%20data.bin`"),
        "{refusal}"
    );
    for (uri, sentence) in [
        (
            "../photo.png",
            "image 0 is at `../photo.png`: it must lie beside",
        ),
        ("/etc/passwd", "image 0 is at `/etc/passwd`"),
        ("http://a/b.png", "image 0 is at `http://a/b.png`"),
        ("absent.png", "absent.png: No such file"),
        ("data:image/png,abc", "image 0: its data is not in base64"),
        (
            "data:image/png;base64,a*",
            "image 0: character 1 of the base64",
        ),
    ] {
        json["images"][0]["uri"] = json!(uri);
        std::fs::write(&path, json.to_string()).unwrap();
        let refusal = Scene::load(&path).unwrap_err().to_string();
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
}

#[test]
fn texture_transforms_are_applied_to_coordinates() {
    let (mut json, binary) = sample();
    let transform = json!({ "KHR_texture_transform": {
        "offset": [0.5, 0.25], "rotation": FRAC_PI_2, "scale": [2, 3] } });
    for texture in ["baseColorTexture", "metallicRoughnessTexture"] {
        json["materials"][0]["pbrMetallicRoughness"][texture]["extensions"] = transform.clone();
    }
    json["materials"][0]["normalTexture"]["extensions"] = transform;
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    // (1, 1) is scaled to (2, 3), rotated to (3, −2) and translated.
    let off = mesh(&scene.objects[0]).uvs[1] - Vec2::new(3.5, -1.75);
    assert!(off.length() < 1e-5, "{off}");
    let base = &mut json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    *base = json!({ "index": 0 });
    let refusal = Scene::from_gltf(&glb(&json, &binary))
        .unwrap_err()
        .to_string();
    assert!(
        refusal.contains("material 0 `paint`: its textures use different texture"),
        "{refusal}"
    );
}

#[test]
fn integers_strips_fans_and_sparse_elements_are_read() {
    // The four corners of a square as bytes; the last one is replaced by a sparse element.
    let mut binary: Vec<u8> = vec![0, 0, 0, 9, 1, 0, 0, 9, 0, 1, 0, 9, 0, 0, 0, 9];
    binary.extend([3, 0, 0, 0, 1, 1, 0, 0]);
    let square = |mode: u32| {
        json!({
            "asset": { "version": "2.0" },
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "mode": mode, "attributes": { "POSITION": 0 } }] }],
            "accessors": [{ "bufferView": 0, "componentType": 5121, "count": 4, "type": "VEC3",
                "sparse": { "count": 1,
                    "indices": { "bufferView": 1, "componentType": 5121 },
                    "values": { "bufferView": 1, "byteOffset": 4 } } }],
            "bufferViews": [{ "buffer": 0, "byteLength": 16, "byteStride": 4 },
                { "buffer": 0, "byteOffset": 16, "byteLength": 8 }],
            "buffers": [{ "byteLength": 24 }]
        })
    };
    let read = |mode| Scene::from_gltf(&glb(&square(mode), &binary));
    let strip = read(5).unwrap();
    let strip = mesh(&strip.objects[0]);
    close(strip.positions[3], Vec3::new(1.0, 0.0, 1.0));
    assert_eq!(strip.triangles, [[0, 1, 2], [2, 1, 3]]);
    let fan = read(6).unwrap();
    assert_eq!(mesh(&fan.objects[0]).triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh(&read(4).unwrap().objects[0]).triangles, [[0, 1, 2]]);
    let refusal = read(1).unwrap_err().to_string();
    assert!(
        refusal.contains("mesh 0, primitive 0 is made of Lines"),
        "{refusal}"
    );
}

#[test]
#[expect(clippy::too_many_lines, reason = "faults as data")]
fn each_fault_is_a_sentence_with_its_place() {
    type Spoil = fn(&mut Value, &mut Vec<u8>);
    let cases: [(Spoil, &str); 18] = [
        (
            |json, _| json["asset"]["version"] = json!("1.0"),
            "it is of glTF 1.0",
        ),
        (
            |json, _| json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]),
            "it requires the extension KHR_draco_mesh_compression, which is not read",
        ),
        (
            |json, _| json["nodes"][1]["children"] = json!([0]),
            "node 0 is reached twice",
        ),
        (
            |json, _| json["nodes"][0]["children"] = json!([1, 77]),
            "node 77 does not exist",
        ),
        (|json, _| json["scene"] = json!(3), "scene 3 does not exist"),
        (
            |json, _| json["nodes"][1]["mesh"] = json!(5),
            "mesh 5 does not exist",
        ),
        (
            |json, _| json["meshes"][0]["primitives"][0]["material"] = json!(1),
            "mesh 0, primitive 0: material 1 does not exist",
        ),
        (
            |json, _| json["accessors"][0]["count"] = json!(9),
            "accessor 0: 9 elements of 12 bytes each 12 bytes from byte 0 on are more than the 96",
        ),
        (
            |json, _| json["accessors"][0]["count"] = json!(u64::MAX),
            "accessor 0 has 18446744073709551615 elements",
        ),
        (
            |json, _| json["bufferViews"][0]["byteOffset"] = json!(u64::MAX),
            "buffer view 0 has bytes 18446744073709551615 and 96 on",
        ),
        (
            |json, _| json["bufferViews"][0]["byteStride"] = json!(4),
            "elements of 12 bytes each 4 bytes",
        ),
        (
            |json, _| json["buffers"][0]["byteLength"] = json!(1u64 << 40),
            "buffer 0 is to have 1099511627776 bytes",
        ),
        (
            |_, binary| binary[4..8].copy_from_slice(&f32::NAN.to_le_bytes()),
            "object 0 `1 a`: vertex 0 of its mesh is [NaN, ",
        ),
        (
            |_, binary| binary[98] = 7,
            "triangle 0 of its mesh has vertex 7, but there are 3 vertices",
        ),
        (
            |_, binary| binary[104] = 0,
            "texture 0 `0 photo`: it begins with the bytes [00, 50, 4e, 47]",
        ),
        (
            |json, _| json["textures"][0]["source"] = json!(4),
            "image 4 does not exist",
        ),
        (
            |json, _| json["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = json!(7.0),
            "its roughness is 7: it must be from 0 to 1",
        ),
        (
            |json, _| json["cameras"][0]["perspective"]["yfov"] = json!(0.0),
            "the camera's fov_x_deg is 0",
        ),
    ];
    for (spoil, sentence) in cases {
        let (mut json, mut binary) = sample();
        spoil(&mut json, &mut binary);
        let refusal = match Scene::from_gltf(&glb(&json, &binary)) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("`{sentence}` was expected"),
        };
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
}

/// A tetrahedron and a triangle of glass; only the former has an inside.
#[test]
fn closed_meshes_with_a_volume_that_transmit_are_dielectrics() {
    let corners = [
        [0.0f32, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let bytes = corners.as_flattened().iter();
    let mut binary: Vec<u8> = bytes.flat_map(|number| number.to_le_bytes()).collect();
    binary.extend([0u8, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]);
    let mut json = json!({
        "asset": { "version": "2.0" },
        "extensionsRequired": ["KHR_materials_transmission", "KHR_materials_volume"],
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [{ "mesh": 0 }, { "mesh": 0, "scale": [1, 1, -1] }],
        "meshes": [{ "primitives": [
            { "material": 0, "indices": 1, "attributes": { "POSITION": 0 } },
            { "material": 0, "indices": 2, "attributes": { "POSITION": 0 } }] }],
        "materials": [{ "name": "glass", "pbrMetallicRoughness": { "roughnessFactor": 0.5 },
            "extensions": { "KHR_materials_ior": { "ior": 1.6 },
                "KHR_materials_transmission": { "transmissionFactor": 1.0 },
                "KHR_materials_volume": { "thicknessFactor": 0.1, "attenuationDistance": 0.5,
                    "attenuationColor": [1.0, 0.5, 0.0] } } }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR" },
            { "bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 12 }],
        "buffers": [{ "byteLength": 60 }]
    });
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    let materials: Vec<_> = scene
        .objects
        .iter()
        .map(|object| object.material.as_str())
        .collect();
    // A mirrored one is closed too.
    let (body, surface) = ("0 body of glass", "0 glass");
    assert_eq!(materials, [body, surface, body, surface]);
    let Material::Dielectric {
        ior, alpha, medium, ..
    } = scene.materials[body]
    else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!((ior, alpha), (1.6, 0.25));
    // The fractions of light left after half a metre.
    let medium = medium.unwrap();
    let left = (-0.5 * medium.extinction).exp();
    close(left, Vec3::new(1.0, 0.5, 1e-6));
    assert_eq!(medium.albedo, Vec3::ZERO);

    let extensions = &mut json["materials"][0]["extensions"];
    extensions["KHR_materials_volume"]["attenuationDistance"] = json!(0.0);
    let refusal = Scene::from_gltf(&glb(&json, &binary))
        .unwrap_err()
        .to_string();
    assert!(
        refusal.contains("material 0 `glass`: it attenuates light to"),
        "{refusal}"
    );
    let extensions = &mut json["materials"][0]["extensions"];
    extensions["KHR_materials_transmission"]["transmissionFactor"] = json!(0.25);
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    assert_thin_walls(&scene, surface, 0.25);

    // Without a thickness closed meshes are thin walls, too.
    let extensions = &mut json["materials"][0]["extensions"];
    extensions["KHR_materials_transmission"]["transmissionFactor"] = json!(1.0);
    extensions["KHR_materials_volume"]["thicknessFactor"] = json!(0.0);
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    assert_thin_walls(&scene, surface, 1.0);
}

/// Checks that all objects have surfaces of this transmission.
fn assert_thin_walls(scene: &Scene, surface: &str, transmission: f32) {
    let mut objects = scene.objects.iter();
    assert!(objects.all(|object| object.material == surface));
    let Material::MetallicRoughness { layers, .. } = scene.materials[surface] else {
        panic!("{:?}", scene.materials);
    };
    assert_eq!(layers.transmission, transmission);
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let (json, binary) = sample();
    let file = glb(&json, &binary);
    for cut in (0..file.len() - 4).step_by(7) {
        assert!(Scene::from_gltf(&file[..cut]).is_err(), "{cut}");
    }
    let many = "[".repeat(100_000);
    for text in ["", "{}", "glTF", "glTF\x02\0\0\0\0\0\0\0\u{1}\0\0\0", &many] {
        assert!(Scene::from_gltf(text.as_bytes()).is_err());
    }
}

/// Without a camera in the file, the default one sees the whole scene.
#[test]
fn what_has_no_camera_is_framed() {
    let (mut json, binary) = sample();
    json["nodes"][2] = json!({});
    let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
    let view = scene.camera.target - scene.camera.eye;
    for object in &scene.objects {
        for position in &mesh(object).positions {
            let to = mesh(object).center + *position - scene.camera.eye;
            let cosine = to.normalize().dot(view.normalize());
            assert!(cosine > 0.93, "{position} is {cosine} from the middle");
        }
    }
    assert_eq!(mesh(&scene.objects[0]).rotation, Quat::IDENTITY);
}
