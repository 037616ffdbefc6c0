//! Videos of shots: their frames and sound, and the output file.

mod ffmpeg;
pub mod replay_film;
mod shot_sequence;

use std::path::{Path, PathBuf};

use carom_farm::{FilmFormat, FilmFrames};

use crate::Error;
use crate::audio::Sound;
use crate::capture::next_path;

pub use ffmpeg::VideoContainer;
pub use shot_sequence::{ShotSequence, VideoView};

/// Output of a film, whose kind follows from the name's ending.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VideoTarget {
    /// One lossless file without sound, see [`FilmFormat`].
    File(PathBuf),
    /// One compressed file with sound.
    Encoded(PathBuf, VideoContainer),
    /// A PNG for each frame, in this folder.
    Folder(PathBuf),
}

impl VideoTarget {
    /// Parses a path.
    ///
    /// # Errors
    /// [`Error::VideoKind`] for an unknown ending, [`Error::FfmpegMissing`] for one that
    /// needs ffmpeg if it is not installed.
    pub fn parse(path: &str) -> Result<Self, Error> {
        let at = PathBuf::from(path);
        if let Some(container) = VideoContainer::of(&at) {
            let name = path.to_owned();
            let is_possible = ffmpeg::installed().is_some();
            return is_possible
                .then_some(Self::Encoded(at, container))
                .ok_or(Error::FfmpegMissing(name));
        }
        match FilmFormat::of(&at) {
            Ok(_) => Ok(Self::File(at)),
            Err(_) if !path.is_empty() && at.extension().is_none() => Ok(Self::Folder(at)),
            Err(_) => Err(Error::VideoKind(path.to_owned())),
        }
    }

    /// The next free path in a folder, of the best available kind: MP4 with sound if ffmpeg is installed,
    /// an animated PNG otherwise.
    ///
    /// # Errors
    /// As [`next_path`].
    pub fn next_in(folder: &Path) -> Result<Self, Error> {
        Ok(match ffmpeg::installed() {
            Some(_) => Self::Encoded(next_path(folder, "film", &["mp4"])?, VideoContainer::Mp4),
            None => Self::File(next_path(folder, "film", &["png"])?),
        })
    }

    /// Path of the file or folder.
    pub fn path(&self) -> &Path {
        match self {
            Self::File(path) | Self::Encoded(path, _) | Self::Folder(path) => path,
        }
    }

    /// Path of the folder that holds the frames until the film is complete.
    pub fn frames_folder(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::File(path) | Self::Encoded(path, _) => {
                let mut name = path.as_os_str().to_owned();
                name.push(".frames");
                name.into()
            }
        }
    }
}

/// Assembles the frames of a film to the target while `proceed` returns true.
///
/// # Errors
/// If the file cannot be written or encoded, or `proceed` returned false.
pub fn save(
    frames: &FilmFrames,
    soundtrack: impl FnOnce() -> Sound,
    frames_per_sec: u16,
    target: &VideoTarget,
    proceed: &mut dyn FnMut() -> bool,
) -> anyhow::Result<()> {
    match target {
        VideoTarget::Folder(_) => Ok(()),
        VideoTarget::File(path) => Ok(frames.save_while(path, frames_per_sec, proceed)?),
        VideoTarget::Encoded(path, container) => {
            let sound = soundtrack();
            ffmpeg::encode(frames, &sound, path, *container, frames_per_sec, proceed)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_tells_the_kind_and_the_frames_lie_beside() {
        let film = VideoTarget::parse("a/shot.y4m").unwrap();
        assert_eq!(film, VideoTarget::File("a/shot.y4m".into()));
        assert_eq!(film.frames_folder(), Path::new("a/shot.y4m.frames"));
        let apng = VideoTarget::parse("b.png").unwrap();
        assert_eq!(apng, VideoTarget::File("b.png".into()));
        let folder = VideoTarget::parse("frames").unwrap();
        assert_eq!(folder.frames_folder(), folder.path());
        for wrong in ["shot.avi", "shot.PNG.gz", ""] {
            let error = VideoTarget::parse(wrong).unwrap_err().to_string();
            assert!(error.contains(".y4m"), "{wrong}: {error}");
        }
    }
}
