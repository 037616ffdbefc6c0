//! Straight pool, 14.1 continuous (WPA 4).

use carom_text::text;
use glam::DVec2;

use super::{
    call::Call,
    foul::Foul,
    layout::{BallPosition, BallPositions, PlacementArea, TableLayout, place_of},
    rack::{is_in_rack, rack_of_fourteen},
    rack_state::Straight,
    referee::{Game, JudgedShot, Referee, apply_moves},
    verdict::{Choice, Verdict},
};

impl Referee {
    pub(crate) fn judge_straight(
        &mut self,
        mut straight: Straight,
        shot: &JudgedShot<'_>,
        verdict: &mut Verdict,
    ) {
        let (report, player) = (shot.report, self.turn());
        let is_break = self.is_break();
        let all: Vec<u8> = (1..=15).collect();
        verdict.fouls = self.standard_fouls(shot, &all, text!("on-any"));
        let potted = report.potted();
        let called = shot
            .called_pot()
            .filter(|_| shot.call != Some(Call::Safety));
        let weak = is_break && called.is_none() && self.is_weak_opening(shot);
        if weak {
            let driven = report.balls_to_rails().min(2);
            verdict.fouls.retain(|foul| *foul != Foul::NoRail);
            verdict.fouls.push(Foul::WeakBreak { driven, needed: 2 });
        }
        self.add_foul_line(verdict);
        self.end_break();
        let legal = called.is_some() && !verdict.is_foul();
        if legal {
            // Each ball that falls with the called one counts (WPA 4.7).
            verdict.points = potted.len() as i32;
            verdict.pots.clone_from(&potted);
            straight.run += potted.len() as u32;
            verdict.goes_on = true;
        } else {
            straight.run = 0;
            self.put_back(&potted, shot, verdict);
            self.say_why_turn_passes(shot, verdict);
        }
        let off: Vec<u8> = report.off_table().filter(|&ball| ball != 0).collect();
        self.put_back(&off, shot, verdict);
        self.set_game(Game::Straight(straight));
        let three = self.charge(weak, verdict);
        self.add_points(player, verdict.points, verdict);
        if self.winner().is_some() {
            return;
        }
        if three {
            verdict.add_line(text!("straight-three-fouls"));
            return self.rack_again(verdict);
        }
        if !verdict.goes_on {
            self.pass();
        }
        if weak {
            self.offer(&[Choice::Accept, Choice::RerackReturn]);
        }
        if report.lost_cue_ball() {
            self.take_in_hand(PlacementArea::Kitchen);
            self.spot_nearest(shot, verdict);
        }
        self.rack_fourteen(straight, shot, verdict);
    }

    /// Whether an opening break is weak: it must drive the cue ball and two object balls to cushions,
    /// or pot a called ball (WPA 4.3).
    fn is_weak_opening(&self, shot: &JudgedShot<'_>) -> bool {
        let rails = shot.report.balls_to_rails();
        let cue_ball = shot.report.cue_ball_to_rail() || shot.report.lost_cue_ball();
        rails < self.info().break_rails || !cue_ball
    }

    /// Charges a foul: it costs a point, a weak break two, the third in a row fifteen more (WPA 4.9,
    /// 4.10). A weak break does not count towards the three. Returns whether this was the third.
    fn charge(&mut self, weak: bool, verdict: &mut Verdict) -> bool {
        let is_weak_only = weak && verdict.fouls.len() == 1;
        if is_weak_only {
            verdict.points = -2;
            return false;
        }
        if verdict.is_foul() {
            verdict.points = -1;
        }
        let three = self.count_foul(verdict.is_foul(), verdict);
        if three {
            verdict.points -= 15;
        }
        three
    }

    fn put_back(&self, balls: &[u8], shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        for &ball in balls {
            self.spot(shot, verdict, ball, shot.layout.foot_spot());
        }
        if !balls.is_empty() {
            let names: Vec<String> = balls.iter().map(u8::to_string).collect();
            verdict.add_line(text!("straight-spotted", balls = names.join(", ")));
        }
    }

    /// Spots the ball nearest to the head string if the cue ball is in hand behind it and all balls are
    /// there. The player may ask for this (WPA 1.5); it is always done, as no other shot is legal
    /// without a cushion first.
    fn spot_nearest(&self, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let positions = apply_moves(&shot.report.after, &verdict.moves);
        let head_x = shot.layout.head_spot().x;
        let nearest = positions
            .iter()
            .filter(|p| p.ball != 0)
            .max_by(|a, b| a.at.x.total_cmp(&b.at.x));
        if let Some(nearest) = nearest.filter(|p| p.at.x <= head_x) {
            self.put_back(&[nearest.ball], shot, verdict);
        }
    }

    /// Racks the others again with the apex open when one ball is left, or none (WPA 4.4); balls in the
    /// way go to the places of the table of 4.8.
    fn rack_fourteen(&mut self, straight: Straight, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let positions = apply_moves(&shot.report.after, &verdict.moves);
        let mut left = positions.iter().filter(|p| p.ball != 0);
        let last = left.next().copied();
        if left.next().is_some() {
            return;
        }
        let racks = straight.racks + 1;
        self.set_game(Game::Straight(Straight { racks, ..straight }));
        let last_ball = last.map_or_else(|| shot.report.potted().last().copied(), |p| Some(p.ball));
        let others: Vec<u8> = (1..=15).filter(|ball| Some(*ball) != last_ball).collect();
        let cue_ball = place_of(&positions, 0);
        let (last_at, cue_at) = special_places(shot.layout, last.map(|p| p.at), cue_ball);
        let seed = self.seed().wrapping_mul(31).wrapping_add(racks);
        verdict.moves = rack_of_fourteen(shot.layout, &others, seed);
        if let (Some(ball), Some(at)) = (last_ball, last_at.or(last.map(|p| p.at))) {
            verdict.moves.push(BallPosition { ball, at });
        }
        verdict.add_line(text!("straight-fourteen"));
        match cue_at {
            CuePlace::Stays => {}
            CuePlace::Kitchen => self.take_in_hand(PlacementArea::Kitchen),
            CuePlace::At(at) => verdict.moves.push(BallPosition { ball: 0, at }),
        }
        if let CuePlace::Kitchen = cue_at {
            let positions: BallPositions = verdict.moves.clone();
            let at = shot
                .layout
                .place_in_hand(&positions, PlacementArea::Kitchen);
            verdict.moves.push(BallPosition { ball: 0, at });
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum CuePlace {
    Stays,
    Kitchen,
    At(DVec2),
}

/// The table of WPA 4.8: the places of the fifteenth ball, if it moves, and of the cue ball. A ball is
/// "on" a spot if one that is spotted there would touch it.
fn special_places(
    layout: &TableLayout,
    last: Option<DVec2>,
    cue: Option<DVec2>,
) -> (Option<DVec2>, CuePlace) {
    let (head, foot, centre) = (layout.head_spot(), layout.foot_spot(), DVec2::ZERO);
    let cue_in_rack = cue.is_some_and(|at| is_in_rack(layout, at, layout.cue_radius_m));
    let last_in_rack = last.is_some_and(|at| is_in_rack(layout, at, layout.radius_m));
    let is_on = |at: Option<DVec2>, spot: DVec2| {
        at.is_some_and(|at| at.distance(spot) < layout.radius_m + layout.cue_radius_m)
    };
    let cue_place = |place| if cue_in_rack { place } else { CuePlace::Stays };
    let Some(last_at) = last else {
        return (Some(foot), cue_place(CuePlace::Kitchen));
    };
    if last_in_rack {
        return if cue_in_rack {
            (Some(foot), CuePlace::Kitchen)
        } else if is_on(cue, head) {
            (Some(centre), CuePlace::Stays)
        } else {
            (Some(head), CuePlace::Stays)
        };
    }
    let place = if is_on(Some(last_at), head) {
        CuePlace::At(centre)
    } else if last_at.x <= head.x {
        CuePlace::At(head)
    } else {
        CuePlace::Kitchen
    };
    (None, cue_place(place))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::RuleSet;
    use crate::rules::test_shots::{TestTable, call, hit, pot, rail};

    fn opened() -> TestTable {
        let mut scene = TestTable::new(RuleSet::Straight);
        scene.play(&[hit(1), rail(2), rail(3), rail(0)], None);
        assert_eq!(
            (scene.referee.turn(), scene.referee.scores()),
            (1, &[0, 0][..])
        );
        scene
    }

    #[test]
    fn a_called_ball_is_a_point_and_those_with_it_too() {
        let mut scene = opened();
        let verdict = scene.play(&[hit(4), pot(4, 1), pot(7, 2)], call(4, 1));
        assert!(verdict.goes_on);
        assert_eq!((verdict.points, scene.referee.scores()), (2, &[0, 2][..]));
    }

    #[test]
    fn what_falls_uncalled_is_spotted_and_the_turn_passes() {
        for said in [None, call(4, 2), Some(Call::Safety)] {
            let mut scene = opened();
            let verdict = scene.play(&[hit(4), pot(4, 1)], said);
            assert!(!verdict.goes_on && !verdict.is_foul() && scene.has(4));
            assert_eq!(scene.referee.scores(), [0, 0]);
        }
    }

    #[test]
    fn a_scratch_costs_a_point_and_gives_the_kitchen() {
        let mut scene = opened();
        scene.play(&[hit(4), pot(4, 1), pot(0, 2)], call(4, 1));
        assert_eq!(
            (scene.referee.scores(), scene.referee.ball_in_hand_area()),
            (&[0, -1][..], Some(PlacementArea::Kitchen))
        );
        assert!(scene.has(4));
        let mut scene = opened();
        scene.play(&[hit(4)], None);
        assert_eq!(
            (scene.referee.scores(), scene.referee.ball_in_hand_area()),
            (&[0, -1][..], None),
            "played as it lies"
        );
    }

    #[test]
    fn a_weak_opening_costs_two_points() {
        for events in [
            vec![hit(1), rail(1), rail(2)],
            vec![hit(1), rail(0), rail(2)],
        ] {
            let mut scene = TestTable::new(RuleSet::Straight);
            scene.play(&events, None);
            assert_eq!(scene.referee.scores(), [-2, 0], "{events:?}");
            assert_eq!(scene.referee.fouls_in_row(), [0, 0]);
            let positions = scene.positions.clone();
            let verdict = scene
                .referee
                .choose(&scene.layout, &positions, Choice::RerackReturn)
                .unwrap();
            assert!(verdict.rack.is_some());
            assert_eq!((scene.referee.turn(), scene.referee.is_break()), (0, true));
        }
    }

    #[test]
    fn the_third_foul_in_a_row_costs_fifteen_more() {
        let mut scene = opened();
        for _ in 0..2 {
            scene.play(&[rail(0)], None);
            scene.play(&[hit(1), rail(1)], None);
        }
        let verdict = scene.play(&[rail(0)], None);
        assert_eq!(
            (verdict.points, scene.referee.scores()),
            (-16, &[0, -18][..])
        );
        assert!(verdict.rack.is_some() && scene.referee.is_break());
        assert_eq!(scene.referee.turn(), 1);
    }

    /// A table with balls 15 and 0 after the fourteenth was potted.
    fn after_fourteen(last: Option<(f64, f64)>, cue: (f64, f64)) -> (TestTable, Verdict) {
        let mut scene = opened();
        scene.keep(&[14, 15]);
        scene.put(0, cue.0, cue.1);
        scene.put(15, 1.0, 0.5);
        if let Some((x, y)) = last {
            scene.put(15, x, y);
        }
        let mut events = vec![hit(14), pot(14, 1)];
        events.extend(last.is_none().then(|| pot(15, 2)));
        let verdict = scene.play(&events, call(14, 1));
        assert!(verdict.goes_on && scene.positions.len() == 16);
        let mut numbers: Vec<u8> = scene.positions.iter().map(|p| p.ball).collect();
        numbers.sort_unstable();
        assert_eq!(numbers, (0..16).collect::<Vec<u8>>());
        for (i, one) in scene.positions.iter().enumerate() {
            for other in &scene.positions[..i] {
                let distance = one.at.distance(other.at);
                assert!(distance > 0.05714, "{one:?} and {other:?}");
            }
        }
        (scene, verdict)
    }

    #[test]
    fn fourteen_are_racked_as_rule_4_8_says() {
        let (head, foot) = (DVec2::new(-0.635, 0.0), DVec2::new(0.635, 0.0));
        let (free, inside) = ((0.0, 0.4), (0.75, 0.0));
        let (scene, _) = after_fourteen(Some(free), (-0.2, -0.3));
        assert_eq!(scene.at(15), Some(DVec2::new(0.0, 0.4)), "in position");
        assert_eq!(
            (scene.at(0), scene.referee.ball_in_hand_area()),
            (Some(DVec2::new(-0.2, -0.3)), None)
        );

        let (scene, _) = after_fourteen(Some(free), inside);
        assert_eq!(
            (scene.at(15).unwrap().y, scene.referee.ball_in_hand_area()),
            (0.4, Some(PlacementArea::Kitchen))
        );

        let (scene, _) = after_fourteen(Some(inside), (-0.2, -0.3));
        assert_eq!(
            (scene.at(15), scene.referee.ball_in_hand_area()),
            (Some(head), None)
        );

        let (scene, _) = after_fourteen(Some(inside), (-0.64, 0.0));
        assert_eq!(
            scene.at(15),
            Some(DVec2::ZERO),
            "the cue ball is on the head spot"
        );

        let (scene, _) = after_fourteen(Some(inside), (0.85, 0.0));
        assert_eq!(
            (scene.at(15), scene.referee.ball_in_hand_area()),
            (Some(foot), Some(PlacementArea::Kitchen))
        );

        let (scene, _) = after_fourteen(Some((-0.9, 0.2)), inside);
        assert_eq!(
            (scene.at(0), scene.referee.ball_in_hand_area()),
            (Some(head), None)
        );

        let (scene, _) = after_fourteen(Some((-0.635, 0.01)), inside);
        assert_eq!(
            (scene.at(0), scene.referee.ball_in_hand_area()),
            (Some(DVec2::ZERO), None)
        );

        let (scene, verdict) = after_fourteen(None, (-0.2, -0.3));
        assert_eq!((scene.at(15), verdict.points), (Some(foot), 2));
    }

    #[test]
    fn nearest_ball_is_spotted_if_all_are_in_the_kitchen() {
        let mut scene = opened();
        scene.keep(&[3, 4]);
        scene.put(3, -0.8, 0.1);
        scene.put(4, -1.0, 0.1);
        scene.put(0, 0.1, 0.1);
        scene.play(&[hit(3), rail(3), pot(0, 0)], None);
        assert_eq!(scene.at(3), Some(scene.layout.foot_spot()));
        assert_eq!(scene.at(4).unwrap().x, -1.0);
    }

    #[test]
    fn the_target_ends_the_match() {
        let mut scene = opened();
        scene.play(&[hit(4), pot(4, 1), pot(7, 2), pot(8, 2)], call(4, 1));
        assert_eq!(scene.referee.winner(), Some(1));
    }
}
