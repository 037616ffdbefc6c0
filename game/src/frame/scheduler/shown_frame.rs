//! The picture on show, and the one before it.

use carom_tracer::{ImageSize, ObjectPose, SceneUpdate};
use carom_window::display::DisplayFrame;

use crate::frame::opening_still::OpeningStill;

/// The picture on show and its history.
#[derive(Debug, Default)]
pub(super) struct ShownFrame {
    /// Serial number of the newest picture.
    serial: u64,
    frame: Option<DisplayFrame>,
    /// Whether it was traced as a draft of a moving view.
    is_moving: bool,
    /// The picture that was on show before, until it is taken.
    replaced: Option<DisplayFrame>,
    still: Option<ShownStill>,
}

/// The opening still, which stays until a finer picture arrives or something moves.
#[derive(Debug)]
struct ShownStill {
    pixels: usize,
    poses: Vec<ObjectPose>,
    /// Time of the first target, in seconds.
    since_secs: Option<f64>,
}

impl ShownFrame {
    pub(super) fn frame(&self) -> Option<&DisplayFrame> {
        self.frame.as_ref()
    }

    pub(super) fn moving(&mut self) -> Option<&mut DisplayFrame> {
        self.frame.as_mut().filter(|_| self.is_moving)
    }

    pub(super) fn take_replaced(&mut self) -> Option<DisplayFrame> {
        self.replaced.take()
    }

    /// Creates a picture with the next serial number.
    pub(super) fn picture(
        &mut self,
        size: ImageSize,
        rgba: Vec<[u8; 4]>,
        update: SceneUpdate,
    ) -> DisplayFrame {
        self.serial += 1;
        DisplayFrame {
            serial: self.serial,
            size,
            rgba,
            update,
        }
    }

    /// Shows a picture of a moving view.
    pub(super) fn replace(&mut self, picture: DisplayFrame) {
        self.replaced = self.frame.replace(picture);
        self.is_moving = true;
    }

    /// Shows a picture of a view at rest, in place of the still.
    pub(super) fn refine(&mut self, picture: DisplayFrame) {
        self.still = None;
        self.replace(picture);
        self.is_moving = false;
    }

    pub(super) fn show_still(&mut self, still: OpeningStill) {
        let shown = ShownStill {
            pixels: still.size.pixels(),
            poses: still.update.poses.clone(),
            since_secs: None,
        };
        let picture = self.picture(still.size, still.rgba, still.update);
        self.refine(picture);
        self.still = Some(shown);
    }

    /// Whether a draft of this size would be coarser than the still of the same view.
    pub(super) fn keeps_still(&self, size: ImageSize) -> bool {
        let still = self.still.as_ref();
        still.is_some_and(|still| still.since_secs.is_some() && size.pixels() < still.pixels)
    }

    /// Drops the still once the target differs from it: other poses, a shot (`None`), or a change later than
    /// [`SETTLE_SECS`].
    pub(super) fn look(&mut self, now_secs: f64, view: Option<&SceneUpdate>) {
        self.still.take_if(|still| {
            let since_secs = *still.since_secs.get_or_insert(now_secs);
            let shows = view.is_some_and(|view| view.poses == still.poses);
            !shows || now_secs - since_secs > SETTLE_SECS
        });
    }
}

/// Time after the first target, in seconds, in which layout of the window's panels may still move the camera
/// without the player's action.
pub(super) const SETTLE_SECS: f64 = 0.5;
