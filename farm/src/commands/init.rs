//! `carom-farm init`: creates a new farm's authority and its first player's certificate.

use std::path::PathBuf;

use carom_farm::net::{AuthorityFolder, FIRST_PLAYER, Role};

use crate::commands::{Failure, authority};

/// Create a farm: its certificate authority and this machine's player
///
/// Never overwrites an existing farm.
#[derive(clap::Args)]
pub(crate) struct InitArgs {
    /// Write the farm's certificate, ca.pem, and the player's key and certificate to this new folder
    #[arg(long, default_value = ".carom")]
    dir: PathBuf,
    /// Write the authority's key, ca.key, and its record to another new folder, such as one on a
    /// memory stick: name it with --dir to the commands that issue certificates
    #[arg(long)]
    ca_dir: Option<PathBuf>,
    /// Encrypt ca.key by a passphrase, which is asked for or taken from the environment variable
    /// CAROM_PASSPHRASE
    #[arg(long)]
    passphrase: bool,
}

pub(crate) fn run(args: &InitArgs) -> Result<(), Failure> {
    let passphrase = match args.passphrase {
        true => Some(authority::passphrase("New passphrase: ")?),
        false => None,
    };
    let passphrase = passphrase.as_ref().map(|passphrase| passphrase.as_str());
    let dir = args.dir.display();
    let ca_dir = args.ca_dir.as_ref().filter(|ca_dir| **ca_dir != args.dir);
    let ca_dir = match ca_dir {
        None => {
            AuthorityFolder::create(&args.dir, passphrase, Some(FIRST_PLAYER))?;
            dir.to_string()
        }
        Some(ca_dir) => {
            let farm = AuthorityFolder::create(ca_dir, passphrase, None)?;
            farm.add(Role::Player, FIRST_PLAYER, Some(&args.dir), false)?;
            ca_dir.display().to_string()
        }
    };
    println!("Created a farm in {dir}. Keep {ca_dir}/ca.key private: it admits nodes and players.");
    println!("Next: carom-farm token --dir {ca_dir}, and what it prints on a node");
    Ok(())
}
