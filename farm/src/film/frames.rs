//! Finished frames of a film in a folder, from which an interrupted film resumes.
//!
//! `job.json` identifies the film: a BLAKE3 hash of all that its pixels depend on. Each frame is a PNG that
//! is written under a temporary name and renamed, so that an existing one is complete.

use std::fs::{self, File};
use std::io::{self, BufReader, BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use carom_protocol::SceneHash;
use carom_tracer::{ImageSize, RenderSettings};
use serde::{Deserialize, Serialize};

use super::apng::{Animation, COMPRESSION};
use super::frame_range::FrameRange;
use super::states::FilmStates;
use super::y4m::Y4m;
use crate::error::Error;
use crate::picture::write_png;
use crate::whole_file::WholeFile;

/// Identity of the film whose frames a folder holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct FilmIdentity {
    /// Hash of all that the frames' pixels depend on, in hexadecimal.
    hash: String,
    frames: u32,
    /// Description for users.
    words: String,
    /// Whether the film is finished, so that its frames may be replaced.
    done: bool,
}

impl FilmIdentity {
    /// The identity of a film of a scene with a frame for each state.
    pub(super) fn of(
        SceneHash(scene): SceneHash,
        size: ImageSize,
        settings: RenderSettings,
        exposure: f32,
        states: &FilmStates,
    ) -> Self {
        let mut hash = blake3::Hasher::new();
        hash.update(&scene);
        // Rust's shortest round-trip format of a float identifies its value.
        hash.update(format!("{VERSION} {size:?} {settings:?} {exposure:?}").as_bytes());
        states.hash_into(&mut hash);
        let ImageSize { width, height } = size;
        let RenderSettings { samples, seed, .. } = settings;
        let frames = u32::try_from(states.frames()).unwrap_or(u32::MAX);
        Self {
            hash: hash.finalize().to_hex().to_string(),
            frames,
            words: format!(
                "{frames} frames of {width}x{height}, {samples} samples per pixel, seed {seed}"
            ),
            done: false,
        }
    }
}

/// The frames of a film, each a PNG in one folder.
#[derive(Debug)]
pub struct FilmFrames {
    folder: PathBuf,
    identity: FilmIdentity,
    size: ImageSize,
    kept: Vec<bool>,
    range: FrameRange,
}

impl FilmFrames {
    /// Opens a folder, which is created if absent, and resumes the frames of the same film that it holds.
    /// Frames of another, finished film are removed. Those outside of `range` may be written by other
    /// processes, also on other machines that share the folder.
    ///
    /// # Errors
    /// [`Error::UnfinishedFilm`] if it holds frames of another film, [`Error::ForeignFrame`] if it holds
    /// frames without an identity, [`Error::Resume`], [`Error::File`].
    pub(super) fn open(
        folder: &Path,
        identity: FilmIdentity,
        size: ImageSize,
        range: FrameRange,
    ) -> Result<Self, Error> {
        fs::create_dir_all(folder).map_err(Error::file(folder))?;
        let mut frames = Self {
            folder: folder.to_owned(),
            kept: vec![false; identity.frames as usize],
            identity,
            size,
            range,
        };
        // A whole film that is marked as finished is traced anew. For a part the hash alone counts, as a
        // process of another part may have marked it.
        let is_part = range != FrameRange::ALL;
        match frames.before()? {
            Some(before)
                if before == frames.identity || is_part && before.hash == frames.identity.hash =>
            {
                let is_there = |i| frames.path(i).is_file();
                frames.kept = (0..frames.identity.frames).map(is_there).collect();
            }
            Some(before) => frames.make_room(&before)?,
            None => {
                if let Some(path) = frames.held(frames.frames()).next() {
                    return Err(Error::ForeignFrame(path));
                }
            }
        }
        frames.write_identity()?;
        Ok(frames)
    }

    /// Whether a folder holds frames of a film.
    pub fn are_in(folder: &Path) -> bool {
        folder.join(IDENTITY_FILE).exists()
    }

    /// Number of frames of the film.
    pub fn frames(&self) -> u32 {
        self.identity.frames
    }

    /// Size of a frame in pixels.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// The folder of the frames, which are named `frame_0000.png` and so on.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The missing frames of the film's range, in order.
    pub fn missing(&self) -> impl Iterator<Item = u32> {
        let in_range = (0..self.frames()).filter(|&i| self.range.contains(i));
        in_range.filter(|&i| !self.kept[i as usize])
    }

    /// Number of existing frames of the film's range.
    pub fn kept(&self) -> u32 {
        let kept = (0..).zip(&self.kept);
        kept.map(|(i, &kept)| u32::from(kept && self.range.contains(i)))
            .sum()
    }

    /// Stores a frame of sRGB bytes, row by row.
    pub(super) fn keep(&mut self, index: u32, rgb: &[u8]) -> Result<(), Error> {
        let path = self.path(index);
        let written = WholeFile::replace(&path, |file| {
            let mut file = BufWriter::new(file);
            write_png(&mut file, self.size, rgb, COMPRESSION)?;
            file.flush()
        });
        written.map_err(Error::file(&path))?;
        self.kept[index as usize] = true;
        Ok(())
    }

    /// The sRGB bytes of a frame, row by row from the top left.
    ///
    /// # Errors
    /// [`Error::FilmFrame`] if it is missing or damaged.
    pub fn read(&self, index: u32) -> Result<Vec<u8>, Error> {
        let path = self.path(index);
        let read = || -> Result<Vec<u8>, Box<dyn std::error::Error>> {
            let file = BufReader::new(File::open(&path)?);
            let mut reader = png::Decoder::new(file).read_info()?;
            let (width, height) = reader.info().size();
            let expected = 3 * self.size.pixels();
            if ImageSize::new(width, height) != self.size
                || reader.output_buffer_size() != Some(expected)
            {
                return Err("it has another size".into());
            }
            let mut rgb = vec![0; expected];
            reader.next_frame(&mut rgb)?;
            Ok(rgb)
        };
        read().map_err(|why| Error::FilmFrame {
            path: path.clone(),
            reason: why.to_string(),
        })
    }

    /// Writes all frames to one file whose name selects the [`FilmFormat`], at `frames_per_sec`, at least
    /// 1. The file appears only when it is complete.
    ///
    /// # Errors
    /// [`Error::FilmFormat`], [`Error::FilmFrame`], [`Error::File`].
    pub fn save(&self, path: impl AsRef<Path>, frames_per_sec: u16) -> Result<(), Error> {
        self.save_while(path, frames_per_sec, &mut || true)
    }

    /// The same, while `proceed`, called before each frame, returns true.
    ///
    /// # Errors
    /// As [`FilmFrames::save`], and [`Error::FilmCancelled`].
    pub fn save_while(
        &self,
        path: impl AsRef<Path>,
        frames_per_sec: u16,
        proceed: &mut dyn FnMut() -> bool,
    ) -> Result<(), Error> {
        let path = path.as_ref();
        let format = FilmFormat::of(path)?;
        let (size, frames, rate) = (self.size, self.frames(), frames_per_sec);
        // Carries an error out of the closure, which can only return I/O errors.
        let mut failure = None;
        let written = WholeFile::replace(path, |file| {
            let mut file = BufWriter::new(file);
            let mut next = |index| self.next_to_save(index, proceed, &mut failure);
            match format {
                FilmFormat::Y4m => {
                    let mut film = Y4m::begin(&mut file, size, rate)?;
                    (0..frames).try_for_each(|index| film.push(&next(index)?))?;
                    film.finish()?;
                }
                FilmFormat::Apng => {
                    let mut film = Animation::begin(&mut file, size, frames, rate)?;
                    (0..frames).try_for_each(|index| film.push(&next(index)?))?;
                    film.finish()?;
                }
            }
            file.flush()
        });
        failure.map_or(written.map_err(Error::file(path)), Err)
    }

    /// Writes all frames as YUV4MPEG2, for an encoder that reads them as they come, while `proceed`, called
    /// before each, returns true.
    ///
    /// # Errors
    /// [`Error::File`] of the encoder's input, and those of [`FilmFrames::save_while`].
    pub fn write_y4m(
        &self,
        out: impl io::Write,
        frames_per_sec: u16,
        proceed: &mut dyn FnMut() -> bool,
    ) -> Result<(), Error> {
        let mut failure = None;
        let write = || {
            let mut film = Y4m::begin(out, self.size, frames_per_sec)?;
            for index in 0..self.frames() {
                film.push(&self.next_to_save(index, proceed, &mut failure)?)?;
            }
            film.finish()
        };
        let written = write().map_err(Error::file(Path::new("the encoder")));
        failure.map_or(written, Err)
    }

    /// Reads the next frame to save; its error is stored in `failure`.
    fn next_to_save(
        &self,
        index: u32,
        proceed: &mut dyn FnMut() -> bool,
        failure: &mut Option<Error>,
    ) -> io::Result<Vec<u8>> {
        let frame = if proceed() {
            self.read(index)
        } else {
            Err(Error::FilmCancelled {
                frames_done: self.kept(),
                frames: self.frames(),
            })
        };
        frame.map_err(|why| {
            *failure = Some(why);
            ErrorKind::Interrupted.into()
        })
    }

    /// Marks the film as finished, so that the next film may take the folder.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn finish(&mut self) -> Result<(), Error> {
        self.identity.done = true;
        self.write_identity()
    }

    /// Removes the frames, and the folder if it is empty then.
    ///
    /// # Errors
    /// [`Error::File`].
    pub fn remove(self) -> Result<(), Error> {
        self.clear(self.frames())?;
        let path = self.identity_path();
        fs::remove_file(&path).map_err(Error::file(&path))?;
        // Other files in the folder stay.
        let _ = fs::remove_dir(&self.folder);
        Ok(())
    }

    /// Removes the frames of another film, unless it is unfinished.
    fn make_room(&self, before: &FilmIdentity) -> Result<(), Error> {
        let held = self.held(before.frames).count();
        if held > 0 && !before.done {
            return Err(Error::UnfinishedFilm {
                folder: self.folder.clone(),
                held,
                other: before.words.clone(),
                own: self.identity.words.clone(),
            });
        }
        self.clear(before.frames.max(self.frames()))
    }

    fn clear(&self, frames: u32) -> Result<(), Error> {
        for path in self.held(frames) {
            fs::remove_file(&path).map_err(Error::file(&path))?;
        }
        Ok(())
    }

    /// Paths of the existing ones among the first `frames` frames.
    fn held(&self, frames: u32) -> impl Iterator<Item = PathBuf> {
        let paths = (0..frames).map(|i| self.path(i));
        paths.filter(|path| path.is_file())
    }

    /// The identity of the film in the folder; `None` without one.
    fn before(&self) -> Result<Option<FilmIdentity>, Error> {
        let path = self.identity_path();
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(why) if why.kind() == ErrorKind::NotFound => return Ok(None),
            Err(why) => return Err(Error::file(&path)(why)),
        };
        match serde_json::from_str::<FilmIdentity>(&text) {
            Ok(film) if film.frames <= FRAMES_MAX => Ok(Some(film)),
            _ => Err(Error::Resume {
                path,
                reason: "it tells of no film".to_owned(),
            }),
        }
    }

    fn write_identity(&self) -> Result<(), Error> {
        let text = serde_json::to_string_pretty(&self.identity);
        // Named by range, as processes of other ranges may write the same file at the same time.
        let partial = format!(".job_{:04}.partial", self.range.first());
        let path = self.identity_path();
        let write = || {
            let mut file = WholeFile::claim_as(&path, self.folder.join(partial))?;
            writeln!(file, "{}", text?)?;
            file.commit()
        };
        write().map_err(Error::file(&path))
    }

    fn identity_path(&self) -> PathBuf {
        self.folder.join(IDENTITY_FILE)
    }

    fn path(&self, index: u32) -> PathBuf {
        self.folder.join(format!("frame_{index:04}.png"))
    }
}

/// Format of a film's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilmFormat {
    /// YUV4MPEG2, uncompressed, as video encoders read it: `.y4m`.
    Y4m,
    /// Animated PNG, lossless: `.png`.
    Apng,
}

impl FilmFormat {
    /// The format of a file name's extension.
    ///
    /// # Errors
    /// [`Error::FilmFormat`] for an unsupported extension.
    pub fn of(path: &Path) -> Result<Self, Error> {
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("y4m") => Ok(Self::Y4m),
            Some("png") => Ok(Self::Apng),
            _ => Err(Error::FilmFormat(path.to_owned())),
        }
    }
}

const IDENTITY_FILE: &str = "job.json";
/// Part of the identity, as another version of the library may trace different pixels.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Maximum number of frames, more than four hours at 60 per second: bounds the work that a damaged
/// `job.json` can cause.
pub(super) const FRAMES_MAX: u32 = 1 << 20;

#[cfg(test)]
mod tests {
    use carom_tracer::SceneUpdate;

    use super::*;

    const SIZE: ImageSize = ImageSize::new(4, 2);

    /// A film whose first camera stands at `eye`.
    fn film(eye: f32, samples: u32, frames: usize) -> FilmIdentity {
        let mut camera = carom_tracer::Scene::new().camera;
        camera.eye.y = eye;
        let mut updates = vec![SceneUpdate::default(); frames];
        updates[0].camera = Some(camera);
        let settings = RenderSettings {
            samples,
            ..RenderSettings::default()
        };
        let states = FilmStates::Updates(updates);
        FilmIdentity::of(SceneHash([7; 32]), SIZE, settings, 1.0, &states)
    }

    fn open(folder: &tempfile::TempDir, film: FilmIdentity) -> Result<FilmFrames, Error> {
        FilmFrames::open(folder.path(), film, SIZE, FrameRange::ALL)
    }

    fn frame(value: u8) -> Vec<u8> {
        vec![value; 3 * SIZE.pixels()]
    }

    #[test]
    fn a_film_goes_on_with_the_frames_that_are_there() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = open(&folder, film(0.5, 1, 4)).unwrap();
        first.keep(0, &frame(10)).unwrap();
        first.keep(2, &frame(30)).unwrap();
        let mut second = open(&folder, film(0.5, 1, 4)).unwrap();
        assert_eq!(second.missing().collect::<Vec<u32>>(), [1, 3]);
        assert_eq!(second.read(2).unwrap(), frame(30));
        second.keep(1, &frame(20)).unwrap();
        second.keep(3, &frame(40)).unwrap();
        assert_eq!((second.kept(), second.missing().count()), (4, 0));
        second.remove().unwrap();
        assert!(!folder.path().exists());
    }

    #[test]
    fn ranges_of_a_film_share_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let part = |range: &str| {
            let range = range.parse().unwrap();
            FilmFrames::open(folder.path(), film(0.5, 1, 4), SIZE, range).unwrap()
        };
        let (mut first, mut second) = (part("0-1"), part("2-3"));
        for (reel, frames) in [(&mut first, [0, 1]), (&mut second, [2, 3])] {
            assert_eq!(reel.missing().collect::<Vec<u32>>(), frames);
            for index in frames {
                reel.keep(index, &frame(index as u8)).unwrap();
            }
            assert_eq!((reel.kept(), reel.missing().count()), (2, 0));
        }
        let mut whole = open(&folder, film(0.5, 1, 4)).unwrap();
        assert_eq!(whole.missing().count(), 0);
        assert_eq!(whole.read(3).unwrap(), frame(3));
        whole.finish().unwrap();
        // A queue may run a job twice, also after the film is whole.
        assert_eq!(part("1-2").missing().count(), 0);
        assert_eq!(part("3").read(3).unwrap(), frame(3));
    }

    #[test]
    fn an_unfinished_film_is_never_lost_to_another_and_a_finished_one_makes_room() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = open(&folder, film(0.5, 1, 4)).unwrap();
        first.keep(0, &frame(1)).unwrap();
        for other in [film(0.6, 1, 4), film(0.5, 2, 4), film(0.5, 1, 5)] {
            let refused = open(&folder, other).unwrap_err().to_string();
            assert!(
                refused.contains("1 frames of an unfinished film"),
                "{refused}"
            );
        }
        first.finish().unwrap();
        let second = open(&folder, film(0.5, 2, 4)).unwrap();
        assert_eq!(second.kept(), 0);
        // The same film, asked for again after it was finished, is traced again.
        drop(second);
        let mut third = open(&folder, film(0.5, 2, 4)).unwrap();
        third.keep(1, &frame(1)).unwrap();
        third.finish().unwrap();
        let again = open(&folder, film(0.5, 2, 4)).unwrap();
        assert_eq!(again.kept(), 0);
    }

    #[test]
    fn pictures_of_unknown_origin_are_neither_taken_for_frames_nor_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frame_0001.png");
        let file = File::create(&path).unwrap();
        write_png(file, SIZE, &frame(9), COMPRESSION).unwrap();
        let before = fs::read(&path).unwrap();
        let refused = open(&folder, film(0.5, 1, 4)).unwrap_err();
        assert!(matches!(&refused, Error::ForeignFrame(of) if *of == path));
        assert_eq!(fs::read(&path).unwrap(), before);
        assert!(!FilmFrames::are_in(folder.path()));
        fs::write(folder.path().join("job.json"), "{}").unwrap();
        let error = open(&folder, film(0.5, 1, 4)).unwrap_err();
        assert!(error.to_string().contains("tells of no film"), "{error}");
    }

    #[test]
    fn a_damaged_frame_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut reel = open(&folder, film(0.5, 1, 2)).unwrap();
        reel.keep(0, &frame(7)).unwrap();
        let path = folder.path().join("frame_0000.png");
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() - 12 {
            fs::write(&path, &whole[..length]).unwrap();
            let error = format!("{:#}", reel.read(0).unwrap_err());
            assert!(error.contains("frame_0000.png is damaged"), "{error}");
        }
    }
}
