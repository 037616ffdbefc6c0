//! The racks: the balls at the start of each game.

use std::f64::consts::TAU;

use glam::DVec2;

use crate::deterministic_math::unit_at;
use crate::rng::CounterRng;

use super::{
    drills::drill_layout,
    layout::{BallPosition, BallPositions, PlacementArea, TableLayout},
    ruleset::RuleSet,
    spots::own_spot,
};

/// The balls of a game at its start, the cue ball last. The seed draws what the rules leave open, and
/// gaps of 20 to 60 µm between racked balls, as real racks have: they decide the outcome of a break.
///
/// 8-ball: WPA 3.2; 9-ball: 2.2; straight pool: 4.2; snooker: WPBSA 3.2; three-cushion: UMB 23.
pub fn rack(rules: RuleSet, layout: &TableLayout, seed: u32) -> BallPositions {
    let mut rng = CounterRng::new(seed, RACK);
    let apex = layout.foot_spot();
    let mut positions = match rules {
        RuleSet::Free | RuleSet::Eight => {
            let order = order_eight(&mut rng);
            triangle(layout, apex, &TRIANGLE, &order, &mut rng)
        }
        RuleSet::Nine => {
            let mut others = [2, 3, 4, 5, 6, 7, 8];
            rng.shuffle(&mut others);
            let [a, b, c, d, e, f, g] = others;
            let order = [1, a, b, c, 9, d, e, f, g];
            triangle(layout, apex, &[1, 2, 3, 2, 1], &order, &mut rng)
        }
        RuleSet::Straight => {
            let mut order: Vec<u8> = (1..=15).collect();
            rng.shuffle(&mut order);
            triangle(layout, apex, &TRIANGLE, &order, &mut rng)
        }
        RuleSet::Snooker => snooker(layout, &mut rng),
        RuleSet::ThreeCushion => carom(layout),
        RuleSet::LineUp | RuleSet::SpotShots | RuleSet::PositionPlay | RuleSet::DailyShot => {
            drill_layout(rules, layout, &mut rng)
        }
    };
    if positions.iter().all(|p| p.ball != 0) {
        let area = rules.info().start.unwrap_or(PlacementArea::Anywhere);
        let at = layout.place_in_hand(&positions, area);
        positions.push(BallPosition { ball: 0, at });
    }
    positions
}

/// Straight pool's fourteen balls with the apex left open (WPA 4.4): those of `balls` at the other
/// places.
pub(crate) fn rack_of_fourteen(layout: &TableLayout, balls: &[u8], seed: u32) -> BallPositions {
    let mut rng = CounterRng::new(seed, RACK);
    let mut order: Vec<u8> = balls.to_vec();
    rng.shuffle(&mut order);
    order.insert(0, 0);
    let whole = triangle(layout, layout.foot_spot(), &TRIANGLE, &order, &mut rng);
    whole.into_iter().skip(1).collect()
}

/// Whether a ball that lies there is in the way of a rack of fifteen: within the triangle, or
/// touching a ball of it.
pub(crate) fn is_in_rack(layout: &TableLayout, at: DVec2, radius_m: f64) -> bool {
    let pitch = 2.0 * layout.radius_m + GAP_M;
    let depth = 4.0 * pitch * ROW;
    let along = at.x - layout.foot_spot().x;
    let across = at.y.abs();
    // The triangle through the centres of the corner balls, grown by the radii of a ball of the rack
    // and of this ball.
    let grown = radius_m + layout.radius_m;
    let slope = 0.5 / ROW;
    let side = (across - along * slope) / (1.0 + slope * slope).sqrt();
    (-grown..=depth + grown).contains(&along) && side < grown
}

fn snooker(layout: &TableLayout, rng: &mut CounterRng) -> BallPositions {
    let pink = own_spot(RuleSet::Snooker, layout, 20);
    let apex = pink + DVec2::new(2.0 * layout.radius_m + GAP_M, 0.0);
    let reds: Vec<u8> = (1..=15).collect();
    let mut positions = triangle(layout, apex, &TRIANGLE, &reds, rng);
    positions.extend((16..=21).map(|ball| BallPosition {
        ball,
        at: own_spot(RuleSet::Snooker, layout, ball),
    }));
    positions
}

/// The player's ball on a starting spot 182.5 mm beside the other's, the red on the foot spot.
fn carom(layout: &TableLayout) -> BallPositions {
    let head = layout.head_spot();
    let beside = DVec2::new(0.0, -0.1825);
    [(0, head + beside), (1, head), (2, layout.foot_spot())]
        .map(|(ball, at)| BallPosition { ball, at })
        .to_vec()
}

/// Balls in rows of these lengths, from the apex towards the foot.
fn triangle(
    layout: &TableLayout,
    apex: DVec2,
    rows: &[u8],
    order: &[u8],
    rng: &mut CounterRng,
) -> BallPositions {
    let pitch = 2.0 * layout.radius_m + GAP_M;
    let places = rows.iter().enumerate().flat_map(|(row, &width)| {
        (0..width).map(move |i| {
            let across = f64::from(i) - 0.5 * f64::from(width - 1);
            DVec2::new(row as f64 * ROW, across)
        })
    });
    let mut moved = |at: DVec2| {
        let offset = 0.25 * GAP_M * unit_at(TAU * rng.unit());
        apex + pitch * at + rng.unit() * offset
    };
    order
        .iter()
        .zip(places)
        .map(|(&ball, at)| BallPosition {
            ball,
            at: moved(at),
        })
        .collect()
}

/// Order of the balls by place: the 8 in the middle, a ball of each group in the far corners, the rest
/// at random.
fn order_eight(rng: &mut CounterRng) -> Vec<u8> {
    let mut solids = [1, 2, 3, 4, 5, 6, 7];
    let mut stripes = [9, 10, 11, 12, 13, 14, 15];
    rng.shuffle(&mut solids);
    rng.shuffle(&mut stripes);
    let mut corners = [solids[6], stripes[6]];
    rng.shuffle(&mut corners);
    let mut rest: Vec<u8> = [&solids[..6], &stripes[..6]].concat();
    rng.shuffle(&mut rest);
    // Row by row from the apex, place 4 is the middle of the third row, 10 and 14 are the ends of the
    // last.
    rest.insert(4, 8);
    rest.insert(10, corners[0]);
    rest.push(corners[1]);
    rest
}

const TRIANGLE: [u8; 5] = [1, 2, 3, 4, 5];
/// Distance between rows, in pitches: half the root of 3.
const ROW: f64 = 0.866_025_403_784_438_6;
/// Mean gap between neighbours.
const GAP_M: f64 = 40e-6;
/// Random stream of racks, apart from others with the same seed.
const RACK: u32 = 0x7261_636b;
