//! What several commands read from their command line, checked before anything is opened.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use carom_tracer::Scene;

use crate::commands::Failure;

/// The scene of commands that name none: the table of `assets/scenes/pool.json`.
const POOL: &str = include_str!("../../../assets/scenes/pool.json");

/// A scene with the name it goes by in results.
pub(crate) struct NamedScene {
    pub(crate) name: String,
    pub(crate) scene: Scene,
}

/// Reads the scene file, or takes the built-in pool table.
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

/// A picture file that is to be written.
#[derive(Clone, Debug)]
pub(crate) struct Output {
    pub(crate) path: PathBuf,
    pub(crate) format: Format,
}

/// How a picture is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// 8-bit sRGB.
    Png,
    /// 32-bit linear floats.
    Exr,
}

impl FromStr for Output {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let path = PathBuf::from(text);
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let format = match extension.to_str() {
            Some("png") => Format::Png,
            Some("exr") => Format::Exr,
            _ => return Err("its name must end in .png or .exr".into()),
        };
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            return Err(format!("there is no folder {}", folder.display()));
        }
        if path.is_dir() {
            return Err("it is a folder".into());
        }
        Ok(Self { path, format })
    }
}
