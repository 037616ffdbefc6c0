//! Finished frames in a folder, so that a film that was interrupted goes on.
//!
//! `job.json` says whose frames they are: a BLAKE3 hash of all that their pixels depend on. Each frame
//! is a PNG that is written beside its place and renamed, so that one that is there is whole.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use carom_tracer::{ImageSize, RenderSettings};
use serde::{Deserialize, Serialize};

use super::{FrameRange, ShotSequence, frame_bytes, write_png};
use crate::scene::scene_builder::EXPOSURE;

/// Whose frames a folder holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderJob {
    /// Of all that the frames' pixels depend on, in hexadecimal.
    hash: String,
    frames: u32,
    /// For people.
    words: String,
    /// Whether the film was finished.
    done: bool,
}

impl RenderJob {
    /// Of a film at a size, with settings.
    ///
    /// # Errors
    /// If a number of the scene cannot be written down.
    pub fn of(
        footage: &ShotSequence,
        size: ImageSize,
        settings: RenderSettings,
    ) -> anyhow::Result<Self> {
        let mut hash = blake3::Hasher::new();
        let scene = footage.stage().scene();
        serde_json::to_writer(&mut hash, &(VERSION, scene, size, settings, EXPOSURE))?;
        for frame in 0..footage.frames() {
            serde_json::to_writer(&mut hash, &footage.update(frame))?;
        }
        let (ImageSize { width, height }, frames) = (size, footage.frames());
        let RenderSettings { samples, seed, .. } = settings;
        let rate = footage.frames_per_sec();
        Ok(Self {
            hash: hash.finalize().to_hex().to_string(),
            frames,
            words: format!(
                "{frames} frames of {width}x{height}, {rate} a second, {samples} samples per pixel, \
                 seed {seed}"
            ),
            done: false,
        })
    }
}

/// The frames of a job.
#[derive(Debug)]
pub struct FrameCache {
    folder: PathBuf,
    job: RenderJob,
    size: ImageSize,
    kept: Vec<bool>,
    range: FrameRange,
}

impl FrameCache {
    /// Begins in a folder, which is made if there is none; or goes on with the frames of the same job
    /// that are there. Frames of a finished film make room.
    ///
    /// # Errors
    /// A sentence with the folder if it holds an unfinished film of another job, or cannot be used.
    pub fn open(folder: &Path, job: RenderJob, size: ImageSize) -> anyhow::Result<Self> {
        Self::open_range(folder, job, size, FrameRange::ALL)
    }

    /// The same for some of the frames, while others may be kept by other processes, also on other
    /// machines that share the folder. A part of a finished film that is asked for again is there.
    ///
    /// # Errors
    /// As [`FrameCache::open`].
    pub fn open_range(
        folder: &Path,
        job: RenderJob,
        size: ImageSize,
        range: FrameRange,
    ) -> anyhow::Result<Self> {
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
        let mut reel = Self {
            folder: folder.to_owned(),
            kept: vec![false; job.frames as usize],
            job,
            size,
            range,
        };
        let is_part = range != FrameRange::ALL;
        match reel.before()? {
            Some(before) if before == reel.job || is_part && before.hash == reel.job.hash => {
                reel.kept = (0..reel.job.frames)
                    .map(|i| reel.path(i).is_file())
                    .collect();
            }
            Some(before) => reel.make_room(&before)?,
            None => reel.clear(reel.job.frames)?,
        }
        reel.write_job()?;
        Ok(reel)
    }

    /// How many frames the film has.
    pub fn frames(&self) -> u32 {
        self.job.frames
    }

    /// Pixels across and down.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Where it is.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The frames of its range that are not there yet, in order.
    pub fn missing(&self) -> impl Iterator<Item = u32> {
        let in_range = (0..self.job.frames).filter(|&i| self.range.contains(i));
        in_range.filter(|&i| !self.kept[i as usize])
    }

    /// How many frames of its range are there.
    pub fn kept(&self) -> u32 {
        let kept = (0..).zip(&self.kept);
        kept.map(|(i, &kept)| u32::from(kept && self.range.contains(i)))
            .sum()
    }

    /// Keeps a frame of sRGB bytes, row by row.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn keep(&mut self, index: u32, rgb: &[u8]) -> anyhow::Result<()> {
        // Others may write theirs at the same time.
        let partial = self.folder.join(format!("frame_{index:04}.partial"));
        write_png(&partial, self.size, rgb)?;
        let path = self.path(index);
        fs::rename(&partial, &path).with_context(|| format!("cannot write {}", path.display()))?;
        self.kept[index as usize] = true;
        Ok(())
    }

    /// The sRGB bytes of a frame that is there.
    ///
    /// # Errors
    /// A sentence with the path if it is damaged, and what to do.
    pub fn read(&self, index: u32) -> anyhow::Result<Vec<u8>> {
        let path = self.path(index);
        let read = || -> anyhow::Result<Vec<u8>> {
            let file = BufReader::new(File::open(&path)?);
            let mut reader = png::Decoder::new(file).read_info()?;
            let (width, height) = reader.info().size();
            let expected = frame_bytes(self.size);
            ensure!(
                ImageSize::new(width, height) == self.size
                    && reader.output_buffer_size() == Some(expected),
                "it has another size"
            );
            let mut rgb = vec![0; expected];
            reader.next_frame(&mut rgb)?;
            Ok(rgb)
        };
        read().with_context(|| {
            format!(
                "{} is damaged: delete it and give the same command again",
                path.display()
            )
        })
    }

    /// Notes that the film is whole: the next job may take the folder.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn finish(&mut self) -> anyhow::Result<()> {
        self.job.done = true;
        self.write_job()
    }

    /// Removes the frames, and the folder if nothing else is in it.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn remove(self) -> anyhow::Result<()> {
        self.clear(self.job.frames)?;
        fs::remove_file(self.job_path())
            .with_context(|| format!("cannot remove {}", self.job_path().display()))?;
        // Whatever else somebody put there stays.
        let _ = fs::remove_dir(&self.folder);
        Ok(())
    }

    /// Throws the frames of another job away, unless it is not finished.
    fn make_room(&self, before: &RenderJob) -> anyhow::Result<()> {
        let held = (0..before.frames)
            .filter(|&i| self.path(i).is_file())
            .count();
        if held > 0 && !before.done {
            bail!(
                "{} holds {held} frames of an unfinished film of another kind ({}): its own command \
                 goes on with it; delete the folder, or name another, for this one ({})",
                self.folder.display(),
                before.words,
                self.job.words
            );
        }
        self.clear(before.frames.max(self.job.frames))
    }

    fn clear(&self, frames: u32) -> anyhow::Result<()> {
        for path in (0..frames)
            .map(|i| self.path(i))
            .filter(|path| path.is_file())
        {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        Ok(())
    }

    /// The job whose frames are there; none if nothing tells.
    fn before(&self) -> anyhow::Result<Option<RenderJob>> {
        let path = self.job_path();
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => {
                return Err(error).with_context(|| format!("cannot read {}", path.display()));
            }
        };
        let job: RenderJob = serde_json::from_str(&text).with_context(|| {
            format!(
                "{} tells of no film: delete it, or name another folder",
                path.display()
            )
        })?;
        ensure!(
            job.frames <= FRAMES_MAX,
            "{} tells of {} frames: delete it, or name another folder",
            path.display(),
            job.frames
        );
        Ok(Some(job))
    }

    fn write_job(&self) -> anyhow::Result<()> {
        let path = self.job_path();
        let partial = format!("job_{:04}.partial", self.range.first());
        let partial = self.folder.join(partial);
        let write = || -> anyhow::Result<()> {
            fs::write(&partial, serde_json::to_string_pretty(&self.job)? + "\n")?;
            Ok(fs::rename(&partial, &path)?)
        };
        write().with_context(|| format!("cannot write {}", path.display()))
    }

    fn job_path(&self) -> PathBuf {
        self.folder.join("job.json")
    }

    fn path(&self, index: u32) -> PathBuf {
        self.folder.join(format!("frame_{index:04}.png"))
    }
}

/// Another version of the program may trace other pixels.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// More than an hour's shot at the highest rate: bounds what a file can make the program look for.
const FRAMES_MAX: u32 = 1 << 20;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::video::VideoView;
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_scene::TableScene;
    use carom_billiards::physics::{Stroke, World};

    const SIZE: ImageSize = ImageSize::new(4, 2);

    fn job(speed_m_s: f64, samples: u32, frames: u32) -> RenderJob {
        let table = TableScene::table();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        let shot = world.strike(Stroke::straight(1.2, speed_m_s)).unwrap();
        let stage = TableScene::room(BallSet::Classic);
        let footage = ShotSequence::whole(stage, vec![shot], VideoView::Table, 30).cut(frames);
        let settings = RenderSettings {
            samples,
            ..RenderSettings::default()
        };
        RenderJob::of(&footage, SIZE, settings).unwrap()
    }

    fn frame(value: u8) -> Vec<u8> {
        vec![value; frame_bytes(SIZE)]
    }

    #[test]
    fn a_film_goes_on_with_the_frames_that_are_there() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = FrameCache::open(folder.path(), job(0.5, 1, 4), SIZE).unwrap();
        first.keep(0, &frame(10)).unwrap();
        first.keep(2, &frame(30)).unwrap();
        let mut second = FrameCache::open(folder.path(), job(0.5, 1, 4), SIZE).unwrap();
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
            FrameCache::open_range(folder.path(), job(0.5, 1, 4), SIZE, range).unwrap()
        };
        let (mut first, mut second) = (part("0-1"), part("2-3"));
        for (reel, frames) in [(&mut first, [0, 1]), (&mut second, [2, 3])] {
            assert_eq!(reel.missing().collect::<Vec<u32>>(), frames);
            for index in frames {
                reel.keep(index, &frame(index as u8)).unwrap();
            }
            assert_eq!((reel.kept(), reel.missing().count()), (2, 0));
        }
        let mut whole = FrameCache::open(folder.path(), job(0.5, 1, 4), SIZE).unwrap();
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
        let mut first = FrameCache::open(folder.path(), job(0.5, 1, 4), SIZE).unwrap();
        first.keep(0, &frame(1)).unwrap();
        for other in [job(0.6, 1, 4), job(0.5, 2, 4), job(0.5, 1, 5)] {
            let refused = FrameCache::open(folder.path(), other, SIZE)
                .unwrap_err()
                .to_string();
            assert!(
                refused.contains("1 frames of an unfinished film"),
                "{refused}"
            );
        }
        first.finish().unwrap();
        let second = FrameCache::open(folder.path(), job(0.5, 2, 4), SIZE).unwrap();
        assert_eq!(second.kept(), 0);
        // The same film, asked for again after it was finished, is traced again.
        drop(second);
        let mut third = FrameCache::open(folder.path(), job(0.5, 2, 4), SIZE).unwrap();
        third.keep(1, &frame(1)).unwrap();
        third.finish().unwrap();
        let again = FrameCache::open(folder.path(), job(0.5, 2, 4), SIZE).unwrap();
        assert_eq!(again.kept(), 0);
    }

    #[test]
    fn pictures_of_unknown_origin_are_not_taken_for_frames() {
        let folder = tempfile::tempdir().unwrap();
        write_png(&folder.path().join("frame_0001.png"), SIZE, &frame(9)).unwrap();
        let reel = FrameCache::open(folder.path(), job(0.5, 1, 4), SIZE).unwrap();
        assert_eq!(reel.kept(), 0);
        fs::write(folder.path().join("job.json"), "{}").unwrap();
        let error = FrameCache::open(folder.path(), job(0.5, 1, 4), SIZE).unwrap_err();
        assert!(error.to_string().contains("tells of no film"), "{error}");
    }

    #[test]
    fn a_damaged_frame_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut reel = FrameCache::open(folder.path(), job(0.5, 1, 2), SIZE).unwrap();
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
