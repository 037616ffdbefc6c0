//! Entropy coding: decisions and values in as many bits as they are unlikely.

pub(crate) mod range_coder;
