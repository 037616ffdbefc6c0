//! Imports between the files of a package, which must form no cycle.
//!
//! A file imports another if a path in its code, outside of tests, leads to an item that the other
//! defines. `pub use` hands an item on and is no import; neither is what a parent module takes from
//! its own children, since a module and its parts are one thing seen from two sides. A crate's
//! `error.rs` is left out: it names the values of all that can fail, and all that can fail names it.

use std::collections::{BTreeMap, BTreeSet};

use crate::sources::{code_lines, sources};

/// The packages' source folders.
const PACKAGES: [&str; 9] = [
    "tracer/src/",
    "protocol/src/",
    "farm/src/",
    "farm/viewer/src/",
    "farm/window/src/",
    "game/billiards/src/",
    "game/src/",
    "tests/testkit/src/",
    "tests/bench/src/",
];

#[test]
fn files_import_each_other_in_no_cycle() {
    for folder in PACKAGES {
        let package = Package::read(folder);
        let cycles = package.cycles();
        let described: Vec<_> = cycles.iter().map(|cycle| package.describe(cycle)).collect();
        assert!(cycles.is_empty(), "{}", described.join("\n"));
    }
}

/// The modules of a package by their paths: `["coordinator", "balancer"]`.
struct Package {
    modules: BTreeMap<Vec<String>, Module>,
}

/// A module that is a file of its own.
struct Module {
    file: String,
    /// Paths that its code names, as written: `["super", "tile", "Tile"]`.
    paths: Vec<Vec<String>>,
    /// What `pub use` hands on: the last name, and the path behind it.
    exports: BTreeMap<String, Vec<String>>,
}

impl Package {
    fn read(folder: &str) -> Self {
        let mut modules = BTreeMap::new();
        for source in sources() {
            let Some(file) = source.path.strip_prefix(folder) else {
                continue;
            };
            if let Some(name) = module_path(file).filter(|name| *name != ["error"]) {
                modules.insert(name, Module::parse(source.path.clone(), &source.text));
            }
        }
        Self { modules }
    }

    /// Files that each module imports, by module path.
    fn imports(&self) -> BTreeMap<&Vec<String>, BTreeSet<&Vec<String>>> {
        self.modules
            .iter()
            .map(|(name, module)| {
                let targets = module
                    .paths
                    .iter()
                    .filter_map(|path| self.definer(name, path, 0))
                    .filter(|target| *target != name && !target.starts_with(name))
                    .collect();
                (name, targets)
            })
            .collect()
    }

    /// The module that defines what `path` leads to, seen from the module `from`.
    fn definer(&self, from: &[String], path: &[String], depth: usize) -> Option<&Vec<String>> {
        let mut at = match path.first()?.as_str() {
            "crate" => Vec::new(),
            "self" => from.to_vec(),
            "super" => from[..from.len().checked_sub(1)?].to_vec(),
            first => {
                let child = [from, &[first.to_owned()]].concat();
                self.modules.contains_key(&child).then_some(child)?
            }
        };
        let mut rest = &path[1..];
        while let Some(next) = rest.first() {
            if next == "super" {
                at.pop()?;
            } else {
                let child = [at.as_slice(), std::slice::from_ref(next)].concat();
                if !self.modules.contains_key(&child) {
                    break;
                }
                at = child;
            }
            rest = &rest[1..];
        }
        let (name, module) = self.modules.get_key_value(&at)?;
        match rest.first().and_then(|item| module.exports.get(item)) {
            // Twelve re-exports behind one another would be a ring of them.
            Some(export) if depth < 12 => self.definer(&at, export, depth + 1).or(Some(name)),
            _ => Some(name),
        }
    }

    /// Groups of two and more modules of which each imports the others, directly or through others.
    fn cycles(&self) -> Vec<Vec<&Vec<String>>> {
        let imports = self.imports();
        let reached: BTreeMap<_, BTreeSet<_>> = imports
            .keys()
            .map(|name| (*name, reachable(name, &imports)))
            .collect();
        let mut cycles = BTreeSet::new();
        for (name, others) in &reached {
            if others.contains(name) {
                let cycle: Vec<_> = others
                    .iter()
                    .filter(|other| reached[*other].contains(name))
                    .copied()
                    .collect();
                cycles.insert(cycle);
            }
        }
        cycles.into_iter().collect()
    }

    fn describe(&self, cycle: &[&Vec<String>]) -> String {
        let imports = self.imports();
        let mut lines = vec![format!("a cycle of {} files:", cycle.len())];
        for name in cycle {
            for target in imports[*name]
                .iter()
                .filter(|target| cycle.contains(target))
            {
                let (from, to) = (&self.modules[*name].file, &self.modules[*target].file);
                lines.push(format!("  {from} imports {to}"));
            }
        }
        lines.join("\n")
    }
}

fn reachable<'a>(
    start: &'a Vec<String>,
    imports: &BTreeMap<&'a Vec<String>, BTreeSet<&'a Vec<String>>>,
) -> BTreeSet<&'a Vec<String>> {
    let mut seen = BTreeSet::new();
    let mut open = vec![start];
    while let Some(name) = open.pop() {
        for target in &imports[name] {
            if seen.insert(*target) {
                open.push(*target);
            }
        }
    }
    seen
}

/// A file's module path: `a/b/mod.rs` and `a/b.rs` are `["a", "b"]`, `lib.rs` is `[]`; none for the root
/// of a binary and for tests.
fn module_path(file: &str) -> Option<Vec<String>> {
    let stem = file.strip_suffix(".rs")?;
    if stem == "main" || stem.ends_with("tests") {
        return None;
    }
    let stem = stem.strip_suffix("/mod").unwrap_or(stem);
    if stem == "lib" {
        return Some(Vec::new());
    }
    Some(stem.split('/').map(str::to_owned).collect())
}

impl Module {
    fn parse(file: String, text: &str) -> Self {
        let product = text.split("#[cfg(test)]\nmod ").next().unwrap_or(text);
        let code: Vec<_> = code_lines(product).map(|(_, line)| line).collect();
        let code = code.join("\n");
        let mut module = Self {
            file,
            paths: Vec::new(),
            exports: BTreeMap::new(),
        };
        let mut rest = code.as_str();
        while let Some((before, statement, is_export, after)) = next_use(rest) {
            module.paths.extend(inline_paths(before));
            for (path, name) in expand(statement) {
                if is_export {
                    module.exports.insert(name, path);
                } else {
                    module.paths.push(path);
                }
            }
            rest = after;
        }
        module.paths.extend(inline_paths(rest));
        module
    }
}

/// The next `use` statement: the text before it, its tree, whether it is `pub`, the text behind it.
fn next_use(code: &str) -> Option<(&str, &str, bool, &str)> {
    let mut from = 0;
    loop {
        let at = from + code[from..].find("use ")?;
        let line = code[..at].rfind('\n').map_or(0, |end| end + 1);
        let lead = code[line..at].trim();
        if lead.is_empty() || lead.starts_with("pub") && !lead.contains('=') {
            let end = at + code[at..].find(';')?;
            return Some((
                &code[..line],
                &code[at + 4..end],
                lead == "pub",
                &code[end + 1..],
            ));
        }
        from = at + 4;
    }
}

/// The paths of a `use` tree, each with the name that it brings in.
fn expand(tree: &str) -> Vec<(Vec<String>, String)> {
    let tree = tree.trim();
    if let Some(open) = tree.find('{') {
        let prefix: Vec<_> = segments(tree[..open].trim_end_matches("::"));
        // A sentence in a string may begin with `use` too: its braces need not match.
        let close = tree.rfind('}').filter(|close| *close > open);
        let inside = &tree[open + 1..close.unwrap_or(tree.len())];
        return split_top(inside)
            .into_iter()
            .filter(|part| !part.trim().is_empty())
            .flat_map(expand)
            .map(|(path, name)| ([prefix.clone(), path].concat(), name))
            .collect();
    }
    let (path, alias) = tree
        .split_once(" as ")
        .map_or((tree, None), |(path, alias)| (path, Some(alias)));
    let path = segments(path);
    let name = alias.map_or_else(
        || path.last().cloned().unwrap_or_default(),
        |alias| alias.trim().to_owned(),
    );
    vec![(path, name)]
}

fn segments(path: &str) -> Vec<String> {
    path.split("::")
        .map(|segment| segment.trim().to_owned())
        .filter(|segment| !segment.is_empty())
        .collect()
}

/// The parts of a `use` group between its outermost commas.
fn split_top(group: &str) -> Vec<&str> {
    let (mut parts, mut depth, mut start) = (Vec::new(), 0, 0);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&group[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&group[start..]);
    parts
}

/// Paths in expressions and types that begin with `crate::` or `super::`.
fn inline_paths(code: &str) -> Vec<Vec<String>> {
    let mut paths = Vec::new();
    for start in ["crate::", "super::"] {
        for (at, _) in code.match_indices(start) {
            let is_inner = code[..at].ends_with(|c: char| c.is_alphanumeric() || "_:$".contains(c));
            let end = code[at..]
                .find(|c: char| !c.is_alphanumeric() && !"_:".contains(c))
                .map_or(code.len(), |length| at + length);
            if !is_inner {
                paths.push(segments(&code[at..end]));
            }
        }
    }
    paths
}

#[test]
fn a_cycle_is_found_through_a_reexport() {
    let module = |file: &str, text: &str| {
        let name = module_path(file).expect("a module");
        (name, Module::parse(file.to_owned(), text))
    };
    let package = Package {
        modules: BTreeMap::from([
            module("lib.rs", "pub mod a;\nmod b;\npub use b::{B, c::D as E};"),
            module("a.rs", "use crate::{B, std::X};\nstruct A;"),
            module("b.rs", "struct B(super::a::A);\nmod c;"),
            module("b/c.rs", "pub struct D;"),
        ]),
    };
    let path = |text: &str| segments(text);
    assert_eq!(
        package.definer(&[], &path("crate::E"), 0),
        Some(&path("b::c"))
    );
    let cycles = package.cycles();
    assert_eq!(cycles.len(), 1);
    assert_eq!(cycles[0], [&path("a"), &path("b")]);
}
