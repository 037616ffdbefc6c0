//! The frame function: the steps between two polls of the window's events.

use std::time::{Duration, Instant};

#[cfg(feature = "gamepad")]
use carom_text::text;
use winit::event_loop::{ActiveEventLoop, ControlFlow};

use super::event_loop::{App, FrameCause};
use super::window;
#[cfg(feature = "gamepad")]
use super::{event_loop::QueuedEvent, gamepads::GamepadEvent};

impl App {
    /// Runs one frame. No step waits for the farm.
    pub(super) fn frame(&mut self, event_loop: &ActiveEventLoop, cause: FrameCause) {
        let now_secs = self.begun.elapsed().as_secs_f64();
        self.handle_input();
        self.advance_simulation(now_secs);
        self.session.poll_farm(now_secs);
        self.session.accumulate();
        self.session.choose_frame();
        if cause == FrameCause::Redraw {
            self.session.reproject(now_secs);
            self.draw_and_present(event_loop, now_secs);
        }
        self.session.request_frames(now_secs);
        self.apply_settings(event_loop);
        self.schedule_next(event_loop, now_secs);
    }

    fn handle_input(&mut self) {
        #[cfg(feature = "gamepad")]
        self.poll_gamepads();
        for queued in std::mem::take(&mut self.events) {
            if let (Some(screen), Some(key)) = (&mut self.screen, self.shell.page_key(queued.event))
            {
                screen.press(key);
                self.session.redraw();
                continue;
            }
            let session = &mut self.session;
            self.shell
                .handle(queued.event, queued.is_taken, session, queued.at_secs);
        }
    }

    #[cfg(feature = "gamepad")]
    fn poll_gamepads(&mut self) {
        for event in self.gamepads.poll() {
            match event {
                GamepadEvent::Input(event, at) => self.events.push(QueuedEvent {
                    event,
                    is_taken: false,
                    at_secs: at.saturating_duration_since(self.begun).as_secs_f64(),
                }),
                GamepadEvent::Connected(name) => {
                    let sentence = text!("gamepad-connected", name = name);
                    self.shell
                        .notify(sentence, self.begun.elapsed().as_secs_f64());
                    self.session.redraw();
                }
            }
        }
    }

    fn advance_simulation(&mut self, now_secs: f64) {
        self.session.advance_simulation(now_secs);
        self.shell.tick(&mut self.session, now_secs);
    }

    fn draw_and_present(&mut self, event_loop: &ActiveEventLoop, now_secs: f64) {
        let Some(screen) = &mut self.screen else {
            return;
        };
        let begun = Instant::now();
        let interface =
            window::draw_interface(screen, &mut self.session, &mut self.shell, now_secs);
        let presented = screen.display.show(self.session.displayed(), &interface);
        self.session.set_draw_secs(begun.elapsed().as_secs_f64());
        if let Err(why) = presented {
            self.replace_display(event_loop, &why.to_string());
        }
    }

    /// Requests a redraw if something has changed, and schedules the next poll of the farm.
    fn schedule_next(&mut self, event_loop: &ActiveEventLoop, now_secs: f64) {
        if self.shell.wants_quit() {
            event_loop.exit();
        }
        let now = Instant::now();
        if let Some(screen) = &self.screen
            && self.session.needs_redraw()
            && now >= self.next_redraw
        {
            self.next_redraw = now + REDRAW_PERIOD;
            screen.window.request_redraw();
        }
        let pause = if self.session.is_at_rest() && !self.shell.is_steering() {
            let next_secs = self.shell.next_secs().unwrap_or(f64::INFINITY) - now_secs;
            Duration::from_secs_f64(next_secs.clamp(0.0, REST_PERIOD.as_secs_f64()))
        } else {
            POLL_PERIOD
        };
        event_loop.set_control_flow(ControlFlow::WaitUntil(now + pause));
    }
}

/// Least time between two redraws; the display may need more.
const REDRAW_PERIOD: Duration = Duration::from_millis(8);
/// Interval at which the farm is polled for finished frames.
const POLL_PERIOD: Duration = Duration::from_millis(3);
/// Interval at which the farm is polled while nothing moves.
const REST_PERIOD: Duration = Duration::from_secs(1);
