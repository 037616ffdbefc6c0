//! The viewer's command: arguments only.

use std::process::ExitCode;

use carom_view::app;
use carom_view::args::Args;
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
    let invalid = |error: anyhow::Error| (error, 2);
    if let Some(translation) = &args.translation {
        carom_text::load_translation(translation).map_err(|error| invalid(error.into()))?;
    }
    let config = args.farm_config().map_err(invalid)?;
    let present = args.presentation().map_err(invalid)?;
    app::run(args, config, present).map_err(|error| (error, 1))
}

/// Libraries below warn of things that the person at the window can do nothing about.
const LOG: &str = "warn,wgpu_core=error,wgpu_hal=error,winit=error,sctk=error";
