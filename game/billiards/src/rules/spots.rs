//! Spots of balls that have their own.

use glam::DVec2;

use super::{layout::TableLayout, ruleset::RuleSet};

/// The spot of a colour of snooker or of a ball of carom; the foot spot for others.
pub(crate) fn own_spot(rules: RuleSet, layout: &TableLayout, ball: u8) -> DVec2 {
    let baulk = layout.baulk_spot();
    match (rules, ball) {
        (RuleSet::Snooker, 16) => baulk - DVec2::new(0.0, layout.d_radius_m()),
        (RuleSet::Snooker, 17) => baulk + DVec2::new(0.0, layout.d_radius_m()),
        (RuleSet::Snooker, 18) => baulk,
        (RuleSet::Snooker, 19) => DVec2::ZERO,
        (RuleSet::Snooker, 21) => DVec2::new((0.5 - BLACK_SHARE) * layout.length_m, 0.0),
        (RuleSet::ThreeCushion, 0) => layout.head_spot(),
        (RuleSet::ThreeCushion, 1) => DVec2::ZERO,
        _ => layout.foot_spot(),
    }
}

/// Distance of the black's spot from the top cushion, 324 mm, over the length.
const BLACK_SHARE: f64 = 0.324 / 3.569;
