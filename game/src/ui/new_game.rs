//! The page on which a new game is begun.

use carom_billiards::ai::Level;
use carom_billiards::game_match::{Match, MatchConfig, Player};
use carom_billiards::physics::TableOptions;
use carom_billiards::rules::RuleSet;
use clap::ValueEnum as _;
use egui::{Grid, RichText, Ui};

use super::theme;

/// What the player wants to play.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewGame {
    /// The game.
    pub rules: RuleSet,
    /// The computer that plays against; none for two people.
    pub computer: Option<Level>,
    /// Racks, frames or points to win; 0 for the game's own.
    pub target: u32,
    /// Whether a computer takes the person's place too.
    pub is_watched: bool,
}

impl Default for NewGame {
    fn default() -> Self {
        Self {
            rules: RuleSet::Eight,
            computer: Some(Level::default()),
            target: 0,
            is_watched: false,
        }
    }
}

impl NewGame {
    /// The match that it means, on a table with `options`; `seed` draws the racks.
    ///
    /// # Errors
    /// A sentence if there is no such match.
    pub fn begin(&self, seed: u32, options: TableOptions) -> carom_billiards::Result<Match> {
        let human = |name: &str| Player::Human(name.to_owned());
        let players = match (self.rules, self.computer) {
            (RuleSet::Free, _) => vec![human("You")],
            (rules, _) if rules.is_drill() => vec![human("You")],
            (_, Some(level)) if self.is_watched => {
                vec![Player::Computer(Level::Hard), Player::Computer(level)]
            }
            (_, Some(level)) => vec![human("You"), Player::Computer(level)],
            (_, None) => vec![human("Player 1"), human("Player 2")],
        };
        let own = MatchConfig::new(self.rules, players, seed)?;
        Match::new(MatchConfig {
            target: self.target,
            table: own.table.with_options(options),
            ..own
        })
    }
}

/// Draws the page; says whether the game is to begin.
pub(super) fn page(ui: &mut Ui, game: &mut NewGame, is_fresh: bool) -> bool {
    ui.set_width(560.0_f32.min(ui.ctx().content_rect().width() - 60.0));
    ui.heading("New game");
    Grid::new("new game")
        .num_columns(2)
        .spacing([20.0, 12.0])
        .show(ui, |ui| {
            for (label, choices) in [("Game", &RuleSet::ALL[..]), ("Drill", &RuleSet::DRILLS)] {
                ui.label(label);
                ui.vertical(|ui| rules(ui, game, choices));
                ui.end_row();
            }
            if game.rules != RuleSet::Free && !game.rules.is_drill() {
                opponent(ui, game);
                target(ui, game);
            }
        });
    let begin = ui.button("Begin");
    if is_fresh {
        begin.request_focus();
    }
    begin.clicked()
}

/// A row of games to choose from, and what the chosen one is.
fn rules(ui: &mut Ui, game: &mut NewGame, choices: &[RuleSet]) {
    ui.horizontal_wrapped(|ui| {
        for &rules in choices {
            if ui
                .selectable_value(&mut game.rules, rules, rules.info().name)
                .changed()
            {
                game.target = 0;
            }
        }
    });
    if choices.contains(&game.rules) {
        let help = game.rules.to_possible_value();
        let help = help.as_ref().and_then(|value| value.get_help());
        faint(ui, &help.map_or(String::new(), ToString::to_string));
    }
}

fn opponent(ui: &mut Ui, game: &mut NewGame) {
    ui.label("Against");
    ui.vertical(|ui| {
        ui.horizontal_wrapped(|ui| {
            ui.selectable_value(&mut game.computer, None, "A person at this machine");
            for level in Level::ALL {
                let words = format!("Computer, {}", level.display_text());
                ui.selectable_value(&mut game.computer, Some(level), words);
            }
        });
        let help = game.computer.and_then(|level| level.to_possible_value());
        let help = help.as_ref().and_then(|value| value.get_help());
        faint(
            ui,
            &help.map_or(
                "You take turns with mouse and keys".to_owned(),
                ToString::to_string,
            ),
        );
    });
    ui.end_row();
}

fn target(ui: &mut Ui, game: &mut NewGame) {
    let sheet = game.rules.info();
    ui.label(format!("First to, {}", sheet.unit));
    ui.horizontal_wrapped(|ui| {
        let targets: &[u32] = if sheet.target > 1 {
            &[10, 25, 50, 100]
        } else {
            &[1, 3, 5, 7, 9]
        };
        for &target in targets {
            let is_own = target == sheet.target;
            let value = if is_own { 0 } else { target };
            ui.selectable_value(&mut game.target, value, target.to_string());
        }
    });
    ui.end_row();
}

fn faint(ui: &mut Ui, words: &str) {
    ui.label(RichText::new(words).color(theme::FAINT).small());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_game_that_can_be_chosen_begins() {
        for rules in RuleSet::ALL.into_iter().chain(RuleSet::DRILLS) {
            for computer in [None, Some(Level::Easy)] {
                let game = NewGame {
                    rules,
                    computer,
                    target: 5,
                    is_watched: false,
                };
                for options in TableOptions::all() {
                    let begun = game.begin(9, options).unwrap();
                    assert_eq!(begun.referee().rules(), rules);
                    let table = begun.world().table();
                    assert_eq!(table, &table.with_options(options));
                }
            }
        }
    }
}
