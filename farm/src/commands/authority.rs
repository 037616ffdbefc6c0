//! Opening of the farm's authority by the commands that need its key.

use std::io::IsTerminal as _;
use std::path::PathBuf;

use anyhow::Context as _;
use carom_farm::Error;
use carom_farm::net::AuthorityFolder;
use zeroize::Zeroizing;

use crate::commands::Failure;

/// Where the authority is.
#[derive(clap::Args)]
pub(crate) struct AuthorityArgs {
    /// Read the farm's authority from this folder, which `init` created. If its key is encrypted,
    /// the passphrase is asked for or taken from the environment variable CAROM_PASSPHRASE
    #[arg(long, alias = "ca-dir", default_value = ".carom")]
    pub(crate) dir: PathBuf,
}

/// Opens the authority, with a passphrase from the user if its key is encrypted.
pub(crate) fn open(args: &AuthorityArgs) -> Result<AuthorityFolder, Failure> {
    match AuthorityFolder::open(&args.dir, None) {
        Err(Error::PassphraseMissing(path)) => {
            let passphrase = passphrase(&format!("Passphrase of {}: ", path.display()))?;
            Ok(AuthorityFolder::open(&args.dir, Some(&passphrase))?)
        }
        opened => Ok(opened?),
    }
}

/// Obtains a passphrase from the environment or, without echo, from the terminal. It is wiped from memory
/// when dropped.
pub(crate) fn passphrase(prompt: &str) -> Result<Zeroizing<String>, Failure> {
    if let Ok(passphrase) = std::env::var("CAROM_PASSPHRASE") {
        return Ok(Zeroizing::new(passphrase));
    }
    if !std::io::stdin().is_terminal() {
        return Err(Failure::Input(
            "a passphrase is needed: run this in a terminal, or set CAROM_PASSPHRASE".into(),
        ));
    }
    let typed = rpassword::prompt_password(prompt).context("the passphrase")?;
    Ok(Zeroizing::new(typed))
}
