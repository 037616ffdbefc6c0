//! Denoising on the device: the sequence of passes, and the filter's kernels.

mod frame;
mod kernels;

pub(super) use kernels::{FilterBuffers, FilterKernels};
