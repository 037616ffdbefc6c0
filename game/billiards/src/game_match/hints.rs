//! Decisions of the computer: described in words, as a player's hint or as its own intention, and
//! carried out.
//!
//! ```text
//! Match ── start_hint ─► AiWorker ─► Decision ── hint_text, intention_text ─► a sentence
//!                                        └────── carry_out ─► Stroke, Shot ─(watched)─► finish
//! ```

use carom_text::text;

use super::{Match, Player};
use crate::ai::{AiWorker, Decision, Level, Skill};
use crate::physics::{AimContact, Shot, Stroke, predict};
use crate::rng::CounterRng;
use crate::rules::{self, Call, Choice, RuleSet};
use crate::{Result, RuleFault};

impl Match {
    /// Level of the computer when it plays for a person.
    pub const HINT_LEVEL: Level = Level::Hard;

    /// Skill of the computer when it plays for a person.
    pub fn hint_skill() -> Skill {
        Skill {
            effort: EFFORT,
            ..Self::HINT_LEVEL.into()
        }
    }

    /// Starts the search for a good shot of the player at the table, on a thread of its own. Its
    /// decision is valid until the match changes. On the free table the cue ball stays where it is.
    ///
    /// # Errors
    /// [`RuleFault::NothingToSuggest`] once the match is over, [`crate::Error::NoThread`].
    pub fn start_hint(&self) -> Result<AiWorker> {
        if self.at_table().is_none() {
            return Err(RuleFault::NothingToSuggest.into());
        }
        let mut position = self.position();
        if position.referee.rules() == RuleSet::Free {
            position.referee.keep_cue_ball();
        }
        AiWorker::start(position, Self::hint_skill(), self.draw_seed())
    }

    /// A decision as a sentence, for the position that it was made in.
    pub fn hint_text(&self, decision: &Decision) -> String {
        let mut parts = Vec::new();
        if let Some(choice) = decision.choice {
            parts.push(choice.display_text().to_lowercase());
            if gives_away(choice) {
                return sentence(&parts);
            }
        }
        if decision.place.is_some() {
            parts.push(text!("hint-put-at-mark").to_owned());
        }
        parts.push(self.target_text(decision));
        parts.push(tip_text(&decision.stroke));
        sentence(&parts)
    }

    /// Sentence that says what the computer is about to do for the player at the table, for the
    /// position in which the decision was made: ball and pocket, a safety, the break.
    pub fn intention_text(&self, decision: &Decision) -> String {
        let player = self.at_table().filter(|player| player.level().is_some());
        let name = player.map_or(Player::Computer(Self::HINT_LEVEL).name(), Player::name);
        match decision.choice.filter(|&choice| gives_away(choice)) {
            Some(choice) => {
                let choice = choice.display_text().to_lowercase();
                text!("intention-choice", name = name, choice = choice)
            }
            None => text!(
                "intention",
                name = name,
                target = self.target_text(decision)
            ),
        }
    }

    /// Purpose of the stroke, as a verb with its object.
    fn target_text(&self, decision: &Decision) -> String {
        if let Some(call @ (Call::Pot { .. } | Call::PushOut)) = decision.aim {
            return text!("hint-play", call = self.call_text(call));
        }
        if self.referee().is_break() && self.referee().rules() != RuleSet::ThreeCushion {
            return text!("hint-break").to_owned();
        }
        let is_safety = decision.aim == Some(Call::Safety);
        let mut world = self.world().clone();
        // Where the placement fails the mark cannot be shown either, and the words stay true.
        let placed = decision
            .place
            .is_none_or(|at| world.place(0, at.x, at.y).is_ok());
        let line = predict(&world, decision.stroke);
        match line.ok().filter(|_| placed).map(|line| line.contact) {
            Some(AimContact::Ball { number, .. }) => {
                let ball = self.referee().rules().ball_name(number);
                match is_safety {
                    true => text!("hint-safe-off", ball = ball),
                    false => text!("hint-hit", ball = ball),
                }
            }
            _ if is_safety => text!("hint-safe-cushions").to_owned(),
            _ => text!("hint-cushions").to_owned(),
        }
    }

    /// Carries out a decision: chooses, places the cue ball, calls, and strikes with the error of
    /// `skill`. The shot is to be shown and then given to [`Match::finish`]; none if the choice gave
    /// the table to the other player.
    ///
    /// # Errors
    /// The part of the decision that cannot be carried out: it was made for another position.
    pub fn carry_out(
        &mut self,
        decision: &Decision,
        skill: &Skill,
    ) -> Result<Option<(Stroke, Shot)>> {
        if let Some(choice) = decision.choice {
            self.choose(choice)?;
            if gives_away(choice) {
                return Ok(None);
            }
        }
        if let Some(at) = decision.place {
            self.place(at)?;
        }
        self.call(decision.call);
        let mut rng = CounterRng::new(self.draw_seed(), STRAY);
        let strayed = skill.add_error(decision.stroke, &mut rng);
        // If the stroke with errors is not valid, the intended one is played.
        let strike = |stroke| self.strike(stroke).map(|shot| Some((stroke, shot)));
        strike(strayed).or_else(|_| strike(decision.stroke))
    }
}

fn gives_away(choice: Choice) -> bool {
    matches!(choice, Choice::Return | Choice::RerackReturn)
}

/// Position of the tip on the ball, and speed, in words.
fn tip_text(stroke: &Stroke) -> String {
    let side = |value: f64, words: [&'static str; 3]| match value {
        v if v < -TOUCH_MIN => words[0],
        v if v > TOUCH_MIN => words[2],
        _ => words[1],
    };
    let height = side(stroke.vertical, ["low", "middle", "high"]);
    let width = side(stroke.side, ["left", "middle", "right"]);
    let place = match (height, width) {
        (height, "middle") => height.to_owned(),
        ("middle", width) => width.to_owned(),
        (height, width) => format!("{height}-{width}"),
    };
    let speed = format!("{:.1}", stroke.speed_m_s);
    text!("tip", place = place, speed = speed)
}

fn sentence(parts: &[String]) -> String {
    rules::capital(&parts.join("; "))
}

/// With it a stroke of 8 m/s has to gain a pot's value over one of 2 m/s.
const EFFORT: f64 = 0.5;
/// Offset in radii below which the tip counts as in the middle: nobody sees the difference.
const TOUCH_MIN: f64 = 0.04;
/// Random stream of strokes' errors, apart from other draws.
const STRAY: u32 = 0x7374_7261;

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::*;
    use crate::ai::think;
    use crate::game_match::{MatchConfig, Player};
    use crate::physics::BallState;

    fn game(rules: RuleSet) -> Match {
        let players = Player::list("Ada,Bo").unwrap();
        Match::new(MatchConfig::new(rules, players, 4).unwrap()).unwrap()
    }

    #[test]
    fn every_game_has_hints_and_strokes_of_the_computer() {
        for rules in RuleSet::ALL {
            let mut game = game(rules);
            let skill = Skill {
                shots: 40,
                ..Match::hint_skill()
            };
            for _ in 0..4 {
                let seed = game.draw_seed();
                let decision = think(&game.position(), &skill, seed, &AtomicBool::new(false));
                let words = game.hint_text(&decision);
                assert!(
                    words.ends_with("m/s") || decision.choice.is_some(),
                    "{words}"
                );
                let Some((stroke, shot)) = game.carry_out(&decision, &skill).unwrap() else {
                    continue;
                };
                let judged = game.turns().len();
                game.finish(stroke, &shot);
                assert_eq!(game.turns().len(), judged + 1);
            }
            assert!(!game.turns().is_empty(), "{rules:?}");
        }
    }

    #[test]
    fn the_computer_says_which_pot_safety_or_break_it_intends() {
        let players = Player::list("ai:hard,ai:medium").unwrap();
        for (rules, first) in [
            (RuleSet::Nine, "break"),
            (RuleSet::ThreeCushion, "hit the red"),
        ] {
            let mut game =
                Match::new(MatchConfig::new(rules, players.clone(), 4).unwrap()).unwrap();
            let mut said = std::collections::BTreeSet::new();
            for shot in 0..12 {
                let skill = Level::Hard.into();
                let seed = game.draw_seed();
                let decision = think(&game.position(), &skill, seed, &AtomicBool::new(false));
                let words = game.intention_text(&decision);
                let Some(player) = game.at_table().map(Player::name) else {
                    break;
                };
                let Some((name, deed)) = words.split_once(" will ") else {
                    continue;
                };
                assert_eq!(name, player);
                if shot == 0 {
                    assert_eq!(deed, first);
                }
                if let Some(Call::Pot { ball, pocket }) = decision.aim {
                    let pocket = game.table_layout().pocket_name(pocket.unwrap());
                    assert_eq!(deed, format!("play the {ball} in {pocket}"));
                }
                said.extend(deed.split(' ').take(2).map(str::to_owned));
                if let Some((stroke, shot)) = game.carry_out(&decision, &skill).unwrap() {
                    game.finish(stroke, &shot);
                }
            }
            let wanted = match rules {
                RuleSet::Nine => "play the break",
                _ => "hit",
            };
            for word in wanted.split(' ') {
                assert!(said.contains(word), "{rules:?}: {said:?}");
            }
        }
    }

    #[test]
    fn a_drills_hint_is_a_pot_and_its_attempts_are_not_taken_back() {
        let drill = |rules, seed| {
            let players = vec![Player::Human("You".to_owned())];
            Match::new(MatchConfig::new(rules, players, seed).unwrap()).unwrap()
        };
        for rules in RuleSet::DRILLS {
            let mut made = 0;
            for seed in 20_780..20_790 {
                let mut game = drill(rules, seed);
                assert!(game.view().goal.contains("attempt"));
                let skill = Match::hint_skill();
                let decision = think(&game.position(), &skill, seed, &AtomicBool::new(false));
                let words = game.hint_text(&decision);
                let is_pot = matches!(decision.aim, Some(Call::Pot { .. }));
                assert!(is_pot, "{rules:?} {seed}: {words}");
                if let Some(at) = decision.place {
                    game.place(at).unwrap();
                }
                let shot = game.strike(decision.stroke).unwrap();
                let verdict = game.finish(decision.stroke, &shot);
                made += u32::from(verdict.points > 0);
                assert!(!game.undo() && game.view().undo == 0);
            }
            assert!(made >= 8, "{rules:?}: {made} of 10");
        }
        let mut game = drill(RuleSet::DailyShot, 3);
        while game.at_table().is_some() {
            let stroke = Stroke::straight(0.0, 0.1);
            let shot = game.strike(stroke).unwrap();
            game.finish(stroke, &shot);
        }
        assert_eq!(game.view().prompt, "You made 0 of 3 points");
    }

    #[test]
    fn hints_end_with_their_position_and_the_match() {
        let mut game = game(RuleSet::Nine);
        assert!(game.start_hint().is_ok());
        let decision = Decision {
            choice: Some(Choice::Return),
            place: None,
            call: None,
            aim: None,
            stroke: Stroke::straight(0.0, 1.0),
            worth: 0.0,
            simulated: 0,
        };
        assert!(game.carry_out(&decision, &Match::hint_skill()).is_err());
        while game.at_table().is_some() {
            game.concede();
        }
        assert!(game.start_hint().unwrap_err().to_string().contains("over"));
    }

    #[test]
    fn a_straight_pot_is_suggested_as_a_soft_stun() {
        let players = vec![Player::Human("You".to_owned())];
        let mut game = Match::new(MatchConfig::new(RuleSet::Free, players, 4).unwrap()).unwrap();
        let table = game.world().table().clone();
        // Cue ball, ball and corner in a line, half a metre between the balls.
        let corner = table.pockets()[0].center;
        let ahead = -corner.normalize();
        let [object, cue] = [0.5, 1.0].map(|way_m| corner + way_m * ahead);
        let body = table.ball();
        let ball = |number, at: glam::DVec2| BallState::at_rest(number, at.x, at.y, &body);
        game.arrange(&[ball(0, cue), ball(3, object)], None)
            .unwrap();
        let worker = game.start_hint().unwrap();
        let decision = loop {
            if let Some(decision) = worker.poll().unwrap() {
                break decision;
            }
            std::thread::yield_now();
        };
        assert_eq!(decision.place, None, "the cue ball stays");
        let (words, stroke) = (game.hint_text(&decision), decision.stroke);
        assert!((1.0..3.0).contains(&stroke.speed_m_s), "{words}");
        assert!(stroke.vertical < 0.1 && stroke.side.abs() < 0.1, "{words}");
        let shot = game.strike(stroke).unwrap();
        let verdict = game.finish(stroke, &shot);
        assert!(verdict.pots == [3] && verdict.goes_on, "{words}");
    }

    #[test]
    fn advice_says_where_the_tip_goes() {
        let stroke = Stroke {
            side: -0.2,
            vertical: 0.3,
            ..Stroke::straight(0.0, 2.04)
        };
        assert_eq!(tip_text(&stroke), "tip high on the left, 2.0 m/s");
        assert_eq!(
            tip_text(&Stroke::straight(0.0, 1.0)),
            "tip in the middle, 1.0 m/s"
        );
        assert_eq!(sentence(&["a".to_owned(), "b".to_owned()]), "A; b");
    }
}
