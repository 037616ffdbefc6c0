//! All constants of a game of billiards in one place.

use super::{
    ball::BallBody,
    ball_ball::BallBallLaw,
    cloth::Cloth,
    cushion::CushionLaw,
    error::{Error, Result},
    stick::Cue,
};

/// The laws that set velocities. The default is a pool table as measured by Alciatore
/// ("Physical properties", billiards.colostate.edu).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Laws {
    /// The balls.
    pub body: BallBody,
    /// The cue.
    pub cue: Cue,
    /// Ball on cloth.
    pub cloth: Cloth,
    /// Ball against ball.
    pub ball_ball: BallBallLaw,
    /// Ball against cushion.
    pub cushion: CushionLaw,
}

impl Laws {
    /// # Errors
    /// [`Error::Laws`] for a constant outside of the range in which its law holds.
    pub fn validate(&self) -> Result<()> {
        let any = 0.0..f64::MAX;
        let over_zero = f64::MIN_POSITIVE..f64::MAX;
        let ratio = f64::MIN_POSITIVE..1.0 + f64::EPSILON;
        let checks = [
            ("mass of a ball", self.body.mass_kg, &over_zero),
            ("radius of a ball", self.body.radius_m, &over_zero),
            ("mass of the cue", self.cue.mass_kg, &over_zero),
            ("end mass of the cue", self.cue.end_mass_kg, &over_zero),
            // Without friction of its own each of these would go on for ever.
            ("sliding friction", self.cloth.sliding_friction, &over_zero),
            ("rolling friction", self.cloth.rolling_friction, &over_zero),
            ("spin friction", self.cloth.spin_friction_m, &over_zero),
            ("gravity", self.cloth.gravity_m_s2, &over_zero),
            ("restitution of balls", self.ball_ball.restitution, &ratio),
            ("friction of balls", self.ball_ball.friction_fast, &any),
            (
                "friction of slow balls",
                self.ball_ball.friction_slow_extra,
                &any,
            ),
            ("fading of friction", self.ball_ball.friction_fade_s_m, &any),
            ("restitution of cushions", self.cushion.restitution, &ratio),
            ("friction of cushions", self.cushion.friction, &any),
            (
                "frequency ratio of cushions",
                self.cushion.frequency_ratio,
                &(1.0..2.0),
            ),
        ];
        match checks
            .into_iter()
            .find(|(_, value, range)| !range.contains(value))
        {
            None => Ok(()),
            Some((name, value, range)) => Err(Error::Laws(format!(
                "the {name} is {value}, not from {:e} to {:e}",
                range.start, range.end
            ))),
        }
    }
}
