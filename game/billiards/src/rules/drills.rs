//! Drills for one player: a score from a number of attempts, on layouts that a seed draws.
//!
//! | drill | layout | points |
//! |---|---|---|
//! | line-up | ten balls along the middle, cue ball in hand | one a ball, until a miss |
//! | spot shots | a ball on the foot spot, cue ball behind the head string | one a pot |
//! | position play | three balls, cue ball in hand | one a ball in order, until a miss |
//! | daily shot | a ball that can be potted between three others | three, two, one by attempt |

use carom_text::text;
use glam::DVec2;

use crate::deterministic_math::angle_between;
use crate::rng::CounterRng;

use super::{
    layout::{BallPosition, BallPositions, TableLayout, object_balls, place_of},
    rack_state::{Drill, Nine},
    referee::{Game, JudgedShot, Referee},
    ruleset::RuleSet,
    verdict::Verdict,
};

impl RuleSet {
    /// All drills.
    pub const DRILLS: [Self; 4] = [
        Self::LineUp,
        Self::SpotShots,
        Self::PositionPlay,
        Self::DailyShot,
    ];

    /// Whether it is a drill: one player, and a score in place of a winner.
    pub fn is_drill(self) -> bool {
        Self::DRILLS.contains(&self)
    }
}

impl Referee {
    /// Maximum points of a drill; none in a match.
    pub fn points_max(&self) -> Option<u32> {
        match self.rules() {
            RuleSet::LineUp => Some(u32::from(LINE_BALLS) * self.target()),
            RuleSet::SpotShots => Some(self.target()),
            RuleSet::PositionPlay => Some(u32::from(POSITION_BALLS) * self.target()),
            RuleSet::DailyShot => Some(self.target()),
            _ => None,
        }
    }

    /// The balls of a drill that the cue ball may hit first.
    pub(crate) fn drill_targets(&self, positions: &BallPositions) -> Vec<u8> {
        match self.rules() {
            RuleSet::PositionPlay | RuleSet::DailyShot => Nine::legal_targets(positions),
            _ => object_balls(positions),
        }
    }

    pub(crate) fn judge_drill(
        &mut self,
        drill: Drill,
        shot: &JudgedShot<'_>,
        verdict: &mut Verdict,
    ) {
        let report = shot.report;
        let targets = self.drill_targets(&report.before);
        let words = self.legal_targets_text(&report.before);
        verdict.fouls = self.standard_fouls(shot, &targets, &words);
        self.add_foul_line(verdict);
        let mut potted = report.potted();
        potted.retain(|ball| targets.contains(ball));
        if !verdict.is_foul() {
            verdict.pots = potted;
        }
        let made = verdict.pots.len() as u32;
        verdict.points = match self.rules() {
            RuleSet::DailyShot if made > 0 => (self.target() - drill.attempts) as i32,
            _ => made as i32,
        };
        self.add_drill_points(verdict.points);
        let goes_on = matches!(self.rules(), RuleSet::LineUp | RuleSet::PositionPlay);
        let is_left = report.after.iter().any(|p| p.ball != 0);
        if made > 0 && goes_on && is_left {
            verdict.goes_on = true;
            return;
        }
        let attempts = match self.rules() {
            RuleSet::DailyShot if made > 0 => self.target(),
            _ => drill.attempts + 1,
        };
        self.set_game(Game::Drill(Drill { attempts }));
        if attempts >= self.target() {
            return self.end_drill();
        }
        if made == 0 && !verdict.is_foul() {
            verdict.add_line(text!("verdict-missed"));
        }
        // Each day has one shot; other attempts are drawn anew.
        self.lay_drill(self.rules() != RuleSet::DailyShot, verdict);
    }
}

/// The balls of an attempt; the cue ball only where it is not in hand.
pub(crate) fn drill_layout(
    rules: RuleSet,
    layout: &TableLayout,
    rng: &mut CounterRng,
) -> BallPositions {
    match rules {
        RuleSet::LineUp => line_up(layout),
        RuleSet::PositionPlay => apart(layout, 1..=POSITION_BALLS, rng),
        RuleSet::DailyShot => (0..DRAWS_MAX)
            .map(|_| apart(layout, 0..=DAILY_BALLS, rng))
            .find(|positions| has_plain_pot(layout, positions))
            .unwrap_or_else(|| spot_shot(layout, rng)),
        _ => spot_shot(layout, rng),
    }
}

/// Balls in a line from before the middle of the table to before the foot cushion.
fn line_up(layout: &TableLayout) -> BallPositions {
    let place = |ball: u8| {
        let share = f64::from(ball - 1) / f64::from(LINE_BALLS - 1);
        let x = (LINE_FROM + (LINE_TO - LINE_FROM) * share) * layout.length_m;
        let at = DVec2::new(x, 0.0);
        BallPosition { ball, at }
    };
    (1..=LINE_BALLS).map(place).collect()
}

fn spot_shot(layout: &TableLayout, rng: &mut CounterRng) -> BallPositions {
    let behind = 0.1 * layout.length_m * rng.unit();
    let across = 0.7 * layout.width_m * (rng.unit() - 0.5);
    let cue = layout.head_spot() + DVec2::new(-behind, across);
    [(0, cue), (1, layout.foot_spot())]
        .map(|(ball, at)| BallPosition { ball, at })
        .to_vec()
}

/// Balls at random places, away from cushions and from each other.
fn apart(
    layout: &TableLayout,
    balls: impl IntoIterator<Item = u8>,
    rng: &mut CounterRng,
) -> BallPositions {
    let least = CLEAR_RADII * layout.radius_m;
    let half = 0.5 * DVec2::new(layout.length_m, layout.width_m) - least;
    let mut positions = BallPositions::new();
    for ball in balls {
        for _ in 0..DRAWS_MAX {
            let at = half * (2.0 * DVec2::new(rng.unit(), rng.unit()) - 1.0);
            if positions.iter().all(|p| p.at.distance(at) > least) {
                positions.push(BallPosition { ball, at });
                break;
            }
        }
    }
    positions
}

/// Whether ball 1 can be potted straight from the cue ball: neither path is blocked, the cut is
/// [`CUT_RAD_MAX`] at most, and neither path is longer than half the table.
fn has_plain_pot(layout: &TableLayout, positions: &BallPositions) -> bool {
    let (Some(cue), Some(object)) = (place_of(positions, 0), place_of(positions, 1)) else {
        return false;
    };
    let room = 1.3 * layout.radius_m;
    layout.pockets.iter().any(|&pocket| {
        let way = (pocket - object).normalize_or_zero();
        let ghost = object - way * (layout.radius_m + layout.cue_radius_m);
        // A side pocket accepts balls only from in front of it.
        let is_side = pocket.x.abs() < 0.2 * layout.length_m;
        let is_open = !is_side || way.y.abs() > SIDE_COS;
        is_open
            && angle_between(ghost - cue, way).abs() < CUT_RAD_MAX
            && cue.distance(ghost).max(object.distance(pocket)) < 0.5 * layout.length_m
            && layout.is_clear(positions, (cue, ghost), room, |ball| ball > 1)
            && layout.is_clear(positions, (object, pocket), room, |ball| ball > 1)
    })
}

const LINE_BALLS: u8 = 10;
/// Ends of the line of balls, in table lengths from the middle.
const LINE_FROM: f64 = -0.15;
const LINE_TO: f64 = 0.42;
const POSITION_BALLS: u8 = 3;
/// Object balls of a daily shot: three are in the way.
const DAILY_BALLS: u8 = 4;
/// Minimum distance in ball radii between the centres of balls, and to cushions.
const CLEAR_RADII: f64 = 4.0;
const CUT_RAD_MAX: f64 = 0.7;
/// Cosine of 30°: approached from farther aside a side pocket is narrow.
const SIDE_COS: f64 = 0.866;
/// Maximum number of draws: one in a dozen is such a layout.
const DRAWS_MAX: u32 = 1000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::test_shots::{TestTable, hit, layout, pot};
    use crate::rules::{ShotEvent, rack};

    fn table(rules: RuleSet) -> TestTable {
        let layout = layout(2.54, 1.27, 0.028575);
        TestTable {
            referee: Referee::new(rules, 1, 0, 5).unwrap(),
            positions: rack(rules, &layout, 5),
            layout,
        }
    }

    fn points(table: &TestTable) -> i32 {
        table.referee.scores()[0]
    }

    #[test]
    fn a_line_up_counts_balls_until_a_miss() {
        let mut table = table(RuleSet::LineUp);
        assert_eq!(table.referee.points_max(), Some(10));
        let verdict = table.play(&[hit(3), pot(3, 0)], None);
        assert!(verdict.goes_on && verdict.rack.is_none());
        assert!(table.play(&[hit(7), pot(7, 2), pot(8, 4)], None).goes_on);
        assert_eq!((points(&table), table.referee.winner()), (3, None));
        table.play(&[hit(1)], None);
        assert_eq!((points(&table), table.referee.winner()), (3, Some(0)));
    }

    #[test]
    fn a_cleared_line_up_is_over_with_all_points() {
        let mut table = table(RuleSet::LineUp);
        for ball in 1..=10 {
            assert_eq!(table.referee.winner(), None);
            table.play(&[hit(ball), pot(ball, 1)], None);
        }
        assert_eq!((points(&table), table.referee.winner()), (10, Some(0)));
    }

    #[test]
    fn every_spot_shot_is_drawn_anew_and_a_scratch_counts_nothing() {
        let mut table = table(RuleSet::SpotShots);
        let mut cue_balls = vec![table.at(0).unwrap()];
        for attempt in 0..10 {
            assert!(!table.referee.is_break() && table.referee.ball_in_hand_area().is_none());
            let scratch = [hit(1), pot(1, 2), pot(0, 3)];
            let events: &[ShotEvent] = if attempt == 4 {
                &scratch
            } else {
                &scratch[..2]
            };
            assert_eq!(table.play(events, None).is_foul(), attempt == 4);
            assert!(table.has(1) || attempt == 9);
            cue_balls.extend(table.at(0));
        }
        assert_eq!((points(&table), table.referee.winner()), (9, Some(0)));
        cue_balls.dedup();
        assert!(cue_balls.len() > 9, "{cue_balls:?}");
    }

    #[test]
    fn position_play_wants_the_lowest_ball_first() {
        let mut table = table(RuleSet::PositionPlay);
        assert_eq!(table.referee.legal_targets(&table.positions), [1]);
        assert!(table.play(&[hit(1), pot(1, 0)], None).goes_on);
        let verdict = table.play(&[hit(3), pot(3, 0)], None);
        assert!(verdict.is_foul() && verdict.rack.is_some());
        assert_eq!(points(&table), 1);
        assert!(table.has(1) && table.referee.ball_in_hand_area().is_some());
    }

    #[test]
    fn the_daily_shot_stays_the_same_and_counts_less_each_time() {
        for (misses, wanted) in [(0, 3), (1, 2), (2, 1), (3, 0)] {
            let mut table = table(RuleSet::DailyShot);
            let laid = table.positions.clone();
            for _ in 0..misses {
                assert_eq!(table.positions, laid);
                table.play(&[hit(1)], None);
            }
            if misses < 3 {
                table.play(&[hit(1), pot(1, 5)], None);
            }
            assert_eq!((points(&table), table.referee.winner()), (wanted, Some(0)));
        }
    }

    #[test]
    fn each_day_has_a_shot_of_its_own_that_can_be_potted() {
        let layout = layout(2.54, 1.27, 0.028575);
        let shots: Vec<_> = (20_000..20_400)
            .map(|day| rack(RuleSet::DailyShot, &layout, day))
            .collect();
        for (day, shot) in shots.iter().enumerate() {
            assert!(has_plain_pot(&layout, shot) && shot.len() == 5, "{day}");
            assert!(shots[..day].iter().all(|other| other != shot), "{day}");
        }
    }
}
