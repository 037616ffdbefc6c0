//! Load of a device: the time that each player has recently used.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use carom_protocol::NodeLoad;

use super::fair_queue::PlayerId;

/// The turns of the last [`PERIOD`].
#[derive(Debug, Default)]
pub(super) struct LoadMeter {
    turns: VecDeque<PastTurn>,
}

#[derive(Debug)]
struct PastTurn {
    player: PlayerId,
    ended: Instant,
    took: Duration,
}

impl LoadMeter {
    /// Records that a player has used the device for `took`.
    pub(super) fn note(&mut self, now: Instant, player: PlayerId, took: Duration) {
        self.turns.push_back(PastTurn {
            player,
            ended: now,
            took,
        });
        let is_past = |turn: &PastTurn| now.saturating_duration_since(turn.ended) > PERIOD;
        while self.turns.len() > TURNS_MAX || self.turns.front().is_some_and(is_past) {
            self.turns.pop_front();
        }
    }

    /// The use by players other than `player`; `waiting` are the players with work in the queue or in
    /// progress.
    pub(super) fn load(
        &self,
        now: Instant,
        player: PlayerId,
        waiting: impl Iterator<Item = PlayerId>,
    ) -> NodeLoad {
        let since = now.checked_sub(PERIOD);
        let of_others = self.turns.iter().filter(|turn| turn.player != player);
        let recent = of_others.filter(|turn| since.is_none_or(|since| turn.ended >= since));
        let (mut busy, mut players) = (Duration::ZERO, Vec::new());
        for turn in recent {
            let inside = since.map_or(turn.took, |since| turn.ended - since);
            busy += turn.took.min(inside);
            players.push(turn.player);
        }
        players.extend(waiting.filter(|other| *other != player));
        players.sort_unstable();
        players.dedup();
        let percent = 100.0 * busy.as_secs_f64() / PERIOD.as_secs_f64();
        NodeLoad {
            players: u16::try_from(players.len()).unwrap_or(u16::MAX),
            busy_percent: percent.min(100.0).round() as u8,
        }
    }
}

/// Averaging window.
const PERIOD: Duration = Duration::from_secs(1);
/// Maximum number of turns kept; beyond it the oldest are dropped, and the load is underestimated.
const TURNS_MAX: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    fn load(meter: &LoadMeter, now: Instant, player: PlayerId) -> (u16, u8) {
        let NodeLoad {
            players,
            busy_percent,
        } = meter.load(now, player, std::iter::empty());
        (players, busy_percent)
    }

    #[test]
    fn a_player_is_told_what_others_have_had_in_the_last_second() {
        let [me, you, they] = [1, 2, 3].map(|number: u8| PlayerId::of_key(&[number]));
        let begin = Instant::now();
        let at = |millis| begin + Duration::from_millis(millis);
        let mut meter = LoadMeter::default();
        for slice in 1..=40 {
            let player = if slice % 2 == 0 { me } else { you };
            meter.note(at(50 * slice), player, Duration::from_millis(50));
        }
        assert_eq!(load(&meter, at(2000), me), (1, 50));
        assert_eq!(load(&meter, at(2000), they), (2, 100));
        assert_eq!(load(&meter, at(2500), they), (2, 50));
        assert_eq!(load(&meter, at(3100), they), (0, 0));
        let waiting = [they, me, they].into_iter();
        assert_eq!(meter.load(at(3100), me, waiting).players, 1);
    }
}
