//! Compressed videos with sound, encoded by an installed ffmpeg.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};
use carom_farm::{FilmFrames, WholeFile};
use carom_tracer::ImageSize;

use crate::audio::{Sound, installed_program};

/// Container format with its codecs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VideoContainer {
    /// H.264 and AAC: `.mp4`.
    Mp4,
    /// H.264 and AAC: `.mkv`.
    Mkv,
    /// VP9 and Opus: `.webm`.
    Webm,
    /// 256 colours a frame, without sound: `.gif`.
    Gif,
}

impl VideoContainer {
    /// The format of a file's ending, if it is one of these.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension().and_then(OsStr::to_str)? {
            "mp4" => Some(Self::Mp4),
            "mkv" => Some(Self::Mkv),
            "webm" => Some(Self::Webm),
            "gif" => Some(Self::Gif),
            _ => None,
        }
    }

    /// Size of a video for frames of this size: with H.264 it is rounded up to even numbers.
    pub fn size(self, frame: ImageSize) -> ImageSize {
        match self {
            Self::Mp4 | Self::Mkv => ImageSize::new(
                frame.width.next_multiple_of(2),
                frame.height.next_multiple_of(2),
            ),
            Self::Webm | Self::Gif => frame,
        }
    }

    /// Options of ffmpeg for the output.
    fn options(self) -> String {
        // Chroma planes at half resolution (yuv420p) need even sizes.
        let h264 = "-vf pad=ceil(iw/2)*2:ceil(ih/2)*2 -c:v libx264 -crf 18 -pix_fmt yuv420p -c:a aac -b:a 192k";
        match self {
            Self::Mp4 => format!("{h264} -movflags +faststart -f mp4"),
            Self::Mkv => format!("{h264} -f matroska"),
            Self::Webm => "-c:v libvpx-vp9 -crf 28 -b:v 0 -row-mt 1 -pix_fmt yuv420p -c:a libopus \
                           -b:a 128k -f webm"
                .to_owned(),
            Self::Gif => "-vf split[a][b];[a]palettegen[p];[b][p]paletteuse -an -f gif".to_owned(),
        }
    }
}

/// Path of ffmpeg, if it is installed.
pub(super) fn installed() -> Option<PathBuf> {
    installed_program("ffmpeg")
}

/// Encodes frames and sound to one file while `proceed`, called before each frame, returns true. The file
/// is written under a temporary name and renamed at the end, so that there is never an incomplete video at
/// `path`.
///
/// # Errors
/// If ffmpeg is not installed or fails, with its last message; those of [`FilmFrames::write_y4m`].
pub(super) fn encode(
    frames: &FilmFrames,
    sound: &Sound,
    path: &Path,
    container: VideoContainer,
    frames_per_sec: u16,
    proceed: &mut dyn FnMut() -> bool,
) -> anyhow::Result<()> {
    let program = installed().context("ffmpeg is not installed any more")?;
    let scratch = tempfile::tempdir().context("there is no room for the sound")?;
    let track = scratch.path().join("sound.wav");
    let mut file = BufWriter::new(File::create(&track)?);
    sound.write_wav(1.0, &mut file)?;
    file.flush()?;
    let unwritable = || format!("cannot write {}", path.display());
    let claimed = WholeFile::claim(path).with_context(unwritable)?;
    let secs = f64::from(frames.frames()) / f64::from(frames_per_sec);
    let mut encoder = Command::new(&program)
        .args("-y -hide_banner -loglevel error -f yuv4mpegpipe -i pipe:0 -i".split(' '))
        .arg(&track)
        .args(container.options().split(' '))
        .args(["-t", &secs.to_string()])
        .arg(claimed.partial_path())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::from(File::create(scratch.path().join("log"))?))
        .spawn()
        .with_context(|| format!("{} cannot be started", program.display()))?;
    let pipe = encoder.stdin.take().context("ffmpeg has no input")?;
    let sent = frames.write_y4m(BufWriter::new(pipe), frames_per_sec, proceed);
    if sent.is_err() && !proceed() {
        // It would finish a shorter video from the frames that it has.
        let _ = encoder.kill();
    }
    let status = encoder.wait()?;
    if !status.success() || sent.is_err() {
        let said = fs::read_to_string(scratch.path().join("log")).unwrap_or_default();
        if let Some(line) = said.lines().last() {
            bail!("{}: ffmpeg: {line}", path.display());
        }
        sent?;
        bail!("{}: ffmpeg ended with {status}", path.display());
    }
    claimed.commit().with_context(unwritable)
}
