//! The rack of eight-ball: the balls at the start.

use std::f64::consts::TAU;

use glam::DVec2;

use super::{ball::BallState, table::Table};
use crate::{deterministic_math::unit_at, rng::CounterRng};

/// The balls of a game and their positions.
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
        let mut rng = CounterRng::in_domain(seed, RACK_STREAM, RACK_DOMAIN);
        let numbers = order_eight(&mut rng);
        let pitch = 2.0 * self.ball().radius_m + RACK_GAP_M;
        let mut balls = Vec::with_capacity(16);
        balls.push(turned(self.resting_ball(0, self.head_spot()), &mut rng));
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
                // Up to a quarter of the mean gap each, so that gaps range from 20 to 60 µm.
                let offset = 0.25 * RACK_GAP_M * unit_at(TAU * rng.unit());
                let place = spot + rng.unit() * offset;
                balls.push(turned(self.resting_ball(number, place), &mut rng));
            }
        }
        BallLayout { balls }
    }
}

/// Numbers by place, from the apex row by row.
fn order_eight(rng: &mut CounterRng) -> [u8; 15] {
    const MIDDLE: usize = 4;
    const CORNERS: [usize; 2] = [10, 14];
    let (mut solids, mut stripes) = ([1, 2, 3, 4, 5, 6, 7], [9, 10, 11, 12, 13, 14, 15]);
    rng.shuffle(&mut solids);
    rng.shuffle(&mut stripes);
    let solid_left = usize::from(rng.unit() < 0.5);
    let mut order = [8; 15];
    order[CORNERS[solid_left]] = solids[6];
    order[CORNERS[1 - solid_left]] = stripes[6];
    let mut rest = [&solids[..6], &stripes[..6]].concat();
    rng.shuffle(&mut rest);
    let places = (0..15).filter(|place| *place != MIDDLE && !CORNERS.contains(place));
    for (place, number) in places.zip(rest) {
        order[place] = number;
    }
    order
}

fn turned(ball: BallState, rng: &mut CounterRng) -> BallState {
    BallState {
        orientation: rng.rotation(),
        ..ball
    }
}

/// Random stream of racks, apart from others with the same seed.
const RACK_STREAM: u32 = 0x7261_636b;
/// Random domain of racks; reference pictures and measured breaks depend on its bits.
const RACK_DOMAIN: u32 = 0;
/// Mean gap between neighbours.
const RACK_GAP_M: f64 = 40e-6;
