//! Three-cushion carom (UMB 83).
//!
//! The cue ball of the player at the table is ball 0, the other player's 1, the red 2: when the turn
//! passes, 0 and 1 change places ([`super::Verdict::swaps_cue_balls`]).

use carom_text::text;
use glam::DVec2;

use super::{
    foul::Foul,
    layout::{BallPosition, BallPositions, TableLayout},
    referee::{JudgedShot, Referee, apply_moves},
    report::{ShotEvent, ShotReport},
    ruleset::RuleSet,
    spots::own_spot,
    verdict::{Choice, Verdict},
};

impl Referee {
    pub(crate) fn judge_three_cushion(&mut self, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let (report, player) = (shot.report, self.turn());
        let off: Vec<u8> = report.off_table().collect();
        let fouls = &mut verdict.fouls;
        fouls.extend(off.iter().copied().map(Foul::off_table));
        fouls.extend(pushed_ball(report).map(Foul::PushStroke));
        fouls.extend(report.double_hit.map(Foul::DoubleHit));
        // The first shot of a match is played on the red (UMB 23).
        let hit = report.first_hit();
        if let (true, Some(hit)) = (self.is_break() && hit != Some(2), hit) {
            let on = self.rules().ball_name(2);
            verdict.fouls.push(Foul::WrongBall { hit, on });
        }
        self.add_foul_line(verdict);
        self.end_break();
        let cushions = cushions_before_second(report);
        let made = cushions.is_some_and(|cushions| cushions >= CUSHIONS);
        match cushions {
            Some(cushions) if made => verdict.add_line(text!("carom-scored", cushions = cushions)),
            Some(cushions) => verdict.add_line(text!(
                "carom-too-few",
                cushions = cushions,
                needed = CUSHIONS
            )),
            None => {}
        }
        if made && !verdict.is_foul() {
            verdict.points = 1;
            verdict.goes_on = true;
            self.add_points(player, 1, verdict);
            if self.winner().is_some() {
                return;
            }
        } else {
            self.pass();
            verdict.swaps_cue_balls = true;
        }
        for ball in off {
            let positions = apply_moves(&report.after, &verdict.moves);
            self.spot(
                shot,
                verdict,
                ball,
                carom_spot(shot.layout, &positions, ball),
            );
        }
        let positions = apply_moves(&report.after, &verdict.moves);
        let next = u8::from(verdict.swaps_cue_balls);
        if !touching(shot.layout, &positions, next).is_empty() {
            self.offer(&[Choice::Accept, Choice::SpotBalls]);
        }
    }

    /// Spots the cue ball and the balls that touch it.
    pub(crate) fn spot_touching(
        layout: &TableLayout,
        positions: &BallPositions,
        verdict: &mut Verdict,
    ) {
        let mut balls = touching(layout, positions, 0);
        balls.push(0);
        let stays = |p: &&BallPosition| !balls.contains(&p.ball);
        let mut positions: BallPositions = positions.iter().filter(stays).copied().collect();
        for ball in balls {
            let spot = carom_spot(layout, &positions, ball);
            let placed = BallPosition {
                ball,
                at: layout.spotted(&positions, spot),
            };
            positions.push(placed);
            verdict.moves.push(placed);
        }
    }
}

/// Spot of a ball: its own, or that of the ball that is in the way (UMB 28).
fn carom_spot(layout: &TableLayout, positions: &BallPositions, ball: u8) -> DVec2 {
    let rules = RuleSet::ThreeCushion;
    let spot = own_spot(rules, layout, ball);
    let is_in_way =
        |p: &&BallPosition| p.ball != ball && p.at.distance(spot) < 2.0 * layout.radius_m;
    let blocker = positions.iter().find(is_in_way);
    blocker.map_or(spot, |p| own_spot(rules, layout, p.ball))
}

/// Balls that touch a cue ball.
fn touching(layout: &TableLayout, positions: &BallPositions, cue_ball: u8) -> Vec<u8> {
    let Some(cue_ball) = positions.iter().find(|p| p.ball == cue_ball) else {
        return Vec::new();
    };
    let least = layout.radius_m + layout.cue_radius_m + TOUCH_M;
    let touches = |p: &&BallPosition| p.ball != cue_ball.ball && p.at.distance(cue_ball.at) < least;
    positions.iter().filter(touches).map(|p| p.ball).collect()
}

/// The ball that was in contact with the cue ball and into which it was played (UMB 27): their contact
/// is the first event.
fn pushed_ball(report: &ShotReport) -> Option<u8> {
    let first = report.events.first()?;
    let hit = report.first_hit()?;
    let is_contact = matches!(first, ShotEvent::Contact { .. });
    (is_contact && report.frozen.contains(&hit)).then_some(hit)
}

/// Number of cushions that the cue ball had touched at its first contact with the second ball; none if
/// it touched fewer than two balls.
fn cushions_before_second(report: &ShotReport) -> Option<usize> {
    let mut first = None;
    let mut cushions = 0;
    for happening in &report.events {
        match *happening {
            ShotEvent::Cushion { ball: 0 } => cushions += 1,
            ShotEvent::Contact {
                one: 0,
                other: ball,
            }
            | ShotEvent::Contact {
                one: ball,
                other: 0,
            } if *first.get_or_insert(ball) != ball => return Some(cushions),
            _ => {}
        }
    }
    None
}

const CUSHIONS: usize = 3;
/// Gap below which balls touch: a tenth of a millimetre.
const TOUCH_M: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::test_shots::{TestTable, hit, off, rail};

    fn opened() -> TestTable {
        let mut scene = TestTable::new(RuleSet::ThreeCushion);
        scene.play(&[hit(2), rail(0)], None);
        assert_eq!(scene.referee.turn(), 1);
        scene
    }

    #[test]
    fn three_cushions_before_the_second_ball_score() {
        for events in [
            vec![hit(1), rail(0), rail(0), rail(0), hit(2)],
            vec![rail(0), rail(0), rail(0), hit(2), hit(1)],
            vec![rail(0), hit(2), rail(0), hit(2), rail(0), rail(0), hit(1)],
        ] {
            let mut scene = opened();
            let verdict = scene.play(&events, None);
            assert!(verdict.goes_on && !verdict.swaps_cue_balls);
            assert_eq!(scene.referee.scores(), [0, 1]);
        }
        for events in [
            vec![hit(1), rail(0), rail(0), hit(2)],
            vec![hit(1), rail(0), rail(0), rail(0)],
            vec![hit(1), rail(1), rail(1), rail(1), hit(2)],
            vec![rail(0), rail(0), rail(0), hit(2), rail(0), hit(2)],
        ] {
            let mut scene = opened();
            let verdict = scene.play(&events, None);
            assert!(!verdict.goes_on && verdict.swaps_cue_balls, "{events:?}");
            assert_eq!(scene.referee.scores(), [0, 0]);
        }
    }

    #[test]
    fn the_opening_is_played_on_the_red() {
        let mut scene = TestTable::new(RuleSet::ThreeCushion);
        let verdict = scene.play(&[hit(1), rail(0), rail(0), rail(0), hit(2)], None);
        assert_eq!(
            verdict.lines[0],
            "fouled: the other cue ball was hit first; legal was the red"
        );
        assert_eq!(
            (scene.referee.scores(), scene.referee.turn()),
            (&[0, 0][..], 1)
        );
    }

    #[test]
    fn balls_off_the_table_end_the_turn_and_are_spotted() {
        let mut scene = opened();
        scene.put(0, -0.2, 0.3);
        scene.put(1, 0.3, 0.3);
        let verdict = scene.play(&[hit(1), rail(0), rail(0), rail(0), hit(2), off(2)], None);
        assert_eq!(verdict.fouls, [Foul::BallOff(2)]);
        assert_eq!(scene.at(2), Some(scene.layout.foot_spot()));
        let mut scene = opened();
        scene.put(0, 0.71, 0.01);
        scene.put(1, 0.3, 0.3);
        scene.play(&[off(2)], None);
        assert_eq!(
            scene.at(2),
            Some(scene.layout.head_spot()),
            "the spot of the ball in the way"
        );
    }

    #[test]
    fn a_touching_ball_must_not_be_played_into() {
        let mut scene = opened();
        let mut report = scene.report(&[hit(2), rail(0), rail(0), rail(0), hit(1)]);
        report.frozen = vec![2];
        assert_eq!(scene.judge(&report, None).fouls, [Foul::PushStroke(2)]);
        let mut scene = opened();
        let mut report = scene.report(&[rail(0), rail(0), rail(0), hit(2), hit(1)]);
        report.frozen = vec![2];
        report.after.iter_mut().for_each(|p| match p.ball {
            0 => p.at = DVec2::new(0.1, 0.0),
            1 => p.at = DVec2::new(0.1, 0.0615),
            _ => {}
        });
        assert!(scene.judge(&report, None).goes_on, "played away");
        assert_eq!(scene.referee.options(), [Choice::Accept, Choice::SpotBalls]);
        let positions = scene.positions.clone();
        let verdict = scene
            .referee
            .choose(&scene.layout, &positions, Choice::SpotBalls)
            .unwrap();
        scene.lay(&positions, &verdict);
        assert_eq!(
            (scene.at(0), scene.at(1)),
            (Some(scene.layout.head_spot()), Some(DVec2::ZERO))
        );
    }
}
