//! What can go wrong with a farm, and whose fault it is.

/// Errors of the public API. A node that fails is no error: its work goes elsewhere and
/// [`crate::Farm::nodes`] says why.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene, the update or the settings are the caller's mistake, or the local device fails.
    #[error(transparent)]
    Tracer(#[from] carom_tracer::Error),
    /// The configuration contradicts itself: a sentence with the value.
    #[error("{0}")]
    Config(String),
    /// A certificate or key is missing, unreadable or not what its role needs.
    #[error("{0}")]
    Credentials(String),
    /// A socket could not be opened.
    #[error("{address}: {source}")]
    Socket {
        /// The address.
        address: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// As many frames are in flight as the configuration allows: poll first.
    #[error("{in_flight} frames are in flight already: take one with poll_frame first")]
    FramesInFlight {
        /// How many.
        in_flight: usize,
    },
    /// All nodes are lost: why, one by one.
    #[error("no node is left: {0}")]
    NoNodes(String),
    /// No scene has been set.
    #[error("no scene is set: call set_scene first")]
    NoScene,
}
