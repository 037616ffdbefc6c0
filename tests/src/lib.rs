//! Tests of the repository itself, in the `tests` folder, and the independent references that the
//! other crates' tests read. The package has no code of its own.
