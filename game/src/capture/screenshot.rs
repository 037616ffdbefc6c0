//! A picture of what the window shows in full quality, traced by a farm of its own beside the game's.
//!
//! The game's farm goes on with the window's pictures; a node serves both.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use carom_farm::{Farm, FarmConfig, PrecisionRange, Still};
use carom_tracer::film::Film;
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::capture::next_path;
use crate::scene::scene_builder::EXPOSURE;

/// A picture in the making. Dropped, it stops within a frame and leaves no file.
#[derive(Debug)]
pub struct Screenshot {
    outcome: Receiver<Result<PathBuf, String>>,
    progress: Arc<Progress>,
    samples: u32,
}

#[derive(Debug, Default)]
struct Progress {
    done: AtomicU32,
    stop: AtomicBool,
}

impl Screenshot {
    /// Begins a picture of `scene` that will lie in `folder`, as `still_0001.png` and, with layers of
    /// albedo, normal and depth, `still_0001.exr`.
    ///
    /// # Errors
    /// A sentence if the system gives no thread.
    pub fn begin(
        config: FarmConfig,
        scene: Scene,
        still: Still,
        folder: PathBuf,
    ) -> Result<Self, String> {
        let (sender, outcome) = channel();
        let progress = Arc::new(Progress::default());
        let samples = still.settings.samples;
        let seen = Arc::clone(&progress);
        let run = move || {
            let made = make(config, &scene, &still, &folder, &seen);
            // Nobody waits any more once the receiver is gone.
            let _ = sender.send(made.map_err(|error| format!("{error:#}")));
        };
        thread::Builder::new()
            .name("screenshot".to_owned())
            .spawn(run)
            .map_err(|error| format!("the screenshot cannot start: {error}"))?;
        Ok(Self {
            outcome,
            progress,
            samples,
        })
    }

    /// What is traced for a window: as it is, with little noise left.
    pub fn of(update: SceneUpdate, size: ImageSize, max_depth: u32) -> Still {
        Still {
            update,
            size,
            settings: RenderSettings {
                samples: SAMPLES,
                max_depth,
                ..RenderSettings::default()
            },
        }
    }

    /// How far it is, 0 to 1.
    pub fn share(&self) -> f32 {
        self.progress.done.load(Ordering::Relaxed) as f32 / self.samples as f32
    }

    /// Once it is finished: where the PNG lies, or why there is none.
    pub fn poll(&self) -> Option<Result<PathBuf, String>> {
        match self.outcome.try_recv() {
            Ok(outcome) => Some(outcome),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err("the screenshot was cancelled".to_owned())),
        }
    }
}

impl Drop for Screenshot {
    fn drop(&mut self) {
        self.progress.stop.store(true, Ordering::Relaxed);
    }
}

fn make(
    config: FarmConfig,
    scene: &Scene,
    still: &Still,
    folder: &Path,
    progress: &Progress,
) -> anyhow::Result<PathBuf> {
    // Files are kept: exact pixels, however long they travel.
    let mut farm = Farm::new(FarmConfig {
        precision: PrecisionRange::EXACT,
        ..config
    })?;
    farm.set_scene(scene)?;
    let mut film = Film::new(still.size);
    let mut watch = |_: &Film, done: u32| {
        progress.done.store(done, Ordering::Relaxed);
        if progress.stop.load(Ordering::Relaxed) {
            anyhow::bail!("it was given up");
        }
        Ok(())
    };
    still.trace(&mut farm, &mut film, 0, &mut watch)?;
    drop(farm);
    let hits = still.aovs(scene)?;
    fs::create_dir_all(folder)?;
    let path = next_path(folder, "still", "png").map_err(anyhow::Error::msg)?;
    let image = film.image();
    let partial = folder.join("still.partial");
    image.write_exr_with_aovs(&partial, &hits)?;
    fs::rename(&partial, path.with_extension("exr"))?;
    image.write_png(&partial, EXPOSURE)?;
    fs::rename(&partial, &path)?;
    Ok(path)
}

/// The screenshot that is being taken; one at a time.
#[derive(Debug)]
pub struct ScreenshotSlot {
    config: FarmConfig,
    current: Option<Screenshot>,
}

impl ScreenshotSlot {
    /// Screenshots by a farm of `config`.
    pub fn new(config: FarmConfig) -> Self {
        Self {
            config,
            current: None,
        }
    }

    /// Begins a screenshot of `scene` after `update`, in a folder.
    ///
    /// # Errors
    /// A sentence if one is being taken, or if the system gives no thread.
    pub fn begin(
        &mut self,
        scene: Scene,
        update: SceneUpdate,
        size: ImageSize,
        max_depth: u32,
        folder: PathBuf,
    ) -> Result<(), String> {
        if self.current.is_some() {
            return Err("A screenshot is being rendered already".to_owned());
        }
        let render = Screenshot::of(update, size, max_depth);
        self.current = Some(Screenshot::begin(
            self.config.clone(),
            scene,
            render,
            folder,
        )?);
        Ok(())
    }

    /// A sentence for the player once the screenshot is finished.
    pub fn poll(&mut self) -> Option<String> {
        let outcome = self.current.as_ref()?.poll()?;
        self.current = None;
        Some(match outcome {
            Ok(path) => format!(
                "Saved the screenshot as {} and, with albedo, normal and depth, as .exr",
                path.display()
            ),
            Err(why) => format!("Screenshot failed: {why}"),
        })
    }

    /// Whether one is being taken.
    pub fn is_taking(&self) -> bool {
        self.current.is_some()
    }
}

/// Noise is then a sixteenth of one path's: grain that is hardly seen.
const SAMPLES: u32 = 256;

#[cfg(test)]
mod tests {
    use carom_farm::LocalNode;
    use carom_tracer::RadianceImage;

    use super::*;
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_scene::TableScene;

    fn begin(folder: &Path, size: ImageSize, samples: u32) -> Screenshot {
        let table_scene = TableScene::room(BallSet::Classic);
        let update = table_scene.update(table_scene.scene().camera, &[]);
        let mut still = Screenshot::of(update, size, 5);
        still.settings.samples = samples;
        let config = FarmConfig {
            local: LocalNode::Cpu,
            ..FarmConfig::default()
        };
        Screenshot::begin(
            config,
            table_scene.scene().clone(),
            still,
            folder.to_owned(),
        )
        .unwrap()
    }

    #[test]
    fn it_lies_as_png_and_exr_where_it_says() {
        let folder = tempfile::tempdir().unwrap();
        let size = ImageSize::new(32, 18);
        for number in 1..=2 {
            let taken = begin(folder.path(), size, 2);
            let path = taken.outcome.recv().unwrap().unwrap();
            assert_eq!(path, folder.path().join(format!("still_000{number}.png")));
            assert_eq!(taken.share(), 1.0);
            let exr = RadianceImage::read_exr(path.with_extension("exr")).unwrap();
            assert_eq!(exr.size, size);
            assert!(exr.pixels.iter().any(|pixel| pixel[1] > 0.0), "a lit table");
            // The PNG shows the same picture.
            let seen = folder.path().join("seen.png");
            exr.write_png(&seen, EXPOSURE).unwrap();
            assert_eq!(fs::read(&seen).unwrap(), fs::read(&path).unwrap());
        }
    }

    #[test]
    fn one_that_is_dropped_leaves_nothing_and_one_that_cannot_be_written_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let endless = begin(folder.path(), ImageSize::new(640, 360), 65_536);
        endless.progress.stop.store(true, Ordering::Relaxed);
        assert!(
            endless
                .outcome
                .recv()
                .unwrap()
                .unwrap_err()
                .contains("given up")
        );
        drop(endless);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let taken = begin(&file, ImageSize::new(8, 8), 1);
        assert!(taken.outcome.recv().unwrap().is_err());
    }
}
