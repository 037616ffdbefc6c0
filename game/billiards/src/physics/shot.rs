//! A simulated shot: the state of every ball at each instant.

use std::sync::Arc;

use crate::Result;

use super::{
    ball::{BallPose, BallState},
    event::{Event, EventKind},
    event_engine::{EventEngine, SimulatedShot, Until},
    laws::Laws,
    particles::{ParticleBed, ParticleTrack},
    table::Table,
    trajectory::Trajectory,
};

/// A whole shot, from the stroke until all balls are at rest.
#[derive(Clone, Debug)]
pub struct Shot {
    trajectories: Vec<Trajectory>,
    events: Vec<Event>,
    duration_secs: f64,
    particles: Option<Arc<ParticleTrack>>,
    /// The particles at the end; none for a shot that was read from a file.
    bed: Option<Arc<ParticleBed>>,
}

impl Shot {
    pub(crate) fn new(outcome: SimulatedShot) -> Self {
        let SimulatedShot {
            trajectories,
            events,
            end_secs,
        } = outcome;
        Self {
            trajectories,
            events,
            duration_secs: end_secs,
            particles: None,
            bed: None,
        }
    }

    /// The same shot with particles, which at the end are those of `bed`.
    pub(crate) fn with_particles(self, track: ParticleTrack, bed: Option<ParticleBed>) -> Self {
        Self {
            particles: Some(Arc::new(track)),
            bed: bed.map(Arc::new),
            ..self
        }
    }

    /// Track of the particles, on a table that has some.
    pub fn particles(&self) -> Option<&Arc<ParticleTrack>> {
        self.particles.as_ref()
    }

    pub(crate) fn bed(&self) -> Option<&Arc<ParticleBed>> {
        self.bed.as_ref()
    }

    /// Simulates moving balls on a table until all are at rest: [`super::World::release`] for sets of
    /// balls that no world holds, with repeated numbers.
    ///
    /// # Errors
    /// [`crate::Error::Endless`] if they do not come to rest.
    pub fn of_balls(table: &Table, laws: &Laws, balls: &[BallState]) -> Result<Self> {
        Ok(Self::new(
            EventEngine::new(table, laws, balls).run(Until::Rest, &mut |_| {})?,
        ))
    }

    pub(crate) fn trajectories(&self) -> &[Trajectory] {
        &self.trajectories
    }

    /// Time at which the last ball came to rest, in s.
    pub fn duration_secs(&self) -> f64 {
        self.duration_secs
    }

    /// Poses at a time in s, in the order of the world's balls; before 0 as at 0, after the end as
    /// at rest. Exact at any instant: nothing is interpolated.
    pub fn poses_at(&self, t: f64) -> Vec<BallPose> {
        self.trajectories
            .iter()
            .map(|trajectory| trajectory.pose_at(t))
            .collect()
    }

    /// States at a time in s; at the instant of an event, those after it.
    pub fn states_at(&self, t: f64) -> Vec<BallState> {
        self.trajectories
            .iter()
            .map(|trajectory| trajectory.state_at(t))
            .collect()
    }

    /// States of the balls at the end.
    pub fn final_states(&self) -> Vec<BallState> {
        self.states_at(self.duration_secs)
    }

    /// Numbers of the balls that fell into pockets, in their order, with the pockets' indices.
    pub fn potted(&self) -> impl Iterator<Item = (u8, usize)> {
        self.events.iter().filter_map(|event| match event.kind {
            EventKind::Pocketed { ball, pocket, .. } => Some((ball, pocket)),
            _ => None,
        })
    }

    /// The events, in the order of time.
    pub fn events(&self) -> &[Event] {
        &self.events
    }
}
