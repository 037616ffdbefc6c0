//! All physical constants of a game of billiards in one place.

use std::ops::Range;

use crate::{Error, Result};

use super::{
    ball_ball::BallBallLaw, cloth::Cloth, cue_impact::Cue, cushion::CushionLaw,
    slate_impact::BounceLaw, table::Table,
};

/// The laws that set velocities. The default is a pool table as measured by Alciatore
/// ("Physical properties", billiards.colostate.edu).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laws {
    /// The cue.
    pub cue: Cue,
    /// Ball on cloth.
    pub cloth: Cloth,
    /// Ball falling onto the slate under the cloth, or onto a rail.
    pub slate: BounceLaw,
    /// Ball against the rims and walls of pockets.
    pub pocket: BounceLaw,
    /// Ball against ball.
    pub ball_ball: BallBallLaw,
    /// Ball against cushion.
    pub cushion: CushionLaw,
}

impl Default for Laws {
    fn default() -> Self {
        Self {
            cue: Cue::default(),
            cloth: Cloth::default(),
            slate: BounceLaw::SLATE,
            pocket: BounceLaw::POCKET,
            ball_ball: BallBallLaw::default(),
            cushion: CushionLaw::default(),
        }
    }
}

impl Laws {
    /// The default laws with the resistance of a table's cloth.
    pub fn of(table: &Table) -> Self {
        let mut laws = Self::default();
        laws.cloth.rolling_friction *= table.speed().resistance_factor();
        laws
    }

    /// Checks that each constant is in the range in which its law holds.
    ///
    /// # Errors
    /// [`Error::Laws`] for a constant outside of the range in which its law holds.
    pub fn validate(&self) -> Result<()> {
        let mut checks = self.checks().into_iter();
        match checks.find(|(_, value, range)| !range.contains(value)) {
            None => Ok(()),
            Some((name, value, range)) => Err(Error::Laws {
                constant: name,
                value,
                min: range.start,
                max: range.end,
            }),
        }
    }

    fn checks(&self) -> Vec<(&'static str, f64, Range<f64>)> {
        let any = || 0.0..f64::MAX;
        let over_zero = || f64::MIN_POSITIVE..f64::MAX;
        let ratio = || f64::MIN_POSITIVE..1.0 + f64::EPSILON;
        // Lossless bounces would go on without end.
        let lossy = || 0.0..0.99;
        let (balls, cushion) = (&self.ball_ball, &self.cushion);
        vec![
            ("mass of the cue", self.cue.mass_kg, over_zero()),
            ("end mass of the cue", self.cue.end_mass_kg, over_zero()),
            ("friction of the tip", self.cue.tip_friction, any()),
            // Without friction each of these motions would go on without end.
            ("sliding friction", self.cloth.sliding_friction, over_zero()),
            ("rolling friction", self.cloth.rolling_friction, over_zero()),
            ("spin friction", self.cloth.spin_friction_m, over_zero()),
            ("gravity", self.cloth.gravity_m_s2, over_zero()),
            ("restitution of the slate", self.slate.restitution, lossy()),
            ("friction of the slate", self.slate.friction, any()),
            ("restitution of pockets", self.pocket.restitution, lossy()),
            ("friction of pockets", self.pocket.friction, any()),
            ("restitution of balls", balls.restitution, ratio()),
            ("friction of balls", balls.friction_fast, any()),
            ("friction of slow balls", balls.friction_slow_extra, any()),
            ("fading of friction", balls.friction_fade_s_m, any()),
            ("restitution of cushions", cushion.restitution, ratio()),
            ("friction of cushions", cushion.friction, any()),
            (
                "frequency ratio of cushions",
                cushion.frequency_ratio,
                1.0..2.0,
            ),
        ]
    }
}
