//! Tests of the statistics overlay by its texts, by clicks, and by its appearance.

mod fixture;
#[path = "../looks/mod.rs"]
mod looks;
mod pictures;

use std::collections::BTreeSet;

use carom_farm::quality::QualityPreference;
use carom_farm::{Algorithm, Distribution};
use carom_window::stats::{Stats, StatsCommand, StatsLevel};
use carom_window::theme;
use egui::accesskit::Role;
use egui::{Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use fixture::{PICTURES, input, nodes, overlay, take};

struct OverlayFixture {
    stats: Stats,
    now_secs: f64,
    commands: Vec<StatsCommand>,
}

fn harness(level: StatsLevel, size: Vec2, text_scale: f32) -> Harness<'static, OverlayFixture> {
    let folder = tempfile::tempdir().unwrap();
    let state = OverlayFixture {
        stats: overlay(level, folder.path()),
        now_secs: 100.0,
        commands: Vec::new(),
    };
    let mut harness = Harness::builder()
        .with_size(size / text_scale)
        .with_pixels_per_point(text_scale)
        .with_step_dt(0.3)
        .with_context_setup(|ctx| theme::apply(ctx, 1.0, true))
        .build_ui_state(
            |ui, state: &mut OverlayFixture| {
                state.now_secs += 0.3;
                let nodes = nodes();
                ui.ctx().all_styles_mut(|style| {
                    style.interaction.tooltip_delay = 0.0;
                    style.interaction.show_tooltips_only_when_still = false;
                });
                state.stats.draw(ui.ctx(), state.now_secs, &input(&nodes));
                state.commands.extend(state.stats.take_commands());
            },
            state,
        );
    harness.run_steps(4);
    harness
}

const WINDOW: Vec2 = Vec2::new(1280.0, 720.0);

/// Text and position of every label.
fn labels(harness: &Harness<'_, OverlayFixture>) -> Vec<(String, Rect)> {
    let nodes = harness.root().children_recursive();
    let labels = nodes.filter(|node| node.accesskit_node().role() == Role::Label);
    let text = |node: &egui_kittest::Node<'_>| {
        let node = node.accesskit_node();
        node.label().or_else(|| node.value()).unwrap_or_default()
    };
    labels
        .map(|node| (text(&node), node.rect()))
        .filter(|(text, _)| !text.trim().is_empty())
        .collect()
}

fn has(harness: &Harness<'_, OverlayFixture>, part: &str) -> bool {
    labels(harness).iter().any(|(text, _)| text.contains(part))
}

#[test]
fn f3_goes_through_all_levels_and_back_to_none() {
    let mut level = StatsLevel::Off;
    let mut seen = vec![level];
    while level.next() != StatsLevel::Off {
        level = level.next();
        seen.push(level);
    }
    assert_eq!(
        seen,
        [
            StatsLevel::Off,
            StatsLevel::Line,
            StatsLevel::Card,
            StatsLevel::Full,
            StatsLevel::Recording
        ]
    );
}

#[test]
fn a_hidden_overlay_draws_nothing_and_keeps_nothing() {
    let harness = harness(StatsLevel::Off, WINDOW, 1.0);
    assert!(labels(&harness).is_empty());
    let mut nothing = Harness::builder().with_size(WINDOW).build_ui(|_| {});
    nothing.run_steps(4);
    assert_eq!(harness.output().shapes.len(), nothing.output().shapes.len());
    assert!(harness.state().stats.history().records().is_empty());
}

#[test]
fn each_level_shows_what_the_one_before_does_and_more() {
    let of = |level| harness(level, WINDOW, 1.0);
    let line = [
        "fps",
        "new pictures 48 a second",
        "each takes",
        "sharpness 50 %",
        "made by 4 machines",
        "gone does not help",
    ];
    let card = [
        "1% low",
        "nodes 4/5",
        "network",
        "trace",
        "packed",
        "late 32",
        "lost 37",
        "balance",
        "0.1% low",
        "mean",
        "encode",
        "decode",
        "idle",
        "last node",
        "ideal",
        "reissued",
    ];
    let full = [
        "gpu-2",
        "A ms",
        "B ms/M",
        "pred",
        "p99",
        "σ",
        "equal",
        "water_filling_hedged",
    ];
    let (on_line, on_card, on_full) = (
        of(StatsLevel::Line),
        of(StatsLevel::Card),
        of(StatsLevel::Full),
    );
    for word in line {
        assert!(
            has(&on_line, word) && has(&on_card, word) && has(&on_full, word),
            "{word}"
        );
    }
    for word in card {
        assert!(!has(&on_line, word), "{word}");
        assert!(has(&on_card, word) && has(&on_full, word), "{word}");
    }
    for word in full {
        assert!(!has(&on_card, word), "{word}");
        assert!(has(&on_full, word), "{word}: {:?}", labels(&on_full));
    }
}

/// The figures of the fixture, computed independently.
#[test]
fn the_numbers_are_those_of_the_pictures() {
    let harness = harness(StatsLevel::Full, WINDOW, 1.0);
    // 300 pictures at 48 a second; every fortieth requested four tiles again, and one picture another 37.
    assert!(has(&harness, "frames/s 48.0"));
    assert!(has(&harness, "late 32") && has(&harness, "lost 37!") && has(&harness, "reissued 69"));
    assert!(has(&harness, "size 640x360 x 2"));
    // 920 tiles of 190 bytes against 691,200 bytes.
    assert!(has(&harness, "packed 4.0x"));
    let newest = harness.state().stats.history().newest().unwrap().clone();
    assert!(has(
        &harness,
        &format!("frame {:.2} ms", newest.makespan_secs * 1e3)
    ));
    assert!(newest.efficiency() > 0.8, "{}", newest.efficiency());
    let tallies = harness.state().stats.history().tallies();
    assert_eq!(
        tallies.iter().map(|tally| tally.frames).collect::<Vec<_>>(),
        [200, 100]
    );
    assert!(tallies[0].efficiency() < 0.5 * tallies[1].efficiency());
}

#[test]
fn every_number_has_a_tooltip_that_defines_it() {
    let meanings: BTreeSet<&str> = carom_window::stats::glossary::ALL
        .iter()
        .map(|term| term.meaning())
        .collect();
    for level in [StatsLevel::Line, StatsLevel::Card, StatsLevel::Full] {
        let mut harness = harness(level, WINDOW, 1.0);
        let numbers: Vec<(String, Rect)> = labels(&harness)
            .into_iter()
            .filter(|(text, _)| text.chars().any(|c| c.is_ascii_digit()))
            .filter(|(text, _)| !text.contains("does not help"))
            .filter(|(text, _)| !text.starts_with("Node ") && !text.starts_with("Well divided"))
            .collect();
        assert!(numbers.len() >= 5);
        for (text, rect) in numbers {
            let shown = Rect::from_min_size(Pos2::ZERO, WINDOW).intersect(rect);
            if !shown.is_positive() {
                continue;
            }
            harness.hover_at(shown.center());
            harness.run_steps(4);
            let defined = labels(&harness)
                .iter()
                .any(|(text, _)| meanings.contains(text.as_str()));
            assert!(defined, "`{text}` at {rect:?} has no definition");
        }
    }
}

#[test]
fn frozen_frames_stay_and_can_be_stepped_from() {
    let mut harness = harness(StatsLevel::Full, WINDOW, 1.0);
    harness.get_by_label("Freeze").click();
    harness.run_steps(2);
    let frozen = |harness: &Harness<'_, OverlayFixture>| {
        harness.state().stats.frozen().map(|record| record.frame)
    };
    assert_eq!(frozen(&harness), Some(PICTURES - 1));
    (0..50).for_each(|i| take(&mut harness.state_mut().stats, PICTURES + i));
    harness.run_steps(2);
    assert!(has(&harness, &format!("Frozen at frame {}", PICTURES - 1)));
    harness.get_by_label("<").click();
    harness.run_steps(2);
    assert_eq!(frozen(&harness), Some(PICTURES - 2));
    harness.get_by_label(">").click();
    harness.run_steps(2);
    assert_eq!(frozen(&harness), Some(PICTURES - 1));
    harness.get_by_label("Resume").click();
    harness.run_steps(2);
    assert_eq!(frozen(&harness), None);
    take(&mut harness.state_mut().stats, PICTURES + 60);
    assert_eq!(
        harness.state().stats.history().newest().unwrap().frame,
        PICTURES + 60
    );
}

#[test]
fn the_way_of_dividing_is_chosen_in_the_overlay() {
    let mut harness = harness(StatsLevel::Full, WINDOW, 1.0);
    harness.get_by_role(Role::ComboBox).click();
    harness.run_steps(3);
    harness.get_by_label("cycles").click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().commands,
        [StatsCommand::Balancing(Algorithm::Cycles.hedged())]
    );
    harness.state_mut().commands.clear();
    harness.get_by_label("hedged").click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().commands,
        [StatsCommand::Balancing(Algorithm::WaterFilling.unhedged())]
    );
    harness.state_mut().commands.clear();
    harness.get_by_label("by samples").click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().commands,
        [StatsCommand::Distribution(Distribution::Samples)]
    );
}

#[test]
fn quality_is_chosen_beside_its_measured_cost() {
    let mut harness = harness(StatsLevel::Full, Vec2::new(900.0, 2400.0), 1.0);
    harness.get_by_label("Quality").click();
    harness.run_steps(4);
    for part in ["1280x720", "427x240", "ms here", "spp"] {
        assert!(has(&harness, part), "{part}");
    }
    harness.get_by_label("fine").click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().commands,
        [StatsCommand::QualityPreference(QualityPreference::Fine)]
    );
}

#[test]
fn the_map_tells_whose_a_tile_is() {
    let mut harness = harness(StatsLevel::Full, WINDOW, 1.0);
    harness.get_by_label("owner").click();
    harness.run_steps(2);
    // The last node that is available has the tiles at the bottom, the first those at the top.
    harness.hover_at(Pos2::new(500.0, 440.0));
    harness.run_steps(2);
    assert!(
        has(&harness, "times the mean cost"),
        "{:?}",
        labels(&harness)
    );
    let words = labels(&harness)
        .into_iter()
        .find(|(text, _)| text.contains("times the mean"));
    let words = words.unwrap().0;
    assert!(
        words.contains("gpu-1") || words.contains("gpu-2"),
        "{words}"
    );
}

/// Every text drawn: its words, its position, and its clip rectangle.
fn texts(harness: &Harness<'_, OverlayFixture>) -> Vec<(String, Rect, Rect)> {
    let shapes = harness.output().shapes.iter();
    let text = |clipped: &egui::epaint::ClippedShape| match &clipped.shape {
        egui::Shape::Text(text) if !text.galley.text().trim().is_empty() => {
            let words = text.galley.text().to_owned();
            Some((
                words,
                text.galley.rect.translate(text.pos.to_vec2()),
                clipped.clip_rect,
            ))
        }
        _ => None,
    };
    shapes.filter_map(text).collect()
}

#[test]
fn nothing_overlaps_at_any_window_and_text_size() {
    for size in [WINDOW, Vec2::new(640.0, 360.0)] {
        for text_scale in [1.0, 2.0] {
            for level in [StatsLevel::Line, StatsLevel::Card, StatsLevel::Full] {
                let harness = harness(level, size, text_scale);
                let texts = texts(&harness);
                let case = format!("{level:?} at {size} x {text_scale}");
                assert!(texts.len() >= 5, "{case}");
                for (i, (text, rect, clip)) in texts.iter().enumerate() {
                    // A row of the table is long and is scrolled to where it does not fit.
                    let fits = rect.left() >= clip.left() && rect.right() <= clip.right() + 0.5;
                    assert!(
                        fits || text.len() > 100,
                        "{case}: `{text}` {rect:?} in {clip:?}"
                    );
                    for (other, place, other_clip) in &texts[..i] {
                        // Lines of text may touch.
                        let [a, b] = [rect, place].map(|rect| rect.shrink(2.0));
                        let both = a.intersect(*clip).intersect(b.intersect(*other_clip));
                        assert!(
                            !both.is_positive(),
                            "{case}: `{text}` {rect:?} and `{other}` {place:?}"
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn recording_begins_and_ends_with_its_level() {
    let folder = tempfile::tempdir().unwrap();
    let mut stats = overlay(StatsLevel::Recording, folder.path());
    stats.freeze(10);
    take(&mut stats, PICTURES);
    stats.set_level(StatsLevel::Off);
    take(&mut stats, PICTURES + 1);
    let lines = std::fs::read_to_string(folder.path().join("stats_0001.jsonl")).unwrap();
    // All pictures that arrived, also while the charts were frozen, except those for which the disk was too
    // slow.
    let frames: Vec<u64> = lines
        .lines()
        .map(|line| {
            serde_json::from_str::<serde_json::Value>(line).unwrap()["frame"]
                .as_u64()
                .unwrap()
        })
        .collect();
    assert!(frames.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(
        frames.len() > 200 && frames.iter().all(|frame| *frame <= PICTURES),
        "{frames:?}"
    );
    let csv = std::fs::read_to_string(folder.path().join("stats_0001.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + frames.len() * nodes().len());
}

/// A picture fitted into the free area comes to rest, however long the sentences at the top are.
#[test]
fn the_free_part_of_the_window_stays_as_the_line_wraps_anew() {
    struct Shown {
        stats: Stats,
        now_secs: f64,
        has_lost: bool,
        rooms: Vec<Rect>,
    }
    for (level, size) in [
        (StatsLevel::Line, WINDOW),
        (StatsLevel::Full, WINDOW),
        (StatsLevel::Full, Vec2::new(640.0, 360.0)),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let state = Shown {
            stats: overlay(level, folder.path()),
            now_secs: 100.0,
            has_lost: false,
            rooms: Vec::new(),
        };
        let draw = |ui: &mut egui::Ui, shown: &mut Shown| {
            shown.now_secs += 0.3;
            let mut nodes = nodes();
            if !shown.has_lost {
                nodes.truncate(4);
            }
            let room = shown.stats.draw(ui.ctx(), shown.now_secs, &input(&nodes));
            shown.rooms.push(room);
        };
        let builder = Harness::builder().with_size(size).with_step_dt(0.3);
        let mut harness = builder.build_ui_state(draw, state);
        let mut top = |has_lost| {
            harness.state_mut().has_lost = has_lost;
            harness.run_steps(4);
            harness.state().rooms.last().unwrap().top()
        };
        // One absent node less is one line less.
        let [without, with, without_again] = [false, true, false].map(&mut top);
        assert!(with >= without, "{level:?}: {without}, {with}");
        assert_eq!(without_again, with, "{level:?} in {size:?}");
        if (level, size) == (StatsLevel::Line, WINDOW) {
            assert!(with > without, "the sentence has no line of its own");
        }
    }
}
