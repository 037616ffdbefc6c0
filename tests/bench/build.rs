//! Copies the balancer that `carom-bench balance` calls `own` to where the compiler finds it: a Rust file
//! with a type `MyBalancer` that has `Default` and `carom_farm::balancer::Balancer`.

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-env-changed={VARIABLE}");
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let named = env::var_os(VARIABLE).map(PathBuf::from);
    // Relative to where cargo is called, which build scripts do not know.
    let file = match named {
        Some(file) if file.is_relative() => root.join("../..").join(file),
        Some(file) => file,
        None => root.join(EXAMPLE),
    };
    println!("cargo::rerun-if-changed={}", file.display());
    match fs::read_to_string(&file) {
        Ok(text) => copy(&text),
        Err(why) => println!("cargo::error={VARIABLE}: {}: {why}", file.display()),
    }
}

/// Inside of a module a file has no documentation of its own.
fn copy(text: &str) {
    let line = |line: &str| match line.strip_prefix("//!") {
        Some(rest) => format!("//{rest}\n"),
        None => format!("{line}\n"),
    };
    let text: String = text.lines().map(line).collect();
    let folder = env::var_os("OUT_DIR").expect("cargo sets it");
    fs::write(Path::new(&folder).join("own_balancer.rs"), text).expect("cargo's folder is there");
}

const VARIABLE: &str = "CAROM_BALANCER";
const EXAMPLE: &str = "../../farm/examples/own_balancer.rs";
