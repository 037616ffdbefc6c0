//! Frames of a video: shots one after the other, and the scene at each frame.

use std::sync::Arc;

use carom_billiards::physics::{EventKind, Shot, Table};
use carom_tracer::{Camera, ImageSize, Scene, SceneUpdate};
use clap::ValueEnum;
use glam::DVec2;

use crate::audio::{self, Sound};
use crate::camera::{APERTURE_RADIUS_M, FollowCamera, Framing, Viewpoint, smoothstep};
use crate::particles::{BedMoment, ChalkPuff, ParticleMoment};
use crate::play::{CueView, cue_of_shot};
use crate::scene::table_scene::TableScene;

/// Where a film is seen from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum VideoView {
    /// From a fixed place beside the table
    #[default]
    Table,
    /// From behind the cue ball, rising to the whole table, as in the game
    Player,
    /// From straight above
    Plan,
    /// After the cue ball, and then after the ball that still moves
    Follow,
    /// From behind the pocket that a ball falls into
    Pocket,
    /// Round the table, slowly
    Orbit,
}

/// Sequence of shots to be traced as a film.
#[derive(Clone, Debug)]
pub struct ShotSequence {
    stage: TableScene,
    shots: Vec<Shot>,
    /// The cue of each shot.
    cues: Vec<Option<CueView>>,
    puffs: Vec<Arc<ChalkPuff>>,
    view: VideoView,
    /// The camera path of each shot with [`VideoView::Follow`], otherwise empty.
    followed: Vec<FollowCamera>,
    /// Width over height.
    aspect: f64,
    frames_per_sec: u16,
    /// Moment at which each shot begins, seconds since its stroke.
    first_secs: f64,
    /// Index of the first frame of each shot, and the total number of frames.
    starts: Vec<u32>,
}

impl ShotSequence {
    /// A sequence of whole shots, each followed by `REST_SECS` of rest. `frames_per_sec` is at least 1.
    pub fn whole(
        stage: TableScene,
        shots: Vec<Shot>,
        view: VideoView,
        frames_per_sec: u16,
    ) -> Self {
        let frames = |shot: &Shot| {
            let secs = shot.duration_secs() + REST_SECS;
            (secs * f64::from(frames_per_sec)).ceil() as u32
        };
        let mut starts = vec![0];
        for shot in &shots {
            let before = starts[starts.len() - 1];
            starts.push(before + frames(shot));
        }
        let cue = |shot| cue_of_shot(stage.table_inside(), shot);
        let followed = shots.iter().filter(|_| view == VideoView::Follow);
        Self {
            followed: followed
                .map(|shot| FollowCamera::new(shot, false))
                .collect(),
            aspect: 16.0 / 9.0,
            cues: shots.iter().map(cue).collect(),
            puffs: shots
                .iter()
                .map(|shot| Arc::new(ChalkPuff::new(shot)))
                .collect(),
            stage,
            shots,
            view,
            frames_per_sec,
            first_secs: 0.0,
            starts,
        }
    }

    /// A sequence of `frames` frames of a shot from shortly before the first contact of balls.
    pub fn impact(
        stage: TableScene,
        shot: Shot,
        view: VideoView,
        frames_per_sec: u16,
        frames: u32,
    ) -> Self {
        let first_secs = (first_contact_secs(&shot) - LEAD_IN_SECS).max(0.0);
        Self {
            first_secs,
            starts: vec![0, frames],
            ..Self::whole(stage, vec![shot], view, frames_per_sec)
        }
    }

    /// The sequence cut to at most `frames` frames.
    #[must_use]
    pub fn cut(mut self, frames: u32) -> Self {
        for start in &mut self.starts {
            *start = (*start).min(frames);
        }
        self
    }

    /// The sequence for frames of this size.
    #[must_use]
    pub fn sized(self, size: ImageSize) -> Self {
        let aspect = f64::from(size.width) / f64::from(size.height);
        Self { aspect, ..self }
    }

    /// The sound of all shots.
    pub fn soundtrack(&self) -> Sound {
        let mut track = Sound::default();
        for (shot, start) in self.shots.iter().zip(&self.starts) {
            let start_secs = f64::from(*start) / f64::from(self.frames_per_sec);
            track.mix(&audio::of_shot(shot).shifted(-self.first_secs), start_secs);
        }
        track
    }

    /// The scene, to which [`Self::update`] applies.
    pub fn scene(&self) -> &Scene {
        self.stage.scene()
    }

    /// Number of frames.
    pub fn frames(&self) -> u32 {
        self.starts[self.starts.len() - 1]
    }

    /// Frames per second.
    pub fn frames_per_sec(&self) -> u16 {
        self.frames_per_sec
    }

    /// Index of the shot of a frame, and the moment in it in seconds since the stroke.
    pub fn moment(&self, frame: u32) -> (usize, f64) {
        let shot = self.starts.partition_point(|&start| start <= frame);
        let shot = shot.clamp(1, self.shots.len()) - 1;
        let since = f64::from(frame.saturating_sub(self.starts[shot]));
        let secs = self.first_secs + since / f64::from(self.frames_per_sec);
        (shot, secs)
    }

    /// The update of the scene for a frame.
    pub fn update(&self, frame: u32) -> SceneUpdate {
        let (shot, moment_secs) = self.moment(frame);
        let cue = self.cues[shot].clone();
        let cue = cue.and_then(|cue| cue.swung(moment_secs));
        let cue = cue.map(|cue| cue.pose(self.stage.table_inside().cue_ball().radius_m));
        let sharp = self.camera(frame, shot, moment_secs);
        let puff = Arc::clone(&self.puffs[shot]);
        let shot = &self.shots[shot];
        let track = shot.particles().map(Arc::clone);
        let particles = ParticleMoment {
            dust: Some((puff, moment_secs)),
            bed: track.map(|track| BedMoment::Moving(track, moment_secs)),
        };
        let camera = sharp.aperture_radius_m(APERTURE_RADIUS_M);
        self.stage
            .update(camera, &shot.poses_at(moment_secs), cue.as_ref())
            .particles(particles.clouds(self.stage.particle_detail(), self.stage.cloth_albedo()))
    }
}

impl ShotSequence {
    fn camera(&self, frame: u32, index: usize, moment_secs: f64) -> Camera {
        let (table, shot) = (self.stage.table_inside(), &self.shots[index]);
        let viewpoint = match self.view {
            VideoView::Table => return self.stage.scene().camera,
            VideoView::Player => {
                let elevation_rad = self.cues[index]
                    .as_ref()
                    .map_or(0.0, |cue| cue.elevation_rad);
                behind(table, shot, elevation_rad, moment_secs)
            }
            VideoView::Plan => {
                let film = DVec2::new(self.aspect, 1.0) * PLAN_POINTS;
                return Viewpoint::overhead(table, &Framing::whole(film)).camera();
            }
            VideoView::Follow => {
                let ball = self.followed[index].at(moment_secs);
                Viewpoint::beside(ball, bearing_rad(shot).unwrap_or(0.0))
            }
            VideoView::Pocket => {
                let pocket = shot.potted().next().map_or(0, |(_, pocket)| pocket);
                match table.pockets().get(pocket) {
                    Some(pocket) => Viewpoint::from_pocket(pocket),
                    None => Viewpoint::overview(table, 0.0),
                }
            }
            VideoView::Orbit => {
                let secs = f64::from(frame) / f64::from(self.frames_per_sec);
                Viewpoint::overview(table, ORBIT_RAD_PER_SEC * secs)
            }
        };
        viewpoint.camera()
    }
}

/// Horizontal direction of the stroke; none if the cue ball is not struck.
fn bearing_rad(shot: &Shot) -> Option<f64> {
    let states = shot.states_at(0.0);
    let cue_ball = states.iter().find(|ball| ball.number == 0)?;
    let velocity = cue_ball.velocity.truncate();
    (velocity.length() > 0.0).then(|| velocity.to_angle())
}

/// View from behind the cue ball that rises to the whole table.
fn behind(table: &Table, shot: &Shot, elevation_rad: f64, moment_secs: f64) -> Viewpoint {
    let states = shot.states_at(0.0);
    let cue_ball = states.iter().find(|ball| ball.number == 0);
    let (Some(cue_ball), Some(bearing_rad)) = (cue_ball, bearing_rad(shot)) else {
        return Viewpoint::overview(table, 0.0);
    };
    let risen = smoothstep((moment_secs - RISE_SECS.start) / (RISE_SECS.end - RISE_SECS.start));
    let overview = Viewpoint::overview(table, bearing_rad);
    Viewpoint::over_cue(cue_ball.position, bearing_rad, elevation_rad).lerp(overview, risen)
}

fn first_contact_secs(shot: &Shot) -> f64 {
    let is_contact =
        |event: &&carom_billiards::physics::Event| matches!(event.kind, EventKind::BallBall { .. });
    let contact = shot.events().iter().find(is_contact);
    contact.map_or(0.0, |event| event.time_secs)
}

/// Height of a plan's frame in points; only the aspect ratio matters.
const PLAN_POINTS: f64 = 720.0;
/// Angular speed of the orbiting camera: one turn in a minute.
const ORBIT_RAD_PER_SEC: f64 = std::f64::consts::TAU / 60.0;
/// Time of rest after each shot.
const REST_SECS: f64 = 0.5;
/// Time before the first contact at which [`ShotSequence::impact`] begins.
const LEAD_IN_SECS: f64 = 0.1;
/// Time after the stroke in which the camera rises.
const RISE_SECS: std::ops::Range<f64> = 0.1..1.7;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ball_materials::BallSet;
    use carom_billiards::physics::{Stroke, World};

    fn shot(speed_m_s: f64) -> Shot {
        let table = TableScene::table();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        world.strike(Stroke::straight(1.2, speed_m_s)).unwrap()
    }

    #[test]
    fn shots_follow_each_other_at_their_own_times() {
        let shots = vec![shot(0.5), shot(0.2)];
        let ends: Vec<f64> = shots.iter().map(Shot::duration_secs).collect();
        let film = ShotSequence::whole(
            TableScene::room(BallSet::Classic),
            shots,
            VideoView::Player,
            24,
        );
        assert_eq!(film.moment(0), (0, 0.0));
        let second = (0..film.frames()).find(|&i| film.moment(i).0 == 1).unwrap();
        let (_, last_secs) = film.moment(second - 1);
        assert!(
            (ends[0]..ends[0] + REST_SECS).contains(&last_secs),
            "{last_secs}"
        );
        assert_eq!(film.moment(second), (1, 0.0));
        assert_eq!(film.moment(second + 12), (1, 0.5));
        assert_ne!(film.update(1), film.update(2));
        assert_eq!(film.clone().cut(second + 1).frames(), second + 1);
        assert_eq!(film.clone().cut(1).moment(0), (0, 0.0));
    }

    #[test]
    fn the_soundtrack_has_each_shot_at_its_time() {
        let stage = TableScene::room(BallSet::Classic);
        let film = ShotSequence::whole(stage, vec![shot(2.0), shot(2.0)], VideoView::Table, 24);
        let second = (0..film.frames()).find(|&i| film.moment(i).0 == 1).unwrap();
        let track = film.soundtrack().samples;
        let at = (f64::from(second) / 24.0 * f64::from(audio::RATE_HZ)) as usize;
        let peak = |samples: &[[f32; 2]]| {
            samples
                .iter()
                .flatten()
                .fold(0.0_f32, |peak, sample| peak.max(sample.abs()))
        };
        let (before, after) = (&track[at - 2400..at], &track[at..at + 2400]);
        assert!(
            peak(after) > 10.0 * peak(before),
            "{} {}",
            peak(after),
            peak(before)
        );
        assert_eq!(track[..480], audio::of_shot(&shot(2.0)).samples[..480]);
    }

    #[test]
    fn each_view_looks_from_elsewhere() {
        use clap::ValueEnum as _;
        let eyes = VideoView::value_variants().iter().map(|&view| {
            let stage = TableScene::room(BallSet::Classic);
            let film = ShotSequence::whole(stage, vec![shot(6.0)], view, 24);
            let camera = film.sized(ImageSize::new(320, 180)).update(30).camera;
            camera.unwrap().eye.to_array().map(f32::to_bits)
        });
        let eyes: std::collections::BTreeSet<[u32; 3]> = eyes.collect();
        assert_eq!(eyes.len(), VideoView::value_variants().len());
    }

    #[test]
    fn a_break_is_shown_from_shortly_before_its_impact() {
        let table = TableScene::table();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let soft = world.strike(Stroke::straight(0.0, 2.0)).unwrap();
        let contact = first_contact_secs(&soft);
        let film = ShotSequence::impact(
            TableScene::room(BallSet::Classic),
            soft,
            VideoView::Table,
            30,
            5,
        );
        let (_, first_secs) = film.moment(0);
        assert!((contact - first_secs - LEAD_IN_SECS).abs() < 1e-9);
        assert_eq!(film.frames(), 5);
    }
}
