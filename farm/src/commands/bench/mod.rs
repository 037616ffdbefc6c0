//! `carom-farm bench`: what this machine's back ends and wire can do.

mod accuracy;
mod codec;
mod codec_frames;
mod trace;

use clap::Subcommand;

use crate::commands::Failure;

/// Measure this machine's back ends.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Subcommand)]
enum Bench {
    Trace(trace::Args),
    Accuracy(accuracy::Args),
    Codec(codec::Args),
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    match &args.bench {
        Bench::Trace(args) => trace::run(args),
        Bench::Accuracy(args) => accuracy::run(args),
        Bench::Codec(args) => codec::run(args),
    }
}
