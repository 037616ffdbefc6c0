//! `carom-farm cloud`: EC2 machines as nodes, created and deleted by the AWS command line.
//!
//! ```text
//! up ── price, confirmation ──▶ CloudFormation (farm/deploy/aws/farm.yaml)
//!    ──▶ machines that join by token ──▶ nodes.txt
//! down ──▶ bucket emptied, stack deleted, leftovers listed
//! ```

mod aws_cli;
mod down;
mod inventory;
mod plan;
mod programs;
mod stack;
mod up;

use std::io::{BufRead as _, IsTerminal as _, Write as _};
use std::path::PathBuf;

use clap::Subcommand;

use crate::commands::Failure;
use aws_cli::AwsCli;
use stack::Stack;

/// Run nodes on EC2: needs the program aws, with credentials
#[derive(clap::Args)]
pub(crate) struct CloudArgs {
    #[command(subcommand)]
    command: CloudCommand,
}

#[derive(Subcommand)]
enum CloudCommand {
    Up(Box<up::UpArgs>),
    /// List the machines of the farm, and write the addresses of those that run to --nodes-file
    Status(inventory::StatusArgs),
    /// Print what the machines have written to their consoles, and why any could not be started
    Logs(StackArgs),
    Down(down::DownArgs),
}

/// Which farm of an account.
#[derive(Clone, clap::Args)]
struct StackArgs {
    /// The farm's name, which all its machines have as the tag carom:farm
    #[arg(long, default_value = "carom", value_parser = stack::name)]
    name: String,
    /// The region [default: as the program aws is configured]
    #[arg(long)]
    region: Option<String>,
}

impl StackArgs {
    fn open(&self) -> Stack {
        Stack::new(AwsCli::new(self.region.clone()), self.name.clone())
    }
}

/// The file that lists the farm's nodes.
#[derive(Clone, clap::Args)]
struct NodesFile {
    /// Write the nodes' addresses to this file, for `--node file:nodes.txt`
    #[arg(long, default_value = "nodes.txt")]
    nodes_file: PathBuf,
}

pub(crate) fn run(args: &CloudArgs) -> Result<(), Failure> {
    match &args.command {
        CloudCommand::Up(args) => up::run(args),
        CloudCommand::Status(args) => inventory::status(args),
        CloudCommand::Logs(args) => inventory::logs(&args.open()),
        CloudCommand::Down(args) => down::run(args),
    }
}

/// Asks for confirmation on the terminal; without one, only `--yes` confirms.
fn confirm(question: &str, yes: bool) -> Result<(), Failure> {
    if yes {
        return Ok(());
    }
    if !std::io::stdin().is_terminal() {
        return Err(Failure::Input(format!("{question} Add --yes to go on.")));
    }
    print!("{question} [y/N] ");
    let _ = std::io::stdout().flush();
    let mut answer = String::new();
    let _ = std::io::stdin().lock().read_line(&mut answer); // nothing is no
    match answer.trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ => Err(Failure::Interrupted),
    }
}
