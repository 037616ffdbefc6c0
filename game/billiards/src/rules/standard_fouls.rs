//! The fouls that the games of pool have in common.

use carom_text::text;

use super::{
    foul::Foul,
    layout::{BallPosition, PlacementArea},
    referee::{JudgedShot, Referee},
    verdict::Verdict,
};

impl Referee {
    /// The fouls that games have in common, as far as the game's row asks for them (WPA 6).
    pub(crate) fn standard_fouls(
        &self,
        shot: &JudgedShot<'_>,
        on: &[u8],
        legal_targets_text: &str,
    ) -> Vec<Foul> {
        let (report, info) = (shot.report, self.info());
        let mut fouls = Vec::new();
        if report.scratch().is_some() {
            fouls.push(Foul::Scratch);
        }
        fouls.extend(report.off_table().map(Foul::off_table));
        fouls.extend(self.contact_foul(shot, on, legal_targets_text));
        if info.needs_rail && report.first_hit().is_some() && !report.rail_after_contact() {
            fouls.push(Foul::NoRail);
        }
        fouls.extend(report.double_hit.map(Foul::DoubleHit));
        fouls
    }

    fn contact_foul(
        &self,
        shot: &JudgedShot<'_>,
        on: &[u8],
        legal_targets_text: &str,
    ) -> Option<Foul> {
        let report = shot.report;
        let Some(hit) = report.first_hit() else {
            return Some(Foul::NoBallHit);
        };
        if !on.contains(&hit) {
            let on = legal_targets_text.to_owned();
            return Some(Foul::WrongBall { hit, on });
        }
        let head_x = shot.layout.head_spot().x;
        let lies_behind = |p: &&BallPosition| p.ball == hit && p.at.x <= head_x;
        let behind = report.before.iter().find(lies_behind).is_some();
        let stays_behind = shot.hand == Some(PlacementArea::Kitchen) && report.reach_x_m <= head_x;
        (behind && stays_behind).then_some(Foul::BehindHeadString(hit))
    }

    /// A break that potted nothing and drove too few balls to cushions.
    pub(crate) fn weak_break(&self, shot: &JudgedShot<'_>) -> Option<Foul> {
        let (driven, needed) = (shot.report.balls_to_rails(), self.info().break_rails);
        (driven < needed).then_some(Foul::WeakBreak { driven, needed })
    }

    pub(crate) fn add_foul_line(&self, verdict: &mut Verdict) {
        let reasons: Vec<String> = verdict
            .fouls
            .iter()
            .map(|foul| foul.display_text(self.rules()))
            .collect();
        if !reasons.is_empty() {
            verdict
                .lines
                .insert(0, text!("verdict-fouled", reasons = reasons.join("; ")));
        }
    }
}
