//! The program without a window, from the outside: what it writes, says and returns.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

const FRAMES: usize = 3;

/// Runs the program in `folder` on the CPU alone, with no display and no leftover settings.
fn carom(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_carom"))
        .args(args)
        .current_dir(folder)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("CAROM_PRESENT")
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

fn render(folder: &Path, out: &str, seed: &str) -> Output {
    let rest = ["--out", out, "--seed", seed];
    carom(folder, &[&SMALL[..], &rest].concat())
}

/// Three small frames.
#[rustfmt::skip]
const SMALL: [&str; 9] =
    ["--headless", "--backend", "cpu", "--size", "96x54", "--spp", "2", "--frames", "3"];

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn decode(path: &Path) -> Vec<u8> {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap()))
        .read_info()
        .unwrap();
    assert_eq!(reader.info().size(), (96, 54));
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    pixels
}

fn frames(folder: &Path) -> Vec<Vec<u8>> {
    (0..FRAMES)
        .map(|i| decode(&folder.join(format!("frame_{i:04}.png"))))
        .collect()
}

/// The root of the mean squared distance from the mean, of all channels.
fn spread(pixels: &[u8]) -> f64 {
    let mean = |f: &dyn Fn(f64) -> f64| {
        pixels.iter().map(|&v| f(f64::from(v))).sum::<f64>() / pixels.len() as f64
    };
    let average = mean(&|v| v);
    mean(&|v| (v - average).powi(2)).sqrt()
}

#[test]
fn a_break_becomes_frames_animation_and_statistics() {
    let folder = tempfile::tempdir().unwrap();
    let output = render(folder.path(), "pictures", "1");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let last = text(&output.stdout).lines().last().unwrap().to_owned();
    assert!(
        last.contains("pictures"),
        "the last line names the folder: {last}"
    );

    let out = folder.path().join("pictures");
    let frames = frames(&out);
    assert!(
        frames.iter().all(|frame| spread(frame) > 20.0),
        "a table is no blank picture"
    );
    assert_ne!(frames[0], frames[FRAMES - 1], "the balls move");
    assert_animation(&out.join("break.png"), &frames);

    let stats: Value = serde_json::from_slice(&fs::read(out.join("stats.json")).unwrap()).unwrap();
    assert_stats(&stats);
}

#[test]
fn a_recorded_shot_gives_the_same_frames_again() {
    let folder = tempfile::tempdir().unwrap();
    let run = |rest: &[&str]| carom(folder.path(), &[&SMALL[..], rest].concat());
    fs::create_dir(folder.path().join("shots")).unwrap();
    fs::write(folder.path().join("shots/shot_0001.carom"), "earlier").unwrap();
    let played = run(&["--out", "played", "--record", "shots", "--seed", "5"]);
    assert!(played.status.success(), "{}", text(&played.stderr));
    let file = "shots/shot_0002.carom";
    let again = run(&["--out", "again", "--replay", file, "--seed", "5"]);
    assert!(again.status.success(), "{}", text(&again.stderr));
    assert_eq!(
        frames(&folder.path().join("played")),
        frames(&folder.path().join("again"))
    );

    fs::write(folder.path().join("torn.carom"), b"carom shot\n").unwrap();
    for (file, words) in [
        ("torn.carom", "ends within its version"),
        ("none.carom", "none.carom"),
        ("none.carom", "--replay takes a file"),
    ] {
        let refused = run(&["--out", "refused", "--replay", file]);
        assert_eq!(refused.status.code(), Some(1));
        assert!(
            text(&refused.stderr).contains(words),
            "{}",
            text(&refused.stderr)
        );
    }
}

/// A film of a break, `rest` telling where to.
fn film(folder: &Path, rest: &[&str]) -> Output {
    let small = ["--backend", "cpu", "--size", "96x54", "--frames", "3"];
    carom(folder, &[&small[..], rest].concat())
}

#[test]
fn a_film_is_the_same_frames_in_one_file() {
    let folder = tempfile::tempdir().unwrap();
    for out in ["film.y4m", "film.png", "film"] {
        let made = film(folder.path(), &["--spp", "1", "--video", out]);
        assert!(made.status.success(), "{}", text(&made.stderr));
        assert!(text(&made.stdout).contains(out), "{}", text(&made.stdout));
    }
    let frames = frames(&folder.path().join("film"));
    assert_animation(&folder.path().join("film.png"), &frames);
    let bytes = fs::read(folder.path().join("film.y4m")).unwrap();
    let line = bytes.iter().position(|&byte| byte == b'\n').unwrap();
    assert_eq!(bytes.len(), line + 1 + FRAMES * (6 + 3 * 96 * 54));
    assert!(text(&bytes[..line]).starts_with("YUV4MPEG2 W96 H54 F30:1 "));
    for (i, frame) in frames.iter().enumerate() {
        let at = line + 1 + i * (6 + 3 * 96 * 54);
        assert_eq!(bytes[at..at + 6], *b"FRAME\n");
        // BT.601's luma of the last pixel, which PNG tells by other code.
        let [r, g, b] = [3, 2, 1].map(|back| f64::from(frame[frame.len() - back]));
        let luma = 16.0 + (65.481 * r + 128.553 * g + 24.966 * b) / 255.0;
        let written = f64::from(bytes[at + 6 + 96 * 54 - 1]);
        assert!((written - luma).abs() <= 0.51, "{written} for {luma}");
    }
    let left: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 3, "no frames are left beside the films");
}

/// The streams of a video, as ffprobe tells them.
fn streams(video: &Path) -> String {
    let probe = Command::new("ffprobe")
        .args(["-v", "error", "-show_entries"])
        .arg("stream=codec_type,width,height,channels,nb_read_frames")
        .args(["-count_frames", "-of", "csv=p=0"])
        .arg(video)
        .output()
        .unwrap();
    text(&probe.stdout)
}

#[test]
fn a_compressed_video_has_the_frames_and_the_sound() {
    if Command::new("ffprobe").arg("-version").output().is_err() {
        assert!(std::env::var_os("CAROM_REQUIRE_FFMPEG").is_none());
        eprintln!("skipped: ffmpeg is not installed");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (out, video, has_sound) in [
        ("film.mp4", "video,96,54,3", true),
        ("film.mkv", "video,96,54", true),
        ("film.webm", "video,96,54", true),
        ("film.gif", "video,96,54,3", false),
    ] {
        let made = film(
            folder.path(),
            &["--spp", "1", "--video", out, "--view", "orbit"],
        );
        assert!(made.status.success(), "{}", text(&made.stderr));
        let streams = streams(&folder.path().join(out));
        assert!(streams.contains(video), "{out}: {streams}");
        assert_eq!(streams.contains("audio,2"), has_sound, "{out}: {streams}");
    }
    let left = fs::read_dir(folder.path()).unwrap();
    assert_eq!(left.count(), 4, "frames and partial files are gone");
}

#[test]
fn a_video_that_needs_ffmpeg_says_so_before_anything_is_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let refused = Command::new(env!("CARGO_BIN_EXE_carom"))
        .args(["--video", "film.mp4"])
        .current_dir(folder.path())
        .env("PATH", folder.path())
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("apt install ffmpeg"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn interrupted_videos_resume() {
    let folder = tempfile::tempdir().unwrap();
    let make = |spp: &str| film(folder.path(), &["--spp", spp, "--video", "film"]);
    assert!(make("1").status.success());
    let path = |name: &str| folder.path().join("film").join(name);
    let whole = frames(&folder.path().join("film"));
    // The state of a film that was interrupted in the third frame; the second one is replaced to recognise
    // it.
    let job = fs::read_to_string(path("job.json")).unwrap();
    let job = job.replace("\"done\": true", "\"done\": false");
    fs::write(path("job.json"), job).unwrap();
    fs::remove_file(path("frame_0002.png")).unwrap();
    fs::copy(path("frame_0000.png"), path("frame_0001.png")).unwrap();

    let refused = make("2");
    assert_eq!(refused.status.code(), Some(1));
    let said = text(&refused.stderr);
    for words in ["film holds 2 frames", "1 samples", "2 samples"] {
        assert!(said.contains(words), "{said}");
    }
    // An error that every run would repeat comes without a hint to continue.
    let nowhere = film(
        folder.path(),
        &["--spp", "1", "--video", "film", "--node", "foo"],
    );
    let said = text(&nowhere.stderr);
    assert!(
        said.contains("foo") && !said.contains("to continue"),
        "{said}"
    );
    let again = make("1");
    let said = text(&again.stderr);
    assert!(
        again.status.success() && said.contains("Resuming: 2 of 3"),
        "{said}"
    );
    let frames = frames(&folder.path().join("film"));
    assert_eq!(
        frames,
        [whole[0].clone(), whole[0].clone(), whole[2].clone()]
    );
    // A finished film is rendered anew.
    assert!(make("2").status.success());
}

#[test]
fn ranges_of_a_film_are_the_film() {
    let folder = tempfile::tempdir().unwrap();
    let make = |rest: &[&str]| film(folder.path(), &[&["--spp", "1"], rest].concat());
    assert!(make(&["--video", "whole.y4m"]).status.success());
    for range in ["2-9", "0-1"] {
        let made = make(&["--video", "parts.y4m", "--frame-range", range]);
        assert!(made.status.success(), "{}", text(&made.stderr));
    }
    let beyond = make(&["--video", "parts.y4m", "--frame-range", "3-5"]);
    assert_eq!(beyond.status.code(), Some(1));
    assert!(text(&beyond.stderr).contains("of 3 frames"));
    let put_together = make(&["--video", "parts.y4m"]);
    assert!(text(&put_together.stderr).contains("Resuming: 3 of 3"));
    let [whole, parts] = ["whole.y4m", "parts.y4m"];
    let bytes = |name| fs::read(folder.path().join(name)).unwrap();
    assert!(bytes(whole) == bytes(parts));
}

fn assert_animation(path: &Path, frames: &[Vec<u8>]) {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap()))
        .read_info()
        .unwrap();
    let animation = reader.info().animation_control.unwrap();
    assert_eq!(animation.num_frames as usize, FRAMES);
    for frame in frames {
        let mut pixels = vec![0; frame.len()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, *frame);
    }
}

fn assert_stats(stats: &Value) {
    let settings = &stats["settings"];
    assert_eq!(
        ["width", "height", "samples", "seed", "frames"].map(|key| settings[key].as_u64()),
        [96, 54, 2, 1, FRAMES as u64].map(Some)
    );
    let frames = stats["frames"].as_array().unwrap();
    assert_eq!(frames.len(), FRAMES);
    let mut moment = -1.0;
    for frame in frames {
        assert!(frame["makespan_secs"].as_f64().unwrap() > 0.0);
        // Pixels of this process are handed over, not encoded.
        assert_eq!(frame["payload_bytes"], 0);
        for key in ["reissued_tiles", "duplicate_tiles", "dropped_samples"] {
            assert!(frame[key].is_u64(), "{key}");
        }
        // 96 x 54 pixels are 3 x 2 tiles of 32.
        let tiles = frame["tiles_by_node"].as_array().unwrap();
        assert_eq!(
            tiles
                .iter()
                .map(|tiles| tiles.as_u64().unwrap())
                .sum::<u64>(),
            6
        );
        let next = frame["moment_secs"].as_f64().unwrap();
        assert!(next > moment);
        moment = next;
    }
    assert_eq!(stats["nodes"].as_array().unwrap().len(), 1);
    assert_eq!(stats["nodes"][0]["address"], "local");
    let totals = &stats["totals"];
    assert_eq!(totals["tiles_by_node"][0].as_u64(), Some(6 * FRAMES as u64));
    assert!(totals["wall_secs"].as_f64().unwrap() > 0.0);
}

#[test]
fn the_same_seed_gives_the_same_frames_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (out, seed) in [("a", "7"), ("b", "7"), ("c", "8")] {
        let output = render(folder.path(), out, seed);
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    let [a, b, c] = ["a", "b", "c"].map(|out| frames(&folder.path().join(out)));
    assert_eq!(a, b);
    assert_ne!(a, c);
}

#[test]
fn without_a_display_it_says_so_and_renders() {
    let folder = tempfile::tempdir().unwrap();
    let args = [
        "--backend",
        "cpu",
        "--size",
        "32x18",
        "--spp",
        "1",
        "--frames",
        "1",
    ];
    let output = carom(folder.path(), &args);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("rendering a break shot"));
    assert!(text(&output.stdout).contains("carom-frames holds 1 frame of 32x18"));
    let missing = carom(folder.path(), &["--replay", "no.carom"]);
    let said = text(&missing.stderr);
    assert!(
        said.contains("no.carom") && !said.contains("rendering"),
        "{said}"
    );
    assert!(folder.path().join("carom-frames/frame_0000.png").is_file());
}

#[test]
fn a_missing_display_names_what_to_install() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_carom"))
        .current_dir(folder.path())
        .env("DISPLAY", ":no-such-display")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("CAROM_PRESENT")
        .output()
        .unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    for word in [":no-such-display", "apt install", "--headless"] {
        assert!(said.contains(word), "{said}");
    }
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn wrong_arguments_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("wrong.toml"), "tile_edgy = 32\n").unwrap();
    let cases: [(&[&str], &str); 10] = [
        (&["--video", "film", "--frame-range", "9-3"], "0-9"),
        (&["--headless", "--frame-range", "0-3"], "--video"),
        (&["--video", "film.avi"], "ffmpeg"),
        (&["--video", "film.y4m", "--out", "frames"], "--out"),
        (&["--headless", "--size", "640"], "640"),
        (&["--headless", "--size", "0x9"], "0x9"),
        (&["--headless", "--frames", "0"], "0"),
        (&["--headless", "--spp", "lots"], "lots"),
        (&["--headless", "--config", "wrong.toml"], "wrong.toml"),
        (&["--sound"], "--sound"),
    ];
    for (args, named) in cases {
        let output = carom(folder.path(), args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(
            text(&output.stderr).contains(named),
            "{}",
            text(&output.stderr)
        );
        assert!(output.stdout.is_empty());
    }
}

/// Refused, with the name of the file, which stays as it is.
fn assert_kept(folder: &Path, file: &str, args: &[&str]) {
    let path = folder.join(file);
    fs::write(&path, "somebody's").unwrap();
    let output = carom(folder, args);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains(file) && said.contains("name another"),
        "{said}"
    );
    assert_eq!(fs::read(&path).unwrap(), b"somebody's");
    fs::remove_file(&path).unwrap();
}

#[test]
fn files_of_others_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("mine")).unwrap();
    let frames = [&SMALL[..], &["--out", "mine"]].concat();
    for file in ["mine/frame_0001.png", "mine/break.png", "mine/stats.json"] {
        assert_kept(folder, file, &frames);
    }
    assert_kept(folder, "shot.wav", &["sound"]);
    assert_kept(folder, "room.json", &["scene"]);
    fs::write(folder.join("named.wav"), "old").unwrap();
    let named = carom(folder, &["sound", "--out", "named.wav"]);
    assert!(named.status.success(), "{}", text(&named.stderr));
    assert!(fs::metadata(folder.join("named.wav")).unwrap().len() > 1000);
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    let output = render(folder.path(), "file/pictures", "1");
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("file/pictures"));
}
