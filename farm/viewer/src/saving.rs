//! Orders to save the current view: a still, a turntable or an animation.

use std::sync::Arc;

use crate::render::{FrameCamera, FrameView};
use crate::save_form::SaveKind;
use crate::viewer::Viewer;

impl Viewer {
    /// Orders a picture or film to be saved.
    pub(crate) fn save(&mut self, kind: SaveKind) {
        if self.document.is_none() || self.saving.is_some() {
            return;
        }
        let (exposure, views) = (self.exposure(), self.views(kind));
        let is_film = kind != SaveKind::Still;
        let order = self.form.order(views, is_film, self.window, exposure);
        self.renderer.want(|wanted| wanted.save = Some(order));
    }

    /// The view of each frame.
    fn views(&self, kind: SaveKind) -> Arc<[FrameView]> {
        let time = self.playback.time();
        let seen = |camera| FrameView {
            camera: FrameCamera::Placed(camera),
            time,
        };
        match kind {
            SaveKind::Still => [seen(self.camera.camera())].into(),
            SaveKind::Turntable => self.camera.turntable(self.form.frames).map(seen).collect(),
            SaveKind::Animation => {
                let camera = match self.attached_camera() {
                    Some(number) => FrameCamera::OfFile(number),
                    None => FrameCamera::Placed(self.camera.camera()),
                };
                let times = self.form.times_in(self.playback.duration_secs());
                let frames = times.map(|secs| FrameView {
                    camera,
                    time: time.map(|(animation, _)| (animation, secs)),
                });
                frames.collect()
            }
        }
    }

    /// Cancels what is being saved.
    pub(crate) fn cancel_save(&mut self) {
        let last = self.form.orders();
        self.renderer.want(|wanted| wanted.cancelled_save = last);
    }
}
