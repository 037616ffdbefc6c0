//! Camera of a game, while aiming and during a shot.

use carom_billiards::physics::{self, AimContact, Pocket};
use carom_billiards::rules::Call;
use carom_text::text;
use carom_tracer::Camera;
use glam::DVec2;

use crate::camera::{
    CameraIntent, CameraView, Framing, Projection, ViewContext, Viewpoint, wrap_rad,
};

use super::{Game, LINE_POWER, TurnPhase};

impl Game {
    /// Sets the window and its free part.
    pub fn set_framing(&mut self, framing: Framing) {
        self.framing = framing;
    }

    /// The window and its free part.
    pub fn framing(&self) -> Framing {
        self.framing
    }

    /// The camera's projection to the window, at `moment_secs` of the present shot, or now.
    pub fn projection(&self, moment_secs: f64) -> Projection {
        let film = self.framing.film;
        Projection::new(&self.camera(moment_secs), film.x, film.y)
    }

    /// Sets whether the camera cuts instead of moving.
    pub fn set_instant_camera(&mut self, instant_camera: bool) {
        self.instant_camera = instant_camera;
    }

    /// The camera at `moment_secs` of the present shot, or now.
    pub fn camera(&self, moment_secs: f64) -> Camera {
        self.viewpoint(moment_secs).camera()
    }

    /// The viewpoint at `moment_secs` of the present shot, or now.
    pub fn viewpoint(&self, moment_secs: f64) -> Viewpoint {
        match self.active() {
            Some(active) => active.viewpoint(moment_secs, &self.views, self.table(), self.framing),
            None => self.seen_from,
        }
    }

    /// The chosen view.
    pub fn view(&self) -> CameraView {
        self.views.view()
    }

    /// Applies a command to the camera.
    pub fn look(&mut self, intent: CameraIntent, now_secs: f64) {
        let active = self.active();
        let moment_secs = active.map_or(0.0, |active| active.clock_secs(now_secs));
        let now = self.viewpoint(moment_secs);
        self.views.apply(intent, self.contest.world().table(), now);
        if intent.is_adjustment() {
            return;
        }
        self.notice = Some(text!("view-chosen", name = self.views.view().name()));
        if let TurnPhase::Watching(active) = &mut self.phase {
            active.turn(now, moment_secs);
        }
    }

    pub(super) fn aim_view(&self) -> Viewpoint {
        // The whole table is shown while the cue ball is placed, and once the match is over.
        let is_wide =
            matches!(self.phase, TurnPhase::Placing(_)) || self.contest.at_table().is_none();
        self.views.viewpoint(&ViewContext {
            table: self.table(),
            ball: self.cue_ball().filter(|_| !is_wide),
            bearing_rad: if is_wide { 0.0 } else { self.aim.bearing_rad },
            elevation_rad: self.aim.elevation_rad,
            pocket: self.pocket_ahead(),
            is_wide,
            framing: self.framing,
        })
    }

    /// Returns to the view before the present shot, if there is one.
    pub(super) fn look_from_before(&mut self) {
        if let Some(from) = self.active().map(|active| active.from) {
            self.seen_from = from;
        }
    }

    /// The target pocket, if the view depends on it: the called one, or the one nearest to the direction of
    /// the ball that the aim meets first.
    pub(super) fn pocket_ahead(&self) -> Option<usize> {
        if self.views.view() != CameraView::Pocket {
            return None;
        }
        if let Some(Call::Pot {
            pocket: Some(pocket),
            ..
        }) = self.contest.called()
        {
            return Some(pocket);
        }
        let stroke = self.aim.stroke(LINE_POWER);
        let met = physics::predict(self.contest.world(), stroke).map(|line| line.contact);
        let (from, way) = match met {
            Ok(AimContact::Ball {
                object,
                object_direction,
                ..
            }) => (object, object_direction),
            _ => (
                self.cue_ball()?,
                DVec2::from_angle(self.aim.bearing_rad).extend(0.0),
            ),
        };
        let off_rad = |pocket: &Pocket| {
            let wanted = pocket.center - from.truncate();
            wrap_rad(wanted.to_angle() - way.truncate().to_angle()).abs()
        };
        let pockets = self.table().pockets().iter().enumerate();
        let nearest = pockets.min_by(|(_, a), (_, b)| off_rad(a).total_cmp(&off_rad(b)));
        nearest.map(|(index, _)| index)
    }
}
