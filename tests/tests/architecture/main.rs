//! Laws of the repository: documents name what exists, dependencies point one way, names say what
//! they name.

mod imports;
mod names;
mod sources;

use std::fs;
use std::process::Command;

use sources::{Source, code_lines, root, sources};

#[test]
fn paths_named_in_the_documents_exist() {
    for document in ["ARCHITECTURE.md", "README.md", SECURITY] {
        let text = fs::read_to_string(root().join(document)).expect(document);
        let paths = named_paths(&text);
        assert!(paths.len() >= 3, "{document} names only {paths:?}");
        for path in paths {
            assert!(
                root().join(&path).exists(),
                "{document} names `{path}`, which is not there"
            );
        }
    }
}

/// A test that is named beside files is in one of them.
#[test]
fn tests_named_for_security_exist() {
    let text = fs::read_to_string(root().join(SECURITY)).expect(SECURITY);
    let mut named = 0;
    for line in text.lines().filter(|line| line.starts_with('|')) {
        let files = named_paths(line).into_iter().map(|path| root().join(path));
        let files = files.filter(|path| path.is_file()).map(fs::read_to_string);
        let sources: String = files.map(|file| file.expect("a file")).collect();
        let quoted = line.split('`').skip(1).step_by(2);
        let is_test = |word: &&str| {
            let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            word.matches('_').count() >= 2 && word.chars().all(is_plain)
        };
        for test in quoted.filter(is_test) {
            let is_there = sources.contains(&format!("fn {test}("));
            assert!(is_there, "{SECURITY} names `{test}`, which is not there");
            named += 1;
        }
    }
    assert!(named > 20, "only {named} tests are named");
}

/// Words in back quotes that begin with one of the repository's folders.
fn named_paths(markdown: &str) -> Vec<String> {
    let folders = [
        "tracer/",
        "protocol/",
        "farm/",
        "game/",
        "tests/",
        "assets/",
        ".ci/",
    ];
    let quoted = markdown.split('`').skip(1).step_by(2);
    let is_path = |word: &&str| {
        folders.iter().any(|folder| word.starts_with(folder)) && !word.contains([' ', '*', '<'])
    };
    quoted.filter(is_path).map(str::to_owned).collect()
}

/// The document of what the farm withstands.
const SECURITY: &str = "farm/SECURITY.md";

/// A crate name as a path in code, and the folders that may say it.
const LAYERS: &[(&[&str], &[&str])] = &[
    (
        &[
            "quinn",
            "quinn_proto",
            "rustls",
            "tokio",
            "rcgen",
            "x509_parser",
        ],
        &[
            "farm/src/net/",
            "farm/src/health/",
            "farm/src/directory/nats.rs",
            "farm/tests/quic/",
            "farm/examples/service.rs",
        ],
    ),
    (
        &["winit", "egui", "egui_winit"],
        &[
            "farm/viewer/src/",
            "farm/viewer/tests/",
            "farm/window/",
            "game/src/",
            "game/tests/",
            "game/examples/",
            "farm/examples/",
            "tests/bench/",
        ],
    ),
    (
        &["egui_wgpu", "softbuffer"],
        &[
            "farm/window/src/display/",
            "farm/window/tests/",
            "farm/examples/",
        ],
    ),
    (&["gilrs"], &["game/src/app/gamepads.rs"]),
    (&["cpal"], &["game/src/audio/device.rs"]),
    (&["fluent_bundle", "fluent_syntax"], &["game/text/"]),
    (
        &["rapier3d"],
        &["game/billiards/", "tests/bench/src/particles/soft_body.rs"],
    ),
    (&["ratatui"], &["farm/src/commands/top/"]),
    (
        &["wgpu"],
        &[
            "tracer/src/gpu/",
            "game/mpm/src/gpu/",
            "farm/window/src/display/",
            "farm/window/tests/",
        ],
    ),
    (
        &["fearless_simd"],
        &[
            "tracer/src/cpu/",
            "tracer/src/simd.rs",
            "tracer/src/denoise/",
            "tracer/src/reproject/",
            "protocol/src/tile_codec/",
            "game/mpm/src/",
        ],
    ),
    (&["zstd"], &["protocol/"]),
    (&["postcard"], &["protocol/", "game/billiards/"]),
    (
        &["carom_farm", "carom_tracer"],
        &[
            "tracer/",
            "protocol/",
            "farm/",
            "game/src/",
            "game/tests/",
            "game/examples/",
            "tests/",
        ],
    ),
    (&["carom_billiards"], &["game/", "tests/"]),
    (&["carom_mpm"], &["game/", "tests/"]),
    (&["carom_protocol"], &["protocol/", "farm/", "tests/"]),
    (
        &["carom_window"],
        &["farm/viewer/", "farm/window/", "game/", "tests/bench/"],
    ),
    (
        &["carom::"],
        &[
            "game/src/",
            "game/tests/",
            "game/examples/",
            "tests/bench/",
            "tests/fuzz/",
        ],
    ),
];

#[test]
fn each_library_is_named_only_in_its_layer() {
    for Source { path, text } in sources() {
        for (crates, folders) in LAYERS {
            if folders.iter().any(|folder| path.starts_with(folder)) {
                continue;
            }
            for name in *crates {
                let line = code_lines(&text).find(|(_, line)| names_crate(line, name));
                if let Some((number, line)) = line {
                    panic!("{path}:{number} names {name}, which belongs to {folders:?}: {line}");
                }
            }
        }
    }
}

#[test]
fn tracer_and_protocol_know_no_socket_clock_or_window() {
    let forbidden = ["std::net", "Instant", "SystemTime", "thread::sleep"];
    for Source { path, text } in sources() {
        if !path.starts_with("tracer/src/") && !path.starts_with("protocol/src/") {
            continue;
        }
        for (number, line) in code_lines(&text) {
            let word = forbidden.iter().find(|word| line.contains(*word));
            assert!(
                word.is_none(),
                "{path}:{number} uses {}: {line}",
                word.unwrap_or(&"")
            );
        }
    }
}

#[test]
fn dependencies_point_one_way() {
    let order = ["tracer", "protocol", "farm", "game"];
    for (rank, folder) in order.iter().enumerate() {
        let manifest = fs::read_to_string(root().join(folder).join("Cargo.toml")).expect(folder);
        for later in &order[rank + 1..] {
            let name = if *later == "game" {
                "carom"
            } else {
                &format!("carom-{later}")
            };
            let mut keys = manifest.lines().map(|line| line.split(['.', ' ']).next());
            assert!(
                !keys.any(|key| key == Some(name)),
                "{folder}/Cargo.toml depends on {later}"
            );
        }
    }
}

/// Dev-dependencies may name the test kit: cargo leaves them out of every build but that of tests.
#[test]
fn product_depends_on_no_bench_or_test_kit() {
    for folder in [
        "tracer",
        "protocol",
        "farm",
        "farm/viewer",
        "farm/window",
        "game",
        "game/billiards",
        "game/mpm",
        "game/text",
    ] {
        let manifest = fs::read_to_string(root().join(folder).join("Cargo.toml")).expect(folder);
        let product = manifest.split("[dev-dependencies]").next().expect("a part");
        for package in ["carom-bench", "carom-testkit", "plotters"] {
            assert!(
                !product.lines().any(|line| line.starts_with(package)),
                "{folder}/Cargo.toml depends on {package}"
            );
        }
    }
}

#[test]
fn particles_depend_on_no_other_package() {
    let folder = root().join("game/mpm");
    let manifest = fs::read_to_string(folder.join("Cargo.toml")).expect("a manifest");
    for line in manifest.lines() {
        let is_ours = line.starts_with("carom") && !line.starts_with("carom-mpm");
        assert!(
            !is_ours && !line.starts_with("rapier"),
            "game/mpm/Cargo.toml: {line}"
        );
    }
}

#[test]
fn protocol_builds_without_gpu_and_image_files() {
    let tree = ["tree", "--offline", "--locked", "-p", "carom-protocol"];
    let tree = Command::new(env!("CARGO"))
        .args(tree)
        .args(["--edges", "normal", "--prefix", "none"])
        .current_dir(root())
        .output()
        .expect("cargo");
    assert!(tree.status.success(), "{tree:?}");
    let tree = String::from_utf8(tree.stdout).expect("names of packages");
    assert!(tree.contains("carom-tracer"), "{tree}");
    for package in ["wgpu", "naga", "pollster", "exr", "png"] {
        assert!(
            !tree.lines().any(|line| line.starts_with(package)),
            "carom-protocol depends on {package}"
        );
    }
}

#[test]
fn the_layer_check_finds_a_breach() {
    assert!(names_crate("use quinn::Endpoint;", "quinn"));
    assert!(names_crate("    let x = tokio::spawn(f);", "tokio"));
    assert!(!names_crate("let quinn_like = 1;", "quinn"));
    assert!(!names_crate("my_quinn::f()", "quinn"));
    let text = "// quinn::X\nlet a = 1; // tokio::Y\nuse winit::Z;";
    let lines: Vec<_> = code_lines(text).collect();
    assert_eq!(lines, [(2, "let a = 1; "), (3, "use winit::Z;")]);
}

/// Whether a line of code uses `name` as the first part of a path.
fn names_crate(line: &str, name: &str) -> bool {
    let path = if name.ends_with("::") {
        name.to_owned()
    } else {
        format!("{name}::")
    };
    line.match_indices(&path).any(|(at, _)| {
        !line[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':' || c == '`')
    })
}
