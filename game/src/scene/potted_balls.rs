//! Positions of potted balls, stacked in their pockets.

use carom_billiards::physics::{BallPose, Pocket, Table};
use glam::DVec3;

use super::scene_builder::POCKET_DEPTH_M;

/// Numbers and centres of the balls of `poses` that lie in pockets. The balls of a
/// pocket are stacked in the order of their numbers; those for which there is no room are left out.
pub(super) fn potted_balls(table: &Table, poses: &[BallPose]) -> Vec<(u8, DVec3)> {
    let mut potted = Vec::new();
    for pocket in table.pockets() {
        let is_inside = |pose: &&BallPose| {
            let from_axis = pose.position.truncate() - pocket.center;
            !pose.on_table && from_axis.length() < pocket.radius_m
        };
        let mut numbers: Vec<u8> = poses.iter().filter(is_inside).map(|p| p.number).collect();
        numbers.sort_unstable();
        potted.extend(numbers.into_iter().zip(places(table, pocket)));
    }
    potted
}

/// Centres of balls that fill a pocket from its floor to the cloth: in a wide one layers of two,
/// alternately at right angles, in a narrow one each ball against the wall opposite to that of the one
/// below.
fn places(table: &Table, pocket: &Pocket) -> impl Iterator<Item = DVec3> {
    let radius = table.ball().radius_m.max(table.cue_ball().radius_m);
    let aside = (pocket.radius_m - radius - GAP_M).clamp(0.0, radius + GAP_M);
    let holds_pairs = aside > radius;
    let rise = if holds_pairs {
        std::f64::consts::SQRT_2 * radius
    } else {
        // Balls alternate between two sides, 2·aside apart: next neighbours touch at a rise of 2√(r² −
        // aside²), and those on the same side, two layers apart, need a rise of at least r.
        radius.max(2.0 * (radius * radius - aside * aside).sqrt())
    };
    let lowest = radius + GAP_M - f64::from(POCKET_DEPTH_M);
    let center = move |index: u32| {
        let layer = if holds_pairs { index / 2 } else { index };
        let across = match holds_pairs && layer % 2 == 1 {
            true => pocket.mouth,
            false => pocket.mouth.perp(),
        };
        let side = if index.is_multiple_of(2) {
            aside
        } else {
            -aside
        };
        let height = lowest + f64::from(layer) * (rise + GAP_M);
        (pocket.center + side * across).extend(height)
    };
    (0..)
        .map(center)
        .take_while(move |center| center.z + radius < 0.0)
}

/// Gap between balls and their supports, as coincident surfaces would flicker.
const GAP_M: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn potted_balls_lie_in_their_pockets_and_touch_nothing() {
        for table in [
            Table::nine_foot(),
            Table::parse(include_str!("../../../assets/tables/snooker.json")).unwrap(),
        ] {
            let pockets = table.pockets();
            let pose = |number: u8| BallPose {
                number,
                position: pockets[usize::from(number) % 2].center.extend(-0.1),
                rotation: DQuat::IDENTITY,
                on_table: number == 1,
            };
            let poses: Vec<_> = (0..16).rev().map(pose).collect();
            let potted = potted_balls(&table, &poses);
            let radius = table.ball().radius_m;
            assert!(potted.len() >= 6, "{potted:?}");
            assert!(potted.iter().all(|(number, _)| *number != 1));
            for (index, (number, center)) in potted.iter().enumerate() {
                let pocket = &pockets[usize::from(*number) % 2];
                let from_axis = center.truncate().distance(pocket.center);
                assert!(from_axis + radius < pocket.radius_m, "{center}");
                assert!(center.z + radius < 0.0, "{center}");
                assert!(center.z - radius > -f64::from(POCKET_DEPTH_M), "{center}");
                for (_, other) in &potted[..index] {
                    assert!(center.distance(*other) > 2.0 * radius, "{center} {other}");
                }
            }
        }
    }

    #[test]
    fn balls_off_the_table_lie_in_no_pocket() {
        let table = Table::nine_foot();
        let pose = BallPose {
            number: 3,
            position: DVec3::new(0.0, 1.5, -0.7),
            rotation: DQuat::IDENTITY,
            on_table: false,
        };
        assert!(potted_balls(&table, &[pose]).is_empty());
    }
}
