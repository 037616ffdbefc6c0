//! Simulation engines: event-driven with the billiards laws, or rapier alone at a fixed step.

use crate::{EngineFault, Error};
use std::{fmt, str::FromStr};

/// Simulation engine of a world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Engine {
    /// Event-driven, with the billiards laws: the default.
    #[default]
    Exact,
    /// Rapier's own contacts and solver at a fixed step.
    Rapier(Rapier),
}

/// Settings of plain rapier. `carom-bench physics` prints the cost and the gain of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rapier {
    /// Steps per simulated second, [`Rapier::STEPS_PER_SEC_MIN`] to [`Rapier::STEPS_PER_SEC_MAX`].
    /// The only setting of much effect: with it the error of a cut shot falls, and the time rises.
    pub steps_per_sec: u32,
    /// Whether balls may turn by more than 45° a step. Without it a stun shot at 60 steps per
    /// second ends 41 % too slow.
    pub fast_rotation: bool,
    /// Whether the cue ball has continuous collision detection. Without it fast balls pass through
    /// others at 60 steps per second. It does not help for both balls of a pair: rapier sweeps no body
    /// against another that is swept.
    pub sweep_cue_ball: bool,
    /// Whether a contact's normal is kept while the bodies move by up to 50 mm: rapier's default, which
    /// deflects every cut by degrees at any step.
    pub recycle_contacts: bool,
    /// Iterations of the contact solver, 1 to [`Rapier::ITERATIONS_MAX`]; rapier's default is 4.
    pub solver_iterations: u32,
}

impl Rapier {
    /// Minimum step rate: at fewer steps a hard break crosses half the table in one.
    pub const STEPS_PER_SEC_MIN: u32 = 30;
    /// Maximum step rate: more would cost seconds a shot.
    pub const STEPS_PER_SEC_MAX: u32 = 10_000;
    /// Maximum solver iterations: far more than has any effect.
    pub const ITERATIONS_MAX: u32 = 64;

    /// The best settings of plain rapier at this step rate.
    pub fn at(steps_per_sec: u32) -> Self {
        Self {
            steps_per_sec,
            fast_rotation: true,
            sweep_cue_ball: true,
            recycle_contacts: false,
            solver_iterations: 4,
        }
    }

    /// Checks that all settings are in range.
    ///
    /// # Errors
    /// [`Error::Engine`] for a number out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let checks = [
            (
                "steps per second",
                self.steps_per_sec,
                Self::STEPS_PER_SEC_MIN..=Self::STEPS_PER_SEC_MAX,
            ),
            (
                "solver iterations",
                self.solver_iterations,
                1..=Self::ITERATIONS_MAX,
            ),
        ];
        match checks
            .iter()
            .find(|(_, value, range)| !range.contains(value))
        {
            None => Ok(()),
            Some((name, value, range)) => Err(EngineFault::OutOfRange {
                quantity: name,
                value: *value,
                min: *range.start(),
                max: *range.end(),
            }
            .into()),
        }
    }
}

impl FromStr for Engine {
    type Err = Error;

    /// `exact`, or `rapier-N` for [`Rapier::at`] N steps per second.
    fn from_str(text: &str) -> Result<Self, Error> {
        if text == "exact" {
            return Ok(Self::Exact);
        }
        let steps = text.strip_prefix("rapier-").and_then(|n| n.parse().ok());
        let Some(steps_per_sec) = steps else {
            let name = text.to_owned();
            return Err(EngineFault::Unknown(name).into());
        };
        let rapier = Rapier::at(steps_per_sec);
        rapier.validate()?;
        Ok(Self::Rapier(rapier))
    }
}

impl fmt::Display for Engine {
    /// As read by `from_str`; settings that differ from those of [`Rapier::at`] are appended.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::Rapier(rapier) = self else {
            return f.write_str("exact");
        };
        write!(f, "rapier-{}", rapier.steps_per_sec)?;
        let usual = Rapier::at(rapier.steps_per_sec);
        if !rapier.fast_rotation {
            f.write_str(", slow rotation")?;
        }
        if !rapier.sweep_cue_ball {
            f.write_str(", no sweep")?;
        }
        if rapier.recycle_contacts {
            f.write_str(", recycling")?;
        }
        if rapier.solver_iterations != usual.solver_iterations {
            write!(f, ", {} iterations", rapier.solver_iterations)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_engine_is_read_as_it_is_written() {
        for text in ["exact", "rapier-60", "rapier-4000"] {
            assert_eq!(text.parse::<Engine>().unwrap().to_string(), text);
        }
        for text in [
            "",
            "rapier",
            "rapier-",
            "rapier-0",
            "rapier-20000",
            "rapier--1",
            "Exact",
        ] {
            let error = text.parse::<Engine>().unwrap_err().to_string();
            assert!(
                error.starts_with("the physics cannot be set so: "),
                "{error}"
            );
        }
    }
}
