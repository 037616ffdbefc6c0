//! The bench of the BVH: the number of primitives from which on it is faster than testing each.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Instant;

use carom_tracer::compiled::{BvhUse, ShapeKind};
use carom_tracer::{
    AreaLight, Camera, CompiledScene, Environment, ImageSize, Lens, Material, Mesh, Object, Scene,
    SceneUpdate, Shape, Tracer, sampling,
};
use cpu_time::ProcessTime;
use glam::{EulerRot, Quat, Vec3};
use serde::Serialize;

use crate::{BenchError, print_json, timing};
use carom_farm::backend::{self, Backend, OpenBackend};

/// Find the number of primitives from which on a BVH is faster than testing each.
///
/// Clouds of 8 to 100,000 of them that fill the same room are traced with and without the BVH. That of
/// balls is built anew for each picture as it is when they move; others are built once. Printed are the
/// time of a picture, CPU time of this process on a processor, the device's own and that of building
/// the BVH on a GPU that tells it, and the crossing: the fewest from which on the BVH was faster.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Only this back end [default: the CPU, and the GPU if there is one].
    #[arg(long)]
    backend: Option<Backend>,
    /// Pixels; a large GPU needs more to be filled.
    #[arg(long, default_value = "160x90")]
    size: ImageSize,
    /// Samples per pixel.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: u32,
    /// Only this shape; may be repeated.
    #[arg(long, value_enum)]
    shape: Vec<SweptShape>,
    /// The most primitives.
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    count_max: u32,
    /// Turns; the best of each is taken.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
}

/// What there are many of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
enum SweptShape {
    Balls,
    Boxes,
    Discs,
    Rectangles,
    Triangles,
}

impl SweptShape {
    fn kind(self) -> ShapeKind {
        match self {
            Self::Balls => ShapeKind::Sphere,
            Self::Boxes => ShapeKind::Box,
            Self::Discs => ShapeKind::Disc,
            Self::Rectangles => ShapeKind::Rectangle,
            Self::Triangles => ShapeKind::Triangle,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Balls => "balls",
            Self::Boxes => "boxes",
            Self::Discs => "discs",
            Self::Rectangles => "rectangles",
            Self::Triangles => "triangles",
        }
    }
}

#[derive(Serialize)]
struct BvhReport {
    build: Vec<BuildTimes>,
    backends: Vec<BvhSweep>,
}

/// Build times of a BVH, on all threads.
#[derive(Serialize)]
struct BuildTimes {
    shape: SweptShape,
    count: u32,
    cpu_milliseconds: f64,
    milliseconds: f64,
}

#[derive(Serialize)]
struct BvhSweep {
    backend: &'static str,
    shape: SweptShape,
    /// Smallest number from which on the BVH was faster.
    crossing: Option<u32>,
    rows: Vec<BvhRow>,
}

#[derive(Serialize)]
struct BvhRow {
    count: u32,
    each_milliseconds: f64,
    bvh_milliseconds: f64,
}

/// Scenes with increasing numbers of a shape.
struct ShapeClouds {
    shape: SweptShape,
    scenes: Vec<(u32, CompiledScene)>,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let shapes = match &args.shape[..] {
        [] => <SweptShape as clap::ValueEnum>::value_variants(),
        shapes => shapes,
    };
    let mut clouds = shapes
        .iter()
        .map(|shape| ShapeClouds::new(*shape, args.count_max))
        .collect::<Result<Vec<_>, _>>()?;
    let opened = backend::open_all(args.backend, 0)?;
    let is_compared = |opened: &&OpenBackend| {
        args.backend.is_some() || matches!(opened.backend, Backend::Cpu | Backend::Gpu)
    };
    let mut backends = Vec::new();
    for opened in opened.iter().filter(is_compared) {
        for clouds in &mut clouds {
            backends.push(sweep(opened, clouds, args)?);
        }
    }
    let mut build = Vec::new();
    for clouds in &clouds {
        for (count, scene) in &clouds.scenes {
            build.push(time_build(clouds.shape, *count, scene, args));
        }
    }
    let report = BvhReport { build, backends };
    if args.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(())
}

impl ShapeClouds {
    fn new(shape: SweptShape, count_max: u32) -> Result<Self, carom_tracer::Error> {
        let counts = COUNTS.into_iter().filter(|count| *count <= count_max);
        let scenes = counts.map(|count| Ok((count, CompiledScene::new(&cloud(shape, count))?)));
        Ok(Self {
            shape,
            scenes: scenes.collect::<Result<_, carom_tracer::Error>>()?,
        })
    }
}

fn sweep(
    opened: &OpenBackend,
    clouds: &mut ShapeClouds,
    args: &Args,
) -> Result<BvhSweep, BenchError> {
    let tracer = opened.tracer.as_ref();
    let shape = clouds.shape;
    let mut rows = Vec::new();
    for (count, scene) in &mut clouds.scenes {
        match compare(tracer, *count, scene, args) {
            Ok(row) => rows.push(row),
            // Not every device can test this many without a BVH.
            Err(error) if !rows.is_empty() => {
                let name = shape.name();
                eprintln!("{count} {name} are not compared there: {error}");
                break;
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(BvhSweep {
        backend: opened.backend.name(),
        shape,
        crossing: crossing(&rows),
        rows,
    })
}

fn compare(
    tracer: &dyn Tracer,
    count: u32,
    scene: &mut CompiledScene,
    args: &Args,
) -> Result<BvhRow, carom_tracer::Error> {
    backend::wake(tracer, || {
        picture(tracer, scene, BvhUse::Always, args).map(|_| ())
    })?;
    let mut least = [f64::INFINITY; 2];
    // The first turn compiles kernels and fills caches.
    for turn in 0..=args.repetitions {
        for (bvh_use, least) in [BvhUse::Never, BvhUse::Always].iter().zip(&mut least) {
            let milliseconds = picture(tracer, scene, *bvh_use, args)?;
            if turn > 0 {
                *least = least.min(milliseconds);
            }
        }
    }
    let [each_milliseconds, bvh_milliseconds] = least;
    Ok(BvhRow {
        count,
        each_milliseconds,
        bvh_milliseconds,
    })
}

fn crossing(rows: &[BvhRow]) -> Option<u32> {
    let is_faster = |row: &&BvhRow| row.bvh_milliseconds < row.each_milliseconds;
    let faster = rows.iter().rev().take_while(is_faster);
    faster.last().map(|row| row.count)
}

/// Time in ms of a picture after an update, with the build of the BVHs.
fn picture(
    tracer: &dyn Tracer,
    scene: &mut CompiledScene,
    bvh_use: BvhUse,
    args: &Args,
) -> Result<f64, carom_tracer::Error> {
    scene.bvh_use = bvh_use;
    scene.apply(&SceneUpdate::default())?;
    let begun = ProcessTime::now();
    for shape in ShapeKind::ALL {
        scene.bvh(shape, usize::MAX);
    }
    let built = begun.elapsed().as_secs_f64() * 1e3;
    Ok(built + timing::milliseconds(tracer, scene, args.size, args.spp)?)
}

fn time_build(shape: SweptShape, count: u32, scene: &CompiledScene, args: &Args) -> BuildTimes {
    let mut least = BuildTimes {
        shape,
        count,
        cpu_milliseconds: f64::INFINITY,
        milliseconds: f64::INFINITY,
    };
    for _ in 0..=args.repetitions {
        let (wall, core) = (Instant::now(), ProcessTime::now());
        black_box(scene.build_bvh(shape.kind()));
        let (wall, core) = (wall.elapsed(), core.elapsed());
        least.milliseconds = least.milliseconds.min(wall.as_secs_f64() * 1e3);
        least.cpu_milliseconds = least.cpu_milliseconds.min(core.as_secs_f64() * 1e3);
    }
    least
}

fn print(report: &BvhReport) {
    for swept in &report.backends {
        let name = swept.shape.name();
        println!("{}, milliseconds a picture", swept.backend);
        println!(
            "{name:>10} {:>10} {:>10} {:>12}",
            "each", "BVH", "each / BVH"
        );
        for row in &swept.rows {
            println!(
                "{:>10} {:>10.2} {:>10.2} {:>12.3}",
                row.count,
                row.each_milliseconds,
                row.bvh_milliseconds,
                row.each_milliseconds / row.bvh_milliseconds
            );
        }
        match swept.crossing {
            Some(count) => println!("the BVH is faster from {count} {name} on"),
            None => println!("the BVH is not faster"),
        }
    }
    println!("building the BVH: of how many, milliseconds of CPU time, and on all threads");
    for build in &report.build {
        let BuildTimes {
            shape,
            count,
            cpu_milliseconds,
            milliseconds,
        } = build;
        let name = shape.name();
        println!("{count:>8} {name:<10} {cpu_milliseconds:>10.3} {milliseconds:>10.3}");
    }
}

/// Primitive `i` of a cloud, whose total volume or area does not depend on the number.
fn shape(many: SweptShape, count: u32, i: u32) -> Shape {
    let body = 0.25 * (4.0 / count as f32).cbrt();
    let flat = 0.4 * (4.0 / count as f32).sqrt();
    let [x, y, z, turn] = sampling::uniforms(i, count, 0, 0);
    let normal = Quat::from_euler(EulerRot::XYZ, 6.0 * turn, 9.0 * x, 0.0) * Vec3::Z;
    let [u, v] = <[Vec3; 2]>::from(normal.any_orthonormal_pair());
    let place = |half: f32| Vec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, half + z);
    match many {
        SweptShape::Balls => Shape::Sphere {
            center: place(body),
            radius: body,
            rotation: Quat::IDENTITY,
        },
        SweptShape::Boxes => Shape::Box {
            min: place(body) - 0.8 * body,
            max: place(body) + 0.8 * body,
        },
        SweptShape::Discs => Shape::Disc {
            center: place(flat),
            normal,
            radius: flat,
        },
        SweptShape::Rectangles => Shape::Rectangle {
            center: place(flat),
            half_u: flat * u,
            half_v: 0.8 * flat * v,
        },
        SweptShape::Triangles => {
            let corners = [u, v, -u - v].map(|corner| flat * corner);
            Mesh::new(corners.into(), vec![[0, 1, 2]])
                .at(place(flat))
                .into()
        }
    }
}

/// A scene of primitives at random places over a floor.
fn cloud(many: SweptShape, count: u32) -> Scene {
    let colours = [
        Vec3::new(0.7, 0.1, 0.05),
        Vec3::new(0.75, 0.6, 0.1),
        Vec3::new(0.1, 0.2, 0.6),
    ];
    let materials = (0..)
        .zip(colours)
        .map(|(i, c)| (format!("plastic {i}"), Material::plastic(c)));
    let mut materials: BTreeMap<String, Material> = materials.collect();
    materials.insert("floor".to_owned(), Material::diffuse([0.2, 0.5, 0.3]));
    let object = |i: u32| Object {
        name: String::new(),
        material: format!("plastic {}", i % 3),
        shape: shape(many, count, i),
    };
    let floor = Object {
        name: "floor".to_owned(),
        material: "floor".to_owned(),
        shape: Shape::Box {
            min: Vec3::new(-3.0, -3.0, -0.1),
            max: Vec3::new(3.0, 3.0, 0.0),
        },
    };
    Scene {
        camera: Camera {
            eye: Vec3::new(0.0, -3.5, 1.8),
            target: Vec3::new(0.0, 0.0, 0.4),
            up: Vec3::Z,
            fov_x_deg: 50.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::new(0.3, 0.35, 0.4),
        },
        materials,
        objects: (0..count).map(object).chain([floor]).collect(),
        area_lights: vec![AreaLight {
            name: "lamp".to_owned(),
            center: Vec3::new(0.0, 0.0, 3.0),
            half_u: Vec3::X,
            half_v: Vec3::NEG_Y,
            radiance: Vec3::splat(6.0),
            ..AreaLight::new(1.0, 1.0)
        }],
        ..Scene::new()
    }
}

const COUNTS: [u32; 16] = [
    8, 16, 32, 48, 64, 96, 128, 192, 256, 512, 1024, 4096, 10_000, 16_384, 65_536, 100_000,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crossing_is_where_the_bvh_stays_faster() {
        let row = |(count, bvh_milliseconds): (u32, f64)| BvhRow {
            count,
            each_milliseconds: 2.0,
            bvh_milliseconds,
        };
        let crossing = |rows: &[(u32, f64)]| {
            let rows: Vec<BvhRow> = rows.iter().copied().map(row).collect();
            crossing(&rows)
        };
        assert_eq!(
            crossing(&[(8, 3.0), (16, 1.0), (32, 3.0), (64, 1.0), (96, 1.0)]),
            Some(64)
        );
        assert_eq!(crossing(&[(8, 1.0), (16, 1.0)]), Some(8));
        assert_eq!(crossing(&[(8, 1.0), (16, 2.0)]), None);
    }

    #[test]
    fn clouds_are_scenes_up_to_the_largest() {
        for shape in <SweptShape as clap::ValueEnum>::value_variants() {
            for count in [COUNTS[0], COUNTS[COUNTS.len() - 1]] {
                let scene = CompiledScene::new(&cloud(*shape, count)).unwrap();
                assert_eq!(scene.primitives.len(), count as usize + 1, "{shape:?}");
                let leaves = scene.build_bvh(shape.kind()).unwrap().nodes.len() + 1;
                assert!(leaves >= count as usize / 4, "{shape:?}");
            }
        }
    }
}
