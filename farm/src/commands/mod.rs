//! The subcommands, one file each: arguments in, calls of the library, lines out.

mod add_node;
mod bench;
mod checkpoint;
mod compare;
mod failure;
mod init;
mod inputs;
mod node;
mod output_file;
mod render;
mod status;

use clap::Subcommand;

pub(crate) use failure::Failure;

/// The subcommands.
#[derive(Subcommand)]
pub(crate) enum FarmCommand {
    Init(init::InitArgs),
    AddNode(add_node::AddNodeArgs),
    Node(node::NodeArgs),
    Render(render::RenderArgs),
    Status(status::StatusArgs),
    Bench(bench::Args),
    Compare(compare::CompareArgs),
}

impl FarmCommand {
    pub(crate) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Init(args) => init::run(&args),
            Self::AddNode(args) => add_node::run(&args),
            Self::Node(args) => node::run(&args),
            Self::Render(args) => render::run(&args),
            Self::Status(args) => status::run(&args),
            Self::Bench(args) => bench::run(&args),
            Self::Compare(args) => compare::run(&args),
        }
    }
}
