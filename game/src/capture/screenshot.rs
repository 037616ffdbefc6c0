//! Screenshots: what the window shows in full quality, traced by the game's farm where the window leaves
//! it time, and written as PNG and EXR by a thread.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use carom_farm::{Canceller, Farm, FileFormat, FrameSpec, Picture, PixelFormat, Still, StillJob};
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::capture::next_path;
use crate::scene::scene_builder::EXPOSURE;

/// The screenshot that is being taken; one at a time.
#[derive(Debug, Default)]
pub struct ScreenshotSlot {
    current: Option<Screenshot>,
}

/// A picture in the making. Dropped, it leaves no file.
#[derive(Debug)]
struct Screenshot {
    canceller: Canceller,
    percent: Arc<AtomicU32>,
    outcome: Receiver<anyhow::Result<PathBuf>>,
}

impl ScreenshotSlot {
    /// Begins a screenshot of `scene` after `update` that will lie in `folder`, as `still_0001.png` and,
    /// with layers of albedo, normal and depth, `still_0001.exr`. One that is being taken is dropped.
    ///
    /// # Errors
    /// [`crate::Error::Farm`] if the farm does not take it, [`crate::Error::ScreenshotThread`].
    pub fn begin(
        &mut self,
        farm: &mut Farm,
        scene: &Scene,
        spec: FrameSpec,
        folder: PathBuf,
    ) -> crate::Result<()> {
        let percent = Arc::new(AtomicU32::new(0));
        let seen = Arc::clone(&percent);
        let still = Still::of(spec)
            .background()
            .layers()
            .exposure(EXPOSURE)
            .on_progress(move |progress| {
                seen.store((100.0 * progress.fraction()) as u32, Ordering::Relaxed);
            });
        let job = farm.still(scene, still)?;
        let canceller = job.canceller();
        let outcome = finish(job, folder).map_err(crate::Error::ScreenshotThread)?;
        self.current = Some(Screenshot {
            canceller,
            percent,
            outcome,
        });
        Ok(())
    }

    /// Once the screenshot is finished or has failed, a sentence for the player.
    pub fn poll(&mut self) -> Option<String> {
        let screenshot = self.current.as_mut()?;
        let outcome = match screenshot.outcome.try_recv() {
            Ok(outcome) => outcome,
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => Err(anyhow::anyhow!("its thread ended")),
        };
        self.current = None;
        Some(match outcome {
            Ok(path) => format!(
                "Saved the screenshot as {} and, with albedo, normal and depth, as .exr",
                path.display()
            ),
            Err(why) => format!("Screenshot failed: {why:#}"),
        })
    }

    /// Drops the screenshot.
    pub fn cancel(&mut self) {
        self.current = None;
    }

    /// How much of the screenshot is traced, if one is being taken.
    pub fn percent(&self) -> Option<u32> {
        let percent = &self.current.as_ref()?.percent;
        Some(percent.load(Ordering::Relaxed))
    }
}

impl Drop for Screenshot {
    fn drop(&mut self) {
        self.canceller.cancel();
    }
}

/// The picture of a screenshot of `size` after `update`.
pub fn frame_spec(update: SceneUpdate, size: ImageSize, max_depth: u32) -> FrameSpec {
    FrameSpec {
        update,
        size,
        settings: RenderSettings {
            samples: SAMPLES,
            max_depth,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF32,
    }
}

/// Waits for the picture on a thread, and writes it.
fn finish(job: StillJob, folder: PathBuf) -> std::io::Result<Receiver<anyhow::Result<PathBuf>>> {
    let (sender, outcome) = channel();
    let run = move || {
        let picture = job.wait().map_err(anyhow::Error::from);
        // Nobody waits any more once the receiver is gone.
        let _ = sender.send(picture.and_then(|picture| write(&picture, &folder)));
    };
    thread::Builder::new()
        .name("screenshot".to_owned())
        .spawn(run)?;
    Ok(outcome)
}

fn write(picture: &Picture, folder: &Path) -> anyhow::Result<PathBuf> {
    fs::create_dir_all(folder)?;
    let path = next_path(folder, "still", "png")?;
    let partial = folder.join("still.partial");
    for (format, to) in [
        (FileFormat::Exr, path.with_extension("exr")),
        (FileFormat::Png, path.clone()),
    ] {
        picture.write(&partial, format)?;
        fs::rename(&partial, to)?;
    }
    Ok(path)
}

/// Noise is then a sixteenth of one path's: grain that is hardly seen.
const SAMPLES: u32 = 256;

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use carom_farm::{FarmConfig, LocalNode};
    use carom_tracer::RadianceImage;

    use super::*;
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_scene::TableScene;

    const SIZE: ImageSize = ImageSize::new(16, 9);

    fn begin(slot: &mut ScreenshotSlot, folder: &Path) -> Farm {
        let table_scene = TableScene::room(BallSet::Classic);
        let scene = table_scene.scene().clone();
        let config = FarmConfig {
            local: LocalNode::Cpu,
            ..FarmConfig::default()
        };
        let mut farm = Farm::new(config).unwrap();
        farm.set_scene(&scene).unwrap();
        let update = table_scene.update(scene.camera, &[], None);
        let spec = frame_spec(update, SIZE, 5);
        slot.begin(&mut farm, &scene, spec, folder.to_owned())
            .unwrap();
        farm
    }

    /// Polls until there is a sentence.
    fn finish(slot: &mut ScreenshotSlot) -> String {
        loop {
            if let Some(sentence) = slot.poll() {
                return sentence;
            }
            thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn a_screenshot_is_a_png_and_an_exr_of_one_picture() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = ScreenshotSlot::default();
        for number in 1..=2 {
            let _farm = begin(&mut slot, folder.path());
            assert!(slot.percent().is_some());
            let sentence = finish(&mut slot);
            let path = folder.path().join(format!("still_000{number}.png"));
            assert!(
                sentence.contains(path.to_str().unwrap()),
                "{sentence} of {number}"
            );
            assert_eq!(slot.percent(), None);
            let exr = RadianceImage::read_exr(path.with_extension("exr")).unwrap();
            assert_eq!(exr.size, SIZE);
            assert!(exr.pixels.iter().any(|pixel| pixel[1] > 0.0), "a lit table");
            let again = folder.path().join("again.png");
            exr.write_png(&again, EXPOSURE).unwrap();
            assert_eq!(fs::read(&again).unwrap(), fs::read(&path).unwrap());
        }
    }

    #[test]
    fn a_cancelled_screenshot_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = ScreenshotSlot::default();
        let farm = begin(&mut slot, folder.path());
        assert_eq!(slot.poll(), None);
        slot.cancel();
        drop(farm);
        assert_eq!(slot.poll(), None);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_screenshot_that_cannot_be_written_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let mut slot = ScreenshotSlot::default();
        let _farm = begin(&mut slot, &file);
        let sentence = finish(&mut slot);
        assert!(sentence.starts_with("Screenshot failed: "), "{sentence}");
    }
}
