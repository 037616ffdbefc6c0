//! Ball in hand: the player moves the cue ball over the table and places it where rules and other balls
//! allow it.

use carom_billiards::PlacementFault;
use carom_text::text;
use glam::DVec2;

use crate::input::{AimIntent, StrokeIntent};

use super::{Game, TurnPhase};

/// A carried cue ball.
#[derive(Clone, Debug, PartialEq)]
pub struct BallInHand {
    /// Position over the table, in m.
    pub at: DVec2,
    /// Whether it may be placed there, or the reason why not.
    pub verdict: Result<(), PlacementFault>,
    /// Position where it was picked up.
    from: DVec2,
}

impl Game {
    /// The carried cue ball, if it is carried.
    pub fn ball_in_hand(&self) -> Option<&BallInHand> {
        match &self.phase {
            TurnPhase::Placing(ball_in_hand) => Some(ball_in_hand),
            _ => None,
        }
    }

    /// Picks the cue ball up, or places it.
    pub(super) fn pick_up(&mut self) {
        if matches!(self.phase, TurnPhase::Placing(_)) {
            return self.put_down();
        }
        let Some(at) = self.contest.cue_ball_in_hand() else {
            self.notice = Some(text!("ball-not-in-hand").to_owned());
            return;
        };
        self.phase = TurnPhase::Placing(BallInHand {
            at,
            verdict: self.contest.may_place(at),
            from: at,
        });
    }

    /// Moves the carried ball to a point of the window.
    pub(super) fn point(&mut self, point: DVec2, now_secs: f64) {
        if !matches!(self.phase, TurnPhase::Placing(_)) {
            return;
        }
        let projection = self.projection(now_secs);
        if let Some(seen) = projection.world_from_film(point, 0.0) {
            self.carry_to(seen.truncate());
        }
    }

    /// Moves the carried ball by the controls of the aim; false if none is carried or the intent is another.
    pub(super) fn carry(&mut self, intent: AimIntent) -> bool {
        let TurnPhase::Placing(ball_in_hand) = &self.phase else {
            return false;
        };
        let by = match intent {
            AimIntent::MoveTip(by) => by * TIP_M,
            AimIntent::Turn(by_rad) => DVec2::new(-by_rad.to_degrees() * TURN_M, 0.0),
            _ => return false,
        };
        self.carry_to(ball_in_hand.at + self.on_screen(by));
        true
    }

    /// Places the carried ball, or puts it back, by the controls of the stroke.
    pub(super) fn stroke_in_hand(&mut self, intent: StrokeIntent) {
        match intent {
            StrokeIntent::Strike | StrokeIntent::BeginCharge => self.put_down(),
            StrokeIntent::Cancel => self.put_back(),
            StrokeIntent::BeginPull
            | StrokeIntent::Pull(_)
            | StrokeIntent::BeginSwing
            | StrokeIntent::Swing(_)
            | StrokeIntent::Release => {}
        }
    }

    /// Converts a displacement to the right and away on screen to one on the table.
    fn on_screen(&self, by: DVec2) -> DVec2 {
        let ahead = DVec2::from_angle(self.seen_from.bearing_rad);
        ahead * by.y - ahead.perp() * by.x
    }

    fn carry_to(&mut self, at: DVec2) {
        let verdict = self.contest.may_place(at);
        if verdict.is_ok() {
            // The traced ball follows only to legal positions.
            let _ = self.contest.place(at);
            self.shot_preview = None;
        }
        if let TurnPhase::Placing(ball_in_hand) = &mut self.phase {
            (ball_in_hand.at, ball_in_hand.verdict) = (at, verdict);
        }
    }

    pub(super) fn put_down(&mut self) {
        let TurnPhase::Placing(ball_in_hand) = &self.phase else {
            return;
        };
        if let Err(why) = ball_in_hand.verdict {
            self.notice = Some(why.to_string());
            return;
        }
        self.get_ready();
    }

    pub(super) fn put_back(&mut self) {
        if let TurnPhase::Placing(ball_in_hand) = &self.phase {
            let from = ball_in_hand.from;
            // Cannot fail: the ball was there before.
            let _ = self.contest.place(from);
        }
        self.get_ready();
    }
}

/// Distance per ball radius of the tip's motion: a key press, 5 % of a radius, moves the ball by 20 mm, 2
/// mm in fine mode.
const TIP_M: f64 = 0.4;
/// Distance per degree of the aim's rotation.
const TURN_M: f64 = 0.02;
