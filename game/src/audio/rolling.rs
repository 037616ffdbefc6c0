//! Noise of balls that roll on cloth, and the room tone.
//!
//! A rolling ball is noise through a low-pass filter: its level is proportional to the speed, and its
//! corner frequency rises with it. Both are fitted by ear to a phenolic ball on worsted over slate.

use carom_billiards::physics::Shot;
use glam::DVec3;

use super::RATE_HZ;
use super::listener::Ear;

/// Positions of balls on the table, every [`STEP_SECS`] of a shot.
pub(super) struct BallPaths {
    steps: Vec<Vec<Option<DVec3>>>,
}

impl BallPaths {
    pub(super) fn of(shot: &Shot) -> Self {
        let count = (shot.duration_secs() / STEP_SECS).ceil() as usize + 1;
        let step = |step: usize| {
            let poses = shot.poses_at(step as f64 * STEP_SECS);
            let place =
                |pose: &carom_billiards::physics::BallPose| pose.on_table.then_some(pose.position);
            poses.iter().map(place).collect()
        };
        Self {
            steps: (0..count).map(step).collect(),
        }
    }

    /// Adds the rolling noise that an ear hears.
    pub(super) fn add_to(&self, samples: &mut Vec<f32>, ear: Ear) {
        let per_step = (STEP_SECS * f64::from(RATE_HZ)) as usize;
        let balls = self.steps.first().map_or(0, Vec::len);
        samples.resize(samples.len().max(self.steps.len() * per_step), 0.0);
        for ball in 0..balls {
            let mut noise = Noise::new(ball as u32);
            let mut level = 0.0;
            for (step, pair) in self.steps.windows(2).enumerate() {
                let (speed_m_s, place) = match (pair[0][ball], pair[1][ball]) {
                    (Some(from), Some(to)) => (from.distance(to) / STEP_SECS, to),
                    _ => (0.0, DVec3::ZERO),
                };
                let wanted = LOUDNESS * speed_m_s as f32 * ear.hears(place).1;
                if wanted == 0.0 && level < SILENT {
                    continue;
                }
                let corner_hz = CORNER_HZ + CORNER_HZ_PER_M_S * speed_m_s;
                for out in &mut samples[step * per_step..][..per_step] {
                    // Smoothed for every sample: speeds are known every 5 ms, and steps of the level would
                    // click.
                    level += (wanted - level) * LEVEL_SHARE;
                    *out += level * noise.next(corner_hz);
                }
            }
        }
    }
}

/// Adds the tone of a quiet room at one ear over the whole length of a sound, faded in and out.
pub(super) fn room_tone(samples: &mut [f32], ear: Ear) {
    let mut noise = Noise::new(u32::MAX - ear as u32);
    let (count, fade) = (samples.len(), FADE_SECS * RATE_HZ as f32);
    for (i, out) in samples.iter_mut().enumerate() {
        let edge = i.min(count - 1 - i) as f32 / fade;
        *out += ROOM_TONE * edge.min(1.0) * noise.next(ROOM_TONE_HZ);
    }
}

/// White noise from PCG hashes through two first-order low-pass filters, with a level that hardly depends
/// on the corner frequency.
struct Noise {
    state: u32,
    low: [f32; 2],
}

impl Noise {
    fn new(seed: u32) -> Self {
        Self {
            state: seed.wrapping_mul(0x9e37_79b9),
            low: [0.0; 2],
        }
    }

    fn next(&mut self, corner_hz: f64) -> f32 {
        // PCG hash: Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020.
        self.state = self
            .state
            .wrapping_mul(747_796_405)
            .wrapping_add(2_891_336_453);
        let word =
            ((self.state >> ((self.state >> 28) + 4)) ^ self.state).wrapping_mul(277_803_737);
        let white = ((word >> 22) ^ word) as f32 / (0.5 * u32::MAX as f32) - 1.0;
        let share = (std::f64::consts::TAU * corner_hz / f64::from(RATE_HZ)).min(1.0) as f32;
        self.low[0] += share * (white - self.low[0]);
        self.low[1] += share * (self.low[0] - self.low[1]);
        // The power of white noise behind a low-pass is proportional to its corner frequency: the square root
        // normalises the amplitude.
        self.low[1] / share.sqrt()
    }
}

/// Interval of the sampled positions.
const STEP_SECS: f64 = 0.005;
/// Level of a ball at 1 m/s at the centre of the table.
const LOUDNESS: f32 = 0.004;
const CORNER_HZ: f64 = 110.0;
const CORNER_HZ_PER_M_S: f64 = 160.0;
/// Smoothing of the level for each sample: a time constant of about 4 ms.
const LEVEL_SHARE: f32 = 0.005;
const SILENT: f32 = 1e-6;
/// Level of the room tone, some 66 dB below full scale.
const ROOM_TONE: f32 = 8e-4;
const ROOM_TONE_HZ: f64 = 180.0;
const FADE_SECS: f32 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball that rolls along the table at one speed for a second.
    fn rolled(speed_m_s: f64) -> Vec<f32> {
        let place = |step: usize| DVec3::new(speed_m_s * STEP_SECS * step as f64 - 0.5, 0.0, 0.0);
        let paths = BallPaths {
            steps: (0..200).map(|step| vec![Some(place(step))]).collect(),
        };
        let mut samples = Vec::new();
        paths.add_to(&mut samples, Ear::Left);
        samples
    }

    fn loudness(samples: &[f32]) -> f32 {
        (samples.iter().map(|sample| sample * sample).sum::<f32>() / samples.len() as f32).sqrt()
    }

    /// Changes of sign per second: twice the mean frequency, about.
    fn crossings_hz(samples: &[f32]) -> f64 {
        let pairs = samples.windows(2).filter(|pair| pair[0] * pair[1] < 0.0);
        0.5 * pairs.count() as f64 * f64::from(RATE_HZ) / samples.len() as f64
    }

    #[test]
    fn a_faster_ball_rumbles_louder_and_brighter() {
        let [slow, fast] = [0.5, 2.0].map(rolled);
        assert!(loudness(&fast) > 2.5 * loudness(&slow));
        let [slow, fast] = [slow, fast].map(|samples| crossings_hz(&samples));
        assert!(fast > 1.3 * slow, "{slow} {fast}");
        assert!(
            (80.0..1500.0).contains(&slow) && fast < 1500.0,
            "{slow} {fast}"
        );
    }

    #[test]
    fn a_ball_at_rest_is_silent() {
        assert!(rolled(0.0).iter().all(|sample| *sample == 0.0));
    }

    #[test]
    fn a_room_is_quiet_and_has_no_edges() {
        let mut samples = vec![0.0; RATE_HZ as usize];
        room_tone(&mut samples, Ear::Right);
        assert!(
            (1e-5..1e-3).contains(&loudness(&samples)),
            "{}",
            loudness(&samples)
        );
        assert_eq!((samples[0], samples[samples.len() - 1]), (0.0, 0.0));
    }
}
