//! Ranges of a film's frames, by which a render queue divides it among machines.

use std::fmt;
use std::str::FromStr;

use crate::error::Error;

/// Range of frames, both ends included; the first frame of a film is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    first: u32,
    last: u32,
}

impl FrameRange {
    /// All frames.
    pub const ALL: Self = Self {
        first: 0,
        last: u32::MAX,
    };

    /// The first frame.
    pub const fn first(self) -> u32 {
        self.first
    }

    /// Whether the range contains a frame.
    pub const fn contains(self, frame: u32) -> bool {
        self.first <= frame && frame <= self.last
    }

    /// The part of the range within a film of `frames` frames: the last of several equal ranges may extend
    /// beyond the film.
    ///
    /// # Errors
    /// [`Error::NoFrameOfRange`] if that part is empty.
    pub fn of_film(self, frames: u32) -> Result<Self, Error> {
        if self.first >= frames {
            let first = self.first;
            return Err(Error::NoFrameOfRange { first, frames });
        }
        let last = self.last.min(frames - 1);
        Ok(Self { last, ..self })
    }

    /// Number of frames.
    pub const fn count(self) -> u32 {
        (self.last - self.first).saturating_add(1)
    }
}

/// `A-B`, or `A` for one frame.
impl FromStr for FrameRange {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        let range = match (first.parse(), last.parse()) {
            (Ok(first), Ok(last)) if first <= last => Some(Self { first, last }),
            _ => None,
        };
        range.ok_or_else(|| Error::FrameRange(text.to_owned()))
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.first, self.last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_include_both_ends_and_end_with_the_film() {
        let range: FrameRange = "10-19".parse().unwrap();
        assert_eq!(range.count(), 10);
        assert!(range.contains(10) && range.contains(19) && !range.contains(20));
        assert_eq!(range.of_film(15).unwrap().count(), 5);
        assert_eq!("7".parse::<FrameRange>().unwrap().count(), 1);
        assert_eq!(FrameRange::ALL.of_film(48).unwrap().count(), 48);
        let why = range.of_film(10).unwrap_err().to_string();
        assert!(why.contains("of 10 frames"), "{why}");
    }

    #[test]
    fn what_is_no_range_is_refused() {
        for text in ["", "-", "3-", "-3", "4-3", "1-2-3", "a-b", "1..2"] {
            let why = text.parse::<FrameRange>().unwrap_err().to_string();
            assert!(why.contains("0-9"), "{text}: {why}");
        }
    }
}
