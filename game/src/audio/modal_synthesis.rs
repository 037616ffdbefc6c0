//! Modal synthesis of contacts: resonant modes of the struck body, excited by the force of the contact.
//!
//! The force is that of a Hertz contact, approximately sin^1.5 of time, over a duration that falls with the
//! fifth root of the speed (Johnson, "Contact Mechanics", 11.4). So harder contacts are brighter, and their
//! level grows more than the speed. The sound of two balls is mostly that of the air accelerated by each: a
//! dipole of angular frequency c/a and decay time a/c, with the opposite dipole of the other ball (Koss and
//! Alfredson, "Transient sound radiated by spheres undergoing an elastic collision", 1973). Low frequencies
//! cancel, which leaves the click between 2 and 6 kHz; the ball's lowest vibration mode is at 17 kHz (Lamb,
//! 1882: k a = 2.64 for a Poisson ratio of 1/3). The other modes are fitted by ear to the kind of body: a
//! maple shaft, a wooden rail behind rubber, slate, a leather pocket, a floor.

use super::RATE_HZ;

/// Kind of contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Voice {
    /// Cue tip on the cue ball; speeds are those of the cue.
    Tip,
    /// Tip that slips off the cue ball.
    Slip,
    /// Ball on ball.
    Ball,
    /// Ball on a cushion.
    Cushion,
    /// Ball in a pocket.
    Pocket,
    /// Ball that falls on the cloth.
    Slate,
    /// Ball that falls on a rail.
    Rail,
    /// Ball that falls on the floor.
    Floor,
}

/// Mode: frequency in Hz, decay time to 1/e in s, relative amplitude.
type VibrationMode = (f64, f64, f64);

struct StruckBody {
    /// Duration of the contact at 1 m/s.
    contact_secs: f64,
    /// Largest sample at 1 m/s.
    loudness: f64,
    modes: &'static [VibrationMode],
}

impl Voice {
    fn body(self) -> StruckBody {
        let (contact_secs, loudness, modes): (f64, f64, &'static [VibrationMode]) = match self {
            Self::Tip => (
                1.0e-3,
                0.07,
                &[
                    (620.0, 0.012, 1.0),
                    (1360.0, 0.008, 0.6),
                    (2720.0, 0.004, 0.4),
                ],
            ),
            Self::Slip => (0.4e-3, 0.09, &[(1900.0, 0.006, 1.0), (3100.0, 0.009, 0.8)]),
            Self::Ball => (
                hertz_secs(),
                0.16,
                &[(DIPOLE_HZ, DIPOLE_SECS, 1.0), (BALL_MODE_HZ, 1.5e-3, 0.3)],
            ),
            Self::Cushion => (
                5.0e-3,
                0.10,
                &[(95.0, 0.03, 0.4), (190.0, 0.04, 1.0), (430.0, 0.012, 0.1)],
            ),
            Self::Pocket => (
                2.0e-3,
                0.14,
                &[(120.0, 0.05, 1.0), (260.0, 0.03, 0.6), (900.0, 0.01, 0.2)],
            ),
            Self::Slate => (1.5e-3, 0.12, &[(180.0, 0.03, 1.0), (520.0, 0.015, 0.4)]),
            Self::Rail => (0.8e-3, 0.12, &[(350.0, 0.02, 1.0), (800.0, 0.012, 0.6)]),
            Self::Floor => (
                1.2e-3,
                0.12,
                &[(75.0, 0.06, 1.0), (160.0, 0.05, 0.7), (640.0, 0.02, 0.3)],
            ),
        };
        StruckBody {
            contact_secs,
            loudness,
            modes,
        }
    }

    /// The sound of a contact at `speed_m_s` that begins a fraction `begin` of a sample after the first.
    pub(super) fn strike(self, speed_m_s: f64, begin: f64) -> Vec<f32> {
        let body = self.body();
        let scale = body.loudness / peak(&self.radiated(ring(&body, 1.0, 0.0)));
        let rung = self.radiated(ring(&body, speed_m_s, begin));
        rung.into_iter()
            .map(|sample| (sample * scale) as f32)
            .collect()
    }
}

impl Voice {
    /// Radiated sound of the modes. For two balls it is that of one minus that of the other, delayed by the
    /// distance.
    fn radiated(self, mut rung: Vec<f64>) -> Vec<f64> {
        if self == Self::Ball {
            rung.resize(rung.len() + BALLS_APART, 0.0);
            // Backwards, so that the subtracted samples are still unchanged.
            for i in (BALLS_APART..rung.len()).rev() {
                rung[i] -= rung[i - BALLS_APART];
            }
        }
        rung
    }
}

/// The first difference of the sum of all modes, in place of its derivative: far-field pressure follows the
/// surface's acceleration.
fn ring(body: &StruckBody, speed_m_s: f64, begin: f64) -> Vec<f64> {
    let rate = f64::from(RATE_HZ);
    let contact = (body.contact_secs * speed_m_s.powf(-0.2) * rate).max(2.0);
    let longest = body.modes.iter().map(|mode| mode.1).fold(0.0, f64::max);
    let length = (contact + FADE_DECAYS * longest * rate).ceil() as usize + 2;
    let mut sum = vec![0.0; length];
    for &(hz, decay_secs, strength) in body.modes {
        let radius = (-1.0 / (decay_secs * rate)).exp();
        let angle = std::f64::consts::TAU * hz / rate;
        // Two-pole resonator with poles r·e^(±iθ). Its impulse response is rⁿ sin((n + 1)θ) / sin θ; the
        // factor `strength · sin θ` below normalises the amplitude to the mode's at any frequency.
        let (a, b) = (2.0 * radius * angle.cos(), radius * radius);
        let (mut last, mut before) = (0.0, 0.0);
        for (i, out) in sum.iter_mut().enumerate() {
            // Divided by the contact's duration, so that the integral, the momentum, is proportional to the
            // speed.
            let force = force((i as f64 - begin) / contact) * speed_m_s / contact;
            let now = a * last - b * before + strength * angle.sin() * force;
            (before, last) = (last, now);
            *out += now;
        }
    }
    let first = sum[0];
    std::iter::once(first)
        .chain(sum.windows(2).map(|pair| pair[1] - pair[0]))
        .collect()
}

/// Normalised force of a Hertz contact at a time from 0 to 1, with a maximum of 1 and an integral of about
/// 0.56.
fn force(time: f64) -> f64 {
    if !(0.0..=1.0).contains(&time) {
        return 0.0;
    }
    (std::f64::consts::PI * time).sin().max(0.0).powf(1.5)
}

fn peak(samples: &[f64]) -> f64 {
    let peak = samples
        .iter()
        .fold(0.0_f64, |peak, sample| peak.max(sample.abs()));
    peak.max(1e-12)
}

/// Duration of the Hertz contact of two balls at 1 m/s: 2.87 (m² / (R E² v))^(1/5) with the pair's reduced
/// mass, radius and modulus. Phenolic resin has a Young's modulus of 5.8 GPa and a Poisson ratio of 0.34.
fn hertz_secs() -> f64 {
    let (mass, radius) = (0.5 * 0.17, 0.5 * 0.028_575);
    let modulus = 5.8e9 / (2.0 * (1.0 - 0.34_f64.powi(2)));
    2.87 * (mass * mass / (radius * modulus * modulus)).powf(0.2)
}

/// Frequency c/(2πa) and decay time a/c of a ball's dipole, for c = 343 m/s and a = 28.575 mm.
const DIPOLE_HZ: f64 = 1910.0;
const DIPOLE_SECS: f64 = 83.3e-6;
/// Delay between the sounds of two balls in samples, averaged over all directions: that of half a diameter.
const BALLS_APART: usize = 4;
/// Lowest mode of a ball: 2.64 times the speed of shear waves over the circumference.
const BALL_MODE_HZ: f64 = 16_600.0;
/// Decay times after which a mode has fallen by 60 dB: ln 1000.
const FADE_DECAYS: f64 = 6.9;

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) const ALL: [Voice; 8] = [
        Voice::Tip,
        Voice::Slip,
        Voice::Ball,
        Voice::Cushion,
        Voice::Pocket,
        Voice::Slate,
        Voice::Rail,
        Voice::Floor,
    ];

    fn loudest(samples: &[f32]) -> f32 {
        samples
            .iter()
            .fold(0.0, |peak, sample| peak.max(sample.abs()))
    }

    fn power(samples: &[f32], hz: f64) -> f64 {
        let turn = std::f64::consts::TAU * hz / f64::from(RATE_HZ);
        let (mut re, mut im) = (0.0, 0.0);
        for (i, sample) in samples.iter().enumerate() {
            let (sin, cos) = (turn * i as f64).sin_cos();
            re += f64::from(*sample) * cos;
            im += f64::from(*sample) * sin;
        }
        re * re + im * im
    }

    /// The mean frequency of the energy, in Hz.
    fn brightness_hz(samples: &[f32]) -> f64 {
        let bands = (1..400).map(|band| 50.0 * f64::from(band));
        let (weighted, whole) = bands.fold((0.0, 0.0), |(weighted, whole), hz| {
            let power = power(samples, hz);
            (weighted + hz * power, whole + power)
        });
        weighted / whole
    }

    #[test]
    fn harder_blows_are_louder_and_brighter() {
        for voice in ALL {
            let [soft, hard] = [0.5, 5.0].map(|speed| voice.strike(speed, 0.0));
            assert!(loudest(&hard) > 9.0 * loudest(&soft), "{voice:?}");
            assert!(brightness_hz(&hard) > brightness_hz(&soft), "{voice:?}");
        }
    }

    #[test]
    fn each_body_sounds_at_its_loudness_and_fades() {
        for voice in ALL {
            let sound = voice.strike(1.0, 0.0);
            assert!((f64::from(loudest(&sound)) - voice.body().loudness).abs() < 1e-6);
            assert!(sound.iter().all(|sample| sample.is_finite()));
            let end = &sound[sound.len() - 20..];
            assert!(loudest(end) < 3e-3 * loudest(&sound), "{voice:?}");
        }
    }

    /// The share of the energy between two frequencies.
    fn share(samples: &[f32], band_hz: std::ops::Range<f64>) -> f64 {
        let powers = (1..800).map(|step| 25.0 * f64::from(step));
        let powers = powers.map(|hz| (hz, power(samples, hz)));
        let (within, whole) = powers.fold((0.0, 0.0), |(within, whole), (hz, power)| {
            let counted = if band_hz.contains(&hz) { power } else { 0.0 };
            (within + counted, whole + power)
        });
        within / whole
    }

    #[test]
    fn balls_click_between_2_and_6_khz() {
        for speed_m_s in [0.5, 2.0, 8.0] {
            let within = share(&Voice::Ball.strike(speed_m_s, 0.0), 2000.0..6000.0);
            assert!(within > 0.5, "{within} at {speed_m_s} m/s");
        }
    }

    #[test]
    fn cushions_thump_between_150_and_250_hz() {
        for speed_m_s in [0.5, 2.0, 8.0] {
            let within = share(&Voice::Cushion.strike(speed_m_s, 0.0), 150.0..250.0);
            assert!(within > 0.5, "{within} at {speed_m_s} m/s");
        }
    }

    #[test]
    fn pockets_are_duller_than_tips() {
        let brightness = |voice: Voice| brightness_hz(&voice.strike(2.0, 0.0));
        assert!(brightness(Voice::Pocket) < brightness(Voice::Tip));
    }

    #[test]
    fn hard_ball_contact_lasts_a_quarter_millisecond() {
        let secs = hertz_secs() * 5f64.powf(-0.2);
        assert!((2.0e-4..3.5e-4).contains(&secs), "{secs}");
    }
}
