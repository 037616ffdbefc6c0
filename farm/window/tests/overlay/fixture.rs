//! Synthetic farm of five nodes: three hundred pictures, first divided into equal parts, then by the nodes'
//! speeds; the last node is lost.

use carom_farm::quality::{QUALITY_LEVELS, QualityPreference};
use carom_farm::{
    Algorithm, Balancing, Delivery, Distribution, FrameStats, LatencySplit, NodeIndex, NodeInfo,
    NodeState, NodeStatus,
};
use carom_tracer::sampling::uniforms;
use carom_tracer::{DeviceInfo, DeviceKind, ImageSize, TileGrid, TileRange};
use carom_window::stats::frame_record::FrameSample;
use carom_window::stats::{Stats, StatsInput, StatsLevel};

pub(crate) const SIZE: ImageSize = ImageSize::new(640, 360);
pub(crate) const PICTURES: u64 = 300;
/// The first picture for which the nodes' speeds are known.
pub(crate) const CHANGE: u64 = 200;
const EDGE: u16 = 16;
/// Name, device, A in seconds, and speed in million samples per second.
const NODES: [(&str, &str, f64, f64); 5] = [
    ("local", "CPU, 16 lanes of AVX2", 0.0002, 3.0),
    ("gpu-1", "NVIDIA H200", 0.0031, 40.0),
    ("gpu-2", "NVIDIA H200", 0.0042, 36.0),
    ("office, west", "AMD Radeon RX 7900 XTX", 0.0012, 22.0),
    ("gone", "Intel Arc A770", 0.0020, 12.0),
];

/// The nodes' status at the end.
pub(crate) fn nodes() -> Vec<NodeStatus> {
    let node = |&(name, device, fixed_secs, msamples_per_sec): &(&str, &str, f64, f64)| {
        let mut node = NodeStatus::new(format!("{name}.example:4433"));
        node.info = Some(NodeInfo {
            name: name.to_owned(),
            instance: 0,
            device: DeviceInfo {
                kind: DeviceKind::Gpu,
                name: device.to_owned(),
                width: 1,
                threads: 1,
            },
        });
        node.state = NodeState::Ready;
        (node.fixed_secs, node.fixed_error_secs) = (fixed_secs, 0.07 * fixed_secs);
        (node.msamples_per_sec, node.speed_error) = (msamples_per_sec, 0.03);
        node.tiles = 40_000;
        node
    };
    let mut nodes: Vec<NodeStatus> = NODES.iter().map(node).collect();
    nodes[1].state = NodeState::Rendering;
    nodes[4].state = NodeState::Lost {
        why: "its connection broke".to_owned(),
        retry_secs: Some(4),
    };
    nodes[4].lost_tiles = 37;
    nodes
}

pub(crate) fn input<'a>(nodes: &'a [NodeStatus]) -> StatsInput<'a> {
    StatsInput {
        nodes,
        balancing: Balancing::default(),
        distribution: Distribution::default(),
        preference: QualityPreference::default(),
        window: ImageSize::new(1280, 720),
        period_secs: 1.0 / 60.0,
        stop: QUALITY_LEVELS[6],
        level_secs: QUALITY_LEVELS.map(|stop| Some(0.011 * stop.cost())),
        lead_secs: 0.031,
        skipped: 3,
        disocclusion_fraction: Some(0.012),
        draw_secs: 0.0021,
        present: "llvmpipe",
    }
}

/// An overlay at this level that has received all pictures.
pub(crate) fn overlay(level: StatsLevel, folder: &std::path::Path) -> Stats {
    let mut stats = Stats::new(folder.to_path_buf());
    stats.set_level(level);
    for i in 0..PICTURES {
        take(&mut stats, i);
    }
    for i in 0..400 {
        let slow = if i % 90 == 0 { 0.021 } else { 0.0 };
        stats.note_redraw(f64::from(i) / 60.0 + slow, true);
    }
    stats
}

pub(crate) fn take(stats: &mut Stats, picture: u64) {
    stats.take(FrameSample {
        frame: picture,
        at_secs: picture as f64 / 48.0,
        size: SIZE,
        samples: 2,
        stats: frame(picture),
        nodes: &nodes(),
    });
}

fn noise(picture: u64, node: usize) -> f64 {
    f64::from(uniforms(picture as u32, node as u32, 7, 0)[0])
}

/// Tiles at the top of the picture cost half of those below.
fn tile_work(grid: TileGrid) -> Vec<f32> {
    let rows = grid.rows() as f32;
    let cost = |tile: u32| {
        let row = (tile / grid.columns()) as f32 / rows;
        let column = (tile % grid.columns()) as f32 / grid.columns() as f32;
        512.0 * (0.4 + row + 1.5 * (-40.0 * ((column - 0.6).powi(2) + (row - 0.6).powi(2))).exp())
    };
    (0..grid.len()).map(cost).collect()
}

fn frame(picture: u64) -> FrameStats {
    let grid = TileGrid::new(SIZE, EDGE);
    let is_equal = picture < CHANGE;
    let mut stats = FrameStats {
        balancing: if is_equal {
            Algorithm::Equal.unhedged()
        } else {
            Balancing::default()
        },
        raw_bytes: (SIZE.pixels() * 3) as u64,
        tile_edge: EDGE,
        tile_work: tile_work(grid),
        split_by_node: vec![LatencySplit::default(); NODES.len()],
        reissued_tiles: u32::from(picture == 150) * 37 + u32::from(picture.is_multiple_of(40)) * 4,
        lost_tiles: u32::from(picture == 150) * 37,
        ..FrameStats::default()
    };
    let there = if picture < 150 {
        NODES.len()
    } else {
        NODES.len() - 1
    };
    let work: f64 = stats.tile_work.iter().copied().map(f64::from).sum();
    let speeds = NODES[..there]
        .iter()
        .map(|node| if is_equal { 1.0 } else { node.3 });
    let speed: f64 = speeds.sum();
    let mut first = 0;
    for (node, &(_, _, fixed_secs, msamples)) in NODES[..there].iter().enumerate() {
        let share = work * if is_equal { 1.0 } else { msamples } / speed;
        let is_last = node + 1 == there;
        let mut dealt = 0.0;
        let begin = first;
        while first < grid.len() && (is_last || dealt < share) {
            dealt += f64::from(stats.tile_work[first as usize]);
            first += 1;
        }
        let pace = 1e-6 / msamples * (0.9 + 0.2 * noise(picture, node));
        let run = TileRange {
            first: begin,
            count: first - begin,
        };
        deliver(
            &mut stats,
            node,
            run,
            fixed_secs,
            pace,
            1e-6 / msamples * dealt,
        );
    }
    stats
        .deliveries
        .sort_by(|a, b| a.arrived_secs.total_cmp(&b.arrived_secs));
    stats.makespan_secs = stats
        .deliveries
        .iter()
        .map(|delivery| delivery.arrived_secs)
        .fold(0.0, f64::max);
    stats.payload_bytes = stats
        .deliveries
        .iter()
        .map(|delivery| u64::from(delivery.payload_bytes))
        .sum();
    stats
}

fn deliver(
    stats: &mut FrameStats,
    node: usize,
    run: TileRange,
    fixed_secs: f64,
    pace: f64,
    predicted: f64,
) {
    let (mut now, mut first) = (0.0001 + fixed_secs, run.first);
    while first < run.end() {
        let tiles = TileRange {
            first,
            count: 16.min(run.end() - first),
        };
        let work: f64 = tiles
            .indices()
            .map(|tile| f64::from(stats.tile_work[tile as usize]))
            .sum();
        let busy_secs = pace * work;
        now += busy_secs;
        let split = LatencySplit {
            request_secs: 0.0001,
            network_secs: 0.9 * fixed_secs,
            queue_secs: 0.02 * fixed_secs,
            trace_secs: now - 0.0001 - fixed_secs,
            encode_secs: 0.06 * fixed_secs,
            decode_secs: 0.02 * fixed_secs,
        };
        stats.split_by_node[node] = split;
        stats.deliveries.push(Delivery {
            node: NodeIndex(node),
            tiles,
            fresh_tiles: tiles.count,
            work,
            expected_secs: Some(0.0001 + fixed_secs + predicted),
            arrived_secs: now,
            busy_secs,
            split,
            payload_bytes: 190 * tiles.count,
        });
        first = tiles.end();
    }
}
