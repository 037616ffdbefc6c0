//! The bench of particles: bytes on the wire, and what they cost in a picture.

mod convergence;
mod gpu_speed;
mod picture;
mod precision;
mod soft_body;
mod speed;
mod surface;
mod wire;

use anyhow::anyhow;
use carom_farm::backend::Backend;
use clap::ValueEnum;

use crate::BenchError;

/// Measure what particles cost on the wire and in the picture.
///
/// wire: sand and water of 20,000 particles that all move, at 60 frames a second, through a pair of sessions: Mbit/s
/// to a node, the farthest that a particle is drawn from its place, and CPU time at both ends. picture: CPU time (on
/// a GPU that tells it, its own) of the game's room at several moments of a stroke, with each level of dust. precision:
/// particles, time and the cue ball's way through each trick table, at each precision, and how far it is from that at
/// the finest over the first second. surface: CPU time of one core to make the surfaces of jelly and water of a frame and
/// their tree, and of a frame with them and with their particles as beads. speed: CPU time of a particle over a substep,
/// for each material, of rapier's soft bodies, and of a Taichi program of the same method where Python has it; with `--backend gpu` wall-clock
/// time on a GPU instead, of 100,000 and a million particles. convergence: the error of a standing wave in a bar of jelly by
/// the grid's resolution, against theory and against a run of 8 times the cells, also as a chart.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only this part.
    #[arg(long, value_enum)]
    part: Option<Part>,
    /// How many particles are on the wire, up to 60,000 [default: 20,000], or on the GPU, about.
    #[arg(long, value_parser = clap::value_parser!(u32).range(100..=16_000_000))]
    particles: Option<u32>,
    #[command(flatten)]
    picture: picture::PictureArgs,
    #[command(flatten)]
    speed: speed::SpeedArgs,
    #[command(flatten)]
    convergence: convergence::ConvergenceArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    Wire,
    Picture,
    Precision,
    Surface,
    Speed,
    Convergence,
}

/// Maximum number of particles of the wire's part.
const PARTICLES_ON_WIRE_MAX: u32 = 60_000;

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let is_wanted = |part| args.part.is_none_or(|only| only == part);
    if is_wanted(Part::Wire) {
        let particles = args.particles.unwrap_or(20_000);
        if particles > PARTICLES_ON_WIRE_MAX {
            return Err(anyhow!(
                "{particles} particles are more than {PARTICLES_ON_WIRE_MAX} on the wire: use fewer, or --part speed"
            )
            .into());
        }
        wire::run(particles)?;
    }
    if is_wanted(Part::Picture) {
        picture::run(&args.picture)?;
    }
    if is_wanted(Part::Surface) {
        surface::run(&args.picture)?;
    }
    if is_wanted(Part::Speed) {
        if args.picture.backend == Some(Backend::Gpu) {
            gpu_speed::run(args.particles)?;
        } else {
            speed::run(&args.speed)?;
        }
    }
    if is_wanted(Part::Precision) {
        precision::run()?;
    }
    if is_wanted(Part::Convergence) {
        convergence::run(&args.convergence)?;
    }
    Ok(())
}
