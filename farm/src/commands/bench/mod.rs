//! `carom-farm bench`: what this machine's back ends, the wire and the balancers can do.

mod balance;
mod cluster;
mod codec;
mod codec_frames;
mod faults;
mod hierarchy;
mod latency;
mod lookahead;
mod loopback;
mod noise;
mod process;
mod specialise;
mod trace;
mod tradeoff;
mod transport;

use clap::Subcommand;

use crate::commands::Failure;

/// Measure this machine's back ends, and balancing on simulated farms.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Subcommand)]
enum Bench {
    Trace(trace::Args),
    Tradeoff(tradeoff::Args),
    Balance(balance::Args),
    Cluster(cluster::Args),
    Faults(faults::Args),
    Codec(codec::Args),
    Transport(transport::Args),
    Latency(latency::Args),
    Lookahead(lookahead::Args),
    Specialise(specialise::Args),
    Hierarchy(hierarchy::Args),
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    match &args.bench {
        Bench::Trace(args) => trace::run(args),
        Bench::Tradeoff(args) => tradeoff::run(args),
        Bench::Balance(args) => balance::run(args),
        Bench::Cluster(args) => cluster::run(args),
        Bench::Faults(args) => faults::run(args),
        Bench::Codec(args) => codec::run(args),
        Bench::Transport(args) => transport::run(args),
        Bench::Latency(args) => latency::run(args),
        Bench::Lookahead(args) => lookahead::run(args),
        Bench::Specialise(args) => specialise::run(args),
        Bench::Hierarchy(args) => hierarchy::run(args),
    }
}
