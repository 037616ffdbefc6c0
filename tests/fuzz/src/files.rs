//! Files of the game: recorded shots and matches.

use std::path::Path;

use carom_billiards::game_match::MatchSave;
use carom_billiards::physics::Recording;

/// What is read can be written, and is then read as the same; its balls have a finite place at any time.
pub fn recording(bytes: &[u8]) {
    let Ok(recording) = Recording::from_bytes(bytes) else {
        return;
    };
    let written = recording
        .to_bytes()
        .expect("a recording that was read is valid");
    let again = Recording::from_bytes(&written).expect("a written recording is right");
    assert_eq!(again.to_bytes().expect("as before"), written);
    for clip in &recording.clips {
        for share in [0.0, 0.3, 1.0, 2.0] {
            for pose in clip.shot.poses_at(share * clip.shot.duration_secs()) {
                assert!(pose.position.is_finite(), "{pose:?}");
            }
        }
    }
}

/// What is read is a match that can be played to its end, or says at which step it cannot.
pub fn match_save(bytes: &[u8]) {
    if let Ok(save) = MatchSave::from_bytes(bytes) {
        let written = save
            .to_bytes()
            .expect("a match that was read is small enough");
        let again = MatchSave::from_bytes(&written).expect("a written match is right");
        assert_eq!(again.to_bytes().expect("as before"), written); // as bytes: NaN differs from itself
        if let Err(error) = save.play() {
            assert!(!error.to_string().is_empty());
        }
    }
}

/// Recordings of earlier versions.
pub fn recording_seeds() -> Vec<Vec<u8>> {
    stored("break_shot")
}

/// Matches of earlier versions.
pub fn match_save_seeds() -> Vec<Vec<u8>> {
    stored("match_")
}

fn stored(start: &str) -> Vec<Vec<u8>> {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let mut folders = tests.map(|folder| folder.join("game/billiards/tests/stored"));
    let folder = folders
        .find(|folder| folder.is_dir())
        .expect("the stored files");
    let files = std::fs::read_dir(folder).expect("readable");
    let mut paths: Vec<_> = files.map(|file| file.expect("readable").path()).collect();
    paths.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(start)
    });
    paths.sort();
    let read = paths.iter().map(std::fs::read);
    read.collect::<Result<_, _>>().expect("readable")
}
