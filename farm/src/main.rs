//! `carom-farm`: the farm's credentials, its nodes, pictures without the game, and benches.
//!
//! Exit codes: 0 done, 1 it failed while running, 2 the arguments or their files are wrong.

mod commands;

use std::process::ExitCode;

use clap::Parser;
use mimalloc::MiMalloc;
use tracing_subscriber::EnvFilter;

/// With glibc's an answer of 64 KiB over a loopback takes a quarter more time.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Many machines as one path tracer.
#[derive(Parser)]
#[command(name = "carom-farm", version, about, long_about = None)]
struct Cli {
    #[command(subcommand)]
    command: commands::Command,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("warn"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_target(false)
        .init();
    match cli.command.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("carom-farm: {failure}");
            failure.exit_code()
        }
    }
}
