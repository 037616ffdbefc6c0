//! How much work may be done twice: buckets that frames fill and hedges empty.

/// Work that may be asked for although another node has been asked for it. What is taken over from
/// nodes that are taken for lost is not counted here.
#[derive(Debug, Default)]
pub(super) struct Spare {
    usual: Bucket,
    /// For tiles that are gravely late: a node that has become slow is rare, but then much of a
    /// frame has to be done again.
    reserve: Bucket,
}

#[derive(Debug, Default)]
struct Bucket {
    work: f64,
    most: f64,
}

impl Spare {
    /// Fills it by what a frame of `work` allows. It is full at the start.
    pub(super) fn add_frame(&mut self, work: f64) {
        self.usual.fill(SHARE * work, FRAMES_MAX * work);
        self.reserve
            .fill(RESERVE_SHARE * work, RESERVE_FRAMES_MAX * work);
    }

    /// Takes the work of a tile.
    pub(super) fn take(&mut self, work: f64, is_grave: bool) {
        let reserved = if is_grave {
            work.min(self.reserve.work)
        } else {
            0.0
        };
        self.reserve.work -= reserved;
        self.usual.work -= work - reserved;
    }

    /// What there is for tiles that are, or are not, gravely late.
    pub(super) fn work(&self, is_grave: bool) -> f64 {
        self.usual.work + if is_grave { self.reserve.work } else { 0.0 }
    }

    /// From 0 to 1.
    pub(super) fn fullness(&self) -> f64 {
        if self.usual.most > 0.0 {
            (self.usual.work / self.usual.most).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}

impl Bucket {
    fn fill(&mut self, work: f64, most: f64) {
        let filled = if self.most == 0.0 {
            most
        } else {
            self.work + work
        };
        (self.work, self.most) = (filled.clamp(0.0, most), most);
    }
}

/// Share of each frame's work.
const SHARE: f64 = 0.0125;
/// How much can be saved up, in frames.
const FRAMES_MAX: f64 = 0.2;
/// The same for what is gravely late: a whole frame, once in a while.
const RESERVE_SHARE: f64 = 0.0025;
const RESERVE_FRAMES_MAX: f64 = 1.0;
