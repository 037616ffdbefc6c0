//! The program `carom-farm`: a farm's credentials, its nodes, pictures without the game, and
//! measurements of a machine.
//!
//! Exit codes: 0 success, 1 a failure while running, 2 invalid arguments or files, 130 interrupted.

mod commands;
mod core_dumps;

use std::process::ExitCode;

use carom_farm::logging::LogFormat;
use clap::Parser;
use mimalloc::MiMalloc;

/// With glibc's allocator an answer of 64 KiB over a loopback takes a quarter more time.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Path-trace pictures on many machines as one
#[derive(Parser)]
#[command(name = "carom-farm", version, about, long_about = None)]
struct FarmCli {
    #[command(subcommand)]
    command: commands::FarmCommand,
    /// Write lines of logs plainly, with the time first, or as JSON: plain, time or json
    #[arg(long, global = true, default_value = "plain", value_name = "FORMAT")]
    log: LogFormat,
}

fn main() -> ExitCode {
    let cli = FarmCli::parse();
    carom_farm::logging::init_with_format("warn", cli.log);
    core_dumps::forbid();
    match cli.command.run(cli.log) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("carom-farm: {failure}");
            failure.exit_code()
        }
    }
}
