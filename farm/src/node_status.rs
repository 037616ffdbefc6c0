//! Status of nodes as a farm reports it: index, state, learned speed and latency.

use std::fmt;
use std::time::Duration;

use carom_protocol::{NodeInfo, NodeLoad};

use crate::stats::LatencySplit;

/// Index of a node in [`crate::Farm::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeIndex(pub usize);

/// Status of a node as the coordinator sees it.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct NodeStatus {
    /// Its address, or `local`.
    pub address: String,
    /// Its own description; absent before it has sent it.
    pub info: Option<NodeInfo>,
    /// Its state.
    pub state: NodeState,
    /// Learned fixed cost of a request, A, in seconds.
    pub fixed_secs: f64,
    /// Standard error of A, in seconds; 0 until two requests have been answered.
    pub fixed_error_secs: f64,
    /// Learned speed, 1/B, in millions of pixel samples per second.
    pub msamples_per_sec: f64,
    /// Standard error of the speed, as a share of it; 0 until two requests have been answered.
    pub speed_error: f64,
    /// Tiles delivered since it joined.
    pub tiles: u64,
    /// Requested tiles that it refused, or that were lost with its connection or reassigned because it had
    /// fallen silent.
    pub lost_tiles: u64,
    /// Its tiles that others have traced again for comparison.
    pub checked_tiles: u64,
    /// An undecided disagreement of its pixels with another node's, as the end of a sentence.
    pub doubt: Option<String>,
    /// Round-trip time of the last ping, if there was one.
    pub round_trip: Option<Duration>,
    /// Latency breakdown of its last tile.
    pub split: LatencySplit,
    /// Load by other players, as of its last answer to a ping.
    pub load: NodeLoad,
}

impl NodeStatus {
    /// The status of a node of which only the address is known.
    pub fn new(address: impl Into<String>) -> Self {
        Self {
            address: address.into(),
            ..Self::default()
        }
    }

    /// Its state as a predicate for a user who has waited for `waited`, with what to check if it has not
    /// answered.
    pub fn sentence_after(&self, waited: Duration) -> String {
        let secs = waited.as_secs();
        match self.state {
            NodeState::Starting if self.address == LOCAL_ADDRESS => {
                format!("has not opened its device within {secs} s")
            }
            NodeState::Starting => format!(
                "has not answered for {secs} s: check that the node is running and that firewalls let its \
                 UDP port through"
            ),
            _ => self.state.sentence(),
        }
    }
}

/// Placeholder for the address of the node in this process.
pub(crate) const LOCAL_ADDRESS: &str = "local";

/// State of a node, in the words that players, `carom-farm status` and the node itself use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum NodeState {
    /// Its device is being opened, or it is being connected to for the first time.
    #[default]
    Starting,
    /// It waits for a player: reported only by a node about itself.
    Listening,
    /// Connected, and this farm has no scene yet.
    Paired,
    /// Connected, without this farm's scene yet.
    Syncing {
        /// Bytes of the scene that it has received.
        bytes: u64,
        /// Total bytes of the scene; 0 until it has been asked what it lacks.
        of: u64,
    },
    /// Holds the scene.
    Ready,
    /// Holds the scene and has had work within the last second.
    Rendering,
    /// Shuts down, and gets no more requests.
    Draining,
    /// Lost, or unusable for now.
    Lost {
        /// Reason, as a sentence.
        why: String,
        /// Whole seconds until the next attempt, rounded up; absent during an attempt, and if unknown.
        retry_secs: Option<u64>,
    },
}

impl NodeState {
    /// The state's name.
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Listening => "listening",
            Self::Paired => "paired",
            Self::Syncing { .. } => "syncing",
            Self::Ready => "ready",
            Self::Rendering => "rendering",
            Self::Draining => "draining",
            Self::Lost { .. } => "lost",
        }
    }

    /// Its meaning, as a predicate to the node's name.
    pub fn sentence(&self) -> String {
        match self {
            Self::Starting => "is being called, or opens its device".into(),
            Self::Listening => "waits for a player".into(),
            Self::Paired => "is connected and waits for a scene".into(),
            Self::Syncing { of: 0, .. } => "is being sent the scene".into(),
            Self::Syncing { bytes, of } => format!(
                "is being sent the scene and has {:.1} of {:.1} MB of it",
                *bytes as f64 / 1e6,
                *of as f64 / 1e6
            ),
            Self::Ready => "holds the scene and waits for work".into(),
            Self::Rendering => "traces".into(),
            Self::Draining => "is shutting down".into(),
            Self::Lost { .. } => format!("is {self}"),
        }
    }

    /// Whether pictures of this farm's scene can be requested from it.
    pub const fn is_ready(&self) -> bool {
        matches!(self, Self::Ready | Self::Rendering)
    }
}

/// A share in percent, rounded down; 0 if there is no total.
fn percent(bytes: u64, of: u64) -> u64 {
    100 * bytes / of.max(1)
}

/// The state's name, with the share of the scene that has been received, and for a lost node the reason and
/// the next attempt.
impl fmt::Display for NodeState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())?;
        match self {
            Self::Syncing { bytes, of } => write!(f, " {} %", percent(*bytes, *of)),
            Self::Lost { why, retry_secs } => match retry_secs {
                Some(secs) => write!(f, " ({why}, tried again within {secs} s)"),
                None => write!(f, " ({why})"),
            },
            _ => Ok(()),
        }
    }
}
