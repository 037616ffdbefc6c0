//! Replays of previous shots with seeking, slow motion, stepping through events, a list of shots, and files.
//!
//! ```text
//! Recording (takes) ─▶ ReplayPlayer ─┬─ ReplayClock (runs, slows, pauses, seeks)
//!        ▲   ▲                  └─▶ poses and camera, as a game gives them
//!    RecordingStore   Match::recording
//! ```
//! Uses neither window nor farm; time is an argument.

mod clock;

use std::cell::OnceCell;
use std::path::PathBuf;
use std::sync::Arc;

use crate::camera::{
    CameraIntent, CameraView, FollowCamera, ViewContext, ViewSelection, Viewpoint,
};
use crate::capture::{RecordingKind, TimelineEvent, timeline_events};
use crate::input::ReplayControl;
use crate::particles::{BedMoment, ChalkPuff, ParticleMoment};
use crate::play::practice::{PracticeLayout, at_rest};
use crate::play::{CueView, Game, ShotClock, cue_of_shot};
use crate::scene::cue_stick::CuePose;
use carom_billiards::physics::{
    BallPose, Clip, ParticleBed, ParticlePatch, ParticlePrecision, Recording, Shot, Table,
};

pub use clock::ReplayClock;

/// Command of the replay page.
#[derive(Clone, Debug, PartialEq)]
pub enum ReplayCommand {
    /// Control time, or choose another shot.
    Control(ReplayControl),
    /// Save the shot or all shots as a file.
    Save(RecordingKind),
    /// Open a file.
    Open(PathBuf),
    /// Render a film of the shot in the present view, or cancel the one in progress.
    Film,
    /// Continue play from the balls before the shot.
    Play,
    /// Go back to the game.
    Close,
}

/// Player of a recording.
#[derive(Clone, Debug)]
pub struct ReplayPlayer {
    table: Table,
    recording: Recording,
    take: usize,
    clock: ReplayClock,
    timeline: Vec<TimelineEvent>,
    views: ViewSelection,
    chase: OnceCell<FollowCamera>,
    cue: OnceCell<Option<CueView>>,
    puff: OnceCell<Arc<ChalkPuff>>,
}

impl ReplayPlayer {
    /// A player at the last take of a recording of `table`; none if it has no takes.
    pub fn new(recording: Recording, table: &Table, now_secs: f64) -> Option<Self> {
        let take = recording.clips.len().checked_sub(1)?;
        let shot = &recording.clips[take].shot;
        Some(Self {
            clock: ReplayClock::new(shot.duration_secs(), now_secs),
            timeline: timeline_events(shot),
            table: table.clone(),
            recording,
            take,
            views: ViewSelection::new(table),
            chase: OnceCell::new(),
            cue: OnceCell::new(),
            puff: OnceCell::new(),
        })
    }

    /// The recording.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Index of the take on show.
    pub fn take(&self) -> usize {
        self.take
    }

    /// The clock of the take on show.
    pub fn clock(&self) -> &ReplayClock {
        &self.clock
    }

    /// The events of the take on show.
    pub fn timeline_events(&self) -> &[TimelineEvent] {
        &self.timeline
    }

    /// The shot on show.
    pub fn shot(&self) -> &Shot {
        &self.recording.clips[self.take].shot
    }

    /// A recording of only the take on show.
    pub fn excerpt(&self) -> Recording {
        Recording {
            table: self.recording.table.clone(),
            clips: vec![Clip::clone(&self.recording.clips[self.take])],
        }
    }

    /// Applies a playback control.
    pub fn apply(&mut self, watch: ReplayControl, now_secs: f64) {
        match watch {
            ReplayControl::Toggle => self.clock.toggle(now_secs),
            ReplayControl::Rate(rate) => self.clock.set_rate(rate, now_secs),
            ReplayControl::Seek(moment_secs) => self.clock.seek(moment_secs, now_secs),
            ReplayControl::Skip(by_secs) => {
                let moment_secs = self.clock.moment_secs(now_secs) + by_secs;
                self.clock.seek(moment_secs, now_secs);
            }
            ReplayControl::Turn { forward: true } => {
                self.apply(ReplayControl::Pick(self.take + 1), now_secs)
            }
            ReplayControl::Turn { forward: false } => {
                self.apply(ReplayControl::Pick(self.take.wrapping_sub(1)), now_secs);
            }
            ReplayControl::Step { forward } => {
                let times: Vec<f64> = self.timeline.iter().map(|moment| moment.secs).collect();
                self.clock.step(&times, forward, now_secs);
            }
            ReplayControl::Pick(take) if take < self.recording.clips.len() => {
                self.take = take;
                self.chase = OnceCell::new();
                self.cue = OnceCell::new();
                self.puff = OnceCell::new();
                self.clock = self.clock.restarted(self.shot().duration_secs(), now_secs);
                self.timeline = timeline_events(self.shot());
            }
            ReplayControl::Pick(_) => {}
        }
    }

    /// Applies a command to the camera.
    pub fn look(&mut self, intent: CameraIntent, game: &Game, now_secs: f64) {
        let now = self.viewpoint(game, self.clock.moment_secs(now_secs) / self.clock.rate());
        self.views.apply(intent, game.table(), now);
    }

    /// The chosen view.
    pub fn view(&self) -> CameraView {
        self.views.view()
    }

    /// Advances the clock.
    pub fn tick(&mut self, now_secs: f64) {
        self.clock.tick(now_secs);
    }

    /// The clock while it runs. It counts seconds of display time, so that the frame rate is the same in
    /// slow motion.
    pub fn shot_clock(&self, now_secs: f64) -> Option<ShotClock> {
        let rate = self.clock.rate();
        self.clock.is_running().then(|| ShotClock {
            number: NUMBERS_FROM + self.clock.turns(),
            now_secs: self.clock.moment_secs(now_secs) / rate,
            end_secs: self.clock.end_secs() / rate,
        })
    }

    /// The balls at a time of [`ReplayPlayer::shot_clock`]; while the clock pauses, at the moment on show.
    pub fn poses(&self, display_secs: f64) -> Vec<BallPose> {
        self.shot().poses_at(self.moment_secs(display_secs))
    }

    /// The cue, at a time as in [`ReplayPlayer::poses`].
    pub fn cue(&self, table: &Table, display_secs: f64) -> Option<CuePose> {
        let cue = self.cue.get_or_init(|| cue_of_shot(table, self.shot()));
        let swung = cue.clone()?.swung(self.moment_secs(display_secs))?;
        Some(swung.pose(table.cue_ball().radius_m))
    }

    /// The particles, at a time as in [`ReplayPlayer::poses`].
    pub fn particles(&self, display_secs: f64) -> ParticleMoment {
        let puff = self
            .puff
            .get_or_init(|| Arc::new(ChalkPuff::new(self.shot())));
        let moment_secs = self.moment_secs(display_secs);
        let track = self.shot().particles();
        ParticleMoment {
            dust: Some((Arc::clone(puff), moment_secs)),
            bed: track.map(|track| BedMoment::Moving(Arc::clone(track), moment_secs)),
        }
    }

    /// The viewpoint, at a time as in [`ReplayPlayer::poses`]; table and framing are those of `game`.
    pub fn viewpoint(&self, game: &Game, display_secs: f64) -> Viewpoint {
        let follows = self.views.view() == CameraView::Follow;
        let chase = || {
            let chase = self
                .chase
                .get_or_init(|| FollowCamera::new(self.shot(), false));
            chase.at(self.moment_secs(display_secs))
        };
        self.views.viewpoint(&ViewContext {
            table: game.table(),
            framing: game.framing(),
            ball: follows.then(chase),
            bearing_rad: bearing_rad(self.shot()),
            elevation_rad: 0.0,
            pocket: self
                .shot()
                .potted()
                .next()
                .map_or(Some(0), |(_, pocket)| Some(pocket)),
            is_wide: true,
        })
    }

    /// The moment of the shot at a time of [`ReplayPlayer::shot_clock`].
    fn moment_secs(&self, display_secs: f64) -> f64 {
        if self.clock.is_running() {
            (display_secs * self.clock.rate()).max(0.0)
        } else {
            // A paused clock shows the same moment at any time.
            self.clock.moment_secs(0.0).max(0.0)
        }
    }

    /// The player with the same shot and view, from the stroke on and in real time.
    #[must_use]
    pub fn restarted(&self) -> Self {
        let mut player = self.clone();
        player.clock = ReplayClock::new(self.shot().duration_secs(), 0.0);
        player
    }

    /// The table before the stroke, at rest, from which play can continue. Particles are as they were first
    /// placed.
    pub fn start(&self) -> PracticeLayout {
        let balls = at_rest(self.shot().states_at(0.0));
        let patches = self.patches();
        let bed = ParticleBed::new(&self.table, &balls, patches, ParticlePrecision::default());
        PracticeLayout {
            // Without patches there is no bed.
            particles: bed.ok().map(Arc::new),
            balls,
        }
    }

    /// The patches of particles on the table.
    pub fn patches(&self) -> &[ParticlePatch] {
        self.shot().particles().map_or(&[], |track| track.patches())
    }
}

/// Horizontal direction of the stroke, 0 without a cue ball.
fn bearing_rad(shot: &Shot) -> f64 {
    let states = shot.states_at(0.0);
    let cue_ball = states.iter().find(|ball| ball.number == 0);
    cue_ball.map_or(0.0, |ball| ball.velocity.truncate().to_angle())
}

/// First number of replayed shots, beyond those of played ones.
const NUMBERS_FROM: u64 = 1 << 62;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::{BallState, Stroke, World};

    fn player() -> ReplayPlayer {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let strike = |speed| world.strike(Stroke::straight(0.1, speed)).unwrap();
        let mut recording = Recording::of(&table, "soft", strike(1.0));
        recording.clips.push(Clip {
            title: "hard".to_owned(),
            shot: strike(6.0),
        });
        ReplayPlayer::new(recording, &table, 100.0).unwrap()
    }

    #[test]
    fn slow_motion_shows_the_same_moments_later() {
        let mut player = player();
        assert_eq!(player.take(), 1, "the newest first");
        let clock = player.shot_clock(100.5).unwrap();
        let end_secs = player.shot().duration_secs();
        assert_eq!((clock.now_secs, clock.end_secs), (0.5, end_secs));
        let poses = player.poses(0.5);
        assert_eq!(poses, player.shot().poses_at(0.5));
        player.apply(ReplayControl::Rate(0.25), 100.5);
        let slow = player.shot_clock(100.5).unwrap();
        assert!(slow.number != clock.number && slow.end_secs == 4.0 * end_secs);
        assert_eq!((slow.now_secs, player.poses(slow.now_secs)), (2.0, poses));
    }

    #[test]
    fn standing_still_it_is_a_still_picture() {
        let mut player = player();
        player.apply(ReplayControl::Seek(0.7), 101.0);
        player.apply(ReplayControl::Toggle, 101.0);
        assert_eq!(player.shot_clock(109.0), None);
        assert_eq!(player.poses(109.0), player.shot().poses_at(0.7));
        player.apply(ReplayControl::Step { forward: false }, 110.0);
        let contacts: Vec<f64> = player.timeline_events().iter().map(|m| m.secs).collect();
        assert!(contacts.contains(&player.clock().moment_secs(0.0)));
    }

    #[test]
    fn another_take_is_picked_shared_and_played_on_from() {
        let mut player = player();
        player.apply(ReplayControl::Pick(7), 100.0);
        assert_eq!(player.take(), 1);
        player.apply(ReplayControl::Pick(0), 100.0);
        let shared = Recording::from_bytes(&player.excerpt().to_bytes().unwrap()).unwrap();
        assert_eq!(
            (shared.clips.len(), shared.clips[0].title.as_str()),
            (1, "soft")
        );
        let world = World::new(
            Table::nine_foot(),
            carom_billiards::physics::BallLayout {
                balls: player.start().balls,
            },
        )
        .unwrap();
        let rack = Table::nine_foot().rack_eight(1).balls;
        let places = |balls: &[BallState]| balls.iter().map(|b| b.position).collect::<Vec<_>>();
        assert_eq!(places(&world.balls()), places(&rack));
        assert!(world.release().unwrap().duration_secs() == 0.0);
    }
}
