//! Recordings, replays, screenshots, videos, and rendering without a window.

pub mod background;
pub mod headless;
mod recordings;
pub mod replay;
pub mod screenshot;
mod shot_history;
mod shot_recorder;
mod timeline;
pub mod video;

pub(crate) use recordings::next_path;
pub use recordings::{RecordingKind, RecordingStore, SavedRecording};
pub use shot_history::{ShotHistory, shot_title};
pub use shot_recorder::ShotRecorder;
pub use timeline::{TimelineEvent, timeline_events};
