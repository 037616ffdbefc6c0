//! Nodes as a farm reports them: index, state, learned speed and latency.

use std::fmt;
use std::time::Duration;

use carom_protocol::{NodeInfo, NodeLoad};

use crate::stats::LatencySplit;

/// A node of a farm: its place in [`crate::Farm::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeIndex(pub usize);

/// A node as the coordinator sees it.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct NodeStatus {
    /// Its address, or `local`.
    pub address: String,
    /// What it said of itself; absent until it has.
    pub info: Option<NodeInfo>,
    /// Where it stands.
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
    /// Tiles that it was asked for and that it refused, or that were lost with its connection or
    /// asked of others because it had fallen silent.
    pub lost_tiles: u64,
    /// Tiles of it that others have traced again and that were compared.
    pub checked_tiles: u64,
    /// That its pixels differ from another node's while nobody knows who is right, as the end of a
    /// sentence.
    pub doubt: Option<String>,
    /// Last round trip of a ping, if there was one.
    pub round_trip: Option<Duration>,
    /// Where the time of its last tile went.
    pub split: LatencySplit,
    /// What its other players had of its device when it last answered a ping.
    pub load: NodeLoad,
}

impl NodeStatus {
    /// A node of which nothing is known but its address.
    pub fn new(address: impl Into<String>) -> Self {
        Self {
            address: address.into(),
            ..Self::default()
        }
    }

    /// Its state as a predicate to somebody who has waited for it for so long: with what to check, if it has
    /// not answered.
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

/// What stands for the address of the node in this process.
pub(crate) const LOCAL_ADDRESS: &str = "local";

/// Where a node stands, in the words that players, `carom-farm status` and the node itself use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum NodeState {
    /// Its device is being opened, or it is being called for the first time.
    #[default]
    Starting,
    /// It waits for a player: only a node says that, of itself.
    Listening,
    /// Connected, and this farm has no scene yet.
    Paired,
    /// Connected, without this farm's scene yet.
    Syncing {
        /// Bytes of the scene that it has.
        bytes: u64,
        /// Bytes of the scene; 0 until it is asked which it lacks.
        of: u64,
    },
    /// Holds the scene.
    Ready,
    /// Holds the scene and has had work within the last second.
    Rendering,
    /// Ends, and is asked for nothing more.
    Draining,
    /// Gone, or of no use for now.
    Lost {
        /// A sentence.
        why: String,
        /// When it is tried again, in whole seconds from now, rounded up; absent while it is, and if nobody knows.
        retry_secs: Option<u64>,
    },
}

impl NodeState {
    /// One word.
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

    /// What that means, as the end of a sentence that begins with the node's name.
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

    /// Whether it can be asked for pictures of this farm's scene.
    pub const fn is_ready(&self) -> bool {
        matches!(self, Self::Ready | Self::Rendering)
    }
}

/// A part in percent, rounded down; 0 of nothing.
fn percent(bytes: u64, of: u64) -> u64 {
    100 * bytes / of.max(1)
}

/// Its word, with how much of the scene it has, and for a lost node why it is and when it is tried
/// again.
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
