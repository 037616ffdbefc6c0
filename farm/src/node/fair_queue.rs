//! Fair queueing of a device's time: of the waiting players, the one that has used the least is served
//! next, a slice at a time (start-time fair queueing, Goyal et al. 1996).
//!
//! A new or returning player starts with the used time of the player served last: unused time is not saved
//! up.

use std::collections::VecDeque;

/// Identity of a player: the hash of its certificate's key identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PlayerId([u8; 32]);

impl PlayerId {
    /// The player of this process.
    pub(crate) const LOCAL: Self = Self([0; 32]);

    /// The player whose key has this identifier.
    pub fn of_key(key_id: &[u8]) -> Self {
        Self(*blake3::hash(key_id).as_bytes())
    }
}

/// Waiting jobs by player.
#[derive(Debug)]
pub struct FairQueue<J> {
    shares: Vec<Share<J>>,
    /// Virtual time: the used device seconds of the player served last.
    served_secs: f64,
}

/// State of a player in a [`FairQueue`].
#[derive(Debug)]
struct Share<J> {
    player: PlayerId,
    /// Used device seconds, in virtual time.
    used_secs: f64,
    jobs: VecDeque<J>,
}

impl<J> FairQueue<J> {
    /// An empty queue.
    pub const fn new() -> Self {
        let shares = Vec::new();
        Self {
            shares,
            served_secs: 0.0,
        }
    }

    /// The jobs of a player, the next one first; for adding a job.
    pub fn jobs_mut(&mut self, player: PlayerId) -> &mut VecDeque<J> {
        let (position, served_secs) = (self.position(player), self.served_secs);
        let index = position.unwrap_or_else(|| {
            self.shares.push(Share {
                player,
                used_secs: served_secs,
                jobs: VecDeque::new(),
            });
            self.shares.len() - 1
        });
        let share = &mut self.shares[index];
        if share.jobs.is_empty() {
            // A returning player starts level with the one served last: unused time is not saved up.
            share.used_secs = share.used_secs.max(served_secs);
        }
        &mut share.jobs
    }

    /// The jobs, at least one, of the player to serve next.
    pub fn next_mut(&mut self) -> Option<&mut VecDeque<J>> {
        let waiting = self
            .shares
            .iter_mut()
            .filter(|share| !share.jobs.is_empty());
        let next = waiting.min_by(|a, b| a.used_secs.total_cmp(&b.used_secs))?;
        // The virtual time of start-time fair queueing: the start tag of the slice in service.
        self.served_secs = next.used_secs;
        Some(&mut next.jobs)
    }

    /// Adds to the used time of a player.
    pub fn charge(&mut self, player: PlayerId, secs: f64) {
        let served_secs = self.served_secs;
        match self.position(player) {
            Some(index) => self.shares[index].used_secs += secs,
            None => self.shares.push(Share {
                player,
                used_secs: served_secs + secs,
                jobs: VecDeque::new(),
            }),
        }
        // Only idle players behind the virtual time are dropped: one that is ahead would shed its debt by
        // leaving and returning.
        let is_owed = |share: &Share<J>| share.used_secs <= served_secs;
        self.shares
            .retain(|share| !(share.jobs.is_empty() && is_owed(share)));
    }

    /// Keeps only the jobs that are `wanted`.
    pub fn retain(&mut self, wanted: impl Fn(&J) -> bool) {
        for share in &mut self.shares {
            share.jobs.retain(&wanted);
        }
    }

    /// The players with waiting jobs.
    pub fn waiting(&self) -> impl Iterator<Item = PlayerId> {
        let waiting = self.shares.iter().filter(|share| !share.jobs.is_empty());
        waiting.map(|share| share.player)
    }

    /// Whether other players have waiting jobs.
    pub fn others_wait(&self, player: PlayerId) -> bool {
        self.waiting().any(|waiting| waiting != player)
    }

    fn position(&self, player: PlayerId) -> Option<usize> {
        self.shares.iter().position(|share| share.player == player)
    }
}

impl<J> Default for FairQueue<J> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn player(number: usize) -> PlayerId {
        PlayerId::of_key(&number.to_le_bytes())
    }

    #[test]
    fn device_time_is_shared_whatever_a_slice_takes() {
        let secs = [0.05, 0.001, 9.0, 0.02];
        let (mut queue, mut times) = (FairQueue::new(), [0.0; 4]);
        for one in 0..secs.len() {
            queue.jobs_mut(player(one)).push_back(one);
        }
        for _ in 0..40_000 {
            let one = queue.next_mut().and_then(VecDeque::pop_front).unwrap();
            queue.jobs_mut(player(one)).push_back(one);
            queue.charge(player(one), secs[one]);
            times[one] += secs[one];
            let most = times.iter().copied().fold(0.0, f64::max);
            let least = times.iter().copied().fold(f64::MAX, f64::min);
            // Nobody is more than a slice of the greediest behind.
            assert!(most - least <= 9.001, "{times:?}");
        }
    }

    #[test]
    fn a_pause_saves_no_time_up() {
        let mut queue = FairQueue::new();
        for _ in 0..100 {
            let jobs = queue.jobs_mut(player(0));
            jobs.push_back(0);
            queue.next_mut().unwrap().pop_front();
            queue.charge(player(0), 0.05);
        }
        let mut order = Vec::new();
        queue.jobs_mut(player(0)).extend([0; 10]);
        queue.jobs_mut(player(1)).extend([1; 10]);
        for _ in 0..20 {
            let one = queue.next_mut().and_then(VecDeque::pop_front).unwrap();
            queue.charge(player(one), 0.05);
            order.push(one);
        }
        let early: usize = order[..10].iter().sum();
        assert!((4..=6).contains(&early), "{order:?}");
    }
}
