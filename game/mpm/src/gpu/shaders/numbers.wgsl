// Exponential and logarithm within 2e-7, the same as in `lanes.rs`: WGSL guarantees less for the built-in
// ones.

// eˣ with x clamped to -87..=88.
fn exponential(value: f32) -> f32 {
    let x = clamp(value, -87.0, 88.0);
    let exponent = round(x * 1.44269504);
    // rest = x − exponent · ln 2 (Cody and Waite): the first part of ln 2 has few bits, so that its product
    // is exact.
    let rest = fma(exponent, 2.1219444e-4, fma(exponent, -0.6933594, x));
    var series = 1.0 / 5040.0;
    series = fma(series, rest, 1.0 / 720.0);
    series = fma(series, rest, 1.0 / 120.0);
    series = fma(series, rest, 1.0 / 24.0);
    series = fma(series, rest, 1.0 / 6.0);
    series = fma(series, rest, 0.5);
    series = fma(series, rest, 1.0);
    series = fma(series, rest, 1.0);
    return series * bitcast<f32>((i32(exponent) + 127) << 23u);
}

// Natural logarithm of positive normal numbers, by ln m = 2 artanh((m − 1)/(m + 1)).
fn logarithm(x: f32) -> f32 {
    let bits = bitcast<i32>(x);
    // Subtracting the bits of √½ gives mantissas from √½ to √2, where the series converges fast.
    let exponent = (bits - 0x3f3504f3) >> 23u;
    let mantissa = bitcast<f32>(bits - (exponent << 23u));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let square = s * s;
    var series = 2.0 / 9.0;
    series = fma(series, square, 2.0 / 7.0);
    series = fma(series, square, 2.0 / 5.0);
    series = fma(series, square, 2.0 / 3.0);
    series = fma(series, square, 2.0);
    return fma(f32(exponent), 0.69314718, series * s);
}
