//! `carom-farm init`: a new farm's authority and its player's certificate.

use std::path::PathBuf;

use carom_farm::net;

use crate::commands::Failure;

/// Create a farm: its certificate authority and the player's certificate
///
/// Never overwrites an existing farm.
#[derive(clap::Args)]
pub(crate) struct InitArgs {
    /// Write ca.pem, ca.key, player.pem and player.key to this folder
    #[arg(long, default_value = ".carom")]
    dir: PathBuf,
}

pub(crate) fn run(args: &InitArgs) -> Result<(), Failure> {
    net::create_farm(&args.dir)?;
    let dir = args.dir.display();
    println!("Created a farm in {dir}. Keep {dir}/ca.key private: it admits nodes and players.");
    println!("Next: carom-farm add-node NAME --dir {dir}");
    Ok(())
}
