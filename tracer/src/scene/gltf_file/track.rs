//! Tracks of an animation: key frames of one property and their interpolation (appendix C of the
//! specification).

use glam::DQuat;
use gltf_json::accessor::Type;
use gltf_json::animation::{Interpolation, Property, Sampler};

use super::{Document, Refusal, known};

/// Key frames of a translation, rotation, scale or of the weights of morph targets.
#[derive(Debug)]
pub(super) struct Track {
    /// Times in seconds, strictly increasing.
    times: Vec<f32>,
    /// `width` values per time; for cubic splines three times as many: in-tangent, value and
    /// out-tangent.
    values: Vec<f32>,
    width: usize,
    interpolation: Interpolation,
    is_rotation: bool,
}

impl Track {
    /// Reads and checks a track with `width` values per key frame.
    pub(super) fn read(
        document: &Document,
        sampler: &Sampler,
        property: Property,
        width: usize,
        what: &str,
    ) -> Result<Self, Refusal> {
        let unknown = || format!("{what} is interpolated in no way that glTF knows");
        let interpolation = known(&sampler.interpolation, unknown)?;
        let times = document.numbers(sampler.input, Type::Scalar, what)?;
        check_times(&times, what)?;
        let kind = match property {
            Property::Translation | Property::Scale => Type::Vec3,
            Property::Rotation => Type::Vec4,
            Property::MorphTargetWeights => Type::Scalar,
        };
        let values = document.numbers(sampler.output, kind, what)?;
        let track = Self {
            times,
            values,
            width,
            interpolation,
            is_rotation: property == Property::Rotation,
        };
        track.check_values(what)?;
        Ok(track)
    }

    fn check_values(&self, what: &str) -> Result<(), Refusal> {
        let (keys, found) = (self.times.len(), self.values.len());
        let wanted = keys * self.parts() * self.width;
        if found != wanted {
            return Err(format!(
                "{what} has {keys} key frames and {found} numbers of them: it must have {wanted}"
            ));
        }
        if let Some(place) = self.values.iter().position(|value| !value.is_finite()) {
            let (key, value) = (place / (self.parts() * self.width), self.values[place]);
            return Err(format!(
                "{what}: key frame {key} has {value}: it must be finite"
            ));
        }
        let is_turned = |key: &usize| self.value(*key).iter().any(|value| value.abs() > 1e-6);
        match (0..keys).find(|key| self.is_rotation && !is_turned(key)) {
            Some(key) => Err(format!("{what}: key frame {key} is a rotation of length 0")),
            None => Ok(()),
        }
    }

    /// Number of floats that the track holds.
    pub(super) fn numbers(&self) -> usize {
        self.times.len() + self.values.len()
    }

    /// Time of the last key frame in seconds.
    pub(super) fn end_secs(&self) -> f64 {
        self.times.last().map_or(0.0, |secs| f64::from(*secs))
    }

    /// The value at a time; constant before the first and after the last key frame.
    pub(super) fn at(&self, secs: f64) -> Vec<f64> {
        let next = self.times.partition_point(|key| f64::from(*key) <= secs);
        let value = match next {
            0 => widened(self.value(0)),
            next if next == self.times.len() => widened(self.value(next - 1)),
            next => self.between(next - 1, secs),
        };
        if self.is_rotation {
            return rotation(&value).to_array().to_vec();
        }
        value
    }

    /// The value between key frame `key` and the next one.
    fn between(&self, key: usize, secs: f64) -> Vec<f64> {
        let [begin, end] = [key, key + 1].map(|key| f64::from(self.times[key]));
        let t = (secs - begin) / (end - begin);
        let (from, to) = (self.value(key), self.value(key + 1));
        match self.interpolation {
            Interpolation::Step => widened(from),
            Interpolation::Linear if self.is_rotation => {
                let [from, to] = [from, to].map(|value| rotation(&widened(value)));
                // `slerp` takes the shorter arc.
                from.slerp(to, t).to_array().to_vec()
            }
            Interpolation::Linear => {
                let pairs = from.iter().zip(to);
                pairs
                    .map(|(a, b)| f64::from(*a) * (1.0 - t) + f64::from(*b) * t)
                    .collect()
            }
            Interpolation::CubicSpline => {
                let (leaving, arriving) = (self.part(key, 2), self.part(key + 1, 0));
                let (t2, t3, length) = (t * t, t * t * t, end - begin);
                // Cubic Hermite basis of both values and tangents. Tangents are per second, so they
                // are scaled by the interval's length.
                let weights = [
                    2.0 * t3 - 3.0 * t2 + 1.0,
                    length * (t3 - 2.0 * t2 + t),
                    3.0 * t2 - 2.0 * t3,
                    length * (t3 - t2),
                ];
                let sum = |i: usize| {
                    let knots = [from[i], leaving[i], to[i], arriving[i]];
                    let terms = knots.iter().zip(weights);
                    terms.map(|(knot, weight)| f64::from(*knot) * weight).sum()
                };
                (0..self.width).map(sum).collect()
            }
        }
    }

    fn value(&self, key: usize) -> &[f32] {
        self.part(key, self.parts() / 2)
    }

    fn part(&self, key: usize, part: usize) -> &[f32] {
        let start = (key * self.parts() + part) * self.width;
        &self.values[start..start + self.width]
    }

    /// Number of parts of a key frame: a value, with tangents for cubic splines.
    fn parts(&self) -> usize {
        match self.interpolation {
            Interpolation::CubicSpline => 3,
            Interpolation::Linear | Interpolation::Step => 1,
        }
    }
}

fn check_times(times: &[f32], what: &str) -> Result<(), Refusal> {
    if let Some(key) = times
        .iter()
        .position(|secs| !(*secs >= 0.0 && secs.is_finite()))
    {
        let secs = times[key];
        return Err(format!(
            "{what}: key frame {key} is at {secs} s: it must be at 0 or later"
        ));
    }
    match times.windows(2).position(|pair| pair[0] >= pair[1]) {
        Some(key) => Err(format!(
            "{what}: key frame {} is at {} s, but the one before is at {} s: times must grow",
            key + 1,
            times[key + 1],
            times[key]
        )),
        None => Ok(()),
    }
}

fn widened(value: &[f32]) -> Vec<f64> {
    value.iter().map(|number| f64::from(*number)).collect()
}

/// The unit quaternion of a value; the identity if interpolation has brought it to 0.
fn rotation(value: &[f64]) -> DQuat {
    let [x, y, z, w] = *value else {
        return DQuat::IDENTITY;
    };
    let rotation = DQuat::from_xyzw(x, y, z, w);
    match rotation.length_squared() > 1e-24 {
        true => rotation.normalize(),
        false => DQuat::IDENTITY,
    }
}
