//! Texts of the user interface: every sentence, label and message that the game shows, by identifier.
//!
//! `en.ftl` beside this crate's manifest holds all of them in the syntax of [Project
//! Fluent](https://projectfluent.org/fluent/guide/), so that a translator needs that file alone. A
//! translation is a file of the same identifiers, loaded by [`load_translation`]; missing messages stay
//! English.
//!
//! ```
//! use carom_text::text;
//!
//! let heading: &'static str = text!("menu-quit");
//! let score: String = text!("ball", number = 8);
//! assert_eq!(score, "the 8");
//! # let _ = heading;
//! ```
//!
//! The test `texts` checks that every identifier in the sources exists and gets its arguments.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, PoisonError, RwLock};

pub use fluent_bundle::FluentValue;
use fluent_bundle::concurrent::FluentBundle;
use fluent_bundle::{FluentArgs, FluentResource};
use fluent_syntax::ast;
use unic_langid::LanguageIdentifier;

/// The English texts, in Fluent syntax; the only complete set.
pub const ENGLISH: &str = include_str!("../en.ftl");

/// Largest size of a translation's file, in bytes: 25 times that of the English one.
const TRANSLATION_MAX: u64 = 1 << 20;

/// The text of an identifier: `&'static str` without arguments, `String` with them (`text!("id", name =
/// value, …)`).
///
/// A value is a string, a number or anything else that [`FluentValue`] is made from.
#[macro_export]
macro_rules! text {
    ($id:expr) => {
        $crate::plain($id)
    };
    ($id:expr, $($name:ident = $value:expr),+ $(,)?) => {
        $crate::format($id, [$((stringify!($name), $crate::FluentValue::from($value))),+])
    };
}

/// Reason why a translation cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TranslationError {
    /// A file that cannot be read.
    #[error("cannot read the translation {}: {fault}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's error.
        fault: std::io::Error,
    },
    /// A file that is not Fluent.
    #[error("the translation {} is not in Fluent's syntax: {fault}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Its first syntax error.
        fault: String,
    },
}

/// Loads a translation, a Fluent file of UTF-8 text up to 1 MiB, which applies to all later look-ups.
///
/// # Errors
/// If the file cannot be read or parsed, or is larger.
pub fn load_translation(path: &Path) -> Result<(), TranslationError> {
    let unreadable = |fault| TranslationError::Unreadable {
        path: path.to_owned(),
        fault,
    };
    let bytes = fs::metadata(path).map_err(unreadable)?.len();
    if bytes > TRANSLATION_MAX {
        return Err(unreadable(std::io::Error::other(format!(
            "it has {bytes} bytes, at most {TRANSLATION_MAX} are read"
        ))));
    }
    let source = fs::read_to_string(path).map_err(unreadable)?;
    let texts = Texts::new(Some(source)).map_err(|fault| TranslationError::Syntax {
        path: path.to_owned(),
        fault,
    })?;
    *TEXTS.write().unwrap_or_else(PoisonError::into_inner) = Some(Box::leak(Box::new(texts)));
    Ok(())
}

/// The text of an identifier without arguments; empty for an unknown one and for one with arguments.
#[must_use]
pub fn plain(id: &str) -> &'static str {
    texts().plain.get(id).copied().unwrap_or_default()
}

/// The text of an identifier with its arguments; empty for an unknown one.
#[must_use]
pub fn format<const N: usize>(id: &str, values: [(&'static str, FluentValue<'_>); N]) -> String {
    let args = FluentArgs::from_iter(values);
    texts().resolve(id, &args).0
}

/// The translation in use, if one is loaded. It is leaked, so that texts without arguments are `'static`.
static TEXTS: RwLock<Option<&'static Texts>> = RwLock::new(None);

fn texts() -> &'static Texts {
    static ENGLISH: LazyLock<Texts> =
        LazyLock::new(|| Texts::new(None).expect("the English texts are valid: a test reads them"));
    let translated = *TEXTS.read().unwrap_or_else(PoisonError::into_inner);
    translated.unwrap_or_else(|| &ENGLISH)
}

struct Texts {
    bundle: FluentBundle<FluentResource>,
    /// Formatted texts of the messages without arguments.
    plain: HashMap<String, &'static str>,
}

impl Texts {
    /// The English texts, overridden by those of a translation.
    fn new(translation: Option<String>) -> Result<Self, String> {
        let mut bundle = FluentBundle::new_concurrent(vec![
            LanguageIdentifier::from_bytes(b"en").expect("a language"),
        ]);
        // Unicode's bidirectional isolation marks would be drawn as boxes.
        bundle.set_use_isolating(false);
        let mut ids = Vec::new();
        for source in [Some(ENGLISH.to_owned()), translation]
            .into_iter()
            .flatten()
        {
            let resource = FluentResource::try_new(source).map_err(|(resource, faults)| {
                let told = faults.first().map(|fault| {
                    let before = resource.source().get(..fault.pos.start).unwrap_or_default();
                    format!("line {}: {fault}", 1 + before.matches('\n').count())
                });
                told.unwrap_or_default()
            })?;
            for entry in resource.entries() {
                if let ast::Entry::Message(message) = entry {
                    ids.push(message.id.name.to_owned());
                }
            }
            bundle.add_resource_overriding(resource);
        }
        let mut texts = Self {
            bundle,
            plain: HashMap::new(),
        };
        for id in ids {
            let (text, complete) = texts.resolve(&id, &FluentArgs::new());
            if complete {
                texts.plain.insert(id, text.leak());
            }
        }
        Ok(texts)
    }

    /// The text of a message, and whether all of its references could be resolved.
    fn resolve(&self, id: &str, args: &FluentArgs<'_>) -> (String, bool) {
        let pattern = self
            .bundle
            .get_message(id)
            .and_then(|message| message.value());
        let Some(pattern) = pattern else {
            return (String::new(), false);
        };
        let mut faults = Vec::new();
        let text = self.bundle.format_pattern(pattern, Some(args), &mut faults);
        (text.into_owned(), faults.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text_of(texts: &Texts, id: &str, values: &[(&'static str, FluentValue<'static>)]) -> String {
        texts.resolve(id, &values.iter().cloned().collect()).0
    }

    #[test]
    fn a_translation_overrides_its_messages_and_the_rest_stays_english() {
        let german = "menu-quit = Beenden\nball = die { $number }\n";
        let texts = Texts::new(Some(german.to_owned())).expect("two messages");
        assert_eq!(texts.plain["menu-quit"], "Beenden");
        assert_eq!(text_of(&texts, "ball", &[("number", 8.into())]), "die 8");
        assert_eq!(texts.plain["menu-settings"], plain("menu-settings"));
    }

    #[test]
    fn a_translation_that_cannot_be_read_is_refused_with_its_path() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("de.ftl");
        let refusal = |path: &Path| {
            load_translation(path)
                .expect_err("no translation")
                .to_string()
        };
        assert!(refusal(&path).contains("de.ftl"));
        fs::write(&path, "menu-back = Zurück\nmenu quit = Beenden").expect("a file");
        let said = refusal(&path);
        assert!(
            said.contains("de.ftl") && said.contains("syntax: line 2"),
            "{said}"
        );
        fs::write(&path, vec![b'#'; TRANSLATION_MAX as usize + 1]).expect("a file");
        assert!(refusal(&path).contains("1048577 bytes"));
    }

    #[test]
    fn messages_with_arguments_have_no_plain_text() {
        assert_eq!(plain("ball"), "");
        assert_eq!(plain("no-such-text"), "");
        assert_eq!(text!("ball", number = 8), "the 8");
    }
}
