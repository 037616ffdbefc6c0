//! Screenshots: the window's view in full quality, traced by the game's farm in the background and written
//! as PNG and EXR by a thread.

use std::path::{Path, PathBuf};

use carom_farm::{Farm, FrameSpec, Picture, PixelFormat, Still};
use carom_text::text;
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::capture::background::{CaptureProgress, CaptureSlot};
use crate::capture::next_path;
use crate::scene::scene_builder::EXPOSURE;
use crate::{Error, Result};

/// Begins a screenshot of `scene` as specified, to be written to `folder` as `still_0001.png` and, with
/// layers of albedo, normal and depth, `still_0001.exr`.
///
/// # Errors
/// [`crate::Error::Unwritable`], [`crate::Error::Farm`] if the farm refuses it,
/// [`crate::Error::CaptureThread`].
pub fn begin(
    slot: &mut CaptureSlot,
    farm: &mut Farm,
    scene: &Scene,
    spec: FrameSpec,
    folder: PathBuf,
) -> Result<()> {
    next_path(&folder, NAME, &ENDINGS)?;
    let progress = CaptureProgress::default();
    let seen = progress.clone();
    let still = Still::of(spec)
        .background()
        .layers()
        .exposure(EXPOSURE)
        .on_progress(move |progress| seen.set(progress.fraction()));
    let job = farm.still(scene, still)?;
    slot.begin(job.canceller(), progress, move || {
        let path = write(&job.wait()?, &folder)?;
        Ok(text!("screenshot-saved", path = path.display().to_string()))
    })
}

/// Specification of a screenshot of `size` after `update`.
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

fn write(picture: &Picture, folder: &Path) -> Result<PathBuf> {
    let path = next_path(folder, NAME, &ENDINGS)?;
    let save = |path: &Path| {
        picture.save(path).map_err(|why| match why {
            carom_farm::Error::File { path, source } => Error::Unwritable { path, source },
            why => why.into(),
        })
    };
    save(&path.with_extension("exr"))?;
    save(&path)?;
    Ok(path)
}

const NAME: &str = "still";
const ENDINGS: [&str; 2] = ["png", "exr"];

/// Samples per pixel: noise is then 1/16 of that of one sample, hardly visible.
const SAMPLES: u32 = 256;

#[cfg(test)]
mod tests {
    use std::fs;
    use std::time::Duration;

    use carom_farm::{FarmConfig, LocalNode};
    use carom_tracer::RadianceImage;

    use super::*;
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_scene::TableScene;

    const SIZE: ImageSize = ImageSize::new(16, 9);

    fn begin(slot: &mut CaptureSlot, folder: &Path) -> Result<Farm> {
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
        super::begin(slot, &mut farm, &scene, spec, folder.to_owned())?;
        Ok(farm)
    }

    /// Polls until there is a sentence.
    fn finish(slot: &mut CaptureSlot) -> anyhow::Result<String> {
        loop {
            if let Some(outcome) = slot.poll() {
                return outcome;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn a_screenshot_is_a_png_and_an_exr_of_one_picture() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = CaptureSlot::default();
        let other = folder.path().join("still_0002.exr");
        fs::write(&other, "of another program").unwrap();
        for number in [1, 3] {
            let _farm = begin(&mut slot, folder.path()).unwrap();
            assert!(slot.percent().is_some());
            let sentence = finish(&mut slot).unwrap();
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
        assert_eq!(fs::read_to_string(&other).unwrap(), "of another program");
    }

    #[test]
    fn a_cancelled_screenshot_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = CaptureSlot::default();
        let farm = begin(&mut slot, folder.path()).unwrap();
        assert!(slot.poll().is_none());
        slot.cancel();
        drop(farm);
        assert!(slot.poll().is_none());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_screenshot_that_cannot_be_written_says_where_and_why_before_it_is_rendered() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let mut slot = CaptureSlot::default();
        let why = begin(&mut slot, &file).err().unwrap().to_string();
        let words = [file.to_str().unwrap(), "exists", "then try again"];
        assert!(words.iter().all(|words| why.contains(words)), "{why}");
        assert_eq!(slot.percent(), None);
    }
}
