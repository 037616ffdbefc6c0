//! Entry point of the viewer: command line, logging and exit codes.

use std::process::ExitCode;

use carom_farm::FarmConfig;
use carom_view::app;
use carom_view::args::Args;
use carom_window::display::Present;
use clap::Parser as _;
use mimalloc::MiMalloc;

/// With glibc's allocator an answer of 64 KiB over loopback takes a quarter more time.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    let args = Args::parse();
    carom_farm::logging::init(LOG);
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err((error, code)) => {
            eprintln!("carom-view: {error:#}");
            ExitCode::from(code)
        }
    }
}

/// Invalid arguments yield exit code 2, all other errors 1.
fn run(args: &Args) -> Result<(), (anyhow::Error, u8)> {
    let (config, present) = configuration(args).map_err(|error| (error, 2))?;
    app::run(args, config, present).map_err(|error| (error, 1))
}

fn configuration(args: &Args) -> anyhow::Result<(FarmConfig, Option<Present>)> {
    if let Some(translation) = &args.window.translation {
        carom_text::load_translation(translation)?;
    }
    Ok((args.window.farm_config()?, args.window.presentation()?))
}

/// Log filter: libraries warn about things that the user cannot influence.
const LOG: &str = "warn,wgpu_core=error,wgpu_hal=error,winit=error,sctk=error";
