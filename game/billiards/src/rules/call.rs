//! Calls: the announcement of a player before a shot.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::layout::TableLayout;
use crate::deterministic_math::{angle_between, atan};

/// The announcement of a player before a shot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Call {
    /// To pot a ball: in a pocket where games ask for it. In snooker the nominated ball.
    Pot {
        /// The ball.
        ball: u8,
        /// Index into [`TableLayout::pockets`].
        pocket: Option<usize>,
    },
    /// To pass the turn, whatever falls (WPA 1.6).
    Safety,
    /// Nine-ball, the shot after the break: no ball and no cushion need be hit (WPA 2.4).
    PushOut,
}

/// The call that is obvious from the aim (WPA 1.6): the first ball, which lies at `at` and will leave
/// along `direction`, and the pocket towards which it leaves; none without such a pocket.
pub fn infer(layout: &TableLayout, ball: u8, at: DVec2, direction: DVec2) -> Option<Call> {
    let off = |center: &DVec2| angle_between(direction, *center - at).abs();
    let straight = |center: &DVec2| {
        let distance = center.distance(at).max(1e-6);
        off(center) <= atan(MOUTH_RADII * layout.radius_m / distance)
    };
    let pockets = layout.pockets.iter().enumerate();
    let (pocket, _) = pockets
        .filter(|(_, center)| straight(center))
        .min_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
    Some(Call::Pot {
        ball,
        pocket: Some(pocket),
    })
}

/// Half a pocket's mouth in ball radii, with a margin: a ball that passes this near is meant for the
/// pocket.
const MOUTH_RADII: f64 = 3.5;
