//! Command-line options shared by programs with a window.

use std::path::{Path, PathBuf};

use carom_farm::{Balancing, FarmConfig, LocalNode};
use clap::{Args, ValueEnum as _};

use crate::display::Present;

/// Where pictures are traced, and how they are shown.
#[derive(Clone, Debug, Args)]
pub struct WindowArgs {
    /// Address of a farm node; repeat for several. Replaces the nodes of --config
    #[arg(long = "node", value_name = "HOST:PORT")]
    pub nodes: Vec<String>,
    /// Folder of the farm's certificates and the player's key
    #[arg(long, value_name = "DIR")]
    pub credentials: Option<PathBuf>,
    /// Farm configuration [default: farm.toml in this folder, if it exists]
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Devices of this machine to trace with: auto (all GPUs that pass the self-test, plus the CPU), cpu,
    /// gpu (an error if there is none) or none (farm nodes do all the work)
    #[arg(long)]
    pub backend: Option<LocalNode>,
    /// Balancing algorithm, as `balancer` in the configuration [default: water_filling_hedged, or that of
    /// --config]
    #[arg(long, value_name = "NAME")]
    pub balancer: Option<Balancing>,
    /// Presentation of pictures in the window [default: CAROM_PRESENT, else the first that works]
    #[arg(long, value_enum)]
    pub present: Option<Present>,
    /// Show the texts of a translation: a copy of game/text/en.ftl in another language, with Latin, Greek or Cyrillic letters
    #[arg(long, value_name = "FILE")]
    pub translation: Option<PathBuf>,
}

/// Reason why the options cannot be applied.
#[derive(Debug, thiserror::Error)]
pub enum ArgsFault {
    /// The farm's configuration cannot be read.
    #[error(transparent)]
    Config(#[from] carom_farm::Error),
    /// No device and no node would trace pictures.
    #[error(
        "no renderer is configured: --backend none (or `local` in the configuration) disables this \
         machine, and no node is given. Add --node HOST:PORT, or use --backend auto"
    )]
    NoRenderer,
    /// The environment variable holds a value that `--present` does not accept.
    #[error("CAROM_PRESENT is `{0}`: it must be vulkan, gl or software")]
    Present(String),
}

impl WindowArgs {
    /// The farm that the configuration file and the options describe; options override the file.
    ///
    /// # Errors
    /// [`ArgsFault::Config`] with the file and what is wrong in it, [`ArgsFault::NoRenderer`].
    pub fn farm_config(&self) -> Result<FarmConfig, ArgsFault> {
        let beside = Path::new(FarmConfig::FILE);
        let mut config = match &self.config {
            Some(path) => FarmConfig::load(path)?,
            None if beside.is_file() => FarmConfig::load(beside)?,
            None => FarmConfig::default(),
        };
        if !self.nodes.is_empty() {
            config.nodes.clone_from(&self.nodes);
        }
        if let Some(folder) = &self.credentials {
            config.credentials.clone_from(folder);
        }
        config.local = self.backend.unwrap_or(config.local);
        config.balancer = self.balancer.unwrap_or(config.balancer);
        if config.local == LocalNode::None && config.nodes.is_empty() {
            return Err(ArgsFault::NoRenderer);
        }
        Ok(config)
    }

    /// The presentation requested by the option or else by the environment variable `CAROM_PRESENT`.
    ///
    /// # Errors
    /// [`ArgsFault::Present`] if the variable holds no presentation.
    pub fn presentation(&self) -> Result<Option<Present>, ArgsFault> {
        let variable = std::env::var("CAROM_PRESENT").unwrap_or_default();
        if self.present.is_some() || variable.is_empty() {
            return Ok(self.present);
        }
        let present = Present::from_str(&variable, true);
        present.map(Some).map_err(|_| ArgsFault::Present(variable))
    }
}

#[cfg(test)]
mod tests {
    use clap::{Args as _, Command, FromArgMatches as _};

    use super::*;

    fn config(words: &[&str]) -> Result<FarmConfig, ArgsFault> {
        let command = WindowArgs::augment_args(Command::new("carom"));
        let matches = command.get_matches_from([&["carom"], words].concat());
        WindowArgs::from_arg_matches(&matches)
            .unwrap()
            .farm_config()
    }

    #[test]
    fn options_win_over_the_configuration() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("farm.toml");
        std::fs::write(&file, "nodes = [\"a:1\"]\nlocal = \"none\"\n").unwrap();
        let file = file.to_str().unwrap();
        let of_file = config(&["--config", file]).unwrap();
        assert_eq!((of_file.local, of_file.nodes.len()), (LocalNode::None, 1));
        let nodes = ["--config", file, "--node", "b:1", "--node", "c:1"];
        let others = ["--backend", "cpu", "--credentials", "keys"];
        let balancer = ["--balancer", "cycles_hedged"];
        let config = config(&[&nodes[..], &others, &balancer].concat()).unwrap();
        assert_eq!((config.local, config.nodes.len()), (LocalNode::Cpu, 2));
        assert_eq!(config.credentials, PathBuf::from("keys"));
        assert_eq!(config.balancer, carom_farm::Algorithm::Cycles.hedged());
    }

    #[test]
    fn what_makes_no_pictures_is_refused() {
        let said = config(&["--backend", "none"]).unwrap_err().to_string();
        assert!(said.contains("--node HOST:PORT"), "{said}");
        let said = config(&["--config", "no/such/farm.toml"]).unwrap_err();
        assert!(said.to_string().contains("no/such/farm.toml"), "{said}");
    }
}
