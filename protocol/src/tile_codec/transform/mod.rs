//! Transform stage: pixels to planes of small numbers, and back.

pub(crate) mod float_planes;
pub(crate) mod forward;
pub(crate) mod inverse;
pub(crate) mod predict;
pub(crate) mod quantise;
