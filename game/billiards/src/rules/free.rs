//! The free table: no rules, and nothing that stops the play.

use carom_text::text;

use super::{
    referee::{JudgedShot, Referee},
    spots::own_spot,
    verdict::Verdict,
};

impl Referee {
    pub(crate) fn judge_free(&mut self, shot: &JudgedShot<'_>, verdict: &mut Verdict) {
        let report = shot.report;
        let potted = report.potted();
        self.end_break();
        verdict.pots.clone_from(&potted);
        for ball in report.off_table().filter(|&ball| ball != 0) {
            verdict.add_line(text!(
                "free-spotted",
                ball = capital(&self.rules().ball_name(ball))
            ));
            self.spot(
                shot,
                verdict,
                ball,
                own_spot(self.rules(), shot.layout, ball),
            );
        }
        if report.lost_cue_ball() {
            verdict.add_line(text!("free-cue-ball-lost"));
        }
        if !report.after.iter().any(|p| p.ball != 0) && verdict.moves.is_empty() {
            verdict.add_line(text!("free-clear"));
            self.rack_again(verdict);
        }
        verdict.goes_on = !potted.is_empty() && !report.lost_cue_ball();
        if !verdict.goes_on {
            self.pass();
        }
        self.take_in_hand(self.info().after_loss);
    }
}

/// The words with a capital first letter.
pub(crate) fn capital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(letters).collect()
    })
}
