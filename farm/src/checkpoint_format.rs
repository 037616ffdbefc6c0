//! File format of checkpoints: one line of JSON that identifies the picture, the film's bytes, and a BLAKE3 hash
//! of both.

use carom_tracer::film::Film;
use carom_tracer::{ImageSize, RenderSettings};
use serde::{Deserialize, Serialize};

/// Identity of a checkpoint's picture, and its progress.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckpointHeader {
    /// Version of the file format.
    version: u32,
    /// Hash of the scene, in hexadecimal.
    scene: String,
    /// Columns and rows.
    pub size: ImageSize,
    /// Settings of the whole picture.
    pub settings: RenderSettings,
    /// Samples per pixel in the sums.
    pub samples_done: u32,
}

const VERSION: u32 = 1;
const HASH_BYTES: usize = 32;
/// Maximum bytes of the JSON line, which has some 500.
const HEADER_BYTES_MAX: usize = 16 << 10;
const DAMAGED: &str = "this checkpoint is damaged";

/// Maximum bytes of a checkpoint of a picture of this size.
pub const fn bytes_max(size: ImageSize) -> usize {
    HEADER_BYTES_MAX + Film::bytes_of(size) + HASH_BYTES
}

impl CheckpointHeader {
    /// The header of a picture without samples.
    pub const fn new(scene: String, size: ImageSize, settings: RenderSettings) -> Self {
        Self {
            version: VERSION,
            scene,
            size,
            settings,
            samples_done: 0,
        }
    }

    /// The bytes of a checkpoint.
    ///
    /// # Errors
    /// Those of the JSON library; none is known.
    pub fn encode(&self, film: &Film) -> serde_json::Result<Vec<u8>> {
        let mut content = serde_json::to_vec(self)?;
        content.push(b'\n');
        content.extend(film.to_bytes());
        Ok(with_hash(content))
    }

    /// The film in the bytes of a checkpoint of this header's picture, and its samples per pixel.
    ///
    /// # Errors
    /// The fault of the bytes.
    pub fn decode(&self, bytes: &[u8]) -> Result<(Film, u32), &'static str> {
        let content = bytes.len().checked_sub(HASH_BYTES).ok_or(DAMAGED)?;
        let (content, hash) = bytes.split_at(content);
        if blake3::hash(content).as_bytes() != hash {
            return Err(DAMAGED);
        }
        let line = content.iter().position(|&byte| byte == b'\n');
        let (line, film) = content.split_at(line.ok_or(DAMAGED)?);
        let found: Self = serde_json::from_slice(line).map_err(|_| DAMAGED)?;
        let samples_done = found.samples_done;
        let same = Self {
            samples_done,
            ..self.clone()
        };
        if found != same || samples_done > self.settings.samples {
            return Err("this checkpoint is of another scene, size or number of samples");
        }
        let film = Film::from_bytes(self.size, &film[1..]).ok_or(DAMAGED)?;
        // The hash is not keyed, so sums that no render produces are possible and must be rejected.
        match film.samples_max() <= u64::from(samples_done) {
            true => Ok((film, samples_done)),
            false => Err(DAMAGED),
        }
    }
}

/// Appends the BLAKE3 hash of a header and a film's bytes to them.
pub fn with_hash(mut content: Vec<u8>) -> Vec<u8> {
    let hash = blake3::hash(&content);
    content.extend(hash.as_bytes());
    content
}

#[cfg(test)]
mod tests {
    use carom_tracer::Tile;

    use super::*;

    /// A checkpoint whose hash is right resumes only from sums that samples can have: others would overflow when more
    /// are added, or end in a picture that is not finite.
    #[test]
    fn sums_that_no_render_has_are_refused() {
        let size = ImageSize::new(1, 1);
        let settings = RenderSettings {
            samples: 16,
            ..RenderSettings::default()
        };
        let header = CheckpointHeader {
            samples_done: 3,
            ..CheckpointHeader::new(String::new(), size, settings)
        };
        let whole = Tile {
            x: 0,
            y: 0,
            width: 1,
            height: 1,
        };
        let bytes_of = |samples| {
            let mut film = Film::new(size);
            film.add(whole, &[[0.5; 3]], samples).unwrap();
            header.encode(&film).unwrap()
        };
        assert_eq!(header.decode(&bytes_of(3)).unwrap().1, 3);
        assert_eq!(header.decode(&bytes_of(4)).unwrap_err(), DAMAGED);
        let right = bytes_of(3);
        let sum = right.len() - HASH_BYTES - 32;
        for wrong in [f64::NAN, f64::INFINITY, 1e300] {
            let mut content = right[..right.len() - HASH_BYTES].to_vec();
            content[sum..sum + 8].copy_from_slice(&wrong.to_le_bytes());
            assert_eq!(header.decode(&with_hash(content)).unwrap_err(), DAMAGED);
        }
    }
}
