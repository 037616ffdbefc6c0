//! The sequence of a video, frame by frame: shots one after the other, at their own times.

use carom_billiards::physics::{EventKind, Shot, Table};
use carom_tracer::SceneUpdate;
use clap::ValueEnum;

use crate::camera::{APERTURE_RADIUS_M, Viewpoint, smoothstep};
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
}

/// A film that is not yet traced.
#[derive(Clone, Debug)]
pub struct ShotSequence {
    stage: TableScene,
    shots: Vec<Shot>,
    /// What each shot is struck with.
    cues: Vec<Option<CueView>>,
    view: VideoView,
    frames_per_sec: u16,
    /// Where each shot begins, seconds since its stroke.
    first_secs: f64,
    /// Frames before each shot, and of all.
    starts: Vec<u32>,
}

impl ShotSequence {
    /// Whole shots, each with a moment of rest after it. `frames_per_sec` is at least 1.
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
        Self {
            cues: shots.iter().map(cue).collect(),
            stage,
            shots,
            view,
            frames_per_sec,
            first_secs: 0.0,
            starts,
        }
    }

    /// The first `frames` of a shot from shortly before balls meet.
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

    /// The same, of `frames` frames at most.
    #[must_use]
    pub fn cut(mut self, frames: u32) -> Self {
        for start in &mut self.starts {
            *start = (*start).min(frames);
        }
        self
    }

    /// The room.
    pub fn stage(&self) -> &TableScene {
        &self.stage
    }

    /// How many frames there are.
    pub fn frames(&self) -> u32 {
        self.starts[self.starts.len() - 1]
    }

    /// How many are shown in a second.
    pub fn frames_per_sec(&self) -> u16 {
        self.frames_per_sec
    }

    /// The shot of a frame, and the moment in it: seconds since the stroke.
    pub fn moment(&self, frame: u32) -> (usize, f64) {
        let shot = self.starts.partition_point(|&start| start <= frame);
        let shot = shot.clamp(1, self.shots.len()) - 1;
        let since = f64::from(frame.saturating_sub(self.starts[shot]));
        let secs = self.first_secs + since / f64::from(self.frames_per_sec);
        (shot, secs)
    }

    /// What differs in a frame from the scene at rest.
    pub fn update(&self, frame: u32) -> SceneUpdate {
        let (shot, moment_secs) = self.moment(frame);
        let cue = self.cues[shot].clone();
        let cue = cue.and_then(|cue| cue.swung(moment_secs));
        let cue = cue.map(|cue| cue.pose(self.stage.table_inside().cue_ball().radius_m));
        let shot = &self.shots[shot];
        let sharp = match self.view {
            VideoView::Table => self.stage.scene().camera,
            VideoView::Player => {
                let table = self.stage.table_inside();
                behind(table, shot, moment_secs).camera_in(table)
            }
        };
        let camera = sharp.aperture_radius_m(APERTURE_RADIUS_M);
        self.stage
            .update(camera, &shot.poses_at(moment_secs), cue.as_ref())
    }
}

/// From behind the cue ball up to the whole table.
fn behind(table: &Table, shot: &Shot, moment_secs: f64) -> Viewpoint {
    let cue_ball = shot
        .states_at(0.0)
        .into_iter()
        .find(|ball| ball.number == 0);
    let Some(cue_ball) = cue_ball.filter(|ball| ball.velocity.truncate().length() > 0.0) else {
        return Viewpoint::overview(table, 0.0);
    };
    let bearing_rad = cue_ball.velocity.truncate().to_angle();
    let risen = smoothstep((moment_secs - RISE_SECS.start) / (RISE_SECS.end - RISE_SECS.start));
    let overview = Viewpoint::overview(table, bearing_rad);
    Viewpoint::behind(cue_ball.position, bearing_rad).lerp(overview, risen)
}

fn first_contact_secs(shot: &Shot) -> f64 {
    let is_contact =
        |event: &&carom_billiards::physics::Event| matches!(event.kind, EventKind::BallBall { .. });
    let contact = shot.events().iter().find(is_contact);
    contact.map_or(0.0, |event| event.time_secs)
}

/// Balls lie still for so long before the next shot.
const REST_SECS: f64 = 0.5;
/// The cue ball is seen rolling for this long before it meets the rack.
const LEAD_IN_SECS: f64 = 0.1;
/// When the camera rises after the blow.
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
