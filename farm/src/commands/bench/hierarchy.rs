//! `carom-farm bench hierarchy`: from how many balls on a tree is faster than each ball by itself.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::Context;
use carom_tracer::compiled::Hierarchy;
use carom_tracer::{
    Camera, CompiledScene, Environment, ImageSize, Lamp, Material, Object, Scene, SceneUpdate,
    Shape, Tracer, sampling,
};
use cpu_time::ProcessTime;
use glam::{Quat, Vec3};
use serde::Serialize;

use crate::commands::Failure;
use crate::commands::backend::{self, Backend, Opened};

/// From how many balls on a tree is faster than each ball by itself.
///
/// Clouds of 8 to 100,000 balls that fill the same room are traced with and without the tree, which
/// is built anew for each picture as it is when balls move. Printed are the time of a picture, CPU
/// time of this process on a processor, the device's own and that of building the tree on a GPU that
/// tells it, and the crossing: the fewest balls from which on the tree was faster.
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
    /// The most balls.
    #[arg(long, default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(8..=100_000))]
    balls_max: u32,
    /// Turns; the best of each is taken.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
}

#[derive(Serialize)]
struct Report {
    build: Vec<Build>,
    backends: Vec<Swept>,
}

/// Of a tree, on all threads.
#[derive(Serialize)]
struct Build {
    balls: u32,
    cpu_milliseconds: f64,
    milliseconds: f64,
}

#[derive(Serialize)]
struct Swept {
    backend: &'static str,
    /// The fewest balls from which on the tree was faster.
    crossing: Option<u32>,
    rows: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    balls: u32,
    each_milliseconds: f64,
    tree_milliseconds: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let counts = COUNTS.into_iter().filter(|count| *count <= args.balls_max);
    let mut scenes = Vec::new();
    for count in counts {
        scenes.push((count, CompiledScene::new(&cloud(count))?));
    }
    let opened = backend::open_all(args.backend, 0)?;
    let is_compared = |opened: &&Opened| {
        args.backend.is_some() || matches!(opened.backend, Backend::Cpu | Backend::Gpu)
    };
    let mut backends = Vec::new();
    for opened in opened.iter().filter(is_compared) {
        backends.push(sweep(opened, &mut scenes, args)?);
    }
    let build = scenes
        .iter_mut()
        .map(|(balls, scene)| build(*balls, scene, args))
        .collect::<Result<_, _>>()?;
    let report = Report { build, backends };
    if args.json {
        let json = serde_json::to_string(&report).context("results as JSON")?;
        println!("{json}");
    } else {
        print(&report);
    }
    Ok(())
}

fn sweep(
    opened: &Opened,
    scenes: &mut [(u32, CompiledScene)],
    args: &Args,
) -> Result<Swept, Failure> {
    let tracer = opened.tracer.as_ref();
    let mut rows = Vec::new();
    for (balls, scene) in scenes {
        match compare(tracer, *balls, scene, args) {
            Ok(row) => rows.push(row),
            // Not every device can test so many.
            Err(error) if !rows.is_empty() => {
                eprintln!("{balls} balls are not compared there: {error}");
                break;
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok(Swept {
        backend: opened.backend.name(),
        crossing: crossing(&rows),
        rows,
    })
}

fn compare(
    tracer: &dyn Tracer,
    balls: u32,
    scene: &mut CompiledScene,
    args: &Args,
) -> Result<Row, carom_tracer::Error> {
    backend::wake(tracer, || {
        picture(tracer, scene, Hierarchy::Always, args).map(|_| ())
    })?;
    let mut least = [f64::INFINITY; 2];
    // The first turn compiles kernels and fills caches.
    for turn in 0..=args.repetitions {
        for (hierarchy, least) in [Hierarchy::Never, Hierarchy::Always].iter().zip(&mut least) {
            let milliseconds = picture(tracer, scene, *hierarchy, args)?;
            if turn > 0 {
                *least = least.min(milliseconds);
            }
        }
    }
    let [each_milliseconds, tree_milliseconds] = least;
    Ok(Row {
        balls,
        each_milliseconds,
        tree_milliseconds,
    })
}

fn crossing(rows: &[Row]) -> Option<u32> {
    let is_faster = |row: &&Row| row.tree_milliseconds < row.each_milliseconds;
    let faster = rows.iter().rev().take_while(is_faster);
    faster.last().map(|row| row.balls)
}

/// Milliseconds of a picture whose balls have moved.
fn picture(
    tracer: &dyn Tracer,
    scene: &mut CompiledScene,
    hierarchy: Hierarchy,
    args: &Args,
) -> Result<f64, carom_tracer::Error> {
    scene.hierarchy = hierarchy;
    scene.apply(&SceneUpdate::default())?;
    let begun = ProcessTime::now();
    scene.ball_tree(usize::MAX);
    let built = begun.elapsed().as_secs_f64() * 1e3;
    Ok(built + backend::milliseconds(tracer, scene, args.size, args.spp)?)
}

fn build(balls: u32, scene: &mut CompiledScene, args: &Args) -> Result<Build, Failure> {
    scene.hierarchy = Hierarchy::Always;
    let mut least = Build {
        balls,
        cpu_milliseconds: f64::INFINITY,
        milliseconds: f64::INFINITY,
    };
    for _ in 0..=args.repetitions {
        scene.apply(&SceneUpdate::default())?;
        let (wall, core) = (Instant::now(), ProcessTime::now());
        scene.ball_tree(0);
        let (wall, core) = (wall.elapsed(), core.elapsed());
        least.milliseconds = least.milliseconds.min(wall.as_secs_f64() * 1e3);
        least.cpu_milliseconds = least.cpu_milliseconds.min(core.as_secs_f64() * 1e3);
    }
    Ok(least)
}

fn print(report: &Report) {
    for swept in &report.backends {
        println!("{}, milliseconds a picture", swept.backend);
        println!(
            "{:>8} {:>10} {:>10} {:>12}",
            "balls", "each", "tree", "each / tree"
        );
        for row in &swept.rows {
            println!(
                "{:>8} {:>10.2} {:>10.2} {:>12.3}",
                row.balls,
                row.each_milliseconds,
                row.tree_milliseconds,
                row.each_milliseconds / row.tree_milliseconds
            );
        }
        match swept.crossing {
            Some(balls) => println!("the tree is faster from {balls} balls on"),
            None => println!("the tree is not faster"),
        }
    }
    println!("building the tree: balls, milliseconds of CPU time, and on all threads");
    for build in &report.build {
        let Build {
            balls,
            cpu_milliseconds,
            milliseconds,
        } = build;
        println!("{balls:>8} {cpu_milliseconds:>10.3} {milliseconds:>10.3}");
    }
}

/// Balls here and there over a floor, all together always of the same volume.
fn cloud(balls: u32) -> Scene {
    let radius = 0.25 * (4.0 / balls as f32).cbrt();
    let plastic = |albedo| Material::SmoothPlastic {
        albedo,
        ior: 1.5,
        internal_reflectance: None,
        stripe: None,
    };
    let colours = [
        Vec3::new(0.7, 0.1, 0.05),
        Vec3::new(0.75, 0.6, 0.1),
        Vec3::new(0.1, 0.2, 0.6),
    ];
    let materials = (0..)
        .zip(colours)
        .map(|(i, c)| (format!("plastic {i}"), plastic(c)));
    let mut materials: BTreeMap<String, Material> = materials.collect();
    let albedo = Vec3::new(0.2, 0.5, 0.3);
    materials.insert("floor".to_owned(), Material::Diffuse { albedo });
    let ball = |i: u32| {
        let [x, y, z, _] = sampling::uniforms(i, balls, 0, 0);
        Object {
            name: String::new(),
            material: format!("plastic {}", i % 3),
            shape: Shape::Sphere {
                center: Vec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, radius + z),
                radius,
                rotation: Quat::IDENTITY,
            },
        }
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
        },
        environment: Environment {
            radiance: Vec3::new(0.3, 0.35, 0.4),
        },
        materials,
        objects: (0..balls).map(ball).chain([floor]).collect(),
        lamps: vec![Lamp {
            name: "lamp".to_owned(),
            center: Vec3::new(0.0, 0.0, 3.0),
            half_u: Vec3::X,
            half_v: Vec3::NEG_Y,
            radiance: Vec3::splat(6.0),
        }],
    }
}

const COUNTS: [u32; 16] = [
    8, 16, 32, 48, 64, 96, 128, 192, 256, 512, 1024, 4096, 10_000, 16_384, 65_536, 100_000,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_crossing_is_where_the_tree_begins_to_stay_faster() {
        let row = |(balls, tree_milliseconds): (u32, f64)| Row {
            balls,
            each_milliseconds: 2.0,
            tree_milliseconds,
        };
        let crossing = |rows: &[(u32, f64)]| {
            let rows: Vec<Row> = rows.iter().copied().map(row).collect();
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
        for count in [COUNTS[0], COUNTS[COUNTS.len() - 1]] {
            let scene = CompiledScene::new(&cloud(count)).unwrap();
            assert_eq!(scene.spheres.len(), count as usize);
        }
    }
}
