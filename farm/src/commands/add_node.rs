//! `carom-farm add`: a node's certificate.

use std::path::PathBuf;

use carom_farm::net;

use crate::commands::Failure;

/// Make a node's certificate, valid for 30 days, as a folder to copy to the node.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The node's name: 1 to 63 letters, digits, `-`, `_` or `.`.
    name: String,
    /// The farm's folder, as `init` made it.
    #[arg(long, default_value = ".carom")]
    dir: PathBuf,
    /// Folder for ca.pem, node.pem and node.key [default: DIR/nodes/NAME].
    #[arg(long)]
    out: Option<PathBuf>,
    /// Replace the key and certificate that the folder holds.
    #[arg(long)]
    renew: bool,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let folder = net::add_node(&args.dir, &args.name, args.out.as_deref(), args.renew)?;
    let folder = folder.display();
    println!("{folder} holds the node's certificate for 30 days. Copy it to the node, there run:");
    println!("carom-farm node --listen 0.0.0.0:4433 --credentials FOLDER");
    Ok(())
}
