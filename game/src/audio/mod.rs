//! Sound synthesis of a shot: each contact of the simulation excites the modes of what is struck, in a room.
//!
//! ```text
//! Shot ─┬▶ events ─▶ modal_synthesis (modes excited by a contact's force) ─┬▶ reverb ─▶ playback, WAV, video
//!       └▶ rolling (noise of balls on cloth)                             ─┘
//! ```
//! Each is computed for both ears, with their delays and levels ([`listener`]).
//!
//! A shot is simulated whole before it is watched, so its whole sound is synthesised at once, with every
//! contact at its exact time. [`playback`] chooses the output.

#[cfg(feature = "cpal")]
mod device;
mod events;
mod listener;
mod modal_synthesis;
pub mod playback;
mod reverb;
mod rolling;
#[cfg(any(feature = "cpal", test))]
mod voice;

pub use events::of_shot;
pub use playback::{Playback, installed_program};

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use anyhow::Context as _;
use carom_billiards::physics::{Recording, Shot, Stroke, World};

use carom_text::text;

use crate::scene::table_scene::TableScene;

/// Sample rate of all sounds.
pub const RATE_HZ: u32 = 48_000;

/// Stereo sound at [`RATE_HZ`], from −1 to 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sound {
    /// Left and right samples.
    pub samples: Vec<[f32; 2]>,
}

impl Sound {
    /// The same sound delayed by `secs`; with a negative delay its beginning is cut off.
    #[must_use]
    pub fn shifted(&self, secs: f64) -> Self {
        let samples = (secs.abs() * f64::from(RATE_HZ)).round() as usize;
        let samples = if secs < 0.0 {
            self.samples.get(samples..).unwrap_or_default().to_vec()
        } else {
            let silence = std::iter::repeat_n([0.0; 2], samples.min(SILENCE_MAX));
            silence.chain(self.samples.iter().copied()).collect()
        };
        Self { samples }
    }

    /// Mixes in another sound that begins at `secs`.
    pub fn mix(&mut self, other: &Self, secs: f64) {
        let first = (secs.max(0.0) * f64::from(RATE_HZ)).round() as usize;
        let end = first + other.samples.len();
        self.samples.resize(self.samples.len().max(end), [0.0; 2]);
        for (out, sample) in self.samples[first..].iter_mut().zip(&other.samples) {
            *out = [out[0] + sample[0], out[1] + sample[1]];
        }
    }

    /// Writes a 16-bit WAV file with samples scaled by `volume` from 0 to 1.
    ///
    /// # Errors
    /// Those of the writer, and sounds longer than a WAV file holds.
    pub fn write_wav(&self, volume: f64, out: &mut impl Write) -> io::Result<()> {
        let bytes = u32::try_from(4 * self.samples.len()).map_err(io::Error::other)?;
        out.write_all(b"RIFF")?;
        out.write_all(&(36 + bytes).to_le_bytes())?;
        out.write_all(b"WAVEfmt ")?;
        out.write_all(&16u32.to_le_bytes())?;
        let [pcm, channels, bits] = [1u16, 2, 16];
        out.write_all(&pcm.to_le_bytes())?;
        out.write_all(&channels.to_le_bytes())?;
        out.write_all(&RATE_HZ.to_le_bytes())?;
        out.write_all(&(RATE_HZ * 4).to_le_bytes())?;
        out.write_all(&4u16.to_le_bytes())?;
        out.write_all(&bits.to_le_bytes())?;
        out.write_all(b"data")?;
        out.write_all(&bytes.to_le_bytes())?;
        let scale = volume.clamp(0.0, 1.0) as f32 * f32::from(i16::MAX);
        let channels = self.samples.iter().flatten();
        let words = channels.map(|sample| (sample * scale) as i16);
        let body: Vec<u8> = words.flat_map(i16::to_le_bytes).collect();
        out.write_all(&body)
    }
}

/// Writes the sound of a recording's first shot, or of a break of `speed_m_s`, as a WAV file, and prints a
/// summary.
///
/// # Errors
/// If the break cannot be struck at this speed, or the file cannot be written.
pub fn write_shot(out: &Path, recording: Option<Recording>, speed_m_s: f64) -> anyhow::Result<()> {
    let first = recording.and_then(|recording| recording.clips.into_iter().next());
    let shot = match first {
        Some(take) => take.shot,
        None => break_shot(speed_m_s)?,
    };
    let sound = of_shot(&shot);
    let unwritable = || text!("file-unwritable", path = out.display().to_string());
    let mut file = BufWriter::new(File::create(out).with_context(unwritable)?);
    let written = sound.write_wav(1.0, &mut file).and_then(|()| file.flush());
    written.with_context(unwritable)?;
    println!(
        "{}: {:.2} s of {} events",
        out.display(),
        sound.samples.len() as f64 / f64::from(RATE_HZ),
        shot.events().len()
    );
    Ok(())
}

fn break_shot(speed_m_s: f64) -> anyhow::Result<Shot> {
    let table = TableScene::table();
    let rack = table.rack_eight(1);
    Ok(World::new(table, rack)?.strike(Stroke::straight(0.0, speed_m_s))?)
}

/// Longest silence of [`Sound::shifted`], in samples: 10 s.
const SILENCE_MAX: usize = 480_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wav_file_has_its_header_and_its_samples() {
        let sound = Sound {
            samples: vec![[0.0, 1.0], [-1.0, 0.5]],
        };
        let mut bytes = Vec::new();
        sound.write_wav(0.5, &mut bytes).unwrap();
        assert_eq!(bytes.len(), 44 + 8);
        assert_eq!(&bytes[..4], b"RIFF");
        assert_eq!(u32::from_le_bytes(bytes[4..8].try_into().unwrap()), 44);
        assert_eq!(
            u32::from_le_bytes(bytes[24..28].try_into().unwrap()),
            RATE_HZ
        );
        let words = bytes[44..]
            .chunks_exact(2)
            .map(|word| i16::from_le_bytes([word[0], word[1]]));
        assert_eq!(words.collect::<Vec<_>>(), [0, 16_383, -16_383, 8191]);
    }

    #[test]
    fn a_sound_begins_later_or_in_its_middle() {
        let sound = Sound {
            samples: vec![[0.1; 2], [0.2; 2], [0.3; 2]],
        };
        let sample_secs = 1.0 / f64::from(RATE_HZ);
        assert_eq!(
            sound.shifted(2.0 * sample_secs).samples,
            [0.0, 0.0, 0.1, 0.2, 0.3].map(|sample| [sample; 2])
        );
        assert_eq!(sound.shifted(-2.0 * sample_secs).samples, [[0.3; 2]]);
        assert_eq!(sound.shifted(-9.0).samples, [[0f32; 2]; 0]);
    }

    #[test]
    fn sounds_add_up_where_they_meet() {
        let click = Sound {
            samples: vec![[0.1, 0.2]],
        };
        let mut sound = click.clone();
        sound.mix(&click, 2.0 / f64::from(RATE_HZ));
        sound.mix(&click, 0.0);
        assert_eq!(sound.samples, [[0.2, 0.4], [0.0; 2], [0.1, 0.2]]);
    }
}
