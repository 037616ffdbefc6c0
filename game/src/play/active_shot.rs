//! A shot that is on: its clock and its camera.

use std::cell::OnceCell;
use std::ops::Range;
use std::sync::Arc;

use crate::camera::{
    CameraView, FollowCamera, Framing, ViewContext, ViewSelection, Viewpoint, smoothstep,
};
use crate::particles::{BedMoment, ChalkPuff, ParticleMoment};
use carom_billiards::physics::{Shot, Stroke, Table};

use super::cue::CueView;

/// A shot that is on.
#[derive(Debug)]
pub(super) struct ActiveShot {
    /// What it was struck with.
    pub(super) stroke: Stroke,
    /// What happens.
    pub(super) shot: Shot,
    /// When the tip meets the ball.
    pub(super) contact_secs: f64,
    /// The cue as it was drawn back.
    pub(super) cue: Option<CueView>,
    /// The view at the stroke, or when another was chosen.
    pub(super) from: Viewpoint,
    /// The moments between which the camera goes from there to the view that is chosen.
    pub(super) glide_secs: Range<f64>,
    /// The cue's direction.
    pub(super) bearing_rad: f64,
    /// The pocket that was played to, if the view depends on it.
    pub(super) pocket: Option<usize>,
    /// Whether the camera cuts to where it would glide.
    pub(super) instant_camera: bool,
    /// Once it is asked for.
    pub(super) chase: OnceCell<FollowCamera>,
    /// Once it is asked for.
    pub(super) puff: OnceCell<Arc<ChalkPuff>>,
}

impl ActiveShot {
    /// The moment on show at `now_secs`, in seconds since the blow; negative before it.
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

    /// From behind the cue ball up and back to the whole table, or to another view that is chosen, as
    /// a function of the shot's own time: pictures of the future know where the camera will be.
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
        // A cut goes all of the way as soon as the glide would have begun.
        let s = if self.instant_camera { s.ceil() } else { s };
        self.from.lerp(wanted, smoothstep(s))
    }

    /// Goes from the view `now` to another that was chosen.
    pub(super) fn turn(&mut self, now: Viewpoint, moment_secs: f64) {
        self.from = now;
        self.glide_secs = moment_secs..moment_secs + TURN_SECS;
    }
}

/// When the camera rises after the blow.
pub(super) const RISE_SECS: Range<f64> = 0.1..1.7;
/// Where the camera need not rise it is at its place when the balls begin to move.
pub(super) const ARRIVE_SECS: Range<f64> = -0.2..0.2;
/// From one view to another during a shot.
const TURN_SECS: f64 = 0.6;
