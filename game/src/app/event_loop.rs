//! The window: winit's events to the session and the session's picture to the display.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use carom_billiards::game_match::{Match, MatchSave};
use carom_billiards::rules::RuleSet;
use carom_farm::FarmConfig;
use carom_tracer::ImageSize;
use egui_winit::State as EguiState;
use glam::DVec2;
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::PhysicalKey;
use winit::window::{Fullscreen, Window, WindowId};

use crate::app::app_shell::AppShell;
use crate::app::session::GameSession;
use crate::args::Args;
use crate::audio::Playback;
use crate::audio::playback::PlayerProgram;
use crate::display::{Display, Present, UiFrame};
use crate::input::{Button, Event, Key};
use crate::play::{self, Outcome};
use crate::scene::table_scene::TableScene;
use crate::settings::{Settings, SettingsStore};
use crate::ui::{self, input_batches::passes};

/// Plays in a window until it is closed.
///
/// # Errors
/// What was tried and what to install, if no window can be opened or drawn on.
pub fn run(args: &Args, config: FarmConfig, present: Option<Present>) -> anyhow::Result<()> {
    let event_loop = open_event_loop()?;
    let (_, recording) = args.table_and_recording()?;
    let settings = store(args);
    let kept_in = settings.path().map(|path| path.with_file_name(MATCH_FILE));
    let mut notes = Vec::new();
    let contest = match args.contest()? {
        Some(contest) => contest,
        None => left(kept_in.as_deref(), &mut notes, args.seed).map_err(anyhow::Error::msg)?,
    };
    let chosen = &settings.settings;
    let mut session = GameSession::new(config, contest, chosen.ball_set)?;
    if let Some(path) = kept_in {
        session.autosave_to(path);
    }
    session.set_engine(chosen.physics);
    session.set_quality_preference(chosen.quality);
    session.set_aids(chosen.aim_aids);
    session.set_instant_camera(chosen.reduced_motion);
    if let Some(folder) = &args.record {
        session.record(folder.clone())?;
    }
    if let Some(recording) = recording {
        session.view(recording);
    }
    let applied = settings.settings.clone();
    let mut shell = AppShell::new(settings, Playback::new(PlayerProgram::installed()));
    for note in notes {
        shell.notify(note, 0.0);
    }
    let mut app = App {
        session,
        applied,
        shell,
        size: args.size,
        present,
        screen: None,
        begun: Instant::now(),
        next_redraw: Instant::now(),
        failure: None,
    };
    event_loop.run_app(&mut app)?;
    app.leave();
    app.failure.map_or(Ok(()), Err)
}

/// The match that was left the last time, else a free table.
fn left(path: Option<&Path>, notes: &mut Vec<String>, seed: u32) -> Result<Match, String> {
    let kept = path.map_or(Ok(None), MatchSave::load);
    let played = kept.and_then(|record| record.map(|record| record.play()).transpose());
    match played {
        Ok(Some(contest)) if contest.at_table().is_some() => {
            if contest.referee().rules() != RuleSet::Free {
                notes.push(format!(
                    "Your game of {} goes on; the menu begins another",
                    contest.referee().info().name
                ));
            }
            return Ok(contest);
        }
        Ok(_) => {}
        Err(why) => notes.push(format!("The game that was left cannot go on: {why}")),
    }
    play::free_table(TableScene::table(), seed)
}

/// The player's settings; options of the command line win for as long as it runs.
fn store(args: &Args) -> SettingsStore {
    let mut store = match &args.settings {
        Some(path) => SettingsStore::open(path.clone()),
        None => SettingsStore::of_player(),
    };
    store.with_override(|settings| {
        settings.ball_set = args.ball_set.unwrap_or(settings.ball_set);
        settings.physics = args.physics.unwrap_or(settings.physics);
    });
    store
}

/// Opens the connection to the display. Libraries that the system lacks make winit panic or fail,
/// depending on which; both become the same sentence.
fn open_event_loop() -> anyhow::Result<EventLoop<()>> {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let opened = std::panic::catch_unwind(EventLoop::new);
    std::panic::set_hook(hook);
    match opened {
        Ok(Ok(event_loop)) => Ok(event_loop),
        Ok(Err(error)) => Err(anyhow!("{}", reason(&error.to_string()))),
        Err(panic) => Err(anyhow!("{}", panic_words(&*panic))),
    }
    .with_context(no_display)
}

/// winit puts the line of its own source in front.
fn reason(error: &str) -> &str {
    let after_file = error.rsplit_once(".rs:").map_or(error, |(_, rest)| rest);
    after_file.split_once(": ").map_or(error, |(_, why)| why)
}

fn panic_words(panic: &(dyn std::any::Any + Send)) -> &str {
    let words = panic.downcast_ref::<String>().map(String::as_str);
    words
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("the windowing library failed")
}

fn no_display() -> String {
    let variable = |name: &str| match std::env::var(name) {
        Ok(value) => format!("{name}={value}"),
        Err(_) => format!("{name} is not set"),
    };
    format!(
        "no window can be opened ({}, {}). On Debian or Ubuntu `apt install libx11-xcb1 \
         libxcursor1 libxi6 libxkbcommon-x11-0` brings what X11 needs; `carom --headless` \
         needs no display at all",
        variable("WAYLAND_DISPLAY"),
        variable("DISPLAY")
    )
}

struct App {
    session: GameSession,
    shell: AppShell,
    /// The settings that window and session follow already.
    applied: Settings,
    size: Option<ImageSize>,
    present: Option<Present>,
    screen: Option<Screen>,
    begun: Instant,
    next_redraw: Instant,
    failure: Option<anyhow::Error>,
}

/// An open window, and egui's state, whose textures live in the display.
struct Screen {
    window: Arc<Window>,
    display: Display,
    egui: egui::Context,
    input: EguiState,
    /// Where the pointer was last, points.
    pointer: egui::Pos2,
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
            WindowEvent::RedrawRequested => self.redraw(event_loop),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.resized(),
            WindowEvent::Occluded(hidden) => self.session.set_hidden(hidden),
            event => {
                let scale = f64::from(egui_winit::pixels_per_point(&screen.egui, &screen.window));
                let now_secs = self.begun.elapsed().as_secs_f64();
                if let Some(event) = translate(&event, scale) {
                    let taken = taken.consumed || screen.is_over_panel(event);
                    let (shell, session) = (&mut self.shell, &mut self.session);
                    let outcome = shell.handle(event, taken, session, now_secs);
                    self.follow(event_loop, outcome);
                }
            }
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let now_secs = self.begun.elapsed().as_secs_f64();
        self.session.tick(now_secs);
        self.shell.tick(&mut self.session, now_secs);
        let now = Instant::now();
        if let Some(screen) = &self.screen
            && self.session.needs_redraw()
            && now >= self.next_redraw
        {
            self.next_redraw = now + REDRAW_PERIOD;
            screen.window.request_redraw();
        }
        let pause = if self.session.is_at_rest() {
            let next_secs = self.shell.next_secs().unwrap_or(f64::INFINITY) - now_secs;
            Duration::from_secs_f64(next_secs.clamp(0.0, REST_PERIOD.as_secs_f64()))
        } else {
            POLL_PERIOD
        };
        event_loop.set_control_flow(ControlFlow::WaitUntil(now + pause));
    }
}

impl App {
    fn open(&self, event_loop: &ActiveEventLoop) -> anyhow::Result<Screen> {
        let settings = self.shell.settings();
        let attributes = Window::default_attributes().with_title("Carom");
        let attributes = match self.size {
            Some(size) => attributes.with_inner_size(PhysicalSize::new(size.width, size.height)),
            None => {
                let [width, height] = settings.window.map(f64::from);
                attributes.with_inner_size(LogicalSize::new(width, height))
            }
        };
        let attributes = attributes.with_fullscreen(fullscreen(settings.fullscreen));
        let window = event_loop
            .create_window(attributes)
            .with_context(no_display)?;
        Screen::open(Arc::new(window), event_loop, self.present, settings)
    }

    /// Does what the shell asks, and what changed settings mean for window and session.
    fn follow(&mut self, event_loop: &ActiveEventLoop, outcome: Outcome) {
        if outcome == Outcome::Quit {
            event_loop.exit();
        }
        let (now, before) = (self.shell.settings().clone(), self.applied.clone());
        if now == before {
            return;
        }
        self.applied = now.clone();
        self.session.set_engine(now.physics);
        self.session.set_quality_preference(now.quality);
        self.session.set_aids(now.aim_aids);
        self.session.set_instant_camera(now.reduced_motion);
        if now.ball_set != before.ball_set
            && let Err(error) = self.session.set_ball_set(now.ball_set)
        {
            return self.fail(event_loop, error);
        }
        if let Some(screen) = &self.screen {
            if now.fullscreen != before.fullscreen {
                screen.window.set_fullscreen(fullscreen(now.fullscreen));
            }
            ui::theme::apply(&screen.egui, now.text_scale as f32, now.reduced_motion);
        }
        self.session.redraw();
        self.resized();
    }

    /// Remembers the window for the next time.
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
        let pixels = screen.window.inner_size();
        let scale = f64::from(egui_winit::pixels_per_point(&screen.egui, &screen.window));
        let points = DVec2::new(f64::from(pixels.width), f64::from(pixels.height)) / scale;
        self.session
            .resize(ImageSize::new(pixels.width, pixels.height), points);
    }

    fn resized(&mut self) {
        let Some(mut screen) = self.screen.take() else {
            return;
        };
        let pixels = screen.window.inner_size();
        screen
            .display
            .resize(ImageSize::new(pixels.width, pixels.height));
        self.follow_size(&screen);
        self.screen = Some(screen);
    }

    fn redraw(&mut self, event_loop: &ActiveEventLoop) {
        let now_secs = self.begun.elapsed().as_secs_f64();
        let Some(screen) = &mut self.screen else {
            return;
        };
        let drawn = screen.draw(&mut self.session, &mut self.shell, now_secs);
        let why = match drawn {
            Ok(outcome) => return self.follow(event_loop, outcome),
            Err(why) => why,
        };
        if screen.display.is_software() || self.present.is_some() {
            let error = anyhow!("{} can show nothing any more: {why}", screen.display.name());
            return self.fail(event_loop, error);
        }
        tracing::warn!("{}: {why}; going on without a GPU", screen.display.name());
        let (window, settings) = (screen.window.clone(), self.shell.settings());
        match Screen::open(window, event_loop, Some(Present::Software), settings) {
            Ok(reopened) => self.screen = Some(reopened),
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn fail(&mut self, event_loop: &ActiveEventLoop, error: anyhow::Error) {
        self.failure = Some(error);
        event_loop.exit();
    }
}

impl Screen {
    fn open(
        window: Arc<Window>,
        event_loop: &ActiveEventLoop,
        present: Option<Present>,
        settings: &Settings,
    ) -> anyhow::Result<Self> {
        let handle = event_loop.owned_display_handle();
        let display = Display::open(&window, &handle, present).map_err(|tried| {
            anyhow!(
                "the window cannot be drawn on ({}). A Vulkan driver helps, on Debian or Ubuntu \
                 `apt install mesa-vulkan-drivers`; `carom --headless` needs none",
                tried.join("; ")
            )
        })?;
        let name = display.name();
        tracing::info!("presenting with {name}");
        let egui = egui::Context::default();
        ui::theme::apply(&egui, settings.text_scale as f32, settings.reduced_motion);
        let scale = window.scale_factor() as f32;
        let input = EguiState::new(
            egui.clone(),
            egui::ViewportId::ROOT,
            &window,
            Some(scale),
            None,
            Some(2048),
        );
        Ok(Self {
            window,
            display,
            egui,
            input,
            pointer: egui::Pos2::ZERO,
        })
    }

    /// Whether the pointer, whose event this is, is over something of the interface.
    fn is_over_panel(&mut self, event: Event) -> bool {
        match event {
            Event::Pointer(at) => self.pointer = egui::pos2(at.x as f32, at.y as f32),
            Event::Button { .. } | Event::Wheel(_) => {}
            _ => return false,
        }
        let layer = self.egui.layer_id_at(self.pointer);
        layer.is_some_and(|layer| layer.order != egui::Order::Background)
    }

    fn draw(
        &mut self,
        session: &mut GameSession,
        shell: &mut AppShell,
        now_secs: f64,
    ) -> Result<Outcome, String> {
        let begun = Instant::now();
        let raw = self.input.take_egui_input(&self.window);
        let name = self.display.name().to_owned();
        let mut outcome = Outcome::Stay;
        let mut output = egui::FullOutput::default();
        for raw in passes(raw) {
            output.append(self.egui.run_ui(raw, |ui| {
                if shell.draw(ui.ctx(), session, now_secs, &name) == Outcome::Quit {
                    outcome = Outcome::Quit;
                }
            }));
        }
        // What moves or fades is drawn again at once.
        let repaint = output.viewport_output.get(&egui::ViewportId::ROOT);
        if repaint.is_some_and(|viewport| viewport.repaint_delay.is_zero()) {
            session.redraw();
        }
        self.input
            .handle_platform_output(&self.window, output.platform_output);
        let frame = UiFrame {
            textures: output.textures_delta,
            primitives: self.egui.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
        };
        self.display.show(session.picture(now_secs), &frame)?;
        session.note_draw(begun.elapsed().as_secs_f64());
        Ok(outcome)
    }
}

/// What a window event is to the game.
fn translate(event: &WindowEvent, scale: f64) -> Option<Event> {
    match event {
        WindowEvent::CursorMoved { position, .. } => {
            Some(Event::Pointer(DVec2::new(position.x, position.y) / scale))
        }
        WindowEvent::CursorLeft { .. } => Some(Event::PointerLeft),
        WindowEvent::Focused(false) => Some(Event::FocusLost),
        WindowEvent::MouseInput { state, button, .. } => {
            button_of(*button).map(|button| Event::Button {
                button,
                pressed: *state == ElementState::Pressed,
            })
        }
        WindowEvent::MouseWheel { delta, .. } => Some(Event::Wheel(match delta {
            MouseScrollDelta::LineDelta(_, lines) => f64::from(*lines),
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / scale / WHEEL_NOTCH_POINTS,
        })),
        WindowEvent::KeyboardInput { event, .. } => {
            key_of(event.physical_key).map(|key| Event::Key {
                key,
                pressed: event.state == ElementState::Pressed,
                repeat: event.repeat,
            })
        }
        _ => None,
    }
}

fn button_of(button: MouseButton) -> Option<Button> {
    match button {
        MouseButton::Left => Some(Button::Left),
        MouseButton::Right => Some(Button::Right),
        MouseButton::Middle => Some(Button::Middle),
        MouseButton::Back => Some(Button::Back),
        MouseButton::Forward => Some(Button::Forward),
        MouseButton::Other(_) => None,
    }
}

/// winit names its keys as the W3C does.
fn key_of(key: PhysicalKey) -> Option<Key> {
    let PhysicalKey::Code(code) = key else {
        return None;
    };
    Key::from_code(&format!("{code:?}"))
}

fn fullscreen(wanted: bool) -> Option<Fullscreen> {
    wanted.then_some(Fullscreen::Borderless(None))
}

/// Beside the settings.
const MATCH_FILE: &str = "match.carom";
/// At most this often a frame is drawn; the display may allow fewer.
const REDRAW_PERIOD: Duration = Duration::from_millis(8);
/// How often finished pictures are looked for.
const POLL_PERIOD: Duration = Duration::from_millis(3);
/// How often the farm is looked after while nothing moves.
const REST_PERIOD: Duration = Duration::from_secs(1);
/// A touchpad's way that counts as a notch of a wheel.
const WHEEL_NOTCH_POINTS: f64 = 50.0;
