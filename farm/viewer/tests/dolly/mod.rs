//! A glTF file with two cameras and two animations.

use std::path::{Path, PathBuf};

/// Writes the file. Its first camera, `dolly`, in front of a square of 2 m, moves 2 m along x in the 2 s of
/// the animation `ride`; the second, `wide`, is fixed. The second animation, of 5 s, has no name and enlarges
/// the square to three times its size.
pub(crate) fn write(folder: &Path) -> PathBuf {
    let corners = [
        [-1.0, -1.0, 0.0],
        [1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, -1.0, 0.0],
        [1.0, 1.0, 0.0],
        [-1.0, 1.0, 0.0],
    ];
    let ride = [[0.0, 0.0, 9.0], [2.0, 0.0, 9.0]];
    let growth = [[1.0; 3], [3.0; 3]];
    let times = [0.0_f32, 2.0, 0.0, 5.0];
    let vectors = [&corners[..], &ride, &growth].concat();
    let numbers = vectors.as_flattened().iter().chain(&times);
    let bytes: Vec<u8> = numbers
        .flat_map(|number: &f32| number.to_le_bytes())
        .collect();
    std::fs::write(folder.join("dolly.bin"), bytes).unwrap();
    let path = folder.join("dolly.gltf");
    std::fs::write(&path, JSON).unwrap();
    path
}

const JSON: &str = r#"{ "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0, 1, 2] }],
    "nodes": [{ "mesh": 0 },
        { "camera": 0, "translation": [0, 0, 9] },
        { "camera": 1, "translation": [0, 0, 20], "name": "wide" }],
    "cameras": [
        { "name": "dolly", "type": "perspective", "perspective": { "yfov": 0.6, "znear": 0.1 } },
        { "type": "perspective", "perspective": { "yfov": 0.9, "znear": 0.1 } }],
    "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
    "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [0.02, 0.02, 0.02, 1], "metallicFactor": 0 } }],
    "animations": [
        { "name": "ride", "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
          "samplers": [{ "input": 3, "output": 1 }] },
        { "channels": [{ "sampler": 0, "target": { "node": 0, "path": "scale" } }],
          "samplers": [{ "input": 4, "output": 2 }] }],
    "accessors": [
        { "bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3" },
        { "bufferView": 0, "byteOffset": 72, "componentType": 5126, "count": 2, "type": "VEC3" },
        { "bufferView": 0, "byteOffset": 96, "componentType": 5126, "count": 2, "type": "VEC3" },
        { "bufferView": 0, "byteOffset": 120, "componentType": 5126, "count": 2, "type": "SCALAR" },
        { "bufferView": 0, "byteOffset": 128, "componentType": 5126, "count": 2, "type": "SCALAR" }],
    "bufferViews": [{ "buffer": 0, "byteLength": 136 }],
    "buffers": [{ "uri": "dolly.bin", "byteLength": 136 }] }"#;
