//! Entropy stage: coding of decisions and values with few bits where they are likely.

pub(crate) mod range_coder;
pub(crate) mod value_model;
