//! Playing sound, resampled to a device's rate and aligned with its start time.

use std::time::Instant;

use super::{RATE_HZ, Sound};

/// A sound that is being played, and its position.
pub(super) struct Voice {
    sound: Sound,
    volume: f32,
    /// Time at which the first sample is to be heard.
    at: Instant,
    /// Fractional index of the next sample, negative before the start; none before the first buffer.
    next: Option<f64>,
}

impl Voice {
    /// A sound whose first sample is to be heard at `at`, `volume` from 0 to 1.
    pub(super) fn new(sound: Sound, at: Instant, volume: f64) -> Self {
        Self {
            sound,
            volume: volume.clamp(0.0, 1.0) as f32,
            at,
            next: None,
        }
    }

    /// The next sample for a device of `rate_hz` whose present buffer is heard from `heard_at` on, linearly
    /// interpolated between two of the sound's samples.
    pub(super) fn sample(&mut self, heard_at: Instant, rate_hz: f64) -> [f32; 2] {
        let rate = f64::from(RATE_HZ);
        // Only for the first buffer: later positions follow by counting samples, as the clocks of device
        // and system drift apart.
        let next = self.next.unwrap_or_else(|| {
            let late = heard_at.saturating_duration_since(self.at).as_secs_f64();
            let early = self.at.saturating_duration_since(heard_at).as_secs_f64();
            (late - early) * rate
        });
        self.next = Some(next + rate / rate_hz);
        if next < 0.0 {
            return [0.0; 2];
        }
        let (index, part) = (next as usize, next.fract() as f32);
        let at = |index: usize| self.sound.samples.get(index).copied().unwrap_or_default();
        let (before, after) = (at(index), at(index + 1));
        [0, 1].map(|ear| self.volume * (before[ear] + part * (after[ear] - before[ear])))
    }

    /// Whether the last sample has been returned.
    pub(super) fn is_over(&self) -> bool {
        let played = self.next.unwrap_or(0.0);
        played >= self.sound.samples.len() as f64
    }
}

/// Value of a device's channel: left and right on the first two, their mean on a single one, silence on
/// others.
pub(super) fn channel_value([left, right]: [f32; 2], channel: usize, channels: usize) -> f32 {
    match channel {
        0 if channels == 1 => 0.5 * (left + right),
        0 => left,
        1 => right,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn ramp() -> Sound {
        Sound {
            samples: (0..480).map(|i| [i as f32 / 480.0, -1.0]).collect(),
        }
    }

    #[test]
    fn a_sound_begins_at_its_moment_whatever_the_devices_latency() {
        let heard_at = Instant::now();
        for (early_samples, rate_hz) in [(48, 48_000.0), (48, 96_000.0), (48, 44_100.0)] {
            let early = Duration::from_secs_f64(f64::from(early_samples) / 48_000.0);
            let mut voice = Voice::new(ramp(), heard_at + early, 0.5);
            let silent = (0..).take_while(|_| voice.sample(heard_at, rate_hz)[1] == 0.0);
            let secs = silent.count() as f64 / rate_hz;
            assert!(
                (secs - early.as_secs_f64()).abs() <= 1.0 / rate_hz,
                "{secs}"
            );
        }
    }

    #[test]
    fn a_late_sound_begins_in_its_middle_and_ends_on_time() {
        let heard_at = Instant::now() + Duration::from_secs(1);
        let mut voice = Voice::new(ramp(), heard_at - Duration::from_millis(5), 0.5);
        let first = voice.sample(heard_at, 96_000.0);
        assert!((first[0] - 0.25).abs() < 1e-3, "{first:?}");
        let second = voice.sample(heard_at, 96_000.0);
        assert!(
            (second[0] - first[0] - 0.25 / 480.0).abs() < 1e-6,
            "half a sample further"
        );
        let rest = (0..).take_while(|_| {
            let is_playing = !voice.is_over();
            voice.sample(heard_at, 96_000.0);
            is_playing
        });
        assert_eq!(rest.count(), 2 * 240 - 2);
    }

    #[test]
    fn left_and_right_reach_the_first_two_channels() {
        let on = |channels| (0..channels).map(move |c| channel_value([0.5, -0.25], c, channels));
        assert!(on(1).eq([0.125]));
        assert!(on(6).eq([0.5, -0.25, 0.0, 0.0, 0.0, 0.0]));
    }
}
