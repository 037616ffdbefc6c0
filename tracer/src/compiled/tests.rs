use glam::Quat;

use super::*;
use crate::scene::{AreaLight, Environment, Lens, Material, Object, Scene, SceneUpdate, Shape};

/// A box and two balls, so that an object's number differs from its sphere's.
fn scene() -> Scene {
    let object = |name: &str, shape| Object {
        name: name.to_owned(),
        material: "grey".to_owned(),
        shape,
    };
    let ball = |x| Shape::Sphere {
        center: Vec3::new(x, 0.0, 0.0),
        radius: 0.5,
        rotation: Quat::IDENTITY,
    };
    let cube = Shape::Box {
        min: Vec3::NEG_ONE,
        max: Vec3::ONE,
    };
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
        materials: [(
            "grey".to_owned(),
            Material::Diffuse {
                albedo: Vec3::splat(0.5),
            },
        )]
        .into(),
        objects: vec![
            object("first", ball(1.0)),
            object("cube", cube),
            object("second", ball(2.0)),
        ],
        area_lights: Vec::new(),
        ..Scene::new()
    }
}

fn pose(object: u32, x: f32) -> ObjectPose {
    ObjectPose {
        object,
        position: Vec3::new(x, 0.0, 0.0),
        rotation: Quat::from_rotation_x(std::f32::consts::FRAC_PI_2),
        visible: true,
    }
}

fn poses(poses: &[ObjectPose]) -> SceneUpdate {
    SceneUpdate {
        camera: None,
        poses: poses.to_vec(),
        particles: Vec::new(),
    }
}

fn after(updates: &[SceneUpdate]) -> (Vec<SphereData>, Camera) {
    let mut compiled = CompiledScene::new(&scene()).unwrap();
    for update in updates {
        let _ = compiled.apply(update);
    }
    (compiled.spheres, compiled.camera)
}

#[test]
fn objects_name_their_data() {
    let compiled = CompiledScene::new(&scene()).unwrap();
    let expected = [
        Primitive::Sphere(0),
        Primitive::Box(0),
        Primitive::Sphere(1),
    ];
    assert_eq!(compiled.primitives, expected);
    assert_eq!(compiled.spheres[1].center, [2.0, 0.0, 0.0]);
}

#[test]
fn a_pose_moves_turns_and_hides_its_ball() {
    let hidden = ObjectPose {
        visible: false,
        ..pose(0, 7.0)
    };
    let (spheres, _) = after(&[poses(&[pose(2, 9.0), hidden])]);
    assert_eq!((spheres[0].center[0], spheres[0].radius), (7.0, 0.0));
    assert_eq!((spheres[1].center[0], spheres[1].radius), (9.0, 0.5));
    let axis = Vec3::from_array(spheres[1].stripe_axis);
    assert!((axis - Vec3::NEG_Y).length() < 1e-6, "{axis}");
}

#[test]
fn updates_do_not_depend_on_those_before() {
    let (a, b) = (poses(&[pose(0, 7.0)]), poses(&[pose(2, 9.0)]));
    assert_eq!(
        after(&[a.clone(), b.clone()]),
        after(std::slice::from_ref(&b))
    );
    assert_eq!(after(&[b, a.clone()]), after(std::slice::from_ref(&a)));
    let still = CompiledScene::new(&scene()).unwrap();
    assert_eq!(
        after(&[a, SceneUpdate::default()]),
        (still.spheres, still.camera)
    );
    let swapped = [pose(2, 9.0), pose(0, 7.0)];
    assert_eq!(
        after(&[poses(&swapped)]),
        after(&[poses(&[swapped[1], swapped[0]])])
    );
}

#[test]
fn a_refused_update_leaves_nothing_behind() {
    let untouched = after(&[]);
    let nan = ObjectPose {
        position: Vec3::NAN,
        ..pose(2, 0.0)
    };
    let turned = ObjectPose {
        rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 2.0),
        ..pose(2, 0.0)
    };
    let blind = Camera {
        fov_x_deg: f32::NAN,
        ..scene().camera
    };
    let good = pose(0, 7.0);
    for (update, sentence) in [
        (
            poses(&[good, nan]),
            "pose of object 2: its position is [NaN",
        ),
        (poses(&[good, turned]), "pose of object 2: its rotation is"),
        (
            poses(&[good, pose(1, 0.0)]),
            "object 1 is posed, but only spheres, truncated cones and meshes move",
        ),
        (
            poses(&[good, pose(3, 0.0)]),
            "object 3 is posed, but the scene has 3 objects",
        ),
        (
            poses(&[good, pose(2, 0.0), good]),
            "object 0 is posed twice",
        ),
        (
            SceneUpdate {
                camera: Some(blind),
                poses: vec![good],
                particles: Vec::new(),
            },
            "the camera's fov_x_deg is NaN",
        ),
    ] {
        let mut compiled = CompiledScene::new(&scene()).unwrap();
        compiled.apply(&poses(&[pose(2, 4.0)])).unwrap();
        let refusal = compiled.apply(&update).unwrap_err().to_string();
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
        assert_eq!((compiled.spheres, compiled.camera), untouched);
    }
}

#[test]
fn the_camera_s_corners_span_its_field_of_view() {
    let size = ImageSize::new(200, 100);
    let frame = camera_frame(&scene().camera, size);
    let at = |x: f32, y: f32| {
        Vec3::from(frame.corner) + x * Vec3::from(frame.dx) + y * Vec3::from(frame.dy)
    };
    let forward = Vec3::new(0.0, 5.0, -1.0).normalize();
    assert!((at(100.0, 50.0) - forward).length() < 1e-6);
    let across = at(0.0, 50.0).angle_between(at(200.0, 50.0));
    assert!((across.to_degrees() - 60.0).abs() < 1e-4, "{across}");
    assert!(at(200.0, 50.0).x > 0.0, "right is right");
    assert!(at(100.0, 0.0).z > at(100.0, 100.0).z, "row 0 is the top");
    let pixel = Vec3::from(frame.dx).length() / Vec3::from(frame.dy).length();
    assert!((pixel - 1.0).abs() < 1e-6, "pixels are square");
}

#[test]
fn lights_and_rectangles_face_along_u_cross_v() {
    let mut scene = scene();
    let (half_u, half_v) = (Vec3::new(0.0, 3.0, 0.0), Vec3::new(0.0, 0.0, 1e-3));
    scene.area_lights.push(AreaLight {
        name: String::new(),
        center: Vec3::ZERO,
        half_u,
        half_v,
        radiance: Vec3::ONE,
        ..AreaLight::new(1.0, 1.0)
    });
    scene.objects[0].shape = Shape::Rectangle {
        center: Vec3::ZERO,
        half_u,
        half_v,
    };
    let compiled = CompiledScene::new(&scene).unwrap();
    assert_eq!(compiled.area_lights[0].normal, [1.0, 0.0, 0.0]);
    assert_eq!(compiled.rectangles[0].normal, [1.0, 0.0, 0.0]);
    assert!((compiled.area_lights[0].length_v / 1e-3 - 1.0).abs() < 1e-6);
}
