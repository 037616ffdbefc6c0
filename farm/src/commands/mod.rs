//! One file per subcommand: arguments in, calls of the library, lines out.

mod add_node;
mod bench;
mod checkpoint;
mod compare;
mod failure;
mod init;
mod inputs;
mod node;
mod render;
mod status;

use clap::Subcommand;

pub(crate) use failure::Failure;

/// What to do.
#[derive(Subcommand)]
pub(crate) enum Command {
    Init(init::Args),
    Add(add_node::Args),
    Node(node::Args),
    Render(render::Args),
    Status(status::Args),
    Bench(bench::Args),
    Compare(compare::Args),
}

impl Command {
    pub(crate) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Init(args) => init::run(&args),
            Self::Add(args) => add_node::run(&args),
            Self::Node(args) => node::run(&args),
            Self::Render(args) => render::run(&args),
            Self::Status(args) => status::run(&args),
            Self::Bench(args) => bench::run(&args),
            Self::Compare(args) => compare::run(&args),
        }
    }
}
