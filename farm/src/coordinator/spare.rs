//! How much work may be done twice: a bucket that frames fill and hedges empty.

/// Work that may be asked for although another node has been asked for it. What is taken over from
/// nodes that are taken for lost is not counted here.
#[derive(Debug, Default)]
pub(super) struct Spare {
    work: f64,
    most: f64,
}

impl Spare {
    /// Fills it by what a frame of `work` allows. It is full at the start.
    pub(super) fn add_frame(&mut self, work: f64) {
        let first = self.most == 0.0;
        self.most = FRAMES_MAX * work;
        self.work = if first {
            self.most
        } else {
            self.work + SHARE * work
        };
        self.work = self.work.clamp(0.0, self.most);
    }

    pub(super) fn take(&mut self, work: f64) {
        self.work -= work;
    }

    pub(super) fn work(&self) -> f64 {
        self.work
    }

    /// From 0 to 1.
    pub(super) fn fullness(&self) -> f64 {
        if self.most > 0.0 {
            (self.work / self.most).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}

/// Share of each frame's work.
const SHARE: f64 = 0.0125;
/// How much can be saved up, in frames.
const FRAMES_MAX: f64 = 0.2;
