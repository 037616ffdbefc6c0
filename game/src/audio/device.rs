//! Playback through the system's sound device, with the feature `cpal`, which links a system library.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use cpal::traits::{DeviceTrait as _, HostTrait as _, StreamTrait as _};
use cpal::{ErrorKind, FromSample, OutputCallbackInfo, SampleFormat, SizedSample, StreamConfig};

use super::Sound;
use super::voice::{Voice, channel_value};

/// The system's default output device, with a stream that is open as long as this lives.
pub struct SoundDevice {
    _stream: cpal::Stream,
    name: String,
    voice: SharedVoice,
    is_lost: Arc<AtomicBool>,
}

/// A sound that plays on a device until this is dropped.
pub struct DeviceSound(SharedVoice);

type SharedVoice = Arc<Mutex<Option<Voice>>>;

impl SoundDevice {
    /// Opens the system's default output device in its native format and rate.
    ///
    /// # Errors
    /// If there is no device, another program holds it, or its sample format is not supported.
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

    /// Display name of the device.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the device has failed, as when it was unplugged.
    pub fn is_lost(&self) -> bool {
        self.is_lost.load(Ordering::Relaxed)
    }

    /// Plays a sound in place of the present one, with a volume from 0 to 1. Its first sample is heard at
    /// `at`; if that is over, the beginning is cut off.
    pub fn start(&self, sound: Sound, at: Instant, volume: f64) -> DeviceSound {
        replace(&self.voice, Some(Voice::new(sound, at, volume)));
        DeviceSound(self.voice.clone())
    }
}

impl DeviceSound {
    /// Whether its last sample has been played.
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

/// Replaces the present sound. The old one is freed outside of the lock, as the device's real-time thread
/// waits for it.
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
        // Both timestamps are of the device's clock; only their difference, the output latency, is used.
        let latency = times.playback.saturating_duration_since(times.callback);
        let heard_at = Instant::now() + latency;
        let mut voice = voice.lock().unwrap_or_else(PoisonError::into_inner);
        for frame in out.chunks_mut(channels) {
            let voice = voice.as_mut();
            let sample = voice.map_or([0.0; 2], |voice| voice.sample(heard_at, rate_hz));
            for (channel, value) in frame.iter_mut().enumerate() {
                *value = T::from_sample(channel_value(sample, channel, channels));
            }
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
