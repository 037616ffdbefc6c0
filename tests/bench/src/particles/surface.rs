//! Cost of the surfaces of jelly and water, compared with the same particles as beads.

use anyhow::Context as _;
use carom::camera::Viewpoint;
use carom::particles::BedMoment;
use carom::play::tricks::TrickTable;
use carom::scene::ball_materials::BallSet;
use carom::scene::table_scene::TableScene;
use carom_billiards::physics::{ParticlePrecision, Table};
use carom_farm::backend;
use carom_tracer::compiled::ShapeKind;
use carom_tracer::{CompiledScene, Material, ParticleCloud, ParticleForm, SceneUpdate};

use super::picture::PictureArgs;
use crate::BenchError;
use crate::timing::{best_ms, milliseconds};

pub(super) fn run(args: &PictureArgs) -> Result<(), BenchError> {
    let room = TableScene::room(BallSet::Classic);
    let table = Table::nine_foot();
    let mut scene = CompiledScene::new(room.scene())?;
    println!(
        "{:<14} {:>5} {:>9} {:>9} {:>10} {:>10} {:>8} {:<8} {:>9} {:>9}",
        "trick",
        "t s",
        "particles",
        "triangles",
        "surface ms",
        "per 10,000",
        "tree ms",
        "backend",
        "bead ms",
        "frame ms"
    );
    for trick in [TrickTable::JellyBumper, TrickTable::SpilledDrink] {
        let precision = ParticlePrecision::Standard;
        let (world, stroke) = trick.world(&table, precision).context("the trick table")?;
        let shot = world.strike(stroke).context("the shot")?;
        let track = shot.particles().context("the particles of the shot")?;
        let cue_ball = shot.poses_at(0.0)[0].position;
        let camera = Viewpoint::behind(cue_ball, 0.0).camera();
        for secs in [0.0, 0.3, 1.0] {
            let bodies = BedMoment::Moving(track.clone(), secs).clouds(room.cloth_albedo());
            let particles: usize = bodies.iter().map(|cloud| cloud.places.len()).sum();
            let base = room.update(camera, &shot.poses_at(secs), None);
            let as_bodies = base.clone().particles(bodies.clone());
            let as_beads = base.particles(beads(bodies));
            let none = SceneUpdate::default();
            let apply_ms = best_ms(args.repetitions, || {
                scene.apply(&none).expect("a valid update");
                scene.apply(&as_bodies).expect("a valid update");
            });
            let triangles = scene.meshes.triangles.iter().filter(|t| t.b != t.c).count();
            let tree_ms = best_ms(args.repetitions, || {
                drop(scene.build_bvh(ShapeKind::Triangle));
            });
            let per_10_000 = apply_ms * 1e4 / particles as f64;
            for opened in backend::open_all(args.backend, 0)? {
                let tracer = opened.tracer.as_ref();
                let mut best = [f64::INFINITY; 2];
                // The first of each compiles kernels.
                for turn in 0..=args.repetitions {
                    for (update, best) in [&as_beads, &as_bodies].into_iter().zip(&mut best) {
                        scene.apply(update)?;
                        let ms = milliseconds(tracer, &scene, args.size, args.spp)?;
                        if turn > 0 {
                            *best = best.min(ms);
                        }
                    }
                }
                println!(
                    "{:<14} {secs:>5} {particles:>9} {triangles:>9} {apply_ms:>10.2} {per_10_000:>10.2} {tree_ms:>8.2} {:<8} {:>9.1} {:>9.1}",
                    format!("{trick:?}"),
                    opened.backend.name(),
                    best[0],
                    best[1],
                );
            }
        }
    }
    Ok(())
}

/// The same particles as glossy touching balls.
fn beads(clouds: Vec<ParticleCloud>) -> Vec<ParticleCloud> {
    let beads = clouds.into_iter().map(|cloud| ParticleCloud {
        material: Material::plastic([0.12, 0.28, 0.36]),
        form: ParticleForm::Balls,
        ..cloud
    });
    beads.collect()
}
