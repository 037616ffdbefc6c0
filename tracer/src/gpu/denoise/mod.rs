//! Denoised pictures on the device: a frame of passes, and the filter's kernels.

mod frame;
mod kernels;

pub(super) use kernels::{FilterBuffers, FilterKernels};
