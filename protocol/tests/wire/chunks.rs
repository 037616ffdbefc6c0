//! Scenes in chunks: a node gets what it lacks, once, and believes no manifest.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use carom_protocol::codec::{decode_to_client, decode_to_node, encode_to_client, encode_to_node};
use carom_protocol::limits::{
    CHUNK_BYTES_MAX, CHUNKS_MAX, SCENE_BYTES_MAX, SCENE_MESSAGE_BYTES_MAX,
};
use carom_protocol::message::VERSION;
use carom_protocol::{
    Channel, ChunkKey, ChunkStore, ClientEvent, ClientSession, EncodedScene, Error, NodeEvent,
    NodeSession, Packet, SceneAssembler, SceneHash, SceneProgress, SceneStatus, ToClient, ToNode,
};
use carom_tracer::{Mesh, Scene};
use glam::Vec3;

use crate::any;

/// Chunks in memory.
#[derive(Default)]
struct Memory(Mutex<HashMap<ChunkKey, Vec<u8>>>);

impl ChunkStore for Memory {
    fn read(&self, chunk: &ChunkKey) -> Option<Vec<u8>> {
        self.0.lock().unwrap().get(chunk).cloned()
    }

    fn write(&self, chunk: &ChunkKey, bytes: &[u8]) {
        let before = self.0.lock().unwrap().insert(*chunk, bytes.to_vec());
        assert!(before.is_none(), "a chunk came twice");
    }
}

/// A client and a node whose scenes are put together as a transport does it.
struct Connection {
    client: ClientSession,
    node: NodeSession,
    assembler: SceneAssembler,
    /// Bytes of packets to the node.
    sent: usize,
    /// Packets to the node that go before the connection breaks.
    packets_left: usize,
    events: Vec<ClientEvent>,
    scenes: Vec<Arc<Scene>>,
}

impl Connection {
    fn new(store: Option<Arc<dyn ChunkStore>>) -> Self {
        Self {
            client: ClientSession::new(),
            node: NodeSession::new(any::node_info("near")),
            assembler: SceneAssembler::new(store, SCENE_BYTES_MAX),
            sent: 0,
            packets_left: usize::MAX,
            events: Vec::new(),
            scenes: Vec::new(),
        }
    }

    /// Sends a scene, and what it takes.
    fn send(&mut self, scene: &Arc<EncodedScene>) -> SceneStatus {
        let status = self.client.set_scene(scene).unwrap();
        self.talk();
        status
    }

    fn talk(&mut self) {
        while self.packets_left > 0 {
            let mut is_idle = true;
            if let Some(packet) = self.client.poll_transmit() {
                self.packets_left -= 1;
                self.sent += packet.bytes.len();
                self.hear(packet);
                is_idle = false;
            }
            while let Some(packet) = self.node.poll_transmit() {
                self.events.extend(self.client.handle(packet).unwrap());
                is_idle = false;
            }
            if is_idle {
                return;
            }
        }
    }

    fn hear(&mut self, packet: Packet) {
        let event = match packet.bytes[0] {
            1 | 7..=9 => {
                let progress = self.assembler.handle(&packet.bytes);
                self.node.handle_scene(progress).unwrap()
            }
            _ => self.node.handle(packet).unwrap(),
        };
        if let Some(NodeEvent::Scene { scene, .. }) = event {
            self.scenes.push(scene);
        }
    }

    fn is_ready(&self, scene: &EncodedScene) -> bool {
        self.events.contains(&ClientEvent::SceneReady(scene.hash()))
    }
}

/// Two meshes that together have some 2 MB; `seed` is the second one's.
fn scene(seed: u32) -> Scene {
    let mesh = |seed: u32| {
        let corner = |index: u32| {
            let hash = (index ^ seed << 20).wrapping_mul(2_654_435_761);
            Vec3::new(
                index as f32,
                (hash >> 8) as f32 * 1e-4,
                (hash & 0xff) as f32,
            )
        };
        let triangle = |index: u32| [index, index + 1, index + 2];
        let corners = (0..60_002).map(corner).collect();
        Mesh::new(corners, (0..60_000).map(triangle).collect())
    };
    let mut scene = any::balls(3);
    for seed in [1, seed] {
        scene.add(mesh(seed), carom_tracer::Material::grey(0.5));
    }
    scene
}

fn encoded(scene: &Scene) -> Arc<EncodedScene> {
    EncodedScene::new(scene).unwrap()
}

/// What a list of its chunks, and the headers of messages, may add to a scene.
const OVERHEAD: usize = 64 << 10;

#[test]
fn a_long_scene_arrives_as_it_was_and_a_short_one_in_one_message() {
    let (long, short) = (scene(2), any::balls(9));
    let mut connection = Connection::new(None);
    connection.talk();
    connection.sent = 0;
    assert_eq!(connection.send(&encoded(&short)), SceneStatus::Pending);
    let message = encoded(&short).bytes() + 33;
    assert!(message < SCENE_MESSAGE_BYTES_MAX && connection.sent == message);
    assert_eq!(connection.send(&encoded(&long)), SceneStatus::Transferring);
    let [first, second] = &connection.scenes[..] else {
        panic!("{} scenes", connection.scenes.len());
    };
    assert!(**first == short && **second == long);
    let bytes = encoded(&long).bytes();
    assert!(bytes > 2_000_000);
    assert!(connection.sent - message < bytes + OVERHEAD);
    // A node that keeps nothing still has it: nothing is sent again.
    assert_eq!(connection.send(&encoded(&long)), SceneStatus::Ready);
}

#[test]
fn progress_is_told_in_bytes_and_rises_to_all() {
    let long = encoded(&scene(2));
    let mut connection = Connection::new(None);
    connection.send(&long);
    let progress = connection.events.iter().filter_map(|event| match event {
        ClientEvent::SceneComing { hash, bytes, of } if *hash == long.hash() => Some((*bytes, *of)),
        _ => None,
    });
    let progress: Vec<(u64, u64)> = progress.collect();
    assert!(progress.len() > 4, "{progress:?}");
    assert_eq!(progress[0], (0, long.bytes() as u64));
    assert!(progress.is_sorted_by(|before, after| before.0 < after.0 && before.1 == after.1));
    let (bytes, of) = progress[progress.len() - 1];
    assert_eq!(bytes, of);
    assert!(connection.is_ready(&long));
}

#[test]
fn of_a_changed_scene_only_the_change_is_sent() {
    let (before, mut after) = (scene(2), scene(3));
    let store: Arc<Memory> = Arc::default();
    let mut connection = Connection::new(Some(store));
    connection.send(&encoded(&before));
    connection.sent = 0;
    let after_bytes = encoded(&after).bytes();
    connection.send(&encoded(&after));
    assert!(connection.scenes[1].as_ref() == &after);
    // Half of it, and a chunk at either side of the mesh.
    let most = after_bytes / 2 + 2 * CHUNK_BYTES_MAX + OVERHEAD;
    assert!(connection.sent < most, "{} of {most}", connection.sent);
    // A ball more, before all that is long: one chunk.
    connection.sent = 0;
    let ball = after.objects[0].clone();
    after.objects.insert(0, ball);
    connection.send(&encoded(&after));
    assert!(connection.scenes[2].as_ref() == &after);
    let most = CHUNK_BYTES_MAX + OVERHEAD;
    assert!(connection.sent < most, "{} of {most}", connection.sent);
}

#[test]
fn a_broken_transfer_goes_on_where_it_was() {
    let long = encoded(&scene(2));
    let store: Arc<Memory> = Arc::default();
    let mut sent = 0;
    for packets in [6, 9, usize::MAX] {
        let mut connection = Connection::new(Some(Arc::<Memory>::clone(&store)));
        connection.packets_left = packets;
        connection.send(&long);
        sent += connection.sent;
        assert_eq!(connection.is_ready(&long), packets == usize::MAX);
    }
    let most = long.bytes() + long.bytes() / 10;
    assert!(sent < most, "{sent} of {most}");
}

#[test]
fn another_node_with_the_same_store_gets_no_chunk() {
    let long = encoded(&scene(2));
    let store: Arc<Memory> = Arc::default();
    for most in [long.bytes() + OVERHEAD, 4096] {
        let mut connection = Connection::new(Some(Arc::<Memory>::clone(&store)));
        connection.send(&long);
        assert!(connection.is_ready(&long));
        assert!(connection.sent < most, "{} of {most}", connection.sent);
    }
}

#[test]
fn a_chunk_that_is_there_several_times_is_sent_once() {
    // A texture's bytes are not looked at here: zeros, which are all one chunk.
    let zeros = vec![0; CHUNK_BYTES_MAX];
    let other = vec![1; 1000];
    let chunks = [&zeros, &other, &zeros, &zeros].map(|bytes| ChunkKey::of(bytes));
    let whole = [&zeros[..], &other, &zeros, &zeros].concat();
    let hash = SceneHash(ChunkKey::of(&whole).hash);
    let mut assembler = SceneAssembler::default();
    let mut handle = |message: ToNode| assembler.handle(&encode_to_node(&message).unwrap());
    let chunks = chunks.to_vec();
    let wanted = handle(ToNode::Manifest { hash, chunks }).unwrap();
    let SceneProgress::Wanted {
        chunks, bytes, of, ..
    } = wanted
    else {
        panic!("{wanted:?}");
    };
    assert_eq!((chunks, bytes, of), (vec![0, 1], 0, whole.len()));
    let come = handle(ToNode::Chunk { bytes: zeros }).unwrap();
    let SceneProgress::Coming { bytes, .. } = come else {
        panic!("{come:?}");
    };
    assert_eq!(bytes, whole.len() - 1000);
    handle(ToNode::Chunk { bytes: other }).unwrap();
    // It hashes to its hash, and is no scene.
    let end = handle(ToNode::ChunksSent(hash)).unwrap_err().to_string();
    assert!(end.contains("malformed scene"), "{end}");
}

/// What a node says to packets of which the last breaks a rule.
fn refusal(messages: impl IntoIterator<Item = ToNode>) -> String {
    let mut node = NodeSession::new(any::node_info("near"));
    let hello = ToNode::Hello { version: VERSION };
    let mut results: Vec<Result<Option<NodeEvent>, Error>> = [hello]
        .into_iter()
        .chain(messages)
        .map(|message| {
            let bytes = postcard(&message);
            node.handle(Packet::new(Channel::Control, bytes))
        })
        .collect();
    let last = results.pop().unwrap().unwrap_err().to_string();
    assert!(results.iter().all(Result::is_ok), "{results:?}");
    let ping = encode_to_node(&ToNode::Ping(1)).unwrap();
    let closed = node.handle(Packet::new(Channel::Control, ping));
    assert!(closed.is_err(), "the session is closed");
    last
}

/// The bytes of a message that breaks rules, too.
fn postcard(message: &ToNode) -> Vec<u8> {
    let varint = |mut number: u64| {
        let mut bytes = Vec::new();
        while number >= 0x80 {
            bytes.push(number as u8 | 0x80);
            number >>= 7;
        }
        bytes.push(number as u8);
        bytes
    };
    match message {
        ToNode::Manifest { hash, chunks } => {
            let key = |key: &ChunkKey| [&key.hash[..], &varint(key.bytes.into())].concat();
            let keys: Vec<u8> = chunks.iter().flat_map(key).collect();
            [&[7], &hash.0[..], &varint(chunks.len() as u64), &keys].concat()
        }
        message => encode_to_node(message).unwrap(),
    }
}

#[test]
fn hostile_manifests_end_the_connection_with_a_sentence() {
    let hash = SceneHash([1; 32]);
    let (one, two) = (vec![1; 1000], vec![2; 1000]);
    let chunk = |bytes: &[u8]| ToNode::Chunk {
        bytes: bytes.to_vec(),
    };
    let manifest = |chunks: &[ChunkKey]| ToNode::Manifest {
        hash,
        chunks: chunks.to_vec(),
    };
    let [key, other] = [&one, &two].map(|bytes| ChunkKey::of(bytes));
    let of_length = |bytes: u32| ChunkKey { bytes, ..key };
    let right = || manifest(&[key, other]);
    let cases: [(Vec<ToNode>, &str); 11] = [
        (vec![manifest(&[of_length(0)])], "a chunk has 0 bytes"),
        (
            vec![manifest(&[of_length(CHUNK_BYTES_MAX as u32 + 1)])],
            "a chunk has 524289 bytes",
        ),
        (
            vec![manifest(&vec![key; CHUNKS_MAX + 1])],
            "4097 chunks: at most 4096",
        ),
        (
            vec![manifest(&vec![of_length(CHUNK_BYTES_MAX as u32); 257])],
            "at most 134217728",
        ),
        (vec![right(), right()], "chunks are being sent"),
        (vec![chunk(&one)], "no chunk is wanted"),
        (vec![right(), chunk(&two)], "hashes to another one"),
        // A length that lies, alone and beside the right one.
        (
            vec![manifest(&[of_length(999)]), chunk(&one)],
            "hashes to another one",
        ),
        (
            vec![manifest(&[key, of_length(999)]), chunk(&one), chunk(&one)],
            "hashes to another one",
        ),
        (
            vec![right(), chunk(&one), ToNode::ChunksSent(hash)],
            "1 chunks are still to come",
        ),
        (
            vec![right(), chunk(&one), chunk(&two), chunk(&one)],
            "no chunk is wanted",
        ),
    ];
    for (messages, sentence) in cases {
        let why = refusal(messages);
        assert!(why.contains(sentence), "{why}");
    }
    let unasked = refusal([right(), ToNode::ChunksSent(SceneHash([2; 32]))]);
    assert!(unasked.contains("no scene's chunks"), "{unasked}");
    // All chunks are right, and another scene's.
    let whole = refusal([right(), chunk(&one), chunk(&two), ToNode::ChunksSent(hash)]);
    assert!(whole.contains("does not hash to its hash"), "{whole}");
}

#[test]
fn a_scene_beyond_a_nodes_memory_is_refused_before_any_chunk() {
    let long = encoded(&scene(2));
    let mut connection = Connection::new(None);
    connection.assembler = SceneAssembler::new(None, 1_000_000);
    connection.send(&long);
    let Some(ClientEvent::SceneRefused { hash, why }) = connection.events.last() else {
        panic!("{:?}", connection.events.last());
    };
    assert_eq!(*hash, long.hash());
    assert!(
        why.contains("may take 1 MB") && why.contains("--scene-memory"),
        "{why}"
    );
    assert!(connection.sent < 4096, "{}", connection.sent);
    // The connection goes on.
    let short = encoded(&any::balls(2));
    connection.send(&short);
    assert!(connection.is_ready(&short));
}

#[test]
fn a_node_gets_no_chunk_twice_whatever_it_asks_for() {
    let long = encoded(&scene(2));
    let hash = long.hash();
    let wanted = |chunks: &[u32]| ToClient::ChunksWanted {
        hash,
        chunks: chunks.to_vec(),
    };
    let after = |answers: &[ToClient]| {
        let mut client = ClientSession::new();
        client.set_scene(&long).unwrap();
        let welcome = ToClient::Welcome {
            version: VERSION,
            node: any::node_info("evil"),
        };
        let answers = [&[welcome], answers].concat();
        let mut heard = Ok(Vec::new());
        for answer in &answers {
            while client.poll_transmit().is_some() {}
            heard = client.handle(control(answer));
        }
        heard.map_err(|why| why.to_string())
    };
    assert_eq!(after(&[wanted(&[0, 2])]), Ok(Vec::new()));
    let count = long.chunks().len() as u32;
    let why = after(&[wanted(&[0, count])]).unwrap_err();
    assert!(why.contains(&format!("chunk {count} of {count}")), "{why}");
    let why = after(&[wanted(&[0]), wanted(&[0])]).unwrap_err();
    assert!(why.contains("was not sent"), "{why}");
    let why = after(&[ToClient::SceneReady(hash)]).unwrap_err();
    assert!(why.contains("was not sent"), "{why}");
    let falling = wanted(&[1, 0]);
    assert!(encode_to_client(&falling).is_err());
    assert!(decode_to_client(&[&[9], &hash.0[..], &[2, 1, 0]].concat()).is_err());
    // More has come than there is.
    let coming = |bytes| ToClient::SceneComing { bytes };
    let most = long.bytes() as u32;
    let (bytes, of) = (most.into(), most.into());
    let all = ClientEvent::SceneComing { hash, bytes, of };
    assert_eq!(after(&[wanted(&[0]), coming(most)]), Ok(vec![all]));
    assert!(after(&[wanted(&[0]), coming(most + 1)]).is_err());
    assert!(after(&[coming(0)]).is_err());
}

fn control(message: &ToClient) -> Packet {
    Packet::new(Channel::Control, encode_to_client(message).unwrap())
}

#[test]
fn other_packets_overtake_chunks() {
    let long = encoded(&scene(2));
    let mut connection = Connection::new(None);
    connection.packets_left = 5;
    connection.send(&long);
    connection.client.ping(3).unwrap();
    let short = encoded(&any::balls(2));
    assert_eq!(
        connection.client.set_scene(&short),
        Ok(SceneStatus::Pending)
    );
    let next = [(); 3].map(|()| connection.client.poll_transmit().unwrap().bytes);
    assert_eq!(decode_to_node(&next[0]), Ok(ToNode::Ping(3)));
    assert!(matches!(decode_to_node(&next[1]), Ok(ToNode::Scene { .. })));
    assert!(matches!(decode_to_node(&next[2]), Ok(ToNode::Chunk { .. })));
}
