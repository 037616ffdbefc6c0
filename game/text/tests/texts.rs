//! Texts of the interface: all of them in one file, each used and given its arguments.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use fluent_syntax::ast::{
    Entry, Expression, InlineExpression, Message, Pattern, PatternElement, Variant,
};
use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};

/// Folders of the sources that show texts of the interface.
const SHOWN_BY: [&str; 4] = [
    "src",
    "billiards/src",
    "../farm/viewer/src",
    "../farm/window/src",
];

/// Files whose sentences are not shown in a window, each with the reason.
const NOT_SHOWN: &[(&str, &str)] = &[
    (
        "billiards/src/game_match/ratings.rs",
        "output of the command line",
    ),
    (
        "billiards/src/game_match/tournament.rs",
        "output of the command line",
    ),
    (
        "billiards/src/physics/built_in_tables.rs",
        "names of tables in saved files",
    ),
    ("billiards/src/physics/engine.rs", "names of engines"),
    (
        "billiards/src/physics/laws.rs",
        "names of quantities in errors",
    ),
    (
        "billiards/src/physics/particles/track.rs",
        "faults of a damaged file",
    ),
    (
        "billiards/src/physics/recording.rs",
        "faults of a damaged file",
    ),
    (
        "billiards/src/physics/table_spec.rs",
        "names of quantities in errors",
    ),
    ("src/args.rs", "the help of the command line"),
    ("src/main.rs", "the command line"),
    ("src/capture/headless.rs", "the command line"),
    (
        "src/input/action.rs",
        "the keys of each control, by their names in the settings file",
    ),
    (
        "src/input/gamepad.rs",
        "names that the settings file keeps and the help shows",
    ),
    (
        "src/input/key.rs",
        "the names of keys, which are those of the settings file",
    ),
    ("src/capture/video/ffmpeg.rs", "arguments of ffmpeg"),
    (
        "src/scene/scene_builder/cushions.rs",
        "names of objects and materials",
    ),
    (
        "src/scene/scene_builder/furniture.rs",
        "names of objects and materials",
    ),
    (
        "src/scene/scene_builder/materials.rs",
        "names of objects and materials",
    ),
    (
        "src/scene/scene_builder/pockets.rs",
        "names of objects and materials",
    ),
    (
        "src/scene/scene_builder/room.rs",
        "names of objects and materials",
    ),
    ("src/scene/table_args.rs", "the help of the command line"),
    ("../farm/viewer/src/args.rs", "the help of the command line"),
    ("../farm/window/src/args.rs", "the help of the command line"),
    ("../farm/viewer/src/main.rs", "the command line"),
];

/// Macros whose strings are not shown in a window: those of logs, the command line, internal errors, and
/// fragments of sentences.
const MACROS_NOT_SHOWN: &[&str] = &[
    "anyhow",
    "assert",
    "assert_eq",
    "assert_ne",
    "bail",
    "debug",
    "debug_assert",
    "debug_assert_eq",
    "ensure",
    "eprintln",
    "error",
    "include_bytes",
    "include_str",
    "info",
    "panic",
    "println",
    "todo",
    "unreachable",
    "warn",
];

/// Functions whose strings are not shown in a window: internal errors, and fragments of sentences.
const FUNCTIONS_NOT_SHOWN: &[&str] = &["context", "expect", "with_context"];

/// String literals and look-ups of texts in a source file.
#[derive(Default)]
struct Literals {
    /// Identifiers of `text!` with the names of its arguments, and the line.
    asked: Vec<(String, BTreeSet<String>, usize)>,
    /// Every other string, and the line.
    strings: Vec<(String, usize)>,
}

#[test]
fn each_text_asked_for_exists_and_is_given_its_arguments() {
    let messages = messages();
    let mut faults = Vec::new();
    for (path, literals) in literals() {
        for (id, given, line) in literals.asked {
            match messages.get(&id) {
                None => faults.push(format!("{path}:{line}: en.ftl has no `{id}`")),
                Some(wanted) if *wanted != given => {
                    faults.push(format!(
                        "{path}:{line}: `{id}` takes {wanted:?}, is given {given:?}"
                    ));
                }
                Some(_) => {}
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// An identifier is used whole, or made of a prefix that ends with a dash (`format!("cloth-{}", …)`).
#[test]
fn each_text_is_used() {
    let mut whole = BTreeSet::new();
    let mut prefixes = BTreeSet::new();
    for (_, literals) in literals() {
        whole.extend(literals.asked.into_iter().map(|(id, ..)| id));
        for (string, _) in literals.strings {
            match string.split_once("-{") {
                Some((prefix, _)) => prefixes.insert(format!("{prefix}-")),
                None => whole.insert(string),
            };
        }
    }
    let unused: Vec<_> = messages()
        .into_keys()
        .filter(|id| !whole.contains(id) && !prefixes.iter().any(|prefix| id.starts_with(prefix)))
        .collect();
    assert!(unused.is_empty(), "nothing shows {unused:?} of en.ftl");
}

#[test]
fn every_sentence_of_the_interface_stands_in_its_file() {
    let mut faults = Vec::new();
    for (path, literals) in literals() {
        if NOT_SHOWN.iter().any(|(exempt, _)| *exempt == path) {
            continue;
        }
        for (string, line) in literals.strings {
            if is_text(&string) {
                faults.push(format!("{path}:{line}: {string:?}"));
            }
        }
    }
    assert!(
        faults.is_empty(),
        "{} texts outside en.ftl:\n{}",
        faults.len(),
        faults.join("\n")
    );
}

/// Whether a string is two words in a row, or one that begins with a capital letter, placeholders apart.
fn is_text(string: &str) -> bool {
    let mut bare = String::new();
    let mut depth = 0;
    for c in string.chars() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            _ if depth == 0 => bare.push(c),
            _ => {}
        }
    }
    let words: Vec<_> = bare.split(' ').collect();
    let is_word = |word: &&str| {
        let letters = word.trim_matches(|c: char| c.is_ascii_punctuation());
        letters.len() > 1 && letters.chars().all(|c| c.is_alphabetic() || c == '\'')
    };
    let mut initial = bare.chars();
    let is_label = initial.next().is_some_and(char::is_uppercase)
        && initial.next().is_some_and(char::is_lowercase);
    is_label || words.windows(2).any(|pair| pair.iter().all(is_word))
}

/// Every message of the English file with the arguments that it names.
fn messages() -> BTreeMap<String, BTreeSet<String>> {
    let resource =
        fluent_syntax::parser::parse(carom_text::ENGLISH).expect("en.ftl is in Fluent's syntax");
    let mut messages = BTreeMap::new();
    for entry in resource.body {
        if let Entry::Message(Message {
            id,
            value: Some(value),
            ..
        }) = entry
        {
            let mut arguments = BTreeSet::new();
            arguments_of(&value, &mut arguments);
            let old = messages.insert(id.name.to_owned(), arguments);
            assert!(old.is_none(), "en.ftl has `{}` twice", id.name);
        }
    }
    messages
}

fn arguments_of(pattern: &Pattern<&str>, into: &mut BTreeSet<String>) {
    for element in &pattern.elements {
        let PatternElement::Placeable { expression } = element else {
            continue;
        };
        match expression {
            Expression::Inline(inline) => argument_of(inline, into),
            Expression::Select { selector, variants } => {
                argument_of(selector, into);
                for Variant { value, .. } in variants {
                    arguments_of(value, into);
                }
            }
        }
    }
}

fn argument_of(expression: &InlineExpression<&str>, into: &mut BTreeSet<String>) {
    match expression {
        InlineExpression::VariableReference { id } => {
            into.insert(id.name.to_owned());
        }
        InlineExpression::Placeable { expression } => {
            if let Expression::Inline(inline) = &**expression {
                argument_of(inline, into);
            }
        }
        _ => {}
    }
}

/// The strings of each source that is not a test, by its path from `game/`.
fn literals() -> Vec<(String, Literals)> {
    // Not of the checkout that the test was built in: several share a target folder.
    let package = std::env::var("CARGO_MANIFEST_DIR").expect("cargo says where the package is");
    let game = Path::new(&package).join("..");
    let mut sources = Vec::new();
    for folder in SHOWN_BY {
        read_sources(&game, folder, &mut sources);
    }
    assert!(
        sources.len() > 100,
        "only {} sources were found",
        sources.len()
    );
    let read = |(path, text): (String, String)| {
        let tokens: TokenStream = text
            .parse()
            .unwrap_or_else(|fault| panic!("{path}: {fault}"));
        let mut found = Literals::default();
        collect(tokens, &mut found);
        (path, found)
    };
    sources.into_iter().map(read).collect()
}

fn read_sources(game: &Path, folder: &str, into: &mut Vec<(String, String)>) {
    for entry in fs::read_dir(game.join(folder)).expect("a source folder") {
        let entry = entry.expect("a folder entry");
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = format!("{folder}/{name}");
        if name == "tests" || name == "tests.rs" {
            continue;
        } else if entry.path().is_dir() {
            read_sources(game, &path, into);
        } else if name.ends_with(".rs") {
            into.push((path, fs::read_to_string(entry.path()).expect("a source")));
        }
    }
}

fn collect(tokens: TokenStream, found: &mut Literals) {
    let tokens: Vec<_> = tokens.into_iter().collect();
    let mut at = 0;
    while at < tokens.len() {
        match &tokens[at] {
            TokenTree::Punct(punct) if punct.as_char() == '#' => {
                at += 1 + usize::from(is_punct(tokens.get(at + 1), '!'));
                let Some(TokenTree::Group(attribute)) = tokens.get(at) else {
                    continue;
                };
                if is_cfg_test(attribute) {
                    at = end_of_item(&tokens, at);
                } else if is_error(attribute) {
                    collect_sentences(attribute, found);
                }
            }
            TokenTree::Ident(name) => {
                let bang = usize::from(is_punct(tokens.get(at + 1), '!'));
                if let Some(TokenTree::Group(group)) = tokens.get(at + 1 + bang) {
                    let name = name.to_string();
                    if bang == 1 && name == "text" {
                        ask(group, found);
                        at += 2;
                    } else if (bang == 1 && MACROS_NOT_SHOWN.contains(&name.as_str()))
                        || (bang == 0 && FUNCTIONS_NOT_SHOWN.contains(&name.as_str()))
                    {
                        at += 1 + bang;
                    }
                }
            }
            TokenTree::Group(group) => collect(group.stream(), found),
            TokenTree::Literal(literal) => {
                if let Some(string) = string_of(&literal.to_string()) {
                    found.strings.push((string, literal.span().start().line));
                }
            }
            TokenTree::Punct(_) => {}
        }
        at += 1;
    }
}

/// Records a call of `text!` and the strings in its arguments.
fn ask(group: &Group, found: &mut Literals) {
    let mut parts: Vec<Vec<TokenTree>> = vec![Vec::new()];
    for token in group.stream() {
        if is_punct(Some(&token), ',') {
            parts.push(Vec::new());
        } else if let Some(part) = parts.last_mut() {
            part.push(token);
        }
    }
    let mut parts = parts.into_iter();
    let id = parts.next().unwrap_or_default();
    let mut given = BTreeSet::new();
    for part in parts.filter(|part| !part.is_empty()) {
        if is_punct(part.get(1), '=') {
            given.insert(part[0].to_string());
            collect(part[2..].iter().cloned().collect(), found);
        } else {
            // The rest of a value with a comma of its own, as of a closure's arguments.
            collect(part.into_iter().collect(), found);
        }
    }
    match id.as_slice() {
        [TokenTree::Literal(literal)] => {
            if let Some(id) = string_of(&literal.to_string()) {
                found.asked.push((id, given, literal.span().start().line));
            }
        }
        _ => collect(id.into_iter().collect(), found),
    }
}

fn is_punct(token: Option<&TokenTree>, c: char) -> bool {
    matches!(token, Some(TokenTree::Punct(punct)) if punct.as_char() == c)
}

fn is_cfg_test(attribute: &Group) -> bool {
    let text = attribute.stream().to_string().replace(' ', "");
    text.starts_with("cfg(test)") || text.starts_with("cfg(all(test,")
}

/// Strings of an error that begin with a capital letter: sentences for the player. The others end a sentence
/// (`Cannot …: {why}`) in the words of the library that reports the fault.
fn collect_sentences(attribute: &Group, found: &mut Literals) {
    let mut error = Literals::default();
    collect(attribute.stream(), &mut error);
    found.asked.append(&mut error.asked);
    error
        .strings
        .retain(|(string, _)| string.starts_with(char::is_uppercase));
    found.strings.append(&mut error.strings);
}

fn is_error(attribute: &Group) -> bool {
    let first = attribute.stream().into_iter().next();
    matches!(first, Some(TokenTree::Ident(name)) if name == "error")
}

/// The last token of the item after an attribute: its body or its semicolon.
fn end_of_item(tokens: &[TokenTree], from: usize) -> usize {
    let length = tokens[from + 1..].iter().position(|token| match token {
        TokenTree::Group(group) => group.delimiter() == Delimiter::Brace,
        token => is_punct(Some(token), ';'),
    });
    from + 1 + length.unwrap_or(tokens.len())
}

/// The text of a string literal, escapes left as they are.
fn string_of(literal: &str) -> Option<String> {
    let body = literal
        .strip_prefix('r')
        .unwrap_or(literal)
        .trim_matches('#');
    let body = body.strip_prefix('"')?.strip_suffix('"')?;
    Some(body.replace("\\n", " "))
}
