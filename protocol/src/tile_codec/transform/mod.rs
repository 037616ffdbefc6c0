//! Transform stage: pixels to planes of small differences, and back.
//!
//! The forward transform quantises sRGB bytes to the levels of a precision, subtracts a prediction from each
//! channel and writes each channel's differences to a plane of its own, where zstd finds bytes of equal
//! meaning side by side. The inverse sums the differences. All arithmetic is modulo 256, or modulo 2ⁿ for the
//! bits of floats.

pub(crate) mod float_planes;
pub(crate) mod quantise;
pub(crate) mod srgb_forward;
pub(crate) mod srgb_inverse;
