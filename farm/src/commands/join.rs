//! `carom-farm join`: makes this machine a node of a farm.

use std::path::PathBuf;

use carom_farm::net::{self, JoinUrl};

use crate::commands::Failure;

/// Make this machine a node of a farm, by what `carom-farm token` prints there
///
/// The key is made here and stays here. While the node runs, it renews its certificate in the last
/// third of its 30 days at the address that it joined at.
#[derive(clap::Args)]
pub(crate) struct JoinArgs {
    /// The farm's address and token: farm://HOST:PORT#TOKEN
    #[arg(value_name = "URL")]
    url: JoinUrl,
    /// Join by this name [default: this machine's name]
    #[arg(long)]
    name: Option<String>,
    /// Write the key and certificates to this folder
    #[arg(long, default_value = ".carom")]
    credentials: PathBuf,
}

pub(crate) fn run(args: &JoinArgs) -> Result<(), Failure> {
    let name = args.name.clone().unwrap_or_else(machine_name);
    let credentials = net::join(&args.url, &name, &args.credentials)?;
    println!(
        "Joined as {name}, with a certificate until {} in {}.",
        credentials.last_day()?,
        args.credentials.display()
    );
    println!(
        "Next: carom-farm node --credentials {}",
        args.credentials.display()
    );
    Ok(())
}

/// The first label of the host name; characters not allowed in a certificate's name become `-`.
fn machine_name() -> String {
    let name = gethostname::gethostname();
    let name = name.to_string_lossy();
    let label = name.split('.').next().unwrap_or_default();
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    label.chars().map(plain).collect()
}
