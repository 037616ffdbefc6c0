//! Listener: a spherical head at the table's end, with a delay and a level for each ear.
//!
//! The head delays sound from the other side by up to 0.26 ms and attenuates it by up to 10 dB (Brown and
//! Duda, "A structural model for binaural sound synthesis", 1998; the shadow here is their value at middle
//! frequencies).

use glam::DVec3;

/// An ear of the listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ear {
    Left,
    Right,
}

impl Ear {
    pub(super) const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// Outward direction of the ear; the listener looks along +x.
    fn axis(self) -> DVec3 {
        match self {
            Self::Left => DVec3::Y,
            Self::Right => DVec3::NEG_Y,
        }
    }

    /// Position, in metres from the centre of the cloth.
    pub(super) fn place(self) -> DVec3 {
        HEAD_M + HEAD_RADIUS_M * self.axis()
    }

    /// Delay of sound from a place relative to the head's centre, in seconds, and gain relative to sound
    /// from the table's centre at the head's centre.
    pub(super) fn hears(self, place: DVec3) -> (f64, f32) {
        let (to_head, to_ear) = (HEAD_M.distance(place), self.place().distance(place));
        let facing = (place - HEAD_M).normalize_or_zero().dot(self.axis());
        let shadow = 1.0 + SHADOW * facing;
        let gain = shadow * HEAD_M.length() / to_ear.max(NEAREST_M);
        ((to_ear - to_head) / SOUND_M_S, gain as f32)
    }
}

/// Centre of the head, in metres from the centre of the cloth.
pub(super) const HEAD_M: DVec3 = DVec3::new(-2.0, -0.2, 0.7);
pub(super) const SOUND_M_S: f64 = 343.0;
const HEAD_RADIUS_M: f64 = 0.0875;
/// Half of the difference in gain between an ear that faces a sound and one that is turned away.
const SHADOW: f64 = 0.5;
/// Least distance from an ear in the distance law, in metres, below those on the table.
const NEAREST_M: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_near_ear_hears_earlier_and_louder() {
        let [left, right] = Ear::BOTH.map(|ear| ear.hears(DVec3::new(-1.0, 0.6, 0.0)));
        assert!(
            left.0 < right.0 && left.1 > 1.3 * right.1,
            "{left:?} {right:?}"
        );
        assert!((right.0 - left.0) < 6e-4);
    }

    #[test]
    fn what_is_ahead_is_heard_by_both_alike() {
        let ahead = HEAD_M + DVec3::X;
        assert_eq!(Ear::Left.hears(ahead), Ear::Right.hears(ahead));
        let farther = Ear::Left.hears(HEAD_M + 3.0 * DVec3::X);
        assert!((Ear::Left.hears(ahead).1 / farther.1 - 3.0).abs() < 0.05);
    }
}
