//! A node of limited speed, for farms of processes on one machine.

use std::io::{BufRead as _, Write as _};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use carom_farm::NodeState;
use carom_farm::backend::NodeBackend;
use carom_farm::net::{Credentials, NodeServer, Role, StopHandle};
use carom_farm::node::Node;
use carom_testkit::throttle::{DeviceShare, ThrottledTracer};
use carom_tracer::Tracer as _;

use crate::BenchError;

/// Trace for players in a share of this machine's time, until Ctrl-C or SIGTERM.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Address to listen on, as in 127.0.0.1:4433; port 0 lets the system choose.
    #[arg(long)]
    listen: SocketAddr,
    /// Folder with ca.pem, node.pem and node.key.
    #[arg(long, default_value = ".carom")]
    credentials: PathBuf,
    /// What to trace with.
    #[arg(long, default_value = "auto")]
    backend: NodeBackend,
    /// Threads of the CPU back end; 0 is one per core.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
    /// The share of the machine's time to trace in, above 0 and at most 1.
    #[arg(long, default_value_t = 1.0, value_name = "SHARE")]
    throttle: f64,
    /// Read lines of `throttle SHARE` from standard input, whose end ends the node.
    #[arg(long)]
    stdin_control: bool,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let share = DeviceShare::new(args.throttle)
        .map_err(|why| BenchError::Input(format!("--throttle: {why}")))?;
    let credentials = Credentials::load(&args.credentials, Role::Node)?;
    let server = NodeServer::bind(args.listen, &credentials)?;
    let tracer = args.backend.open(usize::from(args.threads))?;
    let tracer = Arc::new(ThrottledTracer::new(tracer, share.clone()));
    let stop = StopHandle::default();
    if args.stdin_control {
        let stop = stop.clone();
        std::thread::spawn(move || {
            follow_stdin(&share);
            stop.stop();
        });
    }
    let device = tracer.info().name;
    let node = Node::new(credentials.name(), tracer);
    let line = format!(
        "{} as {} with {device} on {}",
        NodeState::Listening.word(),
        credentials.name(),
        server.local_addr()?
    );
    let _ = writeln!(std::io::stdout(), "{line}"); // a reader that has gone away ends nothing
    server.serve(&stop, move |player, _| node.connect(player), |_| ());
    Ok(())
}

/// Sets the share that each line names, until standard input ends.
fn follow_stdin(share: &DeviceShare) {
    for line in std::io::stdin().lock().lines().map_while(Result::ok) {
        let done = match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["throttle", value] => match value.parse() {
                Ok(value) => share.set(value).map_err(|why| why.to_string()),
                Err(_) => Err(format!("`{value}` is not a number")),
            },
            _ => Err(format!(
                "`{line}` is no command: it must be `throttle SHARE`"
            )),
        };
        if let Err(why) = done {
            eprintln!("carom-bench: {why}");
        }
    }
}
