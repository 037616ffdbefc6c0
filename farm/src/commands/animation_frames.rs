//! Animation times that a render traces: a single one, or those of numbered frames.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use carom_farm::{FrameRange, SceneFile};
use carom_tracer::{Scene, SceneUpdate};

use crate::commands::Failure;
use crate::commands::inputs::{self, PictureFile};

/// Arguments that say when.
#[derive(Clone, clap::Args)]
pub(crate) struct AnimationArgs {
    /// Show a glTF file's animation at this time in seconds [default: without animation]
    #[arg(long, value_name = "SECS", requires = "scene", conflicts_with = "frames", allow_negative_numbers = true, value_parser = secs)]
    time: Option<f64>,
    /// Trace these frames of a glTF file's animation, the first being 0; --out then has a # for each digit of a frame's
    /// number, as in frame_####.png
    #[arg(long, value_name = "A-B", requires = "scene")]
    frames: Option<FrameRange>,
    /// Set the frames of a second of --frames
    #[arg(long, value_name = "N", default_value_t = 24.0, requires = "frames", value_parser = frames_per_sec)]
    fps: f64,
    /// Choose an animation of several by its name or number [default: 0, the first]
    #[arg(long, value_name = "NAME", requires = "scene")]
    animation: Option<String>,
}

/// What a render traces: a still scene, or a file with an animation and its times.
pub(crate) enum Frames {
    Still(Arc<Scene>),
    Animated {
        file: Box<SceneFile>,
        animation: usize,
        times: AnimationArgs,
    },
}

impl Frames {
    /// Reads the scene.
    pub(crate) fn open(args: &AnimationArgs, scene: Option<&Path>) -> Result<Self, Failure> {
        let is_animated = args.time.is_some() || args.frames.is_some() || args.animation.is_some();
        let (true, Some(path)) = (is_animated, scene) else {
            return Ok(Self::Still(Arc::new(inputs::scene(scene)?.scene)));
        };
        inputs::check_scene(path)?;
        let file = Box::new(SceneFile::open(path)?);
        let animation = file.find_animation(args.animation.as_deref())?;
        Ok(Self::Animated {
            file,
            animation,
            times: args.clone(),
        })
    }

    /// The numbers of the frames; a single `None` if they are not numbered.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = Option<u32>> + use<> {
        let range = match self {
            Self::Animated { times, .. } => times.frames,
            Self::Still(_) => None,
        };
        let numbered = range.into_iter().flat_map(|range| {
            let first = range.first();
            (first..=first.saturating_add(range.count() - 1)).map(Some)
        });
        numbered.chain(range.is_none().then_some(None))
    }

    /// The scene of a frame, and its pose in it.
    pub(crate) fn scene(
        &mut self,
        number: Option<u32>,
    ) -> Result<(Arc<Scene>, SceneUpdate), Failure> {
        match self {
            Self::Still(scene) => Ok((Arc::clone(scene), SceneUpdate::default())),
            Self::Animated {
                file,
                animation,
                times,
            } => {
                let secs = match number {
                    Some(number) => f64::from(number) / times.fps,
                    None => times.time.unwrap_or(0.0),
                };
                Ok(file.seek(*animation, secs)?)
            }
        }
    }
}

impl AnimationArgs {
    /// The output files of a frame: each run of # in their names becomes its number, zero-padded to as many
    /// digits.
    pub(crate) fn outputs(
        &self,
        out: &[PictureFile],
        number: Option<u32>,
    ) -> Result<Vec<PictureFile>, Failure> {
        let numbered = |picture: &PictureFile| match number {
            None => Ok(picture.clone()),
            Some(number) => Ok(PictureFile {
                path: numbered(&picture.path, number)?,
                format: picture.format,
            }),
        };
        out.iter().map(numbered).collect()
    }
}

fn numbered(path: &Path, number: u32) -> Result<PathBuf, Failure> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let digits = name.chars().filter(|c| *c == '#').count();
    let run = "#".repeat(digits);
    if digits == 0 || !name.contains(&run) {
        return Err(Failure::Input(format!(
            "--out {}: with --frames its name must have one run of #, as in frame_####.png",
            path.display()
        )));
    }
    let name = name.replace(&run, &format!("{number:0digits$}"));
    Ok(path.with_file_name(name))
}

fn secs(text: &str) -> Result<f64, &'static str> {
    let secs: Option<f64> = text.parse().ok();
    let secs = secs.filter(|secs| secs.is_finite());
    secs.ok_or("it must be a number of seconds, as in 1.5")
}

fn frames_per_sec(text: &str) -> Result<f64, &'static str> {
    let rate: Option<f64> = text.parse().ok();
    let rate = rate.filter(|rate| (0.01..=10_000.0).contains(rate));
    rate.ok_or("it must be a number from 0.01 to 10000")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_hashes_are_the_frames_number() {
        let name = |text: &str, number| numbered(Path::new(text), number);
        let path = name("a/frame_####.png", 7).unwrap();
        assert_eq!(path, Path::new("a/frame_0007.png"));
        assert_eq!(name("#.exr", 1234).unwrap(), Path::new("1234.exr"));
        for text in ["frame.png", "a_#_#.png", "##/frame.png"] {
            let why = name(text, 0).unwrap_err().to_string();
            assert!(
                why.contains("frame_####.png") && why.contains(text),
                "{why}"
            );
        }
    }
}
