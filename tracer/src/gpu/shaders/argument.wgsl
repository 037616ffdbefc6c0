// The argument of a complex number, in (−π, π], after `atanf` of Moshier's Cephes library, 1989.
// The built-in `atan2` may be wrong by 4096 ULP.
fn argument(z: vec2f) -> f32 {
    let low = min(abs(z.x), abs(z.y));
    // A normal number: GPUs may flush subnormal numbers to 0, and 0 / 0 would be NaN.
    let high = max(max(abs(z.x), abs(z.y)), 1.2e-38);
    // tan π/8: above it, the angle is computed relative to π/4, so that |t| stays in the range of
    // the short polynomial.
    let is_steep = low > high * 0.41421357;
    let t = select(low, low - high, is_steep) / select(high, low + high, is_steep);
    let t2 = t * t;
    let tail = ((8.0537445e-2 * t2 - 1.3877686e-1) * t2 + 1.9977711e-1) * t2 - 3.3332949e-1;
    var angle = t + t * t2 * tail + select(0.0, 0.25 * PI, is_steep);
    angle = select(angle, 0.5 * PI - angle, abs(z.y) > abs(z.x));
    angle = select(angle, PI - angle, z.x < 0.0);
    return select(angle, -angle, z.y < 0.0);
}
