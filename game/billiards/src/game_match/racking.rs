//! Racking: fresh racks, spotted balls, and the exchange of the cue balls in carom.

use std::collections::HashSet;
use std::sync::Arc;

use carom_text::text;

use super::{Match, MatchAction};
use crate::physics::{BallState, Engine, Laws, ParticleBed, Table, World};
use crate::rng::CounterRng;
use crate::rules::{self, BallPosition, BallPositions, RuleSet, Verdict};
use crate::{Result, RuleFault};

impl Match {
    /// Lays the balls of a free table, with particles or without any.
    ///
    /// # Errors
    /// [`crate::Error::Layout`] if they cannot lie like this, [`RuleFault::NotFreeTable`] in a game with
    /// rules: it stays as it was.
    pub fn arrange(
        &mut self,
        balls: &[BallState],
        particles: Option<Arc<ParticleBed>>,
    ) -> Result<()> {
        if self.now.referee.rules() != RuleSet::Free {
            return Err(RuleFault::NotFreeTable.into());
        }
        let world = &self.now.world;
        let mut arranged = world.with_balls(balls.to_vec())?;
        arranged.set_particles(particles);
        let places = balls
            .iter()
            .map(|ball| (ball.number, ball.position.truncate()));
        self.act(MatchAction::Layout(places.collect()));
        self.now.world = arranged;
        self.now.referee.end_break();
        Ok(())
    }

    /// Carries out a verdict's racks and moves of balls.
    pub(super) fn apply_verdict(&mut self, verdict: &Verdict) {
        if let Some(seed) = verdict.rack {
            let rules = self.now.referee.rules();
            let positions = rules::rack(rules, &self.layout, seed);
            let (table, engine) = (self.now.world.table().clone(), self.now.world.engine());
            match racked_world(&table, engine, &positions, seed) {
                Ok(world) => self.now.world = world,
                Err(error) => self.now.log.push(error.to_string()),
            }
        }
        self.place_balls(verdict);
        if verdict.swaps_cue_balls {
            self.swap_cue_balls();
        }
    }

    fn place_balls(&mut self, verdict: &Verdict) {
        // A ball may be placed where another has yet to leave: tried again until no more can move.
        let mut left: Vec<BallPosition> = verdict.moves.clone();
        for _ in 0..=verdict.moves.len() {
            let world = &mut self.now.world;
            left.retain(|p| world.place(p.ball, p.at.x, p.at.y).is_err());
        }
        for p in left {
            let name = self.now.referee.rules().ball_name(p.ball);
            self.now.log.push(text!("verdict-no-room", ball = name));
        }
    }

    /// Exchanges balls 0 and 1: in carom the cue ball of the player at the table is 0.
    fn swap_cue_balls(&mut self) {
        let world = &self.now.world;
        let mut balls = world.balls();
        for ball in &mut balls {
            ball.number = match ball.number {
                0 => 1,
                1 => 0,
                other => other,
            };
        }
        match world.with_balls(balls) {
            Ok(swapped) => {
                self.now.world = swapped;
                self.now.swapped = !self.now.swapped;
            }
            Err(error) => self.now.log.push(error.to_string()),
        }
    }
}

/// A table with these balls at rest, in random orientations.
pub(super) fn racked_world(
    table: &Table,
    engine: Engine,
    positions: &BallPositions,
    seed: u32,
) -> Result<World> {
    let mut rng = CounterRng::new(seed, TURNED);
    let mut seen = HashSet::new();
    let balls = positions.iter().filter(|p| seen.insert(p.ball));
    let balls = balls.map(|p| BallState {
        orientation: rng.rotation(),
        ..table.resting_ball(p.ball, p.at)
    });
    let mut world = World::with_laws(table.clone(), Laws::of(table), balls.collect())?;
    world.set_engine(engine);
    Ok(world)
}

/// Random stream of the balls' orientations, apart from other draws with the same seed.
const TURNED: u32 = 0x7475_726e;
