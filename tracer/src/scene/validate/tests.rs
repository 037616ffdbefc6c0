use super::*;
use crate::scene::{AreaLight, Environment, Lens, Object, Stripe};

fn object(name: &str, shape: Shape) -> Object {
    Object {
        name: name.to_owned(),
        material: "m".to_owned(),
        shape,
    }
}

fn sphere() -> Shape {
    Shape::Sphere {
        center: Vec3::ZERO,
        radius: 1.0,
        rotation: Quat::IDENTITY,
    }
}

fn light() -> AreaLight {
    AreaLight {
        name: "l".to_owned(),
        center: Vec3::ZERO,
        half_u: Vec3::X,
        half_v: Vec3::Y,
        radiance: Vec3::ONE,
        ..AreaLight::new(1.0, 1.0)
    }
}

fn scene() -> Scene {
    Scene {
        camera: Camera {
            eye: Vec3::new(0.0, -5.0, 1.0),
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 60.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::ONE,
        },
        materials: [("m".to_owned(), Material::Diffuse { albedo: Vec3::ONE })].into(),
        objects: vec![object("o", sphere())],
        area_lights: vec![light()],
        ..Scene::new()
    }
}

fn refusal(change: impl FnOnce(&mut Scene)) -> String {
    let mut scene = scene();
    scene.validate().unwrap();
    change(&mut scene);
    scene.validate().unwrap_err().to_string()
}

fn refusal_of_shape(shape: Shape) -> String {
    refusal(|scene| scene.objects[0].shape = shape)
}

fn refusal_of_plastic(albedo: f32, ior: f32, internal_reflectance: Option<f32>) -> String {
    let material = Material::SmoothPlastic {
        albedo: Vec3::splat(albedo),
        ior,
        internal_reflectance,
        stripe: None,
    };
    refusal(|scene| *scene.materials.get_mut("m").unwrap() = material)
}

#[track_caller]
fn assert_says(refusal: &str, sentence: &str) {
    assert!(
        refusal.contains(sentence),
        "`{sentence}` is not in `{refusal}`"
    );
}

#[test]
fn cameras_that_see_nothing_are_refused() {
    for fov in [0.0, -1.0, 180.0, f32::NAN, f32::INFINITY] {
        let refusal = refusal(|scene| scene.camera.fov_x_deg = fov);
        assert_says(
            &refusal,
            &format!("the camera's fov_x_deg is {fov}: it must be from 0.01"),
        );
    }
    for radius in [-0.01, 2e3, f32::NAN] {
        let refusal = refusal(|scene| scene.camera.lens.aperture_radius_m = radius);
        assert_says(
            &refusal,
            &format!("the camera's aperture_radius_m is {radius}: it must be from 0 to 1000"),
        );
    }
    for focus in [-1.0, 0.0, f32::INFINITY] {
        let refusal = refusal(|scene| scene.camera.lens.focus_distance_m = focus);
        assert_says(
            &refusal,
            &format!("the camera's focus_distance_m is {focus}: it must be from 0.001"),
        );
    }
    for near in [-0.5, f32::NAN, f32::INFINITY] {
        let refusal = refusal(|scene| scene.camera.near_m = near);
        assert_says(
            &refusal,
            &format!("the camera's near_m is {near}: it must be from 0 to"),
        );
    }
    assert_says(
        &refusal(|s| s.camera.eye = s.camera.target),
        "eye and target are both",
    );
    assert_says(
        &refusal(|s| s.camera.eye.x = f32::NAN),
        "the camera's eye is [NaN",
    );
    assert_says(
        &refusal(|s| s.camera.target.y = 2e7),
        "the camera's target is [0, 20000000",
    );
    assert_says(
        &refusal(|s| s.camera.up = Vec3::ZERO),
        "must not be 0 or parallel",
    );
    assert_says(
        &refusal(|s| s.camera.up = s.camera.eye),
        "must not be 0 or parallel",
    );
    assert_says(
        &refusal(|s| s.camera.up = Vec3::INFINITY),
        "the camera's up is [inf",
    );
}

#[test]
fn extreme_cameras_are_seen_through() {
    let mut scene = scene();
    for up in [Vec3::splat(f32::MAX), Vec3::Z * 1e-40] {
        scene.camera.up = up;
        scene.validate().unwrap();
        let frame = crate::compiled::camera_frame(&scene.camera, crate::ImageSize::new(2, 2));
        assert!(Vec3::from(frame.corner).is_finite() && Vec3::from(frame.dx).is_finite());
    }
}

#[test]
fn shapes_without_extent_are_refused() {
    let ball = |center: Vec3, radius, rotation| {
        refusal_of_shape(Shape::Sphere {
            center,
            radius,
            rotation,
        })
    };
    let still = Quat::IDENTITY;
    assert_says(
        &ball(Vec3::ZERO, 0.0, still),
        "object 0 `o`: its radius is 0 m",
    );
    assert_says(&ball(Vec3::ZERO, -1.0, still), "its radius is -1 m");
    assert_says(&ball(Vec3::ZERO, f32::NAN, still), "its radius is NaN m");
    assert_says(&ball(Vec3::NAN, 1.0, still), "its center is [NaN");
    assert_says(
        &ball(Vec3::ZERO, 1.0, Quat::from_xyzw(0., 0., 0., 0.)),
        "its rotation is",
    );
    assert_says(&ball(Vec3::ZERO, 1.0, Quat::NAN), "its rotation is [NaN");

    let slab = |min, max| refusal_of_shape(Shape::Box { min, max });
    assert_says(
        &slab(Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0)),
        "must be below its max",
    );
    assert_says(&slab(Vec3::ONE, Vec3::ZERO), "must be below its max");
    assert_says(&slab(Vec3::NAN, Vec3::ONE), "its min is [NaN");
    assert_says(&slab(Vec3::ZERO, Vec3::INFINITY), "its max is [inf");
}

#[test]
fn plates_without_extent_are_refused() {
    let disc = |normal, radius| {
        refusal_of_shape(Shape::Disc {
            center: Vec3::ZERO,
            normal,
            radius,
        })
    };
    assert_says(&disc(Vec3::ZERO, 1.0), "its normal [0, 0, 0] must not be 0");
    assert_says(&disc(Vec3::NAN, 1.0), "its normal is [NaN");
    assert_says(&disc(Vec3::Z, 1e-7), "its radius is 0.0000001 m");

    let plate = |half_u, half_v| {
        refusal_of_shape(Shape::Rectangle {
            center: Vec3::ZERO,
            half_u,
            half_v,
        })
    };
    assert_says(
        &plate(Vec3::ZERO, Vec3::Y),
        "the length of its half_u is 0 m",
    );
    assert_says(
        &plate(Vec3::X, Vec3::Y * 2e7),
        "the length of its half_v is 20000000 m",
    );
    assert_says(
        &plate(Vec3::X, Vec3::new(0.1, 1.0, 0.0)),
        "must be at right angles",
    );
    assert_says(&plate(Vec3::NAN, Vec3::Y), "its half_u is [NaN");
}

#[test]
fn area_lights_keep_the_rules_of_rectangles() {
    assert_says(
        &refusal(|s| s.area_lights[0].half_v = Vec3::X),
        "area light 0 `l`: its half_u",
    );
    for radiance in [-1.0, f32::NAN, f32::INFINITY, 1e31] {
        let refusal = refusal(|scene| scene.area_lights[0].radiance.y = radiance);
        assert_says(&refusal, "area light 0 `l`: the area light's radiance is");
    }
    for gradient in [1.5, -1.5, f32::NAN] {
        let refusal = refusal(|scene| scene.area_lights[0].gradient.y = gradient);
        let said = format!("area light 0 `l`: its gradient is [0, {gradient}, 0]");
        assert_says(&refusal, &said);
    }
    let refusal = refusal(|scene| scene.environment.radiance.z = -0.1);
    assert_says(&refusal, "the environment's radiance is [1, 1, -0.1]");
}

#[test]
fn materials_that_make_light_are_refused() {
    let shining = Material::Diffuse {
        albedo: Vec3::new(0.5, 1.1, 0.5),
    };
    let refused = refusal(|scene| *scene.materials.get_mut("m").unwrap() = shining);
    assert_says(&refused, "material `m`: its albedo is [0.5, 1.1, 0.5]");
    assert_says(
        &refusal_of_plastic(f32::NAN, 1.5, None),
        "its albedo is [NaN",
    );
    for bad in [0.0, 0.99, 1001.0, f32::NAN] {
        let refusal = refusal_of_plastic(0.5, bad, None);
        assert_says(
            &refusal,
            &format!("its ior is {bad}: it must be from 1 to 1000"),
        );
    }
    for bad in [-0.1, 1.0, f32::NAN] {
        let refusal = refusal_of_plastic(0.5, 1.5, Some(bad));
        assert_says(&refusal, &format!("its internal_reflectance is {bad}"));
    }
}

#[test]
fn stripes_have_a_width_and_a_colour() {
    let striped = |albedo, half_width| {
        let material = Material::SmoothPlastic {
            albedo: Vec3::ONE,
            ior: 1.5,
            internal_reflectance: None,
            stripe: Some(Stripe { albedo, half_width }),
        };
        refusal(|scene| *scene.materials.get_mut("m").unwrap() = material)
    };
    for bad in [0.0, -0.5, 1.5, f32::NAN] {
        assert_says(
            &striped(Vec3::ONE, bad),
            &format!("its stripe's half_width is {bad}"),
        );
    }
    assert_says(
        &striped(Vec3::splat(2.0), 0.5),
        "its stripe's albedo is [2, 2, 2]",
    );
}

#[test]
fn names_are_short_and_materials_exist() {
    let long = "x".repeat(NAME_BYTES_MAX + 1);
    let sentence = "a name that begins `xxxxxxxxxxxxxxxx` has 65 bytes: at most 64";
    assert_says(&refusal(|s| s.objects[0].name.clone_from(&long)), sentence);
    assert_says(
        &refusal(|s| s.objects[0].material.clone_from(&long)),
        sentence,
    );
    assert_says(
        &refusal(|s| s.area_lights[0].name.clone_from(&long)),
        sentence,
    );
    let material = Material::Diffuse { albedo: Vec3::ONE };
    assert_says(
        &refusal(|s| s.materials = [(long, material)].into()),
        sentence,
    );
    let sentence = "object 0 `o`: its material `n` is not among the scene's materials";
    assert_says(
        &refusal(|s| s.objects[0].material = "n".to_owned()),
        sentence,
    );
}

#[test]
fn counts_are_limited() {
    let objects = refusal(|s| s.objects = vec![object("o", sphere()); OBJECTS_MAX + 1]);
    assert_says(
        &objects,
        "it has 131073 objects: at most 131072 are allowed",
    );
    let area_lights = refusal(|s| s.area_lights = vec![light(); AREA_LIGHTS_MAX + 1]);
    assert_says(
        &area_lights,
        "it has 65 area lights: at most 64 are allowed",
    );
    let material = Material::Diffuse { albedo: Vec3::ONE };
    let many = (0..=MATERIALS_MAX).map(|i| (i.to_string(), material));
    let materials = refusal(|s| s.materials = many.collect());
    assert_says(
        &materials,
        "it has 1025 materials: at most 1024 are allowed",
    );
}
