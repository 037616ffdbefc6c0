//! The menu's pages under the keys, and what asks before something is lost.

use carom::input::{Event, GamepadControl};
use carom::ui::menu::Page;
use carom_billiards::rules::RuleSet;
use carom_window::theme;
use egui::{Key, Modifiers, Rect, Shape};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use crate::player::{Seat, WINDOW, click, harness, harness_of, press};

/// Presses a key for the game and for egui, as a window does.
fn press_both(harness: &mut Harness<'_, Seat>, label: &str, key: Key) {
    harness.state_mut().key(label);
    harness.key_press(key);
    harness.run_steps(6);
}

#[test]
fn an_unfinished_match_is_given_up_only_if_that_is_confirmed() {
    let mut harness = harness(Seat::eight());
    press(&mut harness, "Enter");
    harness.state_mut().wait();
    harness.run_steps(4);
    press(&mut harness, "Esc");
    for entry in ["New game", "9-ball", "Begin"] {
        click(&mut harness, entry);
    }
    let rules =
        |harness: &mut Harness<'_, Seat>| harness.state_mut().session.match_hud().view.rules;
    assert_eq!(harness.state().shell.page(), Some(Page::GiveUp));
    click(&mut harness, "Keep playing it");
    assert_eq!(harness.state().shell.page(), Some(Page::NewGame));
    assert_eq!(rules(&mut harness), RuleSet::Eight);
    for entry in ["Begin", "Give it up and begin"] {
        click(&mut harness, entry);
    }
    assert_eq!(harness.state().shell.page(), None);
    assert_eq!(rules(&mut harness), RuleSet::Nine);
}

#[test]
fn escape_closes_an_open_list_before_its_page() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "F5");
    assert!(!harness.state().session.is_game());
    harness.get_by_label_contains("Trick").click();
    harness.run_steps(4);
    assert!(harness.query_by_label_contains("Sand trap").is_some());
    let is_back = |harness: &Harness<'_, Seat>| {
        let b = Event::Gamepad {
            control: GamepadControl::B,
            pressed: true,
        };
        harness.state().shell.page_key(b) == Some((Key::Escape, Modifiers::NONE))
    };
    assert!(is_back(&harness), "a gamepad's B does what Esc does");
    press_both(&mut harness, "Esc", Key::Escape);
    assert!(harness.query_by_label_contains("Sand trap").is_none());
    assert!(!harness.state().session.is_game(), "the page was left");
    assert!(!is_back(&harness));
    press_both(&mut harness, "Esc", Key::Escape);
    assert!(harness.state().session.is_game());
}

#[test]
fn arrows_go_on_from_the_end_of_a_row() {
    let mut harness = harness_of(Seat::free(), WINDOW * 1.5);
    press(&mut harness, "Esc");
    click(&mut harness, "New game");
    let mut seen = Vec::new();
    for _ in 0..30 {
        let id = harness.ctx.memory(|memory| memory.focused());
        seen.push(id);
        harness.key_press(Key::ArrowRight);
        harness.run_steps(4);
    }
    let stays = seen.windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert_eq!(stays, 0, "the keyboard stays in a place");
}

/// Outlines of the focused widget.
fn outlines(harness: &Harness<'_, Seat>) -> Vec<Rect> {
    let shapes = harness.output().shapes.iter();
    let outlines = shapes.filter_map(|clipped| match &clipped.shape {
        Shape::Rect(shape) if shape.stroke.color == theme::FOCUS => Some(shape.rect),
        _ => None,
    });
    outlines.collect()
}

#[test]
fn the_keyboard_is_outlined_unlike_the_pointer() {
    let mut harness = harness_of(Seat::free(), WINDOW);
    press(&mut harness, "Esc");
    click(&mut harness, "Settings");
    let back = harness.get_by_label("Back").rect();
    for pointed in ["Back", "Restore the defaults"] {
        harness.get_by_label(pointed).hover();
        harness.run_steps(4);
        let outlines = outlines(&harness);
        assert_eq!(outlines.len(), 1, "over {pointed}: {outlines:?}");
        assert!(
            outlines[0].contains_rect(back),
            "{outlines:?} not round {back}"
        );
    }
}
