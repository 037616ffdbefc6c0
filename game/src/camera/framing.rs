//! The part of the window that is not covered by panels.

use glam::DVec2;

/// A window and its free part, which panels do not cover, in points from the window's top left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Framing {
    /// Size of the window.
    pub film: DVec2,
    /// Top left of the free part.
    pub min: DVec2,
    /// Bottom right of the free part.
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

    /// Size of the free part, at least one point along each axis.
    pub fn size(&self) -> DVec2 {
        (self.max - self.min).max(DVec2::ONE)
    }

    /// Offset from the window's centre to that of the free part.
    pub fn offset(&self) -> DVec2 {
        0.5 * (self.min + self.max - self.film)
    }
}
