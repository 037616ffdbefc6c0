//! The contents of a glTF file: its JSON, its buffers, and the files that it refers to.

use std::path::{Path, PathBuf};

use gltf_json::{Root, image, root};

use super::{Document, Fault, GLTF_BYTES_MAX, Refusal, find};
use crate::Error;
use crate::scene::file::{lies_beside, read_limited_file};
use crate::scene::image_texture::from_base64;

/// The JSON of a `.glb` or `.gltf` file, and the binary chunk of the former.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Refusal> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else {
        return Ok((bytes, None));
    };
    let (version, rest) = word(rest)?;
    if version != 2 {
        return Err(format!(
            "it is a GLB of version {version}: it must be of version 2"
        ));
    }
    // The total length, which the lengths of the chunks make redundant.
    let (_, rest) = word(rest)?;
    let (json, rest) = chunk(rest, *b"JSON")?;
    let json = json.ok_or("its first chunk is no JSON")?;
    let binary = if rest.is_empty() {
        None
    } else {
        chunk(rest, *b"BIN\0")?.0
    };
    Ok((json, binary))
}

fn word(bytes: &[u8]) -> Result<(u32, &[u8]), Refusal> {
    let (word, rest) = bytes.split_first_chunk().ok_or("its header is cut off")?;
    Ok((u32::from_le_bytes(*word), rest))
}

/// A chunk's bytes if it is of this kind, and the data after it.
fn chunk(bytes: &[u8], kind: [u8; 4]) -> Result<(Option<&[u8]>, &[u8]), Refusal> {
    let (length, rest) = word(bytes)?;
    let (found, rest) = word(rest)?;
    let (chunk, rest) = rest
        .split_at_checked(length as usize)
        .ok_or_else(|| format!("a chunk of {length} bytes is cut off after {}", rest.len()))?;
    let is_wanted = found == u32::from_le_bytes(kind);
    Ok((is_wanted.then_some(chunk), rest))
}

/// The contents of all buffers.
pub(super) fn buffers(
    root: &Root,
    binary: Option<&[u8]>,
    files: &mut Files,
) -> Result<Vec<Vec<u8>>, Fault> {
    let mut buffers = Vec::with_capacity(root.buffers.len());
    for (index, buffer) in root.buffers.iter().enumerate() {
        let bytes = match &buffer.uri {
            Some(uri) => files.resolve(uri, &format!("buffer {index}"))?,
            None if index == 0 => {
                (binary.ok_or("buffer 0 has neither a URI nor a binary chunk".to_owned())?).to_vec()
            }
            None => return Err(format!("buffer {index} has no URI").into()),
        };
        let wanted = buffer.byte_length.0;
        if (bytes.len() as u64) < wanted {
            let there = bytes.len();
            return Err(
                format!("buffer {index} is to have {wanted} bytes, but has {there}").into(),
            );
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The contents of an image file.
pub(super) fn image(
    document: &Document,
    index: root::Index<image::Image>,
    files: &mut Files,
) -> Result<Vec<u8>, Fault> {
    let place = index.value();
    let image = find(&document.root.images, place, "image")?;
    match (&image.uri, image.buffer_view) {
        (Some(uri), _) => files.resolve(uri, &format!("image {place}")),
        (None, Some(view)) => Ok(document.view(view, &format!("image {place}"))?.to_vec()),
        (None, None) => Err(format!("image {place} has neither a URI nor a buffer view").into()),
    }
}

/// Access to the files that a glTF file may refer to, with a limit on their total size.
pub(super) struct Files {
    /// Their folder; `None` if no files may be referred to.
    folder: Option<PathBuf>,
    bytes_left: u64,
}

impl Files {
    pub(super) fn beside(path: &Path) -> Self {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self {
            folder: Some(folder.to_owned()),
            bytes_left: GLTF_BYTES_MAX,
        }
    }

    pub(super) const fn none() -> Self {
        Self {
            folder: None,
            bytes_left: GLTF_BYTES_MAX,
        }
    }

    /// The contents of a `data:` URI or of a file beside the glTF file. `what` describes them in
    /// errors.
    fn resolve(&mut self, uri: &str, what: &str) -> Result<Vec<u8>, Fault> {
        let start: String = uri.chars().take(32).collect();
        if let Some(data) = uri.strip_prefix("data:") {
            let (_, base64) = data
                .split_once(";base64,")
                .ok_or_else(|| format!("{what}: its data is not in base64"))?;
            let bytes = from_base64(base64).map_err(|fault| format!("{what}: {fault}"))?;
            self.count(bytes.len() as u64)
                .ok_or_else(|| format!("{what}: {TOO_LONG}"))?;
            return Ok(bytes);
        }
        let Some(folder) = &self.folder else {
            return Err(format!(
                "{what} is in a file, `{start}`: open the glTF from a file beside it, or put all into one .glb"
            )
            .into());
        };
        let file = percent_decoded(uri);
        if !lies_beside(Path::new(&file)) || uri.contains("://") {
            return Err(format!(
                "{what} is at `{start}`: it must lie beside or below the glTF file"
            )
            .into());
        }
        let path = folder.join(&file);
        self.read(&path).map_err(Fault::File)
    }

    /// Reads a whole file.
    pub(super) fn read(&mut self, path: &Path) -> Result<Vec<u8>, Error> {
        let bytes = read_limited_file(path, self.bytes_left)?;
        self.count(bytes.len() as u64)
            .ok_or_else(|| Error::format(path, TOO_LONG))?;
        Ok(bytes)
    }

    fn count(&mut self, bytes: u64) -> Option<()> {
        self.bytes_left = self.bytes_left.checked_sub(bytes)?;
        Some(())
    }
}

const TOO_LONG: &str = "with it the glTF and the files that it names have more than 2 GiB";

fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let digits = after.get(..2).filter(|_| byte == b'%');
        let digits = digits.and_then(|digits| std::str::from_utf8(digits).ok());
        // A `%` without two hexadecimal digits stays as it is.
        match digits.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(decoded) => {
                bytes.push(decoded);
                rest = &after[2..];
            }
            None => {
                bytes.push(byte);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
