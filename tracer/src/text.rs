//! Text for display: sanitises untrusted text before it reaches a terminal, a log or a user
//! interface; and formats errors with their causes.

use std::error::Error;

/// `text` without characters that control a terminal, truncated to `bytes_max` bytes.
///
/// Control characters (C0, DEL and C1, and thus every escape sequence) and bidirectional formatting
/// characters, which change the order in which letters are displayed, are removed. Line breaks
/// become spaces, so that no text can imitate a line of its own.
///
/// ```
/// use carom_tracer::text::printable;
///
/// assert_eq!(printable("oak\u{1b}[2J\r\nready", 64), "oak[2J  ready");
/// assert_eq!(printable("möbius", 2), "m");
/// ```
pub fn printable(text: &str, bytes_max: usize) -> String {
    let mut printable = String::with_capacity(text.len().min(bytes_max));
    for letter in text.chars() {
        let letter = if letter.is_whitespace() { ' ' } else { letter };
        if letter.is_control() || is_bidirectional_format(letter) {
            continue;
        }
        if printable.len() + letter.len_utf8() > bytes_max {
            break;
        }
        printable.push(letter);
    }
    printable
}

/// An error and its causes in one line. A cause with which the message so far ends is not repeated.
pub fn with_causes(error: &(dyn Error + 'static)) -> String {
    let mut told = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let why = cause.to_string();
        if !told.ends_with(&why) {
            told = format!("{told}: {why}");
        }
        source = cause.source();
    }
    told
}

/// The characters with the property `Bidi_Control` (Unicode Standard Annex 9, 2).
const fn is_bidirectional_format(letter: char) -> bool {
    matches!(letter,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Maximum length in bytes of a sentence about untrusted data.
pub const SENTENCE_BYTES_MAX: usize = 1024;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_told_once() {
        #[derive(Debug, thiserror::Error)]
        #[error("back end cpu")]
        struct Outer(#[source] crate::Error);
        let full = || std::io::Error::from(std::io::ErrorKind::StorageFull);
        let refused = Outer(crate::Error::Io {
            path: "a.exr".into(),
            source: full(),
        });
        let line = format!("back end cpu: a.exr: {}", full());
        assert_eq!(with_causes(&refused), line);
    }

    #[test]
    fn printable_text_controls_no_terminal() {
        let every: String = (0..0x3000).filter_map(char::from_u32).collect();
        let text = printable(&every, usize::MAX);
        assert!(!text.contains(|letter: char| letter.is_control()));
        assert!(!text.contains(['\u{202e}', '\u{2067}', '\u{2028}', '\u{9b}']));
        assert!(text.contains("xyz"));
        assert_eq!(printable(&text, usize::MAX), text);
    }

    #[test]
    fn printable_text_is_cut_between_characters() {
        for bytes_max in 0..12 {
            let text = printable("€€€€", bytes_max);
            assert_eq!(text.len(), bytes_max / 3 * 3);
        }
    }
}
