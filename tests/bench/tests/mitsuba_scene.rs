//! The conversion of the reference scene into the asset that is traced.

use std::path::{Path, PathBuf};

use carom_bench::mitsuba_scene;
use carom_tracer::{CompiledScene, Material, Scene, Shape};

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(path)
}

#[test]
fn the_pool_asset_is_the_reference_scene() {
    let reference = mitsuba_scene::load(&repository("tests/references/pool_scene.json")).unwrap();
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
    let scene = mitsuba_scene::load(&repository("tests/references/pool_scene.json")).unwrap();
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
