//! Cameras of a scene's file, which the view follows until it is moved.

use crate::viewer::{HomeMoment, Viewer};

impl Viewer {
    /// The file's cameras by their names; empty if it has none.
    pub(crate) fn file_cameras(&self) -> Vec<&str> {
        let document = self.document.as_ref();
        document.map_or_else(Vec::new, |document| document.file.cameras())
    }

    /// The camera of the file through which it is looked; none if it is the free one.
    pub(crate) fn attached_camera(&self) -> Option<usize> {
        let is_there = self.file_camera < self.file_cameras().len();
        (self.camera.is_home() && is_there).then_some(self.file_camera)
    }

    /// Looks through a camera of the file from now on.
    pub(crate) fn attach(&mut self, camera: usize) {
        self.file_camera = camera;
        self.follow_camera();
        self.camera.go_home();
    }

    /// Looks through the file's camera again, or else through its next.
    pub(crate) fn next_camera(&mut self) {
        let count = self.file_cameras().len();
        if count > 0 {
            let next = self.attached_camera().map(|camera| (camera + 1) % count);
            self.attach(next.unwrap_or(self.file_camera));
        }
    }

    /// Has home be where the file's camera is now.
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
        // A time at which it sees nothing is told of where it is traced.
        if let Ok(camera) = document.file.camera(self.file_camera, time) {
            self.camera.set_home(camera);
        }
    }
}
