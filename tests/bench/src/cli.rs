//! The command line: one subcommand per bench, and the programs that benches and tests start.

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::{
    BenchError, assets, balance, bvh, cluster, codec, faults, first_frames, kernel_specialization,
    latency, latency_hiding, mitsuba_scene, motion, node, overlay, particles, physics, play, proxy,
    quality, tradeoff_chart, transport,
};

/// Measure what Carom's parts cost, and how right they are.
#[derive(Parser)]
#[command(name = "carom-bench", version, about, long_about = None)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Assets(assets::Args),
    Balance(balance::Args),
    Cluster(cluster::Args),
    FirstFrames(first_frames::Args),
    Faults(faults::Args),
    Codec(codec::Args),
    Transport(transport::Args),
    Latency(latency::Args),
    LatencyHiding(latency_hiding::Args),
    Play(play::Args),
    Motion(motion::MotionArgs),
    KernelSpecialization(kernel_specialization::Args),
    Bvh(bvh::Args),
    Particles(particles::Args),
    Physics(physics::PhysicsArgs),
    Overlay(overlay::OverlayArgs),
    Quality(quality::QualityArgs),
    TradeoffChart(tradeoff_chart::Args),
    ImportScene(mitsuba_scene::Args),
    Proxy(proxy::Args),
    Node(node::Args),
}

/// Runs the command line. Exit codes: 0 done, 1 failed while running, 2 wrong arguments or files, 130
/// interrupted.
pub fn run() -> ExitCode {
    let cli = Cli::parse();
    carom_farm::logging::init("warn");
    match cli.command.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("carom-bench: {failure}");
            failure.exit_code()
        }
    }
}

impl Command {
    fn run(self) -> Result<(), BenchError> {
        match self {
            Self::Assets(args) => assets::run(&args),
            Self::Balance(args) => balance::run(&args),
            Self::Cluster(args) => cluster::run(&args),
            Self::FirstFrames(args) => first_frames::run(&args),
            Self::Faults(args) => faults::run(&args),
            Self::Codec(args) => codec::run(&args),
            Self::Transport(args) => transport::run(&args),
            Self::Latency(args) => latency::run(&args),
            Self::LatencyHiding(args) => latency_hiding::run(&args),
            Self::Play(args) => play::run(&args),
            Self::Motion(args) => Ok(args.run()?),
            Self::KernelSpecialization(args) => kernel_specialization::run(&args),
            Self::Bvh(args) => bvh::run(&args),
            Self::Particles(args) => particles::run(&args),
            Self::Physics(args) => Ok(args.run()?),
            Self::Overlay(args) => Ok(args.run()?),
            Self::Quality(args) => Ok(args.run()?),
            Self::TradeoffChart(args) => tradeoff_chart::run(&args),
            Self::ImportScene(args) => mitsuba_scene::run(&args),
            Self::Proxy(args) => proxy::run(&args),
            Self::Node(args) => node::run(&args),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_is_consistent() {
        <Cli as clap::CommandFactory>::command().debug_assert();
    }
}
