//! Layout of the panels over the picture: each takes a strip of the remaining free part, so that none
//! overlaps another at any size of window and text.

use carom_billiards::rules::{Calls, RuleInfo, RuleSet};
use egui::{Align, Align2, Area, Context, Id, Order, Rect, Ui, Vec2};
use glam::DVec2;

use crate::camera::Framing;

/// The free part of the window.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    free: Rect,
    center_x: f32,
    is_low: bool,
}

impl Layout {
    /// A layout of an empty part of the window.
    pub fn new(room: Rect) -> Self {
        Self {
            free: room,
            center_x: room.center().x,
            is_low: room.height() < LOW,
        }
    }

    /// Whether the window is so low that only the essential is shown.
    pub(super) fn is_low(&self) -> bool {
        self.is_low
    }

    /// The free part.
    pub fn free(&self) -> Rect {
        self.free
    }

    /// Takes a column at the left of the free part.
    pub fn take_left(&mut self, width: f32) -> Rect {
        let (column, rest) = self.free.split_left_right_at_x(self.free.left() + width);
        self.free = rest;
        column
    }

    /// The free part that is symmetric about the room's centre, if that is wide enough; otherwise the whole
    /// free part.
    fn middle(&self) -> Rect {
        let (left, right) = (
            self.center_x - self.free.left(),
            self.free.right() - self.center_x,
        );
        match left.min(right) {
            half if half < 0.5 * MIDDLE => self.free,
            half => self
                .free
                .with_min_x(self.center_x - half)
                .with_max_x(self.center_x + half),
        }
    }

    /// Draws a panel at the top, bottom or right edge of the free part, which it is taken from.
    pub fn dock<T>(
        &mut self,
        ctx: &Context,
        name: &str,
        place: Align2,
        draw: impl FnOnce(&mut Ui) -> T,
    ) -> T {
        let to = |align| match align {
            Align::Min => GAP,
            Align::Center => 0.0,
            Align::Max => -GAP,
        };
        let part = match place.x() {
            Align::Center => self.middle(),
            _ => self.free,
        };
        let area = Area::new(Id::unique(name))
            .order(Order::Middle)
            .constrain_to(part)
            .anchor(place, Vec2::new(to(place.x()), to(place.y())));
        let room = part.shrink(GAP).size().max(Vec2::splat(GAP));
        let shown = area.show(ctx, |ui| {
            ui.set_max_size(room);
            draw(ui)
        });
        let taken = shown.response.rect;
        match place.y() {
            Align::Min => self.free.min.y = taken.bottom().min(self.free.max.y),
            Align::Max => self.free.max.y = taken.top().max(self.free.min.y),
            Align::Center => self.free.max.x = taken.left().max(self.free.min.x),
        }
        shown.inner
    }
}

/// Panels of a mode. The picture leaves room for them whether they are drawn or not: if it moved with
/// each message, it would never come to rest.
#[derive(Clone, Debug)]
pub enum Panels {
    /// Game: the cue at the left, the score at the top, calls at the right, actions at the bottom.
    Game(RuleInfo),
    /// Replay: all at the bottom.
    Replay,
    /// Practice: all at the bottom.
    Practice,
}

impl Panels {
    /// The free part that they leave of `room`, a part of a window of this size.
    pub fn framing(&self, film: Vec2, room: Rect) -> Framing {
        let is_low = room.height() < LOW;
        let (left, top, right, bottom) = match self {
            Self::Game(info) => {
                let has_score = info.name != RuleSet::Free.info().name;
                let score = match (has_score, is_low) {
                    (false, _) => 0.0,
                    (true, false) => 104.0,
                    (true, true) => 78.0,
                };
                let right = match info.calls {
                    Calls::Nothing => GAP,
                    Calls::Pocket | Calls::Colour => CALLS,
                };
                (CUE_COLUMN, score + SENTENCE, right, 56.0)
            }
            Self::Replay => (GAP, SENTENCE, GAP, if is_low { 230.0 } else { 200.0 }),
            Self::Practice => (GAP, SENTENCE, GAP, if is_low { 190.0 } else { 150.0 }),
        };
        let part = Rect::from_min_max(
            room.min + Vec2::new(left, top),
            room.max - Vec2::new(right, bottom),
        );
        let double = |x: f32, y: f32| DVec2::new(x.into(), y.into());
        Framing {
            film: double(film.x, film.y),
            min: double(part.min.x, part.min.y),
            max: double(part.max.x, part.max.y),
        }
    }
}

/// Height of the window below which only the essential is shown.
const LOW: f32 = 500.0;
/// Height of a line of messages.
const SENTENCE: f32 = 44.0;
/// Least width for messages.
const MIDDLE: f32 = 564.0;
/// Width of the column of calls.
const CALLS: f32 = 196.0;
/// Gap between a panel and the window's edge.
const GAP: f32 = 8.0;
/// Width of the column of power and spin.
pub const CUE_COLUMN: f32 = 124.0;
