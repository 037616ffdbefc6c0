//! Selection of the camera's view, and the player's rotation of it.

use carom_billiards::physics::Table;
use carom_text::text;
use glam::DVec3;

use super::viewpoint::{Orbit, Viewpoint};
use super::{Framing, wrap_rad};

/// Player's command to the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraIntent {
    /// Rotate the camera about its focus, radians.
    Orbit {
        /// To the left.
        yaw_rad: f64,
        /// Upwards.
        pitch_rad: f64,
    },
    /// Multiply the camera's distance.
    Zoom(f64),
    /// Choose the next view.
    NextView,
    /// Toggle between the views from above and behind the cue.
    Overhead,
    /// Look from a saved viewpoint.
    LookFrom(Viewpoint),
}

impl CameraIntent {
    /// Whether it adjusts the chosen view rather than choosing another.
    pub fn is_adjustment(self) -> bool {
        matches!(self, Self::Orbit { .. } | Self::Zoom(_))
    }
}

/// Kind of view of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraView {
    /// Over the cue along the aim; during a shot the whole table.
    #[default]
    Shooter,
    /// The whole table from above.
    Overhead,
    /// A free viewpoint placed by the player.
    Orbit,
    /// Following the cue ball, and then the ball that still moves.
    Follow,
    /// From behind the target pocket.
    Pocket,
}

impl CameraView {
    /// All views, in the order of [`CameraIntent::NextView`].
    pub const ALL: [Self; 5] = [
        Self::Shooter,
        Self::Overhead,
        Self::Orbit,
        Self::Follow,
        Self::Pocket,
    ];

    /// Display name, which follows "View:".
    pub fn name(self) -> &'static str {
        match self {
            Self::Shooter => text!("view-shooter"),
            Self::Overhead => text!("view-overhead"),
            Self::Orbit => text!("view-orbit"),
            Self::Follow => text!("view-follow"),
            Self::Pocket => text!("view-pocket"),
        }
    }

    /// The next view that `table` has, cyclically.
    fn next(self, table: &Table) -> Self {
        let has = |view: &Self| *view != Self::Pocket || !table.pockets().is_empty();
        let place = Self::ALL.iter().position(|view| *view == self);
        let rest = &Self::ALL[place.map_or(0, |place| place + 1)..];
        rest.iter().copied().find(has).unwrap_or_default()
    }
}

/// Input of [`ViewSelection::viewpoint`].
#[derive(Clone, Copy, Debug)]
pub struct ViewContext<'a> {
    /// The table.
    pub table: &'a Table,
    /// Centre of the ball that is played or followed, if there is one, metres.
    pub ball: Option<DVec3>,
    /// Horizontal direction of the cue, radians.
    pub bearing_rad: f64,
    /// Elevation of the cue, radians.
    pub elevation_rad: f64,
    /// Index of the target pocket.
    pub pocket: Option<usize>,
    /// Whether the whole table is to be shown: during a shot, or while the cue ball is placed by hand.
    pub is_wide: bool,
    /// Free part of the window.
    pub framing: Framing,
}

/// The player's choice of view, and rotation of it.
#[derive(Clone, Copy, Debug)]
pub struct ViewSelection {
    view: CameraView,
    by: Orbit,
    /// Viewpoint of [`CameraView::Orbit`] before rotation.
    free: Viewpoint,
}

/// Largest number of saved views.
pub const SAVED_MAX: usize = 4;

impl ViewSelection {
    /// The view behind the cue.
    pub fn new(table: &Table) -> Self {
        Self {
            view: CameraView::Shooter,
            by: Orbit::default(),
            free: Viewpoint::overview(table, 0.0),
        }
    }

    /// The chosen view.
    pub fn view(&self) -> CameraView {
        self.view
    }

    /// Applies a command to the camera, whose present viewpoint is `now`.
    pub fn apply(&mut self, intent: CameraIntent, table: &Table, now: Viewpoint) {
        match intent {
            CameraIntent::Orbit { yaw_rad, pitch_rad } => self.look(yaw_rad, pitch_rad, 1.0),
            CameraIntent::Zoom(zoom) => self.look(0.0, 0.0, zoom),
            CameraIntent::NextView => self.choose(self.view.next(table), now),
            CameraIntent::Overhead if self.view == CameraView::Overhead => {
                self.choose(CameraView::Shooter, now)
            }
            CameraIntent::Overhead => self.choose(CameraView::Overhead, now),
            CameraIntent::LookFrom(saved) => self.choose(CameraView::Orbit, saved),
        }
    }

    /// Turns the view behind the cue back to the cue's direction.
    pub fn straighten(&mut self) {
        if self.view == CameraView::Shooter {
            self.by.yaw_rad = 0.0;
        }
    }

    /// The viewpoint of the chosen view.
    pub fn viewpoint(&self, sight: &ViewContext<'_>) -> Viewpoint {
        let (table, bearing_rad) = (sight.table, sight.bearing_rad);
        let overview = Viewpoint::overview(table, bearing_rad);
        let pocket = sight.pocket.and_then(|pocket| table.pockets().get(pocket));
        let wanted = match (self.view, sight.ball, pocket) {
            (CameraView::Overhead, ..) => Viewpoint::overhead(table, &sight.framing),
            (CameraView::Orbit, ..) => self.free,
            (CameraView::Shooter, Some(ball), _) if !sight.is_wide => {
                Viewpoint::over_cue(ball, bearing_rad, sight.elevation_rad)
            }
            (CameraView::Follow, Some(ball), _) => Viewpoint::beside(ball, bearing_rad),
            (CameraView::Pocket, _, Some(pocket)) => Viewpoint::from_pocket(pocket),
            _ => overview,
        };
        let wanted = if self.by == Orbit::default() {
            wanted
        } else {
            wanted.adjusted(self.by)
        };
        match self.view {
            // The first includes the framing, the second is taken from a view on screen.
            CameraView::Overhead | CameraView::Orbit => wanted,
            _ => wanted.framed(&sight.framing),
        }
    }

    fn choose(&mut self, view: CameraView, free: Viewpoint) {
        (self.view, self.by, self.free) = (view, Orbit::default(), free);
    }

    fn look(&mut self, yaw_rad: f64, pitch_rad: f64, zoom: f64) {
        self.by = Orbit {
            yaw_rad: wrap_rad(self.by.yaw_rad + yaw_rad),
            pitch_rad: (self.by.pitch_rad + pitch_rad).clamp(-1.4, 1.4),
            zoom: (self.by.zoom * zoom).clamp(0.3, 2.5),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(table: &Table) -> ViewContext<'_> {
        ViewContext {
            table,
            ball: Some(DVec3::new(-0.6, 0.1, 0.028)),
            bearing_rad: 0.4,
            elevation_rad: 0.0,
            pocket: Some(1),
            is_wide: false,
            framing: framing(),
        }
    }

    fn framing() -> Framing {
        Framing::whole(glam::DVec2::new(16.0, 9.0))
    }

    #[test]
    fn a_key_goes_through_all_views_and_each_differs_from_the_one_before() {
        let table = Table::nine_foot();
        let mut views = ViewSelection::new(&table);
        let mut seen: Vec<(CameraView, Viewpoint)> = Vec::new();
        for view in CameraView::ALL {
            assert_eq!(views.view(), view);
            let at = views.viewpoint(&sight(&table));
            // The free view begins where the camera is.
            let before = seen.last().filter(|_| view != CameraView::Orbit);
            assert!(before.is_none_or(|(_, before)| *before != at), "{view:?}");
            seen.push((view, at));
            views.apply(CameraIntent::NextView, &table, at);
        }
        assert_eq!(views.view(), CameraView::Shooter);
    }

    #[test]
    fn a_table_without_pockets_has_no_view_from_one() {
        let table = Table::built_in("carom").unwrap();
        let mut views = ViewSelection::new(&table);
        for _ in 0..10 {
            let at = views.viewpoint(&sight(&table));
            views.apply(CameraIntent::NextView, &table, at);
            assert_ne!(views.view(), CameraView::Pocket);
        }
    }

    #[test]
    fn from_above_and_back_with_one_key() {
        let table = Table::nine_foot();
        let mut views = ViewSelection::new(&table);
        let at = views.viewpoint(&sight(&table));
        views.apply(CameraIntent::Zoom(0.9), &table, at);
        views.apply(CameraIntent::Overhead, &table, at);
        assert_eq!(
            views.viewpoint(&sight(&table)),
            Viewpoint::overhead(&table, &framing()),
            "what was zoomed is of the view before"
        );
        views.apply(CameraIntent::Overhead, &table, at);
        assert_eq!(views.viewpoint(&sight(&table)), at);
    }

    #[test]
    fn a_saved_view_is_seen_as_it_was_and_turned_from_there() {
        let table = Table::nine_foot();
        let mut views = ViewSelection::new(&table);
        let saved = Viewpoint::overhead(&table, &framing());
        views.apply(CameraIntent::LookFrom(saved), &table, saved);
        assert_eq!(views.viewpoint(&sight(&table)), saved);
        let turn = CameraIntent::Orbit {
            yaw_rad: 0.01,
            pitch_rad: 0.0,
        };
        views.apply(turn, &table, saved);
        let turned = views.viewpoint(&sight(&table));
        let way = (turned.camera().eye - saved.camera().eye).length();
        assert!(way > 0.0 && way < 0.05, "no jump: {way} m");
    }
}
