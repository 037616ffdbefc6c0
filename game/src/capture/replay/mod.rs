//! Shots that were played before, to be watched again: scrubbed, slowed down, stepped through, picked
//! from a list, kept as files.
//!
//! ```text
//! Recording (takes) ─▶ Viewing ─┬─ Clock (runs, slows, stands, is turned)
//!        ▲   ▲                  └─▶ poses and camera, as a game gives them
//!    Shelf   Match::recording
//! ```
//! Knows neither window nor farm; time is an argument.

mod clock;

use std::cell::OnceCell;

use carom_billiards::physics::{BallPose, BallState, Phase, Recording, Shot, Table, Take};

use crate::camera::{Chase, Sight, View, Viewpoint, Views};
use crate::capture::{Moment, moments};
use crate::input::{Intent, Watch};

pub use clock::Clock;

/// A recording on show.
#[derive(Clone, Debug)]
pub struct Viewing {
    recording: Recording,
    take: usize,
    clock: Clock,
    moments: Vec<Moment>,
    views: Views,
    chase: OnceCell<Chase>,
}

impl Viewing {
    /// Shows the last take of a recording of `table`; None if it has none.
    pub fn new(recording: Recording, table: &Table, now_secs: f64) -> Option<Self> {
        let take = recording.takes.len().checked_sub(1)?;
        let shot = &recording.takes[take].shot;
        Some(Self {
            clock: Clock::new(shot.duration_secs(), now_secs),
            moments: moments(shot),
            recording,
            take,
            views: Views::new(table),
            chase: OnceCell::new(),
        })
    }

    /// What is shown.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Index of the take on show.
    pub fn take(&self) -> usize {
        self.take
    }

    /// Its time.
    pub fn clock(&self) -> &Clock {
        &self.clock
    }

    /// What happens in it.
    pub fn moments(&self) -> &[Moment] {
        &self.moments
    }

    /// The shot on show.
    pub fn shot(&self) -> &Shot {
        &self.recording.takes[self.take].shot
    }

    /// Only the take on show, to be shared.
    pub fn excerpt(&self) -> Recording {
        Recording {
            table: self.recording.table.clone(),
            takes: vec![Take::clone(&self.recording.takes[self.take])],
        }
    }

    /// Does what the viewer wants.
    pub fn apply(&mut self, watch: Watch, now_secs: f64) {
        match watch {
            Watch::Toggle => self.clock.toggle(now_secs),
            Watch::Rate(rate) => self.clock.set_rate(rate, now_secs),
            Watch::Seek(moment_secs) => self.clock.seek(moment_secs, now_secs),
            Watch::Skip(by_secs) => {
                let moment_secs = self.clock.moment_secs(now_secs) + by_secs;
                self.clock.seek(moment_secs, now_secs);
            }
            Watch::Turn { forward: true } => self.apply(Watch::Pick(self.take + 1), now_secs),
            Watch::Turn { forward: false } => {
                self.apply(Watch::Pick(self.take.wrapping_sub(1)), now_secs);
            }
            Watch::Step { forward } => {
                let times: Vec<f64> = self.moments.iter().map(|moment| moment.secs).collect();
                self.clock.step(&times, forward, now_secs);
            }
            Watch::Pick(take) if take < self.recording.takes.len() => {
                self.take = take;
                self.chase = OnceCell::new();
                self.clock = self.clock.restarted(self.shot().duration_secs(), now_secs);
                self.moments = moments(self.shot());
            }
            Watch::Pick(_) => {}
        }
    }

    /// Does what the viewer wants of the camera.
    pub fn look(&mut self, intent: Intent, table: &Table, now_secs: f64) {
        let now = self.viewpoint(table, self.clock.moment_secs(now_secs) / self.clock.rate());
        self.views.take(intent, table, now);
    }

    /// The view that is chosen.
    pub fn view(&self) -> View {
        self.views.view()
    }

    /// Lets time pass.
    pub fn tick(&mut self, now_secs: f64) {
        self.clock.tick(now_secs);
    }

    /// While time passes: a number that differs after each turn of it, the moment on show and that of
    /// the end. These count the display's seconds, so that in slow motion as many pictures are asked
    /// for in a second as else.
    pub fn shot_clock(&self, now_secs: f64) -> Option<(u64, f64, f64)> {
        let rate = self.clock.rate();
        self.clock.is_running().then(|| {
            (
                NUMBERS_FROM + self.clock.turns(),
                self.clock.moment_secs(now_secs) / rate,
                self.clock.end_secs() / rate,
            )
        })
    }

    /// The balls at a moment that [`Viewing::shot_clock`] counts; while time stands, as they are.
    pub fn poses(&self, display_secs: f64) -> Vec<BallPose> {
        self.shot().poses_at(self.moment_secs(display_secs))
    }

    /// From where it is seen, at a moment as [`Viewing::poses`] counts it.
    pub fn viewpoint(&self, table: &Table, display_secs: f64) -> Viewpoint {
        let follows = self.views.view() == View::Follow;
        let chase = || {
            let chase = self.chase.get_or_init(|| Chase::new(self.shot(), false));
            chase.at(self.moment_secs(display_secs))
        };
        self.views.viewpoint(&Sight {
            table,
            ball: follows.then(chase),
            bearing_rad: bearing_rad(self.shot()),
            pocket: self
                .shot()
                .potted()
                .next()
                .map_or(Some(0), |(_, pocket)| Some(pocket)),
            is_wide: true,
        })
    }

    /// The moment of the shot that is meant by one that the display counts.
    fn moment_secs(&self, display_secs: f64) -> f64 {
        if self.clock.is_running() {
            (display_secs * self.clock.rate()).max(0.0)
        } else {
            // Standing, the clock shows the same at any time.
            self.clock.moment_secs(0.0).max(0.0)
        }
    }

    /// The balls before the stroke, at rest: to be played on from.
    pub fn start(&self) -> Vec<BallState> {
        at_rest(self.shot().states_at(0.0))
    }
}

/// The same places, with nothing in motion.
pub fn at_rest(mut balls: Vec<BallState>) -> Vec<BallState> {
    for ball in balls.iter_mut().filter(|ball| ball.phase.is_on_table()) {
        let still = BallState::at_rest(ball.number, ball.position.x, ball.position.y, &ball.body);
        *ball = BallState {
            orientation: ball.orientation,
            phase: Phase::Resting,
            ..still
        };
    }
    balls
}

/// Which way the cue ball is struck.
fn bearing_rad(shot: &Shot) -> f64 {
    let states = shot.states_at(0.0);
    let cue_ball = states.iter().find(|ball| ball.number == 0);
    cue_ball.map_or(0.0, |ball| ball.velocity.truncate().to_angle())
}

/// Beyond the numbers of shots that are played.
const NUMBERS_FROM: u64 = 1 << 62;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::{Stroke, World};

    fn viewing() -> Viewing {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let strike = |speed| world.strike(Stroke::straight(0.1, speed)).unwrap();
        let mut recording = Recording::of(&table, "soft", strike(1.0));
        recording.takes.push(Take {
            title: "hard".to_owned(),
            shot: strike(6.0),
        });
        Viewing::new(recording, &table, 100.0).unwrap()
    }

    #[test]
    fn slow_motion_shows_the_same_moments_later() {
        let mut viewing = viewing();
        assert_eq!(viewing.take(), 1, "the newest first");
        let (number, clock, end) = viewing.shot_clock(100.5).unwrap();
        assert_eq!((clock, end), (0.5, viewing.shot().duration_secs()));
        let poses = viewing.poses(0.5);
        assert_eq!(poses, viewing.shot().poses_at(0.5));
        viewing.apply(Watch::Rate(0.25), 100.5);
        let (slow, clock, slow_end) = viewing.shot_clock(100.5).unwrap();
        assert!(slow != number && slow_end == 4.0 * end);
        assert_eq!((clock, viewing.poses(clock)), (2.0, poses));
    }

    #[test]
    fn standing_still_it_is_a_still_picture() {
        let mut viewing = viewing();
        viewing.apply(Watch::Seek(0.7), 101.0);
        viewing.apply(Watch::Toggle, 101.0);
        assert_eq!(viewing.shot_clock(109.0), None);
        assert_eq!(viewing.poses(109.0), viewing.shot().poses_at(0.7));
        viewing.apply(Watch::Step { forward: false }, 110.0);
        let contacts: Vec<f64> = viewing.moments().iter().map(|m| m.secs).collect();
        assert!(contacts.contains(&viewing.clock().moment_secs(0.0)));
    }

    #[test]
    fn another_take_is_picked_shared_and_played_on_from() {
        let mut viewing = viewing();
        viewing.apply(Watch::Pick(7), 100.0);
        assert_eq!(viewing.take(), 1);
        viewing.apply(Watch::Pick(0), 100.0);
        let shared = Recording::from_bytes(&viewing.excerpt().to_bytes().unwrap()).unwrap();
        assert_eq!(
            (shared.takes.len(), shared.takes[0].title.as_str()),
            (1, "soft")
        );
        let world = World::new(
            Table::nine_foot(),
            carom_billiards::physics::Layout {
                balls: viewing.start(),
            },
        )
        .unwrap();
        let rack = Table::nine_foot().rack_eight(1).balls;
        let places = |balls: &[BallState]| balls.iter().map(|b| b.position).collect::<Vec<_>>();
        assert_eq!(places(&world.balls()), places(&rack));
        assert!(world.release().unwrap().duration_secs() == 0.0);
    }
}
