//! A newcomer who only does what the screen says.

use std::time::Duration;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use crate::player::{Seat, at, click, harness_of, press};

fn says(harness: &Harness<'_, Seat>, words: &str) -> bool {
    harness.query_all_by_label_contains(words).next().is_some()
}

/// Follows the instruction on screen.
fn obey(harness: &mut Harness<'_, Seat>) {
    if says(harness, "Move the mouse: it turns the cue") {
        for x in [600.0, 603.0] {
            harness.state_mut().handle(at(x, 300.0), false);
        }
    } else if says(harness, "click to put it down") || says(harness, "or press Enter") {
        press(harness, "Enter");
    } else if says(harness, "Press F9 for a suggested shot, then Enter") {
        press(harness, "F9");
        while harness.state().session.game().is_thinking() {
            // In real time, which the computer's search runs in.
            std::thread::sleep(Duration::from_millis(50));
            harness.run_steps(1);
        }
        press(harness, "Enter");
    }
    harness.run_steps(1);
    while harness.state().session.shot().is_some() {
        harness.run_steps(1);
    }
    harness.run_steps(4);
}

#[test]
fn a_newcomer_pots_within_a_minute_of_play() {
    let mut seat = Seat::free();
    seat.shell.welcome();
    let mut harness = harness_of(seat, egui::Vec2::new(1280.0, 720.0));
    click(&mut harness, "Practice");
    let begun = harness.state().now_secs;
    let balls = |harness: &Harness<'_, Seat>| {
        let positions = harness.state().session.game().contest().ball_positions();
        positions.iter().filter(|p| p.ball != 0).count()
    };
    while balls(&harness) == 15 {
        obey(&mut harness);
        let played_secs = harness.state().now_secs - begun;
        assert!(played_secs < 60.0, "nothing fell");
    }
}
