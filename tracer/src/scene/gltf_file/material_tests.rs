use glam::{Vec3, Vec4};
use serde_json::{Value, json};

use super::tests::{glb, mesh, sample};
use super::*;
use crate::scene::{ColorSpace, Layers, Material, Opacity};
use crate::texture_file::{Texels, encode_png};

/// The material of the sample's first object.
fn material(json: &Value, binary: &[u8]) -> Material {
    let scene = Scene::from_gltf(&glb(json, binary)).unwrap();
    scene.materials[&scene.objects[0].material]
}

fn layers(material: Material) -> Layers {
    match material {
        Material::MetallicRoughness { layers, .. } => layers,
        other => panic!("{other:?}"),
    }
}

/// The sample with one more accessor, of these bytes.
fn with_accessor(mut accessor: Value, bytes: &[u8]) -> (Value, Vec<u8>) {
    let (mut json, mut binary) = sample();
    let views = json["bufferViews"].as_array_mut().unwrap();
    accessor["bufferView"] = json!(views.len());
    views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len() }));
    binary.extend(bytes);
    binary.resize(binary.len().next_multiple_of(4), 0);
    json["accessors"].as_array_mut().unwrap().push(accessor);
    json["buffers"][0]["byteLength"] = json!(binary.len());
    json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(4);
    (json, binary)
}

#[test]
fn alpha_modes_are_read() {
    let (mut json, binary) = sample();
    assert_eq!(material(&json, &binary).opacity(), Opacity::Opaque);
    let base = &mut json["materials"][0]["pbrMetallicRoughness"];
    base["baseColorFactor"] = json!([1, 1, 1, 0.75]);
    for (mode, expected) in [
        (json!("OPAQUE"), Opacity::Opaque),
        (json!("BLEND"), Opacity::Blend { alpha: 0.75 }),
        (
            json!("MASK"),
            Opacity::Mask {
                alpha: 0.75,
                cutoff: 0.5,
            },
        ),
    ] {
        json["materials"][0]["alphaMode"] = mode;
        assert_eq!(material(&json, &binary).opacity(), expected);
    }
    json["materials"][0]["alphaCutoff"] = json!(0.25);
    let Opacity::Mask { cutoff, .. } = material(&json, &binary).opacity() else {
        panic!("it is a mask");
    };
    assert_eq!(cutoff, 0.25);
}

#[test]
fn layers_specular_and_scale_of_normals_are_read() {
    let (mut json, binary) = sample();
    assert_eq!(layers(material(&json, &binary)), Layers::NONE);
    json["materials"][0]["normalTexture"]["scale"] = json!(0.5);
    json["materials"][0]["extensions"] = json!({
        "KHR_materials_clearcoat": { "clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.5,
            "clearcoatTexture": { "index": 0 },
            "clearcoatNormalTexture": { "index": 0, "scale": 0.25 } },
        "KHR_materials_sheen": { "sheenColorFactor": [0.25, 0.5, 1], "sheenRoughnessFactor": 0.5,
            "sheenColorTexture": { "index": 0 }, "sheenRoughnessTexture": { "index": 0 } },
        "KHR_materials_specular": { "specularFactor": 0.25, "specularColorFactor": [1, 2, 0],
            "specularTexture": { "index": 0 }, "specularColorTexture": { "index": 0 } },
        "KHR_materials_dispersion": { "dispersion": 0.1 }
    });
    json["extensionsRequired"] = json!([
        "KHR_materials_clearcoat",
        "KHR_materials_sheen",
        "KHR_materials_specular"
    ]);
    let read = material(&json, &binary);
    let expected = Layers {
        clearcoat: 0.75,
        clearcoat_roughness: 0.5,
        sheen: Vec3::new(0.25, 0.5, 1.0),
        sheen_roughness: 0.5,
        specular: 0.25,
        specular_color: Vec3::new(1.0, 2.0, 0.0),
        transmission: 0.0,
    };
    assert_eq!(layers(read), expected);
    let textures = read.textures();
    assert_eq!(textures.normal_scale, 0.5);
    assert_eq!(textures.clearcoat, textures.metallic_roughness);
    assert_eq!(textures.clearcoat_roughness, None);
    assert_eq!(textures.clearcoat_normal, textures.metallic_roughness);
    assert_eq!(textures.clearcoat_normal_scale, 0.25);
    // Colours are sRGB, as is the base colour.
    let colors = [textures.sheen, textures.specular_color];
    let alphas = [textures.sheen_roughness, textures.specular];
    assert_eq!(
        (colors, alphas),
        ([textures.base_color; 2], [textures.base_color; 2])
    );
}

#[test]
fn vertex_colours_of_all_types_are_read() {
    let floats = |numbers: &[f32]| -> Vec<u8> {
        numbers
            .iter()
            .flat_map(|number| number.to_le_bytes())
            .collect()
    };
    let words = |numbers: &[u16]| -> Vec<u8> {
        numbers
            .iter()
            .flat_map(|number| number.to_le_bytes())
            .collect()
    };
    let cases = [
        // Floats beyond 0 and 1 are clamped.
        (
            json!({ "componentType": 5126, "type": "VEC3", "count": 3 }),
            floats(&[0.0, 0.5, 1.0, -1.0, 2.0, 0.25, 0.0, 0.0, 0.0]),
            [[0.0, 0.5, 1.0, 1.0], [0.0, 1.0, 0.25, 1.0]],
        ),
        (
            json!({ "componentType": 5126, "type": "VEC4", "count": 3 }),
            floats(&[0.0, 0.5, 1.0, 0.75, 1.0, 1.0, 0.25, 0.5, 0.0, 0.0, 0.0, 0.0]),
            [[0.0, 0.5, 1.0, 0.75], [1.0, 1.0, 0.25, 0.5]],
        ),
        (
            json!({ "componentType": 5121, "type": "VEC4", "count": 3, "normalized": true }),
            vec![0, 51, 255, 102, 255, 255, 153, 0, 0, 0, 0, 0],
            [[0.0, 0.2, 1.0, 0.4], [1.0, 1.0, 0.6, 0.0]],
        ),
        (
            json!({ "componentType": 5123, "type": "VEC3", "count": 3, "normalized": true }),
            words(&[0, 13107, 65535, 65535, 0, 39321, 0, 0, 0]),
            [[0.0, 0.2, 1.0, 1.0], [1.0, 0.0, 0.6, 1.0]],
        ),
    ];
    for (accessor, bytes, expected) in cases {
        let (json, binary) = with_accessor(accessor, &bytes);
        let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
        let colors = &mesh(&scene.objects[0]).colors;
        for (color, expected) in colors.iter().zip(expected) {
            assert!(
                (*color - Vec4::from(expected)).abs().max_element() < 1e-6,
                "{colors:?}"
            );
        }
    }
}

#[test]
fn faults_of_materials_and_colours_are_sentences() {
    assert_refused(&[
        (
            |json| json["materials"][0]["alphaMode"] = json!("HALF"),
            "material 0 `paint`: its alphaMode must be OPAQUE, MASK or BLEND",
        ),
        (
            |json| {
                json["materials"][0]["alphaMode"] = json!("BLEND");
                json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][3] = json!(1.5);
            },
            "`0 paint`: the alpha of its opacity is 1.5",
        ),
        (
            |json| {
                json["materials"][0]["alphaMode"] = json!("MASK");
                json["materials"][0]["alphaCutoff"] = json!(-1);
            },
            "`0 paint`: the cutoff of its opacity is -1",
        ),
        (
            |json| json["accessors"][4]["normalized"] = json!(false),
            "mesh 0, primitive 0, its colours: accessor 4 holds integers: they must be normalized",
        ),
        (
            |json| json["accessors"][4]["count"] = json!(2),
            "its mesh has 2 colours for 3 vertices",
        ),
    ]);
}

#[test]
fn faults_of_layers_are_sentences() {
    assert_refused(&[
        (
            |json| json["materials"][0]["normalTexture"]["scale"] = json!(1e9),
            "`0 paint`: the normal_scale of its textures is 1000000000",
        ),
        (
            |json| {
                json["materials"][0]["extensions"]["KHR_materials_clearcoat"] =
                    json!({ "clearcoatNormalTexture": { "index": 0, "scale": -1e9 } });
            },
            "`0 paint`: the clearcoat_normal_scale of its textures is -1000000000",
        ),
        (
            |json| {
                json["materials"][0]["extensions"]["KHR_materials_sheen"] =
                    json!({ "sheenColorTexture": { "index": 7 } });
            },
            "material 0 `paint`: texture 7 does not exist",
        ),
        (
            |json| {
                json["materials"][0]["extensions"]["KHR_materials_clearcoat"] =
                    json!({ "clearcoatFactor": 2 });
            },
            "`0 paint`: its clearcoat is 2",
        ),
        (
            |json| {
                json["materials"][0]["extensions"]["KHR_materials_transmission"] =
                    json!({ "transmissionFactor": 1.5 });
            },
            "`0 paint`: its transmission is 1.5",
        ),
        (
            |json| {
                json["materials"][0]["extensions"]["KHR_materials_sheen"] =
                    json!({ "sheenColorFactor": "red" });
            },
            "material 0 `paint`: its KHR_materials_sheen: invalid type: string",
        ),
    ]);
}

type Spoil = fn(&mut Value);

/// The sample with invalid colours is refused with this message.
fn assert_refused(cases: &[(Spoil, &str)]) {
    let accessor = json!({ "componentType": 5121, "type": "VEC4", "count": 3, "normalized": true });
    for (spoil, sentence) in cases {
        let (mut json, binary) = with_accessor(accessor.clone(), &[100; 12]);
        spoil(&mut json);
        let refusal = Scene::from_gltf(&glb(&json, &binary))
            .unwrap_err()
            .to_string();
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
}

/// The mean of a texture decides whether a body transmits light.
#[test]
fn bodies_transmit_by_the_mean_of_their_texture() {
    let bodies = |texels: [u8; 2], factor: f32| {
        let (mut json, mut binary) = sample();
        let texels = texels.map(|red| [red, 90, 90, 255]).to_vec();
        let size = [2, 1];
        let file = encode_png(&Texels { size, texels }).unwrap();
        let views = json["bufferViews"].as_array_mut().unwrap();
        let view = views.len();
        views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": file.len() }));
        binary.extend(file);
        binary.resize(binary.len().next_multiple_of(4), 0);
        json["buffers"][0]["byteLength"] = json!(binary.len());
        let images = json["images"].as_array_mut().unwrap();
        images.push(json!({ "mimeType": "image/png", "bufferView": view }));
        let textures = json["textures"].as_array_mut().unwrap();
        textures.push(json!({ "source": 1 }));
        json["materials"][0]["extensions"] = json!({
            "KHR_materials_transmission": {
                "transmissionFactor": factor, "transmissionTexture": { "index": 1 } },
            "KHR_materials_volume": { "thicknessFactor": 0.1 } });
        let scene = Scene::from_gltf(&glb(&json, &binary)).unwrap();
        // The surface of a thin wall has the texture.
        let surface = scene.materials[&scene.objects[0].material];
        let map = surface.textures().transmission.unwrap();
        assert_eq!(scene.textures[map as usize].color_space, ColorSpace::Linear);
        assert_eq!(layers(surface).transmission, factor);
        let materials = scene.materials.values();
        let glass = |material: &&Material| matches!(material, Material::Dielectric { .. });
        materials.filter(glass).count()
    };
    assert_eq!(bodies([255, 64], 1.0), 1);
    assert_eq!(bodies([255, 64], 0.75), 0);
    assert_eq!(bodies([200, 0], 1.0), 0);
}
