//! Pictures in the scenes of peers: a node decodes no more of them than it keeps, and opens no file that they name.

use carom_protocol::codec::{decode_to_client, encode_to_node};
use carom_protocol::message::VERSION;
use carom_protocol::{Channel, NodeInfo, NodeSession, Packet, SceneHash, ToClient, ToNode};
use carom_tracer::texture_file::{Texels, encode_png};
use carom_tracer::{DeviceInfo, DeviceKind, EnvironmentMap, ImageSource, ImageTexture, Scene};

fn packet(message: &ToNode) -> Packet {
    Packet::new(
        Channel::Control,
        encode_to_node(message).expect("it is small"),
    )
}

/// What a node says to a scene.
fn answer(scene: Scene) -> ToClient {
    let device = DeviceInfo {
        kind: DeviceKind::Cpu,
        name: String::new(),
        width: 8,
        threads: 1,
    };
    let mut node = NodeSession::new(NodeInfo {
        name: String::new(),
        instance: 0,
        device,
    });
    node.handle(packet(&ToNode::Hello { version: VERSION }))
        .expect("it is welcome");
    while node.poll_transmit().is_some() {}
    let (hash, scene) = (SceneHash::of(&scene), Box::new(scene));
    node.handle(packet(&ToNode::Scene { hash, scene }))
        .expect("the message is right");
    let packet = node.poll_transmit().expect("there is an answer");
    decode_to_client(&packet.bytes).expect("the answer is right")
}

fn refusal(scene: Scene) -> String {
    match answer(scene) {
        ToClient::SceneRefused { why, .. } => why,
        other => panic!("{other:?}"),
    }
}

/// A PNG of one texel whose header tells another size.
fn png(width: u32, height: u32) -> Vec<u8> {
    let texels = vec![[0; 4]];
    let mut file = encode_png(&Texels {
        size: [1, 1],
        texels,
    })
    .expect("its size is right");
    file[16..20].copy_from_slice(&width.to_be_bytes());
    file[20..24].copy_from_slice(&height.to_be_bytes());
    let sum = crc32(&file[12..29]);
    file[29..33].copy_from_slice(&sum.to_be_bytes());
    file
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn textures_that_would_fill_a_node_are_refused_before_they_are_decoded() {
    let mut scene = Scene::new();
    scene.add_texture(ImageTexture::new("large", png(16_384, 8_192)));
    assert!(matches!(answer(scene.clone()), ToClient::SceneReady(_)));
    scene.add_texture(ImageTexture::new("larger", png(16_384, 8_193)));
    let sentence = "bytes once decoded: a node keeps at most 1073741824";
    let why = refusal(scene.clone());
    assert!(why.contains(sentence), "{why}");
    for _ in 0..4 {
        scene.add_texture(ImageTexture::new("larger", png(16_384, 16_384)));
    }
    let why = refusal(scene);
    assert!(
        why.contains("bytes once decoded: at most 4294967296 are allowed"),
        "{why}"
    );
}

#[test]
fn scenes_of_peers_name_no_files() {
    let file = ImageSource::File("/etc/hostname".to_owned());
    let mut scene = Scene::new();
    scene.add_texture(ImageTexture {
        image: file.clone(),
        ..ImageTexture::new("a", Vec::new())
    });
    let sentence = "its file `/etc/hostname` is read only by `Scene::load`";
    assert!(refusal(scene).contains(sentence));
    let mut scene = Scene::new();
    scene.environment_map = Some(EnvironmentMap {
        image: file,
        turn_deg: 0.0,
    });
    assert!(refusal(scene).contains(sentence));
}
