//! The program `carom`: dispatch of its command line.

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;
use carom::args::{Args, Command, REPLAY};
use carom::capture::headless;
use carom::output_file::output_file;
use carom::{app, audio};
use carom_billiards::physics::Recording;
use carom_farm::FarmConfig;
use carom_tracer::text::with_causes;
use carom_window::display::Present;
use mimalloc::MiMalloc;

/// mimalloc: with glibc's allocator an answer of 64 KiB over a loopback takes 25 % longer.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    let args = Args::of_command_line();
    carom_farm::logging::init(LOG);
    match &args.command {
        Some(Command::Tournament(games)) => return finish(games.run(), 1),
        Some(Command::Sound { out, replay, speed }) => {
            return finish(sound(out.as_deref(), replay.as_deref(), *speed), 1);
        }
        Some(Command::Scene(scene)) => return finish(scene.run(), 1),
        None => {}
    }
    match configuration(&args) {
        Ok((config, present)) => finish(run(&args, config, present), 1),
        Err(error) => finish(Err(error), 2),
    }
}

fn configuration(args: &Args) -> anyhow::Result<(FarmConfig, Option<Present>)> {
    if let Some(translation) = &args.window.translation {
        carom_text::load_translation(translation)?;
    }
    Ok((args.farm_config()?, args.window.presentation()?))
}

fn run(args: &Args, config: FarmConfig, present: Option<Present>) -> anyhow::Result<()> {
    // Validates the arguments before anything starts.
    args.contest(args.table.options())?;
    if args.headless || args.video.is_some() {
        return headless::run(args, config);
    }
    if carom_window::connection::is_displayless() {
        let (_, recording) = args.table_and_recording()?;
        let shot = recording.map_or("a break shot", |_| "the recorded shot");
        eprintln!(
            "There is no display (DISPLAY and WAYLAND_DISPLAY are not set): rendering {shot} to files."
        );
        return headless::run(args, config);
    }
    app::run(args, config, present)
}

fn sound(out: Option<&Path>, replay: Option<&Path>, speed_m_s: f64) -> anyhow::Result<()> {
    let out = output_file(out, "shot.wav")?;
    let recording = replay.map(Recording::load).transpose().context(REPLAY)?;
    audio::write_shot(&out, recording, speed_m_s)
}

fn finish(result: anyhow::Result<()>, code: u8) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("carom: {}", with_causes(error.as_ref()));
            ExitCode::from(code)
        }
    }
}

/// Default log filter: warnings of these libraries are of no use to the player.
const LOG: &str = "warn,wgpu_core=error,wgpu_hal=error,winit=error,sctk=error";
