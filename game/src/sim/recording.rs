//! A shot as a file, to be watched again: the trajectory itself, so that it stays what it was when
//! the physics changes.
//!
//! ```text
//! "carom shot" 0x0A | version u16 | postcard: table, duration, legs of each ball, events
//! ```
//! Between two events a ball has constant accelerations, so that its legs are all there is to know:
//! a break takes about 60 kB, and the shot that is read back has the bits of the one that was
//! written.

use std::{fs, path::Path};

use glam::DQuat;
use serde::{Deserialize, Serialize};

use super::{
    ball::{BallBody, Phase},
    error::{Error, Result},
    event::Event,
    shot::Shot,
    simulation::{Outcome, SHOT_SECS_MAX},
    track::{Leg, Track},
};

/// A shot and the table that it was played on.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Name of the table.
    pub table: String,
    /// What happened on it.
    pub shot: Shot,
}

impl Recording {
    /// The bytes of a file.
    ///
    /// # Errors
    /// [`Error::Recording`] for a shot of more than [`BYTES_MAX`].
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        let body =
            postcard::to_stdvec(&Written::of(self)).map_err(|e| Error::Recording(e.to_string()))?;
        bytes.extend(body);
        check_size(bytes.len() as u64)?;
        Ok(bytes)
    }

    /// Reads what [`Recording::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Error::Recording`] with what is wrong: another kind of file, another version, a file that
    /// was cut off, or numbers that no shot has.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let reject = |message: String| Err(Error::Recording(message));
        check_size(bytes.len() as u64)?;
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            return reject("it does not begin as a recorded shot does".to_owned());
        };
        let Some((version, body)) = rest.split_first_chunk() else {
            return reject("it ends within its version".to_owned());
        };
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return reject(format!(
                "its version is {version}, this program reads {VERSION}"
            ));
        }
        let (written, left): (Written, _) = match postcard::take_from_bytes(body) {
            Ok(taken) => taken,
            Err(error) => return reject(format!("it is cut off or damaged ({error})")),
        };
        if !left.is_empty() {
            return reject(format!("{} bytes follow its end", left.len()));
        }
        written.validate()?;
        Ok(written.into_recording())
    }

    /// Writes a file.
    ///
    /// # Errors
    /// [`Error::Recording`] with the path.
    pub fn save(&self, path: &Path) -> Result<()> {
        fs::write(path, self.to_bytes()?).map_err(|error| at(path, &error))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Recording`] with the path, as [`Recording::from_bytes`].
    pub fn load(path: &Path) -> Result<Self> {
        let size = fs::metadata(path).map_err(|error| at(path, &error))?.len();
        check_size(size).map_err(|error| at(path, &error))?;
        let bytes = fs::read(path).map_err(|error| at(path, &error))?;
        Self::from_bytes(&bytes).map_err(|error| match error {
            Error::Recording(why) => at(path, &why),
            other => other,
        })
    }
}

/// What a file holds. How a ball turns within a leg follows from how it is turned at its start.
#[derive(Serialize, Deserialize)]
struct Written {
    table: String,
    duration_secs: f64,
    tracks: Vec<WrittenTrack>,
    events: Vec<Event>,
}

#[derive(Serialize, Deserialize)]
struct WrittenTrack {
    number: u8,
    body: BallBody,
    legs: Vec<(Leg, DQuat)>,
    end_secs: f64,
    gone: Option<(f64, Phase)>,
}

impl Written {
    fn of(recording: &Recording) -> Self {
        let shot = &recording.shot;
        let track = |track: &Track| WrittenTrack {
            number: track.number(),
            body: track.body(),
            legs: track.legs().collect(),
            end_secs: track.end_secs(),
            gone: track.gone(),
        };
        Self {
            table: recording.table.clone(),
            duration_secs: shot.duration_secs(),
            tracks: shot.tracks().iter().map(track).collect(),
            events: shot.events().to_vec(),
        }
    }

    fn into_recording(self) -> Recording {
        let tracks = self.tracks.into_iter();
        let track =
            |t: WrittenTrack| Track::from_legs((t.number, t.body), &t.legs, t.end_secs, t.gone);
        Recording {
            table: self.table,
            shot: Shot::new(Outcome {
                tracks: tracks.map(track).collect(),
                events: self.events,
                end_secs: self.duration_secs,
            }),
        }
    }

    /// Whether a simulation may have made it.
    fn validate(&self) -> Result<()> {
        let duration_secs = self.duration_secs;
        if !(0.0..=SHOT_SECS_MAX).contains(&duration_secs) {
            return Err(Error::Recording(format!("it lasts {duration_secs} s")));
        }
        let times = self.events.iter().map(|event| event.time_secs);
        if !ascends(times, duration_secs) {
            let message = "its events are not in the order of time".to_owned();
            return Err(Error::Recording(message));
        }
        let mut turns = 0.0;
        for track in &self.tracks {
            turns += track.validate(duration_secs)?;
        }
        if turns > TURNS_MAX {
            return Err(Error::Recording(format!("its balls turn {turns} times")));
        }
        Ok(())
    }
}

impl WrittenTrack {
    /// How often the ball turns.
    fn validate(&self, duration_secs: f64) -> Result<f64> {
        let reject = |what: &str| {
            Err(Error::Recording(format!(
                "the way of ball {} {what}",
                self.number
            )))
        };
        let starts = self.legs.iter().map(|(leg, _)| leg.start_secs);
        let gone = self.gone.map(|(at, _)| at);
        let ends = [Some(self.end_secs), gone].into_iter().flatten();
        let last = self.legs.last().map_or(0.0, |(leg, _)| leg.start_secs);
        self.body
            .validate(self.number)
            .map_err(|error| Error::Recording(error.to_string()))?;
        if self.legs.is_empty() || self.legs[0].0.start_secs != 0.0 {
            return reject("does not begin with the shot");
        }
        if !ascends(starts, duration_secs) || !ends.clone().all(|end| end <= duration_secs) {
            return reject("is not in the order of time");
        }
        if !ends.clone().all(|end| end >= last) {
            return reject("ends before its last leg");
        }
        let mut turns = 0.0;
        let next = self.legs.iter().skip(1).map(|(leg, _)| leg.start_secs);
        for ((leg, orientation), end) in self.legs.iter().zip(next.chain([self.end_secs])) {
            if !leg.numbers().all(|v| v.abs() <= NUMBER_MAX) || !orientation.is_normalized() {
                return reject("has a number that is not finite, or too large");
            }
            let secs = end - leg.start_secs;
            let spin = leg.spin.length() + secs * leg.spin_acceleration.length();
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

fn at(path: &Path, why: &dyn std::fmt::Display) -> Error {
    Error::Recording(format!("{}: {why}", path.display()))
}

fn check_size(bytes: u64) -> Result<()> {
    if bytes <= BYTES_MAX {
        return Ok(());
    }
    Err(Error::Recording(format!(
        "it has {bytes} bytes, a shot at most {BYTES_MAX}"
    )))
}

const MAGIC: &[u8] = b"carom shot\n";
/// Rises when what follows it changes.
const VERSION: u16 = 1;
/// Hundreds of times a break.
pub const BYTES_MAX: u64 = 16 << 20;
/// In SI units: over anything that a ball does.
const NUMBER_MAX: f64 = 1e9;
/// Of all balls together: each turn takes memory once a shot is read. Sixteen balls that turn at
/// 300 rad/s for a minute each.
const TURNS_MAX: f64 = 46_000.0;
