//! Form of what to save: file, size, samples, and frames of a film.

use std::path::{Path, PathBuf};

use std::sync::Arc;

use carom_tracer::ImageSize;

use crate::render::{FrameView, SaveOrder};

/// Kind of output to save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SaveKind {
    /// The current picture.
    Still,
    /// A film of one turn around the target.
    Turntable,
    /// A film of the scene's animation.
    Animation,
}

/// Contents of the form.
#[derive(Clone, Debug)]
pub(crate) struct SaveForm {
    /// Name of the file.
    pub(crate) path: String,
    /// Size in pixels; the window's until one is chosen.
    pub(crate) size: Option<[u32; 2]>,
    /// Samples per pixel.
    pub(crate) samples: u32,
    /// Number of frames of a turntable.
    pub(crate) frames: u32,
    /// First and last frame of an animation; the whole animation until they are chosen.
    pub(crate) range: Option<[u32; 2]>,
    /// Frames per second of a film.
    pub(crate) frames_per_sec: u16,
    /// Number of orders so far.
    orders: u64,
}

impl SaveForm {
    /// A form with a file name that is unused in `folder`.
    pub(crate) fn new(folder: &Path) -> Self {
        Self {
            path: free_name(folder, "png").display().to_string(),
            size: None,
            samples: 256,
            frames: 72,
            range: None,
            frames_per_sec: FRAMES_PER_SEC,
            orders: 0,
        }
    }

    /// The picture's size, given the window's.
    pub(crate) fn size_in(&self, window: ImageSize) -> ImageSize {
        self.size
            .map_or(window, |[width, height]| ImageSize::new(width, height))
    }

    /// First and last frame of an animation of this duration. The whole animation ends before its first frame
    /// would repeat.
    pub(crate) fn range_in(&self, duration_secs: f64) -> [u32; 2] {
        let frames = (duration_secs * f64::from(self.frames_per_sec)).round();
        let last = (frames as u32).saturating_sub(1).min(Self::FRAME_MAX);
        self.range.unwrap_or([0, last])
    }

    /// The times in seconds of the frames of an animation of this duration.
    pub(crate) fn times_in(&self, duration_secs: f64) -> impl Iterator<Item = f64> + use<> {
        let [first, last] = self.range_in(duration_secs);
        let rate = f64::from(self.frames_per_sec);
        (first..=last).map(move |frame| f64::from(frame) / rate)
    }

    /// Maximum number of a frame.
    pub(crate) const FRAME_MAX: u32 = 99_999;
    /// Maximum frames per second.
    pub(crate) const RATE_MAX: u16 = 240;

    /// Creates the order of a still, or of a film of `views`.
    pub(crate) fn order(
        &mut self,
        views: Arc<[FrameView]>,
        is_film: bool,
        window: ImageSize,
        exposure: f32,
    ) -> SaveOrder {
        self.orders += 1;
        SaveOrder {
            number: self.orders,
            path: PathBuf::from(self.path.trim()),
            size: self.size_in(window),
            samples: self.samples,
            exposure,
            views,
            frames_per_sec: is_film.then_some(self.frames_per_sec),
        }
    }

    /// The number of the last order.
    pub(crate) fn orders(&self) -> u64 {
        self.orders
    }

    /// Selects the next unused file name after `saved` has been written.
    pub(crate) fn go_on(&mut self, saved: &Path) {
        if Path::new(self.path.trim()) == saved {
            let ending = saved.extension().unwrap_or_default().to_string_lossy();
            let folder = saved.parent().unwrap_or(Path::new(""));
            self.path = free_name(folder, &ending).display().to_string();
        }
    }
}

/// The first default name that is unused in a folder.
fn free_name(folder: &Path, ending: &str) -> PathBuf {
    let names = (1..=NAMES_MAX).map(|number| folder.join(format!("view_{number:04}.{ending}")));
    let mut free = names.filter(|path| !path.exists());
    free.next().unwrap_or_default()
}

/// Default frames per second; a turntable with the default number of frames lasts three seconds.
const FRAMES_PER_SEC: u16 = 24;
/// Number of names that are tried.
const NAMES_MAX: u32 = 9999;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::FrameCamera;

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
        // A name edited meanwhile is kept.
        form.path = "mine.jpg".to_owned();
        form.go_on(&path("view_0003.exr"));
        assert_eq!(form.path, "mine.jpg");
    }

    #[test]
    fn orders_have_numbers_of_their_own_and_the_windows_size() {
        let folder = tempfile::tempdir().unwrap();
        let view = FrameView {
            camera: FrameCamera::OfFile(0),
            time: None,
        };
        let mut form = SaveForm::new(folder.path());
        let window = ImageSize::new(640, 360);
        let still = form.order([view].into(), false, window, 2.0);
        assert_eq!((still.number, still.size), (1, window));
        assert_eq!((still.views.len(), still.frames_per_sec), (1, None));
        form.size = Some([20, 10]);
        form.frames_per_sec = 30;
        let film = form.order([view; 9].into(), true, window, 2.0);
        assert_eq!((film.number, film.size), (2, ImageSize::new(20, 10)));
        assert_eq!((film.views.len(), film.frames_per_sec), (9, Some(30)));
    }

    #[test]
    fn an_animation_is_saved_whole_until_its_frames_are_chosen() {
        let folder = tempfile::tempdir().unwrap();
        let mut form = SaveForm::new(folder.path());
        assert_eq!(form.range_in(2.0), [0, 47]);
        form.frames_per_sec = 10;
        assert_eq!(form.range_in(2.04), [0, 19]);
        assert_eq!(form.range_in(0.0), [0, 0]);
        assert_eq!(form.range_in(1e9), [0, SaveForm::FRAME_MAX]);
        form.range = Some([3, 5]);
        let times: Vec<f64> = form.times_in(2.0).collect();
        assert_eq!(times, [0.3, 0.4, 0.5]);
    }
}
