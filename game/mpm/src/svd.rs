//! Singular value decomposition of 3x3 matrices, a matrix a lane.
//!
//! One-sided Jacobi (Hestenes 1958; Demmel and Veselić 1992 on its accuracy for small singular
//! values) makes the columns of F·V orthogonal; Givens rotations then give F·V = U·Σ, with the
//! order and signs of McAdams et al. 2011, "Computing the Singular Value Decomposition of 3x3
//! matrices with minimal branching and elementary floating point operations".

use fearless_simd::prelude::*;

use crate::lanes::{Lanes, Mat3x, dot, each};

/// `F = U · diag(sigma) · Vᵀ`. U and V are rotations, so that the sign of det F is that of the
/// last singular value, the smallest in magnitude; the first two are not negative.
pub(crate) struct Svd<S: Simd> {
    pub(crate) u: Mat3x<S>,
    pub(crate) sigma: [Lanes<S>; 3],
    pub(crate) v: Mat3x<S>,
}

/// Cyclic sweeps of Jacobi's method: it converges quadratically, and the sixth is below the
/// rounding of f32 for every matrix of the tests.
const SWEEPS_MAX: usize = 6;

/// Cosine of the angle of two columns below which the sweep that rotates them is the last: what it
/// leaves is of the order of the square.
const COSINE_LAST: f32 = 1e-4;

/// Decomposes a matrix.
#[inline(always)]
pub(crate) fn svd<S: Simd>(simd: S, f: &Mat3x<S>) -> Svd<S> {
    let mut b = *f;
    let mut v = Mat3x::identity(simd);
    for _ in 0..SWEEPS_MAX {
        let mut is_last = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            is_last &= jacobi(simd, &mut b, &mut v, p, q);
        }
        if is_last {
            break;
        }
    }
    sort_columns(&mut b, &mut v);
    let mut u = Mat3x::identity(simd);
    for (p, q, column) in [(0, 1, 0), (0, 2, 0), (1, 2, 1)] {
        rotate_rows(simd, &mut b, &mut u, (p, q, column));
    }
    let sigma = [b.0[0][0], b.0[1][1], b.0[2][2]];
    Svd { u, sigma, v }
}

/// One rotation that makes the columns p and q of `b` orthogonal, and whether they were nearly:
/// Golub and Van Loan, "Matrix Computations", section 8.6.3.
#[inline(always)]
fn jacobi<S: Simd>(simd: S, b: &mut Mat3x<S>, v: &mut Mat3x<S>, p: usize, q: usize) -> bool {
    let (x, y) = (b.column(p), b.column(q));
    let (xx, yy, xy) = (dot(x, x), dot(y, y), dot(x, y));
    let bound = (xx * yy) * (COSINE_LAST * COSINE_LAST);
    let is_small = (xy * xy).simd_le(bound).all_true();
    let twice = xy * 2.0;
    let difference = yy - xx;
    let root = difference.mul_add(difference, twice * twice).sqrt();
    let tangent = twice / (difference.abs() + root + f32::MIN_POSITIVE);
    let tangent = difference.simd_lt(0.0).select(-tangent, tangent);
    let one = Lanes::splat(simd, 1.0);
    let cosine = one / tangent.mul_add(tangent, one).sqrt();
    let sine = tangent * cosine;
    for matrix in [b, v] {
        for row in &mut matrix.0 {
            let (x, y) = (row[p], row[q]);
            row[p] = cosine * x - sine * y;
            row[q] = sine * x + cosine * y;
        }
    }
    is_small
}

/// Orders the columns of `b` by falling length, and those of `v` alike; a swap negates one of the
/// two columns, which keeps `v` a rotation.
#[inline(always)]
fn sort_columns<S: Simd>(b: &mut Mat3x<S>, v: &mut Mat3x<S>) {
    let mut squares = each(
        #[inline(always)]
        |j| dot(b.column(j), b.column(j)),
    );
    for (p, q) in [(0, 1), (0, 2), (1, 2)] {
        let swap = squares[p].simd_lt(squares[q]);
        let (a, c) = (squares[p], squares[q]);
        squares[p] = swap.select(c, a);
        squares[q] = swap.select(a, c);
        for matrix in [&mut *b, &mut *v] {
            for row in &mut matrix.0 {
                let (a, c) = (row[p], row[q]);
                row[p] = swap.select(c, a);
                row[q] = swap.select(-a, c);
            }
        }
    }
}

/// One Givens rotation of the rows p and q that makes the entry (q, column) of `b` zero.
#[inline(always)]
fn rotate_rows<S: Simd>(
    simd: S,
    b: &mut Mat3x<S>,
    u: &mut Mat3x<S>,
    (p, q, column): (usize, usize, usize),
) {
    let (x, y) = (b.0[p][column], b.0[q][column]);
    let length = x.mul_add(x, y * y).sqrt();
    let is_tiny = length.simd_lt(1e-18);
    let one = Lanes::splat(simd, 1.0);
    let inverse = one / is_tiny.select(one, length);
    let cosine = is_tiny.select(one, x * inverse);
    let sine = is_tiny.select(Lanes::splat(simd, 0.0), y * inverse);
    for j in 0..3 {
        let (x, y) = (b.0[p][j], b.0[q][j]);
        b.0[p][j] = cosine * x + sine * y;
        b.0[q][j] = cosine * y - sine * x;
        let (x, y) = (u.0[j][p], u.0[j][q]);
        u.0[j][p] = cosine * x + sine * y;
        u.0[j][q] = cosine * y - sine * x;
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::Mat3;

    use super::*;
    use crate::lanes::LANES;

    type Entries = [[f32; LANES]; 9];

    #[inline(always)]
    fn decompose<S: Simd>(simd: S, f: &Entries) -> [Entries; 3] {
        let parts = svd(simd, &Mat3x::load(simd, f));
        let mut out = [[[0.0; LANES]; 9]; 3];
        parts.u.store(&mut out[0]);
        Mat3x::identity(simd)
            .scale_columns(parts.sigma)
            .store(&mut out[1]);
        parts.v.store(&mut out[2]);
        out
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
        let [u, sigma, v] = dispatch!(Level::new(), simd => decompose(simd, &entries));
        for (i, f) in matrices.iter().enumerate() {
            let (u, sigma, v) = (lane(&u, i), lane(&sigma, i), lane(&v, i));
            let scale = largest(*f).max(1e-6);
            let error = largest(u * sigma * v.transpose() - *f) / scale;
            assert!(error < 4e-6, "{f} is wrong by {error:e}");
            for rotation in [u, v] {
                assert!(
                    (rotation.determinant() - 1.0).abs() < 1e-5,
                    "{f}: {rotation}"
                );
                let error = largest(rotation * rotation.transpose() - Mat3::IDENTITY);
                assert!(error < 4e-6, "{f}: not a rotation by {error:e}");
            }
            let [a, b, c] = [sigma.x_axis.x, sigma.y_axis.y, sigma.z_axis.z];
            assert!(
                a >= b - 1e-5 * scale && b >= c.abs() - 1e-5 * scale,
                "{f}: {a} {b} {c}"
            );
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
