use std::f32::consts::{FRAC_1_SQRT_2, PI};

use glam::{Quat, Vec3};
use serde_json::{Value, json};

use super::tests::{close, glb, mesh};
use super::{AnimatedScene, AnimationTime};
use crate::scene::{Scene, SceneUpdate};

/// Accessors and the bytes of their buffer.
#[derive(Default)]
struct Builder {
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
}

impl Builder {
    fn add(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len() }));
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": component, "count": count, "type": kind,
            "normalized": component == 5121 && kind == "VEC4" && bytes.iter().any(|byte| *byte > 8) }));
        self.binary.extend(bytes);
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, kind: &str, values: &[[f32; N]]) -> usize {
        let bytes = values.as_flattened().iter();
        let bytes: Vec<u8> = bytes.flat_map(|value| value.to_le_bytes()).collect();
        self.add(kind, 5126, values.len(), &bytes)
    }

    fn scalars(&mut self, values: &[f32]) -> usize {
        let values: Vec<_> = values.iter().map(|value| [*value]).collect();
        self.floats("SCALAR", &values)
    }

    fn bytes(&mut self, values: &[[u8; 4]]) -> usize {
        self.add("VEC4", 5121, values.len(), values.as_flattened())
    }

    fn finish(self, mut json: Value) -> (Value, Vec<u8>) {
        json["asset"] = json!({ "version": "2.0" });
        json["accessors"] = json!(self.accessors);
        json["bufferViews"] = json!(self.views);
        json["buffers"] = json!([{ "byteLength": self.binary.len() }]);
        (json, self.binary)
    }
}

fn read((json, binary): &(Value, Vec<u8>)) -> AnimatedScene {
    AnimatedScene::from_gltf(&glb(json, binary)).unwrap()
}

fn at(scene: &AnimatedScene, secs: f64) -> Scene {
    scene.scene(AnimationTime::At(0, secs)).unwrap()
}

/// World positions of an object after an update.
fn positions(scene: &Scene, update: &SceneUpdate, object: usize) -> Vec<Vec3> {
    let mesh = mesh(&scene.objects[object]);
    let pose = update
        .poses
        .iter()
        .find(|pose| pose.object as usize == object);
    let (center, rotation) = pose.map_or((mesh.center, mesh.rotation), |pose| {
        (pose.position, pose.rotation)
    });
    mesh.positions
        .iter()
        .map(|p| center + rotation * *p)
        .collect()
}

/// A triangle on one moving arm and a camera on another, with key frames of every kind.
fn arm() -> (Value, Vec<u8>) {
    let mut data = Builder::default();
    let corners = data.floats("VEC3", &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let normals = data.floats("VEC3", &[[0.0, 0.0, 1.0]; 3]);
    let turn_times = data.scalars(&[1.0, 3.0]);
    // To a right angle about +y, with a negated quaternion: the direct way would be the longer one.
    let turns = data.floats(
        "VEC4",
        &[
            [0.0, 0.0, 0.0, 1.0],
            [0.0, -FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2],
        ],
    );
    let step_times = data.scalars(&[0.0, 1.5, 2.5]);
    let steps = data.floats("VEC3", &[[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 4.0, 0.0]]);
    let spline_times = data.scalars(&[0.0, 2.0]);
    let spline = data.floats(
        "VEC3",
        &[
            [9.0; 3],
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [0.0, 0.0, -4.0],
            [1.0, 0.0, 0.0],
            [9.0; 3],
        ],
    );
    data.finish(json!({
        "scenes": [{ "nodes": [0, 3] }],
        "nodes": [
            { "name": "arm", "scale": [2, 2, 2], "children": [1] },
            { "name": "hand", "translation": [1, 0, 0], "mesh": 0, "children": [2] },
            { "name": "finger", "translation": [0, 0, 1], "mesh": 0 },
            { "name": "eye", "camera": 0 }
        ],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": corners, "NORMAL": normals } }] }],
        "animations": [{ "name": "wave",
            "channels": [
                { "sampler": 0, "target": { "node": 0, "path": "rotation" } },
                { "sampler": 1, "target": { "node": 0, "path": "translation" } },
                { "sampler": 2, "target": { "node": 3, "path": "translation" } }
            ],
            "samplers": [
                { "input": turn_times, "output": turns },
                { "input": step_times, "output": steps, "interpolation": "STEP" },
                { "input": spline_times, "output": spline, "interpolation": "CUBICSPLINE" }
            ] }]
    }))
}

#[test]
fn nodes_stand_where_their_key_frames_have_them() {
    let scene = read(&arm());
    assert_eq!(scene.animations()[0].name(), "wave");
    assert_eq!(scene.animations()[0].duration_secs(), 3.0);
    let hand = |secs| mesh(&at(&scene, secs).objects[0]).center;
    // The file's (x, y, z) is (x, −z, y) here; the hand is 2 m out on the arm.
    close(hand(-1.0), Vec3::new(2.0, 0.0, 0.0));
    close(hand(1.0), Vec3::new(2.0, 0.0, 0.0));
    close(
        hand(1.5),
        Vec3::new(2.0 * (PI / 8.0).cos(), 2.0 * (PI / 8.0).sin(), 2.0),
    );
    let half = 2.0 * FRAC_1_SQRT_2;
    close(hand(2.0), Vec3::new(half, half, 2.0));
    close(
        hand(2.5),
        Vec3::new(2.0 * (PI * 0.375).cos(), 2.0 * (PI * 0.375).sin(), 4.0),
    );
    close(hand(3.0), Vec3::new(0.0, 2.0, 4.0));
    close(hand(99.0), Vec3::new(0.0, 2.0, 4.0));
    // The finger is 2 m along the arm's z, which is −y here and turns to −y × … = +x.
    close(
        mesh(&at(&scene, 3.0).objects[1]).center,
        Vec3::new(2.0, 2.0, 4.0),
    );
    close(mesh(&at(&scene, 3.0).objects[0]).normals[0], Vec3::X);
    // Hermite at a quarter and half of 2 s with tangents 2 and −4 s⁻¹.
    let eye = |secs| at(&scene, secs).camera.eye;
    close(
        eye(1.0),
        Vec3::new(0.5 + 2.0 * 0.125 * 2.0, -(2.0 * 0.125 * 4.0), 0.0),
    );
    let (h10, h01, h11) = (0.140_625 * 2.0, 0.156_25, -0.046_875 * 2.0);
    close(eye(0.5), Vec3::new(h10 * 2.0 + h01, h11 * 4.0, 0.0));
    close(eye(2.0), Vec3::X);
}

#[test]
fn cameras_are_by_name_and_where_they_are_at_a_time() {
    let (mut json, binary) = arm();
    let more = [
        json!({ "name": "tripod", "camera": 1, "translation": [0, 1, 5] }),
        json!({ "camera": 2 }),
        json!({ "camera": 0, "scale": [0, 0, 0] }),
    ];
    json["nodes"].as_array_mut().unwrap().extend(more);
    json["scenes"][0]["nodes"] = json!([0, 3, 4, 5, 6]);
    json["cameras"] = json!([
        { "name": "first", "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } },
        { "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } },
        { "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 1, "znear": 0.1, "zfar": 9 } }]);
    let scene = read(&(json, binary.clone()));
    let names: Vec<_> = scene.cameras().collect();
    assert_eq!(names, ["first", "tripod", "first"]);
    for secs in [0.0, 0.5, 2.0] {
        let camera = scene.camera(0, AnimationTime::At(0, secs)).unwrap();
        assert_eq!(camera, at(&scene, secs).camera);
    }
    let tripod = scene.camera(1, AnimationTime::Rest).unwrap();
    close(tripod.eye, Vec3::new(0.0, -5.0, 1.0));
    let why = |index, time| scene.camera(index, time).unwrap_err().to_string();
    assert!(why(3, AnimationTime::Rest).contains("no camera 3, but 3 cameras"));
    assert!(why(0, AnimationTime::At(9, 0.0)).contains("no animation 9"));
    let blind = why(2, AnimationTime::Rest);
    assert!(blind.contains("camera 2: "), "{blind}");
    // Other files have other hashes, even if only their buffers differ.
    let other = binary
        .iter()
        .map(|byte| byte ^ u8::from(*byte == 63))
        .collect();
    let other = read(&(arm().0, other));
    let same = read(&arm());
    assert_eq!(same.content_hash(), read(&arm()).content_hash());
    assert_ne!(same.content_hash(), other.content_hash());
    assert_ne!(same.content_hash(), scene.content_hash());
}

#[test]
fn updates_of_moving_nodes_are_their_scenes() {
    let scene = read(&arm());
    for from in [AnimationTime::Rest, AnimationTime::At(0, 1.2)] {
        let base = scene.scene(from).unwrap();
        for secs in [0.0, 1.2, 2.2, 5.0] {
            let to = AnimationTime::At(0, secs);
            let update = scene.update(from, to).unwrap().unwrap();
            let wanted = scene.scene(to).unwrap();
            for object in 0..2 {
                let moved = positions(&base, &update, object);
                let wanted = positions(&wanted, &SceneUpdate::default(), object);
                moved.into_iter().zip(wanted).for_each(|(a, b)| close(a, b));
            }
            assert_eq!(update.camera, Some(wanted.camera));
            assert!(update.poses.is_empty() || from != to);
        }
    }
}

/// Scaling needs a new scene, and so does a light that moves.
#[test]
fn what_no_update_can_say_takes_a_scene() {
    let (mut json, binary) = arm();
    let scale = &mut json["animations"][0]["channels"][1]["target"]["path"];
    *scale = json!("scale");
    let scene = read(&(json.clone(), binary.clone()));
    let update = |from, to| {
        scene
            .update(AnimationTime::At(0, from), AnimationTime::At(0, to))
            .unwrap()
    };
    assert_eq!(update(0.5, 1.8), None);
    assert!(update(1.8, 1.9).unwrap().poses.is_empty());
    // A scale of 0 flattens the arm; the scene is still valid.
    close(mesh(&at(&scene, 0.0).objects[0]).normals[0], Vec3::Z);
    let (mut json, binary) = arm();
    json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    json["nodes"][1]["extensions"] = json!({ "KHR_lights_punctual": { "light": 0 } });
    let scene = read(&(json, binary));
    let [a, b] = [1.0, 2.0].map(|secs| AnimationTime::At(0, secs));
    assert_eq!(scene.update(a, b).unwrap(), None);
    assert!(scene.update(b, b).unwrap().is_some());
}

/// A strip of two bones of 1 m, the upper one turned by a right angle in 1 s about the file's z.
fn strip() -> (Value, Vec<u8>) {
    let mut data = Builder::default();
    let corners = data.floats("VEC3", &[[0.0, 0.0, 0.0], [0.2, 1.0, 0.0], [0.0, 2.0, 0.0]]);
    let normals = data.floats("VEC3", &[[1.0, 0.0, 0.0]; 3]);
    let joints = data.bytes(&[[0, 0, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0]]);
    // Weights of 8 bits that do not add up to 1.
    let weights = data.bytes(&[[200, 0, 0, 0], [100, 100, 0, 0], [255, 0, 0, 0]]);
    let mut bind = [[0.0; 16]; 2];
    for matrix in &mut bind {
        for diagonal in [0, 5, 10, 15] {
            matrix[diagonal] = 1.0;
        }
    }
    bind[1][13] = -1.0;
    let bind = data.floats("MAT4", &bind);
    let times = data.scalars(&[0.0, 1.0]);
    let turns = data.floats(
        "VEC4",
        &[
            [0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2],
        ],
    );
    data.finish(json!({
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [
            { "name": "strip", "mesh": 0, "skin": 0, "translation": [5, 5, 5] },
            { "name": "lower", "children": [2] },
            { "name": "upper", "translation": [0, 1, 0] }
        ],
        "skins": [{ "joints": [1, 2], "inverseBindMatrices": bind }],
        "meshes": [{ "primitives": [{ "attributes": {
            "POSITION": corners, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights } }] }],
        "animations": [{
            "channels": [{ "sampler": 0, "target": { "node": 2, "path": "rotation" } }],
            "samplers": [{ "input": times, "output": turns }] }]
    }))
}

#[test]
fn skins_follow_their_joints() {
    let scene = read(&strip());
    let rest = mesh(&scene.rest().objects[0]);
    // Positioned by the joints, not by the node.
    close(rest.center + rest.positions[2], Vec3::new(0.0, 0.0, 2.0));
    let bent = at(&scene, 1.0);
    let bent = mesh(&bent.objects[0]);
    let place = |vertex: usize| bent.center + bent.positions[vertex];
    close(place(0), Vec3::ZERO);
    // The mean of the positions by the lower bone, (0.2, 1), and by the upper one, (0, 1.2).
    close(place(1), Vec3::new(0.1, 0.0, 1.1));
    close(place(2), Vec3::new(-1.0, 0.0, 1.0));
    close(bent.normals[0], Vec3::X);
    close(
        bent.normals[1],
        Vec3::new(FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2),
    );
    close(bent.normals[2], Vec3::Z);
    let [a, b] = [0.0, 1.0].map(|secs| AnimationTime::At(0, secs));
    assert_eq!(scene.update(a, b).unwrap(), None);
    assert!(
        scene
            .update(AnimationTime::Rest, a)
            .unwrap()
            .unwrap()
            .poses
            .is_empty()
    );
}

#[test]
fn joints_and_weights_of_bytes_and_of_words_are_one() {
    let joints = [0u16, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0];
    let weights = [51_400u16, 0, 0, 0, 25_700, 25_700, 0, 0, 65_535, 0, 0, 0];
    let (mut json, mut binary) = strip();
    for (accessor, values) in [(2, joints), (3, weights)] {
        let bytes: Vec<u8> = values.into_iter().flat_map(u16::to_le_bytes).collect();
        let views = json["bufferViews"].as_array_mut().unwrap();
        views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len() }));
        let view = views.len() - 1;
        json["accessors"][accessor]["bufferView"] = json!(view);
        json["accessors"][accessor]["componentType"] = json!(5123);
        binary.extend(bytes);
    }
    json["buffers"][0]["byteLength"] = json!(binary.len());
    let [words, bytes] = [(json, binary), strip()].map(|file| at(&read(&file), 0.7));
    let [words, bytes] = [&words, &bytes].map(|scene| &mesh(&scene.objects[0]).positions);
    words.iter().zip(bytes).for_each(|(a, b)| close(*a, *b));
}

/// A triangle whose corners rise by 3 m and turn their normals by half a right angle.
fn morphed() -> (Value, Vec<u8>) {
    let mut data = Builder::default();
    let corners = data.floats("VEC3", &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let normals = data.floats("VEC3", &[[0.0, 0.0, 1.0]; 3]);
    let rise = data.floats("VEC3", &[[0.0, 3.0, 0.0]; 3]);
    let turn = data.floats("VEC3", &[[1.0, 0.0, 0.0]; 3]);
    let times = data.scalars(&[0.0, 4.0]);
    let weights = data.scalars(&[0.0, 0.0, 1.0, 0.5]);
    data.finish(json!({
        "scenes": [{ "nodes": [0, 1] }],
        "nodes": [{ "mesh": 0 }, { "mesh": 0, "weights": [0.0, 1.0] }],
        "meshes": [{ "weights": [1.0, 0.0], "primitives": [{
            "attributes": { "POSITION": corners, "NORMAL": normals },
            "targets": [{ "POSITION": rise }, { "NORMAL": turn }] }] }],
        "animations": [{
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "weights" } }],
            "samplers": [{ "input": times, "output": weights }] }]
    }))
}

#[test]
fn morph_targets_add_up_by_their_weights() {
    let scene = read(&morphed());
    let rest = scene.rest();
    // With the mesh's weights, and with the node's.
    close(
        mesh(&rest.objects[0]).positions[0],
        Vec3::new(0.0, 0.0, 3.0),
    );
    close(mesh(&rest.objects[1]).positions[0], Vec3::ZERO);
    close(
        mesh(&rest.objects[1]).normals[0],
        Vec3::new(1.0, -1.0, 0.0).normalize(),
    );
    let later = at(&scene, 2.0);
    let first = mesh(&later.objects[0]);
    close(first.positions[1], Vec3::new(1.0, 0.0, 1.5));
    close(first.normals[1], Vec3::new(0.25, -1.0, 0.0).normalize());
    let [a, b] = [0.0, 1.0].map(|secs| AnimationTime::At(0, secs));
    assert_eq!(scene.update(a, b).unwrap(), None);
}

#[test]
fn animations_are_found_by_name_and_by_number() {
    let scene = read(&arm());
    assert_eq!(scene.find_animation("wave").unwrap(), 0);
    assert_eq!(scene.find_animation("0").unwrap(), 0);
    let why = scene.find_animation("1").unwrap_err().to_string();
    assert!(
        why.contains("it has no animation `1`, but 0 `wave`"),
        "{why}"
    );
    for (time, sentence) in [
        (
            AnimationTime::At(1, 0.0),
            "it has no animation 1, but 1 animations",
        ),
        (
            AnimationTime::At(0, f64::NAN),
            "the time is NaN s: it must be finite",
        ),
    ] {
        let why = scene.scene(time).unwrap_err().to_string();
        assert!(why.contains(sentence), "{why}");
    }
    assert_eq!(scene.scene(AnimationTime::Rest).unwrap(), **scene.rest());
    assert_eq!(mesh(&scene.rest().objects[0]).rotation, Quat::IDENTITY);
}

/// Sets the first number of an accessor.
fn spoil_number(accessor: usize, number: f32) -> impl Fn(&mut Value, &mut Vec<u8>) {
    move |json, binary| {
        let view = json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        let at = json["bufferViews"][view]["byteOffset"].as_u64().unwrap() as usize;
        binary[at..at + 4].copy_from_slice(&number.to_le_bytes());
    }
}

#[test]
fn each_fault_of_an_animation_is_a_sentence_with_its_place() {
    type Spoil<'a> = &'a dyn Fn(&mut Value, &mut Vec<u8>);
    let cases: [(Spoil<'_>, &str); 11] = [
        (
            &spoil_number(2, f32::NAN),
            "animation 0 `wave`, channel 0: key frame 0 is at NaN s",
        ),
        (
            &spoil_number(2, -0.5),
            "channel 0: key frame 0 is at -0.5 s: it must be at 0 or later",
        ),
        (
            &spoil_number(2, 3.0),
            "channel 0: key frame 1 is at 3 s, but the one before is at 3 s: times must grow",
        ),
        (
            &spoil_number(5, f32::INFINITY),
            "channel 1: key frame 0 has inf: it must be finite",
        ),
        (
            &|json, _| json["accessors"][5]["count"] = json!(2),
            "channel 1 has 3 key frames and 6 numbers of them: it must have 9",
        ),
        (
            &|json, binary| {
                spoil_number(3, 0.0)(json, binary);
                let at = json["bufferViews"][3]["byteOffset"].as_u64().unwrap() as usize;
                binary[at..at + 16].fill(0);
            },
            "channel 0: key frame 0 is a rotation of length 0",
        ),
        (
            &|json, _| json["animations"][0]["channels"][0]["sampler"] = json!(8),
            "channel 0: sampler 8 does not exist",
        ),
        (
            &|json, _| json["animations"][0]["channels"][1]["target"]["node"] = json!(77),
            "channel 1: node 77 does not exist",
        ),
        (
            &|json, _| json["animations"][0]["channels"][1]["target"]["path"] = json!("weights"),
            "channel 1 moves weights of node 0, which has no morph targets",
        ),
        (
            &|json, _| json["animations"][0]["channels"][2]["target"]["node"] = json!(0),
            "channel 2 moves node 0's Translation a second time",
        ),
        (
            &|json, _| {
                json["nodes"][3]["matrix"] =
                    json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
            },
            "channel 2 moves node 3, which has a matrix",
        ),
    ];
    for (spoil, sentence) in cases {
        refuses(arm(), spoil, sentence);
    }
}

#[test]
fn each_fault_of_a_deformed_mesh_is_a_sentence_with_its_place() {
    type Spoil<'a> = &'a dyn Fn(&mut Value, &mut Vec<u8>);
    let weight = |number: f32| {
        move |json: &mut Value, binary: &mut Vec<u8>| {
            json["accessors"][3] =
                json!({ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC4" });
            json["bufferViews"][0]["byteLength"] = json!(48);
            binary[0..4].copy_from_slice(&number.to_le_bytes());
            binary[12..16].fill(0);
        }
    };
    let cases: [(Spoil<'_>, &str); 9] = [
        (
            &weight(f32::NAN),
            "mesh 0, primitive 0: vertex 0 follows a joint by NaN: it must be at least 0",
        ),
        (&weight(-1.0), "vertex 0 follows a joint by -1"),
        (&weight(0.0), "vertex 0 follows none of its joints"),
        (
            &|json, _| json["skins"][0]["joints"] = json!([1]),
            "vertex 1 follows joint 1, but its skin has 1",
        ),
        (
            &|json, _| json["skins"][0]["joints"] = json!([1, 9]),
            "skin 0: its joint, node 9, is not in the scene",
        ),
        (
            &|json, _| json["nodes"][0]["skin"] = json!(3),
            "skin 3 does not exist",
        ),
        (
            &|json, _| json["accessors"][4]["count"] = json!(1),
            "skin 0 has 2 joints, but 1 inverse bind matrices",
        ),
        (
            &spoil_number(4, f32::NAN),
            "skin 0: inverse bind matrix 0 has NaN",
        ),
        (
            &|json, _| {
                let attributes = &mut json["meshes"][0]["primitives"][0]["attributes"];
                attributes.as_object_mut().unwrap().remove("WEIGHTS_0");
            },
            "it must have JOINTS_0 and WEIGHTS_0",
        ),
    ];
    for (spoil, sentence) in cases {
        refuses(strip(), spoil, sentence);
    }
    let cases: [(Spoil<'_>, &str); 4] = [
        (
            &|json, _| json["nodes"][1]["weights"] = json!([1.0]),
            "node 1 has 1 weights, but its mesh has 2 morph targets",
        ),
        (
            &|json, _| json["accessors"][2]["count"] = json!(2),
            "morph target 0 has 2 displacements of 3 vertices",
        ),
        (&spoil_number(2, f32::NAN), "vertex 0 of its mesh is ["),
        (
            &|json, _| {
                let corners = json["meshes"][0]["primitives"][0]["attributes"].clone();
                let primitives = json["meshes"][0]["primitives"].as_array_mut().unwrap();
                primitives.push(json!({ "attributes": corners }));
            },
            "mesh 0 has primitives of 2 and of 0 morph targets",
        ),
    ];
    for (spoil, sentence) in cases {
        refuses(morphed(), spoil, sentence);
    }
}

fn refuses(
    (mut json, mut binary): (Value, Vec<u8>),
    spoil: &dyn Fn(&mut Value, &mut Vec<u8>),
    sentence: &str,
) {
    spoil(&mut json, &mut binary);
    let why = match AnimatedScene::from_gltf(&glb(&json, &binary)) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("`{sentence}` was expected"),
    };
    assert!(why.contains(sentence), "`{sentence}` is not in `{why}`");
}
