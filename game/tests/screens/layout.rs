//! Screens at all sizes of window and text: no panel lies over another, past the window or over the balls.

use carom::camera::Projection;
use carom::ui::menu::Page;
use carom_billiards::rules::RuleSet;
use carom_window::theme::fitting_scale;
use egui::{Id, Order, Pos2, Rect, Vec2};
use egui_kittest::Harness;

use crate::player::{Seat, harness_of, press};

/// Windows in pixels, with sizes of text in percent.
const SIZES: [(f32, f32, &[u32]); 3] = [
    (640.0, 360.0, &[75, 250]),
    (1280.0, 720.0, &[100, 200]),
    (3840.0, 2160.0, &[75, 250]),
];

fn sizes() -> impl Iterator<Item = Vec2> {
    let points = |(width, height, percents): (f32, f32, &'static [u32])| {
        let window = Vec2::new(width, height);
        let size = move |&percent: &u32| window / fitting_scale(percent as f32 / 100.0, window);
        percents.iter().map(size)
    };
    SIZES.into_iter().flat_map(points)
}

/// The panels that are drawn, by what egui knows of them.
fn panels(harness: &Harness<'_, Seat>) -> Vec<Rect> {
    harness.ctx.memory(|memory| {
        let layers = memory.areas().visible_layer_ids();
        let panels = layers
            .into_iter()
            .filter(|layer| layer.order != Order::Background);
        panels
            .filter_map(|layer| memory.area_rect(layer.id))
            .collect()
    })
}

fn assert_apart(harness: &Harness<'_, Seat>, size: Vec2, case: &str) {
    let window = Rect::from_min_size(Pos2::ZERO, size).expand(1.0);
    let panels = panels(harness);
    assert!(!panels.is_empty(), "{case} at {size}: nothing is drawn");
    for (index, panel) in panels.iter().enumerate() {
        assert!(window.contains_rect(*panel), "{case} at {size}: {panel}");
        for other in &panels[..index] {
            let both = panel.shrink(0.5).intersect(other.shrink(0.5));
            assert!(
                !both.is_positive(),
                "{case} at {size}: {panel} over {other}"
            );
        }
    }
}

/// The balls that panels lie over.
fn assert_balls_clear(harness: &Harness<'_, Seat>, size: Vec2, case: &str) {
    let seat = harness.state();
    let game = seat.session.game();
    let camera = seat.viewpoint().camera();
    let projection = Projection::new(&camera, size.x.into(), size.y.into());
    let panels = panels(harness);
    for ball in game.poses(0.0).iter().filter(|ball| ball.on_table) {
        let film = projection.film_from_world(ball.position).unwrap();
        let at = Pos2::new(film.x as f32, film.y as f32);
        for panel in &panels {
            assert!(
                !panel.contains(at),
                "{case} at {size}: {panel} over ball {}",
                ball.number
            );
        }
    }
}

#[test]
fn no_panel_lies_over_another_at_any_size() {
    for size in sizes() {
        let begins = |seat| harness_of(seat, size);
        let broken = || {
            let mut harness = begins(Seat::eight());
            press(&mut harness, "Enter");
            harness.state_mut().wait();
            harness.run_steps(4);
            harness
        };
        for keys in [
            &[][..],
            &["L"],
            &["F9"],
            &["B"],
            &["V"],
            &["Esc"],
            &["F4"],
            &["F1"],
        ] {
            let mut harness = broken();
            keys.iter().for_each(|key| press(&mut harness, key));
            assert_apart(&harness, size, &format!("8-ball after {keys:?}"));
        }
        let mut harness = begins(Seat::free());
        press(&mut harness, "F5");
        assert_apart(&harness, size, "practice");
        assert_apart(&begins(Seat::lost()), size, "result");
        for page in [Page::Welcome, Page::NewGame, Page::Settings, Page::Keys] {
            let mut seat = Seat::eight();
            seat.shell.open(page, &mut seat.session, 1.0);
            assert_apart(&begins(seat), size, &format!("{page:?}"));
        }
    }
}

#[test]
fn panels_leave_the_balls_free_at_any_size() {
    for size in sizes() {
        let all = RuleSet::ALL.into_iter().chain(RuleSet::DRILLS);
        for rules in all.filter(|rules| *rules != RuleSet::Free) {
            let players = if rules.is_for_one() { "You" } else { "Ada,Bo" };
            let mut harness = harness_of(Seat::match_of(rules, players), size);
            harness.run_steps(60);
            assert_balls_clear(&harness, size, &format!("{rules:?}"));
            press(&mut harness, "O");
            harness.run_steps(60);
            assert_balls_clear(&harness, size, &format!("{rules:?} from above"));
        }
    }
}

#[test]
fn the_board_stands_in_the_middle_at_any_size() {
    for size in sizes() {
        let harness = harness_of(Seat::eight(), size);
        let board = harness
            .ctx
            .memory(|memory| memory.area_rect(Id::unique("score")));
        let aside = board.unwrap().center().x - 0.5 * size.x;
        assert!(aside.abs() <= 1.0, "{aside} at {size}");
    }
}
