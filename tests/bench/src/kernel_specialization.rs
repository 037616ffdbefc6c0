//! The bench of kernel specialization: kernels of only what a scene requires, compared with kernels of
//! everything.

use std::path::PathBuf;

use carom_tracer::{
    Axis, CompiledScene, CsgSolid, ImageSize, Material, Mesh, Object, ProceduralTexture, Scene,
    Shape, Stripe, Subtraction,
};
use glam::{Quat, Vec3};
use serde::Serialize;

use crate::scenes::{self, NamedScene};
use crate::{BenchError, print_json, timing};
use carom_farm::backend::{self, Backend, OpenBackend};

/// Measure the gain of kernels that hold only what a scene requires.
///
/// Each scene is traced as it is, and with something added that is never seen: a material that no
/// object has, or a small shape behind the camera. Kernels need code for it all the same. Printed is
/// the time with it over the time without, of turns taken one after the other: CPU time of this
/// process on a processor, the device's own on a GPU that tells it.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Scene file; may be repeated [default: the built-in pool table].
    #[arg(long)]
    scene: Vec<PathBuf>,
    /// Only this back end [default: the CPU, and the GPU if there is one].
    #[arg(long)]
    backend: Option<Backend>,
    /// Pixels.
    #[arg(long, default_value = "640x360")]
    size: ImageSize,
    /// Samples per pixel.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: u32,
    /// Turns; the best of each is taken.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
}

#[derive(Serialize)]
struct SpecializationReport {
    scenes: Vec<SpecializationMeasurement>,
}

#[derive(Serialize)]
struct SpecializationMeasurement {
    scene: String,
    backend: &'static str,
    milliseconds: f64,
    rows: Vec<SpecializationRow>,
}

#[derive(Serialize)]
struct SpecializationRow {
    left_out: &'static str,
    /// Time with it over that without; absent where the scene uses it.
    gain: Option<f64>,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let mut scenes = Vec::new();
    for path in &args.scene {
        scenes.push(scenes::scene(Some(path))?);
    }
    if scenes.is_empty() {
        scenes.push(scenes::scene(None)?);
    }
    let opened = backend::open_all(args.backend, 0)?;
    let is_compared = |opened: &&OpenBackend| {
        args.backend.is_some() || matches!(opened.backend, Backend::Cpu | Backend::Gpu)
    };
    let mut report = SpecializationReport { scenes: Vec::new() };
    for named in &scenes {
        for opened in opened.iter().filter(is_compared) {
            report.scenes.push(measure(opened, named, args)?);
        }
    }
    if args.json {
        print_json(&report)?;
    } else {
        report.scenes.iter().for_each(print);
    }
    Ok(())
}

fn measure(
    opened: &OpenBackend,
    named: &NamedScene,
    args: &Args,
) -> Result<SpecializationMeasurement, BenchError> {
    let mut everything = named.scene.clone();
    let mut scenes = vec![CompiledScene::new(&named.scene)?];
    let unused = PARTS.iter().filter(|part| !(part.is_used)(&named.scene));
    let unused: Vec<&FeatureChange> = unused.collect();
    for part in &unused {
        let mut scene = named.scene.clone();
        (part.add)(&mut scene);
        (part.add)(&mut everything);
        scenes.push(CompiledScene::new(&scene)?);
    }
    scenes.push(CompiledScene::new(&everything)?);
    let mut least = vec![f64::INFINITY; scenes.len()];
    let tracer = opened.tracer.as_ref();
    backend::wake(tracer, || {
        timing::milliseconds(tracer, &scenes[0], args.size, args.spp).map(|_| ())
    })?;
    // The first turn compiles kernels and fills caches.
    for turn in 0..=args.repetitions {
        for (scene, least) in scenes.iter().zip(&mut least) {
            let milliseconds = timing::milliseconds(tracer, scene, args.size, args.spp)?;
            if turn > 0 {
                *least = least.min(milliseconds);
            }
        }
    }
    let gain = |part: &FeatureChange| {
        let index = unused.iter().position(|other| other.name == part.name)?;
        Some(least[1 + index] / least[0])
    };
    let rows = PARTS.iter().map(|part| SpecializationRow {
        left_out: part.name,
        gain: gain(part),
    });
    let all = SpecializationRow {
        left_out: "all of these",
        gain: Some(least[scenes.len() - 1] / least[0]),
    };
    Ok(SpecializationMeasurement {
        scene: named.name.clone(),
        backend: opened.backend.name(),
        milliseconds: least[0],
        rows: rows.chain([all]).collect(),
    })
}

fn print(measured: &SpecializationMeasurement) {
    println!(
        "{} on {}: {:.2} ms a picture",
        measured.scene, measured.backend, measured.milliseconds
    );
    println!("  {:<24} {:>10}", "with, though not seen", "time over");
    for row in &measured.rows {
        let gain = row.gain.map(|gain| format!("{gain:.3}"));
        let gain = gain.unwrap_or_else(|| "used".to_owned());
        println!("  {:<24} {gain:>10}", row.left_out);
    }
}

/// A feature that scenes may lack.
struct FeatureChange {
    name: &'static str,
    is_used: fn(&Scene) -> bool,
    /// Adds the feature where it is never seen.
    add: fn(&mut Scene),
}

const PARTS: [FeatureChange; 14] = [
    FeatureChange {
        name: "a coat",
        is_used: |scene| any_material(scene, is_coated),
        add: |scene| add_material(scene, "coat", COAT),
    },
    FeatureChange {
        name: "a stripe",
        is_used: |scene| any_material(scene, is_striped),
        add: |scene| {
            add_material(scene, "stripe", ball(Some(STRIPE), 0));
        },
    },
    FeatureChange {
        name: "a ball's number",
        is_used: |scene| any_material(scene, is_numbered),
        add: |scene| {
            add_material(scene, "number", ball(None, 8));
        },
    },
    FeatureChange {
        name: "wood",
        is_used: |scene| any_material(scene, is_wood),
        add: |scene| {
            let texture = ProceduralTexture::Wood {
                light: GREY,
                dark: GREY,
                grain: Axis::X,
                sights: None,
                scale: 1.0,
            };
            add_material(
                scene,
                "wood",
                Material::Coated {
                    ior: 1.5,
                    alpha: 0.0,
                    texture,
                },
            );
        },
    },
    FeatureChange {
        name: "napped cloth",
        is_used: |scene| any_material(scene, |m| matches!(m, Material::Cloth { .. })),
        add: |scene| {
            let cloth = Material::Cloth {
                albedo: GREY,
                sheen: GREY,
                sheen_roughness: 0.5,
                marks: None,
            };
            add_material(scene, "cloth", cloth);
        },
    },
    FeatureChange {
        name: "a metal",
        is_used: |scene| any_material(scene, |m| matches!(m, Material::Conductor { .. })),
        add: |scene| {
            let (eta, k) = (Vec3::ONE, Vec3::splat(3.0));
            let metal = Material::Conductor {
                eta,
                k,
                alpha: 0.1,
                number: 0,
            };
            add_material(scene, "metal", metal);
        },
    },
    FeatureChange {
        name: "a clear body",
        is_used: |scene| any_material(scene, |m| matches!(m, Material::Dielectric { .. })),
        add: |scene| {
            let glass = Material::Dielectric {
                ior: 1.5,
                alpha: 0.0,
                medium: None,
                number: 0,
            };
            add_material(scene, "glass", glass);
        },
    },
    FeatureChange {
        name: "a ball",
        is_used: |scene| any_shape(scene, |shape| matches!(shape, Shape::Sphere { .. })),
        add: |scene| {
            let (center, radius, rotation) = (hidden(scene), SMALL_M, Quat::IDENTITY);
            let ball = Shape::Sphere {
                center,
                radius,
                rotation,
            };
            add_object(scene, ball);
        },
    },
    FeatureChange {
        name: "a box",
        is_used: |scene| any_shape(scene, |shape| matches!(shape, Shape::Box { .. })),
        add: |scene| {
            let (min, max) = hidden_box(scene);
            add_object(scene, Shape::Box { min, max });
        },
    },
    FeatureChange {
        name: "a CSG box",
        is_used: |scene| any_shape(scene, |shape| matches!(shape, Shape::CsgBox { .. })),
        add: |scene| {
            let solid = CsgSolid::HalfSpace {
                point: hidden_box(scene).1,
                normal: Vec3::ONE,
            };
            add_csg_box(scene, solid);
        },
    },
    FeatureChange {
        name: "a subtracted cone",
        is_used: |scene| any_shape(scene, is_turned),
        add: |scene| {
            let solid = CsgSolid::ConeExterior {
                axis: Axis::Z,
                center: hidden(scene),
                radius: 0.5 * SMALL_M,
                taper: 0.0,
                beyond: Vec3::ZERO,
            };
            add_csg_box(scene, solid);
        },
    },
    FeatureChange {
        name: "a disc",
        is_used: |scene| any_shape(scene, |shape| matches!(shape, Shape::Disc { .. })),
        add: |scene| {
            let (center, normal, radius) = (hidden(scene), Vec3::Y, SMALL_M);
            let disc = Shape::Disc {
                center,
                normal,
                radius,
            };
            add_object(scene, disc);
        },
    },
    FeatureChange {
        name: "a rectangle",
        is_used: |scene| any_shape(scene, |shape| matches!(shape, Shape::Rectangle { .. })),
        add: |scene| {
            let (center, half_u, half_v) = (hidden(scene), Vec3::X * SMALL_M, Vec3::Z * SMALL_M);
            let rectangle = Shape::Rectangle {
                center,
                half_u,
                half_v,
            };
            add_object(scene, rectangle);
        },
    },
    FeatureChange {
        name: "a mesh",
        is_used: |scene| any_shape(scene, |shape| matches!(shape, Shape::Mesh(_))),
        add: |scene| {
            let corners = [Vec3::X, Vec3::Z, Vec3::ZERO].map(|corner| SMALL_M * corner);
            let mesh = Mesh::new(corners.into(), vec![[0, 1, 2]]).at(hidden(scene));
            add_object(scene, mesh.into());
        },
    },
];

fn any_material(scene: &Scene, is: impl Fn(&Material) -> bool) -> bool {
    scene.materials.values().any(is)
}

fn any_shape(scene: &Scene, is: impl Fn(&Shape) -> bool) -> bool {
    scene.objects.iter().any(|object| is(&object.shape))
}

fn is_turned(shape: &Shape) -> bool {
    let Shape::CsgBox { subtractions, .. } = shape else {
        return false;
    };
    subtractions
        .iter()
        .any(|subtraction| matches!(subtraction.solid, CsgSolid::ConeExterior { .. }))
}

fn is_coated(material: &Material) -> bool {
    matches!(
        material,
        Material::SmoothPlastic { .. } | Material::Coated { .. }
    )
}

fn is_striped(material: &Material) -> bool {
    match material {
        Material::SmoothPlastic { stripe, .. } => stripe.is_some(),
        Material::Coated { texture, .. } => {
            matches!(texture, ProceduralTexture::Ball { stripe, .. } if stripe.is_some())
        }
        _ => false,
    }
}

fn is_numbered(material: &Material) -> bool {
    let Material::Coated { texture, .. } = material else {
        return false;
    };
    matches!(texture, ProceduralTexture::Ball { number, .. } if *number > 0)
}

fn is_wood(material: &Material) -> bool {
    let Material::Coated { texture, .. } = material else {
        return false;
    };
    matches!(
        texture,
        ProceduralTexture::Wood { .. }
            | ProceduralTexture::Planks { .. }
            | ProceduralTexture::Bricks { .. }
            | ProceduralTexture::Scoreboard { .. }
            | ProceduralTexture::Print { .. }
    )
}

fn ball(stripe: Option<Stripe>, number: u8) -> Material {
    let texture = ProceduralTexture::Ball {
        albedo: GREY,
        stripe,
        number,
    };
    Material::Coated {
        ior: 1.5,
        alpha: 0.0,
        texture,
    }
}

fn add_material(scene: &mut Scene, name: &str, material: Material) {
    scene.materials.insert(format!("unused {name}"), material);
}

fn add_object(scene: &mut Scene, shape: Shape) {
    let material = "unused grey".to_owned();
    let grey = Material::Diffuse { albedo: GREY };
    scene.materials.insert(material.clone(), grey);
    scene.objects.push(Object {
        name: "unseen".to_owned(),
        material,
        shape,
    });
}

fn add_csg_box(scene: &mut Scene, solid: CsgSolid) {
    let (min, max) = hidden_box(scene);
    let subtractions = vec![Subtraction {
        solid,
        material: None,
    }];
    add_object(
        scene,
        Shape::CsgBox {
            min,
            max,
            subtractions,
        },
    );
}

/// A place behind the camera, farther than the size of a hidden shape.
fn hidden(scene: &Scene) -> Vec3 {
    let camera = &scene.camera;
    camera.eye - (camera.target - camera.eye).normalize() * (3.0 * SMALL_M)
}

fn hidden_box(scene: &Scene) -> (Vec3, Vec3) {
    let center = hidden(scene);
    (center - SMALL_M, center + SMALL_M)
}

const SMALL_M: f32 = 0.02;
const GREY: Vec3 = Vec3::splat(0.5);
const STRIPE: Stripe = Stripe {
    albedo: GREY,
    half_width: 0.5,
};
const COAT: Material = Material::SmoothPlastic {
    albedo: GREY,
    ior: 1.5,
    internal_reflectance: None,
    stripe: None,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn added_parts_are_used_and_scenes_stay_valid() {
        let plain = Scene {
            materials: std::collections::BTreeMap::new(),
            objects: Vec::new(),
            ..scenes::scene(None).unwrap().scene
        };
        for part in &PARTS {
            let mut scene = plain.clone();
            assert!(!(part.is_used)(&scene), "{}", part.name);
            (part.add)(&mut scene);
            assert!((part.is_used)(&scene), "{}", part.name);
            CompiledScene::new(&scene).unwrap();
        }
    }
}
