//! The mode of the window (game, replay or practice) and the view that it gives.

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

/// What the window shows.
#[derive(Debug)]
pub enum Mode {
    /// The game.
    Game,
    /// A replay of previous shots.
    Replay(Box<ReplayPlayer>),
    /// A table whose balls are being arranged.
    Practice(Box<Practice>),
}

/// The time of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewTime {
    /// Now, in seconds since the program began.
    Now(f64),
    /// A moment of the shot that is on, as its [`ShotClock`] counts it.
    Moment(f64),
}

/// What is seen at one time: everything a frame depends on.
#[derive(Clone, Debug)]
pub struct ModeView {
    /// From where it is seen.
    pub viewpoint: Viewpoint,
    /// Radius of the lens's aperture in metres: replays have depth of field, in play all is sharp.
    pub aperture_radius_m: f32,
    /// The balls.
    pub poses: Vec<BallPose>,
    /// What the scoreboard on the wall shows.
    pub scores: ScoreReading,
    /// The cue, while there is one to show.
    pub cue: Option<CuePose>,
    /// Particles.
    pub particles: ParticleMoment,
    /// The clock of the shot that is on; none for another moment than now.
    pub clock: Option<ShotClock>,
}

impl ModeView {
    /// The tracer's camera.
    pub fn camera(&self) -> Camera {
        let camera = self.viewpoint.camera();
        camera.aperture_radius_m(self.aperture_radius_m)
    }

    /// The traced scene in a room.
    pub fn update(&self, room: &TableScene) -> SceneUpdate {
        let camera = self.camera();
        let clouds = (self.particles).clouds(room.particle_detail(), room.cloth_albedo());
        let update = room.update(camera, &self.poses, self.cue.as_ref());
        let hands = room.hand_poses(self.scores);
        hands.fold(update, SceneUpdate::pose).particles(clouds)
    }
}

impl Mode {
    /// The view of this mode, beside `game`.
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
            // The game's camera looks at a table that is being arranged.
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

    /// Whether time alone changes what is seen.
    pub fn is_moving(&self, game: &Game) -> bool {
        let is_playing = matches!(self, Self::Replay(player) if player.clock().is_running());
        is_playing || game.is_moving()
    }
}

impl ViewTime {
    /// The clock, if this is now, and the moment of the shot.
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
