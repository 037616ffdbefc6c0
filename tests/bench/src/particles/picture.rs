//! Cost of dust in a picture of the game's room.

use carom::camera::Viewpoint;
use carom::particles::{ChalkPuff, ParticleDetail};
use carom::scene::ball_materials::BallSet;
use carom::scene::table_scene::TableScene;
use carom_billiards::physics::{Stroke, World};
use carom_farm::backend::{self, Backend};
use carom_tracer::{CompiledScene, ImageSize};
use clap::ValueEnum as _;

use crate::BenchError;
use crate::timing::{best_ms, milliseconds};

#[derive(clap::Args)]
pub(super) struct PictureArgs {
    /// Only this back end [default: all].
    #[arg(long)]
    pub(super) backend: Option<Backend>,
    /// Pixels.
    #[arg(long, default_value = "1280x720")]
    pub(super) size: ImageSize,
    /// Samples per pixel.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub(super) spp: u32,
    /// Turns; the best of each is taken.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(super) repetitions: u32,
}

pub(super) fn run(args: &PictureArgs) -> Result<(), BenchError> {
    let room = TableScene::room(BallSet::Classic);
    let table = room.table_inside();
    let world = World::new(table.clone(), table.rack_eight(1)).map_err(anyhow::Error::from)?;
    let shot = world
        .strike(Stroke::straight(0.0, 6.0))
        .map_err(anyhow::Error::from)?;
    let puff = ChalkPuff::new(&shot);
    let cue_ball = shot.poses_at(0.0)[0].position;
    let camera = Viewpoint::behind(cue_ball, 0.0).camera();
    let mut scene = CompiledScene::new(room.scene())?;
    println!(
        "{:<8} {:<6} {:>6} {:>10} {:>9} {:>9} {:>9}",
        "backend", "dust", "t s", "particles", "ms", "apply ms", "tree ms"
    );
    for opened in backend::open_all(args.backend, 0)? {
        for secs in [0.05, 0.5] {
            for detail in ParticleDetail::value_variants() {
                let clouds = puff.clouds(secs, *detail);
                let particles: usize = clouds.iter().map(|cloud| cloud.places.len()).sum();
                let update = room
                    .update(camera, &shot.poses_at(secs), None)
                    .particles(clouds);
                let apply_ms = best_ms(args.repetitions, || {
                    scene.apply(&update).expect("a valid update");
                });
                let tree_ms = best_ms(args.repetitions, || {
                    drop(scene.build_bvh(carom_tracer::compiled::ShapeKind::Sphere));
                });
                let tracer = opened.tracer.as_ref();
                let mut turns = (0..=args.repetitions)
                    .map(|_| milliseconds(tracer, &scene, args.size, args.spp))
                    // The first turn compiles kernels.
                    .skip(1);
                let ms =
                    turns.try_fold(f64::INFINITY, |best, ms| Ok::<_, BenchError>(best.min(ms?)))?;
                println!(
                    "{:<8} {:<6} {secs:>6} {particles:>10} {ms:>9.1} {apply_ms:>9.3} {tree_ms:>9.3}",
                    opened.backend.name(),
                    format!("{detail:?}").to_lowercase(),
                );
            }
        }
    }
    Ok(())
}
