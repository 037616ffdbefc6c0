//! The scalar tracer against the reference in the mean, and the fast tracers against the scalar one
//! sample for sample, on every scene of the laws.
//!
//! Both pictures are of 8 independent batches, which give each pixel's standard error. In every
//! region of 8 × 8 pixels, and over the whole picture, the means differ by less than 4 standard
//! errors of their difference. So many samples are taken that a scalar picture 2 % too bright fails.

use carom_tracer::film::{trace_estimate, trace_image};
use carom_tracer::metrics::{Estimate, compare, region};
use carom_tracer::reference::radiance;
use carom_tracer::regularisation;
use carom_tracer::scalar::camera_ray;
use carom_tracer::{
    CompiledScene, ImageSize, RadianceImage, RenderSettings, ScalarTracer, Scene, Tile, TileGrid,
    Tracer,
};
use glam::DVec3;

use crate::scenes::{LawScene, scenes_of_laws, scenes_of_materials};
use crate::tracers::tracers;

const BATCHES: u32 = 8;
const REGION_EDGE: u16 = 8;
const Z_MAX: f64 = 4.0;

/// The reference's picture of `samples` samples a batch and pixel.
fn reference(scene: &CompiledScene, size: ImageSize, max_depth: u32, samples: u32) -> Estimate {
    let frame = scene.camera_frame(size);
    let batch = |batch: u32| {
        let mut state = u64::from(batch);
        let mut random = || split_mix(&mut state);
        let mut image = RadianceImage::black(size);
        for (pixel, place) in image.pixels.iter_mut().zip(0..) {
            let (x, y) = (place % size.width, place / size.width);
            let sum = (0..samples).fold(DVec3::ZERO, |sum, _| {
                let film = [f64::from(x) + random(), f64::from(y) + random()];
                let ray = camera_ray(&frame, film, [random(), random()]);
                sum + radiance(scene, ray, max_depth, &mut random)
            });
            *pixel = (sum / f64::from(samples)).as_vec3().to_array();
        }
        image
    };
    Estimate::from_batches(&(0..BATCHES).map(batch).collect::<Vec<_>>()).unwrap()
}

/// The next number of SplitMix64 (Steele, Lea and Flood 2014), uniform in [0, 1).
fn split_mix(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut bits = *state;
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((bits ^ (bits >> 31)) >> 11) as f64 * 2.0f64.powi(-53)
}

/// The largest difference in standard errors, of the regions and of the whole picture.
fn z_max(picture: &Estimate, reference: &Estimate) -> f64 {
    let comparison = compare(picture, reference, REGION_EDGE).unwrap();
    let whole = TileGrid::new(picture.mean.size, u16::MAX).tile(0);
    let whole = region(picture, reference, whole).unwrap();
    let (of_regions, _) = comparison.worst_region().unwrap();
    whole.z.into_iter().map(f64::abs).fold(of_regions, f64::max)
}

/// The same picture, times 1.02.
fn brightened(picture: &Estimate) -> Estimate {
    let mut brighter = picture.clone();
    for channel in brighter.mean.pixels.as_flattened_mut() {
        *channel *= 1.02;
    }
    brighter
}

fn assert_agrees_in_the_mean(law: &LawScene, size: ImageSize, samples: u32) {
    let scene = CompiledScene::new(&law.scene).unwrap();
    let reference = reference(&scene, size, law.max_depth, samples);
    let settings = RenderSettings {
        samples,
        first_sample: regularisation::SAMPLES,
        max_depth: law.max_depth,
        ..RenderSettings::default()
    };
    let grid = TileGrid::new(size, REGION_EDGE);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let scalar = trace_estimate(&ScalarTracer, &scene, size, settings, &tiles, BATCHES).unwrap();
    let z = z_max(&scalar, &reference);
    assert!(z < Z_MAX, "{}: {z} standard errors", law.name);
    let is_black = reference
        .mean
        .pixels
        .as_flattened()
        .iter()
        .all(|&value| value == 0.0);
    let z = z_max(&brightened(&scalar), &reference);
    assert!(
        is_black || z > Z_MAX,
        "{}: 2 % are {z} standard errors",
        law.name
    );
}

const SIZE: ImageSize = ImageSize::new(24, 16);

#[test]
fn scalar_keeps_the_reference_mean_on_law_scenes() {
    for law in scenes_of_laws() {
        assert_agrees_in_the_mean(&law, SIZE, 64);
    }
}

#[test]
fn scalar_keeps_the_reference_mean_on_materials() {
    for law in scenes_of_materials() {
        assert_agrees_in_the_mean(&law, SIZE, 64);
    }
}

fn asset(name: &'static str, max_depth: u32) -> LawScene {
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/");
    let scene = Scene::load(format!("{scenes}{name}.json")).unwrap();
    LawScene {
        name,
        scene,
        max_depth,
    }
}

#[test]
fn scalar_keeps_the_reference_mean_on_the_pool_table() {
    assert_agrees_in_the_mean(&asset("pool", 5), ImageSize::new(48, 27), 64);
}

/// A ball of glass, of gold, of wax and of resin.
#[test]
fn scalar_keeps_the_reference_mean_on_the_four_balls() {
    assert_agrees_in_the_mean(&asset("materials", 63), ImageSize::new(48, 27), 64);
}

/// The same random numbers lead through the same paths until a rounding turns one.
#[test]
fn fast_tracers_agree_with_scalar_per_sample() {
    let mut scenes = scenes_of_laws();
    scenes.extend(scenes_of_materials());
    for law in scenes {
        let scene = CompiledScene::new(&law.scene).unwrap();
        let settings = RenderSettings {
            max_depth: law.max_depth,
            ..RenderSettings::default()
        };
        let picture = |tracer: &dyn Tracer| {
            trace_image(tracer, &scene, SIZE, settings)
                .unwrap()
                .image()
                .pixels
        };
        let expected = picture(&ScalarTracer);
        for tracer in tracers() {
            let pixels = picture(tracer.as_ref());
            let is_same = |(a, b): &(&f32, &f32)| (**a - **b).abs() <= 2e-3 * (0.1 + **b);
            let channels = pixels.as_flattened().iter().zip(expected.as_flattened());
            let share = channels.filter(is_same).count() as f64 / (3 * SIZE.pixels()) as f64;
            let name = tracer.info().name;
            assert!(share > 0.97, "{name}: {share} of {} agrees", law.name);
        }
    }
}
