//! Form of what is to be saved: file, size, samples, frames.

use std::path::{Path, PathBuf};

use carom_tracer::ImageSize;

use crate::camera::OrbitCamera;
use crate::render::SaveOrder;

/// What is to be saved, as a person has filled it in.
#[derive(Clone, Debug)]
pub(crate) struct SaveForm {
    /// The file's name.
    pub(crate) path: String,
    /// Pixels across and down; the window's until they are chosen.
    pub(crate) size: Option<[u32; 2]>,
    /// Samples per pixel.
    pub(crate) samples: u32,
    /// Frames of a turntable.
    pub(crate) frames: u32,
    /// Orders so far.
    orders: u64,
}

impl SaveForm {
    /// With a name that no file in `folder` has.
    pub(crate) fn new(folder: &Path) -> Self {
        Self {
            path: free_name(folder, "png").display().to_string(),
            size: None,
            samples: 256,
            frames: 72,
            orders: 0,
        }
    }

    /// The picture's size in a window of so many pixels.
    pub(crate) fn size_in(&self, window: ImageSize) -> ImageSize {
        self.size
            .map_or(window, |[width, height]| ImageSize::new(width, height))
    }

    /// The order of a still, or of a film that goes round the target once.
    pub(crate) fn order(
        &mut self,
        camera: &OrbitCamera,
        window: ImageSize,
        exposure: f32,
        is_turntable: bool,
    ) -> SaveOrder {
        self.orders += 1;
        SaveOrder {
            number: self.orders,
            path: PathBuf::from(self.path.trim()),
            size: self.size_in(window),
            samples: self.samples,
            exposure,
            cameras: match is_turntable {
                true => camera.turntable(self.frames).collect(),
                false => [camera.camera()].into(),
            },
            frames_per_sec: is_turntable.then_some(FRAMES_PER_SEC),
        }
    }

    /// The number of the last order.
    pub(crate) fn orders(&self) -> u64 {
        self.orders
    }

    /// Names the next file, after `saved` is there.
    pub(crate) fn go_on(&mut self, saved: &Path) {
        if Path::new(self.path.trim()) == saved {
            let ending = saved.extension().unwrap_or_default().to_string_lossy();
            let folder = saved.parent().unwrap_or(Path::new(""));
            self.path = free_name(folder, &ending).display().to_string();
        }
    }
}

/// The first of the usual names that is free in a folder.
fn free_name(folder: &Path, ending: &str) -> PathBuf {
    let names = (1..=NAMES_MAX).map(|number| folder.join(format!("view_{number:04}.{ending}")));
    let mut free = names.filter(|path| !path.exists());
    free.next().unwrap_or_default()
}

/// Of a turntable: smooth, and as long as three seconds with the usual number of frames.
const FRAMES_PER_SEC: u16 = 24;
/// Names that are tried.
const NAMES_MAX: u32 = 9999;

#[cfg(test)]
mod tests {
    use carom_tracer::Camera;

    use super::*;

    #[test]
    fn a_new_name_is_free_and_of_the_same_kind() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("view_0001.png"), "").unwrap();
        let mut form = SaveForm::new(folder.path());
        assert_eq!(Path::new(&form.path), path("view_0002.png"));
        form.path = path("view_0002.exr").display().to_string();
        std::fs::write(path("view_0001.exr"), "").unwrap();
        std::fs::write(path("view_0002.exr"), "").unwrap();
        form.go_on(&path("view_0002.exr"));
        assert_eq!(Path::new(&form.path), path("view_0003.exr"));
        // A name that has been changed meanwhile stays.
        form.path = "mine.jpg".to_owned();
        form.go_on(&path("view_0003.exr"));
        assert_eq!(form.path, "mine.jpg");
    }

    #[test]
    fn orders_have_numbers_of_their_own_and_the_windows_size() {
        let folder = tempfile::tempdir().unwrap();
        let camera = OrbitCamera::new(Camera::looking_at([0.0, -1.0, 0.0], [0.0; 3]));
        let mut form = SaveForm::new(folder.path());
        let window = ImageSize::new(640, 360);
        let still = form.order(&camera, window, 2.0, false);
        assert_eq!((still.number, still.size), (1, window));
        assert_eq!((still.cameras.len(), still.frames_per_sec), (1, None));
        form.size = Some([20, 10]);
        form.frames = 9;
        let film = form.order(&camera, window, 2.0, true);
        assert_eq!((film.number, film.size), (2, ImageSize::new(20, 10)));
        assert_eq!(film.cameras.len(), 9);
    }
}
