//! Particles of an update against objects of a scene.

use carom_tracer::film::trace_image;
use carom_tracer::glam::{U16Vec3, Vec3};
use carom_tracer::sampling::uniforms;
use carom_tracer::scene::validate::{CLOUDS_MAX, PARTICLES_MAX};
use carom_tracer::{
    CompiledScene, CpuTracer, Error, ImageSize, Material, ParticleCloud, ParticleForm,
    RadianceImage, RenderSettings, Scene, SceneUpdate, Sphere, Tracer,
};

use super::textures::image_textured_still_life;
use super::tracers::tracers;

const SIZE: ImageSize = ImageSize::new(64, 36);

fn pool() -> Scene {
    Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap()
}

/// Grains over the cloth.
fn cloud(count: u32) -> ParticleCloud {
    let mut cloud = ParticleCloud {
        material: Material::diffuse([0.6, 0.5, 0.3]),
        radius_m: 0.012,
        form: ParticleForm::Balls,
        min: Vec3::new(-0.8, -0.4, 0.0),
        max: Vec3::new(0.8, 0.4, 0.3),
        places: Vec::new(),
    };
    let place = |index| {
        let [x, y, z, _] = uniforms(index, 3, 1, 4);
        cloud.place(cloud.min + Vec3::new(x, y, z * z) * (cloud.max - cloud.min))
    };
    cloud.places = (0..count).map(place).collect();
    cloud
}

fn picture(tracer: &dyn Tracer, scene: &CompiledScene) -> RadianceImage {
    let settings = RenderSettings {
        samples: 2,
        max_depth: 3,
        ..RenderSettings::default()
    };
    trace_image(tracer, scene, SIZE, settings).unwrap().image()
}

/// Beside textured meshes, too, whose materials come before theirs.
#[test]
fn particles_look_as_balls_of_the_scene_do() {
    let cloud = cloud(700);
    for mut scene in [pool(), image_textured_still_life()] {
        let mut with_particles = CompiledScene::new(&scene).unwrap();
        let update = SceneUpdate::default().particles(vec![cloud.clone()]);
        with_particles.apply(&update).unwrap();
        for place in &cloud.places {
            scene.add(
                Sphere::new(cloud.radius_m).at(cloud.center(*place)),
                cloud.material,
            );
        }
        let with_balls = CompiledScene::new(&scene).unwrap();
        for tracer in tracers() {
            let name = tracer.info().name;
            let [particles, balls] =
                [&with_particles, &with_balls].map(|scene| picture(tracer.as_ref(), scene).pixels);
            let differ = particles.iter().zip(&balls).filter(|(a, b)| a != b).count();
            assert_eq!(differ, 0, "{name}");
        }
    }
}

#[test]
fn a_scene_without_particles_is_as_it_was() {
    let mut scene = CompiledScene::new(&pool()).unwrap();
    for tracer in tracers() {
        let before = picture(tracer.as_ref(), &scene);
        let update = SceneUpdate::default().particles(vec![cloud(400), cloud(3)]);
        scene.apply(&update).unwrap();
        assert_ne!(picture(tracer.as_ref(), &scene), before);
        scene.apply(&SceneUpdate::default()).unwrap();
        assert_eq!(
            picture(tracer.as_ref(), &scene),
            before,
            "{}",
            tracer.info().name
        );
    }
}

/// A puddle on the cloth.
fn puddle() -> ParticleCloud {
    let mut cloud = cloud(0);
    cloud.material = Material::Dielectric {
        ior: 1.33,
        alpha: 0.0,
        medium: None,
        number: 0,
    };
    cloud.form = ParticleForm::Surface {
        smoothing_m: 0.05,
        floor_m: -1e-3,
    };
    let places =
        (0..600).map(|i| cloud.place(0.02 * Vec3::new((i % 30) as f32, (i / 30) as f32, 0.5)));
    cloud.places = places.collect();
    cloud
}

#[test]
fn a_surface_looks_the_same_on_every_tracer_and_leaves_nothing_behind() {
    let mut scene = CompiledScene::new(&pool()).unwrap();
    let update = SceneUpdate::default().particles(vec![cloud(3), puddle()]);
    let mut expected: Option<RadianceImage> = None;
    for tracer in tracers() {
        let name = tracer.info().name;
        let before = picture(tracer.as_ref(), &scene);
        scene.apply(&update).unwrap();
        let triangles = scene.meshes.triangles.len();
        assert!(triangles.is_power_of_two(), "{triangles}");
        let with_puddle = picture(tracer.as_ref(), &scene);
        assert_ne!(with_puddle, before, "{name}");
        let expected = expected.get_or_insert_with(|| with_puddle.clone());
        let channels = with_puddle.pixels.as_flattened().iter();
        let channels = channels.zip(expected.pixels.as_flattened());
        let is_same = |(a, b): &(&f32, &f32)| (**a - **b).abs() <= 2e-3 * (0.1 + **b);
        let share = channels.filter(is_same).count() as f64 / (3 * SIZE.pixels()) as f64;
        assert!(share > 0.97, "{name}: {share}");
        scene.apply(&SceneUpdate::default()).unwrap();
        assert_eq!(picture(tracer.as_ref(), &scene), before, "{name}");
    }
}

#[test]
fn kernels_are_of_few_sizes_of_clouds() {
    let mut scene = CompiledScene::new(&pool()).unwrap();
    let own = scene.spheres.len();
    let mut sizes: Vec<usize> = (0..3000)
        .step_by(37)
        .map(|count| {
            let update = SceneUpdate::default().particles(vec![cloud(count)]);
            scene.apply(&update).unwrap();
            let visible = scene
                .spheres
                .iter()
                .filter(|sphere| sphere.radius > 0.0)
                .count();
            assert_eq!(visible, own + count as usize);
            scene.spheres.len() - own
        })
        .collect();
    sizes.dedup();
    assert_eq!(sizes, [0, 1024, 2048, 4096]);
}

#[test]
fn particles_out_of_range_are_refused_and_leave_the_scene() {
    type Change<'a> = (&'a dyn Fn(&mut ParticleCloud), &'a str);
    let changes: [Change<'_>; 8] = [
        (&|cloud| cloud.radius_m = 0.0, "radius"),
        (&|cloud| cloud.radius_m = f32::NAN, "radius"),
        (&|cloud| cloud.max.y = cloud.min.y, "below its max"),
        (&|cloud| cloud.min.x = f32::NEG_INFINITY, "its min"),
        (&|cloud| cloud.material = Material::grey(1.5), "albedo"),
        (
            &|cloud| {
                cloud.form = ParticleForm::Surface {
                    smoothing_m: 0.05,
                    floor_m: f32::NAN,
                };
            },
            "its floor",
        ),
        (
            &|cloud| {
                cloud.form = ParticleForm::Surface {
                    smoothing_m: 1e-5,
                    floor_m: 0.0,
                };
            },
            "at most 16384 times that",
        ),
        (
            &|cloud| cloud.material = Material::wood(carom_tracer::Axis::X),
            "pattern",
        ),
    ];
    let mut scene = CompiledScene::new(&pool()).unwrap();
    let tracer = CpuTracer::with_threads(1).unwrap();
    let before = picture(&tracer, &scene);
    let mut refused = |clouds: Vec<ParticleCloud>, words: &str| {
        let update = SceneUpdate::default().particles(clouds);
        let error = scene.apply(&update).unwrap_err();
        assert!(matches!(error, Error::InvalidUpdate(_)), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    };
    for (change, words) in changes {
        let mut broken = cloud(10);
        change(&mut broken);
        refused(vec![cloud(5), broken], words);
    }
    refused(vec![cloud(0); CLOUDS_MAX + 1], "33 clouds");
    let mut many = cloud(0);
    many.places = vec![U16Vec3::ZERO; PARTICLES_MAX + 1];
    refused(vec![many], "65537 particles");
    assert_eq!(picture(&tracer, &scene), before);
}
