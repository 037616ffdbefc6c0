//! Inputs shared by several commands, validated before anything is opened.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use carom_farm::directory::NodeSource;
use carom_farm::{FarmConfig, FileFormat};
use carom_tracer::Scene;

use crate::commands::Failure;

/// The default scene: a copy of `assets/scenes/pool.json` inside the package.
const POOL: &str = include_str!("pool.json");

/// A scene with its name for results.
pub(crate) struct NamedScene {
    pub(crate) name: String,
    pub(crate) scene: Scene,
}

/// Reads a scene file; without a path, the built-in pool table.
pub(crate) fn scene(path: Option<&Path>) -> Result<NamedScene, Failure> {
    let Some(path) = path else {
        let scene = Scene::from_json(POOL)?;
        return Ok(NamedScene {
            name: "pool".into(),
            scene,
        });
    };
    check_scene(path)?;
    let scene = carom_farm::open_scene(path)?;
    let name = path.file_stem().unwrap_or(path.as_os_str());
    Ok(NamedScene {
        name: name.to_string_lossy().into_owned(),
        scene,
    })
}

/// Checks that the scene file exists.
pub(crate) fn check_scene(path: &Path) -> Result<(), Failure> {
    match path.exists() {
        true => Ok(()),
        false => Err(Failure::Input(format!(
            "{} is no scene file: name one that is there (JSON, glTF, .obj or .ply), or leave --scene out for \
             the built-in pool table",
            path.display()
        ))),
    }
}

/// Parses a node or directory of nodes, as in [`carom_farm::FarmConfig::nodes`].
pub(crate) fn node(text: &str) -> Result<String, carom_farm::Error> {
    text.parse::<NodeSource>()?;
    Ok(text.to_owned())
}

/// Reads the configuration for a command that needs nodes.
pub(crate) fn farm_file(path: &Path) -> Result<FarmConfig, Failure> {
    let lacks = |fault: &str| {
        Failure::Input(format!(
            "{} {fault}: name a node with --node HOST:PORT, or write `nodes = [\"HOST:PORT\"]` in that file",
            path.display()
        ))
    };
    if !path.exists() {
        return Err(lacks("does not exist"));
    }
    let config = FarmConfig::load(path)?;
    match config.nodes.is_empty() {
        true => Err(lacks("lists no nodes")),
        false => Ok(config),
    }
}

/// Resolves a host and port to listen at; the first address counts.
pub(crate) fn listen_address(text: &str) -> Result<SocketAddr, std::io::Error> {
    let mut addresses = text.to_socket_addrs()?;
    addresses.next().ok_or_else(|| ErrorKind::NotFound.into())
}

/// The host by which others reach this machine: the address listened at or, if that is unspecified, the local
/// address of outgoing packets. For use in an address: an IPv6 host is in brackets.
pub(crate) fn reachable_host(listen: SocketAddr) -> String {
    let mut address = SocketAddr::new(listen.ip(), 0);
    if listen.ip().is_unspecified() {
        // Connecting a UDP socket sends nothing but selects the local address. The target is in a block for
        // documentation (RFC 5737).
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0));
        let outward = socket.and_then(|socket| {
            socket.connect((Ipv4Addr::new(192, 0, 2, 1), 9))?;
            socket.local_addr()
        });
        address.set_ip(outward.map_or(Ipv4Addr::LOCALHOST.into(), |outward| outward.ip()));
    }
    let text = address.to_string();
    // Formatting with a port puts an IPv6 address in brackets.
    text.trim_end_matches(":0").to_owned()
}

/// Parses a duration: a number and one of the units s, m, h or d.
pub(crate) fn duration(text: &str) -> Result<Duration, &'static str> {
    const RULE: &str = "it must be a number and s, m, h or d, at most ten years, as in 1h";
    let unit = text.chars().last().ok_or(RULE)?;
    let secs: u64 = match unit {
        's' => 1,
        'm' => 60,
        'h' => 3600,
        'd' => 24 * 3600,
        _ => return Err(RULE),
    };
    let count: u64 = text[..text.len() - 1].parse().map_err(|_| RULE)?;
    let secs = count.checked_mul(secs).filter(|secs| *secs <= SECS_MAX);
    secs.map(Duration::from_secs).ok_or(RULE)
}

/// Maximum duration: the validity of an authority.
const SECS_MAX: u64 = 10 * 365 * 24 * 3600;

/// A picture file to be written.
#[derive(Clone, Debug)]
pub(crate) struct PictureFile {
    pub(crate) path: PathBuf,
    pub(crate) format: FileFormat,
}

impl FromStr for PictureFile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = PathBuf::from(text);
        let format = FileFormat::of(&path)
            .map_err(|_| "the name must end in .png, .exr or .jpg".to_owned())?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            return Err(format!("the folder {} does not exist", folder.display()));
        }
        if path.is_dir() {
            return Err("this is a folder".into());
        }
        Ok(Self { path, format })
    }
}
