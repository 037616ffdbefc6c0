//! Core dumps: a dump of a process that has read a key would hold it.

/// Forbids dumps of this process, whichever command it runs: all read keys, and `token` holds the
/// authority's for as long as thirty days.
#[cfg(unix)]
pub(crate) fn forbid() {
    use rustix::process::{Resource, Rlimit, setrlimit};

    let none = Rlimit {
        current: Some(0),
        maximum: Some(0),
    };
    if let Err(error) = setrlimit(Resource::Core, none) {
        tracing::warn!("core dumps cannot be forbidden: {error}");
    }
}

#[cfg(not(unix))]
pub(crate) fn forbid() {}
