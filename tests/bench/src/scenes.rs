//! The scenes that benches trace.

use std::path::Path;

use carom_tracer::Scene;

use crate::BenchError;

/// The table of benches that name no scene.
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
