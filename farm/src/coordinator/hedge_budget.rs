//! Budget of duplicate work: token buckets that frames fill and hedges empty.

/// Work that may be requested although another node already has it. Tiles taken over from lost nodes do not
/// count.
#[derive(Debug, Default)]
pub(super) struct HedgeBudget {
    usual: TokenBucket,
    /// For gravely late tiles: a node rarely becomes slow, but then much of a frame has to be traced again.
    reserve: TokenBucket,
}

#[derive(Debug, Default)]
struct TokenBucket {
    work: f64,
    most: f64,
}

impl HedgeBudget {
    /// Adds the share of a frame of `work`. The budget is full at the start.
    pub(super) fn add_frame(&mut self, work: f64) {
        self.usual.fill(SHARE * work, FRAMES_MAX * work);
        self.reserve
            .fill(RESERVE_SHARE * work, RESERVE_FRAMES_MAX * work);
    }

    /// Spends the work of a duplicated tile, of the reserve first if it is gravely late.
    pub(super) fn spend(&mut self, work: f64, is_grave: bool) {
        // What the reserve does not cover comes from the usual bucket, which may go negative.
        let reserved = if is_grave {
            work.min(self.reserve.work)
        } else {
            0.0
        };
        self.reserve.work -= reserved;
        self.usual.work -= work - reserved;
    }

    /// Work left, with the reserve if the tile is gravely late.
    pub(super) fn work(&self, is_grave: bool) -> f64 {
        self.usual.work + if is_grave { self.reserve.work } else { 0.0 }
    }

    /// Fill level of the usual bucket, from 0 to 1.
    pub(super) fn fullness(&self) -> f64 {
        if self.usual.most > 0.0 {
            (self.usual.work / self.usual.most).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}

impl TokenBucket {
    /// Adds `work`, up to `most`. The first call fills it completely: the first frames, divided by guesses,
    /// need most help.
    fn fill(&mut self, work: f64, most: f64) {
        let filled = if self.most == 0.0 {
            most
        } else {
            self.work + work
        };
        (self.work, self.most) = (filled.clamp(0.0, most), most);
    }
}

/// Share of each frame's work that may be duplicated.
const SHARE: f64 = 0.0125;
/// Capacity, in frames.
const FRAMES_MAX: f64 = 0.2;
/// The same for gravely late tiles: up to a whole frame, but rarely.
const RESERVE_SHARE: f64 = 0.0025;
const RESERVE_FRAMES_MAX: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duplicates_stay_within_their_share_of_all_work() {
        let mut budget = HedgeBudget::default();
        let mut spent = 0.0;
        for _ in 0..1000 {
            budget.add_frame(100.0);
            while budget.work(false) >= 1.0 {
                budget.spend(1.0, false);
                spent += 1.0;
            }
        }
        let share = spent / 100_000.0;
        assert!((share - SHARE).abs() < 0.001, "{share}");
    }

    #[test]
    fn reserve_is_spent_on_gravely_late_tiles_alone() {
        let mut budget = HedgeBudget::default();
        budget.add_frame(100.0);
        let usual = budget.work(false);
        assert_eq!(budget.work(true), usual + 100.0 * RESERVE_FRAMES_MAX);
        budget.spend(100.0, true);
        assert_eq!((budget.work(false), budget.fullness()), (usual, 1.0));
        budget.spend(usual, false);
        assert_eq!(budget.fullness(), 0.0);
    }
}
