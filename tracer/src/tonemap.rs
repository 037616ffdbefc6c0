//! Radiance to display values, the same on every machine: a tone curve, then the sRGB transfer function.
//!
//! Libraries differ in the last bit of `powf`, and then two nodes would differ by a step in the
//! same pixel. So the 255 thresholds between steps are constants: the least f32 that reaches each
//! step, computed by the compiler in f64. A test shows that none lies so near to the border
//! between two f32 that an error of 10⁻¹² would move it.

/// 8-bit sRGB of `exposure · radiance`: the tone curve, then each channel through the sRGB transfer
/// function (IEC 61966-2-1) and rounded to nearest. What is negative or NaN is 0, +∞ is 255.
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
    // ∞ over ∞ below would be NaN, which is black; the plain step makes of it 255.
    if peak > SHOULDER && peak.is_finite() {
        return shoulder([r, g, b], peak).map(step);
    }
    [r, g, b].map(step)
}

/// The compression of "Khronos PBR Neutral" (Khronos Group, ToneMapping, 2024), which scales the three
/// channels alike, so that hue stays, and mixes in white as the peak rises far beyond 1. Its toe is left
/// out: that takes from black what a rasteriser's constant Fresnel term has added, which a path tracer
/// never adds. It needs no function that libraries round differently.
#[inline]
fn shoulder(rgb: [f32; 3], peak: f32) -> [f32; 3] {
    const RANGE: f32 = 1.0 - SHOULDER;
    let shown = 1.0 - RANGE * RANGE / (peak + (RANGE - SHOULDER));
    let white = 1.0 - 1.0 / (DESATURATION * (peak - shown) + 1.0);
    let scale = shown / peak;
    // A negative channel is none: mixed with white it must not brighten less than black does.
    rgb.map(|channel| {
        let channel = channel.max(0.0) * scale;
        channel + white * (shown - channel)
    })
}

/// What is darker is shown as it is.
pub(crate) const SHOULDER: f32 = 0.7;
pub(crate) const DESATURATION: f32 = 0.15;

/// The linear light that an 8-bit sRGB step shows, 0 to 1.
#[inline]
pub fn linear(step: u8) -> f32 {
    SRGB_LINEAR[step as usize]
}

/// The linear share of light of each sRGB byte (IEC 61966-2-1).
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

/// The sRGB step of linear light. A bucket holds the 2¹⁶ floats that share their upper 16 bits:
/// at most one threshold lies among them. Its entry is `step << 16` for the bucket's first float,
/// plus what makes the sum with the lower bits carry into the step from the threshold on.
#[inline]
fn step(x: f32) -> u8 {
    #[expect(clippy::manual_clamp, reason = "`max` turns NaN into the lower bound")]
    let bits = x.max(X_MIN).min(X_MAX).to_bits();
    let bucket = (bits >> 16) - FIRST_BUCKET;
    ((STEPS[bucket as usize % BUCKETS] + (bits & 0xffff)) >> 16) as u8
}

/// Below the first threshold, 1.5e-4.
pub(crate) const X_MIN: f32 = 1.0 / 8192.0;
/// The greatest f32 below 1.
pub(crate) const X_MAX: f32 = 1.0 - f32::EPSILON / 2.0;
pub(crate) const FIRST_BUCKET: u32 = X_MIN.to_bits() >> 16;
/// 13 octaves of 128 buckets, rounded up to a power of two so that an index needs no check.
pub(crate) const BUCKETS: usize = 2048;

pub(crate) static STEPS: [u32; BUCKETS] = steps();

const fn steps() -> [u32; BUCKETS] {
    let mut steps = [0; BUCKETS];
    let mut step = 0;
    let mut next = threshold(1).to_bits();
    let mut bucket = 0;
    while bucket < BUCKETS {
        let first = (FIRST_BUCKET + bucket as u32) << 16;
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

/// The least f32 whose sRGB value rounds to at least `step`.
const fn threshold(step: u32) -> f32 {
    let exact = linear_from_srgb((step as f64 - 0.5) / 255.0);
    let nearest = exact as f32;
    if (nearest as f64) < exact {
        nearest.next_up()
    } else {
        nearest
    }
}

/// The linear share of light of a share of sRGB (IEC 61966-2-1), both from 0 to 1.
pub(crate) const fn linear_from_srgb(y: f64) -> f64 {
    if y <= 0.040_45 {
        return y / 12.92;
    }
    let t = (y + 0.055) / 1.055;
    t * t * fifth_root(t * t) // t to the power of 2.4
}

/// Newton's method from above, where it falls until rounding stops it; for `a` in (0, 2).
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
        // Orange light: its channels stay in order and in proportion up to a little white.
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
