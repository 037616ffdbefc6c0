//! Files and looks back: recordings, replays, screenshots, videos, rendering without a window.

pub mod headless;
mod recordings;
pub mod replay;
pub mod screenshot;
mod timeline;
pub mod video;

pub(crate) use recordings::next_path;
pub use recordings::{RecordingKind, RecordingStore, SavedRecording};
pub use timeline::{TimelineEvent, timeline_events};
