//! 9-ball (WPA 2).

use carom_text::text;

use super::{
    call::Call,
    foul::Foul,
    layout::{BallPositions, PlacementArea, object_balls},
    rack_state::Nine,
    referee::{Game, JudgedShot, Referee},
    verdict::{Choice, Verdict},
};

impl Nine {
    /// The lowest ball on the table.
    pub(crate) fn legal_targets(positions: &BallPositions) -> Vec<u8> {
        object_balls(positions)
            .into_iter()
            .min()
            .into_iter()
            .collect()
    }
}

impl Referee {
    pub(crate) fn judge_nine(&mut self, nine: Nine, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let report = shot.report;
        let is_break = self.is_break();
        let is_push = nine.may_push && shot.call == Some(Call::PushOut);
        let on = Nine::legal_targets(&report.before);
        verdict.fouls = self.standard_fouls(shot, &on, &self.legal_targets_text(&report.before));
        if is_push {
            // WPA 2.4 suspends 6.2 and 6.3.
            verdict.fouls.retain(|foul| {
                !matches!(
                    foul,
                    Foul::NoBallHit | Foul::WrongBall { .. } | Foul::NoRail
                )
            });
        }
        let potted = report.potted();
        if is_break && potted.is_empty() {
            verdict.fouls.extend(self.weak_break(shot));
        }
        self.add_foul_line(verdict);
        self.end_break();
        self.set_game(Game::Nine(Nine {
            may_push: is_break && !verdict.is_foul(),
        }));
        let nine_off = potted.contains(&9) || report.off_table().any(|ball| ball == 9);
        if nine_off && !verdict.is_foul() && !is_push {
            verdict.pots = potted;
            verdict.add_line(text!("nine-won"));
            self.count_foul(false, verdict);
            return self.win_rack(self.turn(), verdict);
        }
        if nine_off {
            verdict.add_line(text!("nine-spotted"));
            self.spot(shot, verdict, 9, shot.layout.foot_spot());
        }
        if verdict.is_foul() {
            if self.count_foul(true, verdict) {
                return self.win_rack(self.other(), verdict);
            }
            self.pass();
            self.take_in_hand(PlacementArea::Anywhere);
        } else if is_push {
            verdict.add_line(text!("nine-push-out"));
            self.count_foul(false, verdict);
            self.pass();
            self.offer(&[Choice::Accept, Choice::Return]);
        } else {
            self.count_foul(false, verdict);
            verdict.goes_on = !potted.is_empty();
            verdict.pots = potted;
            if !verdict.goes_on {
                self.pass();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::RuleSet;
    use crate::rules::test_shots::{TestTable, hit, off, pot, rail};

    fn nine() -> TestTable {
        let mut scene = TestTable::broken(RuleSet::Nine);
        scene.play(&[hit(1), rail(1)], None);
        scene.play(&[hit(1), rail(1)], None);
        scene
    }

    #[test]
    fn the_lowest_is_hit_first_and_any_pot_goes_on() {
        let mut scene = nine();
        let verdict = scene.play(&[hit(1), pot(6, 2)], None);
        assert!(verdict.goes_on && scene.referee.turn() == 1);
        let verdict = scene.play(&[hit(2), rail(2)], None);
        assert_eq!(
            verdict.lines[0],
            "fouled: the 2 was hit first; legal was the 1"
        );
        assert_eq!(
            scene.referee.ball_in_hand_area(),
            Some(PlacementArea::Anywhere)
        );
    }

    #[test]
    fn the_9_wins_at_any_time_but_not_on_a_foul() {
        let mut scene = TestTable::new(RuleSet::Nine);
        scene.play(&[hit(1), pot(9, 0)], None);
        assert_eq!(scene.referee.scores(), [1, 0]);
        assert!(
            scene.referee.is_break() && scene.referee.turn() == 1,
            "breaks alternate"
        );

        let mut scene = nine();
        scene.play(&[hit(1), pot(9, 0)], None);
        assert_eq!(scene.referee.scores(), [0, 1]);

        for events in [
            vec![hit(1), pot(9, 0), pot(0, 1)],
            vec![hit(2), pot(9, 0)],
            vec![hit(1), off(9)],
        ] {
            let mut scene = nine();
            let verdict = scene.play(&events, None);
            assert!(verdict.is_foul() && scene.has(9), "{events:?}");
            assert_eq!(scene.referee.scores(), [0, 0]);
        }
    }

    #[test]
    fn the_9_and_the_cue_ball_on_the_break_is_no_win() {
        let mut scene = TestTable::new(RuleSet::Nine);
        scene.play(&[hit(1), pot(9, 0), pot(0, 3)], None);
        assert_eq!(
            (scene.referee.scores(), scene.referee.turn()),
            (&[0, 0][..], 1)
        );
        assert!(scene.has(9) && scene.has(0));
    }

    #[test]
    fn a_break_pots_a_ball_or_drives_four_to_cushions() {
        let mut scene = TestTable::new(RuleSet::Nine);
        let verdict = scene.play(&[hit(1), rail(1), rail(2), rail(3), rail(2)], None);
        assert_eq!(
            verdict.fouls,
            [Foul::WeakBreak {
                driven: 3,
                needed: 4
            }]
        );
        assert_eq!(
            scene.referee.ball_in_hand_area(),
            Some(PlacementArea::Anywhere)
        );
    }

    #[test]
    fn a_push_out_needs_no_ball_and_lets_the_other_decide() {
        let mut scene = TestTable::broken(RuleSet::Nine);
        let verdict = scene.play(&[rail(0)], Some(Call::PushOut));
        assert!(!verdict.is_foul());
        assert_eq!(scene.referee.options(), [Choice::Accept, Choice::Return]);
        assert_eq!(scene.referee.turn(), 0);
        let positions = scene.positions.clone();
        scene
            .referee
            .choose(&scene.layout, &positions, Choice::Return)
            .unwrap();
        assert_eq!(scene.referee.turn(), 1, "the one who pushed has to shoot");
        let verdict = scene.play(&[rail(0)], Some(Call::PushOut));
        assert_eq!(
            verdict.fouls,
            [Foul::NoBallHit],
            "only once, right after the break"
        );
    }

    #[test]
    fn a_scratch_on_a_push_out_is_a_foul() {
        let mut scene = TestTable::broken(RuleSet::Nine);
        let verdict = scene.play(&[hit(4), pot(9, 1)], Some(Call::PushOut));
        assert!(!verdict.is_foul() && scene.has(9));
        assert_eq!(scene.referee.scores(), [0, 0]);
        let mut scene = TestTable::broken(RuleSet::Nine);
        let verdict = scene.play(&[hit(4), pot(0, 1)], Some(Call::PushOut));
        assert_eq!(verdict.fouls, [Foul::Scratch]);
        assert!(scene.referee.options().is_empty());
    }

    #[test]
    fn a_push_out_comes_after_a_foul_on_the_break_no_more() {
        let mut scene = TestTable::new(RuleSet::Nine);
        scene.play(&[hit(1), pot(3, 0), pot(0, 1)], None);
        let verdict = scene.play(&[rail(0)], Some(Call::PushOut));
        assert_eq!(verdict.fouls, [Foul::NoBallHit]);
    }

    #[test]
    fn three_fouls_in_a_row_lose_the_rack() {
        let mut scene = nine();
        for fouls in 1..3 {
            scene.play(&[rail(0)], None);
            assert_eq!(scene.referee.fouls_in_row()[1], fouls);
            scene.play(&[hit(1), rail(1)], None);
        }
        assert!(
            scene.referee.state_text(1).contains('2'),
            "the player is warned"
        );
        let verdict = scene.play(&[rail(0)], None);
        assert_eq!(scene.referee.scores(), [1, 0], "{verdict:?}");

        let mut scene = nine();
        for _ in 0..2 {
            scene.play(&[rail(0)], None);
            scene.play(&[hit(1), rail(1)], None);
        }
        scene.play(&[hit(1), rail(1)], None);
        scene.play(&[hit(1), rail(1)], None);
        scene.play(&[rail(0)], None);
        assert_eq!(scene.referee.scores(), [0, 0]);
    }
}
