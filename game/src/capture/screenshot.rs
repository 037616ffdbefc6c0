//! Screenshots: what the window shows in full quality, traced by the game's farm where the window leaves
//! it time, and written as PNG and EXR by a thread.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;

use anyhow::Context as _;
use carom_farm::{
    AccumulatedRender, Farm, Frame, FrameSpec, PixelFormat, Priority, SampleBatch, trace_aovs,
};
use carom_tracer::film::Film;
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
    render: AccumulatedRender,
    batches: Sender<SampleBatch>,
    outcome: Receiver<anyhow::Result<PathBuf>>,
}

impl ScreenshotSlot {
    /// Begins a screenshot of `scene` after `update` that will lie in `folder`, as `still_0001.png` and,
    /// with layers of albedo, normal and depth, `still_0001.exr`. One that is being taken is dropped.
    ///
    /// # Errors
    /// [`crate::Error::ScreenshotThread`].
    pub fn begin(
        &mut self,
        scene: Scene,
        update: SceneUpdate,
        size: ImageSize,
        max_depth: u32,
        folder: PathBuf,
    ) -> crate::Result<()> {
        let spec = FrameSpec {
            update,
            size,
            settings: RenderSettings {
                samples: SAMPLES,
                max_depth,
                ..RenderSettings::default()
            },
            format: PixelFormat::LinearF32,
        };
        let screenshot = Screenshot::begin(scene, spec, folder);
        self.current = Some(screenshot.map_err(crate::Error::ScreenshotThread)?);
        Ok(())
    }

    /// Requests what the farm takes. Once the screenshot is finished or has failed, a sentence for the
    /// player.
    pub fn advance(&mut self, farm: &mut Farm) -> Option<String> {
        let screenshot = self.current.as_mut()?;
        let requested = screenshot.render.submit_to(farm);
        let outcome = match (requested, screenshot.outcome.try_recv()) {
            (_, Ok(outcome)) => outcome,
            (Err(error), _) => Err(error.into()),
            (Ok(()), Err(TryRecvError::Empty)) => return None,
            (Ok(()), Err(TryRecvError::Disconnected)) => Err(anyhow::anyhow!("its thread ended")),
        };
        self.cancel(farm);
        Some(match outcome {
            Ok(path) => format!(
                "Saved the screenshot as {} and, with albedo, normal and depth, as .exr",
                path.display()
            ),
            Err(why) => format!("Screenshot failed: {why:#}"),
        })
    }

    /// Takes in a frame of the screenshot; others are dropped.
    pub fn accept(&mut self, frame: Frame) {
        if let Some(screenshot) = &mut self.current
            && let Some(batch) = screenshot.render.accept(frame)
        {
            // The thread's outcome tells why it has ended, if it has.
            let _ = screenshot.batches.send(batch);
        }
    }

    /// Drops the screenshot.
    pub fn cancel(&mut self, farm: &mut Farm) {
        if let Some(mut screenshot) = self.current.take() {
            screenshot.render.cancel(farm);
        }
    }

    /// How much of the screenshot is traced, if one is being taken.
    pub fn percent(&self) -> Option<u32> {
        let render = &self.current.as_ref()?.render;
        Some(100 * render.samples_done() / render.spec().settings.samples)
    }
}

impl Screenshot {
    fn begin(scene: Scene, spec: FrameSpec, folder: PathBuf) -> std::io::Result<Self> {
        let (batches, received) = channel();
        let (sender, outcome) = channel();
        let render = AccumulatedRender::new(spec.clone(), Priority::Background);
        let run = move || {
            // Nobody waits any more once the receiver is gone.
            let _ = sender.send(write(&received, &scene, &spec, &folder));
        };
        thread::Builder::new()
            .name("screenshot".to_owned())
            .spawn(run)?;
        Ok(Self {
            render,
            batches,
            outcome,
        })
    }
}

/// Sums the batches up and writes the picture once all have come.
fn write(
    batches: &Receiver<SampleBatch>,
    scene: &Scene,
    spec: &FrameSpec,
    folder: &Path,
) -> anyhow::Result<PathBuf> {
    let mut film = Film::new(spec.size);
    let mut samples = 0;
    while samples < spec.settings.samples {
        let batch = batches.recv().context("it was cancelled")?;
        batch.add_to(&mut film)?;
        samples += batch.samples;
    }
    let hits = trace_aovs(scene, spec)?;
    fs::create_dir_all(folder)?;
    let path = next_path(folder, "still", "png")?;
    let image = film.image();
    let partial = folder.join("still.partial");
    image.write_exr_with_aovs(&partial, &hits)?;
    fs::rename(&partial, path.with_extension("exr"))?;
    image.write_png(&partial, EXPOSURE)?;
    fs::rename(&partial, &path)?;
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
        slot.begin(scene, update, SIZE, 5, folder.to_owned())
            .unwrap();
        farm
    }

    /// Advances until there is a sentence.
    fn finish(slot: &mut ScreenshotSlot, farm: &mut Farm) -> String {
        loop {
            if let Some(sentence) = slot.advance(farm) {
                return sentence;
            }
            if let Some(frame) = farm.wait_frame(Duration::from_millis(10)) {
                slot.accept(frame);
            }
        }
    }

    #[test]
    fn a_screenshot_is_a_png_and_an_exr_of_one_picture() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = ScreenshotSlot::default();
        for number in 1..=2 {
            let mut farm = begin(&mut slot, folder.path());
            assert_eq!(slot.percent(), Some(0));
            let sentence = finish(&mut slot, &mut farm);
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
        let mut farm = begin(&mut slot, folder.path());
        assert_eq!(slot.advance(&mut farm), None);
        slot.cancel(&mut farm);
        assert!(farm.wait_frame(Duration::from_secs(60)).is_none());
        assert_eq!(slot.advance(&mut farm), None);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_screenshot_that_cannot_be_written_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let mut slot = ScreenshotSlot::default();
        let mut farm = begin(&mut slot, &file);
        let sentence = finish(&mut slot, &mut farm);
        assert!(sentence.starts_with("Screenshot failed: "), "{sentence}");
    }
}
