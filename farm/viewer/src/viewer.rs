//! Viewer: the state of what is seen, independent of a window, so that tests can drive it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use carom_farm::NodeStatus;
use carom_farm::quality::{QUALITY_LEVELS, Quality};
use carom_text::text;
use carom_tracer::{Camera, ImageSize};
use carom_window::display::DisplayFrame;
use carom_window::notifications::{self, FarmNotifier};
use carom_window::stats::frame_record::FrameSample;
use carom_window::stats::{Stats, StatsCommand, StatsInput};
use carom_window::toasts::Toasts;
use egui::{Id, Key, Modifiers, Rect, Sense, Ui};

use crate::camera::OrbitCamera;
use crate::controls::{self, Walk};
use crate::lights::LightSwitches;
use crate::playback::Playback;
use crate::render::{News, OpenedScene, Renderer, SceneLook, ShownPicture};
use crate::save_form::{SaveForm, SaveKind};

/// State of the viewer; see the [module](self).
pub struct Viewer {
    pub(crate) renderer: Renderer,
    pub(crate) document: Option<OpenedScene>,
    pub(crate) camera: OrbitCamera,
    /// Index of the file's camera that is home.
    pub(crate) file_camera: usize,
    pub(crate) home_of: Option<HomeMoment>,
    pub(crate) lights: LightSwitches,
    pub(crate) playback: Playback,
    /// Exposure as a power of two.
    pub(crate) exposure_stops: f32,
    pub(crate) is_paused: bool,
    pub(crate) form: SaveForm,
    /// Samples per pixel to gather.
    pub(crate) samples: u32,
    pub(crate) picture: Option<ShownPicture>,
    pub(crate) has_panel: bool,
    pub(crate) has_help: bool,
    /// Whether a file is being dragged over the window.
    pub(crate) is_hovered: bool,
    /// A file that is being read.
    pub(crate) reading: Option<PathBuf>,
    /// The reason why a file could not be opened, until another is.
    pub(crate) refusal: Option<String>,
    /// The reason why there are no pictures; empty if there are.
    pub(crate) fault: String,
    /// Progress of the file that is being saved, 0 to 1.
    pub(crate) saving: Option<f64>,
    pub(crate) window: ImageSize,
    pub(crate) toasts: Toasts,
    notifier: FarmNotifier,
    nodes: Vec<NodeStatus>,
    stats: Stats,
    quality: Quality,
    walk: Walk,
    files_asked: u64,
    draw_secs: f64,
    has_moved: bool,
    wants_quit: bool,
    wants_fullscreen: bool,
}

/// Source of the current home camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HomeMoment {
    /// The number of the scene.
    pub(crate) scene: u64,
    /// Index of the file's camera.
    pub(crate) camera: usize,
    /// An animation and the time in it in seconds.
    pub(crate) time: Option<(usize, f64)>,
}

impl Viewer {
    /// A viewer without a scene. Pictures gather `samples` per pixel; files are saved into `folder`.
    pub fn new(renderer: Renderer, samples: u32, folder: &Path) -> Self {
        Self {
            renderer,
            document: None,
            camera: OrbitCamera::new(Camera::looking_at([0.0, -4.0, 2.0], [0.0; 3])),
            file_camera: 0,
            home_of: None,
            lights: LightSwitches::default(),
            playback: Playback::default(),
            exposure_stops: 0.0,
            is_paused: false,
            form: SaveForm::new(folder),
            samples,
            picture: None,
            has_panel: true,
            has_help: false,
            is_hovered: false,
            reading: None,
            refusal: None,
            fault: String::new(),
            saving: None,
            window: ImageSize::new(0, 0),
            toasts: Toasts::default(),
            notifier: FarmNotifier::without_latency(),
            nodes: Vec::new(),
            stats: Stats::new(folder.join(STATS_FOLDER)),
            quality: Quality::default(),
            walk: Walk::default(),
            files_asked: 0,
            draw_secs: 0.0,
            has_moved: false,
            wants_quit: false,
            wants_fullscreen: false,
        }
    }

    /// The renderer of the pictures.
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// Opens a scene file.
    pub fn open(&mut self, path: PathBuf) {
        self.is_hovered = false;
        self.refusal = None;
        self.files_asked += 1;
        let asked = self.files_asked;
        self.renderer
            .want(|wanted| wanted.file = Some((asked, path)));
    }

    /// Records whether a file is being dragged over the window.
    pub fn hover(&mut self, is_hovered: bool) {
        self.is_hovered = is_hovered;
    }

    /// Sets the exposure as a power of two, clamped to ±`STOPS_MAX`.
    pub fn set_exposure_stops(&mut self, stops: f32) {
        self.exposure_stops = stops.clamp(-STOPS_MAX, STOPS_MAX);
    }

    /// Sets the size of the window in pixels.
    pub fn resize(&mut self, window: ImageSize) {
        self.window = window;
    }

    /// Sets the duration of the last redraw in seconds.
    pub fn set_draw_secs(&mut self, draw_secs: f64) {
        self.draw_secs = draw_secs;
    }

    /// The picture to show.
    pub fn displayed(&self) -> Option<&DisplayFrame> {
        self.picture.as_ref().map(|picture| &picture.frame)
    }

    /// The window's title.
    pub fn title(&self) -> String {
        match self.file_name() {
            Some(file) => text!("view-title-file", file = file),
            None => text!("view-title").to_owned(),
        }
    }

    /// Whether the program should end.
    pub fn wants_quit(&self) -> bool {
        self.wants_quit
    }

    /// Whether the window should fill the screen.
    pub fn wants_fullscreen(&self) -> bool {
        self.wants_fullscreen
    }

    /// The time at which the next redraw without events is due, in seconds since the program began.
    pub fn next_secs(&self) -> Option<f64> {
        self.toasts.next_secs()
    }

    /// Takes in the renderer's news; returns whether a redraw is needed.
    pub fn take_news(&mut self, now_secs: f64) -> bool {
        let mut news = self.renderer.take_news();
        let mut is_new = news.is_cleared || self.reading != news.reading;
        is_new |= self.saving != news.saving;
        (self.reading, self.saving) = (news.reading.take(), news.saving);
        is_new |= self.take_document(&mut news);
        if let Some(why) = news.refused {
            self.refusal = Some(why);
            is_new = true;
        }
        if let Some(fault) = news.fault {
            self.fault = fault;
            is_new = true;
        }
        if news.is_cleared {
            self.picture = None;
        }
        if let Some(picture) = news.picture {
            self.picture = Some(picture);
            is_new = true;
        }
        if let Some(saved) = news.saved {
            self.saved(saved, now_secs);
            is_new = true;
        }
        self.quality = news.quality.unwrap_or_else(|| self.quality.clone());
        if let Some(nodes) = news.nodes {
            for sentence in self.notifier.observe(&nodes, now_secs) {
                self.toasts.push(sentence, now_secs);
                is_new = true;
            }
            self.nodes = nodes;
        }
        for frame in news.frames {
            self.stats.take(FrameSample {
                frame: frame.id.0,
                at_secs: now_secs,
                size: frame.size,
                samples: frame.samples,
                stats: frame.stats,
                nodes: &self.nodes,
            });
        }
        self.toasts.tick(now_secs, true) || is_new
    }

    fn take_document(&mut self, news: &mut News) -> bool {
        let Some(opened) = news.opened.take() else {
            return false;
        };
        let (scene, animations) = (opened.file.scene(), opened.file.animations());
        let lights = LightSwitches::of(scene);
        if opened.is_reread && self.document.is_some() {
            self.camera.set_home(scene.camera);
            if !self.lights.fit(&lights) {
                self.lights = lights;
            }
            self.playback.reread(Arc::clone(animations));
            self.file_camera *= usize::from(self.file_camera < opened.file.cameras().len());
        } else {
            self.camera = OrbitCamera::new(scene.camera);
            self.lights = lights;
            self.playback = Playback::new(Arc::clone(animations));
            self.file_camera = 0;
            self.form.range = None;
        }
        self.refusal = None;
        self.document = Some(opened);
        true
    }

    fn saved(&mut self, saved: Result<PathBuf, String>, now_secs: f64) {
        let sentence = match saved {
            Ok(path) => {
                self.form.go_on(&path);
                text!("view-file-saved", path = path.display().to_string())
            }
            Err(why) => text!("view-not-saved", why = why),
        };
        self.toasts.push(sentence, now_secs);
    }

    /// Messages that stay as long as their cause.
    pub(crate) fn standing(&self) -> Vec<String> {
        let file = |path: &PathBuf| file_name(path);
        let reading = self.reading.as_ref();
        let reading = reading.map(|path| text!("view-reading", file = file(path)));
        let dark = self.document.is_some() && self.lights.is_dark();
        let dark = dark.then(|| text!("view-dark").to_owned());
        let fault = (!self.fault.is_empty()).then(|| text!("view-fault", why = &self.fault));
        let nodes =
            match self.document.is_some() && self.picture.is_none() && !self.nodes.is_empty() {
                true => notifications::standing(&self.nodes),
                false => None,
            };
        let nodes = nodes.filter(|_| fault.is_none() && dark.is_none());
        [reading, dark, fault, nodes]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Draws the statistics; returns the part of the window that they leave free.
    pub(crate) fn draw_stats(&mut self, ui: &Ui, now_secs: f64, present: &str) -> Rect {
        let ctx = ui.ctx();
        if !self.stats.is_shown() {
            return ctx.content_rect();
        }
        let moves = std::mem::take(&mut self.has_moved);
        self.stats.note_redraw(now_secs, moves);
        let wanted = self.renderer.wanted();
        let is_draft = self.picture.as_ref().is_none_or(|picture| picture.is_draft);
        let input = StatsInput {
            nodes: &self.nodes,
            balancing: wanted.balancing,
            distribution: wanted.distribution,
            preference: wanted.preference,
            window: self.window,
            period_secs: match is_draft {
                true => self.quality.period_secs(),
                false => REFINEMENT_SECS,
            },
            stop: self.quality.level(),
            level_secs: QUALITY_LEVELS.map(|level| self.quality.secs(level, self.window)),
            lead_secs: 0.0,
            skipped: 0,
            disocclusion_fraction: None,
            draw_secs: self.draw_secs,
            present,
        };
        let room = self.stats.draw(ctx, now_secs, &input);
        for command in self.stats.take_commands() {
            self.renderer.want(|wanted| match command {
                StatsCommand::Balancing(balancing) => wanted.balancing = balancing,
                StatsCommand::Distribution(divided) => wanted.distribution = divided,
                StatsCommand::QualityPreference(preference) => wanted.preference = preference,
            });
        }
        room
    }

    /// Handles pressed keys.
    pub(crate) fn press(&mut self, ui: &Ui) {
        if ui.ctx().text_edit_focused() {
            return;
        }
        let pressed = |key: Key| ui.input(|input| input.key_pressed(key));
        let command = |key: Key| ui.input_mut(|input| input.consume_key(Modifiers::COMMAND, key));
        if command(Key::S) {
            self.save(SaveKind::Still);
        }
        if command(Key::Q) {
            self.wants_quit = true;
        }
        if pressed(Key::F1) {
            self.has_help = !self.has_help;
        }
        if pressed(Key::F2) {
            self.has_panel = !self.has_panel;
        }
        if pressed(Key::F3) {
            self.stats.set_level(self.stats.level().next());
        }
        if pressed(Key::F11) {
            self.wants_fullscreen = !self.wants_fullscreen;
        }
        if pressed(Key::Escape) {
            self.close();
        }
        if pressed(Key::Home) {
            self.go_home();
        }
        if pressed(Key::C) {
            self.next_camera();
        }
        if pressed(Key::P) {
            self.is_paused = !self.is_paused;
        }
        if pressed(Key::Space) && ui.ctx().memory(|memory| memory.focused().is_none()) {
            self.playback.toggle();
        }
        if pressed(Key::R)
            && let Some(document) = &self.document
        {
            self.open(document.path.clone());
        }
        let brighter = pressed(Key::Plus) || pressed(Key::Equals);
        let steps = f32::from(i8::from(brighter) - i8::from(pressed(Key::Minus)));
        if steps != 0.0 {
            self.set_exposure_stops(self.exposure_stops + STOPS_STEP * steps);
        }
        for (number, key) in NUMBER_KEYS.into_iter().enumerate() {
            if pressed(key) {
                self.lights.toggle(number);
            }
        }
    }

    /// Closes the help or else the message about a refused file.
    fn close(&mut self) {
        if self.has_help {
            self.has_help = false;
        } else {
            self.refusal = None;
        }
    }

    /// Returns to the scene's own camera and exposure.
    pub(crate) fn go_home(&mut self) {
        self.camera.go_home();
        self.exposure_stops = 0.0;
    }

    /// Advances the animation.
    pub(crate) fn play(&mut self, ui: &Ui, now_secs: f64) {
        self.playback.advance(now_secs);
        if self.playback.is_playing() {
            self.has_moved = true;
            ui.ctx().request_repaint();
        }
    }

    /// Moves the camera by pointer and keys.
    pub(crate) fn look(&mut self, ui: &Ui, now_secs: f64) {
        let whole = ui.ctx().content_rect();
        let picture = ui.interact(whole, Id::unique("picture"), Sense::click_and_drag());
        if picture.clicked() || picture.dragged() {
            // Gives the keyboard back to the camera.
            ui.ctx().memory_mut(|memory| memory.stop_text_input());
        }
        let has_text = ui.ctx().text_edit_focused();
        let velocity = match has_text || self.document.is_none() {
            true => glam::DVec3::ZERO,
            false => controls::held(ui),
        };
        let way = self.walk.advance(velocity, now_secs);
        if way != glam::DVec3::ZERO {
            self.camera.walk(way);
        }
        if self.walk.is_going() {
            ui.ctx().request_repaint();
        }
        let is_pointed = self.document.is_some() && controls::point(&mut self.camera, &picture, ui);
        self.has_moved |= is_pointed || way != glam::DVec3::ZERO;
    }

    /// Passes the wanted state to the renderer if it has changed.
    pub(crate) fn follow(&mut self) {
        self.follow_camera();
        let look = self.document.as_ref().map(|document| SceneLook {
            scene: document.number,
            camera: self.camera.camera(),
            lights: self.lights.clone(),
            time: self.playback.time(),
        });
        let size = (self.window.pixels() > 0).then_some(self.window);
        let now = (size, self.exposure(), self.is_paused, self.stats.is_shown());
        let wanted = self.renderer.wanted();
        let before = (
            wanted.size,
            wanted.exposure,
            wanted.is_paused,
            wanted.has_statistics,
        );
        if look == wanted.look && now == before {
            return;
        }
        self.renderer.want(|wanted| {
            wanted.look = look;
            (
                wanted.size,
                wanted.exposure,
                wanted.is_paused,
                wanted.has_statistics,
            ) = now;
        });
    }

    /// The factor on radiance for display.
    pub(crate) fn exposure(&self) -> f32 {
        self.exposure_stops.exp2()
    }

    pub(crate) fn file_name(&self) -> Option<String> {
        let document = self.document.as_ref()?;
        Some(file_name(&document.path))
    }
}

/// The name of a file without its folder.
fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Maximum exposure in powers of two.
pub(crate) const STOPS_MAX: f32 = 10.0;
/// Change of exposure per key press, in powers of two.
const STOPS_STEP: f32 = 0.5;
/// Time in seconds after which a refined picture counts as late.
const REFINEMENT_SECS: f64 = 1.0;
/// Folder for recordings of statistics.
const STATS_FOLDER: &str = "carom-stats";
/// Keys of the sky and the first lamps.
const NUMBER_KEYS: [Key; 10] = [
    Key::Num0,
    Key::Num1,
    Key::Num2,
    Key::Num3,
    Key::Num4,
    Key::Num5,
    Key::Num6,
    Key::Num7,
    Key::Num8,
    Key::Num9,
];
