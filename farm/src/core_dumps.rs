//! Prevention of core dumps, which would contain the keys that the process has read.

/// Disables core dumps of this process, whichever command it runs: all read keys, and `token` holds the
/// authority's for up to thirty days.
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
