//! Page on which a new game is chosen.

use carom_billiards::ai::Level;
use carom_billiards::game_match::{Match, MatchConfig, Player};
use carom_billiards::physics::TableOptions;
use carom_billiards::rules::RuleSet;
use carom_text::text;
use egui::{Grid, ScrollArea, Ui};

use super::form::{explain, row};
use crate::settings::value_name;

/// Choice of a new game.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewGame {
    /// The game.
    pub rules: RuleSet,
    /// Level of the computer opponent; none for two people.
    pub computer: Option<Level>,
    /// Racks, frames or points to win; 0 for the game's default.
    pub target: u32,
    /// Whether a computer also plays in place of the person.
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
    /// The chosen match, on a table with `options`; `seed` determines the racks.
    ///
    /// # Errors
    /// If the choices do not make a valid match.
    pub fn begin(&self, seed: u32, options: TableOptions) -> carom_billiards::Result<Match> {
        let human = |name: &str| Player::Human(name.to_owned());
        let players = match (self.rules, self.computer) {
            (rules, _) if rules.is_for_one() => vec![Player::you()],
            (_, Some(level)) if self.is_watched => {
                vec![Player::Computer(Level::Hard), Player::Computer(level)]
            }
            (_, Some(level)) => vec![Player::you(), Player::Computer(level)],
            (_, None) => vec![human(text!("player-1")), human(text!("player-2"))],
        };
        let own = MatchConfig::new(self.rules, players, seed)?;
        // The daily shot is the same for all players, so it ignores table options.
        let options = match self.rules {
            RuleSet::DailyShot => TableOptions::default(),
            _ => options,
        };
        Match::new(MatchConfig {
            target: self.target,
            table: own.table.with_options(options),
            ..own
        })
    }
}

/// Draws the page, and returns whether the game should begin.
pub(super) fn page(ui: &mut Ui, game: &mut NewGame, is_fresh: bool) -> bool {
    ui.set_width(560.0_f32.min(ui.ctx().content_rect().width() - 60.0));
    ui.heading(text!("menu-new-game"));
    let height = ui.ctx().content_rect().height() - 190.0;
    ScrollArea::vertical()
        .auto_shrink([false, true])
        .max_height(height.max(80.0))
        .show(ui, |ui| choices(ui, game));
    let begin = ui.button(text!("new-game-begin"));
    if is_fresh {
        begin.request_focus();
    }
    begin.clicked()
}

fn choices(ui: &mut Ui, game: &mut NewGame) {
    Grid::new("new-game")
        .num_columns(2)
        .spacing([20.0, 12.0])
        .show(ui, |ui| {
            for (label, choices) in [
                (text!("new-game-rules"), &RuleSet::ALL[..]),
                (text!("new-game-drill"), &RuleSet::DRILLS),
            ] {
                ui.label(label);
                ui.vertical(|ui| rules(ui, game, choices));
                ui.end_row();
            }
            if !game.rules.is_for_one() {
                opponent(ui, game);
                target(ui, game);
            }
        });
}

/// Draws a row of games to choose from, and the description of the chosen one.
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
        explain(ui, about_rules(game.rules));
    }
}

fn opponent(ui: &mut Ui, game: &mut NewGame) {
    row(ui, text!("new-game-against"), |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.selectable_value(&mut game.computer, None, text!("new-game-person"));
            for level in Level::ALL {
                let words = text!("new-game-computer", level = level.display_text());
                ui.selectable_value(&mut game.computer, Some(level), words);
            }
        });
        explain(
            ui,
            match game.computer {
                Some(level) => about_level(level),
                None => text!("new-game-person-about"),
            },
        );
    });
}

fn target(ui: &mut Ui, game: &mut NewGame) {
    let sheet = game.rules.info();
    ui.label(text!("new-game-first-to", unit = sheet.unit));
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

fn about_rules(rules: RuleSet) -> &'static str {
    text!(&format!("new-game-rules-{}", value_name(&rules)))
}

fn about_level(level: Level) -> &'static str {
    text!(&format!("new-game-level-{}", value_name(&level)))
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum as _;
    use clap::builder::PossibleValue;

    use super::*;

    #[test]
    fn games_and_opponents_are_told_as_the_command_line_tells_them() {
        let help = |value: Option<PossibleValue>| {
            let help = value.and_then(|value| value.get_help().cloned());
            help.unwrap_or_default().to_string()
        };
        for rules in RuleSet::value_variants() {
            assert_eq!(about_rules(*rules), help(rules.to_possible_value()));
        }
        for level in Level::ALL {
            assert_eq!(about_level(level), help(level.to_possible_value()));
        }
    }

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
                    // The daily shot is the same for everybody.
                    let wanted = match rules {
                        RuleSet::DailyShot => TableOptions::default(),
                        _ => options,
                    };
                    assert_eq!(table, &table.with_options(wanted));
                }
            }
        }
    }
}
