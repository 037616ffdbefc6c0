//! The program `carom-bench`: a farm of processes, and refusals.

use std::path::Path;
use std::process::{Command, Output};

use carom_farm::net::{add_node, create_farm};
use serde_json::Value;

fn carom_bench(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_carom-bench"))
        .args(args)
        .current_dir(dir)
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

/// What the program says when it refuses its input; panics if it does not.
fn refused(dir: &Path, args: &[&str]) -> String {
    let output = carom_bench(dir, args);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
    assert!(!said.contains("panicked"), "{args:?}: {said}");
    assert!(output.stdout.is_empty(), "{args:?}");
    said
}

fn done(dir: &Path, args: &[&str]) -> String {
    let output = carom_bench(dir, args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{args:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn unknown_paths_are_refused_with_the_known_ones() {
    let dir = tempfile::tempdir().unwrap();
    for bench in ["latency", "transport"] {
        let said = refused(dir.path(), &[bench, "--path", "zzz"]);
        assert!(said.contains("zzz") && said.contains("loopback"), "{said}");
    }
}

/// With `--help` behind them, which is answered once all before it has been understood.
#[test]
fn commands_of_the_measurements_are_understood() {
    let dir = tempfile::tempdir().unwrap();
    let commands = include_str!("../MEASUREMENTS.md").split('`');
    let ours = commands.filter_map(|command| command.strip_prefix("carom-bench "));
    let ours: std::collections::BTreeSet<_> = ours.collect();
    assert!(ours.len() > 30, "{ours:?}");
    for command in ours {
        let args: Vec<&str> = command.split_whitespace().chain(["--help"]).collect();
        done(dir.path(), &args);
    }
}

/// Of nodes that slow down, are held, go on, are killed and join, over paths that lose packets.
#[cfg(unix)]
#[test]
fn farms_of_processes_survive_every_event() {
    let dir = tempfile::tempdir().unwrap();
    let args = "cluster --json --frames 48 --width 64 --node 0.5@2,0.3@8,0.2@4,0.4@1 \
                --change 10:1:throttle=0.05,16:0:stop,24:0:go,30:2:kill,36:3:join --loss 1 \
                --jitter 0.5 --algorithm equal,water_filling_hedged";
    let args: Vec<&str> = args.split_whitespace().collect();
    let results: Value = serde_json::from_str(&done(dir.path(), &args)).unwrap();
    assert_eq!(results["nodes"].as_array().unwrap().len(), 4);
    let runs = results["runs"].as_array().unwrap();
    assert_eq!(runs[0]["algorithm"], "equal");
    assert_eq!(runs[1]["algorithm"], "water_filling_hedged");
    for run in runs {
        assert_eq!(run["wrong_frames"], 0, "{run}");
        for figures in [&run["measured"], &run["simulated"]] {
            assert_eq!(figures["lost_frames"], 0, "{run}");
            assert!(figures["mean_ms"].as_f64().unwrap() > 0.0, "{run}");
            let twice = figures["duplicates"].as_f64().unwrap();
            assert!((0.0..1.0).contains(&twice), "{run}");
        }
    }
    let simulated = |run: usize| runs[run]["simulated"]["mean_ms"].as_f64().unwrap();
    assert!(simulated(1) < simulated(0), "{results}");
}

#[test]
fn shares_and_changes_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    create_farm(&dir.join(".carom")).unwrap();
    add_node(&dir.join(".carom"), "oak", None, false).unwrap();
    for (args, place) in [
        ("cluster --node 0@1", "0@1"),
        ("cluster --node 0.5", "SHARE@MS"),
        ("cluster --change 1:9:kill", "node 9"),
        ("cluster --change 1:0:join", "node 0"),
        ("cluster --change 1:2:join", "last"),
        ("cluster --change 1:1:burn", "throttle=SHARE"),
        ("cluster --node 0.5@1,0.5@1", "three"),
        ("cluster --algorithm best", "best"),
    ] {
        let said = refused(dir, &args.split(' ').collect::<Vec<_>>());
        assert!(said.contains(place), "{args}: {said}");
    }
    for share in ["0", "2", "NaN"] {
        let node = "node --listen 127.0.0.1:0 --credentials .carom/nodes/oak --throttle";
        let args: Vec<&str> = node.split(' ').chain([share]).collect();
        assert!(refused(dir, &args).contains(share));
    }
}
