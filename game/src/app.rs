//! The window: winit's events to the session and the session's picture to the display.

use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use carom_farm::FarmConfig;
use carom_tracer::ImageSize;
use egui_winit::State as EguiState;
use glam::DVec2;
use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use crate::args::Args;
use crate::display::{Display, Present, UiFrame};
use crate::input::{Button, Event, Key};
use crate::play::Outcome;
use crate::session::Session;

/// Plays in a window until it is closed.
///
/// # Errors
/// What was tried and what to install, if no window can be opened or drawn on.
pub fn run(args: &Args, config: FarmConfig, present: Option<Present>) -> anyhow::Result<()> {
    let event_loop = open_event_loop()?;
    let (table, recording) = args.table_and_recording()?;
    let mut session = Session::new(config, table, args.seed, args.ball_set)?;
    session.set_engine(args.physics);
    if let Some(folder) = &args.record {
        session.record(folder.clone())?;
    }
    if let Some(recording) = recording {
        session.replay(recording.shot);
    }
    let mut app = App {
        session,
        size: args.size,
        present,
        screen: None,
        begun: Instant::now(),
        next_redraw: Instant::now(),
        failure: None,
    };
    event_loop.run_app(&mut app)?;
    app.failure.map_or(Ok(()), Err)
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
    session: Session,
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
        let _ = screen.input.on_window_event(&screen.window, &event);
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => self.redraw(event_loop),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.resized(),
            event => {
                let scale = f64::from(egui_winit::pixels_per_point(&screen.egui, &screen.window));
                let now_secs = self.begun.elapsed().as_secs_f64();
                let outcome =
                    translate(&event, scale).map(|event| self.session.handle(event, now_secs));
                if outcome == Some(Outcome::Quit) {
                    event_loop.exit();
                }
            }
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        self.session.tick(self.begun.elapsed().as_secs_f64());
        let now = Instant::now();
        if let Some(screen) = &self.screen
            && self.session.needs_redraw()
            && now >= self.next_redraw
        {
            self.next_redraw = now + REDRAW_PERIOD;
            screen.window.request_redraw();
        }
        event_loop.set_control_flow(if self.session.is_at_rest() {
            ControlFlow::Wait
        } else {
            ControlFlow::WaitUntil(now + POLL_PERIOD)
        });
    }
}

impl App {
    fn open(&self, event_loop: &ActiveEventLoop) -> anyhow::Result<Screen> {
        let attributes = Window::default_attributes().with_title("Carom");
        let attributes = match self.size {
            Some(size) => attributes.with_inner_size(PhysicalSize::new(size.width, size.height)),
            None => attributes.with_inner_size(LogicalSize::new(1280.0, 720.0)),
        };
        let window = event_loop
            .create_window(attributes)
            .with_context(no_display)?;
        Screen::open(Arc::new(window), event_loop, self.present)
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
        let Err(why) = screen.draw(&mut self.session, now_secs) else {
            return;
        };
        if screen.display.is_software() || self.present.is_some() {
            let error = anyhow!("{} can show nothing any more: {why}", screen.display.name());
            return self.fail(event_loop, error);
        }
        tracing::warn!("{}: {why}; going on without a GPU", screen.display.name());
        match Screen::open(screen.window.clone(), event_loop, Some(Present::Software)) {
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
        })
    }

    fn draw(&mut self, session: &mut Session, now_secs: f64) -> Result<(), String> {
        let raw = self.input.take_egui_input(&self.window);
        let name = self.display.name().to_owned();
        let output = self
            .egui
            .run_ui(raw, |ui| session.draw(ui.ctx(), now_secs, &name));
        self.input
            .handle_platform_output(&self.window, output.platform_output);
        let frame = UiFrame {
            textures: output.textures_delta,
            primitives: self.egui.tessellate(output.shapes, output.pixels_per_point),
            pixels_per_point: output.pixels_per_point,
        };
        self.display.show(session.picture(now_secs), &frame)
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
        WindowEvent::ModifiersChanged(modifiers) => {
            let state = modifiers.state();
            Some(Event::Fine(state.control_key() || state.shift_key()))
        }
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
        _ => None,
    }
}

/// Keys by their place, so that W A S D lie together on every keyboard.
fn key_of(key: PhysicalKey) -> Option<Key> {
    let PhysicalKey::Code(code) = key else {
        return None;
    };
    Some(match code {
        KeyCode::ArrowLeft => Key::Left,
        KeyCode::ArrowRight => Key::Right,
        KeyCode::ArrowUp => Key::Up,
        KeyCode::ArrowDown => Key::Down,
        KeyCode::Space => Key::Space,
        KeyCode::KeyR => Key::Rack,
        KeyCode::KeyH | KeyCode::F1 => Key::Help,
        KeyCode::F3 => Key::Stats,
        KeyCode::Escape => Key::Escape,
        KeyCode::KeyW => Key::TipUp,
        KeyCode::KeyS => Key::TipDown,
        KeyCode::KeyA => Key::TipLeft,
        KeyCode::KeyD => Key::TipRight,
        KeyCode::KeyX => Key::TipCenter,
        KeyCode::KeyQ => Key::CueUp,
        KeyCode::KeyE => Key::CueDown,
        _ => return None,
    })
}

/// At most this often a frame is drawn; the display may allow fewer.
const REDRAW_PERIOD: Duration = Duration::from_millis(8);
/// How often finished pictures are looked for.
const POLL_PERIOD: Duration = Duration::from_millis(3);
/// A touchpad's way that counts as a notch of a wheel.
const WHEEL_NOTCH_POINTS: f64 = 50.0;
