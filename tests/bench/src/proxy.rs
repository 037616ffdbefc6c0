//! The link emulator as a program between a client and a node.

use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context;
use carom_farm::net::interruption;
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};

use crate::BenchError;

/// Pass UDP packets on to a node over an emulated link, until Ctrl-C or SIGTERM.
///
/// Each direction has the same delay, loss and rate; equal seeds draw equal fates.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Where to listen; port 0 lets the system choose.
    #[arg(long)]
    listen: SocketAddr,
    /// The node.
    #[arg(long)]
    to: SocketAddr,
    #[command(flatten)]
    path: LinkArgs,
    /// Draws losses and jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// A path on a command line.
#[derive(Clone, Copy, clap::Args)]
pub(crate) struct LinkArgs {
    /// Milliseconds, one way.
    #[arg(long, default_value_t = 0.0)]
    delay: f64,
    /// Mean of the jitter on top, in milliseconds.
    #[arg(long, default_value_t = 0.0)]
    jitter: f64,
    /// Packets lost, in percent.
    #[arg(long, default_value_t = 0.0)]
    loss: f64,
    /// Packets that are lost together, on average.
    #[arg(long, default_value_t = 1.0)]
    burst: f64,
    /// Megabits per second [default: no limit].
    #[arg(long)]
    rate: Option<f64>,
    /// Kilobytes that wait for the rate.
    #[arg(long, default_value_t = 256.0)]
    queue: f64,
    /// Packets that overtake others, in percent.
    #[arg(long, default_value_t = 0.0)]
    reorder: f64,
    /// Bytes of the longest packets that pass, without the headers of IP and UDP.
    #[arg(long, default_value_t = LinkConfig::default().packet_bytes_max)]
    packet: usize,
}

impl LinkArgs {
    /// The configuration of the link.
    ///
    /// # Errors
    /// [`BenchError::Input`] with the value and the range.
    pub(crate) fn config(&self) -> Result<LinkConfig, BenchError> {
        let millis = |what: &str, millis: f64| {
            let secs = Duration::try_from_secs_f64(millis * 1e-3);
            secs.map_err(|why| BenchError::Input(format!("{what} is {millis} ms: {why}")))
        };
        let config = LinkConfig {
            delay: millis("--delay", self.delay)?,
            jitter: millis("--jitter", self.jitter)?,
            loss: 0.01 * self.loss,
            burst: self.burst,
            rate: self.rate.map(|megabits| 1e6 * megabits),
            queue_bytes: (1e3 * self.queue) as usize,
            reorder: 0.01 * self.reorder,
            packet_bytes_max: self.packet,
        };
        config
            .validate()
            .map_err(|why| BenchError::Input(why.to_string()))?;
        Ok(config)
    }
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let config = args.path.config()?;
    let proxy = UdpProxy::start(args.listen, args.to, config, args.seed)
        .with_context(|| format!("a proxy at {} for {}", args.listen, args.to))?;
    let line = format!("listening on {} for {}", proxy.local_addr(), args.to);
    let _ = writeln!(std::io::stdout(), "{line}"); // a reader that has gone away ends nothing
    let interrupted = interruption().context("Ctrl-C")?;
    while !interrupted.load(Ordering::Relaxed) {
        std::thread::sleep(PATIENCE);
    }
    let counts = proxy.counts();
    let line = format!("{} packets passed on, {} lost", counts.passed, counts.lost);
    let _ = writeln!(std::io::stdout(), "{line}");
    Ok(())
}

/// Longest time until Ctrl-C is noticed.
const PATIENCE: Duration = Duration::from_millis(50);
