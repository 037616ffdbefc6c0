//! Pictures of each screen.

use std::path::Path;

use crate::looks::{Gpu, Look};
use crate::player::{Seat, WINDOW};
use carom::ui::menu::Page;
use carom_billiards::rules::RuleSet;
use carom_window::theme::ROOM;

#[test]
fn each_screen_looks_as_it_did() {
    let gpu = Gpu::open();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/screens/pictures");
    let mut differing = Vec::new();
    let usual = screens().into_iter().map(|screen| (screen, WINDOW, ""));
    let low = screens().into_iter().chain(low_screens());
    let low = low.map(|screen| (screen, ROOM, "low_"));
    for ((name, mut seat), window, prefix) in usual.chain(low) {
        let size = (window.x as u32, window.y as u32);
        let look = Look::new(size, 1.0, |ui, _| seat.draw(ui));
        let path = folder.join(format!("{prefix}{name}.png"));
        differing.extend(look.differences(&path, gpu.as_ref()));
    }
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

/// Each screen, as someone has come to it.
fn screens() -> Vec<(&'static str, Seat)> {
    let after = |mut seat: Seat, keys: &[&str]| {
        for key in keys {
            seat.key(key);
            seat.wait();
        }
        seat
    };
    let intending = |mut seat: Seat| {
        // A break first, and then the answer to it.
        seat.think();
        seat.key("Z");
        seat.think();
        seat
    };
    vec![
        ("board", after(Seat::eight(), &[])),
        (
            "foul",
            after(Seat::eight(), &[&["-"; 20][..], &["Enter"]].concat()),
        ),
        (
            "intention",
            intending(Seat::match_of(RuleSet::Nine, "ai:hard,ai:medium")),
        ),
        (
            "drill",
            after(Seat::match_of(RuleSet::SpotShots, "You"), &[]),
        ),
        ("menu", after(Seat::eight(), &["Esc"])),
        ("new_game", at(Page::NewGame)),
        ("settings", at(Page::Settings)),
        ("keys", at(Page::Keys)),
        ("help", after(Seat::free(), &["F1"])),
        ("replay", after(Seat::free(), &["Enter", "F4"])),
        ("practice", after(Seat::free(), &["F5"])),
    ]
}

/// Screens whose texts need most of the smallest window.
fn low_screens() -> Vec<(&'static str, Seat)> {
    let mut groups = Seat::match_of(RuleSet::Eight, "ai:expert,ai:medium");
    while groups.session.match_hud().view.players[0].left.is_empty() {
        groups.think();
        groups.key("Z");
        groups.wait();
    }
    // Until both are named beside all balls of theirs.
    groups.think();
    vec![
        ("groups", groups),
        ("give_up", at(Page::GiveUp)),
        ("welcome", at(Page::Welcome)),
        ("result", Seat::lost()),
    ]
}

/// A page over a match.
fn at(page: Page) -> Seat {
    let mut seat = Seat::eight();
    seat.shell.open(page, &mut seat.session, 1.0);
    seat
}
