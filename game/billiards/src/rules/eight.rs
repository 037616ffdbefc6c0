//! 8-ball (WPA 3).

use carom_text::text;

use super::{
    ball_group::BallGroup,
    call::Call,
    foul::Foul,
    free::capital,
    layout::{BallPositions, PlacementArea},
    rack_state::Eight,
    referee::{Game, JudgedShot, Referee},
    ruleset::RuleSet,
    verdict::{Choice, Verdict},
};

impl Eight {
    pub(crate) fn group(self, player: usize) -> Option<BallGroup> {
        let first = self.first?;
        Some(if player == 0 { first } else { first.other() })
    }

    /// The balls that may be hit first (WPA 3.4, 3.5).
    pub(crate) fn legal_targets(self, positions: &BallPositions, player: usize) -> Vec<u8> {
        let balls = positions.iter().map(|p| p.ball);
        let Some(group) = self.group(player) else {
            return balls
                .filter(|&ball| BallGroup::of(ball).is_some())
                .collect();
        };
        let own: Vec<u8> = balls
            .filter(|&ball| BallGroup::of(ball) == Some(group))
            .collect();
        if own.is_empty() { vec![8] } else { own }
    }

    /// The balls on, in words.
    pub(crate) fn legal_targets_text(self, positions: &BallPositions, player: usize) -> String {
        match self.group(player) {
            None => text!("on-any-but-8").to_owned(),
            Some(_) if self.legal_targets(positions, player) == [8] => RuleSet::Eight.ball_name(8),
            Some(group) => group.display_text().to_owned(),
        }
    }
}

impl Referee {
    pub(crate) fn judge_eight(
        &mut self,
        eight: Eight,
        shot: &JudgedShot<'_>,
        verdict: &mut Verdict,
    ) {
        if self.is_break() {
            return self.judge_eight_break(shot, verdict);
        }
        let (report, player) = (shot.report, self.turn());
        let on = eight.legal_targets(&report.before, player);
        verdict.fouls =
            self.standard_fouls(shot, &on, &eight.legal_targets_text(&report.before, player));
        self.add_foul_line(verdict);
        if self.eight_is_gone(shot) {
            return self.judge_the_eight(on == [8], shot, verdict);
        }
        let called = shot.called_pot().filter(|ball| on.contains(ball));
        verdict.goes_on = called.is_some() && !verdict.is_foul() && shot.call != Some(Call::Safety);
        if let (true, Some(ball), None) = (verdict.goes_on, called, eight.first) {
            self.settle_groups(ball, verdict);
        }
        if verdict.goes_on {
            verdict.pots = called.into_iter().collect();
        } else {
            self.say_why_turn_passes(shot, verdict);
            self.pass();
        }
        if verdict.is_foul() {
            self.take_in_hand(PlacementArea::Anywhere);
        }
    }

    /// Assigns the groups: the called ball decides, whatever else fell (WPA 3.4).
    fn settle_groups(&mut self, ball: u8, verdict: &mut Verdict) {
        let Some(own) = BallGroup::of(ball) else {
            return;
        };
        let first = if self.turn() == 0 { own } else { own.other() };
        self.set_game(Game::Eight(Eight { first: Some(first) }));
        verdict.add_line(text!(
            "eight-took",
            group = own.display_text(),
            sign = own.glyph()
        ));
    }

    fn eight_is_gone(&self, shot: &JudgedShot<'_>) -> bool {
        let report = shot.report;
        report.potted().contains(&8) || report.off_table().any(|ball| ball == 8)
    }

    /// Judges a shot that removed the 8 from the table, not on a break (WPA 3.8).
    fn judge_the_eight(&mut self, was_on: bool, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let player = self.turn();
        let lost = if shot.report.off_table().any(|ball| ball == 8) {
            Some(text!("eight-off-table"))
        } else if !was_on {
            Some(text!("eight-too-early"))
        } else if verdict.is_foul() {
            Some(text!("eight-on-foul"))
        } else if shot.call == Some(Call::Safety) {
            Some(text!("eight-on-safety"))
        } else if shot.called_pot() != Some(8) {
            Some(text!("eight-wrong-pocket"))
        } else {
            None
        };
        match lost {
            None => {
                verdict.pots = vec![8];
                verdict.add_line(text!("eight-as-called"));
                self.win_rack(player, verdict);
            }
            Some(why) => {
                verdict.add_line(text!("eight-lost", why = why));
                self.win_rack(self.other(), verdict);
            }
        }
    }

    /// Judges a break (WPA 3.3).
    fn judge_eight_break(&mut self, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let report = shot.report;
        let potted = report.potted();
        verdict.fouls = self.break_fouls(shot);
        self.add_foul_line(verdict);
        let eight_gone = self.eight_is_gone(shot);
        let is_weak = potted.is_empty() && report.balls_to_rails() < self.info().break_rails;
        if verdict.is_foul() {
            self.end_break();
            self.pass();
            if eight_gone {
                self.offer(&[Choice::Accept, Choice::Rerack]);
            } else if !report.lost_cue_ball() {
                self.offer(&[Choice::Accept, Choice::TakeInHand]);
            }
            if report.lost_cue_ball() || eight_gone {
                self.take_in_hand(PlacementArea::Kitchen);
            }
        } else if eight_gone {
            self.end_break();
            verdict.goes_on = true;
            self.offer(&[Choice::Accept, Choice::Rerack]);
        } else if is_weak {
            verdict.add_line(text!("eight-weak-break", balls = report.balls_to_rails()));
            self.end_break();
            self.pass();
            self.offer(&[Choice::Accept, Choice::Rerack, Choice::RerackReturn]);
        } else {
            self.end_break();
            verdict.goes_on = !potted.is_empty();
            if verdict.goes_on {
                verdict.add_line(text!("eight-open"));
            } else {
                self.pass();
            }
        }
        if eight_gone {
            verdict.add_line(text!("eight-spotted"));
            self.spot(shot, verdict, 8, shot.layout.foot_spot());
        }
        verdict.pots = if verdict.is_foul() {
            Vec::new()
        } else {
            potted
        };
    }

    /// Fouls on the break: no ball need be hit first, none be called (WPA 3.3).
    fn break_fouls(&self, shot: &JudgedShot<'_>) -> Vec<Foul> {
        let all: Vec<u8> = (1..=15).collect();
        let mut fouls = self.standard_fouls(shot, &all, text!("on-any"));
        fouls.retain(|foul| *foul != Foul::NoRail);
        fouls
    }

    /// Adds the reason why the turn passes without a foul, where that may surprise.
    pub(crate) fn say_why_turn_passes(&self, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        if verdict.is_foul() || shot.report.potted().is_empty() {
            return;
        }
        match shot.call {
            Some(Call::Safety) => verdict.add_line(text!("turn-passes-safety")),
            Some(Call::Pot {
                ball,
                pocket: Some(pocket),
            }) => verdict.add_line(text!(
                "turn-passes-pocket",
                ball = capital(&self.rules().ball_name(ball)),
                pocket = shot.layout.pocket_name(pocket)
            )),
            _ => verdict.add_line(text!("turn-passes-no-call")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::test_shots::{TestTable, call, hit, off, pot, rail};

    /// Player 1 is on solids, at the table.
    fn with_groups() -> TestTable {
        let mut scene = TestTable::broken(RuleSet::Eight);
        let verdict = scene.play(&[hit(3), pot(3, 1)], call(3, 1));
        assert!(verdict.goes_on);
        assert_eq!(scene.referee.group(1), Some(BallGroup::Solids));
        assert_eq!(scene.referee.group(0), Some(BallGroup::Stripes));
        scene
    }

    #[test]
    fn the_first_called_ball_after_the_break_sets_groups() {
        let mut scene = TestTable::new(RuleSet::Eight);
        let verdict = scene.play(&[hit(1), pot(2, 0), pot(9, 1)], None);
        assert!(
            verdict.goes_on && scene.referee.group(0).is_none(),
            "both groups on the break"
        );
        scene.play(&[hit(10), rail(10)], call(10, 0));
        assert!(
            scene.referee.group(0).is_none(),
            "a miss leaves the table open"
        );
        let verdict = scene.play(&[hit(4), pot(11, 2), pot(4, 3)], call(4, 3));
        assert!(verdict.goes_on);
        assert_eq!(
            scene.referee.group(1),
            Some(BallGroup::Solids),
            "both fell, the called one counts"
        );
    }

    #[test]
    fn uncalled_pots_pass_the_turn_and_stay_down() {
        for said in [None, call(3, 0), Some(Call::Safety)] {
            let mut scene = TestTable::broken(RuleSet::Eight);
            let verdict = scene.play(&[hit(3), pot(3, 1)], said);
            assert!(!verdict.goes_on && !verdict.is_foul(), "{said:?}");
            assert!(!scene.has(3) && scene.referee.group(1).is_none());
            assert!(
                verdict
                    .lines
                    .iter()
                    .any(|line| line.contains("turn passes")),
                "{verdict:?}"
            );
        }
    }

    #[test]
    fn hitting_the_wrong_group_first_is_a_foul() {
        let mut scene = with_groups();
        let verdict = scene.play(&[hit(12), rail(12)], None);
        assert_eq!(
            verdict.lines[0],
            "fouled: the 12 was hit first; legal was solids"
        );
        assert_eq!(
            (scene.referee.turn(), scene.referee.ball_in_hand_area()),
            (0, Some(PlacementArea::Anywhere))
        );
        let verdict = scene.play(&[hit(8), rail(8)], None);
        assert!(verdict.lines[0].contains("legal was stripes"));
    }

    #[test]
    fn no_ball_no_rail_and_a_ball_off_the_table_are_fouls() {
        for (events, why) in [
            (vec![rail(0)], Foul::NoBallHit),
            (vec![rail(0), hit(4)], Foul::NoRail),
            (vec![hit(4), off(4)], Foul::BallOff(4)),
            (vec![hit(4), pot(0, 2)], Foul::Scratch),
            (vec![hit(4), off(0)], Foul::CueBallOff),
        ] {
            let mut scene = with_groups();
            let verdict = scene.play(&events, None);
            assert_eq!(verdict.fouls, std::slice::from_ref(&why));
            assert_eq!(
                scene.referee.ball_in_hand_area(),
                Some(PlacementArea::Anywhere),
                "{why:?}"
            );
            assert!(scene.has(0));
        }
        let mut scene = with_groups();
        let mut report = scene.report(&[hit(4), rail(4)]);
        report.double_hit = Some(4);
        assert_eq!(scene.judge(&report, None).fouls, [Foul::DoubleHit(4)]);
    }

    #[test]
    fn the_8_wins_when_called_and_loses_otherwise() {
        let on_the_8 = || {
            let mut scene = with_groups();
            scene.keep(&[8, 9, 10]);
            scene
        };
        let mut scene = on_the_8();
        assert_eq!(scene.referee.legal_targets(&scene.positions), [8]);
        scene.play(&[hit(8), pot(8, 2)], call(8, 2));
        assert_eq!(scene.referee.scores(), [0, 1]);
        assert!(
            scene.referee.is_break() && scene.has(3),
            "racked for the next"
        );
        for (events, said) in [
            (vec![hit(8), pot(8, 2)], call(8, 1)),
            (vec![hit(8), pot(8, 2)], None),
            (vec![hit(8), pot(8, 2)], Some(Call::Safety)),
            (vec![hit(8), pot(8, 2), pot(0, 3)], call(8, 2)),
            (vec![hit(9), pot(8, 2)], call(8, 2)),
            (vec![hit(8), off(8)], call(8, 2)),
        ] {
            let mut scene = on_the_8();
            let verdict = scene.play(&events, said);
            assert_eq!(scene.referee.scores(), [1, 0], "{events:?} {said:?}");
            assert!(
                verdict
                    .lines
                    .iter()
                    .any(|line| line.starts_with("lost the rack"))
            );
        }
        let mut scene = with_groups();
        scene.play(&[hit(4), pot(8, 2)], call(8, 2));
        assert_eq!(scene.referee.scores(), [1, 0], "the 8 before its time");
    }

    #[test]
    fn a_scratch_on_the_8_that_stays_up_is_only_a_foul() {
        let mut scene = with_groups();
        scene.keep(&[8, 9]);
        let verdict = scene.play(&[hit(8), pot(0, 2)], call(8, 2));
        assert_eq!(verdict.fouls, [Foul::Scratch]);
        assert_eq!(scene.referee.scores(), [0, 0]);
    }

    #[test]
    fn the_8_on_the_break_is_spotted_or_racked_again() {
        let mut scene = TestTable::new(RuleSet::Eight);
        let verdict = scene.play(&[hit(1), pot(8, 2)], None);
        assert!(verdict.goes_on && scene.referee.turn() == 0);
        assert_eq!(scene.referee.options(), [Choice::Accept, Choice::Rerack]);
        assert!(
            scene.has(8),
            "spotted at once, so that the cue is not blocked"
        );
        let positions = scene.positions.clone();
        let verdict = scene
            .referee
            .choose(&scene.layout, &positions, Choice::Rerack)
            .unwrap();
        assert!(verdict.rack.is_some() && scene.referee.is_break());
        assert_eq!(scene.referee.turn(), 0);
    }

    #[test]
    fn the_8_and_a_scratch_on_the_break_give_a_choice() {
        let mut scene = TestTable::new(RuleSet::Eight);
        let verdict = scene.play(&[hit(1), pot(8, 2), pot(0, 1)], None);
        assert_eq!(verdict.fouls, [Foul::Scratch]);
        assert_eq!(
            (scene.referee.turn(), scene.referee.ball_in_hand_area()),
            (1, Some(PlacementArea::Kitchen))
        );
        assert_eq!(scene.referee.options(), [Choice::Accept, Choice::Rerack]);
        assert_eq!(scene.referee.scores(), [0, 0]);
    }

    #[test]
    fn weak_breaks_give_three_choices_and_fouls_two() {
        let mut scene = TestTable::new(RuleSet::Eight);
        let verdict = scene.play(&[hit(1), rail(1), rail(2), rail(3), rail(0)], None);
        assert!(!verdict.is_foul() && verdict.lines[0].starts_with("broke illegally: 3 balls"));
        let options = [Choice::Accept, Choice::Rerack, Choice::RerackReturn];
        assert_eq!(
            (scene.referee.turn(), scene.referee.options()),
            (1, &options[..])
        );
        let positions = scene.positions.clone();
        scene
            .referee
            .choose(&scene.layout, &positions, Choice::RerackReturn)
            .unwrap();
        assert_eq!((scene.referee.turn(), scene.referee.is_break()), (0, true));

        let mut scene = TestTable::new(RuleSet::Eight);
        scene.play(&[hit(1), pot(2, 0), off(5)], None);
        assert_eq!(
            scene.referee.options(),
            [Choice::Accept, Choice::TakeInHand]
        );
        assert!(!scene.has(5) && !scene.has(2), "they stay off");
        let positions = scene.positions.clone();
        scene
            .referee
            .choose(&scene.layout, &positions, Choice::TakeInHand)
            .unwrap();
        assert_eq!(
            scene.referee.ball_in_hand_area(),
            Some(PlacementArea::Kitchen)
        );
    }

    #[test]
    fn kitchen_shots_cross_the_head_string_first() {
        let mut scene = TestTable::new(RuleSet::Eight);
        scene.play(&[hit(1), pot(2, 0), pot(0, 1)], None);
        assert_eq!(
            scene.referee.ball_in_hand_area(),
            Some(PlacementArea::Kitchen)
        );
        scene.put(4, -1.0, 0.3);
        let mut report = scene.report(&[hit(4), rail(4)]);
        report.reach_x_m = -0.8;
        assert_eq!(
            scene.judge(&report, None).fouls,
            [Foul::BehindHeadString(4)]
        );
    }

    #[test]
    fn no_shot_counts_after_the_target_is_reached() {
        let mut scene = with_groups();
        for _ in 0..3 {
            scene.referee.win_rack(1, &mut Verdict::default());
        }
        assert_eq!(scene.referee.winner(), Some(1));
        let verdict = scene.play(&[hit(1), pot(8, 0)], None);
        assert_eq!(
            (verdict, scene.referee.scores()),
            (Verdict::default(), &[0, 3][..])
        );
    }
}
