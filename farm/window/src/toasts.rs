//! Temporary messages over the picture about what has changed, never ones that require an answer.

use std::collections::VecDeque;

use egui::{ScrollArea, Ui};

use crate::theme;

/// Messages on display.
#[derive(Clone, Debug, Default)]
pub struct Toasts {
    lines: VecDeque<Toast>,
    ticked_secs: f64,
}

#[derive(Clone, Debug)]
struct Toast {
    sentence: String,
    until_secs: f64,
    /// Whether the next answer replaces it.
    is_answer: bool,
}

impl Toasts {
    /// Shows a message from `now_secs` on, long enough to be read twice; the oldest is dropped if there are
    /// too many.
    pub fn push(&mut self, sentence: String, now_secs: f64) {
        self.add(sentence, now_secs, false);
    }

    /// Shows the response to a user's action, replacing the previous response.
    pub fn answer(&mut self, sentence: String, now_secs: f64) {
        self.lines.retain(|toast| !toast.is_answer);
        self.add(sentence, now_secs, true);
    }

    fn add(&mut self, sentence: String, now_secs: f64, is_answer: bool) {
        let secs = STAY_SECS + sentence.chars().count() as f64 / LETTERS_PER_SEC;
        self.lines.push_back(Toast {
            sentence,
            until_secs: now_secs + secs,
            is_answer,
        });
        while self.lines.len() > LINES_MAX {
            self.lines.pop_front();
        }
    }

    /// Removes expired messages; returns whether any was removed. Time while nothing `is_shown` does not
    /// count.
    pub fn tick(&mut self, now_secs: f64, is_shown: bool) -> bool {
        let unread_secs = match is_shown {
            true => 0.0,
            false => now_secs - self.ticked_secs,
        };
        self.ticked_secs = now_secs;
        for toast in &mut self.lines {
            toast.until_secs += unread_secs;
        }
        let before = self.lines.len();
        self.lines.retain(|toast| toast.until_secs > now_secs);
        self.lines.len() < before
    }

    /// The time at which the next message expires.
    pub fn next_secs(&self) -> Option<f64> {
        let ends = self.lines.iter().map(|toast| toast.until_secs);
        ends.reduce(f64::min)
    }

    /// Whether there are no messages.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// Draws the messages below `standing` ones, which stay as long as their cause.
    pub fn show(&self, ui: &mut Ui, standing: &[String]) {
        theme::frame().show(ui, |ui| {
            ui.set_max_width(WIDTH.min(ui.available_width()));
            let height = 0.6 * ui.available_height();
            ScrollArea::vertical().max_height(height).show(ui, |ui| {
                let lines = self.lines.iter().map(|toast| &toast.sentence);
                for sentence in standing.iter().chain(lines) {
                    ui.label(sentence);
                }
            });
        });
    }
}

const STAY_SECS: f64 = 4.0;
/// Characters per second of display: half of a slow reader's speed.
const LETTERS_PER_SEC: f64 = 8.0;
const LINES_MAX: usize = 4;
const WIDTH: f32 = 520.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn toasts_last_as_long_as_reading_takes() {
        let mut notes = Toasts::default();
        for i in 0..6 {
            notes.push(format!("sentence {i}"), f64::from(i));
        }
        assert_eq!(notes.lines.len(), LINES_MAX);
        assert!(notes.lines[0].sentence.ends_with('2'));
        let next = notes.next_secs().unwrap();
        assert!(next > 2.0 + STAY_SECS && !notes.tick(next - 0.1, true));
        assert!(notes.tick(next + 0.1, true) && notes.lines.len() == LINES_MAX - 1);
    }

    #[test]
    fn an_answer_takes_the_place_of_the_last_and_leaves() {
        let mut toasts = Toasts::default();
        toasts.push("a node was lost".to_owned(), 0.0);
        for view in ["View: from above", "View: free"] {
            toasts.answer(view.to_owned(), 1.0);
        }
        let sentences: Vec<&str> = toasts.lines.iter().map(|toast| &*toast.sentence).collect();
        assert_eq!(sentences, ["a node was lost", "View: free"]);
        assert!(toasts.tick(10.0, true) && toasts.lines.is_empty());
    }
}
