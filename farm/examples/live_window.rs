//! A window on a live picture; the camera follows the pointer: `cargo run --release -p carom-farm --example live_window`

use std::num::NonZeroU32;
use std::rc::Rc;

use carom_farm::prelude::*;
use winit::application::ApplicationHandler;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::window::{Window, WindowId};

struct Viewer {
    view: LiveView,
    surface: Option<softbuffer::Surface<Rc<Window>, Rc<Window>>>,
}

impl Viewer {
    /// Shows a picture, if the window has an area.
    fn draw(&mut self, picture: &Picture) -> Option<()> {
        let (surface, ImageSize { width, height }) = (self.surface.as_mut()?, picture.size());
        let size = (NonZeroU32::new(width)?, NonZeroU32::new(height)?);
        surface.resize(size.0, size.1).ok()?;
        let mut pixels = surface.buffer_mut().ok()?;
        for (pixel, [r, g, b, _]) in pixels.iter_mut().zip(picture.rgba8()) {
            *pixel = u32::from_be_bytes([0, r, g, b]);
        }
        pixels.present().ok()
    }
}

impl ApplicationHandler for Viewer {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let attributes = Window::default_attributes().with_title("Live picture");
        let window = Rc::new(events.create_window(attributes).expect("a window"));
        let context = softbuffer::Context::new(Rc::clone(&window)).expect("a display");
        self.surface = softbuffer::Surface::new(&context, window).ok();
    }

    fn user_event(&mut self, _: &ActiveEventLoop, (): ()) {
        if let Some(picture) = self.view.latest().expect("nodes that answer") {
            self.draw(&picture);
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::Resized(size) => drop(self.view.resize(size.width, size.height)),
            WindowEvent::CursorMoved { position, .. } => {
                let (sin, cos) = (0.005 * position.x as f32).sin_cos();
                let camera = Camera::looking_at([4.0 * sin, -4.0 * cos, 1.5], [0.0, 0.0, 0.4]);
                self.view
                    .set_camera(camera)
                    .expect("an eye above the floor");
            }
            _ => {}
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scene = Scene::new();
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::glass());
    scene.add(Plane::z(0.0), Material::wood(Axis::X));
    let events = EventLoop::new()?;
    let proxy = events.create_proxy();
    let live = Live::new(800, 600).on_frame(move || proxy.send_event(()).unwrap_or_default());
    let mut farm = Farm::auto()?;
    let view = farm.live(&scene, live)?;
    Ok(events.run_app(&mut Viewer {
        view,
        surface: None,
    })?)
}
