//! The bench of a farm's first frames on real processes: no node's speed is known yet, and they become
//! ready one after the other.

use std::path::{Path, PathBuf};
use std::time::Instant;

use carom::scene::ball_materials::BallSet;
use carom::scene::table_scene::TableScene;
use carom_farm::{Farm, FarmConfig, LocalNode, PrecisionRange};
use carom_tracer::Scene;
use serde::Serialize;

use crate::cluster::process::{RunningProcess, farm_folder};
use crate::scenes;
use crate::timing::median;
use crate::wait::WaitArgs;
use crate::{BenchError, met, print_json};

/// Compare the first frames of many nodes of one thread with those of one node of as many threads.
///
/// Each node is a process of this machine, called as a game calls it: frames are asked for from the
/// start, whoever is ready. Pairs of runs follow each other, and each pair's ratio is printed; what the
/// machine does beside it disturbs single pairs.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Nodes of one thread each.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(2..=64))]
    nodes: u16,
    /// Frames of a run.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// Pixels across; the picture is 16:9.
    #[arg(long, default_value_t = 640, value_parser = clap::value_parser!(u32).range(16..=3840))]
    width: u32,
    /// Samples a pixel.
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=4096))]
    spp: u32,
    /// Pairs of runs.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(1..=100))]
    pairs: u8,
    /// Trace this scene file in place of the game's room.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    wait: WaitArgs,
}

#[derive(Serialize)]
struct FirstFrames {
    one_secs: f64,
    many_secs: f64,
    ratio: f64,
    /// Number of repeated requests per tile of the many nodes.
    reissued_per_tile: f64,
    /// Those of them whose node was considered lost.
    lost_per_tile: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let scene = match &args.scene {
        Some(path) => scenes::scene(Some(path))?.scene,
        None => TableScene::room(BallSet::Classic).scene().clone(),
    };
    let folder = farm_folder()?;
    let pair = |_| -> Result<FirstFrames, BenchError> {
        let one = play(args, &scene, folder.path(), 1, args.nodes)?;
        let many = play(args, &scene, folder.path(), args.nodes, 1)?;
        let per_tile = |tiles| f64::from(tiles) / f64::from(many.tiles.max(1));
        Ok(FirstFrames {
            one_secs: one.secs,
            many_secs: many.secs,
            ratio: many.secs / one.secs,
            reissued_per_tile: per_tile(many.reissued),
            lost_per_tile: per_tile(many.lost),
        })
    };
    let pairs: Vec<FirstFrames> = (0..args.pairs).map(pair).collect::<Result<_, _>>()?;
    if args.json {
        print_json(&pairs)?;
        return Ok(());
    }
    let (nodes, frames) = (args.nodes, args.frames);
    println!(
        "one node s  {nodes} nodes s  ratio  requested again, per tile  of it, taken for lost"
    );
    for pair in &pairs {
        let FirstFrames {
            one_secs,
            many_secs,
            ratio,
            reissued_per_tile,
            lost_per_tile,
        } = pair;
        println!(
            "{one_secs:>10.2}  {many_secs:>9.2}  {ratio:>5.2}  {reissued_per_tile:>25.2}  {lost_per_tile:>21.2}"
        );
    }
    let ratio = median(pairs.iter().map(|pair| pair.ratio));
    let again = pairs.iter().map(|pair| pair.reissued_per_tile);
    let again = again.fold(0.0, f64::max);
    let met = met(ratio <= RATIO_MAX && again < 1.0);
    println!(
        "{met}: the first {frames} frames take {ratio:.2} times as long (at most {RATIO_MAX}), and a \
         tile is requested again {again:.2} times (below 1)"
    );
    Ok(())
}

/// Result of the first frames of a farm.
struct Opening {
    secs: f64,
    tiles: u32,
    reissued: u32,
    lost: u32,
}

/// Starts nodes and a farm, and waits for its first frames.
fn play(
    args: &Args,
    scene: &Scene,
    folder: &Path,
    nodes: u16,
    threads: u16,
) -> Result<Opening, BenchError> {
    let start = |index| RunningProcess::start(folder, usize::from(index), threads, 1.0);
    let nodes: Vec<RunningProcess> = (0..nodes).map(start).collect::<Result<_, _>>()?;
    let begun = Instant::now();
    let mut farm = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: nodes.iter().map(|node| node.address.to_string()).collect(),
        credentials: folder.to_owned(),
        precision: PrecisionRange::EXACT,
        ..FarmConfig::default()
    })?;
    farm.set_scene(scene)?;
    let size = scenes::wide(args.width);
    let (mut submitted, mut tiles, mut reissued, mut lost) = (0, 0, 0, 0);
    for _ in 0..args.frames {
        while submitted < args.frames && farm.in_flight() < FRAMES_IN_FLIGHT {
            // Each frame differs from its neighbours.
            farm.submit(scenes::frame(size, args.spp, submitted))?;
            submitted += 1;
        }
        let frame = args.wait.frame(&mut farm)?;
        reissued += frame.stats.reissued_tiles;
        lost += frame.stats.lost_tiles;
        tiles += frame.stats.tiles_by_node.iter().sum::<u32>();
    }
    Ok(Opening {
        secs: begun.elapsed().as_secs_f64(),
        tiles,
        reissued,
        lost,
    })
}

/// Frames in flight, as in the game without a display.
const FRAMES_IN_FLIGHT: usize = 3;
/// Maximum ratio of the times of many nodes and of one.
const RATIO_MAX: f64 = 1.25;
