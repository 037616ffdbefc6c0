//! Configuration of a farm.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use carom_protocol::{PixelPrecision, PrecisionRange};
use carom_tracer::text::{SENTENCE_BYTES_MAX, printable};
use serde::{Deserialize, Serialize};

use crate::config_fault::ConfigFault;
use crate::directory::NodeSource;
use crate::whole_file::read_limited;
use crate::{Balancing, Distribution, Error};

/// Configuration of a [`crate::Farm`], filled by command lines, `farm.toml` and applications.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FarmConfig {
    /// The node inside this process.
    pub local: LocalNode,
    /// CPU threads of the node inside this process, 0 to 1024; 0 is one per core, which is fastest. Fewer
    /// leave cores to other programs: `carom-farm bench trace --scaling` measures the speed of each number.
    pub threads: u16,
    /// Remote nodes, as `host:port`, and [directories](crate::directory) of nodes: `dns:host:port` has a
    /// node at each address of the host, `file:path` one per line.
    pub nodes: Vec<String>,
    /// Folder with the farm's `ca.pem`, `player.pem` and `player.key`, as created by `carom-farm init`;
    /// needed if there are `nodes`.
    pub credentials: PathBuf,
    /// How tiles are divided, and whether late ones are hedged.
    pub balancer: Balancing,
    /// What is divided: tiles, or samples of whole pictures where these can be merged.
    pub distribution: Distribution,
    /// Edge of a tile in pixels, 8 to 128. Larger tiles balance worse, smaller ones cost bytes: tiles of 16
    /// compress 16–33 % worse than whole pictures, of 64 3–4 %.
    pub tile_edge: u16,
    /// Precision range of sRGB pixels of remote nodes: the finest that the link carries is used. A finer
    /// end costs bytes (`carom-bench codec` has the figures), a coarser end lets a slow link keep up. Nodes
    /// in this process are exact.
    pub precision: PrecisionRange,
    /// Maximum frames in flight, 1 to 8: an application that submits a frame each 1/60 s over a round trip
    /// of 46 ms has 5 in flight. More cost memory, fewer leave nodes idle during transfers.
    pub frames_in_flight: usize,
    /// Seconds without an answer of any node after which [`crate::Farm::check_nodes`] gives up; 0 is never.
    /// The default is ten if no connection is left, and sixty if a node may be starting.
    pub timeout_secs: Option<u32>,
}

impl FarmConfig {
    /// The configuration of the current environment: [`FarmConfig::FILE`] in the working folder if it
    /// exists, or the default; nodes in the environment variable [`FarmConfig::NODES_VARIABLE`],
    /// comma-separated, replace its own.
    ///
    /// # Errors
    /// As [`FarmConfig::load`].
    pub fn discover() -> Result<Self, Error> {
        let mut config = match Path::new(Self::FILE) {
            file if file.exists() => Self::load(file)?,
            _ => Self::default(),
        };
        if let Some(nodes) = std::env::var_os(Self::NODES_VARIABLE) {
            let nodes = nodes.to_string_lossy();
            let nodes = nodes.split(',').map(str::trim);
            config.nodes = nodes
                .filter(|node| !node.is_empty())
                .map(str::to_owned)
                .collect();
        }
        Ok(config)
    }

    /// Default file name of a configuration.
    pub const FILE: &str = "farm.toml";
    /// Environment variable with the nodes.
    pub const NODES_VARIABLE: &str = "CAROM_NODES";

    /// Reads a `farm.toml` with the fields of this struct; omitted ones have their defaults. A relative
    /// [`FarmConfig::credentials`] or path of a directory is relative to the file's folder.
    ///
    /// # Errors
    /// [`Error::Config`] with the file and, if it could be read, the line that is wrong.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let text = read_limited(path, FILE_BYTES_MAX).map_err(|source| ConfigFault::File {
            path: path.to_owned(),
            source,
        })?;
        let mut config: Self = toml::from_str(&text).map_err(|why| {
            let start = why.span().map_or(0, |span| span.start);
            let before = text.bytes().take(start);
            let line = before.filter(|byte| *byte == b'\n').count();
            let place = text.lines().nth(line).unwrap_or_default();
            ConfigFault::Line {
                path: path.to_owned(),
                line: line + 1,
                excerpt: printable(place, EXCERPT_BYTES_MAX),
                reason: printable(why.message(), SENTENCE_BYTES_MAX),
            }
        })?;
        if let Some(folder) = path.parent() {
            config.credentials = folder.join(&config.credentials);
            for node in &mut config.nodes {
                *node = NodeSource::in_folder(node, folder);
            }
        }
        Ok(config)
    }
}

/// Maximum bytes of a faulty line in a message.
const EXCERPT_BYTES_MAX: usize = 60;
/// Maximum bytes of a configuration: 1024 nodes with the longest names need a quarter.
const FILE_BYTES_MAX: u64 = 1 << 20;

impl Default for FarmConfig {
    fn default() -> Self {
        Self {
            local: LocalNode::Auto,
            threads: 0,
            nodes: Vec::new(),
            credentials: PathBuf::from(".carom"),
            balancer: Balancing::default(),
            distribution: Distribution::default(),
            tile_edge: 32,
            precision: PrecisionRange {
                finest: PixelPrecision::Within1,
                coarsest: PixelPrecision::Lossy50,
            },
            frames_in_flight: 8,
            timeout_secs: None,
        }
    }
}

/// Device of the node inside the client's process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LocalNode {
    /// Every hardware GPU that passes its self-test, and the CPU where it helps or they fail.
    #[default]
    Auto,
    /// The CPU with SIMD.
    Cpu,
    /// One hardware GPU; an error if there is none.
    Gpu,
    /// No node in this process.
    None,
}

/// `auto`, `cpu`, `gpu` or `none`, for command lines.
impl FromStr for LocalNode {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            "gpu" => Ok(Self::Gpu),
            "none" => Ok(Self::None),
            _ => Err(Error::Choice("auto, cpu, gpu or none")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fault(text: &[u8]) -> String {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("farm.toml");
        std::fs::write(&path, text).unwrap();
        FarmConfig::load(path).unwrap_err().to_string()
    }

    #[test]
    fn faults_of_a_configuration_control_no_terminal() {
        for text in [
            "\u{9b}2J = 3",
            "\"\\u001b[2J\" = 3",
            "nodes = \"\u{1b}]0;owned\u{7}\"",
        ] {
            let sentence = fault(text.as_bytes());
            assert!(!sentence.contains(char::is_control), "{sentence:?}");
        }
    }

    #[test]
    fn long_configurations_are_refused_unread() {
        let text = vec![b'#'; FILE_BYTES_MAX as usize + 1];
        assert!(fault(&text).contains("it has more than 1048576 bytes"));
    }
}
