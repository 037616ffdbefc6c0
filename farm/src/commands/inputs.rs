//! Arguments that several commands share, checked before anything is opened.

use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use carom_tracer::Scene;

use crate::commands::Failure;

/// The default scene: the table of `assets/scenes/pool.json`.
const POOL: &str = include_str!("../../../assets/scenes/pool.json");

/// A scene with its name in results.
pub(crate) struct NamedScene {
    pub(crate) name: String,
    pub(crate) scene: Scene,
}

/// Reads the scene file; without one, the built-in pool table.
pub(crate) fn scene(path: Option<&Path>) -> Result<NamedScene, Failure> {
    let Some(path) = path else {
        let scene = Scene::from_json(POOL)?;
        return Ok(NamedScene {
            name: "pool".into(),
            scene,
        });
    };
    let scene = Scene::load(path)?;
    let name = path.file_stem().unwrap_or(path.as_os_str());
    Ok(NamedScene {
        name: name.to_string_lossy().into_owned(),
        scene,
    })
}

/// The first address of a host and port to listen at.
pub(crate) fn listen_address(text: &str) -> Result<SocketAddr, std::io::Error> {
    let mut addresses = text.to_socket_addrs()?;
    addresses.next().ok_or_else(|| ErrorKind::NotFound.into())
}

/// A picture file to write.
#[derive(Clone, Debug)]
pub(crate) struct PictureFile {
    pub(crate) path: PathBuf,
    pub(crate) format: PictureFormat,
}

/// The format of a picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PictureFormat {
    /// 8-bit sRGB.
    Png,
    /// 32-bit linear floats.
    Exr,
}

impl FromStr for PictureFile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = PathBuf::from(text);
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let format = match extension.to_str() {
            Some("png") => PictureFormat::Png,
            Some("exr") => PictureFormat::Exr,
            _ => return Err("the name must end in .png or .exr".into()),
        };
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
