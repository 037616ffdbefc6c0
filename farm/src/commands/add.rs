//! `carom-farm add-node` and `add-player`: create a member's key and certificate in a folder.

use std::path::PathBuf;

use carom_farm::net::Role;

use crate::commands::authority::AuthorityArgs;
use crate::commands::{Failure, authority};

/// Arguments of both.
#[derive(clap::Args)]
pub(crate) struct AddArgs {
    /// Name the node or the person: 1 to 63 letters, digits, `-`, `_` or `.`
    name: String,
    #[command(flatten)]
    authority: AuthorityArgs,
    /// Write the certificates and the key to this folder [default: DIR/nodes/NAME or
    /// DIR/players/NAME; the player that `init` made stays in DIR]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Replace the key and certificate in the folder; the old certificate stays valid until it
    /// expires or is revoked
    #[arg(long)]
    renew: bool,
}

pub(crate) fn run(role: Role, args: &AddArgs) -> Result<(), Failure> {
    let farm = authority::open(&args.authority)?;
    let folder = farm.add(role, &args.name, args.out.as_deref(), args.renew)?;
    let folder = folder.display();
    let days = role.life().as_secs() / (24 * 3600);
    println!("Created a {role}'s certificate for {days} days in {folder}.");
    match role {
        Role::Node => {
            println!("Copy this folder to the node and run:");
            println!("carom-farm node --credentials FOLDER");
        }
        Role::Player => println!(
            "Give this folder to {}: carom --credentials FOLDER",
            args.name
        ),
    }
    Ok(())
}
