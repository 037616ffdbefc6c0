//! Random numbers as a hash of where they are used, and warps from the unit square with their pdf.
//!
//! A number depends on (pixel, sample, block, seed) alone, so the picture does not depend on who
//! traced which tile. The same integer arithmetic runs in the reference, in SIMD and in WGSL.

/// Hashes four words to four: PCG4D of Jarzynski and Olano, "Hash Functions for GPU Rendering",
/// JCGT 9(3), 2020.
#[inline]
pub fn pcg4d(v: [u32; 4]) -> [u32; 4] {
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

/// The first argument of [`uniforms`] for a pixel: coordinates are below 2¹⁶.
#[inline]
pub fn pixel_key(x: u32, y: u32) -> u32 {
    (y << 16) | x
}

/// Four numbers in [0, 1), multiples of 2⁻²⁴, for one block of a path's dimensions.
#[inline]
pub fn uniforms(pixel: u32, sample: u32, block: u32, seed: u32) -> [f32; 4] {
    pcg4d([pixel, sample, block, seed]).map(unit_float)
}

/// The upper 24 bits as a number in [0, 1).
#[inline]
pub fn unit_float(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Block of the camera ray: position in the pixel (x, y); two are spare.
pub const BLOCK_CAMERA: u32 = 0;

/// Block of the `bounce`-th scattering, counted from 0: lobe choice, direction (2); one is spare.
#[inline]
pub const fn block_scatter(bounce: u32) -> u32 {
    1 + 2 * bounce
}

/// Block of next-event estimation at that scattering: lamp choice, point on it (2); one is spare.
#[inline]
pub const fn block_light(bounce: u32) -> u32 {
    2 + 2 * bounce
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniforms_fill_the_unit_interval_evenly() {
        let mut bins = [[0u32; 16]; 4];
        for sample in 0..65_536 {
            for (bins, u) in bins
                .iter_mut()
                .zip(uniforms(pixel_key(17, 5), sample, 3, 9))
            {
                assert!((0.0..1.0).contains(&u));
                bins[(u * 16.0) as usize] += 1;
            }
        }
        // Each bin holds 4096 ± 5 standard deviations of a binomial law.
        assert!(
            bins.iter().flatten().all(|&n| n.abs_diff(4096) < 310),
            "{bins:?}"
        );
    }

    #[test]
    fn neighbouring_keys_are_uncorrelated() {
        let mean_product = |a: fn(u32) -> f32, b: fn(u32) -> f32| {
            (0..100_000)
                .map(|i| f64::from((a(i) - 0.5) * (b(i) - 0.5)))
                .sum::<f64>()
                / 1e5
        };
        let base = |i| uniforms(pixel_key(i % 300, i / 300), 7, 1, 0)[0];
        for other in [
            |i| uniforms(pixel_key(i % 300 + 1, i / 300), 7, 1, 0)[0],
            |i| uniforms(pixel_key(i % 300, i / 300), 8, 1, 0)[0],
            |i| uniforms(pixel_key(i % 300, i / 300), 7, 2, 0)[0],
            |i| uniforms(pixel_key(i % 300, i / 300), 7, 1, 1)[0],
            |i| uniforms(pixel_key(i % 300, i / 300), 7, 1, 0)[1],
        ] {
            // The product of two independent centred uniforms has deviation 1/12 / √n = 2.6e-4.
            assert!(mean_product(base, other).abs() < 1.3e-3);
        }
    }
}
