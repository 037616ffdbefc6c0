//! Sound events of a shot: its contacts with their times and forces.

use carom_billiards::physics::{EventKind, Shot, Surface};

use super::modal_synthesis::Voice;
use super::{RATE_HZ, Sound, reverb};

/// The sound of a whole shot; its first sample is the blow.
pub fn of_shot(shot: &Shot) -> Sound {
    let notes = shot.events().iter().filter_map(|event| {
        let (after_secs, voice, speed_m_s) = note(&event.kind)?;
        Some((event.time_secs + after_secs, voice, speed_m_s))
    });
    let mut samples = play(&notes.filter(is_heard).collect::<Vec<_>>());
    reverb::reverberate(&mut samples);
    samples
        .iter_mut()
        .for_each(|sample| *sample = sample.tanh());
    Sound { samples }
}

/// When, what, and how fast.
type ScheduledStrike = (f64, Voice, f64);

fn is_heard((at_secs, _, speed_m_s): &ScheduledStrike) -> bool {
    (AUDIBLE_M_S..SPEED_M_S_MAX).contains(speed_m_s) && (0.0..SECS_MAX).contains(at_secs)
}

fn play(notes: &[ScheduledStrike]) -> Vec<f32> {
    let mut samples = Vec::new();
    for &(at_secs, voice, speed_m_s) in notes {
        let at = at_secs * f64::from(RATE_HZ);
        let first = at.floor() as usize;
        let struck = voice.strike(speed_m_s, at.fract());
        if samples.len() < first + struck.len() {
            samples.resize(first + struck.len(), 0.0);
        }
        // Clicks of the same moment are out of step at the ear, so that their energies add up and not
        // their amplitudes: a rack bursts in a hundred contacts within a few milliseconds.
        let together = |note: &&ScheduledStrike| (note.0 - at_secs).abs() < TOGETHER_SECS;
        let share = 1.0 / (notes.iter().filter(together).count() as f32).sqrt();
        for (out, sample) in samples[first..].iter_mut().zip(&struck) {
            *out += share * sample;
        }
    }
    samples
}

/// How long after the event something sounds, what, and at which speed.
fn note(kind: &EventKind) -> Option<(f64, Voice, f64)> {
    Some(match *kind {
        EventKind::Strike { speed_m_s } => (0.0, Voice::Tip, speed_m_s),
        EventKind::Miscue { .. } => (0.0, Voice::Slip, 1.5),
        EventKind::BallBall { speed_m_s, .. } => (0.0, Voice::Ball, speed_m_s),
        EventKind::Cushion { speed_m_s, .. } => (0.0, Voice::Cushion, speed_m_s),
        EventKind::Pocketed { speed_m_s, .. } => {
            (0.0, Voice::Pocket, speed_m_s.max(POCKET_FALL_M_S))
        }
        EventKind::Bounces {
            surface, speed_m_s, ..
        } => {
            let voice = match surface {
                Surface::Cloth => Voice::Slate,
                Surface::Rail => Voice::Rail,
                Surface::Pocket => Voice::Pocket,
            };
            (0.0, voice, speed_m_s)
        }
        EventKind::LeftTable { point, .. } => {
            // From the table's height and its own, to the floor.
            let height_m = TABLE_HEIGHT_M + point.z.max(0.0);
            let fall_m_s = (2.0 * GRAVITY_M_S2 * height_m).sqrt();
            (fall_m_s / GRAVITY_M_S2, Voice::Floor, fall_m_s)
        }
        EventKind::Rolls { .. } | EventKind::Rests { .. } => return None,
    })
}

/// Softer contacts are lost in the room.
const AUDIBLE_M_S: f64 = 0.02;
/// Within the ring of a click.
const TOGETHER_SECS: f64 = 2e-3;
const SPEED_M_S_MAX: f64 = 60.0;
/// Longer than any shot.
const SECS_MAX: f64 = 120.0;
/// Down a pocket of 60 mm.
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

    /// The first sample over a hundredth within `secs` of a moment.
    fn onset(sound: &Sound, moment_secs: f64, secs: f64) -> Option<f64> {
        let rate = f64::from(RATE_HZ);
        let first = ((moment_secs - secs).max(0.0) * rate) as usize;
        let last = (((moment_secs + secs) * rate) as usize).min(sound.samples.len());
        let found = sound.samples[first..last]
            .iter()
            .position(|sample| sample.abs() > 0.01)?;
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
        let peak = sound
            .samples
            .iter()
            .fold(0.0_f32, |peak, s| peak.max(s.abs()));
        assert!((0.6..1.0).contains(&peak), "{peak}");
        let end = &sound.samples[sound.samples.len() - 100..];
        assert!(end.iter().all(|sample| sample.abs() < 2e-3));
    }

    #[test]
    fn a_soft_shot_is_softer() {
        let loudness = |speed: f64| {
            let sound = of_shot(&break_shot(speed));
            sound
                .samples
                .iter()
                .fold(0.0_f32, |peak, s| peak.max(s.abs()))
        };
        let (soft, loud) = (loudness(1.0), loudness(8.0));
        assert!(soft < 0.4 * loud, "{soft} against {loud}");
    }
}
