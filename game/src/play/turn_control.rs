//! Turns of a match: decisions before a stroke, and the computer's turns.

use std::rc::Rc;

use carom_billiards::game_match::{Match, MatchView};
use carom_billiards::physics::{self, AimContact};
use carom_billiards::rules::{Call, Calls, RuleSet};
use carom_text::text;
use glam::DVec2;

use crate::input::MatchIntent;

use super::ai_turn::{AiTask, AiTurn, PlannedStroke};
use super::aim::{Aim, power_of_speed};
use super::cue::SWING_SECS;
use super::{CueView, Game, TurnPhase};

impl Game {
    /// The match.
    pub fn contest(&self) -> &Match {
        &self.contest
    }

    /// State of the match for the interface, computed on demand.
    pub fn match_view(&mut self) -> Rc<MatchView> {
        let contest = &self.contest;
        Rc::clone(
            self.match_view
                .get_or_insert_with(|| Rc::new(contest.view())),
        )
    }

    /// Whether the computer searches a shot.
    pub fn is_thinking(&self) -> bool {
        self.ai_turn.is_some()
    }

    /// Whether it is a person's turn, with neither a stroke nor a shot in progress.
    pub fn may_play(&self) -> bool {
        let player = self.contest.at_table();
        let is_person = player.is_some_and(|player| player.level().is_none());
        let is_free = matches!(self.phase, TurnPhase::Aiming | TurnPhase::Placing(_));
        let plays = |ai_turn: &AiTurn| ai_turn.purpose == AiTask::Play;
        is_person && is_free && !self.ai_turn.as_ref().is_some_and(plays)
    }

    /// The ball that the aim meets first.
    pub fn aimed_ball(&self) -> Option<u8> {
        let stroke = self.aim.stroke(self.aim.power);
        match physics::predict(self.contest.world(), stroke).ok()?.contact {
            AimContact::Ball { number, .. } => Some(number),
            _ => None,
        }
    }

    /// Description of the call that would apply to the present aim; none if there is none.
    pub fn call_words(&self) -> Option<String> {
        let call = self.contest.call_for(self.aim.stroke(self.aim.power))?;
        Some(self.contest.call_text(call))
    }

    /// Applies a decision other than a stroke.
    pub fn decide(&mut self, intent: MatchIntent, now_secs: f64) {
        match intent {
            MatchIntent::Skip => self.skip(now_secs),
            MatchIntent::Rack => self.rack(),
            MatchIntent::Undo => self.turn_back(false),
            MatchIntent::Redo => self.turn_back(true),
            MatchIntent::Point(point) => self.point(point, now_secs),
            MatchIntent::Put => self.put_down(),
            // All others require a person's turn.
            _ if !self.may_play() => {}
            MatchIntent::Choose(choice) => {
                let chosen = self.contest.choose(choice);
                self.report(chosen);
                self.begin_turn();
            }
            MatchIntent::Call(call) => self.call(call),
            MatchIntent::NextCall => self.call(self.next_call()),
            MatchIntent::Suggest => self.ask(AiTask::Advise),
            MatchIntent::TakeOver => self.ask(AiTask::Play),
            MatchIntent::PickUp => self.pick_up(),
        }
    }

    /// Sentence about the computer's intention, while its cue turns to the shot.
    pub fn intention(&self) -> Option<&str> {
        match &self.phase {
            TurnPhase::Planned(planned) => Some(&planned.intention),
            _ => None,
        }
    }

    /// Skips the computer's search, its aiming, or a shot.
    fn skip(&mut self, now_secs: f64) {
        match (&mut self.phase, &self.ai_turn) {
            (TurnPhase::Planned(planned), _) => planned.hurry(now_secs),
            (TurnPhase::Watching(_), _) => self.end_shot(now_secs),
            (_, Some(ai_turn)) => ai_turn.hurry(),
            (_, None) => {}
        }
    }

    fn call(&mut self, call: Option<Call>) {
        self.contest.call(call);
        self.match_view = None;
    }

    /// The call after the present one in the cycle of none, each pocket for the ball aimed at, a safety and a
    /// push-out if allowed; in snooker the colours.
    fn next_call(&self) -> Option<Call> {
        let referee = self.contest.referee();
        let on = referee.legal_targets(&self.contest.ball_positions());
        let mut calls = vec![None];
        let pot = |ball, pocket| Some(Call::Pot { ball, pocket });
        match referee.info().calls {
            Calls::Pocket => {
                let ball = self.aimed_ball().or(on.first().copied()).unwrap_or(1);
                let pockets = 0..self.contest.table_layout().pockets.len();
                calls.extend(pockets.map(|pocket| pot(ball, Some(pocket))));
                calls.push(Some(Call::Safety));
            }
            Calls::Colour => calls.extend(on.iter().map(|&ball| pot(ball, None))),
            Calls::Nothing => {}
        }
        if referee.may_push_out() {
            calls.push(Some(Call::PushOut));
        }
        // The present call may be for another ball than the one aimed at: pockets are compared.
        let pocket = |call: &Option<Call>| match *call {
            Some(Call::Pot {
                pocket: Some(pocket),
                ..
            }) => Some(pocket),
            _ => None,
        };
        let now = self.contest.called();
        let same = |call: &Option<Call>| {
            *call == now || (pocket(call).is_some() && pocket(call) == pocket(&now))
        };
        let place = calls.iter().position(same).unwrap_or(0);
        calls[(place + 1) % calls.len()]
    }

    /// Undoes or redoes shots until it is a person's turn.
    fn turn_back(&mut self, is_redo: bool) {
        if matches!(self.phase, TurnPhase::Watching(_)) {
            self.notice = Some(text!(if is_redo { "redo-wait" } else { "undo-wait" }).to_owned());
            return;
        }
        self.ai_turn = None;
        let mut taken = 0;
        while match is_redo {
            false => self.contest.undo(),
            true => self.contest.redo(),
        } {
            taken += 1;
            let player = self.contest.at_table();
            if player.is_some_and(|player| player.level().is_none()) {
                break;
            }
        }
        self.begin_turn();
        let count = if is_redo { "redone" } else { "undone" };
        self.notice = Some(text!(count, shots = taken));
    }

    fn ask(&mut self, purpose: AiTask) {
        if self.ai_turn.is_some() {
            return;
        }
        if let Some(ai_turn) = self.report(AiTurn::for_person(&self.contest, purpose)) {
            self.ai_turn = Some(ai_turn);
            self.notice = Some(text!("suggestion-search").to_owned());
        }
    }

    /// Prepares the next turn; after a foul or a scratch, a cue ball in hand is picked up.
    pub(super) fn begin_turn(&mut self) {
        self.get_ready();
        let referee = self.contest.referee();
        let is_racked = referee.is_break() && referee.rules() != RuleSet::Free;
        let is_lost = self.contest.turns().last().is_some_and(|turn| {
            turn.verdict.is_foul() || turn.verdict.moves.iter().any(|moved| moved.ball == 0)
        });
        let is_in_hand = referee.ball_in_hand_area().is_some() && referee.options().is_empty();
        if is_in_hand && is_lost && !is_racked && self.may_play() {
            self.pick_up();
        }
    }

    /// Returns to aiming, with a new aim.
    pub(super) fn get_ready(&mut self) {
        self.phase = TurnPhase::Aiming;
        (self.shot_preview, self.match_view, self.ai_turn) = (None, None, None);
        self.aim.level();
        if self.contest.referee().rules() != RuleSet::Free {
            self.aim_at_nearest();
        }
        self.follow_break();
        self.clear_cue();
    }

    /// Sets the power at the beginning of a break and resets it afterwards; in between the player can
    /// change it.
    fn follow_break(&mut self) {
        let referee = self.contest.referee();
        let is_hard = matches!(
            referee.rules(),
            RuleSet::Free | RuleSet::Eight | RuleSet::Nine
        );
        let is_break = is_hard && referee.is_break();
        if std::mem::replace(&mut self.is_break, is_break) != is_break {
            self.aim.power = match is_break {
                true => power_of_speed(BREAK_M_S),
                false => Aim::LEVEL.power,
            };
        }
    }

    /// Points the cue at the nearest legal ball.
    fn aim_at_nearest(&mut self) {
        let positions = self.contest.ball_positions();
        let on = self.contest.referee().legal_targets(&positions);
        let Some(cue_ball) = self.cue_ball().map(|ball| ball.truncate()) else {
            return;
        };
        let legal = positions.iter().filter(|p| on.contains(&p.ball));
        let nearest = legal.min_by(|a, b| {
            let way = |at: DVec2| at.distance_squared(cue_ball);
            way(a.at).total_cmp(&way(b.at))
        });
        if let Some(ball) = nearest.filter(|ball| ball.at.distance(cue_ball) > 1e-6) {
            self.aim.bearing_rad = (ball.at - cue_ball).to_angle();
        }
    }

    /// Starts the computer's search in its turn, and executes a finished decision.
    pub(super) fn think(&mut self, now_secs: f64) {
        let level = self.contest.at_table().and_then(|player| player.level());
        if let (None, Some(level), TurnPhase::Aiming) = (&self.ai_turn, level, &self.phase) {
            self.ai_turn = self.report(AiTurn::own(&self.contest, level.into()));
        }
        let Some(ai_turn) = &self.ai_turn else {
            return;
        };
        let purpose = ai_turn.purpose;
        let Some(thought) = ai_turn.poll().transpose() else {
            return;
        };
        self.ai_turn = None;
        if let Some((decision, skill)) = self.report(thought) {
            let done = match purpose {
                AiTask::Play => self.carry_out(&decision, &skill, now_secs),
                AiTask::Advise => self.show_advice(&decision),
            };
            self.report(done);
        }
    }

    fn carry_out(
        &mut self,
        decision: &carom_billiards::ai::Decision,
        skill: &carom_billiards::ai::Skill,
        now_secs: f64,
    ) -> carom_billiards::Result<()> {
        let intention = self.contest.intention_text(decision);
        // The free table has no match panel to show the intention, so it becomes a notice.
        let is_free = self.contest.referee().rules() == RuleSet::Free;
        self.notice = is_free.then(|| intention.clone());
        self.match_view = None;
        let struck = self.contest.carry_out(decision, skill)?;
        self.match_view = None;
        match struck {
            Some(struck) => {
                let planned = PlannedStroke::new(struck, intention, self.aim, now_secs);
                self.phase = TurnPhase::Planned(Box::new(planned));
            }
            None => self.begin_turn(),
        }
        Ok(())
    }

    /// Shows the computer's suggestion, and sets the aim to it.
    fn show_advice(
        &mut self,
        decision: &carom_billiards::ai::Decision,
    ) -> carom_billiards::Result<()> {
        self.notice = Some(self.contest.hint_text(decision));
        if decision.choice.is_some() {
            return Ok(());
        }
        if let Some(at) = decision.place {
            self.contest.place(at)?;
        }
        self.phase = TurnPhase::Aiming;
        self.contest.call(decision.call);
        self.aim = Aim::of(&decision.stroke);
        (self.match_view, self.shot_preview) = (None, None);
        self.clear_cue();
        Ok(())
    }

    /// Follows the animation of the computer's cue, and strikes once it is drawn back.
    pub(super) fn follow_plan(&mut self, now_secs: f64) {
        let TurnPhase::Planned(planned) = &self.phase else {
            return;
        };
        self.aim = planned.aim(now_secs);
        if !planned.is_due(now_secs) {
            return;
        }
        let cue = self.cue(now_secs);
        let TurnPhase::Planned(planned) = std::mem::replace(&mut self.phase, TurnPhase::Aiming)
        else {
            return;
        };
        let PlannedStroke { stroke, shot, .. } = *planned;
        self.watch(stroke, shot, cue, now_secs + SWING_SECS.end);
    }

    /// The cue of the computer's planned shot.
    pub(super) fn planned_cue(&self, planned: &PlannedStroke, now_secs: f64) -> Option<CueView> {
        let aim = planned.aim(now_secs);
        let resting = CueView::resting(self.cue_ball()?, &aim);
        Some(match planned.drawn(now_secs) {
            Some(share) => resting.drawn(aim.power, super::cue::DRAW_M * aim.power * share),
            None => resting,
        })
    }
}

/// Speed of the cue in an ordinary break of 8-ball or 9-ball.
const BREAK_M_S: f64 = 8.0;
