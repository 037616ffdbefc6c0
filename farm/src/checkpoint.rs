//! Checkpoints of a long render, from which it resumes after a crash: the film's sums so far.
//!
//! A file ([`CheckpointHeader::encode`]) is written under a temporary name and renamed, so that there is
//! always a complete one.

use std::fs::File;
use std::io::{self, BufReader, Read as _, Write as _};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use carom_protocol::SceneHash;
use carom_tracer::SceneUpdate;
use carom_tracer::film::Film;

use crate::checkpoint_format::{CheckpointHeader, bytes_max};
use crate::error::Error;
use crate::frame::FrameSpec;
use crate::whole_file::WholeFile;

/// The checkpoints of one render.
#[derive(Debug)]
pub(crate) struct Checkpoint {
    path: PathBuf,
    header: CheckpointHeader,
    period: Duration,
    written: Instant,
    /// Whether a failure to write has been logged.
    warned: bool,
}

impl Checkpoint {
    /// The checkpoints of a picture in the file `path`, at most one per `period`.
    pub(crate) fn new(path: PathBuf, scene: SceneHash, spec: &FrameSpec, period: Duration) -> Self {
        Self {
            path,
            header: CheckpointHeader::new(
                picture_hash(scene, &spec.update),
                spec.size,
                spec.settings,
            ),
            period,
            written: Instant::now(),
            warned: false,
        }
    }

    /// The film and its samples per pixel; `None` without a checkpoint.
    ///
    /// # Errors
    /// [`Error::Resume`] if the checkpoint is damaged or of another picture.
    pub(crate) fn resume(&mut self) -> Result<Option<(Film, u32)>, Error> {
        let bytes = match self.read() {
            Ok(bytes) => bytes,
            Err(why) if why.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(why) => return Err(self.refused(&why.to_string())),
        };
        let decoded = self.header.decode(&bytes);
        let (film, samples_done) = decoded.map_err(|reason| self.refused(reason))?;
        self.header.samples_done = samples_done;
        Ok(Some((film, samples_done)))
    }

    /// The bytes of the file, limited to the maximum size of this picture's checkpoint whatever the
    /// reported length: pipes and devices report none.
    fn read(&self) -> io::Result<Vec<u8>> {
        if !std::fs::metadata(&self.path)?.is_file() {
            return Err(io::Error::other("this is no plain file"));
        }
        let max = bytes_max(self.header.size);
        let mut bytes = Vec::new();
        let limited = File::open(&self.path)?.take(max as u64 + 1);
        BufReader::new(limited).read_to_end(&mut bytes)?;
        match bytes.len() <= max {
            true => Ok(bytes),
            false => Err(io::Error::other(format!(
                "this has more bytes than a checkpoint of this picture, which has {max} at most"
            ))),
        }
    }

    fn refused(&self, why: &str) -> Error {
        Error::Resume {
            path: self.path.clone(),
            reason: why.to_owned(),
        }
    }

    /// Writes the film if the last checkpoint is old enough. A failure does not end the render: the first
    /// one is logged as a warning.
    pub(crate) fn offer(&mut self, film: &Film, samples_done: u32) {
        self.header.samples_done = samples_done;
        if self.written.elapsed() < self.period {
            return;
        }
        if let Err(why) = self.write(film) {
            // Retried after another period, not with each frame.
            self.written = Instant::now();
            if !self.warned {
                tracing::warn!("the render goes on without a checkpoint: {why}");
            }
            self.warned = true;
        }
    }

    /// Writes the film to the checkpoint's place, or to the temporary folder if that fails, and returns the
    /// file.
    ///
    /// # Errors
    /// [`Error::File`] if neither place can be written.
    pub(crate) fn rescue(&mut self, film: &Film) -> Result<PathBuf, Error> {
        self.header.samples_done = self.header.settings.samples;
        let path = self.path.clone();
        if self.write(film).is_ok() {
            return Ok(path);
        }
        let name = path.file_name().unwrap_or_default();
        let elsewhere = std::env::temp_dir().join(name);
        self.path.clone_from(&elsewhere);
        let written = self.write(film);
        self.path = path;
        written.map(|()| elsewhere)
    }

    /// Writes the film.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be written.
    pub(crate) fn write(&mut self, film: &Film) -> Result<(), Error> {
        let failed = Error::file(&self.path);
        let bytes = self.header.encode(film).map_err(|why| failed(why.into()))?;
        let written = WholeFile::replace(&self.path, |file| {
            file.write_all(&bytes)?;
            file.sync()
        });
        written.map_err(failed)?;
        self.written = Instant::now();
        Ok(())
    }

    /// Deletes the file once the picture is complete.
    ///
    /// # Errors
    /// [`Error::File`] if it exists and cannot be deleted.
    pub(crate) fn remove(&self) -> Result<(), Error> {
        match std::fs::remove_file(&self.path) {
            Err(why) if why.kind() != io::ErrorKind::NotFound => Err(Error::file(&self.path)(why)),
            _ => Ok(()),
        }
    }
}

/// Hash of a scene in the state that is traced, in hexadecimal.
fn picture_hash(SceneHash(scene): SceneHash, update: &SceneUpdate) -> String {
    let hash = if *update == SceneUpdate::default() {
        blake3::Hash::from_bytes(scene)
    } else {
        // Rust's shortest round-trip format of a float identifies its value.
        blake3::hash(format!("{scene:?} {update:?}").as_bytes())
    };
    hash.to_hex().to_string()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use carom_protocol::PixelFormat;
    use carom_tracer::{ImageSize, RenderSettings, Scene, Tile};

    use super::*;

    const SIZE: ImageSize = ImageSize::new(5, 3);

    fn scene(eye: f32) -> Scene {
        let mut scene = Scene::new();
        scene.camera.eye.y = eye;
        scene
    }

    fn checkpoint(folder: &Path, eye: f32, samples: u32) -> Checkpoint {
        let spec = FrameSpec {
            update: SceneUpdate::default(),
            size: SIZE,
            settings: RenderSettings {
                samples,
                ..RenderSettings::default()
            },
            format: PixelFormat::LinearF32,
        };
        let path = folder.join("a.exr.checkpoint");
        Checkpoint::new(path, SceneHash::of(&scene(eye)), &spec, Duration::ZERO)
    }

    fn film() -> Film {
        let mut film = Film::new(SIZE);
        let all = Tile {
            x: 0,
            y: 0,
            width: 5,
            height: 3,
        };
        film.add(all, &[[0.1, 0.7, 1e9]; 15], 3).unwrap();
        film
    }

    #[test]
    fn a_render_resumes_from_its_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = checkpoint(folder.path(), 1.0, 16);
        assert!(first.resume().unwrap().is_none());
        first.offer(&film(), 3);
        let mut second = checkpoint(folder.path(), 1.0, 16);
        let (back, done) = second.resume().unwrap().unwrap();
        assert_eq!((back.to_bytes(), done), (film().to_bytes(), 3));
        second.remove().unwrap();
        second.remove().unwrap();
        assert!(second.resume().unwrap().is_none());
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0);
    }

    #[test]
    fn a_failed_checkpoint_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoint = checkpoint(folder.path(), 1.0, 16);
        // A folder of the checkpoint's name cannot be replaced by a file.
        std::fs::create_dir_all(checkpoint.path.join("full")).unwrap();
        checkpoint.offer(&film(), 3);
        assert!(checkpoint.warned);
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
    }

    #[test]
    fn a_film_is_rescued_where_there_is_room() {
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoint = checkpoint(folder.path(), 1.0, 16);
        std::fs::create_dir_all(checkpoint.path.join("full")).unwrap();
        let kept = checkpoint.rescue(&film()).unwrap();
        let (back, done) = checkpoint
            .header
            .decode(&std::fs::read(&kept).unwrap())
            .unwrap();
        std::fs::remove_file(kept).unwrap();
        assert_eq!((done, back.to_bytes()), (16, film().to_bytes()));
    }

    #[cfg(unix)]
    #[test]
    fn a_checkpoint_is_read_to_its_limit_and_written_through_no_link() {
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoint = checkpoint(folder.path(), 1.0, 16);
        let long = File::create(&checkpoint.path).unwrap();
        long.set_len(1 << 40).unwrap();
        let why = checkpoint.resume().unwrap_err().to_string();
        assert!(why.contains("16904 at most"), "{why}");
        std::fs::remove_file(&checkpoint.path).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &checkpoint.path).unwrap();
        let why = checkpoint.resume().unwrap_err().to_string();
        assert!(why.contains("no plain file"), "{why}");
        // A file under the hidden name may belong to somebody else.
        let own = folder.path().join("own");
        std::fs::write(&own, "own").unwrap();
        let hidden = folder.path().join(".a.exr.checkpoint.partial");
        std::os::unix::fs::symlink(&own, hidden).unwrap();
        checkpoint.write(&film()).unwrap_err();
        assert_eq!(std::fs::read(own).unwrap(), b"own");
    }

    #[test]
    fn foreign_and_damaged_checkpoints_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = checkpoint(folder.path(), 1.0, 16);
        first.offer(&film(), 3);
        let bytes = std::fs::read(&first.path).unwrap();
        for (eye, samples) in [(1.5, 16), (1.0, 17)] {
            let refused = checkpoint(folder.path(), eye, samples).resume();
            let why = refused.unwrap_err().to_string();
            assert!(
                why.contains("a.exr.checkpoint") && why.contains("another"),
                "{why}"
            );
        }
        for length in 0..bytes.len() {
            std::fs::write(&first.path, &bytes[..length]).unwrap();
            let why = first.resume().unwrap_err().to_string();
            assert!(why.contains("damaged"), "{why}");
        }
        let mut flipped = bytes;
        flipped[200] ^= 1;
        std::fs::write(&first.path, flipped).unwrap();
        assert!(first.resume().is_err());
    }
}
