//! Skill of a level: the errors of its strokes, and the extent of its search.

use super::Level;
use crate::physics::Stroke;
use crate::rng::CounterRng;

/// Parameters of a level.
///
/// The errors are normally distributed, in the proportion of the errors at the Computer Olympiad's pool
/// tournaments: 0.125° of direction, 0.1° of elevation, 0.5 mm of the tip each way (Stanford's FastFiz,
/// `GaussianNoise`, at magnitude 1). Its 0.075 m/s of speed are here a share of the speed, equal at 2
/// m/s: people control a soft stroke better than a hard one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skill {
    /// Standard deviations in multiples of the tournament's. Higher: misses more.
    pub error: f64,
    /// Number of shots to simulate before a stroke. Higher: finds better strokes, takes longer; a shot
    /// takes about 0.1 to 1 ms.
    pub shots: u32,
    /// Number of strokes that are evaluated again under the player's own error, and trials of each.
    /// Higher: takes fewer risks.
    pub trials: (usize, u32),
    /// Weight of the next shot, 0 to 1.
    pub foresight: f64,
    /// Cost of a stroke that is no break, in the value of a shot: this much at 10 m/s, and as much for
    /// a tip offset of one radius, each in proportion to its square. Higher: plays softer and plainer,
    /// as a teacher would.
    pub effort: f64,
}

impl From<Level> for Skill {
    fn from(level: Level) -> Self {
        let (error, shots, trials, foresight) = match level {
            Level::Easy => (8.0, 24, (1, 1), 0.0),
            Level::Medium => (3.0, 60, (3, 3), 0.3),
            Level::Hard => (1.0, 150, (5, 6), 0.6),
            Level::Expert => (0.4, 300, (6, 10), 0.7),
        };
        Self {
            error,
            shots,
            trials,
            foresight,
            effort: 0.0,
        }
    }
}

impl Skill {
    /// The actual stroke of an intended one: with random errors.
    pub fn add_error(&self, stroke: Stroke, rng: &mut CounterRng) -> Stroke {
        let mut off = |deviation: f64| self.error * deviation * rng.normal();
        let strayed = Stroke {
            direction_rad: stroke.direction_rad + off(DIRECTION_RAD),
            speed_m_s: (stroke.speed_m_s * (1.0 + off(SPEED_SHARE)))
                .clamp(SPEED_M_S_MIN, Stroke::SPEED_MAX_M_S),
            side: stroke.side + off(TIP_RADII),
            vertical: stroke.vertical + off(TIP_RADII),
            elevation_rad: (stroke.elevation_rad + off(ELEVATION_RAD))
                .clamp(0.0, Stroke::ELEVATION_MAX_RAD),
        };
        // Errors do not make the tip slip: the offset stays below the miscue limit.
        let share = (TIP_RADII_MAX / strayed.offset()).min(1.0);
        Stroke {
            side: strayed.side * share,
            vertical: strayed.vertical * share,
            ..strayed
        }
    }

    /// Standard deviation of the cue's direction, in rad.
    pub(crate) fn direction_rad(&self) -> f64 {
        self.error * DIRECTION_RAD
    }
}

const DIRECTION_RAD: f64 = 0.125 * std::f64::consts::PI / 180.0;
const ELEVATION_RAD: f64 = 0.1 * std::f64::consts::PI / 180.0;
/// 0.5 mm of a pool ball's radius.
const TIP_RADII: f64 = 0.5 / 28.575;
const SPEED_SHARE: f64 = 0.075 / 2.0;
const SPEED_M_S_MIN: f64 = 0.1;
const TIP_RADII_MAX: f64 = 0.5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_errs_as_much_as_it_says() {
        for level in Level::ALL {
            let skill = Skill::from(level);
            let mut rng = CounterRng::new(5, 0);
            let meant = Stroke::straight(1.0, 2.0);
            let squares: f64 = (0..4000)
                .map(|_| (skill.add_error(meant, &mut rng).direction_rad - 1.0).powi(2))
                .sum();
            let deviation = (squares / 4000.0).sqrt();
            let wanted = skill.error * 0.125f64.to_radians();
            assert!((deviation / wanted - 1.0).abs() < 0.05, "{level:?}");
        }
    }

    #[test]
    fn no_stray_stroke_is_refused_or_slips() {
        let skill = Skill {
            error: 50.0,
            ..Level::Easy.into()
        };
        let mut rng = CounterRng::new(1, 2);
        for _ in 0..1000 {
            let stroke = skill.add_error(Stroke::straight(0.3, 19.0), &mut rng);
            stroke.validate().unwrap();
            assert!(stroke.offset() <= TIP_RADII_MAX + 1e-12);
        }
    }
}
