//! Tests that need more than one crate, and tests of the repository itself. The package has no
//! code of its own: see its `tests` folder.
