//! Time of reprojecting a picture, and of accumulating it, while the camera turns, or while nothing but balls moves.
//!
//! `RAYON_NUM_THREADS=1 cargo run --release -p carom-tracer --example reprojection_speed -- SCENE.json [WIDTHxHEIGHT] [FRAMES]`
//!
//! On one thread the times are processor time.

use std::hint::black_box;
use std::time::{Duration, Instant};

use carom_tracer::compiled::Primitive;
use carom_tracer::reproject::View;
use carom_tracer::reproject::temporal_accumulation::TemporalAccumulation;
use carom_tracer::{CompiledScene, ImageSize, ObjectPose, Scene, SceneUpdate};
use glam::{Quat, Vec3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("which scene file?")?;
    let size: ImageSize = arguments
        .next()
        .map_or(Ok(ImageSize::new(1280, 720)), |text| text.parse())?;
    let frames: u32 = arguments.next().map_or(Ok(20), |text| text.parse())?;
    let scene = CompiledScene::new(&Scene::load(path)?)?;
    for (name, step) in [("camera turns", turn as Step), ("balls move", roll)] {
        let mut scene = scene.clone();
        let (mut from, mut to) = (View::new(&scene, size), View::new(&scene, size));
        let mut memory = Vec::new();
        let pixels = vec![[90_u8, 120, 160, 255]; size.pixels()];
        let (mut accumulation, mut frame) = (TemporalAccumulation::default(), pixels.clone());
        accumulation.begin(&from, &frame, 1.0);
        let [mut views, mut moves, mut blends] = [Duration::ZERO; 3];
        let mut guessed = 0;
        for _ in 0..frames {
            scene.apply(&step(&scene))?;
            let clock = Instant::now();
            to.update(&scene, size);
            views += clock.elapsed();
            let clock = Instant::now();
            let moved = black_box(from.reproject_into(&pixels, &to, memory));
            moves += clock.elapsed();
            guessed += moved.guessed;
            let clock = Instant::now();
            accumulation.accumulate(&from, &to, black_box(&mut frame));
            blends += clock.elapsed();
            std::mem::swap(&mut from, &mut to);
            memory = moved.pixels;
        }
        let pixels = f64::from(frames) * size.pixels() as f64;
        let nanos = |time: Duration| time.as_secs_f64() * 1e9 / pixels;
        println!(
            "{name}: first hits {:.1} ns, reprojection {:.1} ns, accumulation {:.1} ns a pixel, {:.2} % of pixels disoccluded",
            nanos(views),
            nanos(moves),
            nanos(blends),
            100.0 * guessed as f64 / pixels,
        );
    }
    Ok(())
}

type Step = fn(&CompiledScene) -> SceneUpdate;

/// A turn of the camera around its target, as of 60 degrees a second at 60 frames a second.
fn turn(scene: &CompiledScene) -> SceneUpdate {
    let mut camera = scene.camera;
    let turned = Quat::from_rotation_z(1_f32.to_radians()) * (camera.eye - camera.target);
    camera.eye = camera.target + turned;
    SceneUpdate {
        camera: Some(camera),
        ..SceneUpdate::default()
    }
}

/// A step of all balls by a centimetre.
fn roll(scene: &CompiledScene) -> SceneUpdate {
    let pose = |(object, primitive): (usize, &Primitive)| match primitive {
        Primitive::Sphere(index) => Some(ObjectPose {
            object: object as u32,
            position: Vec3::from(scene.spheres[*index as usize].center) + Vec3::new(0.01, 0.0, 0.0),
            rotation: Quat::IDENTITY,
            visible: true,
        }),
        _ => None,
    };
    SceneUpdate {
        poses: scene
            .primitives
            .iter()
            .enumerate()
            .filter_map(pose)
            .collect(),
        ..SceneUpdate::default()
    }
}
