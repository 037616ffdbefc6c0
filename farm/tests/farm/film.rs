//! Laws of films: frames of a scene in a folder, that are traced once and whoever traces them.

use std::path::Path;

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use carom_farm::{Film, FilmFrames, FilmState, FrameRange, LocalNode, Still};
use carom_tracer::{Camera, Material, Plane, Sphere};

use super::*;

const SIZE: ImageSize = ImageSize::new(32, 18);

fn local() -> Farm {
    let config = FarmConfig {
        local: LocalNode::Cpu,
        ..FarmConfig::default()
    };
    Farm::new(config).unwrap()
}

/// A ball and its shadow.
fn ball() -> Scene {
    let mut scene = Scene::new();
    scene.add(Sphere::new(0.5).at([0.3, 0.0, 0.0]), Material::grey(0.3));
    scene.add(Plane::z(-0.5), Material::grey(0.6));
    scene
}

fn orbit(frame: u32) -> SceneUpdate {
    let angle = 0.2 * frame as f32;
    let eye = [3.0 * angle.sin(), -3.0 * angle.cos(), 1.5];
    SceneUpdate::default().camera(Camera::looking_at(eye, [0.0; 3]))
}

fn film(frames: u32) -> Film {
    Film::new(SIZE.width, SIZE.height, (0..frames).map(orbit)).samples(4)
}

fn trace(film: Film, folder: &Path) -> FilmFrames {
    local().film(&ball(), film, folder).unwrap().wait().unwrap()
}

fn pixels(frames: &FilmFrames) -> Vec<Vec<u8>> {
    let all = 0..frames.frames();
    all.map(|frame| frames.read(frame).unwrap()).collect()
}

fn still(frame: u32, samples: u32) -> Vec<u8> {
    let still = Still::new(SIZE.width, SIZE.height).samples(samples);
    let picture = local().render(&ball(), still.update(orbit(frame)));
    let rgba = picture.unwrap().rgba8();
    rgba.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect()
}

#[test]
fn frames_of_a_film_are_stills() {
    let folder = tempfile::tempdir().unwrap();
    let frames = pixels(&trace(film(3), folder.path()));
    for (index, frame) in (0..).zip(&frames) {
        assert!(*frame == still(index, 4), "frame {index}");
    }
    assert!(frames[0] != frames[2], "the camera moves");
}

#[test]
fn frames_of_many_samples_are_summed() {
    let folder = tempfile::tempdir().unwrap();
    let frames = trace(film(1).samples(1500), folder.path());
    let (film, still) = (frames.read(0).unwrap(), still(0, 1500));
    // Sums of other batches differ by rounding.
    let differs = film.iter().zip(&still).filter(|(a, b)| a.abs_diff(**b) > 1);
    assert_eq!(differs.count(), 0);
}

#[test]
fn ranges_of_a_film_are_parts_of_the_same_bits() {
    let (whole, parts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let whole = trace(film(4), whole.path());
    for range in ["0-1", "2", "3-9"] {
        let range: FrameRange = range.parse().unwrap();
        trace(film(4).range(range), parts.path());
    }
    let mut farm = local();
    let job = farm.film(&ball(), film(4), parts.path()).unwrap();
    assert_eq!(job.resumed_frames(), 4);
    let parts = job.wait().unwrap();
    assert!(pixels(&parts) == pixels(&whole));
}

#[test]
fn a_film_that_is_cancelled_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let mut farm = local();
    let (sender, first) = std::sync::mpsc::channel();
    let watched = film(40).samples(64).on_progress(move |progress| {
        if progress.frames_done > 0 {
            let _ = sender.send(progress.frames_done);
        }
    });
    let job = farm.film(&ball(), watched, folder.path()).unwrap();
    first.recv().unwrap();
    job.cancel();
    let kept = match job.wait() {
        Err(Error::FilmCancelled { frames_done, .. }) => frames_done,
        other => panic!("{other:?}"),
    };
    assert!(kept > 0);
    let again = film(40).samples(64);
    let job = farm.film(&ball(), again, folder.path()).unwrap();
    assert_eq!(job.resumed_frames(), kept);
    assert_eq!(job.wait().unwrap().missing().count(), 0);
    let other = farm.film(&ball(), film(39), folder.path()).unwrap_err();
    assert!(
        matches!(other, Error::UnfinishedFilm { held: 40, .. }),
        "{other}"
    );
}

#[test]
fn a_film_that_cannot_be_traced_is_refused_with_its_values() {
    let folder = tempfile::tempdir().unwrap();
    let mut farm = local();
    let mut refused = |film: Film| {
        let why = farm.film(&ball(), film, folder.path()).unwrap_err();
        assert!(why.is_invalid_input(), "{why}");
        why.to_string()
    };
    let range: FrameRange = "5-9".parse().unwrap();
    for (film, words) in [
        (film(0), "film of 0 frames"),
        (film(3).range(range), "begins with frame 5"),
        (film(3).samples(0), "0"),
        (film(3).exposure(f32::NAN), "NaN"),
        (Film::new(0, 18, [orbit(0)]), "0x18"),
    ] {
        let why = refused(film);
        assert!(why.contains(words), "{why}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    let silent = FarmConfig {
        local: LocalNode::None,
        timeout_secs: Some(1),
        ..FarmConfig::default()
    };
    let frames = folder.path().join("frames");
    let job = Farm::new(silent).unwrap().film(&ball(), film(2), &frames);
    assert!(job.unwrap().wait().is_err());
    assert!(!frames.exists(), "nothing was begun");
}

/// The ball of [`ball`], which grows.
fn grown(frame: u32) -> Scene {
    let mut scene = Scene::new();
    let radius = 0.2 + 0.1 * frame as f32;
    scene.add(Sphere::new(radius).at([0.3, 0.0, 0.0]), Material::grey(0.3));
    scene.add(Plane::z(-0.5), Material::grey(0.6));
    scene
}

/// A film of scenes of its own, but for the second frame, and how many of them were made; the last cannot be.
fn growth(key: &str, frames: usize, made: &Arc<AtomicU32>) -> Film {
    let made = Arc::clone(made);
    let make = move |frame: u32| {
        made.fetch_add(1, Ordering::Relaxed);
        if frame == 4 {
            return Err(Error::FrameRange("it cannot be drawn".to_owned()));
        }
        Ok(FilmState {
            scene: (frame != 1).then(|| Arc::new(grown(frame))),
            update: orbit(frame),
        })
    };
    Film::of_states(SIZE.width, SIZE.height, frames, key.to_owned(), make).samples(4)
}

#[test]
fn a_film_of_scenes_has_them_made_once_and_keeps_what_was_traced() {
    let folder = tempfile::tempdir().unwrap();
    let made = Arc::new(AtomicU32::new(0));
    let mut farm = local();
    // Nodes that are at work are told of each scene.
    let still = Still::new(SIZE.width, SIZE.height).samples(1);
    farm.render(&ball(), still).unwrap();
    let film = |key| growth(key, 5, &made);
    let job = farm.film(&ball(), film("growth"), folder.path()).unwrap();
    let why = job.wait().unwrap_err().to_string();
    assert!(why.contains("it cannot be drawn"), "{why}");
    assert_eq!(made.swap(0, Ordering::Relaxed), 5);
    let range: FrameRange = "0-3".parse().unwrap();
    let again = film("growth").range(range);
    let job = farm.film(&ball(), again, folder.path()).unwrap();
    let resumed = job.resumed_frames();
    let frames = job.wait().unwrap();
    assert_eq!(resumed + made.load(Ordering::Relaxed), 4);
    for frame in 0..4 {
        let scene = if frame == 1 { ball() } else { grown(frame) };
        let still = Still::new(SIZE.width, SIZE.height).samples(4);
        let picture = farm.render(&scene, still.update(orbit(frame))).unwrap();
        let rgba = picture.rgba8();
        let rgb: Vec<u8> = rgba.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
        assert!(frames.read(frame).unwrap() == rgb, "frame {frame}");
    }
    let other = farm.film(&ball(), film("another"), folder.path());
    assert!(matches!(other, Err(Error::UnfinishedFilm { .. })));
}
