//! `carom-farm doctor`: finds faults between this machine and the farm, with advice.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use carom_farm::net::{Credentials, Role};
use carom_farm::{Farm, FarmConfig, LocalNode};

use crate::commands::{Failure, status};

/// Check files, dates, names and connections, and say how to mend what is wrong
///
/// The exit code is 0 if nothing is wrong and 1 otherwise.
#[derive(clap::Args)]
pub(crate) struct DoctorArgs {
    /// Read the farm's configuration from this file, if it exists
    #[arg(long, default_value = "farm.toml")]
    farm: PathBuf,
    /// Check the way to this node instead of those in the configuration; repeat for several
    #[arg(long, value_name = "HOST:PORT")]
    node: Vec<String>,
    /// Check the credentials in this folder [default: .carom, or as in the configuration]
    #[arg(long)]
    credentials: Option<PathBuf>,
    /// Wait this many seconds for the nodes
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=600))]
    timeout_secs: u64,
}

pub(crate) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let mut config = match args.farm.exists() {
        true => FarmConfig::load(&args.farm)?,
        false => FarmConfig::default(),
    };
    if let Some(folder) = &args.credentials {
        config.credentials.clone_from(folder);
    }
    if !args.node.is_empty() {
        config.nodes.clone_from(&args.node);
    }
    let mut findings = Findings::default();
    findings.check_credentials(&config.credentials);
    match config.nodes.is_empty() {
        true => findings.note("no nodes are configured: name one with --node HOST:PORT"),
        false => findings.check_nodes(config, Duration::from_secs(args.timeout_secs)),
    }
    match findings.wrong {
        0 => Ok(()),
        wrong => Err(Failure::Run(anyhow::anyhow!(
            "{wrong} of the checks failed"
        ))),
    }
}

/// Results of the checks, each printed as it is made.
#[derive(Default)]
struct Findings {
    wrong: usize,
}

impl Findings {
    fn right(&self, what: &str) {
        println!("ok     {what}");
    }

    fn note(&self, what: &str) {
        println!("note   {what}");
    }

    fn wrong(&mut self, what: &str) {
        println!("WRONG  {what}");
        self.wrong += 1;
    }

    /// Checks files, their permissions, and the dates of the certificates of each role that the folder holds.
    fn check_credentials(&mut self, folder: &Path) {
        let roles = [Role::Player, Role::Node];
        let held = |role: &Role| folder.join(format!("{role}.pem")).exists();
        let mut roles: Vec<Role> = roles.into_iter().filter(held).collect();
        if roles.is_empty() {
            roles.push(Role::Player); // its error says what is missing
        }
        for role in roles {
            match Credentials::load(folder, role) {
                Ok(credentials) => {
                    self.check_dates(folder, &credentials);
                    self.check_permissions(&folder.join(format!("{role}.key")));
                }
                Err(why) => self.wrong(&why.to_string()),
            }
        }
        self.check_permissions(&folder.join("ca.key"));
    }

    fn check_dates(&mut self, folder: &Path, credentials: &Credentials) {
        let (role, name) = (credentials.role(), credentials.name());
        let last_day = credentials.last_day().unwrap_or_default();
        let holder = format!("{}: {role} {name}", folder.display());
        match credentials.is_due() {
            false => self.right(&format!("{holder}, valid until {last_day}")),
            true => self.note(&format!(
                "{holder}, valid until {last_day}: renew it with `carom-farm add-{role} {name} \
                 --renew` where the farm's authority is, if it does not renew itself"
            )),
        }
        // A file cannot come from the future: its time was set by this clock or by a correct one.
        let written = std::fs::metadata(folder.join("ca.pem")).and_then(|file| file.modified());
        match written {
            Ok(written) if written > SystemTime::now() + CLOCK_TOLERANCE => self.wrong(
                "this machine's clock is behind: ca.pem was written in its future; set the clock",
            ),
            _ => self.right("this machine's clock fits the certificates"),
        }
    }

    fn check_permissions(&mut self, key: &Path) {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            let Ok(file) = std::fs::metadata(key) else {
                return;
            };
            let key = key.display();
            match file.permissions().mode() & 0o077 {
                0 => self.right(&format!("{key} is readable by its owner only")),
                _ => self.wrong(&format!(
                    "{key} is readable by other users: run `chmod 600 {key}`"
                )),
            }
        }
        #[cfg(not(unix))]
        let _ = key;
    }

    /// Checks names, UDP connectivity and the certificates of both sides.
    fn check_nodes(&mut self, config: FarmConfig, timeout: Duration) {
        let config = FarmConfig {
            local: LocalNode::None,
            ..config
        };
        let farm = match Farm::new(config) {
            Ok(farm) => farm,
            Err(why) => return self.wrong(&why.to_string()),
        };
        for node in status::wait(&farm, timeout) {
            let (address, sentence) = (&node.address, status::sentence(&node, timeout));
            match &node.info {
                Some(info) => self.right(&format!("{address} answers as {}", info.name)),
                None => self.wrong(&format!("{address} {sentence}")),
            }
        }
    }
}

/// Tolerated difference to the clocks of file servers.
const CLOCK_TOLERANCE: Duration = Duration::from_secs(60);
