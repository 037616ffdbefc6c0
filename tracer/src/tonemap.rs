//! Radiance to display values.

/// 8-bit sRGB of `exposure · radiance`, clamped to [0, 1]: each channel through the sRGB transfer
/// function (IEC 61966-2-1) and rounded to nearest. What is negative or NaN is 0, +∞ is 255.
///
/// ```
/// use carom_tracer::tonemap::srgb8;
///
/// assert_eq!(srgb8([0.0, 0.214_041_14, 1.0], 1.0), [0, 128, 255]);
/// assert_eq!(srgb8([f32::NAN, f32::INFINITY, -1.0], 0.5), [0, 255, 0]);
/// ```
pub fn srgb8(radiance: [f32; 3], exposure: f32) -> [u8; 3] {
    // A float cast to an integer saturates, and makes NaN 0.
    radiance.map(|channel| (255.0 * srgb(exposure * channel) + 0.5) as u8)
}

/// The sRGB transfer function of a linear value, clamped to [0, 1].
fn srgb(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brighter_is_never_darker() {
        let grey = |step: u16| srgb8([f32::from(step) / 65_535.0; 3], 1.0)[0];
        assert!((1..=65_535).all(|step| grey(step - 1) <= grey(step)));
        assert_eq!((grey(0), grey(65_535)), (0, 255));
    }

    #[test]
    fn exposure_scales_radiance() {
        assert_eq!(srgb8([0.1, 0.2, 0.4], 2.0), srgb8([0.2, 0.4, 0.8], 1.0));
        assert_eq!(srgb8([0.0; 3], f32::INFINITY), [0; 3]);
    }
}
