//! Playback through the system's sound device, which needs the system's library: behind the feature `cpal`.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use cpal::traits::{DeviceTrait as _, HostTrait as _, StreamTrait as _};
use cpal::{ErrorKind, FromSample, OutputCallbackInfo, SampleFormat, SizedSample, StreamConfig};

use super::{RATE_HZ, Sound};

/// The system's default device, with a stream that is open as long as this lives.
pub struct SoundDevice {
    _stream: cpal::Stream,
    name: String,
    voice: SharedVoice,
    is_lost: Arc<AtomicBool>,
}

/// A sound on a device, which ends with this.
pub struct DeviceSound(SharedVoice);

type SharedVoice = Arc<Mutex<Option<Voice>>>;

/// What is heard, and how far it is.
struct Voice {
    sound: Sound,
    volume: f32,
    /// When the first sample is to be heard.
    at: Instant,
    /// The sample that comes next, with its part; none before the first buffer.
    next: Option<f64>,
}

impl SoundDevice {
    /// Opens the system's default device in its own format and rate.
    ///
    /// # Errors
    /// The system's: there is no device, another program has it, or its format is none of the usual ones.
    pub fn open() -> Result<Self, cpal::Error> {
        let device = cpal::default_host()
            .default_output_device()
            .ok_or_else(|| cpal::Error::from(ErrorKind::DeviceNotAvailable))?;
        let config = device.default_output_config()?;
        let voice = SharedVoice::default();
        let is_lost = Arc::new(AtomicBool::new(false));
        let parts = (config.config(), voice.clone(), is_lost.clone());
        let stream = match config.sample_format() {
            SampleFormat::F32 => stream::<f32>(&device, parts)?,
            SampleFormat::F64 => stream::<f64>(&device, parts)?,
            SampleFormat::I16 => stream::<i16>(&device, parts)?,
            SampleFormat::I24 => stream::<cpal::I24>(&device, parts)?,
            SampleFormat::I32 => stream::<i32>(&device, parts)?,
            SampleFormat::U8 => stream::<u8>(&device, parts)?,
            SampleFormat::U16 => stream::<u16>(&device, parts)?,
            _ => return Err(ErrorKind::UnsupportedConfig.into()),
        };
        stream.play()?;
        Ok(Self {
            name: device.to_string(),
            _stream: stream,
            voice,
            is_lost,
        })
    }

    /// The device's name, for people.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the device is gone: unplugged, or taken by the system.
    pub fn is_lost(&self) -> bool {
        self.is_lost.load(Ordering::Relaxed)
    }

    /// Plays a sound in place of what was playing, `volume` from 0 to 1; its first sample is heard at `at`, what should
    /// have been heard already is left out.
    pub fn start(&self, sound: Sound, at: Instant, volume: f64) -> DeviceSound {
        let voice = Voice {
            sound,
            volume: volume.clamp(0.0, 1.0) as f32,
            at,
            next: None,
        };
        replace(&self.voice, Some(voice));
        DeviceSound(self.voice.clone())
    }
}

impl DeviceSound {
    /// Whether its last sample was heard.
    pub fn is_over(&self) -> bool {
        let voice = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        voice.as_ref().is_none_or(Voice::is_over)
    }
}

impl Drop for DeviceSound {
    fn drop(&mut self) {
        replace(&self.0, None);
    }
}

/// The old sound is freed outside of the lock, which the device's thread waits for.
fn replace(voice: &SharedVoice, new: Option<Voice>) {
    let old = std::mem::replace(
        &mut *voice.lock().unwrap_or_else(PoisonError::into_inner),
        new,
    );
    drop(old);
}

fn stream<T: SizedSample + FromSample<f32>>(
    device: &cpal::Device,
    (config, voice, is_lost): (StreamConfig, SharedVoice, Arc<AtomicBool>),
) -> Result<cpal::Stream, cpal::Error> {
    let (channels, rate_hz) = (usize::from(config.channels), f64::from(config.sample_rate));
    let fill = move |out: &mut [T], info: &OutputCallbackInfo| {
        let times = info.timestamp();
        let latency = times.playback.saturating_duration_since(times.callback);
        let heard_at = Instant::now() + latency;
        let mut voice = voice.lock().unwrap_or_else(PoisonError::into_inner);
        for frame in out.chunks_mut(channels) {
            let voice = voice.as_mut();
            let sample = voice.map_or([0.0; 2], |voice| voice.sample(heard_at, rate_hz));
            spread(sample, frame);
        }
    };
    let fail = move |error: cpal::Error| match error.kind() {
        ErrorKind::Xrun | ErrorKind::RealtimeDenied | ErrorKind::DeviceChanged => {
            tracing::debug!("the sound device: {error}");
        }
        _ => {
            tracing::warn!("the sound device: {error}");
            is_lost.store(true, Ordering::Relaxed);
        }
    };
    device.build_output_stream(config, fill, fail, None)
}

/// Left and right on the first two channels, their mean on a single one, silence on the others.
fn spread<T: SizedSample + FromSample<f32>>([left, right]: [f32; 2], frame: &mut [T]) {
    match frame {
        [mono] => *mono = T::from_sample(0.5 * (left + right)),
        [to_left, to_right, others @ ..] => {
            *to_left = T::from_sample(left);
            *to_right = T::from_sample(right);
            others.fill(T::from_sample(0.0));
        }
        [] => {}
    }
}

impl Voice {
    /// The next sample of a device with `rate_hz`, whose buffer begins to be heard at `heard_at`: between two of the
    /// sound's samples by linear interpolation.
    fn sample(&mut self, heard_at: Instant, rate_hz: f64) -> [f32; 2] {
        let rate = f64::from(RATE_HZ);
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

    fn is_over(&self) -> bool {
        let played = self.next.unwrap_or(0.0);
        played >= self.sound.samples.len() as f64
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

    fn voice(at: Instant) -> Voice {
        Voice {
            sound: ramp(),
            volume: 0.5,
            at,
            next: None,
        }
    }

    #[test]
    fn a_sound_begins_at_its_moment_whatever_the_devices_latency() {
        let heard_at = Instant::now();
        for (early_samples, rate_hz) in [(48, 48_000.0), (48, 96_000.0), (48, 44_100.0)] {
            let early = Duration::from_secs_f64(f64::from(early_samples) / 48_000.0);
            let mut voice = voice(heard_at + early);
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
        let mut voice = voice(heard_at - Duration::from_millis(5));
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
        let mut frames = [[7i16; 1]; 1];
        spread([0.5, -0.5], &mut frames[0]);
        assert_eq!(frames[0], [0]);
        let mut surround = [7i16; 6];
        spread([0.5, -0.5], &mut surround);
        assert_eq!(surround, [16_384, -16_384, 0, 0, 0, 0]);
    }
}
