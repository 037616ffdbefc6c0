//! Cache of scene chunks in a folder: bounded, verified on reading, shared by the nodes of a machine.
//!
//! A chunk is a file named by the hash of its contents and replaced atomically, so nodes that share the
//! folder need no coordination: all write the same bytes under a name. The modification time of a file is
//! its last use. The least recently used files are evicted first, preceded by those with a time in the
//! future, left by a clock that has been corrected since. A file whose contents do not match its name is
//! removed.

use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime};

use carom_protocol::ChunkKey;
use carom_protocol::session::ChunkStore;

use crate::lock::lock;
use crate::whole_file::WholeFile;

/// Chunks of scenes in a folder. Other files in the folder are left alone.
#[derive(Debug)]
pub struct AssetCache {
    folder: PathBuf,
    bytes_max: u64,
    /// Bytes written since the folder was last scanned.
    written: Mutex<u64>,
    /// Whether a failure has been logged: a full disk is reported once, not per chunk.
    has_failed: AtomicBool,
}

impl AssetCache {
    /// Opens a cache of at most `bytes_max` bytes in `folder`, which is created if absent. The limit holds
    /// for up to eight nodes that share a folder; each further one may exceed it by 1/32.
    ///
    /// # Errors
    /// The I/O error if the folder cannot be created, read or written.
    pub fn open(folder: impl Into<PathBuf>, bytes_max: u64) -> io::Result<Self> {
        let folder = folder.into();
        fs::create_dir_all(&folder)?;
        match WholeFile::claim(&folder.join("writable")) {
            Err(why) if why.kind() != ErrorKind::AlreadyExists => return Err(why),
            _ => {} // claimed by another node, or this one, at this moment: then it is writable
        }
        let cache = Self {
            folder,
            bytes_max,
            written: Mutex::new(0),
            has_failed: AtomicBool::new(false),
        };
        cache.evict(0, SystemTime::now())?;
        Ok(cache)
    }

    /// `carom/assets` in the user's cache folder, `$XDG_CACHE_HOME` or `~/.cache` or the platform's
    /// equivalent, if there is one.
    #[cfg(feature = "cli")]
    pub fn user_folder() -> Option<PathBuf> {
        use etcetera::BaseStrategy as _;
        let folders = etcetera::choose_base_strategy().ok()?;
        Some(folders.cache_dir().join("carom").join("assets"))
    }

    fn path(&self, chunk: &ChunkKey) -> PathBuf {
        let hash = blake3::Hash::from_bytes(chunk.hash).to_hex();
        self.folder.join(format!("{hash}.{EXTENSION}"))
    }

    fn make_room(&self, bytes: u64) -> io::Result<()> {
        let mut written = lock(&self.written);
        *written += bytes;
        if *written > self.bytes_max / SCAN_PARTS {
            self.evict(bytes, SystemTime::now())?;
            *written = bytes;
        }
        Ok(())
    }

    /// Removes the least recently used chunks until three quarters of the limit are taken, including
    /// `bytes` to be written.
    fn evict(&self, bytes: u64, now: SystemTime) -> io::Result<()> {
        let latest = now + CLOCK_DIFFERENCE_MAX;
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            if !is_of_cache(&entry.file_name().to_string_lossy()) {
                continue;
            }
            // Another node may have removed it.
            let Ok(found) = entry.metadata() else {
                continue;
            };
            if found.is_file() {
                let used = found.modified().ok().filter(|used| *used <= latest);
                files.push((used, entry.path(), found.len()));
            }
        }
        // By time; `None`, for times in the future, sorts before all others.
        files.sort();
        let all: u64 = files.iter().map(|(_, _, bytes)| bytes).sum();
        // The remaining quarter is what eight nodes write, 1/32 each, before they scan again.
        let most = self.bytes_max / 4 * 3;
        let mut excess = (all + bytes).saturating_sub(most);
        for (_, path, bytes) in files {
            if excess == 0 {
                break;
            }
            match fs::remove_file(&path) {
                Err(why) if why.kind() != ErrorKind::NotFound => return Err(why),
                _ => excess = excess.saturating_sub(bytes),
            }
        }
        Ok(())
    }

    fn try_write(&self, chunk: &ChunkKey, bytes: &[u8]) -> io::Result<()> {
        if bytes.len() as u64 > self.bytes_max / 4 {
            return Ok(());
        }
        self.make_room(bytes.len() as u64)?;
        WholeFile::replace(&self.path(chunk), |file| file.write_all(bytes))
    }
}

impl ChunkStore for AssetCache {
    fn read(&self, chunk: &ChunkKey) -> Option<Vec<u8>> {
        let path = self.path(chunk);
        // Opened for writing, as Windows changes the times only of such files.
        let mut file = OpenOptions::new().read(true).write(true).open(&path).ok()?;
        // With another length it is corrupt, or the key is wrong; a new copy replaces it.
        if file.metadata().ok()?.len() != u64::from(chunk.bytes) {
            return None;
        }
        let _ = file.set_modified(SystemTime::now()); // a failure only makes it look older
        let mut bytes = vec![0; chunk.bytes as usize];
        if file.read_exact(&mut bytes).is_ok() && ChunkKey::of(&bytes) == *chunk {
            return Some(bytes);
        }
        tracing::warn!("{} is spoiled, and is removed", path.display());
        let _ = fs::remove_file(&path); // on failure, it is only read in vain again
        None
    }

    fn write(&self, chunk: &ChunkKey, bytes: &[u8]) {
        match self.try_write(chunk, bytes) {
            // Another node is writing the same chunk.
            Err(why) if why.kind() == ErrorKind::AlreadyExists => {}
            Err(why) if !self.has_failed.swap(true, Ordering::Relaxed) => tracing::warn!(
                "parts of scenes are not kept in {}: {why}",
                self.folder.display()
            ),
            _ => {}
        }
    }
}

/// Whether a file name is that of a chunk, or of a partial chunk left by a killed node.
fn is_of_cache(name: &str) -> bool {
    let name = name.strip_suffix(".partial").unwrap_or(name);
    let name = name.strip_prefix('.').unwrap_or(name);
    let hash = name
        .strip_suffix(EXTENSION)
        .and_then(|name| name.strip_suffix('.'));
    hash.is_some_and(|hash| hash.len() == 64 && hash.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

const EXTENSION: &str = "chunk";
/// Maximum by which a file server's clock may be ahead of this machine's.
const CLOCK_DIFFERENCE_MAX: Duration = Duration::from_secs(3600);
/// The folder is scanned each time that this part of its limit has been written.
const SCAN_PARTS: u64 = 32;

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn chunk(index: u8) -> (ChunkKey, Vec<u8>) {
        let bytes = vec![index; 1000];
        (ChunkKey::of(&bytes), bytes)
    }

    fn has(cache: &AssetCache, index: u8) -> bool {
        cache.read(&chunk(index).0).is_some()
    }

    fn bytes_in(folder: &Path) -> u64 {
        let files = fs::read_dir(folder).unwrap();
        files
            .map(|file| file.unwrap().metadata().unwrap().len())
            .sum()
    }

    #[test]
    fn chunks_outlast_the_cache_that_wrote_them() {
        let folder = tempfile::tempdir().unwrap();
        let (key, bytes) = chunk(1);
        let first = AssetCache::open(folder.path(), 1 << 20).unwrap();
        assert_eq!(first.read(&key), None);
        first.write(&key, &bytes);
        drop(first);
        let second = AssetCache::open(folder.path(), 1 << 20).unwrap();
        assert_eq!(second.read(&key), Some(bytes));
        assert!(!has(&second, 2));
    }

    #[test]
    fn the_bound_holds_for_nodes_that_share_a_folder_and_old_chunks_go_first() {
        let folder = tempfile::tempdir().unwrap();
        let open = || AssetCache::open(folder.path(), 32_000).unwrap();
        let (near, far) = (open(), open());
        let (key, bytes) = chunk(0);
        near.write(&key, &bytes);
        for index in 1..200 {
            let (key, bytes) = chunk(index);
            let cache = [&near, &far][usize::from(index) % 2];
            cache.write(&key, &bytes);
            assert!(bytes_in(folder.path()) <= 32_000, "chunk {index}");
            assert!(has(cache, index));
            assert!(has(&far, 0), "chunk {index}");
        }
        assert!(!has(&near, 1));
        assert!(has(&near, 190));
        // A smaller bound holds from the start.
        let smaller = AssetCache::open(folder.path(), 8_000).unwrap();
        assert!(bytes_in(folder.path()) <= 6_000);
        assert!(has(&smaller, 0));
    }

    #[test]
    fn chunks_of_a_clock_that_was_ahead_make_room() {
        let folder = tempfile::tempdir().unwrap();
        let cache = AssetCache::open(folder.path(), 32_000).unwrap();
        let now = SystemTime::now();
        let year = Duration::from_secs(365 * 86_400);
        let last_used = |index: u8, time: SystemTime| {
            let (key, bytes) = chunk(index);
            cache.write(&key, &bytes);
            let file = OpenOptions::new().write(true).open(cache.path(&key));
            file.unwrap().set_modified(time).unwrap();
        };
        (0..10).for_each(|index| last_used(index, now + year));
        (10..20).for_each(|index| last_used(index, now));
        // Half of the chunks are to be evicted.
        cache.evict(14_000, now).unwrap();
        let is_there = |index: &u8| cache.path(&chunk(*index).0).exists();
        assert_eq!(
            (0..20).filter(is_there).collect::<Vec<_>>(),
            (10..20).collect::<Vec<_>>()
        );
        // By a clock that is a year behind, all of them are in the future.
        cache.evict(14_000, now - year).unwrap();
        assert_eq!((0..20).filter(is_there).count(), 10);
    }

    #[test]
    fn spoiled_chunks_are_missing_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let cache = AssetCache::open(folder.path(), 4_000).unwrap();
        fs::write(folder.path().join("letter.txt"), vec![0; 9_000]).unwrap();
        let (key, bytes) = chunk(3);
        let path = cache.path(&key);
        for (spoilt, stays) in [(&b"short"[..], true), (&[9; 1000], false)] {
            cache.write(&key, &bytes);
            assert!(has(&cache, 3));
            fs::write(&path, spoilt).unwrap();
            assert!(!has(&cache, 3));
            assert_eq!(path.exists(), stays);
        }
        // A correct hash with a wrong length must do no harm.
        cache.write(&key, &bytes);
        let lie = ChunkKey { bytes: 999, ..key };
        assert_eq!(cache.read(&lie), None);
        assert!(has(&cache, 3));
        for index in 0..20 {
            let (key, bytes) = chunk(index);
            cache.write(&key, &bytes);
        }
        assert!(folder.path().join("letter.txt").exists());
        assert!(bytes_in(folder.path()) <= 13_000);
    }

    #[test]
    fn what_a_killed_node_left_is_removed_too() {
        let folder = tempfile::tempdir().unwrap();
        let (key, bytes) = chunk(4);
        let cache = AssetCache::open(folder.path(), 4_000).unwrap();
        let name = cache.path(&key);
        let name = name.file_name().unwrap().to_string_lossy();
        let partial = folder.path().join(format!(".{name}.partial"));
        fs::write(&partial, vec![0; 5_000]).unwrap();
        AssetCache::open(folder.path(), 4_000).unwrap();
        assert!(!partial.exists());
        cache.write(&key, &bytes);
        assert!(has(&cache, 4));
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, b"").unwrap();
        assert!(AssetCache::open(file, 4_000).is_err());
    }
}
