//! Sound of a shot from the contacts of its simulation.

use carom_billiards::physics::{Event, EventKind, Shot, Surface};
use glam::DVec3;

use super::listener::Ear;
use super::modal_synthesis::Voice;
use super::rolling::{BallPaths, room_tone};
use super::{RATE_HZ, Sound, reverb};

/// The sound of a whole shot, which begins with the stroke.
pub fn of_shot(shot: &Shot) -> Sound {
    let strikes = shot.events().iter().filter_map(|event| strike(shot, event));
    let strikes: Vec<Strike> = strikes.filter(is_heard).collect();
    let paths = BallPaths::of(shot);
    let [left, right] = Ear::BOTH.map(|ear| {
        let mut samples = play(&strikes, ear);
        paths.add_to(&mut samples, ear);
        reverb::reverberate(&mut samples, ear);
        room_tone(&mut samples, ear);
        samples
    });
    let length = left.len().max(right.len());
    // Soft clipping, as a break exceeds full scale for some milliseconds.
    let sample = |channel: &[f32], i: usize| channel.get(i).copied().unwrap_or(0.0).tanh();
    let samples = (0..length).map(|i| [sample(&left, i), sample(&right, i)]);
    Sound {
        samples: samples.collect(),
    }
}

/// An audible contact.
struct Strike {
    /// Seconds since the stroke.
    at_secs: f64,
    voice: Voice,
    speed_m_s: f64,
    place: DVec3,
}

fn is_heard(strike: &Strike) -> bool {
    (AUDIBLE_M_S..SPEED_M_S_MAX).contains(&strike.speed_m_s)
        && (0.0..SECS_MAX).contains(&strike.at_secs)
}

fn play(strikes: &[Strike], ear: Ear) -> Vec<f32> {
    let mut samples = Vec::new();
    for strike in strikes {
        let (later_secs, gain) = ear.hears(strike.place);
        let at = (strike.at_secs + later_secs).max(0.0) * f64::from(RATE_HZ);
        let first = at.floor() as usize;
        // The fraction of a sample is kept: the ears differ by up to 0.26 ms or 12 samples, and differences
        // below one sample are audible as directions.
        let struck = strike.voice.strike(strike.speed_m_s, at.fract());
        if samples.len() < first + struck.len() {
            samples.resize(first + struck.len(), 0.0);
        }
        // Simultaneous clicks reach the ear with random phases, so that energies add up rather than
        // amplitudes: n of them are scaled by 1/√n. A break has a hundred contacts within a few
        // milliseconds.
        let together = |other: &&Strike| (other.at_secs - strike.at_secs).abs() < TOGETHER_SECS;
        let share = gain / (strikes.iter().filter(together).count() as f32).sqrt();
        for (out, sample) in samples[first..].iter_mut().zip(&struck) {
            *out += share * sample;
        }
    }
    samples
}

/// The sound of an event, if it has one.
fn strike(shot: &Shot, event: &Event) -> Option<Strike> {
    let place_of = |number: u8| {
        let poses = shot.poses_at(event.time_secs);
        let ball = poses.iter().find(|ball| ball.number == number);
        ball.map_or(DVec3::ZERO, |ball| ball.position)
    };
    let mut after_secs = 0.0;
    let (voice, speed_m_s, place) = match event.kind {
        EventKind::Strike { speed_m_s } => (Voice::Tip, speed_m_s, place_of(0)),
        EventKind::Miscue { .. } => (Voice::Slip, MISCUE_M_S, place_of(0)),
        EventKind::BallBall {
            speed_m_s, point, ..
        } => (Voice::Ball, speed_m_s, point),
        EventKind::Cushion {
            speed_m_s, point, ..
        } => (Voice::Cushion, speed_m_s, point),
        EventKind::Pocketed {
            ball, speed_m_s, ..
        } => (
            Voice::Pocket,
            speed_m_s.max(POCKET_FALL_M_S),
            place_of(ball),
        ),
        EventKind::Bounces {
            surface,
            point,
            speed_m_s,
            ..
        } => {
            let voice = match surface {
                Surface::Cloth => Voice::Slate,
                Surface::Rail => Voice::Rail,
                Surface::Pocket => Voice::Pocket,
            };
            (voice, speed_m_s, point)
        }
        EventKind::LeftTable { point, .. } => {
            // Free fall from the ball's height above the floor.
            let height_m = TABLE_HEIGHT_M + point.z.max(0.0);
            let fall_m_s = (2.0 * GRAVITY_M_S2 * height_m).sqrt();
            after_secs = fall_m_s / GRAVITY_M_S2;
            (Voice::Floor, fall_m_s, point.with_z(-TABLE_HEIGHT_M))
        }
        EventKind::Rolls { .. } | EventKind::Rests { .. } => return None,
    };
    Some(Strike {
        at_secs: event.time_secs + after_secs,
        voice,
        speed_m_s,
        place,
    })
}

/// Speed below which contacts are inaudible.
const AUDIBLE_M_S: f64 = 0.02;
/// Time within which contacts count as simultaneous: that of a click's decay.
const TOGETHER_SECS: f64 = 2e-3;
const SPEED_M_S_MAX: f64 = 60.0;
/// Speed at which a miscue sounds.
const MISCUE_M_S: f64 = 1.5;
/// Latest time of a contact, longer than any shot.
const SECS_MAX: f64 = 120.0;
/// Speed of a ball after a fall of 60 mm into a pocket, the least of a pocketed ball.
const POCKET_FALL_M_S: f64 = 1.1;
const TABLE_HEIGHT_M: f64 = 0.78;
const GRAVITY_M_S2: f64 = 9.81;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::table_scene::TableScene;
    use carom_billiards::physics::{Stroke, World};

    fn break_shot(speed_m_s: f64) -> Shot {
        let table = TableScene::table();
        let world = World::new(table.clone(), table.rack_eight(1)).unwrap();
        world.strike(Stroke::straight(0.0, speed_m_s)).unwrap()
    }

    /// The first sample over a twentieth within `secs` of a moment.
    fn onset(sound: &Sound, moment_secs: f64, secs: f64) -> Option<f64> {
        let rate = f64::from(RATE_HZ);
        let first = ((moment_secs - secs).max(0.0) * rate) as usize;
        let last = (((moment_secs + secs) * rate) as usize).min(sound.samples.len());
        let found = sound.samples[first..last]
            .iter()
            .position(|[left, _]| left.abs() > 0.05)?;
        Some((first + found) as f64 / rate)
    }

    #[test]
    fn every_click_falls_on_its_moment() {
        let shot = break_shot(6.0);
        let sound = of_shot(&shot);
        let contact = shot
            .events()
            .iter()
            .find(|event| matches!(event.kind, EventKind::BallBall { .. }));
        let moment = contact.unwrap().time_secs;
        let before = onset(&sound, moment, 0.002).unwrap();
        assert!((before - moment).abs() < 3e-4, "{before} for {moment}");
        assert!(onset(&sound, 0.0, 0.005).is_some(), "the blow");
    }

    #[test]
    fn a_break_is_loud_does_not_clip_and_ends_in_silence() {
        let sound = of_shot(&break_shot(9.0));
        let channels = sound.samples.iter().flatten();
        let peak = channels.fold(0.0_f32, |peak, s| peak.max(s.abs()));
        assert!((0.6..1.0).contains(&peak), "{peak}");
        let end = &sound.samples[sound.samples.len() - 100..];
        assert!(end.iter().flatten().all(|sample| sample.abs() < 2e-3));
    }

    #[test]
    fn a_soft_shot_is_softer() {
        let loudness = |speed: f64| {
            let sound = of_shot(&break_shot(speed));
            let channels = sound.samples.iter().flatten();
            channels.fold(0.0_f32, |peak, s| peak.max(s.abs()))
        };
        let (soft, loud) = (loudness(1.0), loudness(8.0));
        assert!(soft < 0.4 * loud, "{soft} against {loud}");
    }

    #[test]
    fn what_happens_on_the_left_is_louder_there() {
        let strike = |y: f64| Strike {
            at_secs: 0.1,
            voice: Voice::Ball,
            speed_m_s: 2.0,
            place: DVec3::new(0.0, y, 0.0),
        };
        let energy = |y: f64, ear: Ear| {
            let samples = play(&[strike(y)], ear);
            samples.iter().map(|sample| sample * sample).sum::<f32>()
        };
        assert!(energy(0.6, Ear::Left) > 1.3 * energy(0.6, Ear::Right));
        assert!(energy(-0.6, Ear::Right) > 1.3 * energy(-0.6, Ear::Left));
    }
}
