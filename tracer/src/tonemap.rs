//! Tone mapping from radiance to display values, identical on all machines: a tone curve, then the
//! sRGB transfer function.
//!
//! Implementations of `powf` differ in the last bit, which would make two nodes differ by a level
//! in the same pixel. So the 255 thresholds between levels are constants: the smallest f32 that
//! reaches each level, computed by the compiler in f64. A test shows that no threshold lies so near
//! the border between two f32 values that an error of 10⁻¹² would move it.

/// 8-bit sRGB of `exposure · radiance`: applies the tone curve, then to each channel the sRGB
/// transfer function (IEC 61966-2-1), and rounds to nearest. Negative values and NaN become 0, +∞
/// becomes 255.
///
/// ```
/// use carom_tracer::tonemap::srgb8;
///
/// assert_eq!(srgb8([0.0, 0.214_041_14, 0.6], 1.0), [0, 128, 203]);
/// assert_eq!(srgb8([1.0; 3], 1.0), [237; 3]);
/// assert_eq!(srgb8([f32::NAN, f32::INFINITY, -1.0], 0.5), [0, 255, 0]);
/// ```
#[inline]
pub fn srgb8(radiance: [f32; 3], exposure: f32) -> [u8; 3] {
    let [r, g, b] = radiance.map(|channel| exposure * channel);
    let peak = r.max(g).max(b);
    // An infinite peak would give ∞/∞ = NaN, which is black; `step` maps ∞ to 255.
    if peak > SHOULDER && peak.is_finite() {
        return shoulder([r, g, b], peak).map(step);
    }
    [r, g, b].map(step)
}

/// The highlight compression of "Khronos PBR Neutral" (Khronos Group, ToneMapping, 2024). It scales
/// the three channels equally, which preserves hue, and mixes in white as the peak goes far
/// beyond 1. The toe is omitted: it subtracts the constant Fresnel term that rasterisers add to black, and
/// that a path tracer does not have. Only exactly rounded operations are needed.
#[inline]
fn shoulder(rgb: [f32; 3], peak: f32) -> [f32; 3] {
    const RANGE: f32 = 1.0 - SHOULDER;
    let shown = 1.0 - RANGE * RANGE / (peak + (RANGE - SHOULDER));
    let white = 1.0 - 1.0 / (DESATURATION * (peak - shown) + 1.0);
    let scale = shown / peak;
    // A negative channel counts as 0, so that mixing it with white does not leave it darker than
    // black would be.
    rgb.map(|channel| {
        let channel = channel.max(0.0) * scale;
        channel + white * (shown - channel)
    })
}

/// Peak value up to which radiance is not compressed.
pub(crate) const SHOULDER: f32 = 0.7;
pub(crate) const DESATURATION: f32 = 0.15;

/// Linear light, 0 to 1, of an 8-bit sRGB level.
#[inline]
pub fn linear(step: u8) -> f32 {
    SRGB_LINEAR[step as usize]
}

/// Linear light, 0 to 1, of each 8-bit sRGB level (IEC 61966-2-1).
pub(crate) static SRGB_LINEAR: [f32; 256] = light();

const fn light() -> [f32; 256] {
    let mut light = [0.0; 256];
    let mut step = 0;
    while step < 256 {
        light[step] = linear_from_srgb(step as f64 / 255.0) as f32;
        step += 1;
    }
    light
}

/// The 8-bit sRGB level of linear light. The table has one entry for each bucket of 2¹⁶ floats that
/// share their upper 16 bits, among which there is at most one threshold. An entry is `level << 16`
/// for the bucket's first float, plus an offset with which the lower 16 bits carry into the level
/// from the threshold on.
#[inline]
fn step(x: f32) -> u8 {
    #[expect(clippy::manual_clamp, reason = "`max` turns NaN into the lower bound")]
    let bits = x.max(X_MIN).min(X_MAX).to_bits();
    let bucket = (bits >> 16) - FIRST_BUCKET;
    ((STEPS[bucket as usize % BUCKETS] + (bits & 0xffff)) >> 16) as u8
}

/// A value below the first threshold, 1.5e-4.
pub(crate) const X_MIN: f32 = 1.0 / 8192.0;
/// The largest f32 below 1.
pub(crate) const X_MAX: f32 = 1.0 - f32::EPSILON / 2.0;
pub(crate) const FIRST_BUCKET: u32 = X_MIN.to_bits() >> 16;
/// 13 octaves of 128 buckets, rounded up to a power of two so that a modulo replaces the bounds
/// check.
pub(crate) const BUCKETS: usize = 2048;

pub(crate) static STEPS: [u32; BUCKETS] = steps();

const fn steps() -> [u32; BUCKETS] {
    let mut steps = [0; BUCKETS];
    let mut step = 0;
    let mut next = threshold(1).to_bits();
    let mut bucket = 0;
    while bucket < BUCKETS {
        let first = (FIRST_BUCKET + bucket as u32) << 16;
        // A threshold at a bucket's first float changes the entry itself; one inside it is the
        // carry below.
        if next <= first && step < 255 {
            step += 1;
            next = threshold(step + 1).to_bits();
        }
        steps[bucket] = step << 16;
        if next >> 16 == first >> 16 && next > first && step < 255 {
            steps[bucket] += 0x1_0000 - (next & 0xffff);
            step += 1;
            next = threshold(step + 1).to_bits();
        }
        bucket += 1;
    }
    steps
}

/// The smallest f32 whose sRGB value rounds to at least `step`.
const fn threshold(step: u32) -> f32 {
    let exact = linear_from_srgb((step as f64 - 0.5) / 255.0);
    let nearest = exact as f32;
    if (nearest as f64) < exact {
        nearest.next_up()
    } else {
        nearest
    }
}

/// Linear light of an sRGB value (IEC 61966-2-1), both from 0 to 1.
pub(crate) const fn linear_from_srgb(y: f64) -> f64 {
    if y <= 0.040_45 {
        return y / 12.92;
    }
    let t = (y + 0.055) / 1.055;
    t * t * fifth_root(t * t) // t to the power of 2.4
}

/// Fifth root of `a` in (0, 2) by Newton's method: starting above the root, iterates decrease until
/// rounding stops them. Usable in `const`, unlike `powf`.
const fn fifth_root(a: f64) -> f64 {
    let mut root = 2.0;
    loop {
        let next = root - (root - a / (root * root * root * root)) / 5.0;
        if next >= root {
            return root;
        }
        root = next;
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
    fn srgb_is_exact_on_both_sides_of_thresholds() {
        for s in 1..=255 {
            let x = threshold(s);
            assert_eq!(u32::from(step(x)), s);
            assert_eq!(u32::from(step(x.next_down())), s - 1);
            assert_eq!(u32::from(by_definition(x.next_up())), s);
            assert_eq!(u32::from(by_definition(x.next_down())), s - 1);
        }
    }

    #[test]
    fn each_step_shows_light_that_is_that_step() {
        for s in 0..=255 {
            assert_eq!(step(linear(s)), s);
        }
        assert_eq!((linear(0), linear(255)), (0.0, 1.0));
    }

    #[test]
    fn srgb_equals_its_definition() {
        for bits in (0..1.5f32.to_bits()).step_by(1009) {
            let x = f32::from_bits(bits);
            assert_eq!(step(x), by_definition(x), "{x}");
        }
    }

    #[test]
    fn srgb_thresholds_do_not_depend_on_rounding() {
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
    fn tone_map_clamps_to_black_and_white() {
        for x in [
            f32::NAN,
            -f32::NAN,
            f32::NEG_INFINITY,
            -1.0,
            -0.0,
            0.0,
            1e-40,
        ] {
            assert_eq!(step(x), 0, "{x}");
        }
        for x in [1.0, 1.0f32.next_down(), 2.0, f32::MAX, f32::INFINITY] {
            assert_eq!(step(x), 255, "{x}");
        }
    }

    #[test]
    fn brighter_is_never_darker() {
        let grey = |step: u16| srgb8([f32::from(step) / 65_535.0; 3], 1.0)[0];
        assert!((1..=65_535).all(|step| grey(step - 1) <= grey(step)));
        assert_eq!((grey(0), grey(65_535)), (0, 237));
        let bright = |step: u16| srgb8([1.1f32.powi(i32::from(step)); 3], 1.0)[0];
        assert!((1..=900).all(|step| bright(step - 1) <= bright(step)));
        assert_eq!(bright(900), 255);
    }

    #[test]
    fn the_shoulder_keeps_hue_and_ends_in_white() {
        // Orange light: the order and proportions of its channels are preserved except for a little
        // white.
        for exposure in [0.5, 1.0, 2.0, 4.0] {
            let shown = srgb8([0.9, 0.45, 0.09], exposure).map(linear);
            assert!(shown[0] > shown[1] && shown[1] > shown[2], "{shown:?}");
            let white = shown[2] - 0.1 * shown[0];
            let half = (shown[1] - white) / (shown[0] - white);
            assert!((half - 0.5).abs() < 0.03, "{shown:?}");
        }
        assert_eq!(srgb8([1e6, 5e5, 1e5], 1.0), [255; 3]);
        assert_eq!(srgb8([f32::MAX; 3], 1.0), [255; 3]);
    }

    #[test]
    fn exposure_scales_radiance() {
        assert_eq!(srgb8([0.1, 0.2, 0.4], 2.0), srgb8([0.2, 0.4, 0.8], 1.0));
        assert_eq!(srgb8([0.0; 3], f32::INFINITY), [0; 3]);
    }
}
