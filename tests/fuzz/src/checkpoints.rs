//! Checkpoints of long renders.

use carom_farm::carom_tracer::film::Film;
use carom_farm::carom_tracer::{ImageSize, RenderSettings, Tile};
use carom_farm::checkpoint_format::{CheckpointHeader, with_hash};

/// Bytes, as they are and with the hash that they would have, are refused or are a film that is written and read as it
/// was, and whose picture is finite when the samples that were missing have been added.
pub fn checkpoint(bytes: &[u8]) {
    resumed(bytes);
    resumed(&with_hash(bytes.to_vec()));
}

fn resumed(bytes: &[u8]) {
    let mut header = header();
    let (mut film, samples_done) = match header.decode(bytes) {
        Ok(resumed) => resumed,
        Err(why) => return assert!(why.contains("this checkpoint is")),
    };
    header.samples_done = samples_done;
    let written = header.encode(&film).expect("a header");
    let (again, samples) = header.decode(&written).expect("a written checkpoint");
    assert_eq!((again.to_bytes(), samples), (film.to_bytes(), samples_done));
    let left = header.settings.samples - samples_done;
    film.add(WHOLE, &[[1.0; 3]; 6], left).expect("all pixels");
    film.count_dropped(left);
    assert!(film.samples_max() <= u64::from(header.settings.samples));
    for pixel in film.image().pixels {
        assert!(pixel.iter().all(|channel| channel.is_finite()), "{pixel:?}");
    }
}

/// Checkpoints of the picture without their hash: at its start, in the middle and at its end.
pub fn checkpoint_seeds() -> Vec<Vec<u8>> {
    let seed = |samples_done| {
        let mut header = header();
        let mut film = Film::new(header.size);
        let radiance = [[0.1, 0.7, 1e9]; 6];
        film.add(WHOLE, &radiance, samples_done)
            .expect("all pixels");
        header.samples_done = samples_done;
        let mut bytes = header.encode(&film).expect("a header");
        bytes.truncate(bytes.len() - 32);
        bytes
    };
    [0, 3, 16].map(seed).into()
}

/// Of the one picture whose checkpoints are read.
fn header() -> CheckpointHeader {
    let settings = RenderSettings {
        samples: 16,
        ..RenderSettings::default()
    };
    CheckpointHeader::new("0123".to_owned(), ImageSize::new(3, 2), settings)
}

/// The whole picture.
const WHOLE: Tile = Tile {
    x: 0,
    y: 0,
    width: 3,
    height: 2,
};
