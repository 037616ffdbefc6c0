//! Saving of stills and films: traced in the background and written by a thread of their own.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use carom_farm::{
    Canceller, Error, Farm, FileFormat, Film, FilmFormat, FilmFrames, FilmProgress, FilmState,
    SceneFile, Still, StillProgress,
};
use carom_text::text;
use carom_tracer::{RenderSettings, Scene, SceneUpdate};

use super::{Accuracy, Exchange, FrameCamera, FrameView, SaveOrder};
use crate::lights::LightSwitches;

/// File that is being traced and written. Dropping it cancels it and waits.
pub(super) struct Saving {
    pub(super) number: u64,
    canceller: Canceller,
    thread: Option<JoinHandle<()>>,
}

impl Saving {
    /// Begins to trace the `order` of a scene file with these lights.
    ///
    /// # Errors
    /// The farm's refusal, an unknown format, a still that cannot be drawn, or the system's error about a
    /// thread.
    pub(super) fn begin(
        farm: &mut Farm,
        (file, lights): (SceneFile, LightSwitches),
        accuracy: Accuracy,
        order: SaveOrder,
        exchange: &Arc<Exchange>,
    ) -> Result<Self, Error> {
        let shared = Arc::clone(exchange);
        let (number, path) = (order.number, order.path.clone());
        let scene = Arc::new(lights.apply(file.scene()));
        let mut states = FrameStates {
            lit: (Arc::clone(file.scene()), Arc::clone(&scene)),
            scene: Arc::clone(&scene),
            file,
            lights,
            views: Arc::clone(&order.views),
        };
        let (canceller, write): (_, Box<dyn FnOnce() -> Result<(), Error> + Send>) =
            match order.frames_per_sec {
                None => {
                    let state = states.state(0)?;
                    let still = still(&order, state.update, accuracy, exchange)?;
                    let job = farm.still(&state.scene.unwrap_or(scene), still)?;
                    let canceller = job.canceller();
                    (canceller, Box::new(move || job.wait()?.save(&order.path)))
                }
                Some(rate) => {
                    let film = film(&order, states, accuracy, exchange)?;
                    let job = farm.film(&scene, film, frames_folder(&order.path))?;
                    let canceller = job.canceller();
                    let write = move || finish_film(job.wait()?, &order.path, rate);
                    (canceller, Box::new(write))
                }
            };
        exchange.post(|news| news.saving = Some(0.0));
        let run = move || {
            let saved = write().map(|()| path).map_err(|why| sentence(&why));
            shared.post(|news| {
                news.saving = None;
                news.saved = Some(saved);
            });
            shared.notify();
        };
        let thread = std::thread::Builder::new().name("carom-view-save".to_owned());
        Ok(Self {
            number,
            canceller,
            thread: Some(thread.spawn(run).map_err(Error::Thread)?),
        })
    }

    pub(super) fn cancel(&self) {
        self.canceller.cancel();
    }

    pub(super) fn is_finished(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for Saving {
    fn drop(&mut self) {
        self.cancel();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic has been reported where it happened
        }
    }
}

/// Source of the scene state of each picture of an order.
struct FrameStates {
    /// The scene without animations, with its lights switched.
    scene: Arc<Scene>,
    file: SceneFile,
    lights: LightSwitches,
    views: Arc<[FrameView]>,
    /// The file's last scene, and the same with its lights switched.
    lit: (Arc<Scene>, Arc<Scene>),
}

impl FrameStates {
    fn state(&mut self, frame: u32) -> Result<FilmState, Error> {
        let FrameView { camera, time } = self.views[frame as usize];
        let (scene, update) = match time {
            Some((animation, secs)) => self.file.seek(animation, secs)?,
            None => (Arc::clone(self.file.scene()), SceneUpdate::default()),
        };
        let camera = match camera {
            FrameCamera::Placed(camera) => camera,
            FrameCamera::OfFile(number) => self.file.camera(number, time)?,
        };
        if !Arc::ptr_eq(&self.lit.0, &scene) {
            let lit = Arc::new(self.lights.apply(&scene));
            self.lit = (scene, lit);
        }
        let (_, lit) = &self.lit;
        Ok(FilmState {
            // `None` stands for the scene with which the film was begun.
            scene: (!Arc::ptr_eq(lit, &self.scene)).then(|| Arc::clone(lit)),
            update: update.camera(camera),
        })
    }

    /// A key that distinguishes these frames from all others of the same scene.
    fn key(&self) -> String {
        format!("{} {:?} {:?}", self.file.key(), self.lights, self.views)
    }
}

fn still(
    order: &SaveOrder,
    update: SceneUpdate,
    accuracy: Accuracy,
    shared: &Arc<Exchange>,
) -> Result<Still, Error> {
    let format = FileFormat::of(&order.path)?;
    let shared = Arc::clone(shared);
    let still = Still::new(order.size.width, order.size.height)
        .samples(order.samples)
        .max_depth(accuracy.max_depth)
        .exposure(order.exposure)
        .update(update)
        .background()
        .on_progress(move |progress: &StillProgress| {
            let fraction = progress.fraction();
            shared.post(|news| news.saving = Some(fraction));
        });
    Ok(match format {
        FileFormat::Exr => still.layers(),
        _ => still,
    })
}

fn film(
    order: &SaveOrder,
    mut states: FrameStates,
    accuracy: Accuracy,
    shared: &Arc<Exchange>,
) -> Result<Film, Error> {
    FilmFormat::of(&order.path)?;
    let shared = Arc::clone(shared);
    let (frames, key) = (states.views.len(), states.key());
    let make = move |frame| states.state(frame);
    let settings = RenderSettings {
        samples: order.samples,
        max_depth: accuracy.max_depth,
        ..RenderSettings::default()
    };
    let film = Film::of_states(order.size.width, order.size.height, frames, key, make)
        .settings(settings)
        .exposure(order.exposure)
        .background()
        .on_progress(move |progress: &FilmProgress| {
            let partly = f64::from(progress.tiles_done) / f64::from(progress.tiles.max(1));
            let partly = if progress.tiles == 0 { 0.0 } else { partly };
            let done = f64::from(progress.frames_done) + partly.min(1.0);
            let fraction = (done / f64::from(progress.frames.max(1))).min(1.0);
            shared.post(|news| news.saving = Some(fraction));
        });
    Ok(film)
}

fn finish_film(frames: FilmFrames, path: &Path, frames_per_sec: u16) -> Result<(), Error> {
    frames.save(path, frames_per_sec)?;
    frames.remove()
}

/// The folder for the frames of an unfinished film; saving again under the same name resumes with them.
fn frames_folder(path: &Path) -> PathBuf {
    let mut folder = path.as_os_str().to_owned();
    folder.push(".frames");
    folder.into()
}

fn sentence(why: &Error) -> String {
    match why {
        Error::Cancelled { .. } => text!("view-save-cancelled").to_owned(),
        Error::FilmCancelled {
            frames_done,
            frames,
        } => text!("view-film-cancelled", done = *frames_done, frames = *frames),
        why => why.to_string(),
    }
}
