//! Particles through a pair of sessions.

use carom_protocol::codec::{decode_to_node, encode_to_node};
use carom_protocol::limits::TRACE_BYTES_MAX;
use carom_protocol::{
    Channel, ClientSession, CodedParticles, EncodedScene, Error, FrameId, NodeEvent, NodeSession,
    Packet, PixelFormat, PrecisionRange, RequestId, SceneHash, ToNode, TraceRequest,
};
use carom_tracer::glam::{U16Vec3, Vec3};
use carom_tracer::scene::validate::PARTICLES_MAX;
use carom_tracer::{
    ImageSize, Material, ParticleCloud, ParticleForm, RenderSettings, SceneUpdate, TileGrid,
    sampling,
};

use super::any;

fn cloud(count: usize, frame: u32) -> ParticleCloud {
    let place = |index: usize| {
        let random = |seed| sampling::uniforms(index as u32, seed, 0, 0);
        let [x, y, z, _] = random(1);
        let [u, v, w, _] = random(2);
        (60_000.0 * Vec3::new(x, y, z) + 200.0 * frame as f32 * Vec3::new(u, v, w)).as_u16vec3()
    };
    ParticleCloud {
        material: Material::diffuse([0.7, 0.6, 0.4]),
        radius_m: 2e-3,
        form: ParticleForm::Balls,
        min: Vec3::ZERO,
        max: Vec3::splat(0.5),
        places: (0..count).map(place).collect::<Vec<U16Vec3>>(),
    }
}

fn request(id: u64, particles: Vec<ParticleCloud>) -> TraceRequest {
    let grid = TileGrid::new(ImageSize::new(64, 64), 16);
    TraceRequest {
        frame: FrameId(id),
        id: RequestId(id),
        scene: SceneHash::of(&any::balls(2)),
        update: SceneUpdate::default().particles(particles),
        grid,
        tiles: grid.all(),
        settings: RenderSettings::default(),
        format: PixelFormat::LinearF16,
        precision: PrecisionRange::EXACT,
        references: Vec::new(),
        particles: CodedParticles::default(),
    }
}

/// Sessions that have greeted each other, and the scene at the node.
fn pair() -> (ClientSession, NodeSession) {
    let mut client = ClientSession::new();
    let mut node = NodeSession::new(any::node_info("near"));
    let scene = any::balls(2);
    client
        .set_scene(&EncodedScene::new(&scene).unwrap())
        .unwrap();
    while let Some(packet) = client.poll_transmit() {
        node.handle(packet).unwrap();
    }
    while let Some(packet) = node.poll_transmit() {
        client.handle(packet).unwrap();
    }
    (client, node)
}

fn particles(event: Option<NodeEvent>) -> Vec<ParticleCloud> {
    match event {
        Some(NodeEvent::Trace { request, .. }) => {
            assert_eq!(request.particles, CodedParticles::default());
            request.update.particles
        }
        other => panic!("no request: {other:?}"),
    }
}

#[test]
fn a_node_sees_the_particles_of_each_request() {
    let (mut client, mut node) = pair();
    let frames = [
        vec![cloud(3000, 0)],
        vec![cloud(3000, 0)],
        vec![],
        vec![cloud(3000, 1), cloud(10, 1)],
        vec![cloud(3000, 2), cloud(10, 2)],
        vec![cloud(2999, 3)],
    ];
    let mut sizes = Vec::new();
    for (clouds, id) in frames.into_iter().zip(1..) {
        client.trace(request(id, clouds.clone())).unwrap();
        let packet = client.poll_transmit().unwrap();
        sizes.push(packet.bytes.len());
        assert_eq!(particles(node.handle(packet).unwrap()), clouds, "{id}");
    }
    assert!(sizes[1] < sizes[2] + 60, "{sizes:?}");
    assert!(sizes[4] < sizes[3], "{sizes:?}");
}

#[test]
fn a_copy_whose_reference_is_missing_waits_for_its_packet() {
    let (mut client, mut node) = pair();
    let mut send = |id, frame| {
        client.trace(request(id, vec![cloud(100, frame)])).unwrap();
        client.poll_transmit().unwrap()
    };
    let packets = [send(1, 0), send(2, 1), send(3, 2)];
    let copy = |packet: &Packet| Packet::new(Channel::Copy, packet.bytes.clone());
    assert_eq!(node.handle(copy(&packets[1])).unwrap(), None);
    // What is coded by itself can be begun by its copy.
    assert_eq!(
        particles(node.handle(copy(&packets[0])).unwrap()),
        [cloud(100, 0)]
    );
    let [first, second, third] = packets;
    let copied = copy(&third);
    assert_eq!(node.handle(first).unwrap(), None);
    assert_eq!(particles(node.handle(second).unwrap()), [cloud(100, 1)]);
    assert_eq!(particles(node.handle(copied).unwrap()), [cloud(100, 2)]);
    assert_eq!(node.handle(third).unwrap(), None);
}

/// A client that codes against what it has not sent, or sends what no encoder makes, is cut off.
#[test]
fn particles_that_break_the_rules_close_the_session() {
    let changes: [&dyn Fn(&mut CodedParticles); 6] = [
        &|coded| coded.reference = Some(RequestId(1)),
        &|coded| coded.clouds[0].count += 1,
        &|coded| coded.clouds[0].places.clear(),
        &|coded| coded.clouds[0].radius_m = f32::NAN,
        &|coded| coded.clouds[0].max.x = -1.0,
        &|coded| coded.clouds[0].material = Material::grey(2.0),
    ];
    for (number, change) in changes.into_iter().enumerate() {
        let (mut client, mut node) = pair();
        client.trace(request(7, vec![cloud(100, 0)])).unwrap();
        let bytes = client.poll_transmit().unwrap().bytes;
        let Ok(ToNode::Trace(mut sent)) = decode_to_node(&bytes) else {
            panic!("no request");
        };
        change(&mut sent.particles);
        let bytes = encode_to_node(&ToNode::Trace(sent)).unwrap();
        let refused = node.handle(Packet::new(Channel::Control, bytes));
        assert!(
            matches!(refused, Err(Error::Malformed { .. })),
            "{number}: {refused:?}"
        );
    }
}

#[test]
fn too_many_particles_are_not_sent() {
    let (mut client, _) = pair();
    let half = PARTICLES_MAX / 2;
    let clouds = vec![cloud(half, 0), cloud(half + 1, 0)];
    let refused = client.trace(request(1, clouds)).unwrap_err().to_string();
    assert!(refused.contains("65537 particles"), "{refused}");
    assert!(client.poll_transmit().is_none());
    client
        .trace(request(1, vec![cloud(PARTICLES_MAX, 0)]))
        .unwrap();
    assert!(client.poll_transmit().unwrap().bytes.len() <= TRACE_BYTES_MAX);
    let (mut sent, mut node) = (request(2, Vec::new()), pair().1);
    let coded = carom_protocol::CodedCloud {
        material: Material::grey(0.5),
        radius_m: 1e-3,
        form: ParticleForm::Balls,
        min: Vec3::ZERO,
        max: Vec3::ONE,
        count: u32::MAX,
        places: vec![2],
    };
    sent.particles = CodedParticles {
        reference: None,
        clouds: vec![coded; 3],
    };
    let bytes = postcard_bytes(sent);
    assert!(node.handle(Packet::new(Channel::Control, bytes)).is_err());
}

/// Of a message that no sender lets pass.
fn postcard_bytes(request: TraceRequest) -> Vec<u8> {
    postcard::to_stdvec(&ToNode::Trace(Box::new(request))).unwrap()
}
