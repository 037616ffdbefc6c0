//! The referee: turns, scores, and the consequences of a shot.

use carom_text::text;
use glam::DVec2;

use crate::RuleFault;

use super::{
    ball_group::BallGroup,
    call::Call,
    layout::{BallPosition, BallPositions, PlacementArea, TableLayout, object_balls, place_of},
    rack_state::{Drill, Eight, Nine, Snooker, Straight},
    report::ShotReport,
    ruleset::{Calls, RuleInfo, RuleSet},
    verdict::{Choice, Verdict},
};

/// State of a match, as far as the rules depend on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Referee {
    rules: RuleSet,
    target: u32,
    seed: u32,
    turn: usize,
    breaker: usize,
    is_break: bool,
    hand: Option<PlacementArea>,
    options: Vec<Choice>,
    scores: Vec<i32>,
    fouls_in_row: Vec<u8>,
    winner: Option<usize>,
    game: Game,
}

/// State that only one game has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Game {
    Free,
    Eight(Eight),
    Nine(Nine),
    Straight(Straight),
    Snooker(Snooker),
    ThreeCushion,
    Drill(Drill),
}

impl Game {
    fn new(rules: RuleSet) -> Self {
        match rules {
            RuleSet::Free => Self::Free,
            RuleSet::Eight => Self::Eight(Eight::default()),
            RuleSet::Nine => Self::Nine(Nine::default()),
            RuleSet::Straight => Self::Straight(Straight::default()),
            RuleSet::Snooker => Self::Snooker(Snooker::default()),
            RuleSet::ThreeCushion => Self::ThreeCushion,
            RuleSet::LineUp | RuleSet::SpotShots | RuleSet::PositionPlay | RuleSet::DailyShot => {
                Self::Drill(Drill::default())
            }
        }
    }
}

/// A shot to be judged.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JudgedShot<'a> {
    pub(crate) layout: &'a TableLayout,
    pub(crate) report: &'a ShotReport,
    pub(crate) call: Option<Call>,
    /// Area in which the cue ball was in hand before the stroke.
    pub(crate) hand: Option<PlacementArea>,
}

impl JudgedShot<'_> {
    /// The ball that was potted as called.
    pub(crate) fn called_pot(&self) -> Option<u8> {
        let Some(Call::Pot { ball, pocket }) = self.call else {
            return None;
        };
        let fell = |(potted, hole): (u8, usize)| potted == ball && pocket.is_none_or(|p| p == hole);
        self.report.pocketed().any(fell).then_some(ball)
    }
}

impl Referee {
    /// A match of `players` to a target of racks, frames or points, 1 to [`Referee::TARGET_MAX`], or 0
    /// for the game's own. Player 0 breaks; in later racks they alternate (WPA Regulation 15). The seed
    /// draws the racks.
    ///
    /// # Errors
    /// A number of players or a target that the game does not have.
    pub fn new(rules: RuleSet, players: usize, target: u32, seed: u32) -> Result<Self, RuleFault> {
        let info = rules.info();
        if !info.players.contains(&players) {
            return Err(RuleFault::PlayerCount {
                game: info.name,
                players,
                min: *info.players.start(),
                max: *info.players.end(),
            });
        }
        if target > Self::TARGET_MAX {
            return Err(RuleFault::TargetTooLong {
                target,
                unit: info.unit,
                max: Self::TARGET_MAX,
            });
        }
        Ok(Self {
            rules,
            target: if target == 0 { info.target } else { target },
            seed,
            turn: 0,
            breaker: 0,
            is_break: !rules.is_drill(),
            hand: info.start,
            options: Vec::new(),
            scores: vec![0; players],
            fouls_in_row: vec![0; players],
            winner: None,
            game: Game::new(rules),
        })
    }

    /// Largest target: the longest matches of straight pool and three-cushion are far below.
    pub const TARGET_MAX: u32 = 1000;

    /// The game.
    pub fn rules(&self) -> RuleSet {
        self.rules
    }

    /// The game's row of the table of rules.
    pub fn info(&self) -> RuleInfo {
        self.rules.info()
    }

    /// Target of the match.
    pub fn target(&self) -> u32 {
        self.target
    }

    /// Seed of the current rack.
    pub fn seed(&self) -> u32 {
        self.seed
    }

    /// The player at the table.
    pub fn turn(&self) -> usize {
        self.turn
    }

    /// Whether the next shot is a break.
    pub fn is_break(&self) -> bool {
        self.is_break
    }

    /// Area in which the cue ball is in hand, if it is.
    pub fn ball_in_hand_area(&self) -> Option<PlacementArea> {
        self.hand
    }

    /// Choices of the player at the table before the shot; usually none.
    pub fn options(&self) -> &[Choice] {
        &self.options
    }

    /// Racks, frames or points of each player.
    pub fn scores(&self) -> &[i32] {
        &self.scores
    }

    /// Fouls in a row of each player, where they count.
    pub fn fouls_in_row(&self) -> &[u8] {
        &self.fouls_in_row
    }

    /// Winner of the match.
    pub fn winner(&self) -> Option<usize> {
        self.winner
    }

    /// The group of a player, in 8-ball once the table is no longer open.
    pub fn group(&self, player: usize) -> Option<BallGroup> {
        match self.game {
            Game::Eight(eight) => eight.group(player),
            _ => None,
        }
    }

    /// The balls that the cue ball may hit first.
    pub fn legal_targets(&self, positions: &BallPositions) -> Vec<u8> {
        match self.game {
            Game::Eight(eight) if !self.is_break => eight.legal_targets(positions, self.turn),
            Game::Nine(_) => Nine::legal_targets(positions),
            Game::Snooker(snooker) => snooker.legal_targets(positions),
            Game::Drill(_) => self.drill_targets(positions),
            Game::ThreeCushion if self.is_break => vec![2],
            Game::Free | Game::Eight(_) | Game::Straight(_) | Game::ThreeCushion => {
                object_balls(positions)
            }
        }
    }

    /// The balls on, in words.
    pub fn legal_targets_text(&self, positions: &BallPositions) -> String {
        match self.game {
            Game::Eight(eight) if !self.is_break => eight.legal_targets_text(positions, self.turn),
            Game::Drill(_) if self.drill_targets(positions).len() > 1 => text!("on-any").to_owned(),
            Game::Nine(_) | Game::Drill(_) => match Nine::legal_targets(positions).first() {
                Some(&ball) => self.rules.ball_name(ball),
                None => text!("on-any").to_owned(),
            },
            Game::Snooker(snooker) => snooker.legal_targets_text(positions),
            Game::ThreeCushion if self.is_break => self.rules.ball_name(2),
            _ => text!("on-any").to_owned(),
        }
    }

    /// Description of a player's state besides the score; may be empty.
    pub fn state_text(&self, player: usize) -> String {
        let mut words = Vec::new();
        if let Some(group) = self.group(player) {
            words.push(format!("{} {}", group.glyph(), group.display_text()));
        }
        if let Game::Snooker(snooker) = self.game {
            words.push(text!("state-points", points = snooker.points[player]));
        }
        if let Game::Drill(drill) = self.game {
            let attempt = (drill.attempts + 1).min(self.target);
            words.push(text!("state-attempt", attempt = attempt, all = self.target));
        }
        if let (Some(run), true) = (self.run(), player == self.turn) {
            words.push(text!("state-run", run = run));
        }
        let fouls = self.fouls_in_row[player];
        if self.info().fouls_in_row.is_some() && fouls > 0 {
            words.push(text!("state-fouls", fouls = fouls));
        }
        words.join(", ")
    }

    /// Balls or points that the player at the table has made without a miss, where they count.
    pub fn run(&self) -> Option<u32> {
        match self.game {
            Game::Straight(straight) => Some(straight.run),
            Game::Snooker(snooker) => Some(snooker.run.max(0) as u32),
            _ => None,
        }
        .filter(|&run| run > 0)
    }

    /// Whether the next shot may be a push-out.
    pub fn may_push_out(&self) -> bool {
        matches!(self.game, Game::Nine(Nine { may_push: true }))
    }

    /// Whether a call is asked for before the next shot.
    pub fn wants_call(&self) -> bool {
        !self.is_break && self.info().calls == Calls::Pocket
    }

    /// Judges a shot.
    pub fn judge(
        &mut self,
        layout: &TableLayout,
        report: &ShotReport,
        call: Option<Call>,
    ) -> Verdict {
        let mut verdict = Verdict::default();
        if self.winner.is_some() {
            return verdict;
        }
        self.options.clear();
        let shot = JudgedShot {
            layout,
            report,
            call,
            hand: self.hand.take(),
        };
        match self.game {
            Game::Free => self.judge_free(&shot, &mut verdict),
            Game::Eight(eight) => self.judge_eight(eight, &shot, &mut verdict),
            Game::Nine(nine) => self.judge_nine(nine, &shot, &mut verdict),
            Game::Straight(straight) => self.judge_straight(straight, &shot, &mut verdict),
            Game::Snooker(snooker) => self.judge_snooker(snooker, &shot, &mut verdict),
            Game::ThreeCushion => self.judge_three_cushion(&shot, &mut verdict),
            Game::Drill(drill) => self.judge_drill(drill, &shot, &mut verdict),
        }
        self.put_cue_ball(layout, &report.after, &mut verdict);
        verdict
    }

    /// Carries out a choice of the player at the table.
    ///
    /// # Errors
    /// [`RuleFault::NoSuchChoice`] if it is not offered now.
    pub fn choose(
        &mut self,
        layout: &TableLayout,
        positions: &BallPositions,
        choice: Choice,
    ) -> Result<Verdict, RuleFault> {
        if !self.options.contains(&choice) {
            let choice = choice.display_text();
            return Err(RuleFault::NoSuchChoice(choice));
        }
        self.options.clear();
        let mut verdict = Verdict::default();
        verdict.add_line(text!(
            "verdict-chose",
            choice = uncapital(choice.display_text())
        ));
        match choice {
            Choice::Accept => {}
            Choice::Return => {
                if let Game::Snooker(snooker) = &mut self.game {
                    snooker.free_ball = false;
                }
                self.pass();
            }
            Choice::TakeInHand => self.take_in_hand(PlacementArea::Kitchen),
            Choice::Rerack => self.rack_again(&mut verdict),
            Choice::RerackReturn => {
                self.pass();
                self.rack_again(&mut verdict);
            }
            Choice::SpotBalls => Self::spot_touching(layout, positions, &mut verdict),
        }
        self.put_cue_ball(layout, positions, &mut verdict);
        Ok(verdict)
    }

    /// The player at the table gives up: the other wins the match.
    pub fn concede(&mut self) -> Verdict {
        let mut verdict = Verdict::default();
        if self.scores.len() > 1 && self.winner.is_none() {
            verdict.add_line(text!("verdict-conceded"));
            self.winner = Some(self.other());
        }
        verdict
    }

    pub(crate) fn set_game(&mut self, game: Game) {
        self.game = game;
    }

    pub(crate) fn other(&self) -> usize {
        (self.turn + 1) % self.scores.len()
    }

    pub(crate) fn pass(&mut self) {
        self.turn = self.other();
    }

    /// Leaves the cue ball where it lies: it is not in hand.
    pub(crate) fn keep_cue_ball(&mut self) {
        self.hand = None;
    }

    pub(crate) fn end_break(&mut self) {
        self.is_break = false;
    }

    pub(crate) fn offer(&mut self, options: &[Choice]) {
        self.options = options.to_vec();
    }

    pub(crate) fn take_in_hand(&mut self, area: PlacementArea) {
        self.hand = Some(area);
    }

    /// Racks the balls again; the player at the table breaks.
    pub(crate) fn rack_again(&mut self, verdict: &mut Verdict) {
        self.seed = self.seed.wrapping_add(1);
        self.is_break = true;
        self.hand = self.info().start;
        self.options.clear();
        self.fouls_in_row.fill(0);
        self.game = Game::new(self.rules);
        verdict.rack = Some(self.seed);
        verdict.moves.clear();
    }

    /// Counts a won rack or frame, and the match if its target is reached.
    pub(crate) fn win_rack(&mut self, player: usize, verdict: &mut Verdict) {
        self.scores[player] += 1;
        if self.scores[player] >= self.target as i32 {
            self.winner = Some(player);
            return;
        }
        self.breaker = (self.breaker + 1) % self.scores.len();
        self.turn = self.breaker;
        self.rack_again(verdict);
    }

    /// Counts a foul in a row, or resets the count. Returns whether the number that is punished is
    /// reached.
    pub(crate) fn count_foul(&mut self, is_foul: bool, verdict: &mut Verdict) -> bool {
        let count = &mut self.fouls_in_row[self.turn];
        *count = if is_foul { *count + 1 } else { 0 };
        let Some(most) = self.rules.info().fouls_in_row else {
            return false;
        };
        if *count + 1 == most {
            verdict.add_line(text!("verdict-fouls-warning", fouls = *count));
        }
        let punished = *count >= most;
        if punished {
            *count = 0;
            verdict.add_line(text!("verdict-fouls-punished", fouls = most));
        }
        punished
    }

    /// Adds points in a game that is played for points.
    pub(crate) fn add_points(&mut self, player: usize, points: i32, verdict: &mut Verdict) {
        self.scores[player] += points;
        if self.scores[player] >= self.target as i32 {
            self.winner = Some(player);
            verdict.add_line(text!("verdict-reached", points = self.scores[player]));
        }
    }

    /// Adds points of a drill, which do not end it.
    pub(crate) fn add_drill_points(&mut self, points: i32) {
        self.scores[self.turn] += points;
    }

    /// Ends a drill after its last attempt.
    pub(crate) fn end_drill(&mut self) {
        self.winner = Some(self.turn);
    }

    /// Lays the balls of a drill for the next attempt: drawn anew, or as before.
    pub(crate) fn lay_drill(&mut self, anew: bool, verdict: &mut Verdict) {
        self.seed = self.seed.wrapping_add(u32::from(anew));
        self.hand = self.info().start;
        verdict.rack = Some(self.seed);
    }

    /// Spots an object ball.
    pub(crate) fn spot(&self, shot: &JudgedShot<'_>, verdict: &mut Verdict, ball: u8, spot: DVec2) {
        let positions = apply_moves(&shot.report.after, &verdict.moves);
        let at = shot.layout.spotted(&positions, spot);
        verdict.moves.push(BallPosition { ball, at });
    }

    /// Places a cue ball that is gone, or lies outside the area in which it is in hand.
    fn put_cue_ball(
        &mut self,
        layout: &TableLayout,
        positions: &BallPositions,
        verdict: &mut Verdict,
    ) {
        if verdict.rack.is_some() || self.winner.is_some() {
            return;
        }
        let positions = apply_moves(positions, &verdict.moves);
        let cue_ball = place_of(&positions, 0);
        let area = match (self.hand, cue_ball) {
            (None, Some(_)) => return,
            (None, None) => self.info().after_loss,
            (Some(area), _) => area,
        };
        self.hand = Some(area);
        let stays = |at: &DVec2| {
            area == PlacementArea::Anywhere || layout.may_place(&positions, *at, area).is_ok()
        };
        if cue_ball.filter(stays).is_none() {
            let at = layout.place_in_hand(&positions, area);
            verdict.moves.push(BallPosition { ball: 0, at });
        }
        if self.rules != RuleSet::Free {
            verdict.add_line(text!("verdict-in-hand", area = area.display_text()));
        }
    }
}

/// The positions after `moves`.
pub fn apply_moves(positions: &[BallPosition], moves: &[BallPosition]) -> BallPositions {
    let stays = |p: &&BallPosition| !moves.iter().any(|moved| moved.ball == p.ball);
    let mut positions: BallPositions = positions.iter().filter(stays).copied().collect();
    positions.extend(moves);
    positions
}

/// The words with a small first letter.
fn uncapital(words: &str) -> String {
    let mut letters = words.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_lowercase().chain(letters).collect()
    })
}
