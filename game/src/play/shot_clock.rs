//! The clock of a shot that is on.

/// Time of a shot that plays, in seconds since the stroke.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotClock {
    /// Number of the shot; it differs for each shot, and after each jump of a replay's time.
    pub number: u64,
    /// Present moment of the shot; negative before the stroke.
    pub now_secs: f64,
    /// When the last ball rests.
    pub end_secs: f64,
}

impl ShotClock {
    /// The moment that is shown: the present one, up to the shot's end.
    pub fn shown_secs(self) -> f64 {
        self.now_secs.min(self.end_secs)
    }
}
