//! Panels of the match over the picture: players and scores, legal balls, log, and decisions. No
//! information is conveyed by colour alone.

use std::rc::Rc;

use carom_billiards::game_match::{Match, MatchView, PlayerView};
use carom_billiards::rules::{Call, RuleSet, TableLayout};
use carom_text::text;
use carom_window::theme;
use egui::{
    Align, Align2, Button, Context, Label, Rect, RichText, ScrollArea, Sense, Stroke, Ui, Vec2,
    WidgetInfo,
};

use super::form::explain;
use super::layout::Layout;
use crate::input::{Action, Bindings, Intent, MatchIntent};

/// State of the match for its panels.
#[derive(Clone, Debug)]
pub struct MatchHud {
    /// The match.
    pub view: Rc<MatchView>,
    /// Whether a person may play now.
    pub may_play: bool,
    /// Whether the computer searches a shot.
    pub is_thinking: bool,
    /// Sentence about the computer's intention.
    pub intention: Option<String>,
    /// Whether a shot can be redone.
    pub may_redo: bool,
    /// The ball that the aim meets first, if something can be called.
    pub aimed: Option<u8>,
    /// Description of the call that would apply, if something can be called.
    pub call: Option<String>,
    /// The table's layout, if something can be called.
    pub pockets: Option<TableLayout>,
}

/// Draws the score at the top centre of the window; a free table has none.
pub fn draw_score(ctx: &Context, layout: &mut Layout, hud: &MatchHud) {
    let is_low = layout.is_low();
    if hud.view.rules != RuleSet::Free {
        panel(ctx, layout, "score", Align2::CENTER_TOP, |ui| {
            score(ui, hud, is_low);
            None
        });
    }
}

/// Draws the decisions, and returns the intent that the player chose with the pointer.
///
/// The panels take their place from `layout`; with `log` the log of the match is shown.
pub fn draw(
    ctx: &Context,
    layout: &mut Layout,
    hud: &MatchHud,
    bindings: &Bindings,
    log: bool,
) -> Option<Intent> {
    let is_low = layout.is_low();
    let mut wanted = None;
    let place = Align2::RIGHT_BOTTOM;
    let asked = panel(ctx, layout, "deeds", place, |ui| {
        actions(ui, hud, bindings, is_low)
    });
    wanted = wanted.or(asked);
    if hud.may_play && !hud.view.options.is_empty() {
        let asked = panel(ctx, layout, "options", place, |ui| options(ui, hud));
        wanted = wanted.or(asked);
    }
    if log && !hud.view.log.is_empty() {
        panel(ctx, layout, "log", place, |ui| {
            said(ui, &hud.view);
            None
        });
    }
    if hud.pockets.is_some() {
        let place = Align2::RIGHT_CENTER;
        let asked = panel(ctx, layout, "call", place, |ui| {
            let area = ScrollArea::vertical().max_height(ui.available_height());
            area.show(ui, |ui| calls(ui, hud, bindings)).inner
        });
        wanted = wanted.or(asked);
    }
    wanted
}

fn panel(
    ctx: &Context,
    layout: &mut Layout,
    name: &str,
    place: Align2,
    draw: impl FnOnce(&mut Ui) -> Option<Intent>,
) -> Option<Intent> {
    layout.dock(ctx, name, place, |ui| theme::frame().show(ui, draw).inner)
}

/// Draws players, score and prompt, in a low window in one line.
fn score(ui: &mut Ui, hud: &MatchHud, is_low: bool) {
    let view = &hud.view;
    ui.set_width(ui.available_width().min(BOARD));
    ui.columns(view.players.len(), |columns| {
        for (index, (column, player)) in columns.iter_mut().zip(&view.players).enumerate() {
            let layout = match index {
                0 => egui::Layout::left_to_right(Align::Center),
                _ => egui::Layout::right_to_left(Align::Center),
            };
            let is_turn = index == view.turn && view.winner.is_none();
            let row = Vec2::new(column.available_width(), ROW);
            column.allocate_ui_with_layout(row, layout, |ui| {
                side(ui, player, view.points_max, is_turn, index == 0);
            });
        }
    });
    let prompt = match (hud.is_thinking, hud.may_play) {
        (true, false) => text!("match-thinking", player = &*view.players[view.turn].name),
        // The intention is shown in place of the prompt.
        (false, false) if view.winner.is_none() => String::new(),
        _ => view.prompt.clone(),
    };
    let game = text!("match-game", title = view.title, goal = &*view.goal);
    let words = [game.trim(), prompt.trim()];
    let words: Vec<&str> = words
        .into_iter()
        .filter(|words| !words.is_empty())
        .collect();
    let prompt = RichText::new(words.join(" · ")).color(theme::FAINT);
    let verdict = view.banner.as_ref().map(|banner| {
        let words = RichText::new(banner.as_str()).strong();
        if view.is_foul {
            words.color(theme::ALARM)
        } else {
            words
        }
    });
    let intention = |words| RichText::new(words).strong().color(theme::ACCENT);
    let banner = hud.intention.as_ref().map(intention).or(verdict);
    ui.vertical_centered(|ui| {
        let line = |words| Label::new(words).wrap();
        match banner {
            Some(banner) if is_low => drop(ui.add(line(banner.small()))),
            None if is_low => drop(ui.add(line(prompt.small()))),
            banner => {
                ui.add(line(banner.unwrap_or_else(|| RichText::new(" "))));
                ui.add(line(prompt));
            }
        }
    });
}

/// Draws a player: a mark for the turn, the name, the score, the group in words, the remaining balls.
fn side(ui: &mut Ui, player: &PlayerView, points_max: Option<u32>, is_turn: bool, is_left: bool) {
    let name = match (is_turn, is_left) {
        (false, _) => player.name.clone(),
        (true, true) => format!("▶ {}", player.name),
        (true, false) => format!("{} ◀", player.name),
    };
    let name = RichText::new(name);
    let name = if is_turn {
        name.strong().color(theme::ACCENT)
    } else {
        name
    };
    ui.label(name);
    let score = match points_max {
        Some(most) => text!("match-score-of", score = player.score, most = most),
        None => player.score.to_string(),
    };
    ui.label(RichText::new(score).heading());
    let mut state = player.state.clone();
    if !player.left.is_empty() {
        let mut left = player.left.clone();
        left.sort_unstable();
        let left: Vec<String> = left.iter().map(u8::to_string).collect();
        state = text!("match-left", state = state, balls = left.join(" "));
    }
    if !state.is_empty() {
        ui.add(Label::new(RichText::new(state).small()).wrap());
    }
}

fn options(ui: &mut Ui, hud: &MatchHud) -> Option<Intent> {
    let mut wanted = None;
    ui.horizontal_wrapped(|ui| {
        for option in &hud.view.options {
            if ui.button(option.words).clicked() {
                wanted = Some(Intent::Match(MatchIntent::Choose(option.choice)));
            }
        }
    });
    wanted
}

/// Draws a small map of the table with clickable pockets, and the other calls. A shot can be struck with
/// any call.
fn calls(ui: &mut Ui, hud: &MatchHud, bindings: &Bindings) -> Option<Intent> {
    let (view, layout) = (&hud.view, hud.pockets.as_ref()?);
    ui.set_max_width(MAP.x + 20.0);
    ui.label(RichText::new(text!("match-call")).color(theme::ACCENT));
    let said = match (&hud.call, view.call.is_some()) {
        (Some(words), true) => text!("match-called", call = &**words),
        (Some(words), false) => text!("match-called-by-aim", call = &**words),
        (None, _) => text!("match-nothing-called").to_owned(),
    };
    ui.label(RichText::new(said).small());
    let mut wanted = None;
    let called = view.call.as_ref().map(|call| call.call);
    if view.wants_call && view.rules != RuleSet::Snooker {
        wanted = map(ui, hud, layout, called);
        wanted = wanted.or(toggle(ui, text!("match-safety"), Call::Safety, called));
    } else if view.wants_call {
        for &ball in &view.on {
            let call = Call::Pot { ball, pocket: None };
            wanted = wanted.or(toggle(ui, &view.rules.ball_name(ball), call, called));
        }
    }
    if view.may_push_out {
        wanted = wanted.or(toggle(ui, text!("match-push-out"), Call::PushOut, called));
    }
    let next = text!("match-next-call", keys = bindings.words(Action::CallNext));
    explain(ui, next);
    wanted
}

fn toggle(ui: &mut Ui, words: &str, call: Call, called: Option<Call>) -> Option<Intent> {
    let is_on = called == Some(call);
    let button = ui.selectable_label(is_on, words);
    button
        .clicked()
        .then_some(Intent::Match(MatchIntent::Call((!is_on).then_some(call))))
}

fn map(ui: &mut Ui, hud: &MatchHud, layout: &TableLayout, called: Option<Call>) -> Option<Intent> {
    let (rect, _) = ui.allocate_exact_size(MAP, Sense::hover());
    let bed = rect.shrink(9.0);
    ui.painter()
        .rect_filled(bed, 3.0, egui::Color32::from_rgb(30, 80, 55));
    let mut wanted = None;
    for (index, pocket) in layout.pockets.iter().enumerate() {
        // The head of the table is at the left, as seen from the long side.
        let share = Vec2::new(
            (pocket.x / layout.length_m + 0.5) as f32,
            (0.5 - pocket.y / layout.width_m) as f32,
        );
        let center = bed.min + share.clamp(Vec2::ZERO, Vec2::ONE) * bed.size();
        let hole = Rect::from_center_size(center, Vec2::splat(18.0));
        let response = ui.interact(hole, ui.scope_id().with(index), Sense::CLICK);
        let name = layout.pocket_name(index);
        response.widget_info(|| WidgetInfo::labeled(egui::Role::Button, true, &name));
        let is_called = matches!(called, Some(Call::Pot { pocket: Some(p), .. }) if p == index);
        let radius = if response.hovered() { 8.0 } else { 6.5 };
        ui.painter().circle(
            center,
            radius,
            egui::Color32::BLACK,
            Stroke::new(1.5, theme::INK),
        );
        if is_called {
            ui.painter().circle_filled(center, 4.0, theme::ACCENT);
        }
        let ball = hud.aimed.or(hud.view.on.first().copied());
        if let (true, Some(ball)) = (response.on_hover_text(&name).clicked(), ball) {
            let pot = Call::Pot {
                ball,
                pocket: Some(index),
            };
            wanted = Some(Intent::Match(MatchIntent::Call(
                (!is_called).then_some(pot),
            )));
        }
    }
    wanted
}

/// Draws the actions other than striking, each with its key.
fn actions(ui: &mut Ui, hud: &MatchHud, bindings: &Bindings, is_low: bool) -> Option<Intent> {
    let view = &hud.view;
    let helper = text!("match-take-over", level = Match::HINT_LEVEL.display_text());
    let rows = [
        (text!("match-undo"), Action::Undo, view.undo > 0),
        (text!("match-redo"), Action::Redo, hud.may_redo),
        (text!("match-suggest"), Action::Suggest, hud.may_play),
        (helper.as_str(), Action::TakeOver, hud.may_play),
        (
            text!("match-pick-up"),
            Action::PickUp,
            hud.may_play && view.hand.is_some(),
        ),
        (text!("match-log"), Action::Log, !view.log.is_empty()),
    ];
    let mut wanted = None;
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing = Vec2::splat(6.0);
        ui.spacing_mut().button_padding = Vec2::new(8.0, 3.0);
        for (words, action, is_possible) in rows {
            let words = match is_low {
                true => words.to_owned(),
                false => format!("{words} ({})", bindings.words(action)),
            };
            let words = RichText::new(words).small();
            if ui.add_enabled(is_possible, Button::new(words)).clicked() {
                wanted = action.intent(1.0);
            }
        }
    });
    wanted
}

fn said(ui: &mut Ui, view: &MatchView) {
    ui.set_max_width(420.0);
    let area = ScrollArea::vertical()
        .max_height(220.0_f32.min(0.5 * ui.available_height()))
        .stick_to_bottom(true);
    area.show(ui, |ui| {
        for line in &view.log {
            ui.label(RichText::new(line).small());
        }
    });
}

const MAP: Vec2 = Vec2::new(132.0, 76.0);
const BOARD: f32 = 760.0;
/// Height of a player's line.
const ROW: f32 = 28.0;

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use carom_billiards::game_match::{MatchConfig, Player};
    use carom_billiards::physics::Stroke;

    /// A match after its break, which leaves calls open.
    fn broken() -> Match {
        let players = Player::list("Ada,Bo").unwrap();
        let mut game = Match::new(MatchConfig::new(RuleSet::Eight, players, 3).unwrap()).unwrap();
        let stroke = Stroke::straight(0.0, 8.0);
        let shot = game.strike(stroke).unwrap();
        game.finish(stroke, &shot);
        game
    }

    fn hud(game: &Match) -> MatchHud {
        MatchHud {
            view: Rc::new(game.view()),
            may_play: true,
            is_thinking: false,
            intention: None,
            may_redo: false,
            aimed: Some(4),
            call: None,
            pockets: Some(game.table_layout().clone()),
        }
    }

    /// Applies the theme to a test's context in its first frame, in which nothing can be drawn yet; returns
    /// whether it was applied before.
    fn is_dressed(ctx: &egui::Context) -> bool {
        let id = egui::Id::unique("dressed");
        let was = ctx.data(|data| data.get_temp(id)).unwrap_or(false);
        if !was {
            theme::apply(ctx, 1.0, false);
            ctx.data_mut(|data| data.insert_temp(id, true));
            ctx.request_repaint();
        }
        was
    }

    fn clicked(hud: &MatchHud, label: &str) -> Vec<Intent> {
        let intents = RefCell::new(Vec::new());
        let bindings = Bindings::default();
        let mut harness = Harness::builder()
            .with_size(Vec2::new(1280.0, 720.0))
            .build_ui(|ui| {
                if is_dressed(ui.ctx()) {
                    let mut layout = Layout::new(ui.ctx().content_rect());
                    draw_score(ui.ctx(), &mut layout, hud);
                    let asked = draw(ui.ctx(), &mut layout, hud, &bindings, true);
                    intents.borrow_mut().extend(asked);
                }
            });
        harness.run();
        harness.get_by_label_contains(label).click();
        harness.run();
        drop(harness);
        intents.into_inner()
    }

    #[test]
    fn clicking_a_pocket_calls_the_aimed_ball() {
        let hud = hud(&broken());
        let call = Call::Pot {
            ball: 4,
            pocket: Some(0),
        };
        let name = hud.pockets.as_ref().unwrap().pocket_name(0);
        assert_eq!(
            clicked(&hud, &name),
            [Intent::Match(MatchIntent::Call(Some(call)))]
        );
        assert_eq!(
            clicked(&hud, "Safety"),
            [Intent::Match(MatchIntent::Call(Some(Call::Safety)))]
        );
    }

    #[test]
    fn the_board_offers_what_can_be_done() {
        let hud = hud(&broken());
        assert_eq!(clicked(&hud, "Undo"), [Intent::Match(MatchIntent::Undo)]);
        assert_eq!(
            clicked(&hud, "Suggest"),
            [Intent::Match(MatchIntent::Suggest)]
        );
        assert_eq!(
            clicked(&hud, "Play it for me"),
            [Intent::Match(MatchIntent::TakeOver)]
        );
    }

    #[test]
    fn the_computers_intention_takes_the_place_of_the_last_verdict() {
        let mut hud = hud(&broken());
        hud.may_play = false;
        hud.intention = Some("Computer (hard) will play the 3 in the left side pocket".to_owned());
        let bindings = Bindings::default();
        for height in [720.0, 360.0] {
            let mut harness = Harness::builder()
                .with_size(Vec2::new(1280.0, height))
                .build_ui(|ui| {
                    if is_dressed(ui.ctx()) {
                        let mut layout = Layout::new(ui.ctx().content_rect());
                        draw_score(ui.ctx(), &mut layout, &hud);
                        draw(ui.ctx(), &mut layout, &hud, &bindings, false);
                    }
                });
            harness.run();
            harness.get_by_label_contains("will play the 3 in the left side pocket");
        }
    }

    #[test]
    fn a_foul_is_told_in_words_and_choices_are_buttons() {
        let mut game = broken();
        for angle in [1.0, 1.0] {
            if let Some(&choice) = game.referee().options().first() {
                game.choose(choice).unwrap();
            }
            let stroke = Stroke::straight(angle, 0.1);
            let shot = game.strike(stroke).unwrap();
            game.finish(stroke, &shot);
        }
        let hud = hud(&game);
        let bindings = Bindings::default();
        let mut harness = Harness::builder()
            .with_size(Vec2::new(1280.0, 720.0))
            .build_ui(|ui| {
                if is_dressed(ui.ctx()) {
                    let mut layout = Layout::new(ui.ctx().content_rect());
                    draw_score(ui.ctx(), &mut layout, &hud);
                    draw(ui.ctx(), &mut layout, &hud, &bindings, false);
                }
            });
        harness.run();
        harness.get_by_label_contains(" fouled: the cue ball touched no ball");
        harness.get_by_label_contains("Ada");
        harness.get_by_label_contains("You are on");
    }
}
