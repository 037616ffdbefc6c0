//! Places of a node: the players that it serves, and the line of those that wait.
//!
//! A player is identified by its certificate's key. Its connections share one place and one
//! [`PlayerAccount`], so that more connections gain nothing. A player that is turned away keeps its place in
//! the line by connecting again, as every link does. When all places are taken, a player that has been idle
//! for a while yields its place to the first in the line.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tokio::sync::watch;

use crate::lock::lock;
use crate::net::peer::NoPlace;
use crate::net::player_account::PlayerAccount;
use crate::node::PlayerId;

/// Players that a node serves at once: a hundred persons may share a farm, and each connects to all of its
/// nodes. Their shares of the device are equal; `crowds_fit_into_a_node` prints what they take.
const PLAYERS_MAX: usize = 128;
/// Connections of one player: a game, a crashed one that has not timed out, a render or two.
const CONNECTIONS_MAX: usize = 4;
/// Players in the line.
const LINE_MAX: usize = 64;
/// Time without a call after which a player leaves the line: links call every five seconds.
const ABSENCE_MAX: Duration = Duration::from_secs(12);
/// Time without tiles after which a player yields its place if another waits.
const IDLE_MAX: Duration = Duration::from_secs(60);
/// Accounts kept, also of players that have left, so that they get no new budget by connecting again.
const ACCOUNTS_MAX: usize = 4 * PLAYERS_MAX;

/// Assignment of places to players, and the line.
#[derive(Debug, Default)]
struct Seating {
    served: BTreeMap<PlayerId, Seat>,
    line: VecDeque<(PlayerId, Instant)>,
    accounts: BTreeMap<PlayerId, Arc<PlayerAccount>>,
}

/// Place of a player, shared by its connections.
#[derive(Debug)]
struct Seat {
    connections: usize,
    /// Whether the place has been given to another player.
    yields: watch::Sender<bool>,
}

impl Seating {
    fn enter(&mut self, now: Instant, player: PlayerId) -> Result<watch::Receiver<bool>, NoPlace> {
        if let Some(seat) = self.served.get_mut(&player) {
            if seat.connections >= CONNECTIONS_MAX {
                return Err(NoPlace::Connections {
                    max: CONNECTIONS_MAX,
                });
            }
            seat.connections += 1;
            return Ok(seat.yields.subscribe());
        }
        let ahead = self.place_in_line(now, player)?;
        if ahead == 0 && self.served.len() >= PLAYERS_MAX {
            self.vacate(now);
        }
        // As many players from the front of the line may enter as there are free places, in whatever order
        // they call.
        if ahead >= PLAYERS_MAX.saturating_sub(self.served.len()) {
            // Being turned away counts as a call, which keeps the place in the line.
            self.line[ahead].1 = now;
            let players = self.served.len();
            return Err(NoPlace::Full { players, ahead });
        }
        self.line.remove(ahead);
        let (yields, yielded) = watch::channel(false);
        let connections = 1;
        self.served.insert(
            player,
            Seat {
                connections,
                yields,
            },
        );
        Ok(yielded)
    }

    /// The number of players in the line before this one, which is appended if it was not in it.
    fn place_in_line(&mut self, now: Instant, player: PlayerId) -> Result<usize, NoPlace> {
        self.line
            .retain(|(_, called)| now.saturating_duration_since(*called) < ABSENCE_MAX);
        let ahead = self.line.iter().position(|(waiting, _)| *waiting == player);
        match ahead {
            Some(ahead) => Ok(ahead),
            None if self.line.len() >= LINE_MAX => Err(NoPlace::LineFull { waiting: LINE_MAX }),
            None => {
                self.line.push_back((player, now));
                Ok(self.line.len() - 1)
            }
        }
    }

    /// Withdraws the place of the player that has been idle for longest, if it has been idle for long enough.
    fn vacate(&mut self, now: Instant) {
        let idle = |player: &&PlayerId| self.accounts.get(player).map(|account| account.idle(now));
        let idlest = self.served.keys().max_by_key(idle).copied();
        let idlest = idlest.filter(|player| idle(&player).is_some_and(|idle| idle >= IDLE_MAX));
        if let Some(seat) = idlest.and_then(|player| self.served.remove(&player)) {
            seat.yields.send_replace(true);
        }
    }

    /// The account of a player, which is kept for a while after it leaves.
    fn account(&mut self, now: Instant, player: PlayerId) -> Arc<PlayerAccount> {
        if self.accounts.len() >= ACCOUNTS_MAX {
            let served = &self.served;
            self.accounts
                .retain(|player, _| served.contains_key(player));
        }
        let new = || Arc::new(PlayerAccount::new(now));
        Arc::clone(self.accounts.entry(player).or_insert_with(new))
    }

    fn leave(&mut self, player: PlayerId, yielded: &watch::Receiver<bool>) {
        let seat = self.served.get_mut(&player);
        // The player may have another seat by now, if it had to yield the one that it leaves.
        if let Some(seat) = seat.filter(|seat| seat.yields.subscribe().same_channel(yielded)) {
            seat.connections -= 1;
            if seat.connections == 0 {
                self.served.remove(&player);
            }
        }
    }
}

/// Places of one node, shared by its tasks.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places(Arc<Mutex<Seating>>);

/// Place held by a connection until it is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) player: PlayerId,
    pub(crate) account: Arc<PlayerAccount>,
    yielded: watch::Receiver<bool>,
    places: Places,
}

impl Places {
    pub(crate) fn enter(&self, now: Instant, player: PlayerId) -> Result<Place, NoPlace> {
        let mut seating = lock(&self.0);
        let known = seating.accounts.get(&player);
        let pause = known.map_or(Duration::ZERO, |account| account.path_probes_pause(now));
        if !pause.is_zero() {
            let secs = pause.as_secs().max(1);
            return Err(NoPlace::Moves { secs });
        }
        let yielded = seating.enter(now, player)?;
        let account = seating.account(now, player);
        account.work(now);
        Ok(Place {
            player,
            account,
            yielded,
            places: self.clone(),
        })
    }
}

impl Place {
    /// Completes once the place goes to another player.
    pub(crate) async fn yielded(&self) {
        let mut yielded = self.yielded.clone();
        if yielded.wait_for(|yielded| *yielded).await.is_err() {
            std::future::pending().await // the seat is gone with its last connection
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.places.0).leave(self.player, &self.yielded);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn player(number: usize) -> PlayerId {
        PlayerId::of_key(&number.to_le_bytes())
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
        assert_eq!(enter(209).unwrap_err(), NoPlace::Full { players, ahead: 0 });
        drop((mine, others));
        enter(209).unwrap();
    }

    #[test]
    fn players_in_line_are_let_in_by_turns() {
        let (places, start) = (Places::default(), Instant::now());
        let enter = |secs, number| places.enter(start + Duration::from_secs(secs), player(number));
        let mut served: Vec<Place> = (0..PLAYERS_MAX).map(|one| enter(0, one).unwrap()).collect();
        for (number, ahead) in [(210, 0), (211, 1), (212, 2), (211, 1)] {
            let players = PLAYERS_MAX;
            let refusal = enter(1, number).unwrap_err();
            assert_eq!(refusal, NoPlace::Full { players, ahead });
        }
        served.pop();
        // The place is kept for the first in line as long as it keeps calling.
        assert!(enter(2, 211).is_err());
        let first = enter(3, 210).unwrap();
        assert!(enter(4, 211).is_err());
        drop(first);
        // The second has stopped calling.
        assert!(enter(6, 212).is_err());
        assert!(enter(17, 212).is_ok());
    }
    #[test]
    fn a_player_that_asks_for_nothing_yields_its_place_to_one_that_waits() {
        let (places, start) = (Places::default(), Instant::now());
        let enter = |secs, number| places.enter(start + Duration::from_secs(secs), player(number));
        let served: Vec<Place> = (0..PLAYERS_MAX).map(|one| enter(0, one).unwrap()).collect();
        let yields = || served.iter().map(|place| *place.yielded.borrow());
        served[1..]
            .iter()
            .for_each(|place| place.account.work(start + IDLE_MAX));
        assert!(enter(1, 200).is_err() && enter(59, 200).is_err());
        assert!(!yields().any(|yields| yields));
        let newcomer = enter(60, 200).unwrap();
        assert!(yields().eq((0..PLAYERS_MAX).map(|one| one == 0)));
        // All other players have been active since.
        assert!(enter(61, 0).is_err());
        // A player that leaves a place it had yielded must not release its new one.
        drop(newcomer);
        let again = enter(62, 0).unwrap();
        drop(served);
        let max = CONNECTIONS_MAX;
        let more: Vec<Place> = (1..max).map(|_| enter(63, 0).unwrap()).collect();
        assert_eq!(enter(64, 0).unwrap_err(), NoPlace::Connections { max });
        drop((again, more));
    }

    #[test]
    fn a_player_whose_address_changes_too_often_is_turned_away_for_a_minute() {
        let (places, start) = (Places::default(), Instant::now());
        let place = places.enter(start, player(0)).unwrap();
        assert!(!place.account.spend_path_probes(start, 10_000));
        drop(place);
        let refusal = places.enter(start, player(0)).unwrap_err();
        assert_eq!(refusal, NoPlace::Moves { secs: 60 });
        places.enter(start, player(1)).unwrap();
        places
            .enter(start + Duration::from_secs(61), player(0))
            .unwrap();
    }

    #[test]
    fn a_player_gets_no_new_account_by_calling_again() {
        let (places, now) = (Places::default(), Instant::now());
        let spend = |place: &Place| place.account.spend_bytes(now, 300 << 20);
        let first = places.enter(now, player(0)).unwrap();
        let second = places.enter(now, player(0)).unwrap();
        assert!(spend(&first) < spend(&second));
        drop((first, second));
        assert!(spend(&places.enter(now, player(0)).unwrap()) > Duration::from_secs(60));
        let other = places.enter(now, player(1)).unwrap();
        assert_eq!(other.account.spend_bytes(now, 1 << 20), Duration::ZERO);
    }
}
