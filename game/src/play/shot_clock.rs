//! Clock of the present shot.

/// Time of a running shot, in seconds since the stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotClock {
    /// Number of the shot, which is unique for each shot and changes with each jump of a replay's time.
    pub number: u64,
    /// Present moment of the shot; negative before the stroke.
    pub now_secs: f64,
    /// Moment at which the last ball comes to rest.
    pub end_secs: f64,
}

impl ShotClock {
    /// The moment to show: the present one, at most the shot's end.
    pub fn shown_secs(self) -> f64 {
        self.now_secs.min(self.end_secs)
    }
}
