//! SIMD types of the width at which all kernels of this back end work, and vectors of three of them.

use std::ops::{Add, Mul, Neg, Sub};

use fearless_simd::{f32x16, mask32x16, prelude::*, u32x16};

/// Lanes per kernel step: twice the registers of AVX2, so that two independent dependency chains
/// hide each other's latency (95 against 73 Mray/s with 8 lanes).
pub(super) const LANES: usize = 16;

pub(super) type Float<S> = f32x16<S>;
pub(super) type Word<S> = u32x16<S>;
pub(super) type Mask<S> = mask32x16<S>;

/// A point, direction or colour per lane.
#[derive(Clone, Copy)]
pub(super) struct Vec3x<S: Simd> {
    pub(super) x: Float<S>,
    pub(super) y: Float<S>,
    pub(super) z: Float<S>,
}

impl<S: Simd> Vec3x<S> {
    #[inline(always)]
    pub(super) fn new(x: Float<S>, y: Float<S>, z: Float<S>) -> Self {
        Self { x, y, z }
    }

    #[inline(always)]
    pub(super) fn splat(simd: S, v: [f32; 3]) -> Self {
        Self {
            x: Float::splat(simd, v[0]),
            y: Float::splat(simd, v[1]),
            z: Float::splat(simd, v[2]),
        }
    }

    /// Loads three columns with one number per lane.
    #[inline(always)]
    pub(super) fn load_arrays(simd: S, [x, y, z]: &[[f32; LANES]; 3]) -> Self {
        Self {
            x: Float::load_array(simd, *x),
            y: Float::load_array(simd, *y),
            z: Float::load_array(simd, *z),
        }
    }

    #[inline(always)]
    pub(super) fn dot(self, rhs: Self) -> Float<S> {
        self.x.mul_add(rhs.x, self.y.mul_add(rhs.y, self.z * rhs.z))
    }

    #[inline(always)]
    pub(super) fn cross(self, rhs: Self) -> Self {
        Self {
            x: self.y * rhs.z - self.z * rhs.y,
            y: self.z * rhs.x - self.x * rhs.z,
            z: self.x * rhs.y - self.y * rhs.x,
        }
    }

    #[inline(always)]
    pub(super) fn length_squared(self) -> Float<S> {
        self.dot(self)
    }

    /// `self · k + add`.
    #[inline(always)]
    pub(super) fn mul_add(self, k: Float<S>, add: Self) -> Self {
        Self {
            x: self.x.mul_add(k, add.x),
            y: self.y.mul_add(k, add.y),
            z: self.z.mul_add(k, add.z),
        }
    }

    /// Componentwise product.
    #[inline(always)]
    pub(super) fn scale(self, rhs: Self) -> Self {
        Self {
            x: self.x * rhs.x,
            y: self.y * rhs.y,
            z: self.z * rhs.z,
        }
    }

    /// Componentwise `self · k + add`.
    #[inline(always)]
    pub(super) fn scale_add(self, k: Self, add: Self) -> Self {
        Self {
            x: self.x.mul_add(k.x, add.x),
            y: self.y.mul_add(k.y, add.y),
            z: self.z.mul_add(k.z, add.z),
        }
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self::new(self.x.abs(), self.y.abs(), self.z.abs())
    }

    #[inline(always)]
    pub(super) fn select(mask: Mask<S>, if_true: Self, if_false: Self) -> Self {
        Self {
            x: mask.select(if_true.x, if_false.x),
            y: mask.select(if_true.y, if_false.y),
            z: mask.select(if_true.z, if_false.z),
        }
    }
}

impl<S: Simd> Add for Vec3x<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, rhs: Self) -> Self {
        Self::new(self.x + rhs.x, self.y + rhs.y, self.z + rhs.z)
    }
}

impl<S: Simd> Sub for Vec3x<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, rhs: Self) -> Self {
        Self::new(self.x - rhs.x, self.y - rhs.y, self.z - rhs.z)
    }
}

impl<S: Simd> Mul<Float<S>> for Vec3x<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, rhs: Float<S>) -> Self {
        Self::new(self.x * rhs, self.y * rhs, self.z * rhs)
    }
}

impl<S: Simd> Neg for Vec3x<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

/// Whether 0 lies between the minimum and the maximum of three numbers.
#[inline(always)]
pub(super) fn has_zero<S: Simd>([a, b, c]: [Float<S>; 3]) -> Mask<S> {
    a.min(b).min(c).simd_le(0.0) & a.max(b).max(c).simd_ge(0.0)
}
