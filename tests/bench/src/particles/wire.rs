//! Transfer of particles through a pair of sessions.

use anyhow::Context as _;
use carom_mpm::{Ball, Bodies, Material, Obstacle, Region, Sand, Settings, Simulation, Water};
use carom_protocol::{
    ClientSession, CodedParticles, EncodedScene, FrameId, NodeEvent, NodeInfo, NodeSession,
    PixelFormat, PrecisionRange, RequestId, TraceRequest,
};
use carom_tracer::{
    DeviceInfo, DeviceKind, ImageSize, ParticleCloud, ParticleForm, RenderSettings, Scene,
    SceneUpdate, TileGrid,
};
use cpu_time::ThreadTime;
use glam::{DVec3, Vec3};

use crate::BenchError;
use crate::timing::{median, ms_since};

/// Cost of a request with particles.
struct RequestCost {
    bytes: usize,
    encode_ms: f64,
    decode_ms: f64,
}

pub(super) fn run(particles: u32) -> Result<(), BenchError> {
    println!(
        "{:<22} {:>9} {:>7} {:>8} {:>7} {:>7} {:>9} {:>9}",
        "moves", "particles", "whole B", "Mbit/s", "peak", "B each", "error mm", "CPU ms"
    );
    for (name, material, speed_m_s) in [
        ("sand, collapsing", Material::Sand(Sand::default()), 0.0),
        ("sand, ball at 3 m/s", Material::Sand(Sand::default()), 3.0),
        ("water, dam break", Material::Water(Water::default()), 0.0),
    ] {
        let frames = frames(particles, material, speed_m_s).context("the particles")?;
        let costs = send(&frames)?;
        let count = frames[0].places.len();
        let later = &costs[1..];
        let mbit = |bytes: f64| bytes * 8.0 * FRAMES_PER_SEC * 1e-6;
        let mean = later.iter().map(|cost| cost.bytes as f64).sum::<f64>() / later.len() as f64;
        let peak = later.iter().map(|cost| cost.bytes).max().unwrap_or(0);
        println!(
            "{name:<22} {count:>9} {:>7.2} {:>8.1} {:>7.1} {:>7.2} {:>9.4} {:>4.2}+{:.2}",
            costs[0].bytes as f64 / count as f64,
            mbit(mean),
            mbit(peak as f64),
            mean / count as f64,
            f64::from(frames[0].error_m()) * 1e3,
            median(later.iter().map(|cost| cost.encode_ms)),
            median(later.iter().map(|cost| cost.decode_ms)),
        );
    }
    Ok(())
}

/// Frames of half a second of a heap twice as wide as high, or of a strip that a ball runs through.
fn frames(
    particles: u32,
    material: Material,
    speed_m_s: f64,
) -> Result<Vec<ParticleCloud>, carom_mpm::Error> {
    let settings = Settings::default();
    let spacing_m = settings.cell_size_m / settings.particles_per_edge as f32;
    let volume_m3 = particles as f32 * spacing_m.powi(3);
    let size = match speed_m_s {
        0.0 => Vec3::new(2.0, 2.0, 1.0) * (volume_m3 / 4.0).cbrt(),
        _ => Vec3::new(2.0, 1.0, 0.0) * (volume_m3 / 0.02 / 2.0).sqrt() + 0.02 * Vec3::Z,
    };
    let mut simulation = Simulation::new(settings)?;
    simulation.fill(
        &Region::Cuboid {
            min: Vec3::ZERO,
            max: size,
        },
        material,
        Vec3::ZERO,
    )?;
    let mut bodies = Bodies {
        balls: Vec::new(),
        obstacles: vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)],
    };
    if speed_m_s > 0.0 {
        let start = DVec3::new(-0.03, f64::from(size.y) / 2.0, RADIUS_M);
        let mut ball = Ball::new(start, RADIUS_M, 0.17);
        ball.velocity.x = speed_m_s;
        bodies.balls.push(ball);
    }
    let box_m = 2.0 * size.max_element();
    let mut frames = Vec::new();
    for _ in 0..FRAMES {
        frames.push(cloud(&simulation, size, box_m));
        simulation.step(1.0 / FRAMES_PER_SEC, &mut bodies)?;
    }
    Ok(frames)
}

/// All particles in the order of their ids, in a box around the places that they can reach.
fn cloud(simulation: &Simulation, size: Vec3, box_m: f32) -> ParticleCloud {
    let middle = (size / 2.0).with_z(0.0);
    let mut cloud = ParticleCloud {
        material: carom_tracer::Material::diffuse([0.6, 0.5, 0.35]),
        radius_m: 2e-3,
        form: ParticleForm::Balls,
        min: middle - Vec3::new(box_m / 2.0, box_m / 2.0, 0.0),
        max: middle + Vec3::new(box_m / 2.0, box_m / 2.0, box_m / 2.0),
        places: vec![glam::U16Vec3::ZERO; simulation.len()],
    };
    for particle in simulation.particles() {
        cloud.places[particle.id as usize] = cloud.place(particle.position);
    }
    cloud
}

/// Sends each cloud in a request of its own, and checks that it arrives unchanged.
fn send(frames: &[ParticleCloud]) -> Result<Vec<RequestCost>, BenchError> {
    let scene = Scene::from_json(include_str!("../../../../assets/scenes/pool.json"))?;
    let device = DeviceInfo {
        kind: DeviceKind::Cpu,
        name: "bench".into(),
        width: 1,
        threads: 1,
    };
    let mut client = ClientSession::new();
    let mut node = NodeSession::new(NodeInfo {
        name: "bench".into(),
        instance: 0,
        device,
    });
    let scene = EncodedScene::new(&scene).context("the scene")?;
    let hash = scene.hash();
    client.set_scene(&scene).context("the scene")?;
    while let Some(packet) = client.poll_transmit() {
        node.handle(packet).context("the scene")?;
    }
    while let Some(packet) = node.poll_transmit() {
        client.handle(packet).context("the scene")?;
    }
    let grid = TileGrid::new(ImageSize::new(64, 64), 32);
    let send = |(cloud, id): (&ParticleCloud, u64)| {
        let request = TraceRequest {
            frame: FrameId(id),
            id: RequestId(id),
            scene: hash,
            update: SceneUpdate::default().particles(vec![cloud.clone()]),
            grid,
            tiles: grid.all(),
            settings: RenderSettings::default(),
            format: PixelFormat::LinearF16,
            precision: PrecisionRange::EXACT,
            references: Vec::new(),
            particles: CodedParticles::default(),
        };
        let begun = ThreadTime::now();
        client.cancel_before(FrameId(id)).context("a request")?;
        client.trace(request).context("a request")?;
        let encode_ms = ms_since(begun);
        let mut bytes = 0;
        let begun = ThreadTime::now();
        while let Some(packet) = client.poll_transmit() {
            bytes += packet.bytes.len();
            if let Some(NodeEvent::Trace { request, .. }) =
                node.handle(packet).context("a request")?
            {
                anyhow::ensure!(
                    request.update.particles == [cloud.clone()],
                    "frame {id} changed"
                );
            }
        }
        let decode_ms = ms_since(begun);
        while let Some(packet) = node.poll_transmit() {
            client.handle(packet).context("an answer")?;
        }
        Ok(RequestCost {
            bytes,
            encode_ms,
            decode_ms,
        })
    };
    Ok(frames
        .iter()
        .zip(1..)
        .map(send)
        .collect::<anyhow::Result<_>>()?)
}

const FRAMES_PER_SEC: f64 = 60.0;
/// Half a second.
const FRAMES: u32 = 30;
const RADIUS_M: f64 = 0.028_575;
