//! What a number is a difference from, a plane at a time; all sums are modulo 256.

/// The value that stands to `green` as `base` to `base_green`. In f32, as processors divide four
/// and more of them at once: the product is exact and the quotient rounded, so that all agree.
#[inline(always)]
pub(crate) fn in_ratio(green: u8, base_green: u8, base: u8) -> u8 {
    /// Added to a number below 2²², it leaves the nearest integer in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let product = f32::from(green) * f32::from(base);
    let value = product / f32::from(base_green.max(1));
    (value.min(255.0) + ROUND).to_bits() as u8
}

#[inline(always)]
pub(crate) fn predict(out: &mut [u8], green: &[u8], base_green: &[u8], base: &[u8]) {
    for (((out, green), base_green), base) in out.iter_mut().zip(green).zip(base_green).zip(base) {
        *out = in_ratio(*green, *base_green, *base);
    }
}

#[inline(always)]
pub(crate) fn minus(out: &mut [u8], a: &[u8], b: &[u8]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a.wrapping_sub(*b);
    }
}

#[inline(always)]
pub(crate) fn minus_neighbour(out: &mut [u8], value: &[u8], width: usize) {
    let mut above = 0;
    for (out, row) in out.chunks_mut(width).zip(value.chunks(width)) {
        out[0] = row[0].wrapping_sub(above);
        above = row[0];
        minus(&mut out[1..], &row[1..], row);
    }
}

#[inline(always)]
pub(crate) fn plus(out: &mut [u8], a: &[u8], b: &[u8]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a.wrapping_add(*b);
    }
}

#[inline(always)]
pub(crate) fn plus_neighbours(out: &mut [u8], number: &[u8], width: usize) {
    let mut above = 0;
    for (out, row) in out.chunks_mut(width).zip(number.chunks(width)) {
        let mut left = above;
        for (out, number) in out.iter_mut().zip(row) {
            left = number.wrapping_add(left);
            *out = left;
        }
        above = out[0];
    }
}

#[inline(always)]
pub(crate) fn add(out: &mut [u8], number: &[u8]) {
    for (out, number) in out.iter_mut().zip(number) {
        *out = out.wrapping_add(*number);
    }
}

/// `value - out`.
#[inline(always)]
pub(crate) fn subtract_from(out: &mut [u8], value: &[u8]) {
    for (out, value) in out.iter_mut().zip(value) {
        *out = value.wrapping_sub(*out);
    }
}

#[inline(always)]
pub(crate) fn sized(plane: &mut Vec<u8>, length: usize) -> &mut [u8] {
    plane.resize(length, 0);
    plane
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_rounds_to_the_nearest_and_keeps_what_has_not_changed() {
        for (green, base_green, base) in
            (0..=255).flat_map(|a| [(a, 7, 200), (91, a, 33), (3, 250, a)])
        {
            let exact = f64::from(green) * f64::from(base) / f64::from(base_green.max(1));
            let ratio = f64::from(in_ratio(green, base_green, base));
            assert!(
                (ratio - exact.min(255.0)).abs() <= 0.5001,
                "{green} {base_green} {base}"
            );
        }
        for (green, base) in (1..=255).flat_map(|green| (0..=255).map(move |base| (green, base))) {
            assert_eq!(in_ratio(green, green, base), base);
        }
    }
}
