//! The present shot with its clock and camera.

use std::cell::OnceCell;
use std::ops::Range;
use std::sync::Arc;

use crate::camera::{
    CameraView, FollowCamera, Framing, ViewContext, ViewSelection, Viewpoint, smoothstep,
};
use crate::particles::{BedMoment, ChalkPuff, ParticleMoment};
use carom_billiards::physics::{Shot, Stroke, Table};

use super::cue::CueView;

/// The shot on show.
#[derive(Debug)]
pub(super) struct ActiveShot {
    /// The stroke.
    pub(super) stroke: Stroke,
    /// The simulated shot.
    pub(super) shot: Shot,
    /// Time of the contact of tip and ball.
    pub(super) contact_secs: f64,
    /// The cue as it was drawn back.
    pub(super) cue: Option<CueView>,
    /// The view at the stroke, or when another view was chosen.
    pub(super) from: Viewpoint,
    /// Moments between which the camera moves from there to the chosen view.
    pub(super) glide_secs: Range<f64>,
    /// Horizontal direction of the cue.
    pub(super) bearing_rad: f64,
    /// The target pocket, if the view depends on it.
    pub(super) pocket: Option<usize>,
    /// Whether the camera cuts instead of moving.
    pub(super) instant_camera: bool,
    /// The path of the following camera, computed on demand.
    pub(super) chase: OnceCell<FollowCamera>,
    /// The chalk dust, created on demand.
    pub(super) puff: OnceCell<Arc<ChalkPuff>>,
}

impl ActiveShot {
    /// The moment on show at `now_secs`, in seconds since the contact; negative before it.
    pub(super) fn clock_secs(&self, now_secs: f64) -> f64 {
        now_secs - self.contact_secs
    }

    /// The particles at a moment.
    pub(super) fn particles(&self, moment_secs: f64) -> ParticleMoment {
        let puff = self
            .puff
            .get_or_init(|| Arc::new(ChalkPuff::new(&self.shot)));
        let track = self.shot.particles();
        ParticleMoment {
            dust: Some((Arc::clone(puff), moment_secs)),
            bed: track.map(|track| BedMoment::Moving(Arc::clone(track), moment_secs)),
        }
    }

    /// The viewpoint at a moment, which moves from the view at the stroke to the chosen one. It is a
    /// function of the shot's time alone, so that frames of future moments can be requested.
    pub(super) fn viewpoint(
        &self,
        moment_secs: f64,
        views: &ViewSelection,
        table: &Table,
        framing: Framing,
    ) -> Viewpoint {
        let chase = || FollowCamera::new(&self.shot, self.instant_camera);
        let follows = views.view() == CameraView::Follow;
        let wanted = views.viewpoint(&ViewContext {
            table,
            ball: follows.then(|| self.chase.get_or_init(chase).at(moment_secs)),
            bearing_rad: self.bearing_rad,
            elevation_rad: 0.0,
            pocket: self.pocket,
            is_wide: true,
            framing,
        });
        let Range { start, end } = self.glide_secs;
        let s = (moment_secs - start) / (end - start);
        // A cut happens when the camera would start to move.
        let s = if self.instant_camera { s.ceil() } else { s };
        self.from.lerp(wanted, smoothstep(s))
    }

    /// Starts to move from the view `now` to a newly chosen one.
    pub(super) fn turn(&mut self, now: Viewpoint, moment_secs: f64) {
        self.from = now;
        self.glide_secs = moment_secs..moment_secs + TURN_SECS;
    }
}

/// Moments between which the camera rises from behind the cue.
pub(super) const RISE_SECS: Range<f64> = 0.1..1.7;
/// Moments between which the camera moves in other views, so that it is in place when the balls begin to
/// move.
pub(super) const ARRIVE_SECS: Range<f64> = -0.2..0.2;
/// Duration of the move to another view during a shot.
const TURN_SECS: f64 = 0.6;
