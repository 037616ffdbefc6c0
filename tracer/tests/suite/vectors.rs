//! The pool scene against the independent renderer's numbers.

use std::path::{Path, PathBuf};

use carom_tracer::compiled::Primitive;
use carom_tracer::scalar::bsdf::Bsdf;
use carom_tracer::scalar::{camera_ray, intersect};
use carom_tracer::{CompiledScene, ImageSize, Material, Scene, Shape};
use serde::Deserialize;

/// Rays and BSDF values that the independent renderer printed, rounded to f32.
#[derive(Deserialize)]
struct Vectors {
    rays: Vec<RayVector>,
    plastic: Vec<PlasticVector>,
}

#[derive(Deserialize)]
struct RayVector {
    px: f64,
    py: f64,
    o: glam::DVec3,
    d: glam::DVec3,
    t: Option<f64>,
    n: Option<glam::DVec3>,
    shape: Option<String>,
}

/// `f(θi, θo) · cos θo` of the diffuse lobe.
#[derive(Deserialize)]
struct PlasticVector {
    theta_i: f64,
    theta_o: f64,
    albedo: f64,
    eval_times_cos: f64,
    formula: f64,
}

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

#[test]
fn the_pool_asset_is_the_reference_scene() {
    let reference = Scene::load(repository("tests/references/pool_scene.json")).unwrap();
    let asset = repository("assets/scenes/pool.json");
    if std::env::var_os("CAROM_REWRITE").is_some() {
        reference.save(&asset).unwrap();
    }
    assert_eq!(Scene::load(&asset).unwrap(), reference);
}

#[test]
fn the_conversion_keeps_numbers_names_and_stripes() {
    let text = std::fs::read_to_string(repository("tests/references/pool_scene.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let scene = Scene::load(repository("tests/references/pool_scene.json")).unwrap();
    assert_eq!(
        (scene.objects.len(), scene.area_lights.len()),
        (16 + 12 + 6, 2)
    );
    assert_eq!(scene.objects[15].name, "ball15");

    let compiled = CompiledScene::new(&scene).unwrap();
    assert!(
        compiled
            .area_lights
            .iter()
            .all(|light| light.normal == [0.0, 0.0, -1.0])
    );
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    for (ball, sphere) in json["spheres"]
        .as_array()
        .unwrap()
        .iter()
        .zip(&compiled.spheres)
    {
        for axis in 0..3 {
            assert_eq!(number(&ball["center"][axis]) as f32, sphere.center[axis]);
            if let Some(stripe) = ball.get("stripe_axis") {
                let difference = number(&stripe[axis]) - f64::from(sphere.stripe_axis[axis]);
                assert!(difference.abs() < 3e-7, "{}: {difference}", ball["name"]);
            }
        }
    }
    let Material::SmoothPlastic {
        internal_reflectance,
        ..
    } = scene.materials["ball_9"]
    else {
        panic!("ball 9 is of plastic");
    };
    assert!((internal_reflectance.unwrap() - 0.596_811).abs() < 1e-6);
    assert!(matches!(scene.objects[16].shape, Shape::Box { .. }));
}

fn vectors() -> Vectors {
    let text = std::fs::read_to_string(repository("tests/references/testvectors.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn pool() -> (Scene, CompiledScene) {
    let scene = Scene::load(repository("assets/scenes/pool.json")).unwrap();
    let compiled = CompiledScene::new(&scene).unwrap();
    (scene, compiled)
}

/// Their rays begin on a plane 0.01 m before the eye, ours at the eye.
#[test]
fn camera_rays_agree() {
    let (scene, compiled) = pool();
    let forward = (scene.camera.target - scene.camera.eye)
        .as_dvec3()
        .normalize();
    let frame = compiled.camera_frame(ImageSize::new(480, 270));
    for theirs in vectors().rays {
        let ray = camera_ray(&frame, theirs.px, theirs.py);
        let difference = (ray.direction - theirs.d).length();
        assert!(
            difference < 3e-7,
            "({}, {}): {difference}",
            theirs.px,
            theirs.py
        );
        let origin = ray.origin + ray.direction * (0.01 / ray.direction.dot(forward));
        assert!((origin - theirs.o).length() < 3e-7, "{origin} {}", theirs.o);
    }
}

#[test]
fn hits_agree_in_distance_normal_and_shape() {
    let (scene, compiled) = pool();
    let forward = (scene.camera.target - scene.camera.eye)
        .as_dvec3()
        .normalize();
    let frame = compiled.camera_frame(ImageSize::new(480, 270));
    for theirs in vectors().rays {
        let ray = camera_ray(&frame, theirs.px, theirs.py);
        let Some(hit) = intersect(&compiled, &ray) else {
            assert_eq!(theirs.shape, None);
            continue;
        };
        let object = compiled
            .primitives
            .iter()
            .position(|&p| p == hit.primitive)
            .unwrap();
        assert_eq!(Some(&scene.objects[object].name), theirs.shape.as_ref());
        let t = hit.t - 0.01 / ray.direction.dot(forward);
        assert!(
            (t / theirs.t.unwrap() - 1.0).abs() < 1e-6,
            "{t} {:?}",
            theirs.t
        );
        // The f32 camera moves the hit by 1e-7 m or so, which on a ball turns the normal by that
        // over the radius and the cosine.
        let tolerance = if matches!(hit.primitive, Primitive::Sphere(_)) {
            2e-5
        } else {
            1e-7
        };
        assert!(
            (hit.n - theirs.n.unwrap()).length() < tolerance,
            "{} {:?}",
            hit.n,
            theirs.n
        );
    }
}

#[test]
fn plastic_agrees() {
    let (_, compiled) = pool();
    let coat = compiled
        .materials
        .iter()
        .find(|material| material.ior == 1.5)
        .unwrap();
    for theirs in vectors().plastic {
        let mut bsdf = Bsdf::new(coat, false);
        bsdf.albedo = glam::DVec3::splat(theirs.albedo);
        let (cos_i, cos_o) = (
            theirs.theta_i.to_radians().cos(),
            theirs.theta_o.to_radians().cos(),
        );
        let value = bsdf.eval(cos_o, cos_i).x * cos_o;
        assert!(
            (value / theirs.formula - 1.0).abs() < 1e-6,
            "{value} {}",
            theirs.formula
        );
        assert!(
            (value / theirs.eval_times_cos - 1.0).abs() < 1e-6,
            "{value}"
        );
    }
}
