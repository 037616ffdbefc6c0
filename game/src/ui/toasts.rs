//! Sentences that come and go at the upper right: what changed, never anything that must be answered.

use std::collections::VecDeque;

use egui::{Align2, Area, Context, Id, Order, Rect};

use super::theme;

/// The sentences on show.
#[derive(Clone, Debug, Default)]
pub struct Toasts {
    lines: VecDeque<(String, f64)>,
}

impl Toasts {
    /// Shows a sentence from `now_secs` on, long enough to be read twice; the oldest gives way.
    pub fn push(&mut self, sentence: String, now_secs: f64) {
        let secs = STAY_SECS + sentence.chars().count() as f64 / LETTERS_PER_SEC;
        self.lines.push_back((sentence, now_secs + secs));
        while self.lines.len() > LINES_MAX {
            self.lines.pop_front();
        }
    }

    /// Drops what has been read; says whether anything was.
    pub fn tick(&mut self, now_secs: f64) -> bool {
        let before = self.lines.len();
        self.lines.retain(|(_, until)| *until > now_secs);
        self.lines.len() < before
    }

    /// When the next sentence goes.
    pub fn next_secs(&self) -> Option<f64> {
        self.lines.iter().map(|(_, until)| *until).reduce(f64::min)
    }

    /// Draws them in a part of the window.
    pub fn draw(&self, ctx: &Context, room: Rect) {
        if self.lines.is_empty() {
            return;
        }
        Area::new(Id::unique("notes"))
            .order(Order::Foreground)
            .constrain_to(room)
            .anchor(Align2::RIGHT_TOP, egui::vec2(-12.0, 10.0))
            .interactable(false)
            .show(ctx, |ui| {
                ui.set_max_width(WIDTH.min(0.5 * room.width()));
                for (sentence, _) in &self.lines {
                    theme::frame().show(ui, |ui| ui.label(sentence));
                }
            });
    }
}

const STAY_SECS: f64 = 4.0;
/// A slow reader's speed, twice over.
const LETTERS_PER_SEC: f64 = 8.0;
const LINES_MAX: usize = 4;
const WIDTH: f32 = 420.0;

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
        assert!(notes.lines[0].0.ends_with('2'));
        let next = notes.next_secs().unwrap();
        assert!(next > 2.0 + STAY_SECS && !notes.tick(next - 0.1));
        assert!(notes.tick(next + 0.1) && notes.lines.len() == LINES_MAX - 1);
    }
}
