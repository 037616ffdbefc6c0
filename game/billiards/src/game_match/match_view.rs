//! The view of a match: everything that a screen shows of it.

use carom_text::text;

use super::Match;
use crate::rules::{BallGroup, Call, Choice, PlacementArea, RuleSet};

/// Everything that is shown of a match, in any arrangement.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchView {
    /// The game.
    pub rules: RuleSet,
    /// The game's name.
    pub title: &'static str,
    /// Goal of the match: "first to 3 racks", "one rack".
    pub goal: String,
    /// The players, in the order of their turns.
    pub players: Vec<PlayerView>,
    /// Maximum points of a drill; none in a match.
    pub points_max: Option<u32>,
    /// Index of the player at the table.
    pub turn: usize,
    /// Instruction for the player at the table, a sentence.
    pub prompt: String,
    /// Outcome of the last shot, until the next stroke.
    pub banner: Option<String>,
    /// Whether the banner reports a foul.
    pub is_foul: bool,
    /// The call, if any.
    pub call: Option<CallView>,
    /// Whether ball and pocket are to be called.
    pub wants_call: bool,
    /// Whether the shot may be called a push-out.
    pub may_push_out: bool,
    /// Choices of the player before the shot; usually none. The first is what a stroke means without a
    /// choice.
    pub options: Vec<OptionView>,
    /// Area in which the cue ball is in hand.
    pub hand: Option<PlacementArea>,
    /// The balls that the cue ball may hit first: others may be drawn dimmed.
    pub on: Vec<u8>,
    /// Lines of the log, in order.
    pub log: Vec<String>,
    /// Index of the player who has won.
    pub winner: Option<usize>,
    /// Number of shots that can be taken back.
    pub undo: usize,
}

impl MatchView {
    /// Whether shots of a match with rules were played, and it is not over.
    pub fn is_unfinished(&self) -> bool {
        self.rules != RuleSet::Free && self.winner.is_none() && self.undo > 0
    }
}

/// A player's part of the scoreboard.
#[derive(Clone, Debug, PartialEq)]
pub struct PlayerView {
    /// Display name.
    pub name: String,
    /// Whether the computer plays.
    pub is_computer: bool,
    /// Racks, frames or points.
    pub score: i32,
    /// Further state: a group and its symbol, a break, fouls in a row. May be empty.
    pub state: String,
    /// The group, in 8-ball.
    pub group: Option<BallGroup>,
    /// The object balls that the player still needs, where balls belong to players.
    pub left: Vec<u8>,
}

/// A call.
#[derive(Clone, Debug, PartialEq)]
pub struct CallView {
    /// The call itself.
    pub call: Call,
    /// In words: "the 5 in the left side pocket".
    pub words: String,
}

/// A choice that is offered.
#[derive(Clone, Debug, PartialEq)]
pub struct OptionView {
    /// The argument of [`Match::choose`].
    pub choice: Choice,
    /// Label of its button.
    pub words: &'static str,
}

impl Match {
    /// Everything that is shown of the match now.
    pub fn view(&self) -> MatchView {
        let referee = self.referee();
        let info = referee.info();
        let positions = self.ball_positions();
        let option = |&choice: &Choice| OptionView {
            choice,
            words: choice.display_text(),
        };
        MatchView {
            rules: referee.rules(),
            title: info.name,
            goal: text!(&format!("goal-{}", info.unit), target = referee.target()),
            players: (0..self.players.len())
                .map(|i| self.player_view(i))
                .collect(),
            points_max: referee.points_max(),
            turn: referee.turn(),
            prompt: self.prompt(),
            banner: self.now.banner.clone(),
            is_foul: self.past.last().is_some_and(|turn| turn.verdict.is_foul()),
            call: self.now.call.map(|call| CallView {
                call,
                words: self.call_text(call),
            }),
            wants_call: referee.wants_call(),
            may_push_out: referee.may_push_out(),
            options: referee.options().iter().map(option).collect(),
            hand: referee.ball_in_hand_area(),
            on: referee.legal_targets(&positions),
            log: self.now.log.clone(),
            winner: referee.winner(),
            undo: self.undo_count(),
        }
    }

    /// A call in words.
    pub fn call_text(&self, call: Call) -> String {
        match call {
            Call::Safety => text!("call-safety").to_owned(),
            Call::PushOut => text!("call-push-out").to_owned(),
            Call::Pot { ball, pocket } => {
                let ball = self.referee().rules().ball_name(ball);
                match pocket {
                    Some(pocket) => text!(
                        "call-pot",
                        ball = ball,
                        pocket = self.layout.pocket_name(pocket)
                    ),
                    None => ball,
                }
            }
        }
    }

    fn player_view(&self, index: usize) -> PlayerView {
        let referee = self.referee();
        let group = referee.group(index);
        let left = self.ball_positions().into_iter().map(|p| p.ball);
        PlayerView {
            name: self.players[index].name(),
            is_computer: self.players[index].level().is_some(),
            score: referee.scores()[index],
            state: referee.state_text(index),
            group,
            left: left
                .filter(|&ball| group.is_some() && BallGroup::of(ball) == group)
                .collect(),
        }
    }

    /// Sentence on the end of the match: the winner, or the score of a drill.
    pub(super) fn result_text(&self, winner: usize) -> String {
        let name = self.players[winner].name();
        let score = self.referee().scores()[winner];
        match self.referee().points_max() {
            Some(most) => text!("result-points", name = name, score = score, most = most),
            None => text!("result-won", name = name),
        }
    }

    fn prompt(&self) -> String {
        let referee = self.referee();
        if let Some(winner) = referee.winner() {
            return self.result_text(winner);
        }
        let prompt = if referee.rules() == RuleSet::Free {
            text!("prompt-free").to_owned()
        } else if referee.is_break() {
            text!("prompt-break").to_owned()
        } else {
            let on = referee.legal_targets_text(&self.ball_positions());
            text!("prompt-on", on = on)
        };
        match referee.ball_in_hand_area() {
            Some(area) => text!(
                "prompt-in-hand",
                prompt = prompt,
                area = area.display_text()
            ),
            None => prompt,
        }
    }
}
