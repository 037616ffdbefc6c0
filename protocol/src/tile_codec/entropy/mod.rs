//! Entropy stage: decisions and values in as few bits as they are likely.

pub(crate) mod range_coder;
pub(crate) mod value_model;
