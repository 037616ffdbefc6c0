//! Frames that are reprojected to another view, and averaged over time, against traced ones.

use std::path::Path;

use carom_tracer::compiled::Primitive;
use carom_tracer::film::trace_image;
use carom_tracer::glam::{Quat, Vec3};
use carom_tracer::metrics::rel_mse;
use carom_tracer::reproject::View;
use carom_tracer::reproject::temporal_accumulation::TemporalAccumulation;
use carom_tracer::scalar::{camera_ray, intersect};
use carom_tracer::tonemap::srgb8;
use carom_tracer::{
    Camera, CompiledScene, CpuTracer, ImageSize, ObjectPose, RadianceImage, RenderSettings, Scene,
    SceneUpdate,
};

const SIZE: ImageSize = ImageSize::new(192, 108);
/// Of frames that are averaged.
const FRAME_SIZE: ImageSize = ImageSize::new(128, 72);

fn pool() -> CompiledScene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/pool.json");
    CompiledScene::new(&Scene::load(path).unwrap()).unwrap()
}

fn turned(scene: &CompiledScene, angle_rad: f32) -> Camera {
    let mut camera = scene.camera;
    camera.eye = Quat::from_rotation_z(angle_rad) * (camera.eye - camera.target) + camera.target;
    camera
}

fn picture(scene: &CompiledScene) -> RadianceImage {
    let settings = RenderSettings {
        samples: 64,
        ..RenderSettings::default()
    };
    let film = trace_image(&CpuTracer::new().unwrap(), scene, SIZE, settings);
    film.unwrap().image()
}

/// The object and centre of the first ball.
fn first_ball(scene: &CompiledScene) -> (u32, Vec3) {
    let is_first = |primitive: &Primitive| *primitive == Primitive::Sphere(0);
    let object = scene.primitives.iter().position(is_first).unwrap();
    (object as u32, Vec3::from(scene.spheres[0].center))
}

/// What rays through the middles of pixels meet first.
fn first_hits(scene: &CompiledScene, size: ImageSize) -> Vec<Option<Primitive>> {
    let frame = scene.camera_frame(size);
    let middles = (0..size.height)
        .flat_map(|y| (0..size.width).map(move |x| [x, y].map(|at| f64::from(at) + 0.5)));
    let hits = middles.map(|film| intersect(scene, &camera_ray(&frame, film, [0.5; 2])));
    hits.map(|hit| hit.map(|hit| hit.primitive)).collect()
}

#[test]
fn a_view_that_stays_shows_the_same_picture() {
    let view = View::new(&pool(), SIZE);
    let pixels: Vec<[u8; 3]> = (0..SIZE.pixels())
        .map(|i| [i as u8, (i / 7) as u8, (i / 31) as u8])
        .collect();
    let moved = view.reproject(&pixels, &view);
    assert_eq!((moved.pixels, moved.guessed), (pixels, 0));
}

#[test]
fn reprojection_to_a_turned_camera_is_close() {
    let mut scene = pool();
    let before = picture(&scene);
    let from = View::new(&scene, SIZE);
    let camera = turned(&scene, 0.03);
    scene
        .apply(&SceneUpdate {
            camera: Some(camera),
            poses: Vec::new(),
            ..SceneUpdate::default()
        })
        .unwrap();
    let truth = picture(&scene);
    let moved = from.reproject(&before.pixels, &View::new(&scene, SIZE));
    let stale = rel_mse(&before, &truth).unwrap();
    let pixels = moved.pixels;
    let error = rel_mse(&RadianceImage { size: SIZE, pixels }, &truth).unwrap();
    assert!(
        error < 0.15 * stale,
        "{error} against {stale} of a stale one"
    );
    assert!(moved.guessed * 20 < SIZE.pixels(), "{}", moved.guessed);
}

#[test]
fn rolled_ball_is_reprojected_to_its_place() {
    let mut scene = pool();
    let (object, center) = first_ball(&scene);
    let before = picture(&scene);
    let from = View::new(&scene, SIZE);
    scene
        .apply(&SceneUpdate {
            camera: None,
            poses: vec![ObjectPose {
                object,
                position: center + Vec3::new(0.02, 0.04, 0.0),
                rotation: Quat::IDENTITY,
                visible: true,
            }],
            ..SceneUpdate::default()
        })
        .unwrap();
    let truth = picture(&scene);
    let to = View::new(&scene, SIZE);
    let moved = from.reproject(&before.pixels, &to).pixels;
    let hits = first_hits(&scene, SIZE);
    let on_ball = |index: &usize| hits[*index] == Some(Primitive::Sphere(0));
    let error = |pixels: &[[f32; 3]]| -> f32 {
        let green = |index: usize| (pixels[index][1] - truth.pixels[index][1]).abs();
        (0..SIZE.pixels()).filter(on_ball).map(green).sum()
    };
    assert!(error(&moved) < 0.3 * error(&before.pixels));
}

#[test]
fn what_was_not_in_the_picture_has_the_mean_of_its_primitive() {
    let mut scene = pool();
    let before = picture(&scene);
    let from = View::new(&scene, SIZE);
    let mut camera = scene.camera;
    camera.eye = camera.target + 0.3 * (camera.eye - camera.target);
    camera.target -= 0.5 * (camera.eye - camera.target).with_z(0.0);
    scene
        .apply(&SceneUpdate {
            camera: Some(camera),
            ..SceneUpdate::default()
        })
        .unwrap();
    let to = View::new(&scene, SIZE);
    // From there to here, so that most of the picture was outside of it.
    let near = picture(&scene);
    let moved = to.reproject(&near.pixels, &from);
    assert!(2 * moved.guessed > SIZE.pixels(), "{}", moved.guessed);
    let of = |pixels: Vec<[f32; 3]>| RadianceImage { size: SIZE, pixels };
    let error = rel_mse(&of(moved.pixels), &before).unwrap();
    let stale = rel_mse(&near, &before).unwrap();
    assert!(
        error < 0.5 * stale,
        "{error} against {stale} of a stale one"
    );
}

fn frame(scene: &CompiledScene, samples: u32, seed: u32) -> Vec<[u8; 4]> {
    let settings = RenderSettings {
        samples,
        seed,
        denoise: samples < 64,
        ..RenderSettings::default()
    };
    let film = trace_image(&CpuTracer::new().unwrap(), scene, FRAME_SIZE, settings).unwrap();
    let level = |light: &[f32; 3]| {
        let [r, g, b] = srgb8(*light, 1.0);
        [r, g, b, 255]
    };
    film.image().pixels.iter().map(level).collect()
}

/// Mean difference of pixels' levels.
fn difference(a: &[[u8; 4]], b: &[[u8; 4]]) -> f64 {
    let of_pixel = |(a, b): (&[u8; 4], &[u8; 4])| -> f64 {
        let channels = a.iter().zip(b).take(3);
        channels.map(|(a, b)| f64::from(a.abs_diff(*b))).sum()
    };
    a.iter().zip(b).map(of_pixel).sum::<f64>() / (3 * a.len()) as f64
}

/// Frames of a scene after each of some updates, by themselves and accumulated; of the last one.
fn last_frames(
    samples: u32,
    updates: impl Iterator<Item = SceneUpdate>,
) -> (CompiledScene, [Vec<[u8; 4]>; 2]) {
    let mut scene = pool();
    let mut accumulation = TemporalAccumulation::default();
    let (mut before, mut last) = (None, [Vec::new(), Vec::new()]);
    for (seed, update) in (1..).zip(updates) {
        scene.apply(&update).unwrap();
        let single = frame(&scene, samples, seed);
        let (now, mut accumulated) = (View::new(&scene, FRAME_SIZE), single.clone());
        match &before {
            None => accumulation.begin(&now, &single, 1.0),
            Some(before) => accumulation.accumulate(before, &now, &mut accumulated),
        }
        before = Some(now);
        last = [single, accumulated];
    }
    (scene, last)
}

/// The errors of [`last_frames`] of single samples.
fn last_errors(updates: impl Iterator<Item = SceneUpdate>) -> [f64; 2] {
    let (scene, frames) = last_frames(1, updates);
    let truth = frame(&scene, 256, 0);
    frames.map(|frame| difference(&frame, &truth))
}

#[test]
fn a_still_view_becomes_the_mean_of_its_frames() {
    let updates = std::iter::repeat_n(SceneUpdate::default(), 8);
    let [single, accumulated] = last_errors(updates);
    assert!(accumulated < 0.7 * single, "{accumulated} of {single}");
}

#[test]
fn a_turning_view_is_nearer_to_the_truth_than_its_single_frames() {
    let mut camera = pool().camera;
    let updates = (0..8).map(|_| {
        let turn = Quat::from_rotation_z(1_f32.to_radians());
        camera.eye = camera.target + turn * (camera.eye - camera.target);
        SceneUpdate {
            camera: Some(camera),
            ..SceneUpdate::default()
        }
    });
    let [single, accumulated] = last_errors(updates);
    assert!(accumulated < 0.85 * single, "{accumulated} of {single}");
}

#[test]
fn balls_at_8_m_s_leave_no_ghosts() {
    let (object, center) = first_ball(&pool());
    let updates = (0..6).map(|step| SceneUpdate {
        poses: vec![ObjectPose {
            object,
            position: center + Vec3::new(0.0, 8.0 / 60.0 * step as f32 - 0.4, 0.0),
            rotation: Quat::IDENTITY,
            visible: true,
        }],
        ..SceneUpdate::default()
    });
    // Without noise, so that whatever differs is of earlier frames. Rims hold some of what was behind them.
    let (scene, [single, accumulated]) = last_frames(256, updates);
    let hits = first_hits(&scene, FRAME_SIZE);
    let width = FRAME_SIZE.width as usize;
    let beside = [1, width - 1, width, width + 1];
    let is_inner = |at: &usize| {
        let neighbours = beside
            .iter()
            .flat_map(|by| [at.checked_sub(*by), at.checked_add(*by)]);
        neighbours
            .flatten()
            .all(|by| hits.get(by).is_none_or(|hit| *hit == hits[*at]))
    };
    let largest = |(a, b): (&[u8; 4], &[u8; 4])| {
        let channels = a.iter().zip(b);
        channels.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
    };
    let differences: Vec<u8> = single.iter().zip(&accumulated).map(largest).collect();
    let is_ghost = |at: &usize| differences[*at] > 8 && is_inner(at);
    let ghosts = (0..FRAME_SIZE.pixels()).filter(is_ghost).count();
    // Three times as many without the clip.
    assert!(ghosts * 250 < FRAME_SIZE.pixels(), "{ghosts} pixels");
}

#[test]
fn a_frame_of_nothing_before_is_left_as_it_is() {
    let mut scene = pool();
    let before = View::new(&scene, FRAME_SIZE);
    let mut camera = scene.camera;
    // Turned round.
    camera.target = camera.eye + (camera.eye - camera.target);
    let update = SceneUpdate {
        camera: Some(camera),
        ..SceneUpdate::default()
    };
    scene.apply(&update).unwrap();
    let mut accumulation = TemporalAccumulation::default();
    accumulation.begin(&before, &vec![[9; 4]; FRAME_SIZE.pixels()], 4.0);
    let frame: Vec<_> = (0..FRAME_SIZE.pixels())
        .map(|i| [i as u8, 7, 200, 255])
        .collect();
    let mut accumulated = frame.clone();
    accumulation.accumulate(&before, &View::new(&scene, FRAME_SIZE), &mut accumulated);
    assert_eq!(accumulated, frame);
}

#[test]
fn views_of_one_pixel_and_of_other_sizes_are_accumulated() {
    let scene = pool();
    let mut accumulation = TemporalAccumulation::default();
    let mut before = View::new(&scene, ImageSize::new(64, 36));
    accumulation.begin(&before, &vec![[90, 90, 90, 255]; 64 * 36], 2.0);
    for size in [(31, 17), (1, 1), (2, 5), (1, 9), (9, 1), (64, 36)] {
        let size = ImageSize::new(size.0, size.1);
        let now = View::new(&scene, size);
        let mut frame = vec![[90, 90, 90, 255]; size.pixels()];
        accumulation.accumulate(&before, &now, &mut frame);
        assert!(frame.iter().all(|pixel| *pixel == [90, 90, 90, 255]));
        before = now;
    }
}
