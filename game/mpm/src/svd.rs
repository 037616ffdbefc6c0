//! Singular values and left singular vectors of 3x3 matrices, one matrix a SIMD lane.
//!
//! One-sided Jacobi rotations (Hestenes 1958; Demmel and Veselić 1992 on the accuracy of small singular
//! values) orthogonalise the columns of F·V.

use fearless_simd::prelude::*;

use crate::lanes::{Lanes, Mat3x, dot, each};

/// Principal directions and stretches of a deformation `F = U · diag(sigma) · Vᵀ`; the stress of isotropic
/// materials depends on these alone.
///
/// V is not computed: F·V has the same stress as F and is stored in its place. Its columns are orthogonal,
/// and still nearly so after the strain of the next substep, so that one or two sweeps suffice then.
pub(crate) struct Stretches<S: Simd> {
    /// `F · V`, which is `U · diag(sigma)`.
    pub(crate) deformation: Mat3x<S>,
    /// Left singular vectors as orthonormal columns, in no particular order; of determinant -1 if that of F
    /// is negative.
    pub(crate) u: Mat3x<S>,
    /// Singular values, at least 0, in the order of the columns of `u`.
    pub(crate) sigma: [Lanes<S>; 3],
}

/// Largest number of cyclic Jacobi sweeps: convergence is quadratic, and the sixth changes less than the
/// rounding of `f32` for every matrix of the tests.
const SWEEPS_MAX: usize = 6;

/// Cosine of the angle between two columns below which the sweep that rotates them is the last: the cosine
/// after it is of the order of its square.
const COSINE_LAST: f32 = 1e-4;

/// Stretch below which a column is too short to give a direction.
const SIGMA_MIN: f32 = 1e-18;

impl<S: Simd> Stretches<S> {
    /// Decomposes deformations. `u` is the identity in lanes where F is singular.
    #[inline(always)]
    pub(crate) fn new(simd: S, f: &Mat3x<S>) -> Self {
        let mut b = *f;
        // All lanes sweep until the last has converged; rotations of converged ones are near the identity.
        for _ in 0..SWEEPS_MAX {
            let mut is_last = true;
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                is_last &= jacobi(simd, &mut b, p, q);
            }
            if is_last {
                break;
            }
        }
        let sigma = each(
            #[inline(always)]
            |j| dot(b.column(j), b.column(j)).sqrt(),
        );
        let least = sigma[0].min(sigma[1]).min(sigma[2]);
        let is_flat = least.simd_lt(SIGMA_MIN);
        let one = Lanes::splat(simd, 1.0);
        let inverse = each(
            #[inline(always)]
            |j| one / sigma[j].max(SIGMA_MIN),
        );
        let (directions, axes) = (b.scale_columns(inverse), Mat3x::identity(simd));
        let u = Mat3x::from_fn(
            #[inline(always)]
            |i, j| is_flat.select(axes.0[i][j], directions.0[i][j]),
        );
        Self {
            deformation: b,
            u,
            sigma,
        }
    }

    /// The stretches, the least of them negated where F is inverted (determinant below 0). The columns of
    /// `u` are not negated: their signs cancel in the stress `U · diag · Uᵀ`.
    #[inline(always)]
    pub(crate) fn signed_sigma(&self) -> [Lanes<S>; 3] {
        let [a, b, c] = self.sigma;
        let is_inverted = self.u.determinant().simd_lt(0.0);
        let is_first = a.simd_le(b) & a.simd_le(c);
        let is_second = !is_first & b.simd_le(c);
        let is_third = !(is_first | is_second);
        [(a, is_first), (b, is_second), (c, is_third)].map(
            #[inline(always)]
            |(sigma, is_least)| (is_inverted & is_least).select(-sigma, sigma),
        )
    }
}

/// Applies the rotation that makes the columns p and q of `b` orthogonal, and returns whether they nearly
/// were in all lanes: Golub and Van Loan, "Matrix Computations", section 8.6.3.
///
/// The form with the tangent of half the angle preserves lengths under small rotations: a cosine of 1 −
/// θ²/2 would be rounded to 1, and columns would grow substep by substep (Rutishauser, "The Jacobi Method
/// for Real Symmetric Matrices", Numerische Mathematik 9, 1966).
#[inline(always)]
fn jacobi<S: Simd>(simd: S, b: &mut Mat3x<S>, p: usize, q: usize) -> bool {
    let (x, y) = (b.column(p), b.column(q));
    let (xx, yy, xy) = (dot(x, x), dot(y, y), dot(x, y));
    let bound = (xx * yy) * (COSINE_LAST * COSINE_LAST);
    let is_small = (xy * xy).simd_le(bound).all_true();
    let twice = xy * 2.0;
    let difference = yy - xx;
    let root = difference.mul_add(difference, twice * twice).sqrt();
    // tan θ is the smaller root of t² + 2 t (yy − xx)/(2 xy) − 1 = 0: |θ| ≤ 45°, which convergence requires.
    // MIN_POSITIVE makes it 0, not NaN, for columns of 0.
    let tangent = twice / (difference.abs() + root + f32::MIN_POSITIVE);
    let tangent = difference.simd_lt(0.0).select(-tangent, tangent);
    let one = Lanes::splat(simd, 1.0);
    let secant = tangent.mul_add(tangent, one).sqrt();
    let sine = tangent / secant;
    let half = tangent / (secant + 1.0);
    for row in &mut b.0 {
        let (x, y) = (row[p], row[q]);
        row[p] = x - sine * half.mul_add(x, y);
        row[q] = y + sine * (x - half * y);
    }
    is_small
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::{Mat3, Vec3};

    use super::*;
    use crate::lanes::LANES;

    type Entries = [[f32; LANES]; 9];

    #[inline(always)]
    fn decompose<S: Simd>(simd: S, f: &Entries) -> ([Entries; 2], [[f32; LANES]; 3]) {
        let parts = Stretches::new(simd, &Mat3x::load(simd, f));
        let mut out = [[[0.0; LANES]; 9]; 2];
        parts.deformation.store(&mut out[0]);
        parts.u.store(&mut out[1]);
        (out, parts.signed_sigma().map(Into::into))
    }

    fn lane(entries: &Entries, lane: usize) -> Mat3 {
        Mat3::from_cols_array(&std::array::from_fn(|i| entries[i][lane])).transpose()
    }

    fn largest(m: Mat3) -> f32 {
        m.to_cols_array()
            .iter()
            .fold(0.0, |max: f32, x| max.max(x.abs()))
    }

    /// Checks the law of the decomposition for 16 matrices.
    fn check(matrices: &[Mat3; LANES]) {
        let entries: Entries = std::array::from_fn(|i| {
            std::array::from_fn(|lane| matrices[lane].transpose().to_cols_array()[i])
        });
        let ([b, u], sigma) = dispatch!(Level::new(), simd => decompose(simd, &entries));
        for (i, f) in matrices.iter().enumerate() {
            let (b, u) = (lane(&b, i), lane(&u, i));
            let sigma = Vec3::from(sigma.map(|lanes| lanes[i]));
            let scale = largest(*f).max(1e-6);
            let of_strain = |m: Mat3| m * m.transpose();
            for stretched in [b, u * Mat3::from_diagonal(sigma)] {
                let error = largest(of_strain(stretched) - of_strain(*f)) / (scale * scale);
                let is_flat = sigma.abs().min_element() < SIGMA_MIN;
                assert!(is_flat || error < 8e-6, "{f} is wrong by {error:e}");
            }
            let error = largest(of_strain(u) - Mat3::IDENTITY);
            assert!(error < 1e-5, "{f}: not orthonormal by {error:e}");
            let (volume, expected) = (sigma.element_product(), f.determinant());
            let error = (volume - expected).abs() / scale.powi(3);
            assert!(error < 1e-5, "{f}: volume {volume}, not {expected}");
        }
    }

    /// Numbers from -1 to 1 by a linear congruential generator.
    fn numbers() -> impl FnMut() -> f32 {
        let mut state = 7_u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    #[test]
    fn random_matrices_are_decomposed() {
        let mut number = numbers();
        for power in [-3, 0, 3] {
            for _ in 0..500 {
                check(&std::array::from_fn(|_| {
                    Mat3::from_cols_array(&std::array::from_fn(|_| number() * 10_f32.powi(power)))
                }));
            }
        }
    }

    #[test]
    fn small_rotations_do_not_stretch() {
        // A shear to and fro of angles whose cosines f32 rounds to 1.
        #[inline(always)]
        fn sheared<S: Simd>(simd: S, times: usize) -> [[f32; LANES]; 3] {
            let mut f = Mat3x::identity(simd).scale_columns([1.0, 1.1, 0.9].map(
                #[inline(always)]
                |stretch| Lanes::splat(simd, stretch),
            ));
            for time in 0..times {
                let slope = if time % 2 == 0 { 1e-4 } else { -1e-4 };
                let moved = f.0[1].map(
                    #[inline(always)]
                    |x| x * slope,
                );
                for (x, moved) in f.0[0].iter_mut().zip(moved) {
                    *x += moved;
                }
                f = Stretches::new(simd, &f).deformation;
            }
            Stretches::new(simd, &f).sigma.map(Into::into)
        }
        let sigma = dispatch!(Level::new(), simd => sheared(simd, 100_000));
        let volume: f32 = sigma.iter().map(|lanes| lanes[0]).product();
        assert!((volume / 0.99 - 1.0).abs() < 1e-4, "{sigma:?}");
    }

    #[test]
    fn singular_and_inverted_matrices_are_decomposed() {
        let mut number = numbers();
        let diagonals = [
            [0.0, 0.0, 0.0],
            [1.0, 1.0, 1.0],
            [1.0, 1.0, -1.0],
            [-1.0, -1.0, -1.0],
            [2.0, 0.0, 0.0],
            [0.0, 0.0, 3.0],
            [1.0, 1e-4, 0.0],
            [0.5, -2.0, 1.0],
        ];
        for _ in 0..500 {
            check(&std::array::from_fn(|lane| {
                let axes = [0, 1].map(|_| {
                    let axis = glam::Vec3::new(number(), number(), number() + 1.001);
                    Mat3::from_axis_angle(axis.normalize(), 3.0 * number())
                });
                let diagonal = Mat3::from_diagonal(diagonals[lane % 8].into());
                if lane < 8 {
                    diagonal
                } else {
                    axes[0] * diagonal * axes[1]
                }
            }));
        }
    }
}
