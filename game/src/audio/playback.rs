//! Playback of one sound at a time, through a player program of the system or its sound device.
//!
//! Without the feature `cpal` no system library is linked, so that the game builds and runs on a machine
//! without sound, and says so in the settings. A player program gets a shot's sound as one temporary WAV
//! file.

use std::ffi::OsString;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use carom_text::text;
use tempfile::TempPath;

use super::Sound;
#[cfg(feature = "cpal")]
use super::device::{DeviceSound, SoundDevice};

/// Output for sounds.
pub enum SoundOutput {
    /// A program that plays a WAV file.
    Program(PlayerProgram),
    /// The system's sound device.
    #[cfg(feature = "cpal")]
    Device(SoundDevice),
}

/// Program that plays a WAV file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlayerProgram {
    /// Path of the program.
    pub program: PathBuf,
    /// Arguments before the file's name.
    pub arguments: Vec<OsString>,
}

/// Plays one sound at a time, on a thread of its own.
#[derive(Debug)]
pub struct Playback {
    requests: Option<Sender<PlaybackRequest>>,
    thread: Option<JoinHandle<()>>,
    state: Arc<Mutex<String>>,
}

enum PlaybackRequest {
    Play {
        sound: Box<dyn FnOnce() -> Sound + Send>,
        /// Time at which the sound's first sample is to be heard.
        at: Instant,
        volume: f64,
    },
    Stop,
}

impl SoundOutput {
    /// The system's device with the feature `cpal` and if it can be opened, otherwise the first of the
    /// known players that is installed.
    pub fn of_system() -> Option<Self> {
        #[cfg(feature = "cpal")]
        match SoundDevice::open() {
            Ok(device) => return Some(Self::Device(device)),
            Err(why) => tracing::warn!("the sound device cannot be used: {why}"),
        }
        PlayerProgram::installed().map(Self::Program)
    }

    fn name(&self) -> String {
        match self {
            Self::Program(player) => player.program.display().to_string(),
            #[cfg(feature = "cpal")]
            Self::Device(device) => device.name().to_owned(),
        }
    }

    /// Plays a sound whose first sample is to be heard at `at`, `volume` from 0 to 1.
    fn start(&mut self, sound: Sound, at: Instant, volume: f64) -> io::Result<PlayingSound> {
        match self {
            Self::Program(player) => {
                // Compensates for the player's start time; of a late sound the beginning is cut off.
                let now = Instant::now() + START_TIME;
                let late_secs = now.saturating_duration_since(at).as_secs_f64();
                let early_secs = at.saturating_duration_since(now).as_secs_f64();
                PlayingSound::of_program(player, &sound.shifted(early_secs - late_secs), volume)
            }
            #[cfg(feature = "cpal")]
            Self::Device(device) => {
                if device.is_lost() {
                    // The default device may have changed.
                    *device = SoundDevice::open().map_err(io::Error::other)?;
                }
                Ok(PlayingSound::Device(device.start(sound, at, volume)))
            }
        }
    }
}

impl PlayerProgram {
    /// The first of the known players that is installed.
    pub fn installed() -> Option<Self> {
        KNOWN.iter().find_map(|(name, arguments)| {
            Some(Self {
                program: installed_program(name)?,
                arguments: arguments.iter().map(OsString::from).collect(),
            })
        })
    }

    fn start(&self, file: &Path) -> io::Result<Child> {
        Command::new(&self.program)
            .args(&self.arguments)
            .arg(file)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
    }
}

/// Path of a program of this name in the folders of `PATH`.
pub fn installed_program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let mut programs = std::env::split_paths(&path).map(|folder| folder.join(&file));
    programs.find(|program| program.is_file())
}

impl Playback {
    /// A playback through `output`; without one it is silent.
    pub fn new(output: Option<SoundOutput>) -> Self {
        let words = match &output {
            Some(output) => text!("sound-by", name = output.name()),
            None => silence(),
        };
        let state = Arc::new(Mutex::new(words));
        let (requests, received) = channel();
        let thread = output.and_then(|output| {
            let state = state.clone();
            let work = move || work(output, &received, &state);
            thread::Builder::new()
                .name("sound".to_owned())
                .spawn(work)
                .ok()
        });
        Self {
            requests: thread.is_some().then_some(requests),
            thread,
            state,
        }
    }

    /// Whether there is no output.
    pub fn is_silent(&self) -> bool {
        self.requests.is_none()
    }

    /// Description of the output, or the reason why there is no sound: a sentence for the settings.
    pub fn state(&self) -> String {
        self.state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Synthesises a sound on the playback thread and plays it in place of the present one. Its first
    /// sample is to be heard at `at`; if that is over, the beginning is cut off.
    pub fn play(&self, at: Instant, volume: f64, sound: impl FnOnce() -> Sound + Send + 'static) {
        if volume > 0.0 {
            self.send(PlaybackRequest::Play {
                sound: Box::new(sound),
                at,
                volume,
            });
        }
    }

    /// Stops the present sound.
    pub fn stop(&self) {
        self.send(PlaybackRequest::Stop);
    }

    fn send(&self, request: PlaybackRequest) {
        if let Some(requests) = &self.requests {
            // The thread lives until this is dropped, so sending succeeds.
            let _ = requests.send(request);
        }
    }
}

impl Drop for Playback {
    fn drop(&mut self) {
        // Closing the channel ends the thread; joining it before would wait for ever.
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn work(mut output: SoundOutput, requests: &Receiver<PlaybackRequest>, state: &Mutex<String>) {
    let mut playing: Option<PlayingSound> = None;
    loop {
        let request = match requests.recv_timeout(REAP_PERIOD) {
            Ok(request) => request,
            Err(RecvTimeoutError::Timeout) => {
                playing.take_if(|playing| playing.is_over());
                continue;
            }
            Err(RecvTimeoutError::Disconnected) => return,
        };
        // Ends the old sound before the new one is synthesised.
        playing = None;
        let PlaybackRequest::Play { sound, at, volume } = request else {
            continue;
        };
        match output.start(sound(), at, volume) {
            Ok(started) => playing = Some(started),
            Err(error) => {
                let words = text!(
                    "sound-failed",
                    name = output.name(),
                    why = error.to_string()
                );
                *state.lock().unwrap_or_else(PoisonError::into_inner) = words;
            }
        }
    }
}

/// A sound that is played until it is over or this is dropped.
enum PlayingSound {
    /// Process of a player, and its file, which is deleted with this.
    Program { child: Child, _file: TempPath },
    #[cfg(feature = "cpal")]
    Device(DeviceSound),
}

impl PlayingSound {
    fn of_program(player: &PlayerProgram, sound: &Sound, volume: f64) -> io::Result<Self> {
        let mut file = tempfile::Builder::new()
            .prefix("carom-")
            .suffix(".wav")
            .tempfile()?;
        let mut out = BufWriter::new(&mut file);
        sound.write_wav(volume, &mut out)?;
        out.flush()?;
        drop(out);
        let file = file.into_temp_path();
        let child = player.start(&file)?;
        Ok(Self::Program { child, _file: file })
    }

    fn is_over(&mut self) -> bool {
        match self {
            Self::Program { child, .. } => !matches!(child.try_wait(), Ok(None)),
            #[cfg(feature = "cpal")]
            Self::Device(sound) => sound.is_over(),
        }
    }
}

impl Drop for PlayingSound {
    fn drop(&mut self) {
        match self {
            Self::Program { child, .. } => {
                let _ = child.kill();
                let _ = child.wait();
            }
            #[cfg(feature = "cpal")]
            Self::Device(_) => {}
        }
    }
}

fn silence() -> String {
    let names: Vec<&str> = KNOWN.iter().map(|(name, _)| *name).collect();
    text!("sound-none", programs = names.join(", "))
}

/// Known players and their arguments. The first three come with PipeWire, PulseAudio and ALSA,
/// afplay with macOS, the others with ffmpeg and SoX.
const KNOWN: [(&str, &[&str]); 6] = [
    ("pw-play", &[]),
    ("paplay", &["--latency-msec=30"]),
    ("aplay", &["-q"]),
    ("afplay", &[]),
    ("ffplay", &["-nodisp", "-autoexit", "-loglevel", "quiet"]),
    ("play", &["-q"]),
];
/// Approximate time from a player's start to its first sample: it opens its device and fills a buffer.
const START_TIME: Duration = Duration::from_millis(30);
const REAP_PERIOD: Duration = Duration::from_millis(500);

#[cfg(all(test, unix))]
mod tests {
    use std::fs;

    use super::*;
    use crate::audio::RATE_HZ;

    fn sound() -> Sound {
        Sound {
            samples: vec![[0.5; 2]; RATE_HZ as usize],
        }
    }

    /// A player that keeps what it was given.
    fn keeper(folder: &Path) -> PlayerProgram {
        let kept = folder.join("kept.wav");
        let script = format!(
            "cp \"$0\" {0}.new && mv {0}.new {0} && exec sleep 600",
            kept.display()
        );
        PlayerProgram {
            program: "/bin/sh".into(),
            arguments: vec!["-c".into(), script.into()],
        }
    }

    fn wait_for(path: &Path, speaker: &Playback) -> Vec<u8> {
        loop {
            if let Ok(bytes) = fs::read(path) {
                return bytes;
            }
            let state = speaker.state();
            assert!(state.starts_with("Played by"), "{state}");
            thread::yield_now();
        }
    }

    #[test]
    fn a_new_sound_replaces_the_one_that_plays() {
        let folder = tempfile::tempdir().unwrap();
        let speaker = Playback::new(Some(SoundOutput::Program(keeper(folder.path()))));
        let kept = folder.path().join("kept.wav");
        speaker.play(Instant::now() + Duration::from_secs(3600), 1.0, sound);
        let early = wait_for(&kept, &speaker);
        assert!(
            early[44..44 + 192_000].iter().all(|byte| *byte == 0),
            "it begins with silence"
        );
        fs::remove_file(&kept).unwrap();
        // The first player would sleep on: it is ended for the second, and that one by the drop.
        speaker.play(Instant::now() - Duration::from_millis(500), 1.0, sound);
        let late = wait_for(&kept, &speaker);
        assert!(
            late.len() < 44 + 2 * RATE_HZ as usize,
            "what is over is left out"
        );
        drop(speaker);
    }

    #[test]
    fn a_player_that_cannot_be_started_is_told() {
        let missing = PlayerProgram {
            program: "/no/such/player".into(),
            arguments: Vec::new(),
        };
        let speaker = Playback::new(Some(SoundOutput::Program(missing)));
        speaker.play(Instant::now(), 1.0, sound);
        while !speaker.state().starts_with("No sound: /no/such/player") {
            thread::yield_now();
        }
    }

    #[test]
    fn without_a_player_there_is_silence_and_a_sentence() {
        let speaker = Playback::new(None);
        speaker.play(Instant::now(), 1.0, sound);
        speaker.stop();
        assert!(speaker.is_silent() && speaker.state().contains("apt install alsa-utils"));
    }
}
