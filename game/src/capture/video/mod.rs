//! Videos of shots: frames by the farm, kept as they come, then put together into one file.
//!
//! ```text
//! ShotSequence (what is seen when) ─▶ Farm ─▶ FrameCache (frames in a folder, by the job's hash)
//!                                          └─▶ film.y4m, film.png (animated), or the folder itself
//! ```

mod apng;
mod frame_cache;
mod frame_range;
mod shot_sequence;
mod y4m;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use carom_tracer::ImageSize;

use crate::Error;

pub use apng::{Animation, write_png};
pub use frame_cache::{FrameCache, RenderJob};
pub use frame_range::FrameRange;
pub use shot_sequence::{ShotSequence, VideoView};
pub use y4m::Y4m;

/// Where a film goes; its kind is told by the name's ending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VideoTarget {
    /// YUV4MPEG2, which video encoders read: `.y4m`.
    Y4m(PathBuf),
    /// An animated PNG: `.png`.
    Apng(PathBuf),
    /// A PNG for each frame, in this folder.
    Folder(PathBuf),
}

impl VideoTarget {
    /// Reads a path.
    ///
    /// # Errors
    /// [`Error::VideoKind`] for an ending that is not written.
    pub fn parse(path: &str) -> Result<Self, Error> {
        let at = PathBuf::from(path);
        let ending = at.extension().map(|ending| ending.to_string_lossy());
        match ending.as_deref() {
            Some("y4m") => Ok(Self::Y4m(at)),
            Some("png") => Ok(Self::Apng(at)),
            None if !path.is_empty() => Ok(Self::Folder(at)),
            _ => Err(Error::VideoKind {
                name: path.to_owned(),
            }),
        }
    }

    /// The path itself.
    pub fn path(&self) -> &Path {
        match self {
            Self::Y4m(path) | Self::Apng(path) | Self::Folder(path) => path,
        }
    }

    /// The folder that keeps the frames until the film is whole.
    pub fn reel(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::Y4m(path) | Self::Apng(path) => {
                let mut name = path.as_os_str().to_owned();
                name.push(".frames");
                name.into()
            }
        }
    }
}

/// Puts all frames together in one file, `between` frames asking whether to go on. Written beside
/// its place and renamed: there is never half a film.
///
/// # Errors
/// A sentence with the path; what `between` says.
pub fn assemble(
    reel: &FrameCache,
    target: &VideoTarget,
    frames_per_sec: u16,
    between: &mut dyn FnMut() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let path = target.path();
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    match target {
        VideoTarget::Folder(_) => return Ok(()),
        VideoTarget::Y4m(_) => {
            let mut film = Y4m::create(&partial, reel.size(), frames_per_sec)?;
            for index in 0..reel.frames() {
                between()?;
                film.push(&reel.read(index)?)?;
            }
            film.finish()?;
        }
        VideoTarget::Apng(_) => {
            let frames = reel.frames();
            let mut film = Animation::create(&partial, reel.size(), frames, frames_per_sec)?;
            for index in 0..frames {
                between()?;
                film.push(&reel.read(index)?)?;
            }
            film.finish()?;
        }
    }
    fs::rename(&partial, path).with_context(|| format!("cannot write {}", path.display()))
}

/// The RGB bytes of a frame.
fn frame_bytes(size: ImageSize) -> usize {
    3 * size.pixels()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_tells_the_kind_and_the_reel_lies_beside() {
        let film = VideoTarget::parse("a/shot.y4m").unwrap();
        assert_eq!(film, VideoTarget::Y4m("a/shot.y4m".into()));
        assert_eq!(film.reel(), Path::new("a/shot.y4m.frames"));
        let apng = VideoTarget::parse("b.png").unwrap();
        assert_eq!(apng, VideoTarget::Apng("b.png".into()));
        let folder = VideoTarget::parse("frames").unwrap();
        assert_eq!(folder.reel(), folder.path());
        for wrong in ["shot.mp4", "shot.PNG.gz", ""] {
            let error = VideoTarget::parse(wrong).unwrap_err().to_string();
            assert!(error.contains(".y4m"), "{wrong}: {error}");
        }
    }
}
