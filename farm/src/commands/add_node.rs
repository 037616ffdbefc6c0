//! `carom-farm add-node`: a node's certificate.

use std::path::PathBuf;

use carom_farm::net;

use crate::commands::Failure;

/// Create a node's certificate, valid for 30 days, in a folder to copy to the node
///
/// A running node keeps the certificate that it started with: restart it after a renewal.
#[derive(clap::Args)]
pub(crate) struct AddNodeArgs {
    /// Name the node: 1 to 63 letters, digits, `-`, `_` or `.`
    name: String,
    /// Read the farm's authority from this folder, which `init` created
    #[arg(long, default_value = ".carom")]
    dir: PathBuf,
    /// Write ca.pem, node.pem and node.key to this folder [default: DIR/nodes/NAME]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Replace the key and certificate in the folder
    #[arg(long)]
    renew: bool,
}

pub(crate) fn run(args: &AddNodeArgs) -> Result<(), Failure> {
    let folder = net::add_node(&args.dir, &args.name, args.out.as_deref(), args.renew)?;
    let folder = folder.display();
    println!(
        "Created a certificate for 30 days in {folder}. Copy this folder to the node and run:"
    );
    println!("carom-farm node --listen 0.0.0.0:4433 --credentials FOLDER");
    Ok(())
}
