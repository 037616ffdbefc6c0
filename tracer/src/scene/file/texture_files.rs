//! Textures and environment maps that lie in files beside a scene file.

use std::path::Path;

use super::read_limited_file;
use crate::Error;
use crate::scene::{FileBytes, ImageSource, Scene};

/// The most bytes that such files have together: 4 GiB of texels as PNG files that hardly shrink.
const TEXTURE_FILES_BYTES_MAX: u64 = 2 << 30;

/// Puts the bytes of files in place of their names, which are relative to the folder of the scene file.
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

/// A file of at most `left` bytes.
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
