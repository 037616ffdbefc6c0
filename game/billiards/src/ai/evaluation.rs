//! The value of a shot to its player.

use super::{Position, pot_candidates::pot_candidates, skill::Skill};
use crate::physics::{Shot, Stroke};
use crate::rules::{BallPositions, Call, PlacementArea, Referee, RuleSet, Verdict, apply_moves};
use crate::shot_report::report;

/// Value of a shot, about −1 (lost) to 1 (won): of the referee's verdict, and of the chance that the
/// table then offers to the next player.
pub(crate) fn evaluate(
    position: &Position,
    stroke: &Stroke,
    shot: &Shot,
    call: Option<Call>,
    skill: &Skill,
) -> f64 {
    let player = position.referee.turn();
    let report = report(&position.world, stroke, shot);
    let mut referee = position.referee.clone();
    let verdict = referee.judge(&position.layout, &report, call);
    if let Some(won) = rack_won(&position.referee, &referee, player) {
        return if won { 1.0 } else { -1.0 };
    }
    let positions = apply_moves(&report.after, &verdict.moves);
    let gained = gain(&position.referee, &verdict);
    let mine = referee.turn() == player;
    // After an attempt of a drill the balls are laid anew, so that the ones left offer nothing.
    let is_laid_anew = referee.rules().is_drill() && !verdict.goes_on;
    let offered = match is_laid_anew {
        true => 0.0,
        false => offer(position, &referee, &positions, skill),
    };
    let near = if position.referee.rules() == RuleSet::ThreeCushion {
        nearness(&report)
    } else {
        0.0
    };
    // One ply of lookahead: what the table offers the opponent counts against the shot.
    let next = if mine { offered } else { -offered };
    gained + near + OFFER * skill.foresight.max(0.1) * next
        - if verdict.is_foul() { FOUL } else { 0.0 }
}

/// Whether the shot won a rack, frame or match, or lost one; none if neither.
fn rack_won(before: &Referee, after: &Referee, player: usize) -> Option<bool> {
    // Nobody wins a drill, and its score is not the rack's.
    if before.rules().is_drill() {
        return None;
    }
    if let Some(winner) = after.winner() {
        return Some(winner == player);
    }
    // Games for points have no racks to win.
    let is_points = before.info().unit == "points";
    let other = (player + 1) % before.scores().len();
    let rose = |who: usize| after.scores()[who] > before.scores()[who];
    match () {
        () if is_points => None,
        () if rose(player) => Some(true),
        () if other != player && rose(other) => Some(false),
        () => None,
    }
}

/// Value of the verdict itself.
fn gain(referee: &Referee, verdict: &Verdict) -> f64 {
    match referee.rules() {
        RuleSet::Snooker => {
            0.05 * f64::from(verdict.points.min(7)) + if verdict.goes_on { 0.25 } else { 0.0 }
        }
        RuleSet::ThreeCushion => 0.8 * f64::from(verdict.points),
        RuleSet::Straight => 0.3 * f64::from(verdict.points.clamp(-2, 3)),
        RuleSet::Free | RuleSet::Eight | RuleSet::Nine => {
            if verdict.goes_on {
                0.35
            } else {
                0.0
            }
        }
        RuleSet::LineUp | RuleSet::SpotShots | RuleSet::PositionPlay | RuleSet::DailyShot => {
            0.35 * f64::from(verdict.points)
        }
    }
}

/// Chance that the player at the table makes the next shot.
fn offer(position: &Position, referee: &Referee, positions: &BallPositions, skill: &Skill) -> f64 {
    if referee.ball_in_hand_area() == Some(PlacementArea::Anywhere) && !referee.is_break() {
        return IN_HAND;
    }
    if referee.rules() == RuleSet::ThreeCushion {
        return 0.0;
    }
    let on = referee.legal_targets(positions);
    let found = pot_candidates(&position.layout, positions, &on, skill);
    found.first().map_or(0.0, |line| line.chance)
}

/// Value of the balls that the cue ball touched, so that a near miss of a carom counts more than a wide
/// one.
fn nearness(report: &crate::rules::ShotReport) -> f64 {
    let mut balls: Vec<u8> = report.contacts().collect();
    balls.sort_unstable();
    balls.dedup();
    0.1 * balls.len() as f64
}

/// Maximum weight of the next shot.
const OFFER: f64 = 0.5;
/// Cost of a foul.
const FOUL: f64 = 0.3;
/// Chance with the cue ball in hand anywhere: there is nearly always a pot.
const IN_HAND: f64 = 0.95;
