//! Pictures of each screen.

use std::path::Path;

use crate::looks::{Gpu, Look};
use crate::player::{Seat, WINDOW};
use carom_billiards::rules::RuleSet;

#[test]
fn each_screen_looks_as_it_did() {
    let gpu = Gpu::open();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/screens/pictures");
    let mut differing = Vec::new();
    for (name, mut seat) in screens() {
        let size = (WINDOW.x as u32, WINDOW.y as u32);
        let look = Look::new(size, 1.0, |ui, _| seat.draw(ui));
        let path = folder.join(format!("{name}.png"));
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
    let page = |page| {
        let mut seat = Seat::eight();
        seat.shell.open(page, &mut seat.session, 1.0);
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
        ("new_game", page(carom::ui::menu::Page::NewGame)),
        ("settings", page(carom::ui::menu::Page::Settings)),
        ("keys", page(carom::ui::menu::Page::Keys)),
        ("help", after(Seat::free(), &["F1"])),
        ("replay", after(Seat::free(), &["Enter", "F4"])),
        ("practice", after(Seat::free(), &["F5"])),
    ]
}
