//! SplitMix64, a seeded random number generator (Steele, Lea and Flood, OOPSLA 2014).

use std::f64::consts::TAU;

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct SplitMix64(u64);

impl SplitMix64 {
    /// The stream that begins with `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The stream that belongs to `key`.
    pub fn keyed(key: &[u64]) -> Self {
        let mut random = Self(0);
        for word in key {
            random.0 ^= *word;
            random.0 = random.word();
        }
        random
    }

    /// The next 64 uniformly distributed bits.
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = self.0;
        word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        word ^ (word >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        // The upper 53 bits, as many as the significand of an f64 has.
        (self.word() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in 0 … `below` − 1, up to a bias of `below` / 2⁶⁴.
    pub fn below(&mut self, below: u64) -> u64 {
        self.word() % below.max(1)
    }

    /// Exponentially distributed with mean 1.
    pub fn exponential(&mut self) -> f64 {
        -(1.0 - self.uniform()).ln()
    }

    /// Normally distributed with mean 0 and deviation 1 (Box and Muller, 1958).
    pub fn normal(&mut self) -> f64 {
        (2.0 * self.exponential()).sqrt() * (TAU * self.uniform()).cos()
    }
}
