//! Event loop of the window, and the start of a game in it.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, anyhow};
use carom_billiards::game_match::{Match, MatchSave};
use carom_billiards::rules::RuleSet;
use carom_farm::FarmConfig;
use carom_text::text;
use carom_tracer::ImageSize;
use carom_window::connection::{WindowError, open_event_loop};
use carom_window::display::Present;
use carom_window::screen::Screen;
use carom_window::theme;
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::WindowEvent;
use winit::event_loop::ActiveEventLoop;
use winit::window::{Fullscreen, Window, WindowId};

use super::window;
use super::window_events::translate;
use crate::app::app_shell::AppShell;
#[cfg(feature = "gamepad")]
use crate::app::gamepads::Gamepads;
use crate::app::session::GameSession;
use crate::args::{Args, HEADLESS_COMMAND};
use crate::audio::Playback;
use crate::audio::playback::SoundOutput;
use crate::capture::ShotRecorder;
use crate::input::Event;
use crate::play;
use crate::scene::table_scene::TableScene;
use crate::settings::{Settings, SettingsStore, set_aside};

/// Runs the game in a window until it is closed.
///
/// # Errors
/// If arguments, files or the scene are invalid, or no window can be opened or drawn to; the message then
/// says what to install.
pub fn run(args: &Args, mut config: FarmConfig, present: Option<Present>) -> anyhow::Result<()> {
    let event_loop = open_event_loop::<()>(HEADLESS_COMMAND)?;
    let (_, recording) = args.table_and_recording()?;
    let settings = store(args);
    let kept_in = settings.path().map(|path| path.with_file_name(MATCH_FILE));
    let mut notes = Vec::new();
    let options = settings.settings.table;
    let asked = args.contest(options)?;
    let is_open = asked.is_none();
    let contest = match begun(asked, kept_in.as_deref(), &mut notes)? {
        Some(contest) => contest,
        None => play::free_table(TableScene::table().with_options(options), args.seed)?,
    };
    let chosen = &settings.settings;
    if config.threads == 0 {
        config.threads = chosen.threads;
    }
    let mut session = GameSession::new(config, contest, chosen.style)?;
    if let Some(path) = kept_in {
        session.autosave_to(path);
    }
    session.show_opening_still();
    session.apply(chosen);
    if let Some(folder) = &args.record {
        session.record(ShotRecorder::new(folder.clone())?);
    }
    if let Some(recording) = recording {
        session.view(recording);
    }
    let applied = settings.settings.clone();
    let playback = Playback::new(SoundOutput::of_system());
    if playback.is_silent() {
        notes.push(playback.state());
    }
    let mut shell = AppShell::new(settings, playback);
    for note in notes {
        shell.notify(note, 0.0);
    }
    if is_open {
        shell.welcome();
    }
    let mut app = App {
        #[cfg(feature = "gamepad")]
        gamepads: Gamepads::start(event_loop.create_proxy()),
        session,
        applied,
        shell,
        size: args.size,
        present,
        screen: None,
        events: Vec::new(),
        pointer: egui::Pos2::ZERO,
        begun: Instant::now(),
        next_redraw: Instant::now(),
        failure: None,
    };
    event_loop.run_app(&mut app)?;
    app.leave();
    app.failure.map_or(Ok(()), Err)
}

/// The unfinished match of the last run; an unreadable file is moved aside.
fn left(path: Option<&Path>, notes: &mut Vec<String>) -> Option<Match> {
    let kept = path.map_or(Ok(None), MatchSave::load);
    let played = kept.and_then(|record| record.map(|record| record.play()).transpose());
    match played {
        Ok(contest) => contest.filter(|contest| contest.at_table().is_some()),
        Err(why) => {
            notes.push(text!("match-not-resumed", why = why.to_string()));
            let aside = path.and_then(|path| set_aside(path, "broken").ok());
            notes.extend(
                aside.map(|aside| text!("match-kept-aside", path = aside.display().to_string())),
            );
            None
        }
    }
}

/// The requested match, or without one the unfinished match of the last run. The file of an unfinished
/// match that is replaced is kept under another name.
fn begun(
    asked: Option<Match>,
    path: Option<&Path>,
    notes: &mut Vec<String>,
) -> anyhow::Result<Option<Match>> {
    let left = left(path, notes);
    if let (Some(_), Some(left), Some(path)) = (&asked, &left, path)
        && left.view().is_unfinished()
    {
        let aside = set_aside(path, "unfinished").with_context(|| path.display().to_string())?;
        notes.push(text!(
            "match-set-aside",
            game = left.referee().info().name,
            path = aside.display().to_string(),
            name = MATCH_FILE
        ));
    } else if let (None, Some(left)) = (&asked, &left)
        && left.referee().rules() != RuleSet::Free
    {
        let game = left.referee().info().name;
        notes.push(text!("match-resumed", game = game));
    }
    Ok(asked.or(left))
}

/// The player's settings, overridden for this run by options of the command line.
fn store(args: &Args) -> SettingsStore {
    let mut store = match &args.settings {
        Some(path) => SettingsStore::open(path.clone()),
        None => SettingsStore::of_player(),
    };
    store.with_override(|settings| {
        let table = &mut settings.table;
        table.pockets = args.table.pockets.unwrap_or(table.pockets);
        table.speed = args.table.table_speed.unwrap_or(table.speed);
        settings.style = args.style(settings.style);
        settings.physics = args.physics.unwrap_or(settings.physics);
    });
    store
}

pub(super) struct App {
    #[cfg(feature = "gamepad")]
    pub(super) gamepads: Gamepads,
    pub(super) session: GameSession,
    pub(super) shell: AppShell,
    /// The settings that have been applied to window and session.
    applied: Settings,
    size: Option<ImageSize>,
    present: Option<Present>,
    pub(super) screen: Option<Screen>,
    /// Events since the last frame.
    pub(super) events: Vec<QueuedEvent>,
    /// Last position of the pointer, in points.
    pointer: egui::Pos2,
    pub(super) begun: Instant,
    pub(super) next_redraw: Instant,
    failure: Option<anyhow::Error>,
}

/// Cause of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FrameCause {
    /// Events, or the timer for polling the farm and advancing time.
    Poll,
    /// The window has to be drawn.
    Redraw,
}

/// An event that waits for the next frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct QueuedEvent {
    pub(super) event: Event,
    /// Whether the interface has consumed it.
    pub(super) is_taken: bool,
    /// Time at which it happened, on which the speed of a swing depends.
    pub(super) at_secs: f64,
}

impl ApplicationHandler for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.screen.is_some() {
            return;
        }
        match self.open(event_loop) {
            Ok(screen) => {
                self.follow_size(&screen);
                screen.window.request_redraw();
                self.screen = Some(screen);
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(screen) = &mut self.screen else {
            return;
        };
        let taken = screen.input.on_window_event(&screen.window, &event);
        if taken.repaint {
            self.session.redraw();
        }
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => self.frame(event_loop, FrameCause::Redraw),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.resized(),
            WindowEvent::Occluded(hidden) => self.session.set_hidden(hidden),
            event => {
                let scale = f64::from(egui_winit::pixels_per_point(&screen.egui, &screen.window));
                if let Some(event) = translate(&event, scale) {
                    self.events.push(QueuedEvent {
                        event,
                        is_taken: taken.consumed
                            || window::is_over_panel(screen, &mut self.pointer, event),
                        at_secs: self.begun.elapsed().as_secs_f64(),
                    });
                }
            }
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.frame(event_loop, FrameCause::Poll);
    }
}

impl App {
    fn open(&self, event_loop: &ActiveEventLoop) -> anyhow::Result<Screen> {
        let settings = self.shell.settings();
        let attributes = Window::default_attributes().with_title(text!("window-title"));
        let attributes = match self.size {
            Some(size) => attributes.with_inner_size(PhysicalSize::new(size.width, size.height)),
            None => {
                let [width, height] = settings.window.map(f64::from);
                attributes.with_inner_size(LogicalSize::new(width, height))
            }
        };
        let attributes = attributes.with_fullscreen(fullscreen(settings.fullscreen));
        let window = event_loop.create_window(attributes);
        let window = window.map_err(|why| WindowError::not_opened(HEADLESS_COMMAND, why))?;
        self.open_screen(Arc::new(window), event_loop, self.present)
    }

    fn open_screen(
        &self,
        window: Arc<Window>,
        event_loop: &ActiveEventLoop,
        present: Option<Present>,
    ) -> anyhow::Result<Screen> {
        let screen = Screen::open(window, event_loop, present, HEADLESS_COMMAND)?;
        window::apply_theme(&screen, self.shell.settings());
        Ok(screen)
    }

    /// Applies changed settings to window and session.
    pub(super) fn apply_settings(&mut self, event_loop: &ActiveEventLoop) {
        if *self.shell.settings() == self.applied {
            return;
        }
        let now = self.shell.settings().clone();
        let before = std::mem::replace(&mut self.applied, now.clone());
        self.session.apply(&now);
        if now.style != before.style
            && let Err(error) = self.session.set_style(now.style)
        {
            return self.fail(event_loop, error);
        }
        if let Some(screen) = &self.screen {
            if now.fullscreen != before.fullscreen {
                screen.window.set_fullscreen(fullscreen(now.fullscreen));
            }
            window::apply_theme(screen, &now);
        }
        self.session.redraw();
        self.resized();
    }

    /// Saves the window's size in the settings.
    fn leave(&mut self) {
        if let Some(screen) = &self.screen
            && screen.window.fullscreen().is_none()
            && self.size.is_none()
        {
            let size = screen
                .window
                .inner_size()
                .to_logical::<f64>(screen.window.scale_factor());
            let [min, max] = Settings::WINDOW_EDGE;
            let edge = |points: f64| (points.round() as u32).clamp(min, max);
            self.shell.settings_mut().window = [edge(size.width), edge(size.height)];
        }
        self.shell.save(self.begun.elapsed().as_secs_f64());
    }

    fn follow_size(&mut self, screen: &Screen) {
        let scale = window::text_scale(screen, self.shell.settings());
        theme::set_scale(&screen.egui, scale);
        self.session.resize(screen.size());
    }

    fn resized(&mut self) {
        let Some(mut screen) = self.screen.take() else {
            return;
        };
        screen.display.resize(screen.size());
        self.follow_size(&screen);
        self.screen = Some(screen);
    }

    /// Replaces a display that has failed by the software one, unless it is that already or the player has
    /// chosen the display explicitly.
    pub(super) fn replace_display(&mut self, event_loop: &ActiveEventLoop, why: &str) {
        let Some(screen) = &self.screen else {
            return;
        };
        if screen.display.is_software() || self.present.is_some() {
            let error = anyhow!("{} failed: {why}", screen.display.name());
            return self.fail(event_loop, error);
        }
        tracing::warn!("{}: {why}; continuing without a GPU", screen.display.name());
        let window = screen.window.clone();
        match self.open_screen(window, event_loop, Some(Present::Software)) {
            Ok(reopened) => self.screen = Some(reopened),
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: anyhow::Error) {
        self.failure = Some(error);
        event_loop.exit();
    }
}

fn fullscreen(wanted: bool) -> Option<Fullscreen> {
    wanted.then_some(Fullscreen::Borderless(None))
}

/// Name of the match's file, beside the settings.
const MATCH_FILE: &str = "match.carom";

#[cfg(test)]
mod tests {
    use carom_billiards::game_match::{MatchConfig, Player, play_out};

    use super::*;

    /// An 8-ball match of two computers.
    fn match_of_computers() -> Match {
        let players = Player::list("ai:easy,ai:easy").unwrap();
        let config = MatchConfig::new(RuleSet::Eight, players, 1).unwrap();
        Match::new(config).unwrap()
    }

    #[test]
    fn a_match_that_is_asked_for_sets_an_unfinished_one_aside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(MATCH_FILE);
        let aside = path.with_extension("unfinished.carom");
        let mut notes = Vec::new();
        let mut left = match_of_computers();
        for is_kept in [false, true] {
            MatchSave::of(&left).save(&path).unwrap();
            let asked = Some(match_of_computers());
            let begun = begun(asked, Some(&path), &mut notes).unwrap().unwrap();
            assert_eq!(begun.action_count(), 0);
            assert_eq!((aside.exists(), path.exists()), (is_kept, !is_kept));
            play_out(&mut left, 1).unwrap();
        }
        let kept = MatchSave::load(&aside).unwrap().unwrap();
        assert_eq!(kept.play().unwrap().turns().len(), 1);
        assert!(notes[0].contains(aside.to_str().unwrap()), "{notes:?}");
    }

    #[test]
    fn a_damaged_match_is_kept_aside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(MATCH_FILE);
        std::fs::write(&path, "torn").unwrap();
        let mut notes = Vec::new();
        let contest = begun(None, Some(&path), &mut notes).unwrap();
        assert!(contest.is_none());
        let aside = path.with_extension("broken.carom");
        assert_eq!(std::fs::read(&aside).unwrap(), b"torn");
        assert!(!path.exists());
        assert!(notes[1].contains(aside.to_str().unwrap()), "{notes:?}");
    }
}
