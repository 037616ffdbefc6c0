//! Pictures of the pool room, and what they cost against the bare table of the tests.
//!
//! ```text
//! cargo run --release -p carom --example room -- [VIEW [SET [SAMPLES [WIDTHxHEIGHT [picture.png]]]]]
//! ```
//!
//! `VIEW` is `player`, `overview`, `rack`, `ball`, `pocket` or `low`, or the whole table of `snooker` or
//! `carom`; `SET` one of `carom --ball-set`.
//! Both scenes are traced by this machine's processor in the same run, so that their ratio holds on
//! a busy machine too.

use std::error::Error;
use std::sync::atomic::AtomicBool;

use carom::scene::ball_materials::BallSet;
use carom::scene::export::{SceneView, opening_scene};
use carom::scene::table_args::TableArgs;
use carom::scene::table_scene::TableScene;
use carom_billiards::rules::RuleSet;
use carom_tracer::film::trace_image;
use carom_tracer::{
    Camera, CompiledScene, CpuTracer, ImageSize, Lens, RenderSettings, Scene, Tile, TraceJob,
    Tracer,
};
use clap::ValueEnum as _;
use cpu_time::ProcessTime;
use glam::Vec3;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let view = arguments.next().unwrap_or_else(|| "player".to_owned());
    let set = BallSet::from_str(arguments.next().as_deref().unwrap_or("classic"), true)?;
    let samples: u32 = arguments.next().as_deref().unwrap_or("16").parse()?;
    let size: ImageSize = arguments.next().as_deref().unwrap_or("640x360").parse()?;

    let tracer = CpuTracer::new()?;
    let mut scene = match view.as_str() {
        "snooker" => opening_scene(
            &TableArgs::default(),
            RuleSet::Snooker,
            set.into(),
            SceneView::Table,
            1,
        )?,
        "carom" => opening_scene(
            &TableArgs::default(),
            RuleSet::ThreeCushion,
            set.into(),
            SceneView::Table,
            1,
        )?,
        _ => TableScene::room(set).scene().clone(),
    };
    if !matches!(view.as_str(), "snooker" | "carom") {
        scene.camera = camera(&view)?;
    }
    let room = CompiledScene::new(&scene)?;
    let settings = RenderSettings {
        samples,
        max_depth: set.max_depth(),
        ..RenderSettings::default()
    };
    if let Some(path) = arguments.next() {
        let image = trace_image(&tracer, &room, size, settings)?.image();
        image.write_png(path, 1.0)?;
    }

    let pool = Scene::from_json(include_str!("../../assets/scenes/pool.json"))?;
    let pool = CompiledScene::new(&pool)?;
    let ours = samples_per_sec(&tracer, &room, settings)?;
    let bare = samples_per_sec(&tracer, &pool, RenderSettings::default())?;
    println!(
        "{view}, {set:?}: {:.2} Msample per core-second, {:.2} of the bare table's {:.2}",
        ours * 1e-6,
        ours / bare,
        bare * 1e-6
    );
    Ok(())
}

/// Paths per second of processor time for a picture of 640×360.
fn samples_per_sec(
    tracer: &CpuTracer,
    scene: &CompiledScene,
    settings: RenderSettings,
) -> Result<f64, Box<dyn Error>> {
    let size = ImageSize::new(640, 360);
    let tile = Tile {
        x: 0,
        y: 0,
        width: size.width,
        height: size.height,
    };
    let job = TraceJob {
        size,
        tiles: &[tile],
        settings: RenderSettings {
            samples: 4,
            ..settings
        },
        cancelled: &AtomicBool::new(false),
    };
    let begun = ProcessTime::now();
    let stats = tracer.trace(scene, &job, &|_| {})?;
    Ok(stats.samples as f64 / begun.elapsed().as_secs_f64())
}

fn camera(view: &str) -> Result<Camera, String> {
    let (eye, target, fov_x_deg) = match view {
        "player" => ([-2.02, -0.3, 0.56], [-0.25, 0.0, 0.0], 44.0),
        "overview" => ([-2.6, -2.4, 0.93], [0.0, 0.0, -0.1], 48.0),
        "rack" => ([0.15, -0.28, 0.2], [0.72, 0.0, 0.02], 36.0),
        "ball" => ([0.52, -0.1, 0.075], [0.66, 0.0, 0.025], 40.0),
        "pocket" => ([0.85, 0.3, 0.28], [1.3, 0.66, 0.0], 34.0),
        "low" => ([-3.9, 2.9, 0.35], [0.2, 0.0, 0.0], 52.0),
        _ => {
            return Err(format!(
                "there is no view `{view}`: choose player, overview, rack, ball, pocket, low, snooker \
                 or carom"
            ));
        }
    };
    Ok(Camera {
        eye: Vec3::from_array(eye),
        target: Vec3::from_array(target),
        up: Vec3::Z,
        fov_x_deg,
        lens: Lens::default(),
        near_m: 0.0,
    })
}
