//! Films of a replay: the shot on show in the present view, rendered by the game's farm in the background.

use std::fs;
use std::path::Path;

use anyhow::Context as _;
use carom_billiards::physics::Shot;
use carom_farm::{Farm, Film};
use carom_text::text;
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate};

use super::{VideoTarget, save};
use crate::audio;
use crate::capture::background::{CaptureProgress, CaptureSlot};
use crate::scene::scene_builder::EXPOSURE;

/// Moments of the frames of a film of `shot`, in seconds since the stroke, up to a short rest after the end.
pub fn moments(shot: &Shot) -> impl Iterator<Item = f64> {
    let secs = shot.duration_secs() + REST_SECS;
    let frames = (secs * f64::from(FRAMES_PER_SEC)).ceil() as u32;
    (0..frames).map(|frame| f64::from(frame) / f64::from(FRAMES_PER_SEC))
}

/// Film of a shot to be rendered.
#[derive(Clone, Debug)]
pub struct ReplayFilm {
    /// The shot, for its sound.
    pub shot: Shot,
    /// The scene at each of its [`moments`].
    pub updates: Vec<SceneUpdate>,
    /// Size of a frame in pixels.
    pub size: ImageSize,
    /// Maximum path depth, see [`RenderSettings::max_depth`].
    pub max_depth: u32,
}

impl ReplayFilm {
    /// Default size of a frame in pixels.
    pub const SIZE: ImageSize = ImageSize::new(1280, 720);

    /// Begins the film, to be written to `folder` as `film_0001.mp4` with sound or, without ffmpeg, as
    /// `film_0001.png`.
    ///
    /// # Errors
    /// [`crate::Error::Unwritable`], [`crate::Error::Farm`] if the farm refuses it,
    /// [`crate::Error::CaptureThread`].
    pub fn begin(
        self,
        slot: &mut CaptureSlot,
        farm: &mut Farm,
        scene: &Scene,
        folder: &Path,
    ) -> crate::Result<()> {
        let target = VideoTarget::next_in(folder)?;
        let progress = CaptureProgress::default();
        let seen = progress.clone();
        let settings = RenderSettings {
            samples: SAMPLES,
            max_depth: self.max_depth,
            denoise: true,
            ..RenderSettings::default()
        };
        let film = Film::new(self.size.width, self.size.height, self.updates)
            .settings(settings)
            .exposure(EXPOSURE)
            .background()
            .on_progress(move |progress| {
                seen.set(f64::from(progress.frames_done) / f64::from(progress.frames.max(1)));
            });
        let job = farm.film(scene, film, target.frames_folder())?;
        slot.begin(job.canceller(), progress, move || {
            let frames = match job.wait() {
                Ok(frames) => frames,
                Err(why) => {
                    // It will not be resumed, so its frames are deleted.
                    let _ = fs::remove_dir_all(target.frames_folder());
                    return Err(why.into());
                }
            };
            let sound = || audio::of_shot(&self.shot);
            let saved = save(&frames, sound, FRAMES_PER_SEC, &target, &mut || true);
            frames.remove()?;
            saved.context("the film")?;
            let path = target.path().display().to_string();
            Ok(text!("film-saved", path = path))
        })
    }
}

const FRAMES_PER_SEC: u16 = 30;
/// Samples per pixel, before denoising.
const SAMPLES: u32 = 16;
/// Time of rest at the end.
const REST_SECS: f64 = 0.5;

#[cfg(test)]
mod tests {
    use carom_billiards::physics::{Stroke, World};
    use carom_farm::{FarmConfig, LocalNode};

    use super::*;
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_scene::TableScene;

    fn film() -> (TableScene, ReplayFilm) {
        let table = TableScene::table();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let shot = world.strike(Stroke::straight(1.2, 0.1)).unwrap();
        let room = TableScene::room(BallSet::Classic);
        let camera = room.scene().camera;
        let update = |secs| room.update(camera, &shot.poses_at(secs), None);
        let updates = moments(&shot).map(update).collect();
        let (size, max_depth) = (ImageSize::new(16, 8), 2);
        let film = ReplayFilm {
            shot,
            updates,
            size,
            max_depth,
        };
        (room, film)
    }

    fn begin(slot: &mut CaptureSlot, folder: &Path) -> Farm {
        let (room, film) = film();
        let config = FarmConfig {
            local: LocalNode::Cpu,
            ..FarmConfig::default()
        };
        let mut farm = Farm::new(config).unwrap();
        film.begin(slot, &mut farm, room.scene(), folder).unwrap();
        farm
    }

    #[test]
    fn a_film_of_a_replay_is_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = CaptureSlot::default();
        let _farm = begin(&mut slot, folder.path());
        let sentence = loop {
            if let Some(outcome) = slot.poll() {
                break outcome.unwrap();
            }
            assert!(slot.percent().is_some());
            std::thread::yield_now();
        };
        let files = fs::read_dir(folder.path())
            .unwrap()
            .map(|file| file.unwrap().path());
        let files: Vec<_> = files.collect();
        assert_eq!(files.len(), 1, "{files:?}");
        assert!(sentence.contains(files[0].to_str().unwrap()), "{sentence}");
        assert!(fs::metadata(&files[0]).unwrap().len() > 1000);
        assert_eq!(slot.percent(), None);
    }

    #[test]
    fn a_film_that_is_cancelled_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut slot = CaptureSlot::default();
        let farm = begin(&mut slot, folder.path());
        slot.cancel();
        drop(farm);
        while fs::read_dir(folder.path()).unwrap().count() > 0 {
            std::thread::yield_now();
        }
    }
}
