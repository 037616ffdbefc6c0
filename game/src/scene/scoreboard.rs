//! Scoreboard on the far wall: a clock between two dials with the players' scores.

use carom_billiards::game_match::Match;
use carom_tracer::texture::DIAL_SPACING;
use carom_tracer::{ProceduralTexture, Shape};
use glam::{Quat, Vec3};

/// Reading of the scoreboard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScoreReading {
    /// Racks, frames or points of the first two players.
    pub scores: [i32; 2],
    /// Minutes since eight o'clock.
    pub minutes: u32,
}

impl ScoreReading {
    /// The reading of a match. The clock starts at eight and advances by a minute with each stroke, so that
    /// it does not move while the table is at rest.
    pub fn of(contest: &Match) -> Self {
        let scores = contest.referee().scores();
        Self {
            scores: [0, 1].map(|player| scores.get(player).copied().unwrap_or(0)),
            minutes: contest.turns().len() as u32,
        }
    }
}

/// Scoreboard at a position on the wall.
#[derive(Clone, Copy, Debug)]
pub struct Scoreboard {
    /// Centre of its clock, in front of the wall, metres.
    pub center: Vec3,
}

/// Pose of a hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandPose {
    /// Position of its tip, metres.
    pub tip: Vec3,
    /// Rotation of its object (`world_from_cone`).
    pub rotation: Quat,
}

impl Scoreboard {
    /// Shape of the board.
    pub fn shape(&self) -> Shape {
        let half = Vec3::new(0.0, DIAL_SPACING_M, 0.0) + Vec3::splat(DIAL_RADIUS_M + BOARD_RIM_M);
        Shape::Box {
            min: (self.center - half).with_x(self.center.x),
            max: (self.center + half).with_x(self.center.x + BOARD_M),
        }
    }

    /// Texture with the dials.
    pub fn texture(&self) -> ProceduralTexture {
        ProceduralTexture::Scoreboard {
            face: Vec3::new(0.62, 0.59, 0.5),
            ink: Vec3::new(0.03, 0.02, 0.014),
            center: [self.center.y, self.center.z],
            radius: DIAL_RADIUS_M,
        }
    }

    /// Poses of the hands, dial by dial: a short one for tens or hours and a long one for units or minutes.
    pub fn hands(&self, reading: ScoreReading) -> [HandPose; 6] {
        let turns = |units: i32, round: i32| units.rem_euclid(round) as f32 / round as f32;
        let minutes = (8 * 60 + reading.minutes) as i32;
        let [score, other_score] = reading.scores;
        let turns = [
            turns(score, 100),
            turns(score, 10),
            turns(minutes, 12 * 60),
            turns(minutes, 60),
            turns(other_score, 100),
            turns(other_score, 10),
        ];
        std::array::from_fn(|hand| self.hand(HANDS[hand], turns[hand]))
    }

    /// Shapes of the hands before a match, in the order of [`Scoreboard::hands`].
    pub fn hand_shapes(&self) -> [Shape; 6] {
        let poses = self.hands(ScoreReading::default());
        std::array::from_fn(|hand| Shape::TruncatedCone {
            center: poses[hand].tip,
            rotation: poses[hand].rotation,
            length: HANDS[hand].1 + TAIL_M,
            radii: HAND_RADII_M,
        })
    }

    /// Pose of one of [`HANDS`] that points `turns` clockwise from the top, seen along +x.
    fn hand(&self, (aside, length): (f32, f32), turns: f32) -> HandPose {
        let (sin, cos) = (std::f32::consts::TAU * turns).sin_cos();
        let direction = Vec3::new(0.0, -sin, cos);
        let middle = self.center + Vec3::new(-HAND_GAP_M, aside * DIAL_SPACING_M, 0.0);
        HandPose {
            tip: middle + length * direction,
            rotation: Quat::from_rotation_arc(Vec3::Z, -direction),
        }
    }
}

/// Name of the hands' objects.
pub const HAND_NAME: &str = "hand";
const DIAL_RADIUS_M: f32 = 0.16;
const DIAL_SPACING_M: f32 = DIAL_SPACING * DIAL_RADIUS_M;
const BOARD_M: f32 = 0.02;
const BOARD_RIM_M: f32 = 0.03;
/// Each hand's dial, as an offset from the clock towards +y in dials, and its length from the centre.
const HANDS: [(f32, f32); 6] = [
    (1.0, SHORT_HAND_M),
    (1.0, LONG_HAND_M),
    (0.0, SHORT_HAND_M),
    (0.0, LONG_HAND_M),
    (-1.0, SHORT_HAND_M),
    (-1.0, LONG_HAND_M),
];
const SHORT_HAND_M: f32 = 0.078;
const LONG_HAND_M: f32 = 0.125;
/// Radii of a hand at its tip and at its other end.
const HAND_RADII_M: [f32; 2] = [0.003, 0.006];
/// Length of a hand beyond the dial's centre.
const TAIL_M: f32 = 0.02;
/// Distance from a dial to the axis of its hands.
const HAND_GAP_M: f32 = 0.012;

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the hands point, in turns clockwise from the top.
    fn turns(reading: ScoreReading) -> [f32; 6] {
        let board = Scoreboard {
            center: Vec3::new(6.0, 0.5, 0.7),
        };
        board.hands(reading).map(|pose| {
            let direction = pose.rotation * Vec3::NEG_Z;
            assert!(direction.x.abs() < 1e-6);
            (-direction.y)
                .atan2(direction.z)
                .rem_euclid(std::f32::consts::TAU)
                / std::f32::consts::TAU
        })
    }

    fn is_close(found: [f32; 6], wanted: [f32; 6]) -> bool {
        let aside = |(a, b): (f32, f32)| ((a - b).abs() - (a - b).abs().round()).abs();
        found.into_iter().zip(wanted).all(|pair| aside(pair) < 1e-5)
    }

    #[test]
    fn hands_show_tens_and_units_and_the_time() {
        let before = turns(ScoreReading::default());
        assert!(
            is_close(before, [0.0, 0.0, 8.0 / 12.0, 0.0, 0.0, 0.0]),
            "{before:?}"
        );
        let later = turns(ScoreReading {
            scores: [37, 105],
            minutes: 75,
        });
        let wanted = [0.37, 0.7, 9.25 / 12.0, 0.25, 0.05, 0.5];
        assert!(is_close(later, wanted), "{later:?}");
    }

    #[test]
    fn a_score_below_zero_turns_back_from_the_top() {
        let found = turns(ScoreReading {
            scores: [-2, 0],
            minutes: 0,
        });
        assert!(
            is_close(found, [0.98, 0.8, 8.0 / 12.0, 0.0, 0.0, 0.0]),
            "{found:?}"
        );
    }
}
