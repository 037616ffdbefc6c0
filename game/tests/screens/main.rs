//! The game's screens as a person meets them: by their words, by pressing them, and by how they look.
//! There is no farm: the table is played all the same.

mod layout;
#[path = "../../../farm/window/tests/looks/mod.rs"]
mod looks;
mod menu;
mod newcomer;
mod pictures;
mod player;

use carom::input::{ACTIONS, Button, Event};
use carom::ui::menu::Page;
use carom_billiards::rules::RuleSet;
use egui::Vec2;
use egui::accesskit::Toggled;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use player::{Seat, at, click, harness, harness_of, press};

#[test]
fn the_menu_leads_to_every_page_and_back_and_out() {
    // High enough for the page of settings.
    let mut harness = harness_of(Seat::free(), Vec2::new(1280.0, 1440.0));
    for (entry, page) in [("New game", Page::NewGame), ("Settings", Page::Settings)] {
        press(&mut harness, "Esc");
        assert_eq!(harness.state().shell.page(), Some(Page::Top));
        click(&mut harness, entry);
        assert_eq!(harness.state().shell.page(), Some(page));
        click(&mut harness, "Back");
        assert_eq!(harness.state().shell.page(), Some(Page::Top));
        click(&mut harness, "Resume");
        assert_eq!(harness.state().shell.page(), None);
    }
    press(&mut harness, "Esc");
    click(&mut harness, "Keys and mouse");
    assert_eq!(harness.state().shell.page(), Some(Page::Keys));
    for page in [Some(Page::Top), None] {
        press(&mut harness, "Esc");
        assert_eq!(harness.state().shell.page(), page);
    }
    press(&mut harness, "Esc");
    click(&mut harness, "Settings");
    click(&mut harness, "Change the controls");
    for page in [Some(Page::Settings), Some(Page::Top), None] {
        press(&mut harness, "Esc");
        assert_eq!(harness.state().shell.page(), page);
    }
    press(&mut harness, "Esc");
    assert!(!harness.state().has_quit);
    click(&mut harness, "Quit");
    assert!(harness.state().has_quit);
}

#[test]
fn new_games_show_their_players() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "Esc");
    for entry in ["New game", "9-ball", "A person at this machine", "Begin"] {
        click(&mut harness, entry);
    }
    assert_eq!(harness.state().shell.page(), None);
    assert_eq!(
        harness.state_mut().session.match_hud().view.rules,
        RuleSet::Nine
    );
    for words in ["Player 1", "Player 2", "9-ball"] {
        assert!(
            harness.query_all_by_label_contains(words).count() > 0,
            "{words}"
        );
    }
}

#[test]
fn settings_are_changed_by_pressing_them() {
    // High enough for all settings.
    let mut harness = harness_of(Seat::free(), Vec2::new(1280.0, 1280.0));
    press(&mut harness, "Esc");
    for entry in ["Settings", "Reduced motion", "125 %", "Glass"] {
        click(&mut harness, entry);
    }
    let settings = harness.state().shell.settings();
    assert!(settings.reduced_motion && settings.text_scale == 1.25);
    assert_eq!(
        settings.style.balls,
        carom::scene::ball_materials::BallSet::Glass
    );
    click(&mut harness, "Restore the defaults");
    assert_eq!(harness.state().shell.settings().text_scale, 1.0);
}

#[test]
fn the_list_of_keys_names_every_control() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "F1");
    for control in ACTIONS {
        assert!(
            harness.query_by_label(control.does()).is_some(),
            "{}",
            control.does()
        );
    }
    let title = harness.get_by_label("Keys and mouse").rect();
    let first = harness.get_by_label("Aim").rect();
    assert!(title.bottom() <= first.top(), "{title} over {first}");
    press(&mut harness, "Esc");
    assert!(harness.query_by_label("Keys and mouse").is_none());
}

#[test]
fn a_shot_is_looked_back_at_stopped_stepped_and_left() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "F4");
    assert!(!harness.state().session.is_replay(), "there is nothing yet");
    press(&mut harness, "Enter");
    harness.state_mut().wait();
    press(&mut harness, "F4");
    assert!(harness.state().session.is_replay());
    click(&mut harness, "Pause");
    for words in ["Event ▶", "1/4×", "Play"] {
        click(&mut harness, words);
    }
    assert!(harness.query_by_label("Pause").is_some(), "it goes on");
    click(&mut harness, "Pause");
    let before = harness.state().viewpoint();
    press(&mut harness, "O");
    assert_ne!(harness.state().viewpoint(), before, "it is seen from above");
    click(&mut harness, "Back to the game");
    assert!(harness.state().session.is_game());
}

#[test]
fn numbers_add_and_remove_balls_in_practice() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "F5");
    let is_there = |harness: &egui_kittest::Harness<'_, Seat>| {
        harness.get_by_label("9").accesskit_node().toggled() == Some(Toggled::True)
    };
    assert!(is_there(&harness));
    click(&mut harness, "9");
    assert!(!is_there(&harness));
    click(&mut harness, "Discard changes");
    press(&mut harness, "F5");
    assert!(is_there(&harness));
    click(&mut harness, "9");
    click(&mut harness, "Play");
    assert!(harness.state().session.is_game());
    press(&mut harness, "F5");
    assert!(!is_there(&harness), "it is played without the 9");
}

#[test]
fn the_page_of_a_replay_is_worked_with_keys_alone() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "Enter");
    harness.state_mut().wait();
    press(&mut harness, "F4");
    press(&mut harness, "Space");
    assert!(harness.query_by_label("Play").is_some(), "it stands");
    let view = harness.state().viewpoint();
    press(&mut harness, "2");
    assert_eq!(harness.state().viewpoint(), view, "2 is a speed here");
    for _ in 0..20 {
        press(&mut harness, "Left");
    }
    for (key, moment) in [
        ("Right", " 0.10 / "),
        ("Right", " 0.20 / "),
        ("Left", " 0.10 / "),
    ] {
        press(&mut harness, key);
        assert!(harness.query_by_label_contains(moment).is_some(), "{key}");
    }
    press(&mut harness, "Esc");
    assert!(harness.state().session.is_game());
}

#[test]
fn replay_keys_can_be_rebound() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    std::fs::write(&path, "[keys]\nreplay-pause = \"G\"\n").unwrap();
    let mut harness = harness(Seat::kept_in(path));
    press(&mut harness, "Enter");
    harness.state_mut().wait();
    press(&mut harness, "F4");
    assert!(harness.query_by_label_contains("G play/pause").is_some());
    for (key, button) in [("Space", "Pause"), ("G", "Play")] {
        press(&mut harness, key);
        assert!(harness.query_by_label(button).is_some(), "{key}");
    }
}

#[test]
fn power_and_spin_stay_on_screen_during_strokes() {
    let shown = |harness: &egui_kittest::Harness<'_, Seat>, what: &str| {
        for words in ["Power ", "m/s", "Spin "] {
            let found = harness.query_all_by_label_contains(words).count();
            assert!(found > 0, "{words} while {what}");
        }
    };
    let mut harness = harness(Seat::eight());
    let down = |harness: &mut egui_kittest::Harness<'_, Seat>, button, pressed| {
        let event = Event::Button { button, pressed };
        harness.state_mut().handle(event, false);
        harness.run_steps(2);
    };
    harness.state_mut().handle(at(500.0, 200.0), false);
    down(&mut harness, Button::Left, true);
    harness.state_mut().handle(at(500.0, 310.0), false);
    harness.run_steps(2);
    shown(&harness, "pulling");
    assert!(
        harness
            .query_by_label_contains("Power 50 %, 2.61 m/s")
            .is_some()
    );
    press(&mut harness, "Esc");
    down(&mut harness, Button::Left, false);
    for (key, what) in [("Space", "charging"), ("F", "swinging")] {
        harness.state_mut().hold(key, true);
        harness.run_steps(4);
        shown(&harness, what);
        press(&mut harness, "Esc");
        harness.state_mut().hold(key, false);
    }
    harness.state_mut().key("Enter");
    harness.run_steps(2);
    assert!(harness.state().session.shot().is_some());
    shown(&harness, "striking");
}

#[test]
fn the_menu_stops_balls_and_computers() {
    let mut harness = harness(Seat::match_of(RuleSet::Eight, "Ada,ai:easy"));
    press(&mut harness, "Enter");
    let clock = |harness: &egui_kittest::Harness<'_, Seat>| {
        let seat = harness.state();
        seat.session.shot_clock(seat.now_secs)
    };
    harness.run_steps(10);
    let before = clock(&harness).unwrap().now_secs;
    press(&mut harness, "Esc");
    harness.run_steps(400);
    assert_eq!(clock(&harness), None, "no time passes");
    click(&mut harness, "Resume");
    let after = clock(&harness).unwrap();
    assert!(after.now_secs < before + 2.0, "{after:?} after {before}");
    harness.state_mut().wait();
    harness.run_steps(2);
    let shots = harness.state().session.shots();
    press(&mut harness, "Esc");
    for _ in 0..200 {
        harness.run_steps(1);
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert_eq!(harness.state().session.shots(), shots, "the computer waits");
}

#[test]
fn a_result_offers_rematch_new_game_and_replays() {
    for (entry, is_over) in [("Rematch", false), ("Back to the table", true)] {
        let mut harness = harness(Seat::lost());
        assert_eq!(harness.state().shell.page(), Some(Page::Result));
        for words in ["Bo won the match", "Ada conceded", "New game", "Replays"] {
            assert!(harness.query_by_label(words).is_some(), "{words}");
        }
        click(&mut harness, entry);
        assert_eq!(harness.state().shell.page(), None);
        assert_eq!(harness.state().session.is_over(), is_over);
        harness.state_mut().key("Enter");
        harness.run_steps(2);
        let page = harness.state().shell.page();
        assert_eq!(page.is_some(), is_over, "Enter strikes or leads on");
    }
}

#[test]
fn the_chosen_line_of_a_menu_goes_round() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "Esc");
    let is_chosen = |harness: &egui_kittest::Harness<'_, Seat>, words: &str| {
        harness.get_by_label(words).accesskit_node().is_focused()
    };
    assert!(is_chosen(&harness, "Resume"));
    for (key, words) in [
        (egui::Key::ArrowUp, "Quit"),
        (egui::Key::ArrowDown, "Resume"),
        (egui::Key::ArrowDown, "New game"),
    ] {
        harness.key_press(key);
        harness.run_steps(2);
        assert!(is_chosen(&harness, words), "{words}");
    }
    let settings = harness.get_by_label("Settings").rect();
    harness.hover_at(settings.center());
    harness.run_steps(2);
    assert!(is_chosen(&harness, "Settings"), "one line is chosen");
}

#[test]
fn answers_leave_by_themselves() {
    let mut harness = harness(Seat::free());
    press(&mut harness, "V");
    let words = "View: from above";
    assert_eq!(harness.query_all_by_label(words).count(), 1);
    harness.run_steps(300);
    assert_eq!(harness.query_all_by_label(words).count(), 0);
}

#[test]
fn over_a_replay_nothing_of_the_game_can_be_decided() {
    let mut harness = harness(Seat::eight());
    press(&mut harness, "Enter");
    harness.state_mut().wait();
    harness.run_steps(4);
    let suggest = |harness: &egui_kittest::Harness<'_, Seat>| {
        harness.query_all_by_label_contains("Suggest").count()
    };
    assert_eq!(suggest(&harness), 1);
    press(&mut harness, "F4");
    assert!(harness.state().session.is_replay());
    assert_eq!(suggest(&harness), 0);
    press(&mut harness, "F5");
    press(&mut harness, "F5");
    assert_eq!(suggest(&harness), 0, "a table is being laid");
}

#[test]
fn what_the_game_shows_lies_beside_the_statistics() {
    let mut harness = harness_of(Seat::eight(), Vec2::new(1280.0, 720.0));
    for _ in 0..3 {
        press(&mut harness, "F3");
    }
    harness.run_steps(4);
    let rect = |words: &str| {
        let mut found = harness.query_all_by_label_contains(words);
        found.next().unwrap_or_else(|| panic!("no {words}")).rect()
    };
    let (line, side, table) = (rect("1% low"), rect("Balancing algorithms"), rect("node "));
    let score = rect("Ada");
    assert!(score.top() > line.bottom(), "{score} under {line}");
    for words in ["Suggest", "Spin ", "Power "] {
        let shown = rect(words);
        assert!(
            shown.bottom() < table.top(),
            "{words}: {shown} over {table}"
        );
        assert!(
            shown.right() < side.left(),
            "{words}: {shown} beside {side}"
        );
    }
}

#[test]
fn the_pointer_aims_over_the_table_alone() {
    let mut seat = Seat::free();
    // Given back, it may differ in its last bits.
    let aim = |seat: &mut Seat| (seat.settled().bearing_rad * 1e9).round();
    let start = aim(&mut seat);
    seat.handle(at(600.0, 300.0), false);
    seat.handle(at(640.0, 300.0), false);
    let turned = aim(&mut seat);
    assert_ne!(turned, start);
    seat.now_secs += 5.0;
    seat.handle(at(700.0, 300.0), false);
    seat.handle(at(900.0, 300.0), true);
    assert_eq!(aim(&mut seat), turned, "the way to the panel is given back");
    seat.handle(at(1000.0, 300.0), true);
    seat.handle(at(800.0, 300.0), false);
    assert_eq!(aim(&mut seat), turned);
    seat.now_secs += 5.0;
    seat.handle(at(790.0, 300.0), false);
    assert_ne!(aim(&mut seat), turned, "after a rest it aims again");
}

#[test]
fn saved_views_come_back_the_next_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("settings.toml");
    let mut seat = Seat::kept_in(path.clone());
    let behind = seat.settled();
    seat.key("1");
    assert_eq!(seat.settled(), behind, "nothing is saved yet");
    seat.key("V");
    let above = seat.settled();
    assert_ne!(above, behind);
    seat.key("5");
    seat.key("O");
    assert_eq!(seat.settled(), behind);
    let mut seat = Seat::kept_in(path);
    seat.key("1");
    let again = seat.settled();
    let off = (again.camera().eye - above.camera().eye).length();
    // The file keeps four digits.
    assert!(off < 1e-3, "{off} m");
}
