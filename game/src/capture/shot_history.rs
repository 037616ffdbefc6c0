//! History of the shots played since the program started, for replays on the free table.

use carom_billiards::physics::{Clip, Shot};

use carom_text::text;

use super::timeline_events;

/// Shots in the order in which they were played.
#[derive(Clone, Debug, Default)]
pub struct ShotHistory {
    clips: Vec<Clip>,
    /// Number of the last recorded shot.
    last: u64,
}

impl ShotHistory {
    /// Adds a shot; each number once.
    pub fn record(&mut self, number: u64, shot: &Shot) {
        if number <= self.last {
            return;
        }
        self.last = number;
        if self.clips.len() == SHOTS_MAX {
            self.clips.remove(0);
        }
        self.clips.push(Clip {
            title: shot_title(number, shot),
            shot: shot.clone(),
        });
    }

    /// The shots with their titles.
    pub fn clips(&self) -> &[Clip] {
        &self.clips
    }
}

/// Title of a shot, such as "Shot 3: the cue strikes at 2.1 m/s, the 5 is potted".
pub fn shot_title(number: u64, shot: &Shot) -> String {
    let events = timeline_events(shot).into_iter();
    let rare = events.filter(|event| !event.is_contact);
    let words: Vec<String> = rare
        .map(|event| event.words)
        .take(TITLE_EVENTS_MAX)
        .collect();
    text!("shot-title", number = number, events = words.join(", "))
}

/// Largest number of shots kept; older ones are dropped.
const SHOTS_MAX: usize = 500;
/// Largest number of events in a title.
const TITLE_EVENTS_MAX: usize = 6;
