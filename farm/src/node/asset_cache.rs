//! Cache of scenes' chunks in a folder: bounded, checked when it is read, shared by the nodes of a machine.
//!
//! A chunk is a file, named by the hash of its bytes and written whole, so nodes that share the folder need no
//! agreement: whoever writes a chunk writes the same. When a file was last used stands in its time of modification;
//! what was not used for longest goes first. A file that does not hash to its name is removed, and is missing.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use carom_protocol::ChunkKey;
use carom_protocol::session::ChunkStore;

use crate::whole_file::WholeFile;

/// Chunks of scenes in a folder. Other files in there are left alone.
#[derive(Debug)]
pub struct AssetCache {
    folder: PathBuf,
    bytes_max: u64,
    /// Bytes written since the folder was last looked through.
    written: Mutex<u64>,
}

impl AssetCache {
    /// A cache of at most `bytes_max` bytes in `folder`, which is made if it is not there. The bound holds for up to
    /// eight nodes that share a folder; each one beyond may exceed it by a thirty-second.
    ///
    /// # Errors
    /// The system's, if the folder cannot be made, read or written.
    pub fn open(folder: impl Into<PathBuf>, bytes_max: u64) -> io::Result<Self> {
        let folder = folder.into();
        fs::create_dir_all(&folder)?;
        match WholeFile::claim(&folder.join("writable")) {
            Err(why) if why.kind() != ErrorKind::AlreadyExists => return Err(why),
            _ => {} // written by another node at this moment, or by this one
        }
        let cache = Self {
            folder,
            bytes_max,
            written: Mutex::new(0),
        };
        cache.evict(0)?;
        Ok(cache)
    }

    /// `carom/assets` in the user's folder for caches: `$XDG_CACHE_HOME` or `~/.cache` and the like, if the platform
    /// has one.
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

    /// The chunk's file, used now; a file of another length is removed.
    fn open_chunk(&self, chunk: &ChunkKey) -> Option<File> {
        let path = self.path(chunk);
        // Windows changes times of files alone that may be written.
        let file = OpenOptions::new().read(true).write(true).open(&path).ok()?;
        if file.metadata().ok()?.len() != u64::from(chunk.bytes) {
            remove_spoiled(&path);
            return None;
        }
        let _ = file.set_modified(SystemTime::now()); // at worst it goes too early
        Some(file)
    }

    fn make_room(&self, bytes: u64) -> io::Result<()> {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        *written += bytes;
        if *written > self.bytes_max / SCAN_PARTS {
            self.evict(bytes)?;
            *written = bytes;
        }
        Ok(())
    }

    /// Removes the chunks that were not used for longest until with so many bytes more three quarters are taken.
    fn evict(&self, bytes: u64) -> io::Result<()> {
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
                let used = found.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                files.push((used, entry.path(), found.len()));
            }
        }
        files.sort();
        let all: u64 = files.iter().map(|(_, _, bytes)| bytes).sum();
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
    fn contains(&self, chunk: &ChunkKey) -> bool {
        self.open_chunk(chunk).is_some()
    }

    fn read(&self, chunk: &ChunkKey) -> Option<Vec<u8>> {
        let file = self.open_chunk(chunk)?;
        let mut bytes = Vec::with_capacity(chunk.bytes as usize);
        let read = file.take(u64::from(chunk.bytes)).read_to_end(&mut bytes);
        if read.is_ok() && ChunkKey::of(&bytes) == *chunk {
            return Some(bytes);
        }
        remove_spoiled(&self.path(chunk));
        None
    }

    fn write(&self, chunk: &ChunkKey, bytes: &[u8]) {
        match self.try_write(chunk, bytes) {
            // Another node is writing the same.
            Err(why) if why.kind() == ErrorKind::AlreadyExists => {}
            Err(why) => tracing::warn!(
                "a part of a scene is not kept in {}: {why}",
                self.folder.display()
            ),
            Ok(()) => {}
        }
    }
}

fn remove_spoiled(path: &Path) {
    tracing::warn!("{} is spoiled, and is removed", path.display());
    if let Err(why) = fs::remove_file(path) {
        tracing::debug!("{}: {why}", path.display());
    }
}

/// Whether a file of that name is a chunk, or what a killed node has left of one.
fn is_of_cache(name: &str) -> bool {
    let name = name.strip_suffix(".partial").unwrap_or(name);
    let name = name.strip_prefix('.').unwrap_or(name);
    let hash = name
        .strip_suffix(EXTENSION)
        .and_then(|name| name.strip_suffix('.'));
    hash.is_some_and(|hash| hash.len() == 64 && hash.bytes().all(|byte| byte.is_ascii_hexdigit()))
}

const EXTENSION: &str = "chunk";
/// The folder is looked through when one of so many parts of it has been written.
const SCAN_PARTS: u64 = 32;

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(index: u8) -> (ChunkKey, Vec<u8>) {
        let bytes = vec![index; 1000];
        (ChunkKey::of(&bytes), bytes)
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
        assert!(!first.contains(&key) && first.read(&key).is_none());
        first.write(&key, &bytes);
        drop(first);
        let second = AssetCache::open(folder.path(), 1 << 20).unwrap();
        assert!(second.contains(&key));
        assert_eq!(second.read(&key), Some(bytes));
        assert!(!second.contains(&chunk(2).0));
    }

    #[test]
    fn the_bound_holds_for_nodes_that_share_a_folder_and_old_chunks_go_first() {
        let folder = tempfile::tempdir().unwrap();
        let open = || AssetCache::open(folder.path(), 32_000).unwrap();
        let (near, far) = (open(), open());
        let (used, bytes) = chunk(0);
        near.write(&used, &bytes);
        for index in 1..200 {
            let (key, bytes) = chunk(index);
            let cache = [&near, &far][usize::from(index) % 2];
            cache.write(&key, &bytes);
            assert!(bytes_in(folder.path()) <= 32_000, "chunk {index}");
            assert!(cache.contains(&key));
            assert!(far.contains(&used), "chunk {index}");
        }
        assert!(!near.contains(&chunk(1).0));
        assert!(near.contains(&chunk(190).0));
        // A smaller bound holds from the start.
        let smaller = AssetCache::open(folder.path(), 8_000).unwrap();
        assert!(bytes_in(folder.path()) <= 6_000);
        assert!(smaller.contains(&used));
    }

    #[test]
    fn spoiled_chunks_are_removed_and_other_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let cache = AssetCache::open(folder.path(), 4_000).unwrap();
        fs::write(folder.path().join("letter.txt"), vec![0; 9_000]).unwrap();
        for spoil in [&b"short"[..], &[9; 1000]] {
            let (key, bytes) = chunk(3);
            cache.write(&key, &bytes);
            let path = cache.path(&key);
            fs::write(&path, spoil).unwrap();
            assert_eq!(cache.read(&key), None);
            assert!(!path.exists() && !cache.contains(&key));
        }
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
        assert!(cache.contains(&key));
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, b"").unwrap();
        assert!(AssetCache::open(file, 4_000).is_err());
    }
}
