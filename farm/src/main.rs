//! Program `carom-farm`: a farm's credentials, its nodes, pictures without the game, and measurements of a
//! machine.
//!
//! Exit codes: 0 success, 1 failure while running, 2 invalid arguments or files, 130 interrupted.

mod commands;
mod core_dumps;

use std::process::ExitCode;

use carom_farm::logging::LogFormat;
use clap::{Command, CommandFactory as _, FromArgMatches as _, Parser};
use mimalloc::MiMalloc;

/// With glibc's allocator, an answer of 64 KiB over loopback takes a quarter longer.
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
    let matches = with_negative_numbers(FarmCli::command()).get_matches();
    let cli = FarmCli::from_arg_matches(&matches).unwrap_or_else(|fault| fault.exit());
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

/// Lets each number's own parser reject negative values, which clap would otherwise report as unknown
/// flags.
fn with_negative_numbers(command: Command) -> Command {
    let command = command.mut_args(|arg| {
        let takes_values = arg.get_action().takes_values();
        arg.allow_negative_numbers(takes_values)
    });
    command.mut_subcommands(with_negative_numbers)
}
