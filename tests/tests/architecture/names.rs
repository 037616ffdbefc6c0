//! Rules of naming: noun phrases first in module docs, and types with names of their own.

use std::collections::BTreeMap;

use crate::sources::{Source, code_lines, sources};

/// Words with which a module's documentation asks a question instead of naming a thing.
const QUESTION_WORDS: [&str; 5] = ["What", "How", "Where", "Which", "Who"];

/// Files in which one type name may be defined.
const DEFINITIONS_MAX: usize = 2;

#[test]
fn module_docs_begin_with_a_noun_phrase() {
    let faults: Vec<_> = sources()
        .iter()
        .filter_map(|source| question(&source.text).map(|line| format!("{}: {line}", source.path)))
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The first line of a module's documentation, if it begins with a question word.
fn question(text: &str) -> Option<&str> {
    let first = text.lines().find_map(|line| line.strip_prefix("//! "))?;
    let word = first.split(|c: char| !c.is_alphabetic()).next()?;
    QUESTION_WORDS.contains(&word).then_some(first)
}

#[test]
fn a_type_name_is_defined_at_most_twice() {
    let mut definitions: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for Source { path, text } in sources() {
        for name in product_types(&text) {
            definitions
                .entry(name.to_owned())
                .or_default()
                .push(path.clone());
        }
    }
    let faults: Vec<_> = definitions
        .iter()
        .filter(|(name, files)| files.len() > DEFINITIONS_MAX && !is_convention(name, files))
        .map(|(name, files)| format!("{name}: {}", files.join(", ")))
        .collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Whether a name is one that each file of its kind has by convention: `Args` of a command and a
/// crate's `Error`.
fn is_convention(name: &str, files: &[String]) -> bool {
    let is_command = |path: &String| {
        path.contains("/commands/")
            || path.ends_with("/args.rs")
            || path.starts_with("tests/bench/src/")
    };
    match name {
        "Args" => files.iter().all(is_command),
        "Error" => files.iter().all(|path| path.ends_with("error.rs")),
        _ => false,
    }
}

/// Names of the structs, enums, traits and type aliases outside of tests that a file defines.
fn product_types(text: &str) -> Vec<&str> {
    let product = text.split("#[cfg(test)]\nmod ").next().unwrap_or(text);
    code_lines(product)
        .filter_map(|(_, line)| defined_type(line))
        .collect()
}

fn defined_type(line: &str) -> Option<&str> {
    // Associated types are indented further than a module's own items.
    let line = line.strip_prefix("    ").unwrap_or(line);
    let line = match line.strip_prefix("pub") {
        Some(rest) if rest.starts_with('(') => rest.split_once(") ")?.1,
        Some(rest) => rest.strip_prefix(' ')?,
        None => line,
    };
    let rest = ["struct ", "enum ", "trait "]
        .iter()
        .find_map(|keyword| line.strip_prefix(keyword))?;
    rest.split(|c: char| !c.is_alphanumeric() && c != '_')
        .next()
}

#[test]
fn questions_and_definitions_are_recognised() {
    assert!(question("//! What nodes answer.").is_some());
    assert!(question("//! Whole frames.").is_none());
    assert_eq!(defined_type("pub struct Tile {"), Some("Tile"));
    assert_eq!(
        defined_type("pub(crate) enum Way<'a> { A(&'a str) }"),
        Some("Way")
    );
    assert_eq!(defined_type("    let structure = 1;"), None);
}
