//! Input of a stroke: three ways to control its speed.

use super::aim::{CUE_SPEED_M_S_MAX, power_of_speed};
use super::cue::DRAW_M;

/// A stroke in progress.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum StrokeInput {
    /// The pointer draws the cue back to a share from 0 to 1 of its travel; release strikes.
    Pulling(f64),
    /// The power rises with time since the given one; release strikes.
    Charging(f64),
    /// The pointer moves the cue back and forth; it strikes when the tip reaches the ball.
    Swinging(SwingInput),
}

/// State of a swing, in which the cue follows the pointer.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct SwingInput {
    back_m: f64,
    /// Recent times in s, with the distances in m by which the tip was drawn back.
    trail: Vec<(f64, f64)>,
}

impl StrokeInput {
    /// The power of the stroke at `now_secs`, 0 to 1; none for a swing.
    pub(super) fn power(&self, now_secs: f64) -> Option<f64> {
        match *self {
            Self::Pulling(power) => Some(power),
            Self::Charging(since) => Some(((now_secs - since) / CHARGE_SECS).clamp(0.0, 1.0)),
            Self::Swinging(_) => None,
        }
    }

    /// Distance by which the tip is drawn back, in m.
    pub(super) fn drawn_m(&self, now_secs: f64) -> f64 {
        match self {
            Self::Swinging(swing) => swing.back_m,
            _ => DRAW_M * self.power(now_secs).unwrap_or(0.0),
        }
    }

    /// The power with which a release strikes, if it does.
    pub(super) fn let_go(&self, now_secs: f64) -> Option<f64> {
        let power = self.power(now_secs)?;
        let is_drawn = power >= PULL_MIN || matches!(self, Self::Charging(_));
        is_drawn.then_some(power)
    }
}

impl SwingInput {
    /// Moves the cue back by a distance in m, forward if negative. Returns the power of the stroke when the
    /// tip has reached the ball, by the mean speed over [`SPEED_SECS`].
    pub(super) fn swing(&mut self, back_m: f64, now_secs: f64) -> Option<f64> {
        // Within its recent motion, the tip must have been drawn back before it strikes.
        let farthest = self.trail.iter().map(|(_, back)| *back).fold(0.0, f64::max);
        let back = (self.back_m + back_m).min(BACK_M_MAX);
        if back > 0.0 || farthest < BACK_M_MIN {
            self.back_m = back.max(0.0);
            self.trail.push((now_secs, self.back_m));
            let recent = |(at, _): &(f64, f64)| now_secs - at <= SPEED_SECS;
            self.trail.retain(recent);
            return None;
        }
        let &(since_secs, from_m) = self.trail.first()?;
        let secs = (now_secs - since_secs).max(1e-3);
        let speed_m_s = (from_m - back) / secs;
        Some(power_of_speed(speed_m_s.min(CUE_SPEED_M_S_MAX)))
    }
}

/// Least pull, as a share of the cue's travel, with which a release strikes.
pub(super) const PULL_MIN: f64 = 0.03;
/// Time in which a charge reaches full power.
const CHARGE_SECS: f64 = 1.6;
/// Time over which the speed of a swing is averaged: several reports of a slow mouse.
const SPEED_SECS: f64 = 0.06;
/// Largest distance by which a swing draws the cue back.
const BACK_M_MAX: f64 = 0.3;
/// Least distance by which a swing must draw the cue back before it strikes.
const BACK_M_MIN: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::super::aim::cue_speed_m_s;
    use super::*;

    /// Draws back and pushes forward at a speed, reported every 8 ms; the cue's speed at the ball.
    fn speed_of_stroke(speed_m_s: f64) -> Option<f64> {
        let (mut swing, mut now) = (SwingInput::default(), 1.0);
        for _ in 0..20 {
            now += 0.008;
            assert_eq!(swing.swing(0.01, now), None);
        }
        for _ in 0..1000 {
            now += 0.008;
            if let Some(power) = swing.swing(-0.008 * speed_m_s, now) {
                return Some(cue_speed_m_s(power));
            }
        }
        None
    }

    #[test]
    fn the_cue_strikes_with_the_speed_of_the_hand() {
        for speed in [0.3, 1.0, 2.5] {
            let struck = speed_of_stroke(speed).unwrap();
            // The turn of the hand lies within the mean for the fastest.
            assert!((struck / speed - 1.0).abs() < 0.12, "{struck} for {speed}");
        }
        assert!(speed_of_stroke(1000.0).unwrap() <= CUE_SPEED_M_S_MAX);
    }

    #[test]
    fn a_cue_that_was_not_drawn_back_does_not_strike() {
        let mut swing = SwingInput::default();
        assert_eq!(swing.swing(-0.5, 1.0), None);
        assert_eq!(swing.swing(0.005, 1.01), None);
        assert_eq!(swing.swing(-0.5, 1.02), None);
    }
}
