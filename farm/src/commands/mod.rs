//! One file per subcommand: arguments in, calls of the library, lines out.

mod add;
mod failure;
mod init;

use clap::Subcommand;

pub(crate) use failure::Failure;

/// What to do.
#[derive(Subcommand)]
pub(crate) enum Command {
    Init(init::Args),
    Add(add::Args),
}

impl Command {
    pub(crate) fn run(self) -> Result<(), Failure> {
        match self {
            Self::Init(args) => init::run(&args),
            Self::Add(args) => add::run(&args),
        }
    }
}
