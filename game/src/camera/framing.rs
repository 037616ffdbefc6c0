//! The part of the window that panels leave to the picture.

use glam::DVec2;

/// A window and the part of it that panels leave to the picture, in points from the window's top left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// The window's size.
    pub film: DVec2,
    /// The part's top left.
    pub min: DVec2,
    /// The part's bottom right.
    pub max: DVec2,
}

impl Framing {
    /// A window without panels.
    pub fn whole(film: DVec2) -> Self {
        Self {
            film,
            min: DVec2::ZERO,
            max: film,
        }
    }

    /// The part's size; never nothing.
    pub fn size(&self) -> DVec2 {
        (self.max - self.min).max(DVec2::ONE)
    }

    /// From the window's middle to the part's.
    pub fn offset(&self) -> DVec2 {
        0.5 * (self.min + self.max - self.film)
    }
}
