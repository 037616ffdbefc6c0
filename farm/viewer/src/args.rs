//! The command line.

use std::path::{Path, PathBuf};

use carom_farm::{Balancing, FarmConfig, LocalNode};
use carom_tracer::{ImageSize, RenderSettings};
use carom_window::display::Present;
use clap::{Parser, ValueEnum as _};

use crate::render::Accuracy;

/// View a scene, path-traced by a farm of any mix of GPUs and CPUs.
///
/// Without options this machine traces the pictures. F1 shows the controls.
#[derive(Clone, Debug, Parser)]
#[command(name = "carom-view", version)]
pub struct Args {
    /// Scene to open: a .json, .gltf, .glb, .obj or .ply file; others can be dropped on the window
    #[arg(value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Size of the window in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    pub size: ImageSize,
    /// Samples per pixel that are gathered while nothing changes
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=i64::from(RenderSettings::SAMPLES_MAX)))]
    pub spp: u32,
    /// Limit paths to this many surface scattering events
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=64))]
    pub max_depth: u32,
    /// Exposure at the start: radiance is shown times two to the power of this, -10 to 10
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true, value_parser = stops)]
    pub exposure: f32,
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

impl Args {
    /// The farm that the configuration file and the options describe; options win.
    ///
    /// # Errors
    /// A sentence with the file and what is wrong in it, or that nobody would make pictures.
    pub fn farm_config(&self) -> anyhow::Result<FarmConfig> {
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
        anyhow::ensure!(
            config.local != LocalNode::None || !config.nodes.is_empty(),
            "no renderer is configured: --backend none (or `local` in the configuration) disables this \
             machine, and no node is given. Add --node HOST:PORT, or use --backend auto"
        );
        Ok(config)
    }

    /// How pictures are traced.
    pub fn accuracy(&self) -> Accuracy {
        Accuracy {
            samples: self.spp,
            max_depth: self.max_depth,
        }
    }

    /// The way of presenting that the option, else the environment variable `CAROM_PRESENT`, asks
    /// for.
    ///
    /// # Errors
    /// A sentence if the variable holds something else than the option takes.
    pub fn presentation(&self) -> anyhow::Result<Option<Present>> {
        let variable = std::env::var("CAROM_PRESENT").unwrap_or_default();
        if self.present.is_some() || variable.is_empty() {
            return Ok(self.present);
        }
        let present = Present::from_str(&variable, true).map_err(|_| {
            anyhow::anyhow!("CAROM_PRESENT is `{variable}`: it must be vulkan, gl or software")
        })?;
        Ok(Some(present))
    }
}

fn stops(text: &str) -> Result<f32, String> {
    let most = crate::viewer::STOPS_MAX;
    let stops: Option<f32> = text.parse().ok();
    let stops = stops.filter(|stops| (-most..=most).contains(stops));
    stops.ok_or_else(|| format!("it must be a number from -{most} to {most}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        <Args as clap::CommandFactory>::command().debug_assert();
    }

    #[test]
    fn options_win_over_the_configuration() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("farm.toml");
        std::fs::write(&file, "nodes = [\"a:1\"]\nlocal = \"none\"\n").unwrap();
        let file = file.to_str().unwrap();
        let of_file = Args::parse_from(["carom-view", "--config", file]);
        let config = of_file.farm_config().unwrap();
        assert_eq!((config.local, config.nodes.len()), (LocalNode::None, 1));
        let words = [
            "carom-view",
            "a.ply",
            "--config",
            file,
            "--node",
            "b:1",
            "--node",
            "c:1",
        ];
        let args = Args::parse_from(words.into_iter().chain(["--backend", "cpu"]));
        let config = args.farm_config().unwrap();
        assert_eq!(
            (config.local, config.nodes),
            (LocalNode::Cpu, vec!["b:1".into(), "c:1".into()])
        );
    }

    #[test]
    fn what_makes_no_pictures_is_refused() {
        let alone = Args::parse_from(["carom-view", "--backend", "none"]);
        let said = alone.farm_config().unwrap_err().to_string();
        assert!(said.contains("--node HOST:PORT"), "{said}");
        for words in [
            ["--exposure", "11"],
            ["--exposure", "nan"],
            ["--spp", "0"],
            ["--size", "0x5"],
        ] {
            let refused = Args::try_parse_from(["carom-view"].into_iter().chain(words));
            let said = refused.unwrap_err().to_string();
            assert!(said.contains(words[0]), "{said}");
        }
    }
}
