//! Textures and environment maps in files beside a scene file.

use std::path::Path;

use super::read_limited_file;
use crate::Error;
use crate::scene::{FileBytes, ImageSource, Scene};

/// Maximum total size of such files in bytes, enough for 4 GiB of texels as PNG files that hardly
/// compress.
const TEXTURE_FILES_BYTES_MAX: u64 = 2 << 30;

/// Replaces file names, which are relative to the scene file's folder, by the files' contents.
pub(super) fn read(scene: &mut Scene, scene_file: &Path) -> Result<(), Error> {
    let folder = scene_file.parent().unwrap_or(Path::new(""));
    let mut left = TEXTURE_FILES_BYTES_MAX;
    let map = scene.environment_map.iter_mut().map(|map| &mut map.image);
    let textures = scene.textures.iter_mut().map(|texture| &mut texture.image);
    for image in textures.chain(map) {
        let ImageSource::File(file) = image else {
            continue;
        };
        let bytes = read_named_file(&folder.join(file), left)?;
        left -= bytes.len() as u64;
        *image = ImageSource::Encoded(FileBytes(bytes));
    }
    Ok(())
}

/// Reads a file of at most `left` bytes.
pub(in crate::scene) fn read_named_file(path: &Path, left: u64) -> Result<Vec<u8>, Error> {
    let bytes = read_limited_file(path, left)?;
    if bytes.len() as u64 > left {
        return Err(Error::format(
            path,
            format!(
                "it and others that the scene names have more bytes than are allowed: {left} are left of them"
            ),
        ));
    }
    Ok(bytes)
}
