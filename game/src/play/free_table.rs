//! What happens between shots where no rules are played: a scratched cue ball comes back.

use glam::DVec2;

use crate::sim::World;

/// Makes the table ready for the next stroke; a sentence if something was done.
pub(super) fn settle(world: &mut World) -> Option<String> {
    let balls = world.balls();
    let is_out = |number: u8| {
        balls
            .iter()
            .any(|b| b.number == number && !b.phase.is_on_table())
    };
    if !is_out(0) {
        return None;
    }
    let others: Vec<DVec2> = balls
        .iter()
        .filter(|ball| ball.phase.is_on_table())
        .map(|ball| ball.position.truncate())
        .collect();
    let table = world.table();
    let spot = free_spot(table.head_spot(), table.cue_ball().radius_m, &others);
    Some(match world.place(0, spot.x, spot.y) {
        Ok(()) => "Scratch: the cue ball is back on the head spot".to_owned(),
        Err(error) => error.to_string(),
    })
}

/// The nearest of `spot` and places in rings round it where a ball touches none of `others`.
pub(super) fn free_spot(spot: DVec2, radius_m: f64, others: &[DVec2]) -> DVec2 {
    let ring = |i: u32| {
        let reach = radius_m * 0.5 * f64::from(i.div_ceil(12));
        spot + DVec2::from_angle(f64::from(i) * std::f64::consts::TAU / 12.0) * reach
    };
    let is_free = |place: &DVec2| {
        others
            .iter()
            .all(|other| other.distance(*place) > 2.01 * radius_m)
    };
    (0..12 * 40).map(ring).find(is_free).unwrap_or(spot)
}
