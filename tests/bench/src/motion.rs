//! The bench of moving pictures: the error of frames by themselves, and accumulated over time.

use std::f64::consts::PI;

use anyhow::Context as _;
use carom::camera::Viewpoint;
use carom::capture::video::{ShotSequence, VideoView};
use carom::frame::reprojection::Reprojector;
use carom::scene::ball_materials::BallSet;
use carom::scene::scene_builder::EXPOSURE;
use carom::scene::table_scene::TableScene;
use carom_billiards::physics::{Stroke, World};
use carom_tracer::film::trace_image;
use carom_tracer::metrics::flip;
use carom_tracer::tonemap::srgb8;
use carom_tracer::{CompiledScene, CpuTracer, ImageSize, RenderSettings, SceneUpdate};
use carom_window::display::DisplayFrame;
use clap::Args;
use cpu_time::ProcessTime;
use serde::Serialize;

/// Measure the error of moving pictures against converged ones of the same moments.
///
/// The room, as 60 frames a second show it: while the camera turns around the table at 60 degrees a second, and during a
/// break. Each frame is traced and denoised, and then blended with those before it as the game does. Errors are mean FLIP of some
/// frames after the first ones; CPU times are of all threads, those of accumulation with the first hits that it needs. "at
/// equal time" is the error over that of a single frame of so many samples that it takes as long, interpolated between those measured.
#[derive(Clone, Debug, Args)]
pub(crate) struct MotionArgs {
    /// Print JSON in place of a table
    #[arg(long)]
    json: bool,
    /// Set the size of frames in pixels
    #[arg(long, default_value = "480x270", value_name = "WIDTHxHEIGHT")]
    size: ImageSize,
    /// Show this many frames; every sixth of the second half is compared
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(12..=600))]
    frames: u32,
    /// Trace this many samples a pixel of what frames are compared with
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    reference_spp: u32,
}

/// Errors of frames of a number of samples per pixel.
#[derive(Clone, Debug, Serialize)]
struct MotionError {
    motion: &'static str,
    samples: u32,
    /// FLIP of single frames, and of accumulated ones.
    single: f64,
    accumulated: f64,
    /// Error of accumulated frames over that of single frames that take as long.
    at_equal_time: f64,
    /// CPU time per frame in ms.
    trace_ms: f64,
    accumulate_ms: f64,
}

impl MotionArgs {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let errors = measure(self)?;
        if self.json {
            println!("{}", serde_json::to_string_pretty(&errors)?);
            return Ok(());
        }
        let ImageSize { width, height } = self.size;
        println!("Denoised frames of {width}x{height}: FLIP, and CPU ms of a frame");
        println!(
            "{:<7} {:>7} {:>8} {:>11} {:>6} {:>13} {:>8} {:>11}",
            "motion",
            "samples",
            "single",
            "accumulated",
            "ratio",
            "at equal time",
            "trace",
            "accumulate"
        );
        for error in errors {
            println!(
                "{:<7} {:>7} {:>8.4} {:>11.4} {:>6.3} {:>13.3} {:>8.1} {:>11.1}",
                error.motion,
                error.samples,
                error.single,
                error.accumulated,
                error.accumulated / error.single,
                error.at_equal_time,
                error.trace_ms,
                error.accumulate_ms
            );
        }
        Ok(())
    }
}

fn measure(args: &MotionArgs) -> anyhow::Result<Vec<MotionError>> {
    let table_scene = TableScene::room(BallSet::default());
    let sequence = break_shot(table_scene.clone(), args.frames)?;
    let turning = |frame: u32| turned(&table_scene, f64::from(frame) / FRAMES_PER_SEC);
    let breaking = |frame: u32| {
        let mut update = sequence.update(frame);
        update.camera = update.camera.map(|camera| camera.aperture_radius_m(0.0));
        update
    };
    let motions: [(&str, &dyn Fn(u32) -> SceneUpdate); 2] =
        [("turn", &turning), ("break", &breaking)];
    let mut errors = Vec::new();
    for (motion, update) in motions {
        let mut of_motion = MeasuredMotion::new(args, &table_scene, update)?;
        let measured = SAMPLES.map(|samples| of_motion.error(motion, samples));
        let measured: anyhow::Result<Vec<MotionError>> = measured.into_iter().collect();
        errors.extend(with_equal_times(measured?));
    }
    Ok(errors)
}

/// The table as seen by a camera that turns around it.
fn turned(table_scene: &TableScene, secs: f64) -> SceneUpdate {
    let table = table_scene.table_inside();
    let viewpoint = Viewpoint::overview(table, PI / 3.0 * secs);
    table_scene.update(viewpoint.camera(), &[], None)
}

fn break_shot(stage: TableScene, frames: u32) -> anyhow::Result<ShotSequence> {
    let table = TableScene::table();
    let rack = table.rack_eight(1);
    let shot = World::new(table, rack)?.strike(Stroke::straight(0.0, BREAK_M_S))?;
    let view = VideoView::Player;
    Ok(ShotSequence::impact(
        stage,
        shot,
        view,
        FRAMES_PER_SEC as u16,
        frames,
    ))
}

/// A motion, and the references of some of its frames.
struct MeasuredMotion<'a> {
    args: &'a MotionArgs,
    table_scene: &'a TableScene,
    scene: CompiledScene,
    tracer: CpuTracer,
    updates: Vec<SceneUpdate>,
    /// References, by the frame that is compared with them.
    references: Vec<(usize, Vec<[u8; 3]>)>,
}

impl<'a> MeasuredMotion<'a> {
    fn new(
        args: &'a MotionArgs,
        table_scene: &'a TableScene,
        update: &dyn Fn(u32) -> SceneUpdate,
    ) -> anyhow::Result<Self> {
        let mut motion = Self {
            args,
            table_scene,
            scene: CompiledScene::new(table_scene.scene())?,
            tracer: CpuTracer::new()?,
            updates: (0..args.frames).map(update).collect(),
            references: Vec::new(),
        };
        let settings = RenderSettings {
            samples: args.reference_spp,
            seed: u32::MAX,
            ..RenderSettings::default()
        };
        let compared = (args.frames as usize / 2..motion.updates.len()).step_by(6);
        for frame in compared {
            let reference = motion.trace(frame, settings)?;
            motion.references.push((frame, reference));
        }
        Ok(motion)
    }

    /// Errors of frames of this many samples; [`MotionError::at_equal_time`] is not set yet.
    fn error(&mut self, motion: &'static str, samples: u32) -> anyhow::Result<MotionError> {
        let mut reprojector = Reprojector::new(self.table_scene.scene())?;
        let (mut single, mut accumulated) = (0.0, 0.0);
        let (mut trace_secs, mut accumulate_secs) = (0.0, 0.0);
        for frame in 0..self.updates.len() {
            let settings = RenderSettings {
                samples,
                denoise: true,
                seed: frame as u32,
                ..RenderSettings::default()
            };
            let clock = ProcessTime::now();
            let rgb = self.trace(frame, settings)?;
            trace_secs += clock.elapsed().as_secs_f64();
            let mut picture = DisplayFrame {
                serial: frame as u64 + 1,
                size: self.args.size,
                rgba: rgb.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(),
                update: self.updates[frame].clone(),
            };
            let clock = ProcessTime::now();
            let is_accumulated = reprojector.accumulate(&mut picture, None);
            accumulate_secs += clock.elapsed().as_secs_f64();
            let ImageSize { width, height } = self.args.size;
            anyhow::ensure!(
                is_accumulated,
                "--size {width}x{height}: the game accumulates only smaller frames on so few threads"
            );
            let reference = self.references.iter().find(|(of, _)| *of == frame);
            if let Some((_, reference)) = reference {
                let shown: Vec<[u8; 3]> =
                    picture.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
                single += flip(self.args.size, &rgb, reference)?.mean;
                accumulated += flip(self.args.size, &shown, reference)?.mean;
            }
        }
        let (compared, frames) = (self.references.len() as f64, self.updates.len() as f64);
        Ok(MotionError {
            motion,
            samples,
            single: single / compared,
            accumulated: accumulated / compared,
            at_equal_time: f64::NAN,
            trace_ms: 1e3 * trace_secs / frames,
            accumulate_ms: 1e3 * accumulate_secs / frames,
        })
    }

    fn trace(&mut self, frame: usize, settings: RenderSettings) -> anyhow::Result<Vec<[u8; 3]>> {
        let update = &self.updates[frame];
        self.scene.apply(update).context("a frame's update")?;
        let film = trace_image(&self.tracer, &self.scene, self.args.size, settings)?;
        let pixels = film.image().pixels;
        Ok(pixels.iter().map(|light| srgb8(*light, EXPOSURE)).collect())
    }
}

/// Sets the comparison with single frames of equal time: interpolated between the two nearest by time,
/// linearly in logarithms.
fn with_equal_times(mut errors: Vec<MotionError>) -> Vec<MotionError> {
    let points: Vec<(f64, f64)> = errors
        .iter()
        .map(|error| (error.trace_ms.ln(), error.single.ln()))
        .collect();
    for error in &mut errors {
        let at = (error.trace_ms + error.accumulate_ms).ln();
        let after = points.partition_point(|(time, _)| *time < at);
        let after = after.clamp(1, points.len() - 1);
        let ((time, flip), (later, lower)) = (points[after - 1], points[after]);
        let single = flip + (lower - flip) * (at - time) / (later - time);
        error.at_equal_time = error.accumulated / single.exp();
    }
    errors
}

const FRAMES_PER_SEC: f64 = 60.0;
/// Speed of the cue ball.
const BREAK_M_S: f64 = 9.0;
/// Samples per pixel that are measured.
const SAMPLES: [u32; 4] = [1, 2, 4, 8];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accumulated_frames_of_one_sample_are_nearer_to_the_truth_than_single_ones() {
        let args = MotionArgs {
            json: false,
            size: ImageSize::new(160, 90),
            frames: 14,
            reference_spp: 64,
        };
        let errors = measure(&args).unwrap();
        let of_one = errors.iter().filter(|error| error.samples == 1);
        for error in of_one {
            assert!(error.accumulated < 0.9 * error.single, "{error:?}");
        }
    }

    #[test]
    fn equal_times_are_read_off_the_line_between_two_sample_counts() {
        let error = |samples: u32, single: f64, accumulate_ms: f64| MotionError {
            motion: "turn",
            samples,
            single,
            accumulated: 0.1,
            at_equal_time: f64::NAN,
            trace_ms: f64::from(samples),
            accumulate_ms,
        };
        let errors = with_equal_times(vec![error(1, 0.4, 1.0), error(4, 0.2, 0.0)]);
        let expected = [0.1 / (0.4 * 0.2_f64).sqrt(), 0.5];
        for (error, expected) in errors.iter().zip(expected) {
            assert!((error.at_equal_time - expected).abs() < 1e-12, "{error:?}");
        }
    }
}
