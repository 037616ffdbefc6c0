//! Mode of the window (game, replay or practice) and its view.

use carom_billiards::physics::BallPose;
use carom_tracer::{Camera, SceneUpdate};

use crate::camera::{APERTURE_RADIUS_M, Viewpoint};
use crate::capture::replay::ReplayPlayer;
use crate::particles::ParticleMoment;
use crate::play::practice::Practice;
use crate::play::{Game, ShotClock};
use crate::scene::cue_stick::CuePose;
use crate::scene::scoreboard::ScoreReading;
use crate::scene::table_scene::TableScene;

/// Content of the window.
#[derive(Debug)]
pub enum Mode {
    /// The game.
    Game,
    /// A replay of previous shots.
    Replay(Box<ReplayPlayer>),
    /// A practice table whose balls are being arranged.
    Practice(Box<Practice>),
}

/// Time of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewTime {
    /// The present, at a time in seconds.
    Now(f64),
    /// A moment of the present shot, as its [`ShotClock`] counts it.
    Moment(f64),
}

/// State of the view at one time: everything that a frame depends on.
#[derive(Clone, Debug)]
pub struct ModeView {
    /// The camera's viewpoint.
    pub viewpoint: Viewpoint,
    /// Aperture radius in metres: replays have depth of field, the game has none.
    pub aperture_radius_m: f32,
    /// The balls.
    pub poses: Vec<BallPose>,
    /// Reading of the scoreboard on the wall.
    pub scores: ScoreReading,
    /// The cue, if it is visible.
    pub cue: Option<CuePose>,
    /// Particles.
    pub particles: ParticleMoment,
    /// The clock of the present shot; none for [`ViewTime::Moment`].
    pub clock: Option<ShotClock>,
}

impl ModeView {
    /// The tracer's camera.
    pub fn camera(&self) -> Camera {
        let camera = self.viewpoint.camera();
        camera.aperture_radius_m(self.aperture_radius_m)
    }

    /// The update of a room's scene to this view.
    pub fn update(&self, room: &TableScene) -> SceneUpdate {
        let camera = self.camera();
        let clouds = (self.particles).clouds(room.particle_detail(), room.cloth_albedo());
        let update = room.update(camera, &self.poses, self.cue.as_ref());
        let hands = room.hand_poses(self.scores);
        hands.fold(update, SceneUpdate::pose).particles(clouds)
    }
}

impl Mode {
    /// The view of this mode at a time.
    pub fn view(&self, game: &Game, time: ViewTime) -> ModeView {
        let scores = ScoreReading::of(game.contest());
        match self {
            Self::Game => {
                let (clock, moment) = time.resolve(|now| game.shot_clock(now));
                let cue = match time {
                    ViewTime::Now(now_secs) => game.cue(now_secs),
                    ViewTime::Moment(moment_secs) => game.cue_in_shot(moment_secs),
                };
                ModeView {
                    viewpoint: game.viewpoint(moment),
                    aperture_radius_m: 0.0,
                    scores,
                    poses: game.poses(moment),
                    cue: cue.map(|cue| cue.pose(game.table().cue_ball().radius_m)),
                    particles: game.particles(moment),
                    clock,
                }
            }
            Self::Replay(player) => {
                let (clock, moment) = time.resolve(|now| player.shot_clock(now));
                ModeView {
                    viewpoint: player.viewpoint(game, moment),
                    aperture_radius_m: APERTURE_RADIUS_M,
                    scores,
                    poses: player.poses(moment),
                    cue: player.cue(game.table(), moment),
                    particles: player.particles(moment),
                    clock,
                }
            }
            // A practice table is seen through the game's camera.
            Self::Practice(practice) => ModeView {
                viewpoint: game.viewpoint(0.0),
                aperture_radius_m: 0.0,
                scores,
                poses: practice.poses(),
                cue: None,
                particles: practice.particles(),
                clock: None,
            },
        }
    }

    /// Whether the view changes with time.
    pub fn is_moving(&self, game: &Game) -> bool {
        let is_playing = matches!(self, Self::Replay(player) if player.clock().is_running());
        is_playing || game.is_moving()
    }
}

impl ViewTime {
    /// The clock for [`ViewTime::Now`], and the moment of the shot.
    fn resolve(self, clock_at: impl Fn(f64) -> Option<ShotClock>) -> (Option<ShotClock>, f64) {
        match self {
            Self::Now(now_secs) => {
                let clock = clock_at(now_secs);
                (clock, clock.map_or(0.0, ShotClock::shown_secs))
            }
            Self::Moment(moment_secs) => (None, moment_secs),
        }
    }
}
