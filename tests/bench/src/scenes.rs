//! The scenes that benches trace, and frames of them.

use std::path::Path;

use carom_farm::{FrameSpec, PixelFormat};
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::BenchError;

/// The scene of benches without one on the command line.
const POOL: &str = include_str!("../../../assets/scenes/pool.json");

/// A scene with its name in results.
pub(crate) struct NamedScene {
    pub(crate) name: String,
    pub(crate) scene: Scene,
}

/// Reads the scene file, or takes the built-in pool table.
pub(crate) fn scene(path: Option<&Path>) -> Result<NamedScene, BenchError> {
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

/// Size of a 16:9 picture.
pub(crate) fn wide(width: u32) -> ImageSize {
    ImageSize::new(width, (width * 9 / 16).max(1))
}

/// A frame of the unchanged scene, for a display.
pub(crate) fn frame(size: ImageSize, samples: u32, seed: u32) -> FrameSpec {
    FrameSpec {
        update: SceneUpdate::default(),
        size,
        settings: RenderSettings {
            samples,
            seed,
            ..RenderSettings::default()
        },
        format: PixelFormat::Srgb8 { exposure: 1.0 },
    }
}
