//! `carom-farm init`: a new farm's authority and its player's certificate.

use std::path::PathBuf;

use carom_farm::net;

use crate::commands::Failure;

/// Make a farm: its authority and the player's certificate. Never overwrites one.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder for ca.pem, ca.key, player.pem and player.key.
    #[arg(long, default_value = ".carom")]
    dir: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    net::create_farm(&args.dir)?;
    let dir = args.dir.display();
    println!("{dir} holds a new farm. Keep {dir}/ca.key to yourself: it admits nodes and players.");
    println!("Next: carom-farm add NAME --dir {dir}");
    Ok(())
}
