//! Panels over the picture.

pub(crate) mod help;
pub(crate) mod notices;
pub(crate) mod panel;
