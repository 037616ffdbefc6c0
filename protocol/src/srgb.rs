//! Linear light to the screen's eight bits, the same on every machine.
//!
//! [`from_linear`] rounds `255 · OETF(x)` (IEC 61966-2-1) to the nearest step. Libraries differ in
//! the last bit of `powf`, and then two nodes would differ by a step in the same pixel. So the
//! 255 thresholds between steps are computed once, in f64, as the least f32 that reaches each
//! step; a test shows that no threshold is so near to the border between two f32 that an error of
//! 10⁻¹² would move it. After that there is only integer arithmetic.

use std::sync::LazyLock;

/// The sRGB step, 0 to 255, of linear light `x` clamped to [0, 1]; NaN is 0.
#[inline]
pub fn from_linear(x: f32) -> u8 {
    step(&STEPS, x)
}

/// The sRGB steps of `exposure · radiance`, channel by channel.
#[inline]
pub fn from_radiance(radiance: [f32; 3], exposure: f32) -> [u8; 3] {
    radiance.map(|channel| from_linear(exposure * channel))
}

/// A conversion with its table at hand, for loops over many pixels.
#[derive(Clone, Copy)]
pub(crate) struct Converter {
    steps: &'static [u32; BUCKETS],
    exposure: f32,
}

impl Converter {
    pub(crate) fn new(exposure: f32) -> Self {
        let steps = &*STEPS;
        Self { steps, exposure }
    }

    #[inline(always)]
    pub(crate) fn convert(self, radiance: [f32; 3]) -> [u8; 3] {
        radiance.map(|channel| step(self.steps, self.exposure * channel))
    }
}

/// A bucket holds the 2¹⁶ floats that share their upper 16 bits: at most one threshold lies among
/// them. Its entry is `step << 16` for the bucket's first float, plus what makes the sum with the
/// lower bits carry into the step from the threshold on.
#[inline(always)]
fn step(steps: &[u32; BUCKETS], x: f32) -> u8 {
    #[expect(clippy::manual_clamp, reason = "`max` turns NaN into the lower bound")]
    let bits = x.max(X_MIN).min(X_MAX).to_bits();
    let bucket = (bits >> 16) - FIRST_BUCKET;
    ((steps[bucket as usize % BUCKETS] + (bits & 0xffff)) >> 16) as u8
}

/// Below the first threshold, 1.5e-4.
const X_MIN: f32 = 1.0 / 8192.0;
/// The greatest f32 below 1.
const X_MAX: f32 = 1.0 - f32::EPSILON / 2.0;
const FIRST_BUCKET: u32 = X_MIN.to_bits() >> 16;
/// 13 octaves of 128 buckets, rounded up to a power of two so that an index needs no check.
const BUCKETS: usize = 2048;

static STEPS: LazyLock<[u32; BUCKETS]> = LazyLock::new(|| {
    let thresholds: Vec<u32> = (1..=255).map(|step| threshold(step).to_bits()).collect();
    std::array::from_fn(|bucket| {
        let first = (FIRST_BUCKET + bucket as u32) << 16;
        let step = thresholds.partition_point(|&bits| bits <= first);
        let carry = match thresholds.get(step) {
            Some(bits) if bits >> 16 == first >> 16 => 0x1_0000 - (bits & 0xffff),
            _ => 0,
        };
        ((step as u32) << 16) + carry
    })
});

/// The least f32 whose sRGB value rounds to at least `step`.
fn threshold(step: u32) -> f32 {
    let exact = linear_from_srgb((f64::from(step) - 0.5) / 255.0);
    let nearest = exact as f32;
    if f64::from(nearest) < exact {
        nearest.next_up()
    } else {
        nearest
    }
}

fn linear_from_srgb(y: f64) -> f64 {
    if y <= 0.040_45 {
        y / 12.92
    } else {
        ((y + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_definition(x: f32) -> u8 {
        let x = f64::from(x).clamp(0.0, 1.0);
        let y = if x <= 0.003_130_8 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        };
        (255.0 * y).round() as u8
    }

    #[test]
    fn agrees_with_the_definition_on_both_sides_of_each_threshold() {
        for step in 1..=255 {
            let x = threshold(step);
            assert_eq!(u32::from(from_linear(x)), step);
            assert_eq!(u32::from(from_linear(x.next_down())), step - 1);
            assert_eq!(u32::from(by_definition(x.next_up())), step);
            assert_eq!(u32::from(by_definition(x.next_down())), step - 1);
        }
    }

    #[test]
    fn agrees_with_the_definition_all_over_the_range() {
        for bits in (0..1.5f32.to_bits()).step_by(1009) {
            let x = f32::from_bits(bits);
            assert_eq!(from_linear(x), by_definition(x), "{x}");
        }
    }

    #[test]
    fn no_threshold_depends_on_the_last_bits_of_powf() {
        for step in 1..=255 {
            let exact = linear_from_srgb((f64::from(step) - 0.5) / 255.0);
            let x = threshold(step);
            for border in [x, x.next_down()] {
                let distance = (f64::from(border) - exact).abs() / exact;
                assert!(distance > 1e-12, "step {step}: {distance}");
            }
        }
    }

    #[test]
    fn what_is_no_light_is_black_and_too_much_is_white() {
        for x in [
            f32::NAN,
            -f32::NAN,
            f32::NEG_INFINITY,
            -1.0,
            -0.0,
            0.0,
            1e-40,
        ] {
            assert_eq!(from_linear(x), 0, "{x}");
        }
        for x in [1.0, 1.0f32.next_down(), 2.0, f32::MAX, f32::INFINITY] {
            assert_eq!(from_linear(x), 255, "{x}");
        }
    }
}
