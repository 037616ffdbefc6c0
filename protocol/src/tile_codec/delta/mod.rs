//! Delta coding: the pixels of a tile that differ from those of its reference.

pub(crate) mod delta_mask;
