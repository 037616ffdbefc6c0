//! Counter-based random numbers: a hash of the seed and the count of draws, identical on every machine.

use std::f64::consts::TAU;

use glam::DQuat;

use crate::deterministic_math::{cos, log, sin_cos};

/// A counter-based random number generator.
#[derive(Clone, Debug)]
pub struct CounterRng {
    seed: u32,
    stream: u32,
    domain: u32,
    drawn: u32,
}

impl CounterRng {
    /// Generator of a seed; different streams are independent.
    pub fn new(seed: u32, stream: u32) -> Self {
        Self::in_domain(seed, stream, DICE)
    }

    /// Generator whose numbers are independent of those of other domains, whatever the stream.
    pub(crate) fn in_domain(seed: u32, stream: u32, domain: u32) -> Self {
        Self {
            seed,
            stream,
            domain,
            drawn: 0,
        }
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.drawn = self.drawn.wrapping_add(1);
        let [word, ..] = pcg4d([self.drawn, self.seed, self.stream, self.domain]);
        f64::from(word) / 4_294_967_296.0
    }

    /// Normally distributed with mean 0 and deviation 1 (Box and Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        // In (0, 1], so that the logarithm is finite.
        let radius = (-2.0 * log(1.0 - self.unit())).sqrt();
        radius * cos(TAU * self.unit())
    }

    /// Shuffles uniformly (Fisher and Yates).
    pub fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            let other = (self.unit() * (last + 1) as f64) as usize;
            items.swap(last, other.min(last));
        }
    }

    /// Uniform over all rotations: Shoemake, "Uniform random rotations", Graphics Gems III.
    pub fn rotation(&mut self) -> DQuat {
        let radius = self.unit();
        let [first, second] = [self.unit(), self.unit()].map(|turn| sin_cos(TAU * turn));
        let (low, high) = ((1.0 - radius).sqrt(), radius.sqrt());
        DQuat::from_xyzw(
            low * first.0,
            low * first.1,
            high * second.0,
            high * second.1,
        )
        .normalize()
    }
}

/// Hashes four words to four: PCG4D of Jarzynski and Olano, "Hash Functions for GPU Rendering",
/// JCGT 9(3), 2020.
pub(crate) fn pcg4d(v: [u32; 4]) -> [u32; 4] {
    let [mut x, mut y, mut z, mut w] =
        v.map(|word| word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |x: &mut u32, y: &mut u32, z: &mut u32, w: &mut u32| {
        *x = x.wrapping_add(y.wrapping_mul(*w));
        *y = y.wrapping_add(z.wrapping_mul(*x));
        *z = z.wrapping_add(x.wrapping_mul(*y));
        *w = w.wrapping_add(y.wrapping_mul(*z));
    };
    mix(&mut x, &mut y, &mut z, &mut w);
    [x, y, z, w] = [x, y, z, w].map(|word| word ^ (word >> 16));
    mix(&mut x, &mut y, &mut z, &mut w);
    [x, y, z, w]
}

/// Domain of [`CounterRng::new`].
const DICE: u32 = 0x6469_6365;
