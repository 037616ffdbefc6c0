//! The start-up probe: a GPU that does not trace a small scene as the reference does is not used.
//!
//! Drivers compile, fuse and round as they like, and now and then wrongly. The scene has every
//! shape, both materials, a stripe and two lamps, so that every part of the kernel is run.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use glam::{Quat, Vec3};

use crate::{
    Camera, CompiledScene, Environment, Error, ImageSize, Lamp, Material, Object, Reference,
    RenderSettings, Scene, Shape, Stripe, Tile, TraceJob, Tracer,
};

/// 32 × 24 pixels of 4 samples: 10 ms of the reference.
const SIZE: ImageSize = ImageSize::new(32, 24);
const SETTINGS: RenderSettings = RenderSettings {
    samples: 4,
    first_sample: 0,
    scatterings_max: 4,
    seed: 1,
    denoise: false,
};
/// Rounding moves a pixel by about 1e-6; a path whose next edge it sends past the other side of an
/// outline changes it by as much as the light does. Such paths are below 1 in 1000.
const ERROR_MAX: f32 = 1e-3;
const PIXELS_OFF_MAX: usize = SIZE.pixels() / 50;

/// Compares `tracer` with the reference.
///
/// # Errors
/// [`Error::Device`] if it fails or too many pixels differ.
pub(crate) fn prove(tracer: &dyn Tracer) -> Result<(), Error> {
    let scene = CompiledScene::new(&scene())?;
    let picture = trace(tracer, &scene)?;
    let truth = trace(&Reference, &scene)?;
    let off = (picture.iter().zip(&truth)).filter(|(a, b)| is_off(**a, **b));
    let off = off.count();
    if picture.len() == truth.len() && off <= PIXELS_OFF_MAX {
        return Ok(());
    }
    Err(Error::Device {
        device: tracer.info().name,
        message: format!(
            "it traces {off} of {} pixels of the start-up probe wrongly; install another version \
             of its driver",
            truth.len()
        ),
    })
}

fn is_off(a: [f32; 3], b: [f32; 3]) -> bool {
    let error = (Vec3::from(a) - Vec3::from(b)).abs();
    // Written so that NaN is off.
    !error.cmple(ERROR_MAX * (1.0 + Vec3::from(b))).all()
}

fn trace(tracer: &dyn Tracer, scene: &CompiledScene) -> Result<Vec<[f32; 3]>, Error> {
    let tile = Tile {
        x: 0,
        y: 0,
        width: SIZE.width,
        height: SIZE.height,
    };
    let job = TraceJob {
        size: SIZE,
        tiles: &[tile],
        settings: SETTINGS,
        cancelled: &AtomicBool::new(false),
    };
    let picture = Mutex::new(Vec::new());
    tracer.trace(scene, &job, &|tile| {
        picture
            .lock()
            .expect("no sink panics")
            .extend(tile.radiance);
    })?;
    Ok(picture.into_inner().expect("no sink panics"))
}

/// A ball, a box and two plates under two lamps.
pub(crate) fn scene() -> Scene {
    let materials = [
        (
            "ball",
            Material::SmoothPlastic {
                albedo: Vec3::new(0.8, 0.78, 0.7),
                ior: 1.5,
                internal_reflectance: None,
                stripe: Some(Stripe {
                    albedo: Vec3::new(0.6, 0.02, 0.02),
                    half_width: 0.5,
                }),
            },
        ),
        (
            "cloth",
            Material::Diffuse {
                albedo: Vec3::new(0.04, 0.4, 0.2),
            },
        ),
    ];
    let sphere = Shape::Sphere {
        center: Vec3::new(0.0, 0.0, 0.5),
        radius: 0.5,
        rotation: Quat::from_rotation_x(0.7),
    };
    let solid = Shape::Box {
        min: Vec3::new(-1.5, 0.6, -0.1),
        max: Vec3::new(-0.4, 1.2, 0.9),
    };
    let disc = Shape::Disc {
        center: Vec3::new(0.9, -0.3, 0.4),
        normal: Vec3::new(-0.5, -0.6, 0.6),
        radius: 0.4,
    };
    let floor = Shape::Rectangle {
        center: Vec3::ZERO,
        half_u: Vec3::new(3.0, 0.0, 0.0),
        half_v: Vec3::new(0.0, 3.0, 0.0),
    };
    let shapes = [
        (sphere, "ball"),
        (solid, "cloth"),
        (disc, "ball"),
        (floor, "cloth"),
    ];
    Scene {
        camera: Camera {
            eye: Vec3::new(0.2, -3.5, 1.6),
            target: Vec3::new(0.0, 0.0, 0.5),
            up: Vec3::Z,
            fov_x_deg: 50.0,
        },
        environment: Environment {
            radiance: Vec3::new(0.1, 0.12, 0.15),
        },
        materials: BTreeMap::from(materials.map(|(name, material)| (name.to_owned(), material))),
        objects: shapes.map(object).into(),
        lamps: vec![lamp(-0.8, 6.0), lamp(1.4, 9.0)],
    }
}

fn object((shape, material): (Shape, &str)) -> Object {
    Object {
        name: material.to_owned(),
        material: material.to_owned(),
        shape,
    }
}

/// A lamp that shines down from 2 m.
fn lamp(x: f32, radiance: f32) -> Lamp {
    Lamp {
        name: "lamp".to_owned(),
        center: Vec3::new(x, 0.0, 2.0),
        half_u: Vec3::new(0.0, 0.3, 0.0),
        half_v: Vec3::new(0.3, 0.0, 0.0),
        radiance: Vec3::new(radiance, radiance, 0.9 * radiance),
    }
}
