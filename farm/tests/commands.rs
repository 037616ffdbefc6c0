//! The program `carom-farm` end to end: refusals, and a farm from `init` to a picture.

use std::fs::File;
use std::io::{BufRead, BufReader, Lines};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Output, Stdio};

use carom_tracer::RadianceImage;
use serde_json::{Value, json};
use tempfile::TempDir;

const POOL: &str = include_str!("../../assets/scenes/pool.json");

fn carom_farm(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .args(args)
        .current_dir(dir)
        .env("XDG_CACHE_HOME", dir)
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

/// The message with which the program refuses its input; panics if it accepts it.
fn refused(dir: &Path, args: &[&str]) -> String {
    let output = carom_farm(dir, args);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
    assert!(!said.contains("panicked"), "{args:?}: {said}");
    assert!(output.stdout.is_empty(), "{args:?}");
    said
}

fn done(dir: &Path, args: &[&str]) -> String {
    let output = carom_farm(dir, args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

/// The pool scene with one value changed, as a file.
fn spoiled(dir: &Path, name: &str, spoil: impl FnOnce(&mut Value)) -> PathBuf {
    let mut scene: Value = serde_json::from_str(POOL).unwrap();
    spoil(&mut scene);
    let path = dir.join(name);
    std::fs::write(&path, scene.to_string()).unwrap();
    path
}

fn first_sphere(scene: &mut Value) -> &mut Value {
    let objects = scene["objects"].as_array_mut().unwrap();
    let sphere = |object: &&mut Value| !object["shape"]["sphere"].is_null();
    &mut objects.iter_mut().find(sphere).unwrap()["shape"]["sphere"]
}

fn first_plastic(scene: &mut Value) -> &mut Value {
    let materials = scene["materials"].as_object_mut().unwrap();
    let plastic = |material: &&mut Value| !material["smooth_plastic"].is_null();
    &mut materials.values_mut().find(plastic).unwrap()["smooth_plastic"]
}

#[test]
fn invalid_scenes_are_refused_with_the_place() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let not_a_number = POOL.replacen("44.0", "NaN", 1).replacen("44,", "NaN,", 1);
    std::fs::write(dir.join("nan.json"), not_a_number).unwrap();
    spoiled(dir, "radius.json", |scene| {
        first_sphere(scene)["radius"] = json!(0)
    });
    spoiled(dir, "ior.json", |scene| {
        first_plastic(scene)["ior"] = json!(0)
    });
    spoiled(dir, "infinite.json", |scene| {
        first_sphere(scene)["radius"] = json!(1e300)
    });
    spoiled(dir, "many.json", |scene| {
        let lights = scene["area_lights"].as_array_mut().unwrap();
        let one = lights[0].clone();
        lights.resize(5000, one);
    });
    // A billion spheres: the file has the length, and takes no room on the disk.
    let huge = File::create(dir.join("huge.json")).unwrap();
    huge.set_len(100_000_000_000).unwrap();
    std::fs::write(dir.join("text.json"), "a pool table").unwrap();
    for (scene, place) in [
        ("missing.json", "missing.json"),
        ("nan.json", "nan.json"),
        ("radius.json", "radius"),
        ("ior.json", "ior"),
        ("infinite.json", "radius"),
        ("many.json", "area lights: at most 64 are allowed"),
        ("huge.json", "huge.json"),
        ("text.json", "text.json"),
    ] {
        for command in ["render --out a.png", "bench trace"] {
            let mut args: Vec<&str> = command.split(' ').collect();
            args.extend(["--scene", scene]);
            let said = refused(dir, &args);
            assert!(said.contains(place), "{said}");
        }
    }
}

#[test]
fn invalid_render_arguments_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for (args, place) in [
        ("--size 0x0 --out a.png", "0x0"),
        ("--size 100000x100000 --out a.png", "100000x100000"),
        ("--size 12 --out a.png", "WIDTHxHEIGHT"),
        ("--size=-1x5 --out a.png", "size"),
        ("--spp 0 --out a.png", "spp"),
        ("--spp -1 --out a.png", "-1 is not in 1..=65536"),
        ("--seed -1 --out a.png", "-1 is not in 0.."),
        ("--spp 99999999 --out a.png", "spp"),
        ("--max-depth 65 --out a.png", "depth"),
        ("--out a.gif", ".png, .exr or .jpg"),
        ("--out a", ".png, .exr or .jpg"),
        ("--out nowhere/a.png", "nowhere"),
        ("--backend quantum --out a.png", "quantum"),
        ("--node oak --out a.png", "host:port"),
        ("--node oak:99999 --out a.png", "65535"),
        ("--node oak:1 --out a.png", "carom-farm init"),
        (
            "--node oak:1 --credentials none --out a.png",
            "carom-farm init",
        ),
        ("--config missing.toml --out a.png", "missing.toml"),
        ("--config missing.toml --out a.png", "correct its name"),
        (
            "--scene missing.json --out a.png",
            "missing.json is no scene file",
        ),
        ("--backend none --out a.png", "no renderer"),
        ("--time 1 --out a.png", "--scene"),
        ("--scene a.glb --time inf --out a.png", "seconds"),
        ("--scene a.glb --frames 5-2 --out a#.png", "5-2"),
        ("--scene a.glb --fps 24 --out a.png", "--frames"),
        (
            "--scene a.glb --frames 0-1 --fps 0 --out a#.png",
            "0.01 to 10000",
        ),
    ] {
        let mut all = vec!["render"];
        all.extend(args.split(' '));
        let said = refused(dir.path(), &all);
        assert!(said.contains(place), "{args}: {said}");
    }
    assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 0);
}

/// A triangle that slides past the camera in 2 s.
const SLIDE: &str = include_str!("slide.gltf");

#[test]
fn frames_of_an_animation_are_numbered_files() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("slide.gltf"), SLIDE).unwrap();
    let scene = "render --scene slide.gltf --backend cpu --size 64x36 --spp 4";
    let scene: Vec<_> = scene.split(' ').collect();
    let frames = ["--frames", "1-3", "--fps", "2", "--out", "slide_##.exr"];
    done(dir, &[&scene[..], &frames].concat());
    let third = ["--animation", "slide", "--time", "1", "--out", "third.exr"];
    done(dir, &[&scene[..], &third].concat());
    done(dir, &[&scene[..], &["--out", "rest.exr"]].concat());
    let frame = |name: &str| pixels(dir, name);
    assert_eq!(frame("slide_02.exr"), frame("third.exr"));
    // Half way it is where it is at rest.
    assert_eq!(frame("slide_02.exr"), frame("rest.exr"));
    assert_ne!(frame("slide_01.exr"), frame("slide_02.exr"));
    assert_ne!(frame("slide_02.exr"), frame("slide_03.exr"));
    for (args, place) in [
        ("--frames 0-1 --out a.png", "frame_####.png"),
        ("--animation jump --out a.png", "0 `slide`"),
    ] {
        let args: Vec<_> = args.split(' ').collect();
        let said = refused(dir, &[&scene[..], &args].concat());
        assert!(said.contains(place), "{said}");
    }
    // The file and the five pictures.
    assert_eq!(std::fs::read_dir(dir).unwrap().count(), 6);
}

#[test]
fn invalid_configuration_fields_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for (text, place) in [
        ("colour = \"green\"", "colour"),
        ("tile_edge = \"wide\"", "tile_edge"),
        ("tile_edge = 0", "tile_edge"),
        ("threads = 5000", "threads"),
        ("frames_in_flight = 1000000", "frames_in_flight"),
        ("nodes = [\"oak\"]", "oak"),
        ("nodes = [", "farm.toml"),
    ] {
        std::fs::write(dir.path().join("farm.toml"), text).unwrap();
        let render = ["render", "--out", "a.png"];
        // It is found where the program runs, too.
        for args in [
            &render[..],
            &[&render[..], &["--config", "farm.toml"]].concat(),
        ] {
            let said = refused(dir.path(), args);
            assert!(said.contains(place), "{text}: {said}");
        }
    }
}

#[test]
fn unusable_credentials_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let node = ["node", "--listen", "127.0.0.1:0", "--backend", "cpu"];
    let with = |folder: &'static str| [&node[..], &["--credentials", folder]].concat();
    assert!(refused(dir, &with("none")).contains("carom-farm add-node"));
    assert!(refused(dir, &["add-node", "oak"]).contains("carom-farm init"));
    done(dir, &["init"]);
    assert!(refused(dir, &["init"]).contains("already holds a farm"));
    assert!(refused(dir, &["add-node", "../oak"]).contains("not a valid name"));
    // The player's folder is not a node's.
    assert!(refused(dir, &with(".carom")).contains("carom-farm add-node"));
    done(dir, &["add-node", "oak"]);
    assert!(refused(dir, &["add-node", "oak"]).contains("--renew"));
    std::fs::write(dir.join(".carom/nodes/oak/node.pem"), "nothing").unwrap();
    assert!(refused(dir, &with(".carom/nodes/oak")).contains("node.pem"));
}

#[test]
fn benches_refuse_invalid_pictures() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("a.exr"), "no picture").unwrap();
    for reference in ["a.exr", "missing.exr"] {
        let args = ["compare", "--reference", reference];
        assert!(refused(dir.path(), &args).contains(reference));
    }
    refused(dir.path(), &["bench", "trace", "--repetitions", "0"]);
    refused(dir.path(), &["bench", "trace", "--size", "0x0"]);
}

#[test]
fn no_command_prints_a_key() {
    let dir = tempfile::tempdir().unwrap();
    let said = done(dir.path(), &["init"])
        + &done(dir.path(), &["add-node", "oak"])
        + &done(dir.path(), &["add-player", "bob"])
        + &done(dir.path(), &["revoke", "bob"]);
    assert!(!said.contains("PRIVATE"));
}

/// A `carom-farm node` on a port of the system's choice; killed when dropped.
struct NodeProcess {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
    address: String,
}

impl NodeProcess {
    fn start(dir: &Path, name: &str) -> Self {
        let folder = format!(".carom/nodes/{name}");
        let mut child = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
            .args(["node", "--listen", "localhost:0", "--backend", "cpu"])
            .args(["--credentials", &folder])
            .current_dir(dir)
            .env("XDG_CACHE_HOME", dir)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let stdout = child.stdout.take().unwrap();
        let mut node = Self {
            child,
            lines: BufReader::new(stdout).lines(),
            address: String::new(),
        };
        let listening = node.wait_for("listening");
        node.address = listening.rsplit(' ').next().unwrap().to_owned();
        node
    }

    /// Reads the node's output until a line that starts with `state`.
    fn wait_for(&mut self, state: &str) -> String {
        let mut lines = self.lines.by_ref().map(Result::unwrap);
        let found = lines.find(|line| line.starts_with(state));
        found.unwrap_or_else(|| panic!("the node ended without `{state}`"))
    }
}

impl Drop for NodeProcess {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A folder with a farm of nodes of these names.
fn farm(nodes: &[&str]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    done(dir.path(), &["init"]);
    for name in nodes {
        done(dir.path(), &["add-node", name]);
    }
    dir
}

fn pixels(dir: &Path, file: &str) -> Vec<[u32; 3]> {
    let image = RadianceImage::read_exr(dir.join(file)).unwrap();
    let bits = |pixel: &[f32; 3]| pixel.map(f32::to_bits);
    image.pixels.iter().map(bits).collect()
}

#[test]
fn remote_and_local_pictures_have_the_same_bits() {
    let dir = farm(&["oak", "elm"]);
    let dir = dir.path();
    let (oak, elm) = (
        NodeProcess::start(dir, "oak"),
        NodeProcess::start(dir, "elm"),
    );
    let picture = ["render", "--size", "96x54", "--spp", "8", "--seed", "7"];
    let local = ["--backend", "cpu", "--out", "local.exr"];
    done(dir, &[&picture[..], &local].concat());
    let remote = [
        "--backend",
        "none",
        "--node",
        &oak.address,
        "--node",
        &elm.address,
    ];
    let remote = [&remote[..], &["--out", "remote.exr"]].concat();
    done(dir, &[&picture[..], &remote].concat());
    assert_eq!(pixels(dir, "local.exr"), pixels(dir, "remote.exr"));
    let merged = ["--distribution", "samples", "--out", "merged.exr"];
    done(dir, &[&picture[..], &remote[..6], &merged].concat());
    let local = RadianceImage::read_exr(dir.join("local.exr")).unwrap();
    let merged = RadianceImage::read_exr(dir.join("merged.exr")).unwrap();
    for (one, several) in local.pixels.iter().zip(&merged.pixels) {
        for (one, several) in one.iter().zip(several) {
            assert!(
                (one - several).abs() <= 1e-6 * one.max(1.0),
                "{one} and {several}"
            );
        }
    }
    let png = ["--backend", "cpu", "--out", "local.png"];
    done(dir, &[&picture[..], &png].concat());
    let signature = &std::fs::read(dir.join("local.png")).unwrap()[..8];
    assert_eq!(signature, b"\x89PNG\r\n\x1a\n");
}

#[test]
fn a_resumed_render_has_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let picture = "render --backend cpu --size 320x180 --spp 512 --checkpoint-secs 0 --out";
    let args = |out| [&picture.split(' ').collect::<Vec<_>>()[..], &[out]].concat();
    done(dir, &args("whole.exr"));
    let mut render = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .args(args("killed.exr"))
        .current_dir(dir)
        .spawn()
        .unwrap();
    while !dir.join("killed.exr.checkpoint").exists() {
        assert!(
            render.try_wait().unwrap().is_none(),
            "there was no checkpoint"
        );
        std::thread::yield_now();
    }
    render.kill().unwrap();
    render.wait().unwrap();
    assert!(
        !dir.join("killed.exr").exists(),
        "the picture was done before the kill"
    );
    // Of another picture the checkpoint is not taken.
    let other = refused(dir, &[&args("killed.exr")[..], &["--seed", "1"]].concat());
    assert!(other.contains("killed.exr.checkpoint"), "{other}");
    done(dir, &args("killed.exr"));
    assert!(pixels(dir, "whole.exr") == pixels(dir, "killed.exr"));
    let left = std::fs::read_dir(dir).unwrap().count();
    assert_eq!(left, 2, "only the pictures are left");
}

#[test]
fn one_and_several_nodes_denoise_to_the_same_bits() {
    let dir = farm(&["oak", "elm"]);
    let dir = dir.path();
    let (oak, elm) = (
        NodeProcess::start(dir, "oak"),
        NodeProcess::start(dir, "elm"),
    );
    let picture = ["render", "--size", "200x110", "--spp", "4", "--denoise"];
    let out = ["--out", "local.exr", "--out", "local.png"];
    done(dir, &[&picture[..], &["--backend", "cpu"], &out].concat());
    let nodes = ["--node", &oak.address, "--node", &elm.address];
    let remote = [&nodes[..], &["--backend", "none", "--out", "remote.exr"]].concat();
    done(dir, &[&picture[..], &remote].concat());
    assert!(pixels(dir, "local.exr") == pixels(dir, "remote.exr"));
    let noisy = ["--backend", "cpu", "--out", "noisy.exr"];
    done(dir, &[&picture[..5], &noisy].concat());
    assert!(pixels(dir, "local.exr") != pixels(dir, "noisy.exr"));
    let signature = &std::fs::read(dir.join("local.png")).unwrap()[..8];
    assert_eq!(signature, b"\x89PNG\r\n\x1a\n");
}

#[test]
fn a_killed_node_costs_no_picture() {
    let dir = farm(&["oak", "elm"]);
    let dir = dir.path();
    let (mut oak, elm) = (
        NodeProcess::start(dir, "oak"),
        NodeProcess::start(dir, "elm"),
    );
    let picture = ["render", "--size", "320x180", "--spp", "256", "--seed", "3"];
    let remote = [
        "--backend",
        "none",
        "--node",
        &oak.address,
        "--node",
        &elm.address,
    ];
    let remote = [&picture[..], &remote, &["--out", "remote.exr"]].concat();
    let mut render = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .args(remote)
        .current_dir(dir)
        .spawn()
        .unwrap();
    oak.wait_for("rendering");
    oak.child.kill().unwrap();
    assert!(
        render.try_wait().unwrap().is_none(),
        "the picture was done before the kill"
    );
    assert!(render.wait().unwrap().success());
    let local = ["--backend", "cpu", "--out", "local.exr"];
    done(dir, &[&picture[..], &local].concat());
    assert_eq!(pixels(dir, "local.exr"), pixels(dir, "remote.exr"));
}

#[cfg(unix)]
#[test]
fn an_interrupted_node_drains_and_exits_cleanly() {
    let dir = farm(&["oak"]);
    let mut oak = NodeProcess::start(dir.path(), "oak");
    let pid = oak.child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    oak.wait_for("draining");
    assert!(oak.child.wait().unwrap().success());
}

#[test]
fn two_machines_become_a_farm_by_a_token() {
    let dir = farm(&[]);
    let dir = dir.path();
    let mut token = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .args(["token", "--listen", "127.0.0.1:0"])
        .current_dir(dir)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(token.stdout.take().unwrap()).lines();
    let mut lines = lines.map(Result::unwrap);
    let command = lines
        .find(|line| line.starts_with("carom-farm join"))
        .unwrap();
    let url = command.rsplit(' ').next().unwrap();
    let join = [
        "join",
        url,
        "--name",
        "oak",
        "--credentials",
        ".carom/nodes/oak",
    ];
    assert!(done(dir, &join).contains("Joined as oak"));
    assert!(token.wait().unwrap().success());
    assert!(lines.any(|line| line.starts_with("joined: oak")));
    let mut oak = NodeProcess::start(dir, "oak");
    let play = oak.wait_for("│ play");
    assert!(play.contains(&oak.address), "{play}");
    let doctor = ["doctor", "--node", &oak.address];
    assert!(done(dir, &doctor).contains("answers as oak"));
    done(dir, &["revoke", "oak"]);
    let output = carom_farm(dir, &doctor);
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        said.contains("WRONG") && said.contains("has been revoked"),
        "{said}"
    );
}

#[test]
fn an_authority_apart_issues_by_its_passphrase() {
    let dir = tempfile::tempdir().unwrap();
    let run = |passphrase: &str, args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_carom-farm"));
        command
            .args(args)
            .current_dir(dir.path())
            .stdin(Stdio::null());
        command
            .env("CAROM_PASSPHRASE", passphrase)
            .output()
            .unwrap()
    };
    let init = ["init", "--ca-dir", "stick", "--passphrase"];
    assert!(run("open sesame", &init).status.success());
    assert!(!dir.path().join(".carom/ca.key").exists());
    let add = ["add-node", "oak", "--dir", "stick", "--out", "oak"];
    let wrong = run("sesame", &add);
    let said = String::from_utf8(wrong.stderr).unwrap();
    assert_eq!(wrong.status.code(), Some(2), "{said}");
    assert!(said.contains("the passphrase is wrong"), "{said}");
    assert!(run("open sesame", &add).status.success());
    assert!(dir.path().join("oak/node.pem").exists());
}

#[cfg(unix)]
#[test]
fn the_doctor_names_what_is_wrong() {
    use std::os::unix::fs::PermissionsExt as _;
    let dir = farm(&[]);
    let dir = dir.path();
    let silent = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let silent = silent.local_addr().unwrap().to_string();
    let key = dir.join(".carom/player.key");
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o644)).unwrap();
    let nodes = ["--node", &silent, "--node", "nobody.invalid:4433"];
    let args = [&["doctor", "--timeout-secs", "5"][..], &nodes].concat();
    let said = String::from_utf8(carom_farm(dir, &args).stdout).unwrap();
    for what in ["chmod 600", "its mode is 644"] {
        assert!(said.contains(what), "{what}: {said}");
    }
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o600)).unwrap();
    let said = String::from_utf8(carom_farm(dir, &args).stdout).unwrap();
    for what in [
        "readable by its owner only",
        "firewalls",
        "the name `nobody.invalid`",
        "valid until",
    ] {
        assert!(said.contains(what), "{what}: {said}");
    }
    let nowhere = carom_farm(dir, &["doctor", "--credentials", "nowhere"]);
    assert_eq!(nowhere.status.code(), Some(1));
    let said = String::from_utf8(nowhere.stdout).unwrap();
    assert!(said.contains("carom-farm init"), "{said}");
}

#[cfg(unix)]
#[test]
fn keys_that_everybody_can_read_are_refused() {
    use std::os::unix::fs::PermissionsExt as _;
    let dir = farm(&["oak"]);
    let dir = dir.path();
    let expose = |key: &str, mode| {
        std::fs::set_permissions(dir.join(key), std::fs::Permissions::from_mode(mode)).unwrap();
    };
    let node = ["node", "--credentials", ".carom/nodes/oak"];
    let status = ["status", "--node", "127.0.0.1:1"];
    for (key, args) in [
        (".carom/ca.key", &["add-node", "elm"][..]),
        (".carom/nodes/oak/node.key", &node),
        (".carom/player.key", &status),
    ] {
        expose(key, 0o604);
        let said = refused(dir, args);
        let advice = format!("chmod 600 {key}");
        assert!(
            said.contains("its mode is 604") && said.contains(&advice),
            "{said}"
        );
        expose(key, 0o600);
    }
    // As containers mount secrets.
    expose(".carom/ca.key", 0o640);
    done(dir, &["add-node", "elm"]);
}

#[cfg(target_os = "linux")]
#[test]
fn no_command_that_holds_a_key_makes_core_dumps() {
    let dir = farm(&[]);
    let mut token = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .args(["token", "--listen", "127.0.0.1:0"])
        .current_dir(dir.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // It has opened the authority when it speaks.
    let mut lines = BufReader::new(token.stdout.take().unwrap()).lines();
    lines.next().unwrap().unwrap();
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", token.id())).unwrap();
    token.kill().unwrap();
    token.wait().unwrap();
    let core = limits
        .lines()
        .find(|line| line.starts_with("Max core file size"));
    let words: Vec<&str> = core.unwrap().split_whitespace().collect();
    assert_eq!(words[4..6], ["0", "0"], "{limits}");
}

#[test]
fn log_lines_in_files_have_no_colour_and_a_damaged_record_revokes() {
    let dir = farm(&["oak"]);
    let dir = dir.path();
    let record = dir.join(".carom/issued.jsonl");
    let torn = std::fs::read_to_string(&record).unwrap() + "{\"name\":\"el";
    std::fs::write(&record, torn).unwrap();
    let output = carom_farm(dir, &["revoke", "oak"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("issued.jsonl, line 3 was cut off"), "{said}");
    assert!(!said.contains('\u{1b}'), "{said}");
    done(dir, &["add-node", "elm"]);
}

#[test]
fn pictures_of_one_stem_do_not_collide() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("p.partial"), "a file of the user").unwrap();
    let render = |out: &str| {
        Command::new(env!("CARGO_BIN_EXE_carom-farm"))
            .args([
                "render",
                "--backend",
                "cpu",
                "--size",
                "96x54",
                "--spp",
                "4",
            ])
            .args(["--out", out])
            .current_dir(dir)
            .spawn()
            .unwrap()
    };
    let renders = ["p.png", "p.exr"].map(render);
    for mut render in renders {
        assert!(render.wait().unwrap().success());
    }
    assert!(
        std::fs::read(dir.join("p.png"))
            .unwrap()
            .starts_with(b"\x89PNG")
    );
    assert_eq!(pixels(dir, "p.exr").len(), 96 * 54);
    let own = std::fs::read_to_string(dir.join("p.partial")).unwrap();
    assert_eq!(own, "a file of the user");
    assert_eq!(std::fs::read_dir(dir).unwrap().count(), 3);
}

#[cfg(target_os = "linux")]
#[test]
fn an_unwritable_folder_is_refused_before_tracing() {
    let dir = tempfile::tempdir().unwrap();
    // Hours of tracing, in a file system that takes no files.
    let picture = ["render", "--backend", "cpu", "--spp", "65536"];
    let said = refused(
        dir.path(),
        &[&picture[..], &["--out", "/proc/a.png"]].concat(),
    );
    assert!(said.contains("/proc/"), "{said}");
}

/// A file that may not grow stands for a disk that is full.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_a_failure_of_the_run_and_not_of_the_arguments() {
    let dir = tempfile::tempdir().unwrap();
    for out in ["a.exr", "a.png", "a.jpg"] {
        let render = format!(
            "trap '' XFSZ; ulimit -f 2; exec {} render --backend cpu --size 320x180 --spp 4 --out {out}",
            env!("CARGO_BIN_EXE_carom-farm")
        );
        let mut command = Command::new("sh");
        // What could be kept elsewhere would be.
        command.args(["-c", &render]).env("TMPDIR", dir.path());
        let output = command.current_dir(dir.path()).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.contains(out) && said.contains("File too large"),
            "{said}"
        );
        assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 0, "{out}");
    }
}

#[test]
fn a_node_needs_no_arguments() {
    let dir = tempfile::tempdir().unwrap();
    // Not before it has joined a farm, which it is told how to.
    let said = refused(dir.path(), &["node"]);
    assert!(
        said.contains("carom-farm token") && said.contains("carom-farm join"),
        "{said}"
    );
    done(dir.path(), &["init", "--dir", "farm"]);
    done(
        dir.path(),
        &["add-node", "oak", "--dir", "farm", "--out", ".carom"],
    );
    let mut node = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .arg("node")
        .current_dir(dir.path())
        .env("XDG_CACHE_HOME", dir.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(node.stdout.take().unwrap()).lines();
    let mut lines = lines.map(Result::unwrap);
    let last = lines.find(|line| line.starts_with("│ play"));
    let _ = node.kill(); // it may have ended
    let output = node.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    match last {
        Some(play) => assert!(
            play.contains("carom --node") && play.contains(":4433"),
            "{play}"
        ),
        // Its port is everybody's.
        None => assert!(said.contains("another program uses this address"), "{said}"),
    }
}

#[test]
fn renders_do_not_wait_for_nodes_in_silence() {
    let dir = farm(&[]);
    let silent = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let silent = silent.local_addr().unwrap().to_string();
    let render = [
        "render",
        "--backend",
        "none",
        "--timeout-secs",
        "5",
        "--out",
        "a.png",
    ];
    let output = carom_farm(dir.path(), &[&render[..], &["--node", &silent]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("waiting for nodes"), "{said}");
    let last = said.lines().last().unwrap();
    assert!(last.contains("no node has answered for 5 s"), "{said}");
    assert!(
        last.contains(&silent) && last.contains("firewalls"),
        "{said}"
    );
    assert!(!said.contains("is being called"), "{said}");
}

#[test]
fn an_address_in_use_is_reported_once() {
    let dir = farm(&["oak"]);
    let held = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let held = held.local_addr().unwrap().to_string();
    let node = [
        "node",
        "--credentials",
        ".carom/nodes/oak",
        "--listen",
        &held,
    ];
    let output = carom_farm(dir.path(), &node);
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(
        said.matches("in use").count() + said.matches("uses").count(),
        1,
        "{said}"
    );
}

#[test]
fn two_names_of_a_node_count_as_one() {
    let dir = farm(&["oak"]);
    let oak = NodeProcess::start(dir.path(), "oak");
    let name = oak.address.replace("127.0.0.1", "localhost");
    let nodes = [
        "--node",
        &oak.address,
        "--node",
        &oak.address,
        "--node",
        &name,
    ];
    let status = [&["status", "--json", "--timeout-secs", "2"][..], &nodes].concat();
    let output = carom_farm(dir.path(), &status);
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap();
    let states = rows
        .as_array()
        .unwrap()
        .iter()
        .map(|row| row["state"].as_str().unwrap());
    let mut states: Vec<&str> = states.collect();
    states.sort_unstable();
    assert_eq!(states, ["lost", "paired"], "{rows}");
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.contains("named twice") && said.contains("the same node as"),
        "{said}"
    );
}

#[test]
fn status_distinguishes_nodes_that_answer() {
    let dir = farm(&["oak"]);
    let dir = dir.path();
    let oak = NodeProcess::start(dir, "oak");
    // A port that is held and never answers.
    let silent = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let silent = silent.local_addr().unwrap().to_string();
    let nodes = format!("nodes = [\"{}\", \"{silent}\"]\n", oak.address);
    std::fs::write(dir.join("farm.toml"), nodes).unwrap();
    let output = carom_farm(dir, &["status", "--json", "--timeout-secs", "5"]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let rows: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows[0]["address"], json!(oak.address));
    assert_eq!(rows[0]["state"], "paired");
    assert_eq!(rows[0]["name"], "oak");
    assert!(rows[0]["device"].is_string() && rows[0]["round_trip_ms"].is_number());
    assert_eq!(rows[1]["address"], json!(silent));
    assert_ne!(rows[1]["state"], "paired");
    assert!(rows[1]["device"].is_null() && rows[1]["protocol"].is_null());
    let sentence = rows[1]["sentence"].as_str().unwrap();
    assert!(sentence.contains("firewalls"), "{sentence}");
    let one = ["status", "--node", &oak.address];
    assert!(done(dir, &one).contains("paired"));
    for command in ["status", "top"] {
        let missing = refused(dir, &[command, "--farm", "nowhere.toml"]);
        assert!(
            missing.contains("nowhere.toml") && missing.contains("--node HOST:PORT"),
            "{missing}"
        );
    }
}

#[test]
fn figures_of_a_farm_that_does_not_answer_are_a_failure() {
    let dir = tempfile::tempdir().unwrap();
    // A port at which nothing listens.
    let closed = std::net::TcpListener::bind("127.0.0.1:0").and_then(|port| port.local_addr());
    let closed = closed.unwrap().to_string();
    let output = carom_farm(dir.path(), &["top", "--once", "--health", &closed]);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    let whole = format!("{closed} does not answer: Connection refused (os error 111)");
    assert!(
        !cfg!(target_os = "linux") || said.contains(&whole),
        "{said}"
    );
    let failure = String::from_utf8(output.stderr).unwrap();
    assert!(failure.contains("1 of 1 nodes do not answer"), "{failure}");
}

#[test]
fn the_packaged_scene_is_the_asset() {
    let asset = include_str!("../../assets/scenes/pool.json");
    assert_eq!(include_str!("../src/commands/pool.json"), asset);
}
