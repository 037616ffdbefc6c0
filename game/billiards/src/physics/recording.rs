//! Recordings: files of shots for replay, sharing and playing on. They store the trajectories
//! themselves, and so do not change with the physics.
//!
//! ```text
//! "carom shot" 0x0A | version u16 | postcard: table, clips (title, duration, segments of each ball,
//! events)
//! ```
//! A recording holds one shot, a whole match, or a layout, which is a shot without a stroke whose balls
//! are at rest. Between two events a ball has constant accelerations, so that its segments determine it
//! fully: a break takes about 60 kB, a layout 3 kB, and a shot that is read has the bits of the one
//! that was written. On a table with particles the version is 3, and the particles' tracks follow.

use std::path::Path;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use crate::file_format::{self, FileFormat};
use crate::{Error, FileFault, Result};

use super::{
    ball::{BallBody, Phase},
    event::Event,
    event_engine::{SHOT_SECS_MAX, SimulatedShot},
    particles::ParticleTrack,
    shot::Shot,
    table::Table,
    trajectory::{Segment, Trajectory},
};

/// Shots of one table, in their order.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Name of the table.
    pub table: String,
    /// The shots: 1 to [`CLIPS_MAX`].
    pub clips: Vec<Clip>,
}

/// A recorded shot.
#[derive(Clone, Debug)]
pub struct Clip {
    /// Title for display: the player and the outcome. At most [`TITLE_BYTES_MAX`] bytes.
    pub title: String,
    /// The shot.
    pub shot: Shot,
}

impl Recording {
    /// Recording of one shot.
    pub fn of(table: &Table, title: impl Into<String>, shot: Shot) -> Self {
        let title = title.into();
        Self {
            table: table.name().to_owned(),
            clips: vec![Clip { title, shot }],
        }
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// [`Error::Recording`] for no clips or too many, a title that is too long, too much motion, or
    /// more than [`BYTES_MAX`].
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let written = RecordingFile::of(self);
        let tracks = self
            .clips
            .iter()
            .map(|clip| clip.shot.particles().map(|track| &**track));
        let tracks: Vec<Option<&ParticleTrack>> = tracks.collect();
        // Contents that could not be read back are not written.
        let bytes = written
            .validate()
            .and_then(|()| match tracks.iter().all(Option::is_none) {
                true => FORMAT.encode(&written),
                false => PARTICLES_FORMAT.encode(&(&written, tracks)),
            });
        bytes.map_err(Error::Recording)
    }

    /// Reads what [`Recording::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Error::Recording`] for another kind of file, another version, a truncated file, or numbers
    /// that no shot has.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Self::decode(bytes).map_err(Error::Recording)
    }

    fn decode(bytes: &[u8]) -> Result<Self, FileFault> {
        let (written, tracks): (RecordingFile, Vec<Option<ParticleTrack>>) =
            match PARTICLES_FORMAT.is_of(bytes) {
                true => PARTICLES_FORMAT.decode(bytes)?,
                false => (FORMAT.decode(bytes)?, Vec::new()),
            };
        written.validate()?;
        let mut recording = written.into_recording();
        for (clip, track) in recording.clips.iter_mut().zip(tracks) {
            if let Some(track) = track {
                let track = track.checked(clip.shot.duration_secs())?;
                clip.shot = clip.shot.clone().with_particles(track, None);
            }
        }
        Ok(recording)
    }

    /// Writes a file atomically.
    ///
    /// # Errors
    /// [`Error::Recording`] with the path.
    pub fn save(&self, path: &Path) -> Result<()> {
        let bytes = self.to_bytes()?;
        file_format::replace(path, &bytes).map_err(|error| at(path, FileFault::Io(error)))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Recording`] with the path, as [`Recording::from_bytes`].
    pub fn load(path: &Path) -> Result<Self> {
        let read = FORMAT.read(path).and_then(|bytes| Self::decode(&bytes));
        read.map_err(|fault| at(path, fault))
    }
}

/// Contents of a file. A ball's rotation within a segment follows from its orientation at the start.
#[derive(Serialize, Deserialize)]
struct RecordingFile {
    table: String,
    clips: Vec<ClipFile>,
}

#[derive(Serialize, Deserialize)]
struct ClipFile {
    title: String,
    duration_secs: f64,
    trajectories: Vec<TrajectoryFile>,
    events: Vec<Event>,
}

#[derive(Serialize, Deserialize)]
struct TrajectoryFile {
    number: u8,
    body: BallBody,
    segments: Vec<(Segment, DQuat)>,
    end_secs: f64,
    gone: Option<(f64, Phase)>,
}

impl RecordingFile {
    fn of(recording: &Recording) -> Self {
        Self {
            table: recording.table.clone(),
            clips: recording.clips.iter().map(ClipFile::of).collect(),
        }
    }

    fn into_recording(self) -> Recording {
        let takes = self.clips.into_iter().map(ClipFile::into_clip);
        Recording {
            table: self.table,
            clips: takes.collect(),
        }
    }

    /// Checks that simulations can have produced it.
    fn validate(&self) -> Result<(), FileFault> {
        check_clips(self.clips.iter().map(|take| take.title.as_str()))?;
        let mut turns = 0.0;
        for take in &self.clips {
            turns += take.validate()?;
        }
        if turns > TURNS_MAX {
            return Err(FileFault::Turns(turns));
        }
        Ok(())
    }
}

impl ClipFile {
    fn of(take: &Clip) -> Self {
        let trajectory = |trajectory: &Trajectory| TrajectoryFile {
            number: trajectory.number(),
            body: trajectory.body(),
            segments: trajectory.segments().collect(),
            end_secs: trajectory.end_secs(),
            gone: trajectory.gone(),
        };
        Self {
            title: take.title.clone(),
            duration_secs: take.shot.duration_secs(),
            trajectories: take.shot.trajectories().iter().map(trajectory).collect(),
            events: take.shot.events().to_vec(),
        }
    }

    fn into_clip(self) -> Clip {
        let trajectories = self.trajectories.into_iter();
        let trajectory = |t: TrajectoryFile| {
            Trajectory::from_segments((t.number, t.body), &t.segments, t.end_secs, t.gone)
        };
        Clip {
            title: self.title,
            shot: Shot::new(SimulatedShot {
                trajectories: trajectories.map(trajectory).collect(),
                events: self.events,
                end_secs: self.duration_secs,
            }),
        }
    }

    /// Checks the clip; returns the number of turns of its balls.
    fn validate(&self) -> Result<f64, FileFault> {
        let duration_secs = self.duration_secs;
        if !(0.0..=SHOT_SECS_MAX).contains(&duration_secs) {
            return Err(FileFault::Duration(duration_secs));
        }
        let times = self.events.iter().map(|event| event.time_secs);
        if !ascends(times, duration_secs) {
            return Err(FileFault::EventsUnordered);
        }
        let trajectories = self.trajectories.iter();
        trajectories
            .map(|trajectory| trajectory.validate(duration_secs))
            .sum()
    }
}

impl TrajectoryFile {
    /// Checks the trajectory; returns the number of turns of its ball.
    fn validate(&self, duration_secs: f64) -> Result<f64, FileFault> {
        let reject = |fault| {
            Err(FileFault::Path {
                ball: self.number,
                fault,
            })
        };
        let starts = self.segments.iter().map(|(segment, _)| segment.start_secs);
        let gone = self.gone.map(|(at, _)| at);
        let ends = [Some(self.end_secs), gone].into_iter().flatten();
        let last = self
            .segments
            .last()
            .map_or(0.0, |(segment, _)| segment.start_secs);
        self.body.validate(self.number).map_err(FileFault::Body)?;
        if self.segments.is_empty() || self.segments[0].0.start_secs != 0.0 {
            return reject("does not begin with the shot");
        }
        if !ascends(starts, duration_secs) || !ends.clone().all(|end| end <= duration_secs) {
            return reject("is not in the order of time");
        }
        if !ends.clone().all(|end| end >= last) {
            return reject("ends before its last segment");
        }
        let mut turns = 0.0;
        let next = self
            .segments
            .iter()
            .skip(1)
            .map(|(segment, _)| segment.start_secs);
        for ((segment, orientation), end) in self.segments.iter().zip(next.chain([self.end_secs])) {
            if !segment.numbers().all(|v| v.abs() <= NUMBER_MAX) || !orientation.is_normalized() {
                return reject("has a number that is not finite, or too large");
            }
            let secs = end - segment.start_secs;
            // Never exceeded within the segment: an upper bound of the rotation.
            let spin = segment.spin.length() + secs * segment.spin_acceleration.length();
            turns += secs * spin / std::f64::consts::TAU;
        }
        Ok(turns)
    }
}

/// Whether times ascend from 0 to `end` at most; NaN does not.
fn ascends(mut times: impl Iterator<Item = f64>, end: f64) -> bool {
    let mut last = 0.0;
    times.all(|time| {
        let follows = (last..=end).contains(&time);
        last = time;
        follows
    })
}

fn check_clips<'a>(titles: impl ExactSizeIterator<Item = &'a str>) -> Result<(), FileFault> {
    let shots = titles.len();
    if !(1..=CLIPS_MAX).contains(&shots) {
        return Err(FileFault::ShotCount {
            shots,
            max: CLIPS_MAX,
        });
    }
    for title in titles {
        if title.len() > TITLE_BYTES_MAX || title.chars().any(char::is_control) {
            return Err(FileFault::Title {
                bytes: title.len(),
                max: TITLE_BYTES_MAX,
            });
        }
    }
    Ok(())
}

fn at(path: &Path, fault: FileFault) -> Error {
    Error::Recording(FileFault::At {
        path: path.to_owned(),
        fault: Box::new(fault),
    })
}

const FORMAT: FileFormat = FileFormat {
    kind: "recorded shot",
    magic: b"carom shot\n",
    version: 2,
    bytes_max: BYTES_MAX,
};
/// Format of shots on tables with particles: the clips are followed by an `Option` of the track of
/// each.
const PARTICLES_FORMAT: FileFormat = FileFormat {
    version: 3,
    ..FORMAT
};
/// Maximum size of a file: hundreds of breaks.
pub const BYTES_MAX: u64 = 16 << 20;
/// Maximum number of clips: as many shots as a match keeps.
pub const CLIPS_MAX: usize = 2000;
/// Maximum length of a title in bytes: one line.
pub const TITLE_BYTES_MAX: usize = 400;
/// Largest magnitude of a number in SI units: beyond anything that a ball reaches.
const NUMBER_MAX: f64 = 1e9;
/// Maximum turns of all balls together: each takes up to half a kilobyte of memory once a shot is read.
/// Sixteen balls at 300 rad/s for five minutes each.
const TURNS_MAX: f64 = 230_000.0;
