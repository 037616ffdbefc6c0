//! `carom-farm token`: admits nodes to the farm while it runs.

use std::net::SocketAddr;
use std::time::Duration;

use carom_farm::net::{EnrolmentEvent, EnrolmentService, NodeAddress};

use crate::commands::authority::AuthorityArgs;
use crate::commands::{Failure, authority, inputs};

/// Print a command with which a node joins the farm, and admit it
///
/// The node makes its own key, which never leaves it. Runs until as many nodes as --uses have joined
/// or --for is over. Meanwhile, nodes that have joined at this address renew their certificates;
/// with --uses 0 that is all it does.
#[derive(clap::Args)]
pub(crate) struct TokenArgs {
    #[command(flatten)]
    authority: AuthorityArgs,
    /// Admit this many nodes
    #[arg(long, default_value_t = 1)]
    uses: u32,
    /// End after this time: 15m, 1h, 30d
    #[arg(long = "for", default_value = "1h", value_parser = inputs::duration)]
    time: Duration,
    /// Listen on this address
    #[arg(long, default_value = "0.0.0.0:4434", value_name = "HOST:PORT",
        value_parser = inputs::listen_address)]
    listen: SocketAddr,
    /// Tell nodes this name or address of this machine [default: its address in the local network]
    #[arg(long)]
    host: Option<String>,
}

pub(crate) fn run(args: &TokenArgs) -> Result<(), Failure> {
    let folder = authority::open(&args.authority)?;
    let host = match &args.host {
        Some(host) => host.clone(),
        None => inputs::reachable_host(args.listen),
    };
    let port = args.listen.port().max(1); // replaced by the one that the system chose
    let address: NodeAddress = format!("{host}:{port}").parse()?;
    let (service, url) = EnrolmentService::bind(args.listen, folder, address, args.uses)?;
    if args.uses > 0 {
        println!("On the node, run:");
        println!("carom-farm join {url}");
    }
    println!("Waiting. Ctrl-C ends this.");
    service.serve(args.time, |event| match event {
        EnrolmentEvent::Joined { name, uses_left } => {
            println!("joined: {name}; {uses_left} more may join");
        }
        EnrolmentEvent::Renewed { name } => println!("renewed: {name}"),
        EnrolmentEvent::Refused { from, why } => eprintln!("refused {from}: {why}"),
    });
    Ok(())
}
