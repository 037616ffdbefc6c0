//! Cameras of the scene file, which the view follows until it is moved.

use crate::viewer::{HomeMoment, Viewer};

impl Viewer {
    /// The names of the file's cameras; empty if it has none.
    pub(crate) fn file_cameras(&self) -> Vec<&str> {
        let document = self.document.as_ref();
        document.map_or_else(Vec::new, |document| document.file.cameras())
    }

    /// The index of the file's camera that the view follows; `None` for the free camera.
    pub(crate) fn attached_camera(&self) -> Option<usize> {
        let is_there = self.file_camera < self.file_cameras().len();
        (self.camera.is_home() && is_there).then_some(self.file_camera)
    }

    /// Makes the view follow a camera of the file.
    pub(crate) fn attach(&mut self, camera: usize) {
        self.file_camera = camera;
        self.follow_camera();
        self.camera.go_home();
    }

    /// Makes the view follow the file's current camera again or, if it does already, the next one.
    pub(crate) fn next_camera(&mut self) {
        let count = self.file_cameras().len();
        if count > 0 {
            let next = self.attached_camera().map(|camera| (camera + 1) % count);
            self.attach(next.unwrap_or(self.file_camera));
        }
    }

    /// Sets the home of the view to the present position of the file's camera.
    pub(crate) fn follow_camera(&mut self) {
        let Some(document) = &self.document else {
            return;
        };
        let time = self.playback.time();
        let moment = HomeMoment {
            scene: document.number,
            camera: self.file_camera,
            time,
        };
        if self.home_of.replace(moment) == Some(moment) {
            return;
        }
        // An invalid time is reported where it is traced.
        if let Ok(camera) = document.file.camera(self.file_camera, time) {
            self.camera.set_home(camera);
        }
    }
}
