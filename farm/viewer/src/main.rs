//! The viewer's command: arguments only.

use std::process::ExitCode;

use carom_farm::FarmConfig;
use carom_view::app;
use carom_view::args::Args;
use carom_window::display::Present;
use clap::Parser as _;
use mimalloc::MiMalloc;

/// With glibc's an answer of 64 KiB over a loopback takes a quarter more time.
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

/// What is wrong with the arguments ends with 2, all else with 1.
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

/// Libraries below warn of things that the person at the window can do nothing about.
const LOG: &str = "warn,wgpu_core=error,wgpu_hal=error,winit=error,sctk=error";
