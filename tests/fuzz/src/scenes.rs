//! Scenes: their files, and what valid ones of any numbers do to the tracers.

use std::sync::atomic::AtomicBool;

use carom_tracer::glam::{Quat, Vec3};
use carom_tracer::{
    AreaLight, Camera, CompiledScene, Environment, ImageSize, Lens, Material, Medium, Object,
    RenderSettings, ScalarTracer, Scene, Shape, TileGrid, TraceJob, Tracer,
};

/// A text is an error, or a scene that reads back as the same.
pub fn scene_json(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    match Scene::from_json(text) {
        Ok(scene) => {
            let written = scene.to_json().expect("a scene that was read is valid");
            assert_eq!(
                Scene::from_json(&written).expect("a written scene is right"),
                scene
            );
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// A valid scene is traced: each sample is finite and at least 0, or counted as dropped. The bytes are its
/// numbers, one each: see [`Numbers`].
pub fn traced_scene(bytes: &[u8]) {
    let scene = Numbers(bytes).scene();
    let Ok(compiled) = CompiledScene::new(&scene) else {
        return;
    };
    let size = ImageSize::new(4, 3);
    let tiles: Vec<_> = TileGrid::new(size, 4)
        .tiles(TileGrid::new(size, 4).all())
        .collect();
    let job = TraceJob {
        size,
        tiles: &tiles,
        settings: RenderSettings {
            samples: 2,
            max_depth: 6,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    let sink = |tile: carom_tracer::TileRadiance| {
        for pixel in tile.radiance {
            assert!(
                pixel.iter().all(|value| value.is_finite() && *value >= 0.0),
                "{scene:?}"
            );
        }
    };
    ScalarTracer
        .trace(&compiled, &job, &sink)
        .expect("the processor is there");
}

/// The repository's scenes, cut to a size that is soon read.
pub fn scene_json_seeds() -> Vec<Vec<u8>> {
    let mut random = 1_u64;
    let bytes = |length: usize| -> Vec<u8> { (0..length).map(|_| next(&mut random)).collect() };
    let scenes = [40, 90, 200].map(bytes);
    let texts = scenes
        .iter()
        .filter_map(|bytes| Numbers(bytes).scene().to_json().ok());
    let mut seeds: Vec<Vec<u8>> = texts.map(String::into_bytes).collect();
    seeds.push(include_bytes!("../../../assets/scenes/materials.json").to_vec());
    seeds
}

/// Numbers of a few scenes.
pub fn traced_scene_seeds() -> Vec<Vec<u8>> {
    let mut random = 7_u64;
    [30, 60, 120, 240]
        .map(|length| (0..length).map(|_| next(&mut random)).collect())
        .into()
}

fn next(random: &mut u64) -> u8 {
    *random = random
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*random >> 56) as u8
}

/// Bytes as numbers: from 0 to 200 steps of a fiftieth from −2 to 2, above them extremes.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (&first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(first)
    }

    fn number(&mut self) -> f32 {
        match self.byte() {
            None => 0.5,
            Some(step @ 0..=200) => f32::from(step) / 50.0 - 2.0,
            Some(extreme) => EXTREMES[usize::from(extreme - 201) % EXTREMES.len()],
        }
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    /// From 0 to 1 unless it is extreme.
    fn share(&mut self) -> f32 {
        let number = self.number();
        if number.abs() <= 2.0 {
            0.25 * (number + 2.0)
        } else {
            number
        }
    }

    fn shares(&mut self) -> Vec3 {
        Vec3::new(self.share(), self.share(), self.share())
    }

    fn scene(&mut self) -> Scene {
        let camera = Camera {
            eye: 3.0 * self.vector(),
            target: self.vector(),
            up: Vec3::Z,
            fov_x_deg: 90.0 * self.share(),
            lens: Lens {
                aperture_radius_m: 0.1 * self.share(),
                focus_distance_m: 0.1 + self.share(),
            },
            near_m: self.share(),
        };
        let mut scene = Scene {
            environment: Environment {
                radiance: self.shares(),
            },
            ..Scene::new().camera(camera)
        };
        while let Some(kind) = self.byte().filter(|_| scene.objects.len() < OBJECTS_MAX) {
            let name = format!("object {}", scene.objects.len());
            let material = self.material(kind / 8);
            match self.shape(kind % 8) {
                Some(shape) => {
                    scene.materials.insert(name.clone(), material);
                    scene.objects.push(Object {
                        material: name.clone(),
                        name,
                        shape,
                    });
                }
                None => scene.area_lights.push(AreaLight {
                    name,
                    center: self.vector(),
                    half_u: Vec3::X * self.share(),
                    half_v: Vec3::Y * self.share(),
                    radiance: 10.0 * self.shares(),
                    ..AreaLight::new(1.0, 1.0)
                }),
            }
        }
        scene
    }

    /// None is an area light.
    fn shape(&mut self, kind: u8) -> Option<Shape> {
        Some(match kind {
            0..=2 => Shape::Sphere {
                center: self.vector(),
                radius: self.share(),
                rotation: Quat::IDENTITY,
            },
            3 | 4 => {
                let min = self.vector();
                Shape::Box {
                    min,
                    max: min + self.shares(),
                }
            }
            5 => Shape::Disc {
                center: self.vector(),
                normal: self.vector(),
                radius: self.share(),
            },
            6 => Shape::Rectangle {
                center: self.vector(),
                half_u: Vec3::X * self.share(),
                half_v: Vec3::Z * self.share(),
            },
            _ => return None,
        })
    }

    fn material(&mut self, kind: u8) -> Material {
        match kind % 5 {
            0 => Material::Diffuse {
                albedo: self.shares(),
            },
            1 => Material::SmoothPlastic {
                albedo: self.shares(),
                ior: 1.0 + self.share(),
                internal_reflectance: None,
                stripe: None,
            },
            2 => Material::Conductor {
                eta: self.shares(),
                k: 4.0 * self.shares(),
                alpha: self.share(),
                number: 0,
            },
            3 => Material::Cloth {
                albedo: self.shares(),
                sheen: self.shares(),
                sheen_roughness: self.share(),
                marks: None,
            },
            _ => Material::Dielectric {
                ior: 1.0 + self.share(),
                alpha: self.share(),
                medium: None::<Medium>,
                number: 0,
            },
        }
    }
}

const OBJECTS_MAX: usize = 12;
const EXTREMES: [f32; 12] = [
    0.0,
    -0.0,
    1e-30,
    1e-6,
    1e3,
    9.9e4,
    1e30,
    f32::MAX,
    f32::MIN_POSITIVE,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
];
