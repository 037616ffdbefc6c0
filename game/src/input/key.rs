//! Keys by physical position, so that W A S D are adjacent on every layout, mouse buttons and wheel. Their
//! labels are the same in the settings file and in the interface.

/// A key, identified by its label in settings and help, one of [`KEYS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key(pub(super) &'static str);

impl Key {
    /// The key of a code of the W3C's "UI Events KeyboardEvent code Values", which windowing libraries also
    /// use; none if it cannot be bound.
    pub fn from_code(code: &str) -> Option<Self> {
        let (_, label) = KEYS.iter().find(|(of, _)| *of == code)?;
        Some(Self(label))
    }

    /// The key with this label, ignoring case.
    pub fn from_label(label: &str) -> Option<Self> {
        let (_, label) = KEYS.iter().find(|(_, of)| of.eq_ignore_ascii_case(label))?;
        Some(Self(label))
    }

    /// Label in the interface and the settings file.
    pub fn label(self) -> &'static str {
        self.0
    }
}

/// A mouse button.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Button {
    Left,
    Middle,
    Right,
    Back,
    Forward,
}

impl Button {
    /// All buttons.
    pub const ALL: [Self; 5] = [
        Self::Left,
        Self::Middle,
        Self::Right,
        Self::Back,
        Self::Forward,
    ];

    /// Label in the interface and the settings file.
    pub fn label(self) -> &'static str {
        match self {
            Self::Left => "Mouse left",
            Self::Middle => "Mouse middle",
            Self::Right => "Mouse right",
            Self::Back => "Mouse back",
            Self::Forward => "Mouse forward",
        }
    }
}

/// Labels of the wheel, turned away from the player and towards the player.
pub(super) const WHEEL: [&str; 2] = ["Wheel up", "Wheel down"];

/// Keys that exist on both sides: the common name, and both keys.
pub(super) const TWICE: [(&str, [Key; 2]); 3] = [
    ("Ctrl", [Key("Left Ctrl"), Key("Right Ctrl")]),
    ("Shift", [Key("Left Shift"), Key("Right Shift")]),
    ("Alt", [Key("Left Alt"), Key("Right Alt")]),
];

/// Codes and labels of the keys that can be bound.
pub const KEYS: [(&str, &str); 101] = [
    ("KeyA", "A"),
    ("KeyB", "B"),
    ("KeyC", "C"),
    ("KeyD", "D"),
    ("KeyE", "E"),
    ("KeyF", "F"),
    ("KeyG", "G"),
    ("KeyH", "H"),
    ("KeyI", "I"),
    ("KeyJ", "J"),
    ("KeyK", "K"),
    ("KeyL", "L"),
    ("KeyM", "M"),
    ("KeyN", "N"),
    ("KeyO", "O"),
    ("KeyP", "P"),
    ("KeyQ", "Q"),
    ("KeyR", "R"),
    ("KeyS", "S"),
    ("KeyT", "T"),
    ("KeyU", "U"),
    ("KeyV", "V"),
    ("KeyW", "W"),
    ("KeyX", "X"),
    ("KeyY", "Y"),
    ("KeyZ", "Z"),
    ("Digit0", "0"),
    ("Digit1", "1"),
    ("Digit2", "2"),
    ("Digit3", "3"),
    ("Digit4", "4"),
    ("Digit5", "5"),
    ("Digit6", "6"),
    ("Digit7", "7"),
    ("Digit8", "8"),
    ("Digit9", "9"),
    ("F1", "F1"),
    ("F2", "F2"),
    ("F3", "F3"),
    ("F4", "F4"),
    ("F5", "F5"),
    ("F6", "F6"),
    ("F7", "F7"),
    ("F8", "F8"),
    ("F9", "F9"),
    ("F10", "F10"),
    ("F11", "F11"),
    ("F12", "F12"),
    ("ArrowLeft", "Left"),
    ("ArrowRight", "Right"),
    ("ArrowUp", "Up"),
    ("ArrowDown", "Down"),
    ("Space", "Space"),
    ("Enter", "Enter"),
    ("Escape", "Esc"),
    ("Tab", "Tab"),
    ("Backspace", "Backspace"),
    ("Insert", "Insert"),
    ("Delete", "Delete"),
    ("Home", "Home"),
    ("End", "End"),
    ("PageUp", "Page up"),
    ("PageDown", "Page down"),
    ("ControlLeft", "Left Ctrl"),
    ("ControlRight", "Right Ctrl"),
    ("ShiftLeft", "Left Shift"),
    ("ShiftRight", "Right Shift"),
    ("AltLeft", "Left Alt"),
    ("AltRight", "Right Alt"),
    ("CapsLock", "Caps lock"),
    ("Pause", "Pause"),
    ("Minus", "-"),
    ("Equal", "="),
    ("BracketLeft", "["),
    ("BracketRight", "]"),
    ("Backslash", "\\"),
    ("IntlBackslash", "<"),
    ("Semicolon", ";"),
    ("Quote", "'"),
    ("Backquote", "`"),
    ("Comma", ","),
    ("Period", "."),
    ("Slash", "/"),
    ("NumLock", "Num lock"),
    ("Numpad0", "Pad 0"),
    ("Numpad1", "Pad 1"),
    ("Numpad2", "Pad 2"),
    ("Numpad3", "Pad 3"),
    ("Numpad4", "Pad 4"),
    ("Numpad5", "Pad 5"),
    ("Numpad6", "Pad 6"),
    ("Numpad7", "Pad 7"),
    ("Numpad8", "Pad 8"),
    ("Numpad9", "Pad 9"),
    ("NumpadAdd", "Pad +"),
    ("NumpadSubtract", "Pad -"),
    ("NumpadMultiply", "Pad *"),
    ("NumpadDivide", "Pad /"),
    ("NumpadDecimal", "Pad ."),
    ("NumpadEnter", "Pad Enter"),
    ("ContextMenu", "Menu"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_and_codes_name_one_key_each() {
        for (code, label) in KEYS {
            assert_eq!(Key::from_code(code), Some(Key(label)));
            assert_eq!(Key::from_label(&label.to_uppercase()), Some(Key(label)));
        }
        assert_eq!(Key::from_code("Fn"), None);
    }
}
