//! The bench of play: the game's own frame loop without a display, and where the time of a frame goes.

use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use carom::camera::Viewpoint;
use carom::frame::farm_startup::FarmState;
use carom::frame::pipeline::{FinishedFrame, FramePipeline};
use carom::frame::scheduler::ViewTarget;
use carom::scene::ball_materials::BallSet;
use carom::scene::table_scene::TableScene;
use carom_farm::net::interruption;
use carom_farm::quality::QualityLevel;
use carom_farm::{FarmConfig, FrameStats, LocalNode};
use carom_tracer::{ImageSize, SceneUpdate};
use cpu_time::{ProcessTime, ThreadTime};
use serde::Serialize;

use crate::BenchError;
use crate::timing::quantiles;

/// Frames of the room while the camera turns once in ten seconds, by the steps of the game's frame loop
/// and its own local node, as fast as they come.
///
/// The farm's stages are of a frame's last tiles, of several frames at once: "wait" until the device
/// begins, "trace", "tone map" to sRGB or the encoding for a network, "hand over" from the node to the
/// frame's buffer. The steps of the main thread follow: "poll" takes frames in, "choose" puts one on
/// show, "reproject" moves it to the present view, "present" copies it as a texture's upload does,
/// "request" asks for the next ones. The first tenth of the frames is not counted in these.
///
/// Of the start it prints the time until the first frame, the farm's own start included, and median and 95th percentile of the
/// times between the first 60 frames.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON in place of a table
    #[arg(long)]
    json: bool,
    /// Show this many frames
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    frames: u32,
    /// Set the window's size in pixels
    #[arg(long, default_value = "1280x720", value_name = "WIDTHxHEIGHT")]
    size: ImageSize,
    /// Trace this many samples per pixel at full size [default: as the game chooses]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1024))]
    spp: Option<u32>,
    /// Denoise the frames of --spp
    #[arg(long, requires = "spp")]
    denoise: bool,
    /// Trace on this: auto, cpu or gpu
    #[arg(long, default_value = "auto")]
    backend: LocalNode,
}

#[derive(Serialize)]
struct PlayReport {
    frames: u32,
    size: ImageSize,
    frames_per_sec: f64,
    /// Frames traced by the farm per second, of which not all are shown.
    traced_per_sec: f64,
    /// CPU time of all threads, per frame.
    cpu_ms: f64,
    /// CPU time of the main thread, per frame.
    main_cpu_ms: f64,
    /// Time from before the farm's start until the first frame.
    first_frame_ms: f64,
    /// Median and 95th percentile of the times between the first 60 frames.
    start_median_ms: f64,
    start_p95_ms: f64,
    stages: Vec<PlayStage>,
}

/// Time per frame in ms, and its share of all stages.
#[derive(Serialize)]
struct PlayStage {
    name: &'static str,
    ms: f64,
    share: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let report = PlayLoop::new(args)?.play(args)?;
    if args.json {
        let text = serde_json::to_string_pretty(&report);
        println!("{}", text.context("the report").map_err(BenchError::Run)?);
        return Ok(());
    }
    println!(
        "{} frames of a {}x{} window: {:.1} frames/s ({:.1} traced), CPU ms a frame: {:.2}, of the main thread {:.2}",
        report.frames,
        report.size.width,
        report.size.height,
        report.frames_per_sec,
        report.traced_per_sec,
        report.cpu_ms,
        report.main_cpu_ms
    );
    println!(
        "first frame after {:.0} ms; the first {START_FRAMES}: median {:.1} ms, 95th percentile {:.1} ms ({:.1} medians)",
        report.first_frame_ms,
        report.start_median_ms,
        report.start_p95_ms,
        report.start_p95_ms / report.start_median_ms
    );
    println!("{:<10} {:>9} {:>7}", "stage", "ms", "share");
    for PlayStage { name, ms, share } in &report.stages {
        println!("{name:<10} {ms:9.3} {:5.1} %", 100.0 * share);
    }
    Ok(())
}

/// The game's frames, and the time that each stage has taken.
struct PlayLoop {
    pipeline: FramePipeline,
    table_scene: TableScene,
    begun: Instant,
    /// Stands for the texture.
    texture: Vec<[u8; 4]>,
    secs: [f64; STAGES.len()],
    /// Number of frames that the farm has finished.
    traced: u32,
    /// Times at which the first frames were shown, in seconds since `begun`.
    start: Vec<f64>,
}

const STAGES: [&str; 9] = [
    "wait",
    "trace",
    "tone map",
    "hand over",
    "poll",
    "choose",
    "reproject",
    "present",
    "request",
];
/// Number of the farm's stages, which are averaged over the frames that it finishes.
const FARM_STAGES: usize = 4;

impl PlayLoop {
    fn new(args: &Args) -> Result<Self, BenchError> {
        let begun = Instant::now();
        if args.backend == LocalNode::None {
            return Err(BenchError::Input("--backend none traces nothing".into()));
        }
        let config = FarmConfig {
            local: args.backend,
            ..FarmConfig::default()
        };
        let set = BallSet::default();
        let table_scene = TableScene::room(set);
        let pipeline = FramePipeline::new(config, table_scene.scene(), set.max_depth());
        let mut pipeline = pipeline.map_err(BenchError::Run)?;
        pipeline.scheduler_mut().resize(args.size);
        if let Some(samples) = args.spp {
            pipeline.scheduler_mut().fix_quality(QualityLevel {
                scale: 1.0,
                samples,
                denoise: args.denoise,
            });
        }
        Ok(Self {
            pipeline,
            table_scene,
            begun,
            texture: vec![[0; 4]; args.size.pixels()],
            secs: [0.0; STAGES.len()],
            traced: 0,
            start: Vec::new(),
        })
    }

    fn play(mut self, args: &Args) -> Result<PlayReport, BenchError> {
        let interrupted = interruption().context("Ctrl-C").map_err(BenchError::Run)?;
        let warm_up = args.frames / 10;
        self.show(warm_up, &interrupted)?;
        self.secs = [0.0; STAGES.len()];
        self.traced = 0;
        let (wall, cpu, main_cpu) = (Instant::now(), ProcessTime::now(), ThreadTime::now());
        self.show(args.frames, &interrupted)?;
        let frames = f64::from(args.frames);
        let wall_secs = wall.elapsed().as_secs_f64();
        let per_frame = |(stage, secs): (usize, &f64)| match stage < FARM_STAGES {
            true => 1e3 * secs / f64::from(self.traced.max(1)),
            false => 1e3 * secs / frames,
        };
        let ms: Vec<f64> = self.secs.iter().enumerate().map(per_frame).collect();
        let sum: f64 = ms.iter().sum();
        let intervals_ms = self.start.windows(2).map(|two| 1e3 * (two[1] - two[0]));
        let [start_median_ms, start_p95_ms] = quantiles(intervals_ms, [0.5, 0.95]);
        let stage = |(name, ms): (&&'static str, f64)| PlayStage {
            name,
            ms,
            share: ms / sum,
        };
        Ok(PlayReport {
            frames: args.frames,
            size: args.size,
            frames_per_sec: frames / wall_secs,
            traced_per_sec: f64::from(self.traced) / wall_secs,
            cpu_ms: 1e3 * cpu.elapsed().as_secs_f64() / frames,
            main_cpu_ms: 1e3 * main_cpu.elapsed().as_secs_f64() / frames,
            first_frame_ms: 1e3 * self.start[0],
            start_median_ms,
            start_p95_ms,
            stages: STAGES.iter().zip(ms).map(stage).collect(),
        })
    }

    /// Runs the loop until this many frames have been shown.
    fn show(&mut self, frames: u32, interrupted: &AtomicBool) -> Result<(), BenchError> {
        let mut shown = 0;
        while shown < frames {
            if interrupted.load(Ordering::Relaxed) {
                return Err(BenchError::Interrupted);
            }
            match self.frame() {
                true => {
                    shown += 1;
                    if self.start.len() < START_FRAMES {
                        self.start.push(self.begun.elapsed().as_secs_f64());
                    }
                }
                // The game polls even less often; sleeping leaves the processor to the device.
                false => std::thread::sleep(POLL_PERIOD),
            }
            if let FarmState::Failed(why) = self.pipeline.farm() {
                return Err(BenchError::Run(anyhow::anyhow!("{why}")));
            }
        }
        Ok(())
    }

    /// One pass of the game's frame loop; returns whether it has shown a new frame.
    fn frame(&mut self) -> bool {
        let now_secs = self.begun.elapsed().as_secs_f64();
        let now = self.update(now_secs);
        let mut clock = Instant::now();
        let mut lap = || {
            std::mem::replace(&mut clock, Instant::now())
                .elapsed()
                .as_secs_f64()
        };
        let (secs, traced) = (&mut self.secs, &mut self.traced);
        let mut record = |frame: FinishedFrame| {
            *traced += 1;
            count_farm_stages(secs, &frame.stats);
        };
        self.pipeline.poll_farm(Some(&mut record));
        self.pipeline.accumulate();
        let poll = lap();
        self.pipeline.choose();
        let choose = lap();
        let is_new = self.pipeline.has_new_frame();
        let (mut reproject, mut present) = (0.0, 0.0);
        if is_new {
            self.pipeline.reproject(now_secs, &now);
            reproject = lap();
            if let Some(frame) = self.pipeline.displayed() {
                self.texture.clear();
                self.texture.extend_from_slice(&frame.rgba);
            }
            present = lap();
        }
        let target = ViewTarget::Live(now.clone());
        self.pipeline.request(now_secs, &target, &|_| now.clone());
        let steps = [poll, choose, reproject, present, lap()];
        for (sum, secs) in self.secs[FARM_STAGES..].iter_mut().zip(steps) {
            *sum += secs;
        }
        is_new
    }

    /// The table as seen by a camera that turns around it.
    fn update(&self, now_secs: f64) -> SceneUpdate {
        let table = self.table_scene.table_inside();
        let viewpoint = Viewpoint::overview(table, TAU * now_secs / TURN_SECS);
        self.table_scene.update(viewpoint.camera(), &[], None)
    }
}

fn count_farm_stages(secs: &mut [f64], stats: &FrameStats) {
    let Some(split) = stats.last_split() else {
        return;
    };
    secs[0] += split.request_secs + split.queue_secs;
    secs[1] += split.trace_secs;
    secs[2] += split.encode_secs;
    secs[3] += split.network_secs + split.decode_secs;
}

const START_FRAMES: usize = 60;
/// Period of the camera's turn around the table, in seconds.
const TURN_SECS: f64 = 10.0;
/// Interval between polls of the farm while there is no new frame.
const POLL_PERIOD: Duration = Duration::from_micros(100);
