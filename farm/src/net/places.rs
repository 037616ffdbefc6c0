//! Places of a node: the players that it serves, and the line of those that wait.
//!
//! A player is a certificate's key. Its connections share one place, so that nobody can take all of
//! them; who is turned away keeps a place in line by calling again, as every link does.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::net::peer::NoPlace;
use crate::node::PlayerId;

/// Players that a node serves at once. They share the device; more would make it slow for all.
const PLAYERS_MAX: usize = 4;
/// Connections of one player: a game, one that has crashed and not timed out, a render or two.
const CONNECTIONS_MAX: usize = 4;
/// Players in line.
const LINE_MAX: usize = 64;
/// A player that has not called for this long leaves the line: links call every five seconds.
const ABSENCE_MAX: Duration = Duration::from_secs(12);

/// Who is served, and who waits.
#[derive(Debug, Default)]
struct Seating {
    /// Connections of each player.
    served: BTreeMap<PlayerId, usize>,
    line: VecDeque<(PlayerId, Instant)>,
}

impl Seating {
    fn enter(&mut self, now: Instant, player: PlayerId) -> Result<(), NoPlace> {
        if let Some(connections) = self.served.get_mut(&player) {
            if *connections >= CONNECTIONS_MAX {
                return Err(NoPlace::Connections {
                    max: CONNECTIONS_MAX,
                });
            }
            *connections += 1;
            return Ok(());
        }
        self.line
            .retain(|(_, called)| now.saturating_duration_since(*called) < ABSENCE_MAX);
        let ahead = self.line.iter().position(|(waiting, _)| *waiting == player);
        let ahead = match ahead {
            Some(ahead) => ahead,
            None if self.line.len() >= LINE_MAX => {
                return Err(NoPlace::LineFull { waiting: LINE_MAX });
            }
            None => {
                self.line.push_back((player, now));
                self.line.len() - 1
            }
        };
        if ahead >= PLAYERS_MAX - self.served.len() {
            self.line[ahead].1 = now;
            let players = self.served.len();
            return Err(NoPlace::Full { players, ahead });
        }
        self.line.remove(ahead);
        self.served.insert(player, 1);
        Ok(())
    }

    fn leave(&mut self, player: PlayerId) {
        if let Some(connections) = self.served.get_mut(&player) {
            *connections -= 1;
            if *connections == 0 {
                self.served.remove(&player);
            }
        }
    }
}

/// The places of one node.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places(Arc<Mutex<Seating>>);

/// A place, held by a connection until it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) player: PlayerId,
    places: Places,
}

impl Places {
    pub(crate) fn enter(&self, now: Instant, player: PlayerId) -> Result<Place, NoPlace> {
        let mut seating = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        seating.enter(now, player)?;
        let places = self.clone();
        Ok(Place { player, places })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut seating = self.places.0.lock().unwrap_or_else(PoisonError::into_inner);
        seating.leave(self.player);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn player(number: usize) -> PlayerId {
        PlayerId::of_key(&[number as u8])
    }

    #[test]
    fn one_player_takes_one_place() {
        let (places, now) = (Places::default(), Instant::now());
        let enter = |number| places.enter(now, player(number));
        let mine: Vec<Place> = (0..CONNECTIONS_MAX).map(|_| enter(0).unwrap()).collect();
        let max = CONNECTIONS_MAX;
        assert_eq!(enter(0).unwrap_err(), NoPlace::Connections { max });
        let others: Vec<Place> = (1..PLAYERS_MAX)
            .map(|other| enter(other).unwrap())
            .collect();
        let players = PLAYERS_MAX;
        assert_eq!(enter(9).unwrap_err(), NoPlace::Full { players, ahead: 0 });
        drop((mine, others));
        enter(9).unwrap();
    }

    #[test]
    fn players_in_line_are_let_in_by_turns() {
        let (places, start) = (Places::default(), Instant::now());
        let enter = |secs, number| places.enter(start + Duration::from_secs(secs), player(number));
        let mut served: Vec<Place> = (0..PLAYERS_MAX).map(|one| enter(0, one).unwrap()).collect();
        for (number, ahead) in [(10, 0), (11, 1), (12, 2), (11, 1)] {
            let players = PLAYERS_MAX;
            let refusal = enter(1, number).unwrap_err();
            assert_eq!(refusal, NoPlace::Full { players, ahead });
        }
        served.pop();
        // The place is kept for the first in line while it calls.
        assert!(enter(2, 11).is_err());
        let first = enter(3, 10).unwrap();
        assert!(enter(4, 11).is_err());
        drop(first);
        // The second has given up.
        assert!(enter(6, 12).is_err());
        assert!(enter(17, 12).is_ok());
    }
}
