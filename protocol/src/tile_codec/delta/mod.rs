//! Delta stage: the pixels of a tile that differ from those of its reference.

pub(crate) mod delta_coder;
pub(crate) mod delta_mask;
pub(crate) mod neighbourhood;
pub(crate) mod reference;
