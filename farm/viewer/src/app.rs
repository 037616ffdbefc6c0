//! Application: the window's events and redraws, and the start of the viewer in it.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use carom_farm::FarmConfig;
use carom_window::connection::{WindowError, is_displayless, open_event_loop};
use carom_window::display::Present;
use carom_window::screen::Screen;
use carom_window::theme;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::window::{Fullscreen, Window, WindowId};

use crate::args::Args;
use crate::render::Renderer;
use crate::viewer::Viewer;

/// Event that announces news of the renderer.
#[derive(Clone, Copy, Debug)]
struct RendererNews;

/// Runs the viewer's window until it is closed.
///
/// # Errors
/// What was tried and what to install, if no window can be opened or drawn on.
pub fn run(args: &Args, config: FarmConfig, present: Option<Present>) -> anyhow::Result<()> {
    anyhow::ensure!(
        !is_displayless(),
        "there is no display (DISPLAY and WAYLAND_DISPLAY are not set): `carom-farm render --scene FILE --out picture.png` \
         renders a scene without one"
    );
    let event_loop = open_event_loop::<RendererNews>(INSTEAD)?;
    let proxy = event_loop.create_proxy();
    // Fails only once the loop has ended, when nothing needs to be woken.
    let wake = move || proxy.send_event(RendererNews).unwrap_or_default();
    let renderer = Renderer::start(config, args.accuracy(), wake)?;
    let mut viewer = Viewer::new(renderer, args.spp, Path::new(""));
    viewer.set_exposure_stops(args.exposure);
    if let Some(path) = &args.scene {
        viewer.open(path.clone());
    }
    let mut app = App {
        viewer,
        size: PhysicalSize::new(args.size.width, args.size.height),
        present,
        screen: None,
        title: String::new(),
        is_fullscreen: false,
        begun: Instant::now(),
        next_redraw: None,
        failure: None,
    };
    event_loop.run_app(&mut app)?;
    app.failure.map_or(Ok(()), Err)
}

struct App {
    viewer: Viewer,
    size: PhysicalSize<u32>,
    present: Option<Present>,
    screen: Option<Screen>,
    title: String,
    is_fullscreen: bool,
    begun: Instant,
    /// Time of the next redraw without events.
    next_redraw: Option<Instant>,
    failure: Option<anyhow::Error>,
}

impl ApplicationHandler<RendererNews> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.screen.is_some() {
            return;
        }
        match self.open(event_loop) {
            Ok(screen) => {
                self.viewer.resize(screen.size());
                screen.window.request_redraw();
                self.screen = Some(screen);
            }
            Err(error) => self.fail(event_loop, error),
        }
    }

    fn user_event(&mut self, _: &ActiveEventLoop, RendererNews: RendererNews) {
        let now_secs = self.begun.elapsed().as_secs_f64();
        if self.viewer.take_news(now_secs) {
            self.redraw();
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(screen) = &mut self.screen else {
            return;
        };
        let taken = screen.input.on_window_event(&screen.window, &event);
        if taken.repaint {
            screen.window.request_redraw();
        }
        match event {
            WindowEvent::CloseRequested => event_loop.exit(),
            WindowEvent::RedrawRequested => self.draw(event_loop),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => self.resized(),
            WindowEvent::DroppedFile(path) => {
                self.viewer.open(path);
                self.redraw();
            }
            WindowEvent::HoveredFile(_) => {
                self.viewer.hover(true);
                self.redraw();
            }
            WindowEvent::HoveredFileCancelled => {
                self.viewer.hover(false);
                self.redraw();
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        if self.next_redraw.is_some_and(|at| at <= Instant::now()) {
            self.next_redraw = None;
            self.redraw();
        }
        event_loop.set_control_flow(match self.next_redraw {
            Some(at) => ControlFlow::WaitUntil(at),
            None => ControlFlow::Wait,
        });
    }
}

impl App {
    fn open(&self, event_loop: &ActiveEventLoop) -> anyhow::Result<Screen> {
        let attributes = Window::default_attributes()
            .with_title(self.viewer.title())
            .with_inner_size(self.size);
        let window = event_loop.create_window(attributes);
        let window = window.map_err(|why| WindowError::not_opened(INSTEAD, why))?;
        self.open_screen(Arc::new(window), event_loop, self.present)
    }

    fn open_screen(
        &self,
        window: Arc<Window>,
        event_loop: &ActiveEventLoop,
        present: Option<Present>,
    ) -> anyhow::Result<Screen> {
        let screen = Screen::open(window, event_loop, present, INSTEAD)?;
        theme::apply(&screen.egui, screen.text_scale(1.0), false);
        Ok(screen)
    }

    fn redraw(&self) {
        if let Some(screen) = &self.screen {
            screen.window.request_redraw();
        }
    }

    fn resized(&mut self) {
        let Some(screen) = &mut self.screen else {
            return;
        };
        screen.display.resize(screen.size());
        theme::set_scale(&screen.egui, screen.text_scale(1.0));
        self.viewer.resize(screen.size());
        screen.window.request_redraw();
    }

    fn draw(&mut self, event_loop: &ActiveEventLoop) {
        let Some(screen) = &mut self.screen else {
            return;
        };
        let now_secs = self.begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let name = screen.display.name().to_owned();
        let viewer = &mut self.viewer;
        let interface = screen.run_interface(|ui| viewer.draw(ui, now_secs, &name));
        let presented = screen.display.show(viewer.displayed(), &interface.frame);
        viewer.set_draw_secs(begun.elapsed().as_secs_f64());
        let toasts_secs = viewer.next_secs().unwrap_or(f64::INFINITY) - now_secs;
        let delay_secs = interface.repaint_delay.as_secs_f64().min(toasts_secs);
        let delay_secs = delay_secs.clamp(REDRAW_PERIOD.as_secs_f64(), SLEEP_MAX.as_secs_f64());
        self.next_redraw = Some(begun + Duration::from_secs_f64(delay_secs));
        if let Err(why) = presented {
            self.replace_display(event_loop, &why.to_string());
        }
        self.follow(event_loop);
    }

    /// Applies the viewer's title, full-screen mode and wish to quit to the window.
    fn follow(&mut self, event_loop: &ActiveEventLoop) {
        if self.viewer.wants_quit() {
            event_loop.exit();
        }
        let Some(screen) = &self.screen else { return };
        let title = self.viewer.title();
        if title != self.title {
            screen.window.set_title(&title);
            self.title = title;
        }
        let is_fullscreen = self.viewer.wants_fullscreen();
        if is_fullscreen != self.is_fullscreen {
            self.is_fullscreen = is_fullscreen;
            let mode = is_fullscreen.then_some(Fullscreen::Borderless(None));
            screen.window.set_fullscreen(mode);
        }
    }

    /// Continues with software presentation after a display has stopped working, unless a presentation was
    /// requested explicitly.
    fn replace_display(&mut self, event_loop: &ActiveEventLoop, why: &str) {
        let Some(screen) = &self.screen else { return };
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

/// A command that does without a display.
const INSTEAD: &str = "carom-farm render";
/// Minimum period of redraws without events.
const REDRAW_PERIOD: Duration = Duration::from_millis(8);
/// Maximum period of redraws, to update the nodes' status.
const SLEEP_MAX: Duration = Duration::from_secs(1);
