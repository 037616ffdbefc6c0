//! Quota of device time: how much of a node a player may use per hour, even where no other player wants it.

use std::time::Instant;

use super::fair_queue::PlayerId;
use crate::token_bucket::TokenBucket;

/// A token bucket of device seconds per player: it holds the quota of an hour, and fills in an hour.
#[derive(Debug)]
pub(super) struct DeviceQuota {
    secs_per_hour: f64,
    /// Buckets of the players whose bucket was not full at the last charge.
    buckets: Vec<(PlayerId, TokenBucket)>,
}

impl DeviceQuota {
    /// A quota with full buckets for all players.
    pub(super) const fn new(secs_per_hour: f64) -> Self {
        Self {
            secs_per_hour,
            buckets: Vec::new(),
        }
    }

    /// Charges a player with used device time.
    pub(super) fn charge(&mut self, now: Instant, player: PlayerId, secs: f64) {
        self.buckets.retain_mut(|(_, bucket)| !bucket.is_full(now));
        if let Some(bucket) = self.bucket(player) {
            bucket.take(now, secs);
            return;
        }
        let mut bucket = TokenBucket::new(now, self.secs_per_hour, self.per_sec());
        bucket.take(now, secs);
        self.buckets.push((player, bucket));
    }

    /// The explanation for a player whose quota is used up, else `None`.
    pub(super) fn refusal(&mut self, now: Instant, player: PlayerId) -> Option<String> {
        let pause = self.bucket(player)?.take(now, 0.0);
        // Plus the time in which one device second accrues, so that a player who returns then is not
        // refused at once.
        let pause_secs = pause.as_secs_f64() + 1.0 / self.per_sec();
        let all_secs = self.secs_per_hour;
        (!pause.is_zero()).then(|| {
            format!(
                "this node gives each player {all_secs} s of its device an hour, and you have had yours: ask \
                 again in {pause_secs:.0} s, or ask its operator for more (`carom-farm node --player-seconds`)"
            )
        })
    }

    fn bucket(&mut self, player: PlayerId) -> Option<&mut TokenBucket> {
        let mut buckets = self.buckets.iter_mut();
        buckets.find_map(|(of, bucket)| (*of == player).then_some(bucket))
    }

    fn per_sec(&self) -> f64 {
        self.secs_per_hour / HOUR_SECS
    }
}

const HOUR_SECS: f64 = 3600.0;

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_player_has_its_seconds_each_hour_and_no_more() {
        let [near, far] = [1, 2].map(|number: u8| PlayerId::of_key(&[number]));
        let mut now = Instant::now();
        let mut quota = DeviceQuota::new(60.0);
        let mut had_secs = 0.0;
        // A hungry player, for three hours.
        for _ in 0..3 * 3600 {
            now += Duration::from_secs(1);
            if quota.refusal(now, near).is_none() {
                quota.charge(now, near, 0.05);
                had_secs += 0.05;
            }
        }
        assert!((239.0..241.0).contains(&had_secs), "{had_secs}");
        quota.charge(now, near, 2.0);
        let why = quota.refusal(now, near).expect("it has had all");
        assert!(why.contains("60 s of its device"), "{why}");
        assert_eq!(quota.refusal(now, far), None, "others are not concerned");
        now += Duration::from_secs(240);
        assert_eq!(quota.refusal(now, near), None);
    }

    #[test]
    fn players_with_full_buckets_are_forgotten() {
        let mut now = Instant::now();
        let mut quota = DeviceQuota::new(60.0);
        for number in 0..1000_u32 {
            now += Duration::from_secs(3600);
            quota.charge(now, PlayerId::of_key(&number.to_le_bytes()), 60.0);
            assert_eq!(quota.buckets.len(), 1);
        }
    }
}
