//! The pool scene against the independent renderer's numbers.

use std::path::{Path, PathBuf};

use carom_tracer::compiled::Primitive;
use carom_tracer::scalar::bsdf::Bsdf;
use carom_tracer::scalar::{camera_ray, intersect};
use carom_tracer::{CompiledScene, ImageSize, Scene};
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
        let ray = camera_ray(&frame, [theirs.px, theirs.py], [0.0; 2]);
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
        let ray = camera_ray(&frame, [theirs.px, theirs.py], [0.0; 2]);
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
