//! Worker: the thread that owns the farm and carries out what the window wants.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_farm::{
    Balancing, Distribution, Error, Farm, FarmConfig, Live, LiveView, Picture, SceneFile,
};
use carom_tracer::{ImageSize, Scene, SceneUpdate};
use carom_window::display::DisplayFrame;

use super::document::{Document, FileWatch, Reading};
use super::save::Saving;
use super::{Accuracy, Exchange, OpenedScene, SceneLook, ShownPicture, Wanted};
use crate::lights::LightSwitches;

/// Runs until the window is closed.
pub(super) fn run(config: FarmConfig, accuracy: Accuracy, exchange: &Arc<Exchange>) {
    let applied = (config.balancer, config.distribution);
    let farm = match Farm::new(config) {
        Ok(farm) => farm,
        Err(why) => {
            tracing::error!("the farm: {why}");
            return exchange.post(|news| news.fault = Some(why.to_string()));
        }
    };
    let mut worker = Worker {
        exchange,
        accuracy,
        farm,
        divided: applied,
        document: None,
        documents: 0,
        files_asked: 0,
        reading: None,
        watch: None,
        view: None,
        view_of: None,
        view_scene: None,
        is_stuck: false,
        lost: None,
        picture: None,
        pictures: 0,
        shown: Instant::now(),
        saving: None,
        saves_asked: 0,
    };
    while let Some(wanted) = worker.exchange.wait(worker.patience()) {
        worker.divide(&wanted);
        worker.open(&wanted);
        worker.follow(&wanted);
        worker.show(&wanted);
        worker.save(&wanted);
        worker.tell(&wanted);
    }
}

struct Worker<'a> {
    exchange: &'a Arc<Exchange>,
    accuracy: Accuracy,
    farm: Farm,
    divided: (Balancing, Distribution),
    document: Option<Document>,
    /// Number of scenes opened so far.
    documents: u64,
    /// Number of the last request for a file.
    files_asked: u64,
    reading: Option<Reading>,
    watch: Option<FileWatch>,
    view: Option<LiveView>,
    /// The number of the view's scene, and its lights.
    view_of: Option<(u64, LightSwitches)>,
    /// The scene that was last passed to the view.
    view_scene: Option<Arc<Scene>>,
    /// Whether the wanted time cannot be shown.
    is_stuck: bool,
    /// Since when there has been no view because no node was available.
    lost: Option<Instant>,
    /// The newest picture, and the exposure at which it has been shown.
    picture: Option<(Picture, Option<f32>)>,
    /// Number of pictures shown.
    pictures: u64,
    shown: Instant,
    saving: Option<Saving>,
    saves_asked: u64,
}

impl Worker<'_> {
    /// The maximum wait for events.
    fn patience(&self) -> Duration {
        match self.view {
            Some(_) => SHOW_PERIOD,
            None => REST_PERIOD,
        }
    }

    fn divide(&mut self, wanted: &Wanted) {
        let (balancing, distribution) = (wanted.balancing, wanted.distribution);
        if self.divided.0 != balancing {
            self.farm.set_balancing(balancing);
        }
        if self.divided.1 != distribution {
            self.farm.set_distribution(distribution);
        }
        self.divided = (balancing, distribution);
    }

    /// Reads a file that is wanted or has changed, and opens one that has been read.
    fn open(&mut self, wanted: &Wanted) {
        if let Some(read) = self.reading.as_ref().and_then(Reading::poll)
            && let Some(Reading {
                path, is_reread, ..
            }) = self.reading.take()
        {
            self.exchange.post(|news| news.reading = None);
            match read {
                Ok(file) => self.opened(path, file, is_reread, wanted),
                Err(why) => self.exchange.post(|news| news.refused = Some(why)),
            }
        }
        if self.reading.is_some() {
            return;
        }
        if let Some((asked, path)) = &wanted.file
            && *asked != self.files_asked
        {
            self.files_asked = *asked;
            return self.read(path.clone());
        }
        if let Some(path) = self.watch.as_mut().and_then(FileWatch::changed) {
            self.read(path);
        }
    }

    fn read(&mut self, path: PathBuf) {
        let is_same = |document: &Document| document.path == path;
        let is_reread = self.document.as_ref().is_some_and(is_same);
        self.watch = Some(FileWatch::new(&path));
        match Reading::begin(path.clone(), is_reread, self.exchange) {
            Ok(reading) => {
                self.reading = Some(reading);
                self.exchange.post(|news| news.reading = Some(path));
            }
            Err(why) => self
                .exchange
                .post(|news| news.refused = Some(why.to_string())),
        }
    }

    fn opened(&mut self, path: PathBuf, file: SceneFile, is_reread: bool, wanted: &Wanted) {
        self.documents += 1;
        let scene = Arc::clone(file.scene());
        let copy = file.clone();
        let number = self.documents;
        let (mut camera, mut lights) = (scene.camera, LightSwitches::of(&scene));
        // A reread scene keeps its view.
        if let Some(look) = self.look(wanted).filter(|_| is_reread) {
            camera = look.camera;
            if look.lights.fit(&lights) {
                lights = look.lights;
            }
        }
        self.document = Some(Document {
            number,
            path: path.clone(),
            file,
            scene,
            update: SceneUpdate::default(),
            time: None,
            camera,
            lights,
        });
        let opened = OpenedScene {
            number,
            path,
            file: copy,
            is_reread,
        };
        self.exchange.post(|news| news.opened = Some(opened));
    }

    /// The view of the open scene.
    fn look(&self, wanted: &Wanted) -> Option<SceneLook> {
        let document = self.document.as_ref()?;
        let of_scene = |look: &&SceneLook| look.scene == document.number;
        Some(match wanted.look.as_ref().filter(of_scene) {
            Some(look) => look.clone(),
            None => SceneLook {
                scene: document.number,
                camera: document.camera,
                lights: document.lights.clone(),
                time: document.time,
            },
        })
    }

    /// Makes the live view show what is wanted.
    fn follow(&mut self, wanted: &Wanted) {
        let (Some(look), Some(size)) = (self.look(wanted), wanted.size) else {
            return;
        };
        self.recover();
        self.seek(&look);
        if self.view_of.as_ref() != Some(&(look.scene, look.lights.clone())) {
            self.begin_view(&look, size, wanted);
        }
        let is_saving = self.saving.is_some();
        let (Some(view), Some(document)) = (&mut self.view, &self.document) else {
            return;
        };
        // Paused while a file is saved, which then has the farm to itself.
        view.set_paused(wanted.is_paused || is_saving);
        view.set_quality_preference(wanted.preference);
        let followed = view.resize(size.width, size.height);
        let update = document.update.clone().camera(look.camera);
        let shown = self.view_scene.as_ref();
        let followed = followed.and_then(|()| {
            // An update suffices while the file yields the same scene; other lights have begun a new view
            // above.
            if shown.is_some_and(|shown| Arc::ptr_eq(shown, &document.scene)) {
                return view.set_update(update);
            }
            view.set_scene(&self.farm, &look.lights.apply(&document.scene), update)
        });
        self.view_scene = Some(Arc::clone(&document.scene));
        if let Err(why) = followed {
            self.fail(&why);
        }
    }

    /// Moves to the wanted time.
    fn seek(&mut self, look: &SceneLook) {
        let Some(document) = &mut self.document else {
            return;
        };
        if document.time == look.time {
            return;
        }
        let sentence = match document.seek(look.time) {
            Ok(()) => String::new(),
            Err(why) => why.to_string(),
        };
        if !sentence.is_empty() || self.is_stuck {
            self.is_stuck = !sentence.is_empty();
            self.exchange.post(|news| news.fault = Some(sentence));
        }
    }

    /// Restarts the view once a node is available, after there was none.
    fn recover(&mut self) {
        let Some(since) = self.lost else { return };
        let has_node = || self.farm.nodes().iter().any(|node| node.state.is_ready());
        if since.elapsed() > RECOVERY_PERIOD && has_node() {
            self.lost = None;
            self.view_of = None;
        }
    }

    fn begin_view(&mut self, look: &SceneLook, size: ImageSize, wanted: &Wanted) {
        let Some(document) = &self.document else {
            return;
        };
        self.view = None;
        self.lost = None;
        self.view_of = Some((look.scene, look.lights.clone()));
        self.view_scene = Some(Arc::clone(&document.scene));
        self.exchange.post(|news| news.fault = Some(String::new()));
        if look.lights.is_dark() {
            self.picture = None;
            return self.exchange.post(|news| news.is_cleared = true);
        }
        let scene = look.lights.apply(&document.scene);
        let notified = Arc::clone(self.exchange);
        let live = Live::new(size.width, size.height)
            .samples(self.accuracy.samples)
            .max_depth(self.accuracy.max_depth)
            .drafts(wanted.preference)
            .on_frame(move || notified.notify());
        match self.farm.live(&scene, live) {
            Ok(view) => self.view = Some(view),
            Err(why) => self.fail(&why),
        }
    }

    /// Ends the view until something else is wanted.
    fn fail(&mut self, why: &Error) {
        tracing::warn!("{why}");
        if matches!(why, Error::NoNodes { .. }) {
            self.lost = Some(Instant::now());
        }
        self.view = None;
        let sentence = why.to_string();
        self.exchange.post(|news| news.fault = Some(sentence));
    }

    /// Passes the newest picture on. While nothing changes this is done less often, so as not to take time
    /// from sampling.
    fn show(&mut self, wanted: &Wanted) {
        let is_shown = self.picture.as_ref().is_some_and(|(_, at)| at.is_some());
        let is_due = self.shown.elapsed() >= SHOW_PERIOD || !is_shown || self.is_draft(wanted);
        if let Some(view) = self.view.as_mut().filter(|_| is_due) {
            match view.latest() {
                Ok(Some(picture)) => self.picture = Some((picture, None)),
                Ok(None) => {}
                Err(why) => self.fail(&why),
            }
        }
        let is_draft = self.is_draft(wanted);
        let Some((picture, shown_at)) = &mut self.picture else {
            return;
        };
        if *shown_at == Some(wanted.exposure) {
            return;
        }
        *shown_at = Some(wanted.exposure);
        self.pictures += 1;
        self.shown = Instant::now();
        let exposed = picture.clone().with_exposure(wanted.exposure);
        let frame = DisplayFrame {
            serial: self.pictures,
            size: exposed.size(),
            rgba: exposed.rgba8(),
            update: SceneUpdate::default(),
        };
        let samples = picture.samples();
        let shown = ShownPicture {
            frame,
            samples,
            is_draft,
        };
        self.exchange.post(|news| {
            news.is_cleared = false;
            news.picture = Some(shown);
        });
    }

    /// Whether the newest picture is a draft, shown while things change.
    fn is_draft(&self, wanted: &Wanted) -> bool {
        let picture = self.picture.as_ref();
        picture.is_none_or(|(picture, _)| {
            Some(picture.size()) != wanted.size || picture.samples() < Live::DRAFT_SAMPLES
        })
    }

    /// Begins or cancels the saving of a file.
    fn save(&mut self, wanted: &Wanted) {
        if let Some(saving) = &self.saving {
            if saving.number <= wanted.cancelled_save {
                saving.cancel();
            }
            if saving.is_finished() {
                self.saving = None;
            }
        }
        let Some(order) = wanted.save.as_ref() else {
            return;
        };
        if order.number == self.saves_asked || self.saving.is_some() {
            return;
        }
        self.saves_asked = order.number;
        let (Some(document), Some(look)) = (&self.document, self.look(wanted)) else {
            return;
        };
        let (accuracy, exchange) = (self.accuracy, self.exchange);
        let seen = (document.file.clone(), look.lights);
        match Saving::begin(&mut self.farm, seen, accuracy, order.clone(), exchange) {
            Ok(saving) => {
                self.saving = Some(saving);
                // Wakes the worker, so that the live view is paused for it.
                self.exchange.notify();
            }
            Err(why) => self
                .exchange
                .post(|news| news.saved = Some(Err(why.to_string()))),
        }
    }

    /// Reports the farm's state.
    fn tell(&mut self, wanted: &Wanted) {
        let nodes = self.farm.nodes();
        let quality = self.view.as_ref().and_then(LiveView::quality);
        let frames = match &mut self.view {
            Some(view) if wanted.has_statistics => view.frames(),
            _ => Vec::new(),
        };
        // Without waking the window: it polls these when it shows them.
        let mut state = self.exchange.lock();
        let news = &mut state.news;
        news.nodes = Some(nodes);
        news.quality = quality.or(news.quality.take());
        news.frames.extend(frames);
        let surplus = news.frames.len().saturating_sub(FRAMES_MAX);
        news.frames.drain(..surplus);
    }
}

/// Period of passing on pictures that gather samples.
const SHOW_PERIOD: Duration = Duration::from_millis(80);
/// Period of checking an idle farm.
const REST_PERIOD: Duration = Duration::from_millis(250);
/// Minimum time before the view is restarted after there was no node.
const RECOVERY_PERIOD: Duration = Duration::from_secs(1);
/// Maximum number of frames waiting to be reported.
const FRAMES_MAX: usize = 256;
