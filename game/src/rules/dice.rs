//! Random draws as a hash of a seed and how many were drawn: the same on every machine.

use std::f64::consts::TAU;

use carom_tracer::sampling::pcg4d;
use glam::DQuat;

/// A sequence of draws.
#[derive(Clone, Debug)]
pub struct Dice {
    seed: u32,
    stream: u32,
    drawn: u32,
}

impl Dice {
    /// Draws of a seed; different streams are independent.
    pub fn new(seed: u32, stream: u32) -> Self {
        Self {
            seed,
            stream,
            drawn: 0,
        }
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.drawn = self.drawn.wrapping_add(1);
        let [word, ..] = pcg4d([self.drawn, self.seed, self.stream, DICE]);
        f64::from(word) / 4_294_967_296.0
    }

    /// Normally distributed with mean 0 and deviation 1 (Box and Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (TAU * self.unit()).cos()
    }

    /// Fisher and Yates.
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let other = (self.unit() * (last + 1) as f64) as usize;
            items.swap(last, other.min(last));
        }
    }

    /// Uniform over all rotations: Shoemake, "Uniform random rotations", Graphics Gems III.
    pub fn rotation(&mut self) -> DQuat {
        let (radius, first, second) = (self.unit(), TAU * self.unit(), TAU * self.unit());
        let (low, high) = ((1.0 - radius).sqrt(), radius.sqrt());
        DQuat::from_xyzw(
            low * first.sin(),
            low * first.cos(),
            high * second.sin(),
            high * second.cos(),
        )
        .normalize()
    }
}

/// Keeps these numbers apart from others drawn with the same seed.
const DICE: u32 = 0x6469_6365;
