//! Snooker (WPBSA section 3). Balls 1 to 15 are the reds, 16 to 21 yellow, green, brown, blue, pink and
//! black, worth 2 to 7.
//!
//! Left out: the "miss" (14), which is a referee's opinion of how well a player tried.

mod targets;

use carom_text::text;
use glam::DVec2;

use super::{
    foul::Foul,
    layout::{BallPosition, BallPositions, PlacementArea, TableLayout, object_balls, place_of},
    rack_state::Snooker,
    referee::{Game, JudgedShot, Referee, apply_moves},
    ruleset::RuleSet,
    spots::own_spot,
    verdict::{Choice, Verdict},
};
use crate::deterministic_math::{asin, unit_at};
use targets::{BLACK, ShotTarget, TargetSet, YELLOW, is_colour, value};

impl Referee {
    pub(crate) fn judge_snooker(
        &mut self,
        mut snooker: Snooker,
        shot: &JudgedShot<'_>,
        verdict: &mut Verdict,
    ) {
        let aim = ShotTarget::of(snooker, shot);
        let player = self.turn();
        verdict.fouls = self.snooker_fouls(snooker, aim, shot);
        self.add_foul_line(verdict);
        self.end_break();
        if verdict.is_foul() {
            verdict.points = -penalty(aim, &verdict.fouls);
            snooker.points[1 - player] -= verdict.points;
            snooker.run = 0;
            verdict.add_line(text!("verdict-points-to-other", points = -verdict.points));
        } else {
            verdict.points = aim.score(&shot.report.potted());
            verdict.pots = shot.report.potted();
            verdict.goes_on = verdict.points > 0;
            snooker.points[player] += verdict.points;
            snooker.run = if verdict.goes_on {
                snooker.run + verdict.points
            } else {
                0
            };
            if verdict.goes_on {
                verdict.add_line(text!(
                    "verdict-scored",
                    points = verdict.points,
                    run = snooker.run
                ));
            }
        }
        self.put_colours_back(snooker, aim, shot, verdict);
        let positions = apply_moves(&shot.report.after, &verdict.moves);
        snooker.on_colour = verdict.goes_on && aim.on == TargetSet::Red;
        snooker.free_ball = false;
        if self.ends_frame(snooker, shot.layout, &positions, verdict) {
            return;
        }
        if !verdict.goes_on {
            self.pass();
        }
        if shot.report.lost_cue_ball() {
            self.take_in_hand(PlacementArea::D);
        }
        if verdict.is_foul() {
            self.after_foul(&mut snooker, shot.layout, &positions, verdict);
        }
        self.set_game(Game::Snooker(snooker));
    }

    fn snooker_fouls(&self, snooker: Snooker, aim: ShotTarget, shot: &JudgedShot<'_>) -> Vec<Foul> {
        let report = shot.report;
        let mut fouls = Vec::new();
        if report.scratch().is_some() {
            fouls.push(Foul::Scratch);
        }
        fouls.extend(report.off_table().map(Foul::off_table));
        // Playing away from a touching ball that is on counts as hitting it (8).
        let touches_on = report.frozen.iter().any(|&ball| aim.allows(ball));
        match report.first_hit() {
            None if !touches_on => fouls.push(Foul::NoBallHit),
            Some(hit) if !aim.allows(hit) && !touches_on => fouls.push(Foul::WrongBall {
                hit,
                on: aim.display_text(),
            }),
            _ => {}
        }
        if let Some(ball) = report
            .first_hit()
            .filter(|ball| report.frozen.contains(ball))
        {
            fouls.push(Foul::PushStroke(ball));
        }
        let wrong = report
            .potted()
            .into_iter()
            .filter(|&ball| aim.points(ball).is_none());
        fouls.extend(wrong.map(Foul::WrongPot));
        fouls.extend(report.jumped.map(Foul::Jump));
        fouls.extend(report.double_hit.map(Foul::DoubleHit));
        fouls.extend(self.free_ball_snooker(snooker, aim, shot));
        fouls
    }

    /// The foul of a free ball that hides the ball on, unless only pink and black are left (12).
    fn free_ball_snooker(
        &self,
        snooker: Snooker,
        aim: ShotTarget,
        shot: &JudgedShot<'_>,
    ) -> Option<Foul> {
        let ball = aim.nominated.filter(|_| aim.is_free)?;
        let after = &shot.report.after;
        let potted = !shot.report.potted().is_empty();
        let few = object_balls(after).len() <= 2;
        if potted || few {
            return None;
        }
        let on = Snooker {
            free_ball: false,
            ..snooker
        }
        .legal_targets(after);
        let cue_ball = place_of(after, 0)?;
        let without: BallPositions = after.iter().filter(|p| p.ball != ball).copied().collect();
        let hides = is_snookered(shot.layout, after, cue_ball, &on)
            && !is_snookered(shot.layout, &without, cue_ball, &on);
        hides.then_some(Foul::FreeBallSnooker(ball))
    }

    /// Spots the potted colours, except those that are legally potted in the order of the end (7).
    fn put_colours_back(
        &self,
        snooker: Snooker,
        aim: ShotTarget,
        shot: &JudgedShot<'_>,
        verdict: &mut Verdict,
    ) {
        let report = shot.report;
        let stays_down = |ball: u8| aim.on == TargetSet::Last(ball) && !verdict.is_foul();
        let mut back: Vec<u8> = report
            .potted()
            .into_iter()
            .chain(report.off_table())
            .collect();
        back.retain(|&ball| is_colour(ball) && !stays_down(ball));
        // On a foul at the re-spotted black the frame is over: nothing comes back.
        if snooker.tied {
            back.clear();
        }
        back.sort_unstable_by(|a, b| b.cmp(a));
        for ball in back {
            let positions = apply_moves(&report.after, &verdict.moves);
            let spot = free_spot(shot.layout, &positions, ball);
            self.spot(shot, verdict, ball, spot);
        }
    }

    /// With only the black left, the first score or foul ends the frame, and a tie spots the black
    /// again (4).
    fn ends_frame(
        &mut self,
        snooker: Snooker,
        layout: &TableLayout,
        positions: &BallPositions,
        verdict: &mut Verdict,
    ) -> bool {
        let colours = object_balls(positions);
        let black_shot = colours.is_empty() || colours == [BLACK] && verdict.is_foul();
        if !black_shot || verdict.points == 0 {
            return false;
        }
        let [first, second] = snooker.points;
        if first == second {
            self.tie(snooker, layout, verdict);
            return true;
        }
        let winner = usize::from(second > first);
        verdict.add_line(text!("verdict-frame-over", first = first, second = second));
        verdict.moves.clear();
        self.win_rack(winner, verdict);
        true
    }

    fn tie(&mut self, snooker: Snooker, layout: &TableLayout, verdict: &mut Verdict) {
        verdict.add_line(text!("verdict-tie"));
        // Lots decide who plays first: the seed stands for them.
        if self.seed().is_multiple_of(2) {
            self.pass();
        }
        verdict.goes_on = false;
        self.set_game(Game::Snooker(Snooker {
            on_colour: false,
            run: 0,
            tied: true,
            ..snooker
        }));
        self.take_in_hand(PlacementArea::D);
        verdict.moves = vec![BallPosition {
            ball: BLACK,
            at: own_spot(RuleSet::Snooker, layout, BLACK),
        }];
        let at = layout.place_in_hand(&verdict.moves, PlacementArea::D);
        verdict.moves.push(BallPosition { ball: 0, at });
    }

    fn after_foul(
        &mut self,
        snooker: &mut Snooker,
        layout: &TableLayout,
        positions: &BallPositions,
        verdict: &mut Verdict,
    ) {
        let on = snooker.legal_targets(positions);
        let cue_ball = place_of(positions, 0);
        let snookered = match cue_ball {
            Some(at) => is_snookered(layout, positions, at, &on),
            None => {
                places_in_d(layout, positions).all(|at| is_snookered(layout, positions, at, &on))
            }
        };
        if snookered {
            snooker.free_ball = true;
            verdict.add_line(text!("verdict-free-ball"));
        }
        self.offer(&[Choice::Accept, Choice::Return]);
    }
}

/// Whether the cue ball at a place cannot be played in a straight line to both edges of any ball on:
/// a ball that is not on is in the way (WPBSA section 2, 17).
fn is_snookered(
    layout: &TableLayout,
    positions: &BallPositions,
    cue_ball: DVec2,
    on: &[u8],
) -> bool {
    let blocks = |ball: u8| ball != 0 && !on.contains(&ball);
    let reach = layout.radius_m + layout.cue_radius_m;
    let is_open = |target: &BallPosition| {
        let way = target.at - cue_ball;
        let distance = way.length();
        if distance <= reach + 1e-4 {
            return true;
        }
        // Centres of a cue ball that just grazes the target: the points of tangency to the circle of
        // contact.
        let along = (distance * distance - reach * reach).sqrt();
        let half = asin(reach / distance);
        [half, -half].into_iter().all(|turn| {
            let graze = cue_ball + unit_at(turn).rotate(way / distance) * along;
            layout.is_clear(positions, (cue_ball, graze), layout.cue_radius_m, blocks)
        })
    };
    let mut targets = positions.iter().filter(|p| on.contains(&p.ball));
    !targets.any(is_open)
}

/// Places all over the D where the cue ball may lie.
fn places_in_d(layout: &TableLayout, positions: &BallPositions) -> impl Iterator<Item = DVec2> {
    let (centre, radius) = (layout.baulk_spot(), layout.d_radius_m());
    let grid = (0..=8).flat_map(move |i| (-8..=8).map(move |j| (f64::from(i), f64::from(j))));
    grid.map(move |(i, j)| centre + radius / 8.0 * DVec2::new(-i, j))
        .filter(move |&at| layout.may_place(positions, at, PlacementArea::D).is_ok())
}

/// Spot of a colour: its own; if that is taken, the highest free one; if all are taken, its own, from
/// which [`TableLayout::spotted`] searches on (7).
fn free_spot(layout: &TableLayout, positions: &BallPositions, ball: u8) -> DVec2 {
    let own = own_spot(RuleSet::Snooker, layout, ball);
    let by_value = (YELLOW..=BLACK)
        .rev()
        .map(|colour| own_spot(RuleSet::Snooker, layout, colour));
    [own]
        .into_iter()
        .chain(by_value)
        .find(|&spot| layout.is_free(positions, spot))
        .unwrap_or(own)
}

/// Penalty points: at least 4, otherwise the highest value of the ball on and the balls concerned (11).
fn penalty(aim: ShotTarget, fouls: &[Foul]) -> i32 {
    let concerned = fouls.iter().filter_map(|foul| match foul {
        Foul::WrongBall { hit: ball, .. }
        | Foul::BallOff(ball)
        | Foul::WrongPot(ball)
        | Foul::Jump(ball)
        | Foul::PushStroke(ball)
        | Foul::FreeBallSnooker(ball)
        | Foul::DoubleHit(ball) => Some(value(*ball)),
        _ => None,
    });
    concerned.chain([aim.value(), 4]).max().unwrap_or(4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::call::Call;
    use crate::rules::test_shots::{TestTable, hit, off, pot, rail};

    const PINK: u8 = 20;

    fn broken() -> TestTable {
        let mut scene = TestTable::new(RuleSet::Snooker);
        scene.play(&[hit(1), rail(0)], None);
        assert_eq!(scene.referee.turn(), 1);
        scene
    }

    fn points(scene: &TestTable) -> [i32; 2] {
        [0, 1].map(|player| {
            let words = scene.referee.state_text(player);
            words.split(' ').next().unwrap().parse().unwrap()
        })
    }

    fn nominate(ball: u8) -> Option<Call> {
        Some(Call::Pot { ball, pocket: None })
    }

    #[test]
    fn reds_and_colours_take_turns_and_colours_come_back() {
        let mut scene = broken();
        assert!(
            scene.play(&[hit(1), pot(1, 0), pot(2, 0)], None).goes_on,
            "two reds at once"
        );
        assert_eq!(scene.referee.legal_targets(&scene.positions).len(), 6);
        let verdict = scene.play(&[hit(BLACK), pot(BLACK, 1)], None);
        assert!(verdict.goes_on && scene.has(BLACK) && !scene.has(1));
        assert_eq!(points(&scene), [0, 9]);
        assert!(scene.referee.state_text(1).contains("break 9"));
        let verdict = scene.play(&[hit(BLACK), rail(0)], None);
        assert_eq!(
            verdict.lines[0],
            "fouled: the black was hit first; legal was a red"
        );
        assert_eq!((verdict.points, points(&scene)), (-7, [7, 9]));
    }

    #[test]
    fn fouls_cost_four_or_what_the_balls_are_worth() {
        for (events, said, cost) in [
            (vec![rail(0)], None, 4),
            (vec![hit(1), pot(0, 2)], None, 4),
            (vec![hit(19), rail(0)], None, 5),
            (vec![hit(1), pot(PINK, 0)], None, 6),
            (vec![hit(1), off(BLACK)], None, 7),
        ] {
            let mut scene = broken();
            let verdict = scene.play(&events, said);
            assert_eq!(
                (verdict.points, points(&scene)),
                (-cost, [cost, 0]),
                "{events:?}"
            );
            assert!(scene.has(0) && scene.has(PINK) && scene.has(BLACK));
            assert_eq!(scene.referee.options(), [Choice::Accept, Choice::Return]);
        }
        let on_colour = |events: &[_], said| {
            let mut scene = broken();
            scene.play(&[hit(1), pot(1, 0)], None);
            scene.play(events, said).points
        };
        assert_eq!(
            on_colour(&[hit(16), rail(0)], nominate(BLACK)),
            -7,
            "the nominated counts"
        );
        assert_eq!(on_colour(&[hit(16), pot(0, 0)], nominate(16)), -4);
        assert_eq!(
            on_colour(&[hit(2), rail(0)], None),
            -7,
            "none was nominated"
        );
    }

    #[test]
    fn colours_fall_in_order_at_the_end_and_stay_down() {
        let mut scene = broken();
        scene.keep(&[1, 16, 17, 18, 19, 20, 21]);
        scene.play(&[hit(1), pot(1, 0)], None);
        scene.play(&[hit(16), pot(16, 0)], None);
        assert!(scene.has(16), "the colour after the last red comes back");
        scene.play(&[hit(16), pot(16, 0)], None);
        assert!(!scene.has(16));
        assert_eq!(scene.referee.legal_targets(&scene.positions), [17]);
        let verdict = scene.play(&[hit(17), pot(17, 0), pot(18, 1)], None);
        assert_eq!(
            (verdict.points, scene.has(17), scene.has(18)),
            (-4, true, true)
        );
    }

    #[test]
    fn colours_go_to_the_highest_free_spot() {
        let mut scene = broken();
        scene.play(&[hit(1), pot(1, 0)], None);
        let spot = |ball| own_spot(RuleSet::Snooker, &scene.layout, ball);
        let (blue, black) = (spot(19), spot(BLACK));
        scene.put(2, blue.x, blue.y);
        scene.put(BLACK, 0.3, 0.6);
        scene.play(&[hit(19), pot(19, 0)], None);
        assert_eq!(scene.at(19), Some(black));
        let mut scene = broken();
        scene.play(&[hit(1), pot(1, 0)], None);
        scene.put(3, black.x, black.y);
        for (red, colour) in (4..=8).zip(16..=20) {
            let at = own_spot(RuleSet::Snooker, &scene.layout, colour);
            scene.put(red, at.x, at.y);
            scene.put(colour, -0.2 + 0.1 * f64::from(colour - 16), 0.8);
        }
        scene.play(&[hit(BLACK), pot(BLACK, 0)], None);
        let at = scene.at(BLACK).unwrap();
        assert!(
            at.x > black.x && at.y == 0.0 && at.x - black.x < 0.06,
            "behind its spot: {at}"
        );
    }

    #[test]
    fn the_black_ends_the_frame_and_a_tie_spots_it_again() {
        let mut scene = broken();
        scene.keep(&[BLACK]);
        scene.play(&[hit(BLACK), rail(0)], None);
        assert_eq!(scene.referee.scores(), [0, 0], "neither a score nor a foul");
        let mut won = TestTable {
            positions: scene.positions.clone(),
            layout: scene.layout.clone(),
            referee: scene.referee.clone(),
        };
        won.play(&[hit(BLACK), pot(BLACK, 0)], None);
        assert_eq!(won.referee.scores(), [1, 0]);
        assert!(won.referee.is_break() && won.positions.len() == 22);

        let mut lost = scene;
        lost.play(&[hit(BLACK), pot(0, 0)], None);
        assert_eq!(lost.referee.scores(), [0, 1], "a foul on the last black");

        let mut scene = broken();
        scene.play(&[hit(BLACK), rail(0)], None);
        scene.keep(&[BLACK]);
        scene.play(&[hit(BLACK), rail(0)], None);
        scene.play(&[hit(BLACK), pot(BLACK, 0)], None);
        assert_eq!(
            (points(&scene), scene.referee.scores()),
            ([7, 7], &[0, 0][..])
        );
        assert!(scene.has(BLACK) && scene.has(0));
        assert_eq!(scene.referee.ball_in_hand_area(), Some(PlacementArea::D));
        let player = scene.referee.turn();
        scene.play(&[rail(0)], None);
        assert_eq!(scene.referee.scores()[1 - player], 1);
    }

    /// The cue ball at the baulk cushion behind two colours; player 1 fouls.
    fn hidden() -> (TestTable, Verdict) {
        let mut scene = broken();
        scene.put(0, -1.7, 0.0);
        scene.put(16, -1.6, 0.028);
        scene.put(17, -1.6, -0.028);
        let verdict = scene.play(&[rail(0)], None);
        (scene, verdict)
    }

    #[test]
    fn a_foul_that_leaves_a_snooker_gives_a_free_ball() {
        let (mut scene, verdict) = hidden();
        assert!(verdict.lines.iter().any(|line| line == "Free ball"));
        let verdict = scene.play(&[hit(16), pot(16, 0)], nominate(16));
        assert_eq!(
            (verdict.points, scene.has(16)),
            (1, true),
            "it counts as a red"
        );
        assert_eq!(
            scene.referee.legal_targets(&scene.positions).len(),
            6,
            "and a colour is next"
        );

        let (mut scene, _) = hidden();
        let positions = scene.positions.clone();
        scene
            .referee
            .choose(&scene.layout, &positions, Choice::Return)
            .unwrap();
        let verdict = scene.play(&[hit(16), rail(0)], nominate(16));
        assert!(verdict.is_foul(), "the one who fouled has no free ball");

        let (mut scene, _) = hidden();
        scene.put(0, -1.7, 0.5);
        scene.put(16, -1.6, 0.5);
        scene.put(17, -0.5, 0.8);
        let verdict = scene.play(&[hit(16), rail(0)], nominate(16));
        assert_eq!(verdict.fouls, [Foul::FreeBallSnooker(16)]);

        let mut scene = broken();
        let verdict = scene.play(&[rail(0)], None);
        assert!(
            !verdict.lines.iter().any(|line| line == "Free ball"),
            "reds are open"
        );
    }

    #[test]
    fn a_free_ball_in_place_of_a_colour_counts_once() {
        let (mut scene, _) = hidden();
        scene.keep(&[16, 17, 18]);
        let verdict = scene.play(&[hit(18), pot(18, 0), pot(16, 1)], nominate(18));
        assert_eq!(
            (verdict.points, scene.has(18), scene.has(16)),
            (2, true, false)
        );
    }

    #[test]
    fn shots_off_a_touching_ball_hit_and_into_it_push() {
        let mut scene = broken();
        let mut report = scene.report(&[rail(0)]);
        report.frozen = vec![3];
        assert!(!scene.judge(&report, None).is_foul());
        let mut scene = broken();
        let mut report = scene.report(&[hit(3), rail(0)]);
        report.frozen = vec![3];
        assert_eq!(scene.judge(&report, None).fouls, [Foul::PushStroke(3)]);
    }

    #[test]
    fn a_jump_over_a_ball_is_a_foul() {
        let mut scene = broken();
        let mut report = scene.report(&[hit(1), rail(0)]);
        report.jumped = Some(19);
        assert_eq!(scene.judge(&report, None).points, -5);
    }
}
