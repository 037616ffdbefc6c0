//! Run-time selection of SIMD instruction sets.

pub use fearless_simd::Level;

#[cfg(not(target_arch = "x86_64"))]
pub(crate) use fearless_simd::dispatch;

/// Compiles an expression for several instruction sets and evaluates it with the one of a
/// [`Level`].
///
/// As `fearless_simd::dispatch`, but without SSE4.2: such processors run the SSE2 code. Both are 4
/// lanes wide, and SSE4.2 is only a tenth faster for more code than AVX2 and AVX-512 have together.
#[cfg(target_arch = "x86_64")]
macro_rules! dispatch {
    ($level:expr, $simd:ident => $op:expr) => {{
        let level: $crate::simd::Level = $level;
        if let Some($simd) = level.as_avx512() {
            $crate::simd::vectorize!($simd => $op)
        } else if let Some($simd) = level.as_avx2() {
            $crate::simd::vectorize!($simd => $op)
        } else {
            let $simd = level.as_sse2().expect("every x86-64 processor has SSE2");
            $crate::simd::vectorize!($simd => $op)
        }
    }};
}

/// Evaluates an expression in a function that is compiled for the instruction set of `$simd`.
#[cfg(target_arch = "x86_64")]
macro_rules! vectorize {
    ($simd:ident => $op:expr) => {
        fearless_simd::Simd::vectorize(
            $simd,
            #[inline(always)]
            || $op,
        )
    };
}

#[cfg(target_arch = "x86_64")]
pub(crate) use {dispatch, vectorize};
