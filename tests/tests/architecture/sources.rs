//! The Rust sources of the workspace, as text.

use std::fs;
use std::path::{Path, PathBuf};

/// A Rust file of the workspace.
pub(crate) struct Source {
    /// Path from the repository's root, with forward slashes.
    pub(crate) path: String,
    /// The whole text.
    pub(crate) text: String,
}

/// Every Rust file of the workspace's packages, `tests/tests` apart.
pub(crate) fn sources() -> Vec<Source> {
    let mut files = Vec::new();
    for folder in ["tracer", "protocol", "farm", "game", "tests"] {
        collect(&root().join(folder), &mut files);
    }
    assert!(files.len() > 20, "only {} sources were found", files.len());
    files
}

fn collect(folder: &Path, files: &mut Vec<Source>) {
    for entry in fs::read_dir(folder).expect("a source folder") {
        let path = entry.expect("a folder entry").path();
        if path.is_dir() && !path.ends_with("target") && !path.ends_with("tests/tests") {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let name = path.strip_prefix(root()).expect("inside the root");
            files.push(Source {
                path: name.to_string_lossy().replace('\\', "/"),
                text: fs::read_to_string(&path).expect("a source"),
            });
        }
    }
}

/// Numbered lines without comments.
pub(crate) fn code_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .filter(|(_, line)| !line.trim_start().starts_with("//"))
        .map(|(index, line)| (index + 1, line.split("//").next().unwrap_or(line)))
}

/// The repository's root.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the workspace root")
        .to_owned()
}
