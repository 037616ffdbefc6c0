//! The computer player's search on a thread of its own, so that the window never waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use crate::{Error, Result};

use super::{
    Position,
    search::{Decision, think},
    skill::Skill,
};

/// A running search on a thread of its own. Dropped, it stops within a simulated shot.
#[derive(Debug)]
pub struct AiWorker {
    decision: Receiver<Decision>,
    stop: Arc<AtomicBool>,
}

impl AiWorker {
    /// Starts the search.
    ///
    /// # Errors
    /// [`Error::NoThread`] if the system cannot start a thread.
    pub fn start(position: Position, skill: Skill, seed: u32) -> Result<Self> {
        let (sender, decision) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let run = move || {
            // Sending fails only if the receiver was dropped and nobody waits any more.
            let _ = sender.send(think(&position, &skill, seed, &stopped));
        };
        thread::Builder::new()
            .name("computer-player".to_owned())
            .spawn(run)
            .map_err(Error::NoThread)?;
        Ok(Self { decision, stop })
    }

    /// The decision, once it is made.
    ///
    /// # Errors
    /// [`Error::SearchBrokeOff`] if the thread ended without one.
    pub fn poll(&self) -> Result<Option<Decision>> {
        match self.decision.try_recv() {
            Ok(decision) => Ok(Some(decision)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(Error::SearchBrokeOff),
        }
    }

    /// Ends the search with the best decision found so far.
    pub fn finish_now(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

impl Drop for AiWorker {
    fn drop(&mut self) {
        self.finish_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ai::Level;
    use crate::game_match::{Match, MatchConfig, Player};
    use crate::rules::RuleSet;

    #[test]
    fn thinking_aside_decides_the_same_and_can_be_hurried() {
        let players = Player::list("ai:easy,ai:easy").unwrap();
        let game = Match::new(MatchConfig::new(RuleSet::Nine, players, 2).unwrap()).unwrap();
        let skill = Skill::from(Level::Easy);
        let here = think(&game.position(), &skill, 7, &AtomicBool::new(false));
        assert!(here.simulated > 0 && here.simulated <= skill.shots);
        let aside = AiWorker::start(game.position(), skill, 7).unwrap();
        assert_eq!(aside.decision.recv().unwrap(), here);
        assert!(aside.decision.recv().is_err(), "it decides once");

        let endless = Skill {
            shots: u32::MAX,
            ..skill
        };
        let aside = AiWorker::start(game.position(), endless, 7).unwrap();
        aside.finish_now();
        assert!(aside.decision.recv().unwrap().simulated < u32::MAX);
    }
}
