//! Track of particles over a shot: 60 frames a second, each of which stores the particles that have
//! moved.

use glam::{U16Vec3, Vec3};
use serde::{Deserialize, Serialize};

use super::{ParticleBed, ParticleGroup, ParticlePatch};
use crate::FileFault;

/// Positions of a table's particles over a shot, quantised to 16 bits along each edge of a box: 6 bytes
/// each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParticleTrack {
    patches: Vec<ParticlePatch>,
    groups: Vec<ParticleGroup>,
    spacing_m: f32,
    /// Corners of the box, in m.
    bounds: [Vec3; 2],
    start: Vec<[u16; 3]>,
    frames: Vec<Vec<Move>>,
    /// Positions as last recorded; `keys` holds all positions at every [`FRAMES_A_KEY`]-th frame.
    #[serde(skip)]
    last: Vec<U16Vec3>,
    #[serde(skip)]
    keys: Vec<Vec<U16Vec3>>,
}

/// A particle that has moved: the number of unmoved particles between it and the one before, and its
/// displacement in quantisation steps, modulo 2¹⁶.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Move {
    skipped: u32,
    way: [i16; 3],
}

impl ParticleTrack {
    /// Frames a second.
    pub const FRAMES_PER_SEC: f64 = 60.0;

    /// A track without frames: the particles of `bed` at the start.
    pub fn new(bed: &ParticleBed) -> Self {
        let centers = bed.centers();
        let half = bed.cloth_half_m().as_vec2();
        let bounds = [(-half).extend(-UNDER_M), half.extend(OVER_M)];
        let mut track = Self {
            patches: bed.patches().to_vec(),
            groups: bed.groups().to_vec(),
            spacing_m: bed.spacing_m(),
            bounds,
            start: Vec::new(),
            frames: Vec::new(),
            last: Vec::new(),
            keys: Vec::new(),
        };
        track.last = centers.iter().map(|center| track.place(*center)).collect();
        track.start = track.last.iter().map(|place| place.to_array()).collect();
        track.keys = vec![track.last.clone()];
        track
    }

    /// Adds the next frame.
    pub(super) fn push(&mut self, centers: &[Vec3]) {
        let mut moves = Vec::new();
        let mut skipped = 0;
        for (index, center) in centers.iter().enumerate() {
            let (place, last) = (self.place(*center), self.last[index]);
            let way = place.wrapping_sub(last).as_i16vec3();
            // Relative to the last recorded position, not to the frame before: creep is stored once it
            // adds up.
            if place.as_ivec3().distance_squared(last.as_ivec3()) < STEPS_SEEN * STEPS_SEEN {
                skipped += 1;
                continue;
            }
            moves.push(Move {
                skipped,
                way: way.to_array(),
            });
            self.last[index] = place;
            skipped = 0;
        }
        self.frames.push(moves);
        self.keep_key();
    }

    fn keep_key(&mut self) {
        if self.frames.len().is_multiple_of(FRAMES_A_KEY) {
            self.keys.push(self.last.clone());
        }
    }

    fn place(&self, center: Vec3) -> U16Vec3 {
        let [min, max] = self.bounds;
        let share = (center - min) / (max - min);
        // The conversion saturates: positions outside are clamped to the box.
        (share * f32::from(u16::MAX) + 0.5).as_u16vec3()
    }

    /// Patches that covered the table before anything moved.
    pub fn patches(&self) -> &[ParticlePatch] {
        &self.patches
    }

    /// Groups of particles by material.
    pub fn groups(&self) -> &[ParticleGroup] {
        &self.groups
    }

    /// Mean spacing of particles at rest, in m.
    pub fn spacing_m(&self) -> f32 {
        self.spacing_m
    }

    /// Corners of the quantisation box, in m.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    /// Quantised centres at a time of the shot in s: before 0 as at 0, after the end as at the end,
    /// linear between frames.
    pub fn places_at(&self, secs: f64) -> Vec<U16Vec3> {
        let frame = (secs * Self::FRAMES_PER_SEC).clamp(0.0, self.frames.len() as f64);
        let whole = frame as usize;
        let key = (whole / FRAMES_A_KEY).min(self.keys.len() - 1);
        let mut places = self.keys[key].clone();
        // Displacements are modulo 2¹⁶, so that wrapping addition gives the exact position.
        for moves in &self.frames[key * FRAMES_A_KEY..whole] {
            apply(moves, |index, way| {
                places[index] = places[index].wrapping_add(way.as_u16vec3())
            });
        }
        let share = (frame - whole as f64) as f32;
        if let Some(moves) = self.frames.get(whole).filter(|_| share > 0.0) {
            apply(moves, |index, way| {
                let part = (way.as_vec3() * share).round().as_i16vec3();
                places[index] = places[index].wrapping_add(part.as_u16vec3());
            });
        }
        places
    }

    /// Validates a track that was read from a file, and rebuilds its key frames.
    ///
    /// # Errors
    /// [`FileFault::Particles`] for contents that no simulation produces.
    pub(crate) fn checked(mut self, duration_secs: f64) -> Result<Self, FileFault> {
        let reject = |fault| Err(FileFault::Particles(fault));
        let [min, max] = self.bounds;
        let counts: u64 = self.groups.iter().map(|group| u64::from(group.count)).sum();
        // A generous bound, as particles settle for some time after the balls.
        let frames_max = (duration_secs + 3600.0) * Self::FRAMES_PER_SEC;
        let is_box = min.is_finite() && max.is_finite() && min.cmplt(max).all();
        if !is_box || (max - min).max_element() > BOX_M_MAX || min.abs().max_element() > BOX_M_MAX {
            return reject("their box is not one");
        }
        if !(1e-6..0.1).contains(&self.spacing_m) {
            return reject("their distance is not from 1 µm to 10 cm");
        }
        if counts != self.start.len() as u64 || self.start.len() > ParticleBed::PARTICLES_MAX {
            return reject("there are too many, or others than were said");
        }
        if self.frames.len() as f64 > frames_max {
            return reject("they move on after the shot");
        }
        self.last = self
            .start
            .iter()
            .map(|place| U16Vec3::from_array(*place))
            .collect();
        self.keys = vec![self.last.clone()];
        for (number, moves) in self.frames.iter().enumerate() {
            let reach: u64 = moves.iter().map(|step| u64::from(step.skipped) + 1).sum();
            if reach > counts {
                return reject("one moves that is not there");
            }
            let last = &mut self.last;
            apply(moves, |index, way| {
                last[index] = last[index].wrapping_add(way.as_u16vec3())
            });
            if (number + 1).is_multiple_of(FRAMES_A_KEY) {
                self.keys.push(self.last.clone());
            }
        }
        Ok(self)
    }
}

fn apply(moves: &[Move], mut each: impl FnMut(usize, glam::I16Vec3)) {
    let mut index = 0;
    for Move { skipped, way } in moves {
        index += *skipped as usize;
        each(index, glam::I16Vec3::from_array(*way));
        index += 1;
    }
}

/// Extent of the box below and above the cloth, in m: particles that fly higher are clamped to its top.
const UNDER_M: f32 = 0.01;
const OVER_M: f32 = 0.5;
/// Largest plausible coordinate and edge of the box, in m.
const BOX_M_MAX: f32 = 20.0;
/// Quantisation steps that a particle moves before it is recorded: 0.1 mm along a nine-foot table.
const STEPS_SEEN: i32 = 3;
/// Frames per key frame, from which positions are reconstructed.
const FRAMES_A_KEY: usize = 32;
