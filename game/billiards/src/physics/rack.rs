//! The rack of eight-ball: the balls at the start.

use std::f64::consts::TAU;

use glam::{DQuat, DVec2};

use crate::rng::pcg4d;

use super::{ball::BallState, table::Table};
use crate::deterministic_math::unit_at;

/// The balls of a game and where they lie.
#[derive(Clone, Debug, PartialEq)]
pub struct BallLayout {
    /// All at rest; numbers are unique.
    pub balls: Vec<BallState>,
}

impl Table {
    /// The rack of eight-ball: fifteen balls behind the foot spot with the 8 in the middle and one
    /// solid and one striped ball in the far corners; the cue ball on the head spot.
    ///
    /// The seed draws the order, how each ball is turned, and the gaps of 20–60 µm that real
    /// racks have: they decide how a rack breaks.
    pub fn rack_eight(&self, seed: u32) -> BallLayout {
        let body = self.ball();
        let mut draw = Draw { seed, drawn: 0 };
        let numbers = order_eight(&mut draw);
        let pitch = 2.0 * body.radius_m + RACK_GAP_M;
        let mut balls = Vec::with_capacity(16);
        let head = self.head_spot();
        balls.push(turned(
            BallState::at_rest(0, head.x, head.y, &self.cue_ball()),
            &mut draw,
        ));
        let mut numbers = numbers.into_iter();
        for row in 0..5u8 {
            for place in 0..=row {
                let number = numbers.next().unwrap_or(0);
                let spot = self.foot_spot()
                    + pitch
                        * DVec2::new(
                            f64::from(row) * 0.75f64.sqrt(),
                            f64::from(place) - 0.5 * f64::from(row),
                        );
                let offset = 0.25 * RACK_GAP_M * unit_at(TAU * draw.unit());
                let place = spot + draw.unit() * offset;
                let ball = BallState::at_rest(number, place.x, place.y, &body);
                balls.push(turned(ball, &mut draw));
            }
        }
        BallLayout { balls }
    }
}

/// Numbers by place, from the apex row by row.
fn order_eight(draw: &mut Draw) -> [u8; 15] {
    const MIDDLE: usize = 4;
    const CORNERS: [usize; 2] = [10, 14];
    let mut solids = draw.shuffled([1, 2, 3, 4, 5, 6, 7]).to_vec();
    let mut stripes = draw.shuffled([9, 10, 11, 12, 13, 14, 15]).to_vec();
    let solid_left = usize::from(draw.unit() < 0.5);
    let mut order = [8; 15];
    order[CORNERS[solid_left]] = solids.pop().unwrap_or(8);
    order[CORNERS[1 - solid_left]] = stripes.pop().unwrap_or(8);
    solids.extend(stripes);
    let rest: [u8; 12] = std::array::from_fn(|i| solids[i]);
    let places = (0..15).filter(|place| *place != MIDDLE && !CORNERS.contains(place));
    for (place, number) in places.zip(draw.shuffled(rest)) {
        order[place] = number;
    }
    order
}

fn turned(ball: BallState, draw: &mut Draw) -> BallState {
    BallState {
        orientation: draw.rotation(),
        ..ball
    }
}

/// Numbers as a hash of the seed and how many were drawn.
struct Draw {
    seed: u32,
    drawn: u32,
}

impl Draw {
    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        self.drawn += 1;
        let [word, ..] = pcg4d([self.drawn, self.seed, RACK_STREAM, 0]);
        f64::from(word) / 4_294_967_296.0
    }

    /// Fisher and Yates.
    fn shuffled<const N: usize>(&mut self, mut items: [u8; N]) -> [u8; N] {
        for last in (1..N).rev() {
            let other = (self.unit() * (last + 1) as f64) as usize;
            items.swap(last, other.min(last));
        }
        items
    }

    /// Uniform over all rotations: Shoemake, "Uniform random rotations", Graphics Gems III.
    fn rotation(&mut self) -> DQuat {
        let (radius, first, second) = (self.unit(), self.unit(), self.unit());
        let (first, second) = (unit_at(TAU * first), unit_at(TAU * second));
        let (low, high) = ((1.0 - radius).sqrt(), radius.sqrt());
        DQuat::from_xyzw(
            low * first.y,
            low * first.x,
            high * second.y,
            high * second.x,
        )
        .normalize()
    }
}

/// Keeps these numbers apart from others drawn with the same seed.
const RACK_STREAM: u32 = 0x7261_636b;
/// The mean gap between neighbours.
const RACK_GAP_M: f64 = 40e-6;
