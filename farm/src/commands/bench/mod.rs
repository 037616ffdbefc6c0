//! `carom-farm bench`: measurements by which a user judges a machine and the settings of a picture.

mod progress;
mod trace;
mod tradeoff;

use clap::Subcommand;

use crate::commands::Failure;

/// Measure this machine's speed, and the cost and gain of each setting of a picture
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Subcommand)]
enum Bench {
    Trace(trace::Args),
    Tradeoff(tradeoff::Args),
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    match &args.bench {
        Bench::Trace(args) => trace::run(args),
        Bench::Tradeoff(args) => tradeoff::run(args),
    }
}
