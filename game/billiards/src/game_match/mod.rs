//! A match: players, a table, the rules, and the history so far.
//!
//! ```text
//! MatchConfig ─► Match ── strike(Stroke) ─► Shot ──(it is watched)──► finish ─► Verdict
//!                  │  ▲                                                 │
//!                  │  └── call, place, choose, undo ◄── the player ◄────┘
//!                  └─► MatchView: everything that is shown of it
//! ```
//! It uses no window and no clock: the same configuration, strokes and choices give the same match.

mod hints;
mod history;
mod match_config;
mod match_log;
mod match_save;
mod match_view;
mod player;
mod racking;
mod ratings;
mod tournament;
mod undo;

pub use match_config::MatchConfig;
use match_save::MatchAction;
pub use match_save::MatchSave;
pub use match_view::{CallView, MatchView, OptionView, PlayerView};
pub use player::Player;
use racking::racked_world;
pub use ratings::{LevelRating, Rating, RoundRobin, RoundRobinResult};
pub use tournament::{PlayerTally, Tournament, TournamentResult, play_out};
use undo::UndoneTurn;

use glam::DVec2;

use crate::ai::Position;
use crate::physics::{self, AimContact, Engine, Shot, Stroke, World};
use crate::rules::{
    self, BallPositions, Call, Choice, PlacementArea, Referee, RuleSet, TableLayout, Verdict,
    place_of,
};
use crate::shot_report::{ball_positions, report, table_layout};
use crate::{PlacementFault, Result, RuleFault};

/// A match in progress.
#[derive(Clone, Debug)]
pub struct Match {
    layout: TableLayout,
    players: Vec<Player>,
    /// Seed of the configuration.
    seed: u32,
    now: Snapshot,
    past: Vec<TurnRecord>,
    /// Shots that were taken back, in that order.
    undone: Vec<UndoneTurn>,
    /// Number of the last of them that can be redone.
    redoable: usize,
    actions: Vec<MatchAction>,
}

/// The state that a shot or a choice may change.
#[derive(Clone, Debug)]
struct Snapshot {
    world: World,
    /// Whether ball 0 is the one that was 1 at the start.
    swapped: bool,
    referee: Referee,
    call: Option<Call>,
    log: Vec<String>,
    banner: Option<String>,
    /// Number of shots played so far, for the seeds of random draws.
    shots: u32,
}

/// A shot that was played.
#[derive(Clone, Debug)]
pub struct TurnRecord {
    before: Snapshot,
    actions_before: usize,
    /// Number among all shots that were struck, also those that were taken back.
    number: usize,
    /// Index of the player.
    pub player: usize,
    /// The stroke.
    pub stroke: Stroke,
    /// The call, made by the player or inferred from the aim.
    pub call: Option<Call>,
    /// The verdict.
    pub verdict: Verdict,
}

impl TurnRecord {
    /// The table before the stroke: simulating the stroke on it gives the same shot.
    pub fn world(&self) -> &World {
        &self.before.world
    }
}

impl Match {
    /// A match at its first break.
    ///
    /// # Errors
    /// [`RuleFault`]s for players, a target or a table that the game does not allow.
    pub fn new(config: MatchConfig) -> Result<Self> {
        let referee = Referee::new(
            config.rules,
            config.players.len(),
            config.target,
            config.seed,
        )?;
        let needs_pockets = config.rules != RuleSet::ThreeCushion;
        let is_free = config.rules == RuleSet::Free;
        if !is_free && needs_pockets == config.table.pockets().is_empty() {
            return Err(RuleFault::OtherTable {
                game: config.rules.info().name,
                table: config.table.name().to_lowercase(),
                pockets: config.table.pockets().len(),
            }
            .into());
        }
        let layout = table_layout(&config.table);
        let positions = rules::rack(config.rules, &layout, config.seed);
        let world = racked_world(&config.table, config.engine, &positions, config.seed)?;
        Ok(Self {
            layout,
            players: config.players,
            now: Snapshot {
                world,
                swapped: false,
                referee,
                call: None,
                log: Vec::new(),
                banner: None,
                shots: 0,
            },
            past: Vec::new(),
            undone: Vec::new(),
            redoable: 0,
            actions: Vec::new(),
            seed: config.seed,
        })
    }

    /// Another match of the same players, on the same table and to the same target; the other player
    /// breaks.
    ///
    /// # Errors
    /// Those of [`Match::new`], which did not occur for this match.
    pub fn rematch(&self, seed: u32) -> Result<Self> {
        let mut players = self.players.clone();
        players.rotate_left(1);
        Self::new(MatchConfig {
            rules: self.referee().rules(),
            players,
            target: self.referee().target(),
            seed,
            table: self.world().table().clone(),
            engine: self.world().engine(),
        })
    }

    /// The table.
    pub fn world(&self) -> &World {
        &self.now.world
    }

    /// Input of a computer player.
    pub fn position(&self) -> Position {
        Position {
            layout: self.layout.clone(),
            world: self.now.world.clone(),
            referee: self.now.referee.clone(),
        }
    }

    /// Seed of a computer's search and errors: different for each shot.
    pub fn draw_seed(&self) -> u32 {
        let shots = self.now.shots.wrapping_mul(SHOT_STEP);
        self.now.referee.seed().wrapping_add(shots)
    }

    /// The referee of the match.
    pub fn referee(&self) -> &Referee {
        &self.now.referee
    }

    /// The marks of the table.
    pub fn table_layout(&self) -> &TableLayout {
        &self.layout
    }

    /// The players.
    pub fn players(&self) -> &[Player] {
        &self.players
    }

    /// The player at the table; none once the match is over.
    pub fn at_table(&self) -> Option<&Player> {
        let over = self.now.referee.winner().is_some();
        (!over).then(|| &self.players[self.now.referee.turn()])
    }

    /// The shots that were played, in order.
    pub fn turns(&self) -> &[TurnRecord] {
        &self.past
    }

    /// Lines of the log, in order.
    pub fn log(&self) -> &[String] {
        &self.now.log
    }

    /// Simulates a stroke of the player at the table. The match stays as it is until
    /// [`Match::finish`].
    ///
    /// # Errors
    /// Those of [`World::strike`].
    pub fn strike(&self, stroke: Stroke) -> Result<Shot> {
        self.now.world.strike(stroke)
    }

    /// Judges a shot that [`Match::strike`] gave for this stroke, and lays the table for the next.
    pub fn finish(&mut self, stroke: Stroke, shot: &Shot) -> &Verdict {
        let before = self.now.clone();
        let actions_before = self.actions.len();
        if shot.particles().is_none() {
            self.act(MatchAction::Shot {
                place: self.cue_ball_in_hand(),
                call: self.now.call,
                stroke,
                engine: self.now.world.engine().to_string(),
            });
        } else {
            // Saves do not hold the particles before a stroke, without which it would differ: they hold
            // the final places of the balls.
            let lying = shot.final_states().into_iter();
            let lying = lying.filter(|ball| ball.phase.is_on_table());
            let places = lying.map(|ball| (ball.number, ball.position.truncate()));
            self.act(MatchAction::Layout(places.collect()));
        }
        let player = self.now.referee.turn();
        let inferred = self.now.call.is_none().then(|| self.inferred(stroke));
        let call = self.now.call.take().or(inferred.flatten());
        let report = report(&self.now.world, &stroke, shot);
        let verdict = self.now.referee.judge(&self.layout, &report, call);
        self.now.world.adopt(shot);
        self.now.shots = self.now.shots.wrapping_add(1);
        self.apply_verdict(&verdict);
        self.log_shot(player, call, &report.potted(), &verdict);
        self.past.push(TurnRecord {
            before,
            actions_before,
            number: self.past.len() + self.undone.len(),
            player,
            stroke,
            call,
            verdict,
        });
        if self.past.len() > TURNS_MAX {
            self.past.remove(0);
        }
        &self.past[self.past.len() - 1].verdict
    }

    /// Calls the next shot; none takes the call back.
    pub fn call(&mut self, call: Option<Call>) {
        self.now.call = call;
    }

    /// The call of the next shot.
    pub fn called(&self) -> Option<Call> {
        self.now.call
    }

    /// Number of actions, strokes and choices: it differs whenever the match has changed.
    pub fn action_count(&self) -> usize {
        self.actions.len()
    }

    /// Position of the cue ball if it is in hand.
    pub fn cue_ball_in_hand(&self) -> Option<DVec2> {
        self.ball_in_hand_area()?;
        place_of(&self.ball_positions(), 0)
    }

    /// The call that counts for a stroke: the one made, or the one that is obvious from the aim.
    pub fn call_for(&self, stroke: Stroke) -> Option<Call> {
        self.now.call.or_else(|| self.inferred(stroke))
    }

    fn inferred(&self, stroke: Stroke) -> Option<Call> {
        if !self.now.referee.wants_call() {
            return None;
        }
        match physics::predict(&self.now.world, stroke).ok()?.contact {
            AimContact::Ball {
                number,
                object,
                object_direction,
                ..
            } => rules::infer(
                &self.layout,
                number,
                object.truncate(),
                object_direction.truncate(),
            ),
            _ => None,
        }
    }

    /// Area in which the cue ball is in hand, if it is.
    pub fn ball_in_hand_area(&self) -> Option<PlacementArea> {
        self.now.referee.ball_in_hand_area()
    }

    /// Whether the cue ball may be put at a place.
    ///
    /// # Errors
    /// [`PlacementFault`] with the reason.
    pub fn may_place(&self, at: DVec2) -> Result<(), PlacementFault> {
        let area = self.ball_in_hand_area().ok_or(PlacementFault::NotInHand)?;
        self.layout.may_place(&self.ball_positions(), at, area)
    }

    /// Places the cue ball.
    ///
    /// # Errors
    /// As [`Match::may_place`]; it stays where it was.
    pub fn place(&mut self, at: DVec2) -> Result<()> {
        self.may_place(at)?;
        let placed = self.now.world.place(0, at.x, at.y);
        placed.map_err(|_| PlacementFault::NotOnCloth.into())
    }

    /// Makes a choice for the player at the table. A stroke without a choice plays the balls as they
    /// lie.
    ///
    /// # Errors
    /// [`RuleFault::NoSuchChoice`] if it is not offered now.
    pub fn choose(&mut self, choice: Choice) -> Result<()> {
        let player = self.now.referee.turn();
        let positions = self.ball_positions();
        let verdict = self.now.referee.choose(&self.layout, &positions, choice)?;
        self.act(MatchAction::Choice(choice));
        self.apply_verdict(&verdict);
        self.log_choice(player, &verdict);
        Ok(())
    }

    /// Concedes the match for the player at the table.
    pub fn concede(&mut self) {
        let player = self.now.referee.turn();
        let verdict = self.now.referee.concede();
        self.act(MatchAction::Concede);
        self.log_choice(player, &verdict);
    }

    /// Sets the engine from the next stroke on.
    pub fn set_engine(&mut self, engine: Engine) {
        self.now.world.set_engine(engine);
    }

    /// Adds an action, after which shots that were taken back cannot be redone.
    fn act(&mut self, action: MatchAction) {
        self.redoable = 0;
        self.actions.push(action);
    }

    /// The balls on the table.
    pub fn ball_positions(&self) -> BallPositions {
        ball_positions(&self.now.world.balls())
    }
}

/// Odd, so that the seeds of all shots differ.
const SHOT_STEP: u32 = 0x9e37_79b1;
/// Maximum number of stored shots: far more than anyone would take back.
const TURNS_MAX: usize = 2000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::{BallState, Laws, Table};
    use crate::rules::BallPosition;

    fn eight() -> Match {
        let players = Player::list("2").unwrap();
        Match::new(MatchConfig::new(RuleSet::Eight, players, 3).unwrap()).unwrap()
    }

    fn play(game: &mut Match, stroke: Stroke) -> Verdict {
        let shot = game.strike(stroke).unwrap();
        game.finish(stroke, &shot).clone()
    }

    #[test]
    fn a_break_is_judged_told_and_taken_back() {
        let mut game = eight();
        let racked_world = game.ball_positions();
        assert_eq!(
            game.view().prompt,
            "Break. Ball in hand behind the head string"
        );
        let verdict = play(&mut game, Stroke::straight(0.0, 8.0));
        assert!(!verdict.is_foul(), "{verdict:?}");
        let view = game.view();
        assert!(!game.referee().is_break() && view.undo == 1);
        assert_eq!(view.turn, usize::from(!verdict.goes_on));
        assert_ne!(game.ball_positions(), racked_world);
        assert!(game.undo() && !game.undo());
        assert_eq!((game.ball_positions(), game.view().undo), (racked_world, 0));
        assert_eq!(
            play(&mut game, Stroke::straight(0.0, 8.0)),
            verdict,
            "the same again"
        );
    }

    #[test]
    fn hitting_no_ball_gives_ball_in_hand() {
        let mut game = eight();
        play(&mut game, Stroke::straight(0.0, 8.0));
        game.now
            .referee
            .choose(&game.layout, &game.ball_positions(), Choice::Accept)
            .ok();
        let turn = game.referee().turn();
        let verdict = play(&mut game, Stroke::straight(1.0, 0.05));
        assert!(
            verdict.lines[0].starts_with("fouled: the cue ball touched no ball"),
            "{verdict:?}"
        );
        assert_eq!(game.referee().turn(), 1 - turn);
        let view = game.view();
        assert!(
            view.is_foul
                && view
                    .banner
                    .is_some_and(|banner| banner.contains(" fouled: "))
        );
        assert_eq!(view.hand, Some(PlacementArea::Anywhere));
        assert!(game.place(DVec2::new(5.0, 0.0)).is_err());
        let taken = game
            .ball_positions()
            .iter()
            .find(|p| p.ball != 0)
            .unwrap()
            .at;
        assert!(game.place(taken).unwrap_err().to_string().contains("touch"));
        let free = game
            .table_layout()
            .place_in_hand(&game.ball_positions(), PlacementArea::Anywhere);
        game.place(free).unwrap();
        assert!(
            game.ball_positions()
                .contains(&BallPosition { ball: 0, at: free })
        );
    }

    #[test]
    fn an_obvious_pot_is_called_by_its_aim() {
        let mut game = eight();
        play(&mut game, Stroke::straight(0.0, 8.0));
        let world = &mut game.now.world;
        let lying: Vec<u8> = world.balls().iter().map(|ball| ball.number).collect();
        // One ball before the left foot corner, the cue ball in line, the others out of the way.
        let world_lie = [(0, 0.6, -0.035), (lying[0].max(1), 1.0, 0.365)];
        let table = world.table().clone();
        let body = table.ball();
        let balls = world_lie.map(|(n, x, y)| BallState::at_rest(n, x, y, &body));
        *world = World::with_laws(table, Laws::default(), balls.to_vec()).unwrap();
        let stroke = Stroke::straight(45f64.to_radians(), 2.0);
        let Some(Call::Pot {
            pocket: Some(pocket),
            ..
        }) = game.call_for(stroke)
        else {
            panic!("nothing is obvious");
        };
        assert_eq!(
            game.table_layout().pocket_name(pocket),
            "the left foot corner"
        );
        assert!(play(&mut game, stroke).goes_on);
    }

    #[test]
    fn a_game_with_pockets_is_refused_on_a_table_without() {
        let mut config = MatchConfig::new(RuleSet::Eight, Player::list("2").unwrap(), 1).unwrap();
        config.table = Table::built_in("carom").unwrap();
        assert!(
            Match::new(config)
                .unwrap_err()
                .to_string()
                .contains("pockets")
        );
        let three = vec![Player::Human("a".into()); 3];
        assert!(Match::new(MatchConfig::new(RuleSet::Eight, three, 1).unwrap()).is_err());
    }
}
