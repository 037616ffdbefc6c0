//! Properties common to all marbles, and the state of one.

use std::f64::consts::PI;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::{Result, check_range};

/// Properties that all marbles of a collection share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Marble {
    /// Radius, in m; default 0.008, a toy marble.
    pub radius_m: f64,
    /// Density, in kg/m³; default 2,500, glass.
    pub density_kg_m3: f64,
    /// Coefficient of restitution between marbles and of marbles and balls, 0.15 to 1; default 0.9.
    pub restitution: f64,
    /// Coefficient of restitution on obstacles, 0.15 to 1; default 0.5, slate under cloth.
    pub obstacle_restitution: f64,
    /// Coefficient of Coulomb friction; default 0.3.
    pub friction: f64,
    /// Coefficient of rolling friction, the resistance over the normal force; default 0.03, glass on cloth.
    pub rolling_friction: f64,
    /// Stiffness of the normal spring, in N/m; default 1e5, far softer than glass for longer substeps:
    /// marbles that meet at 5 m/s overlap by 8 % of their diameter.
    pub stiffness_n_m: f64,
}

impl Default for Marble {
    fn default() -> Self {
        Self {
            radius_m: 0.008,
            density_kg_m3: 2500.0,
            restitution: 0.9,
            obstacle_restitution: 0.5,
            friction: 0.3,
            rolling_friction: 0.03,
            stiffness_n_m: 1e5,
        }
    }
}

impl Marble {
    /// Mass of a marble, in kg.
    pub fn mass_kg(&self) -> f64 {
        4.0 / 3.0 * PI * self.radius_m.powi(3) * self.density_kg_m3
    }

    /// Moment of inertia of a marble about its centre, in kg·m².
    pub fn moment_of_inertia(&self) -> f64 {
        0.4 * self.mass_kg() * self.radius_m * self.radius_m
    }

    /// The longest substep, in s: a fifteenth of the duration of a collision of two marbles, half a period
    /// of the undamped spring with their reduced mass, π·√(m/2k).
    pub fn substep_secs_max(&self) -> f64 {
        PI * (0.5 * self.mass_kg() / self.stiffness_n_m).sqrt() / 15.0
    }

    pub(crate) fn validate(&self) -> Result<()> {
        check_range("radius of a marble in m", self.radius_m, 1e-4, 1.0)?;
        check_range("density of marbles in kg/m³", self.density_kg_m3, 1.0, 1e5)?;
        check_range("restitution of marbles", self.restitution, 0.15, 1.0)?;
        let slate = self.obstacle_restitution;
        check_range("restitution of marbles on obstacles", slate, 0.15, 1.0)?;
        check_range("friction of marbles", self.friction, 0.0, 10.0)?;
        check_range(
            "rolling friction of marbles",
            self.rolling_friction,
            0.0,
            1.0,
        )?;
        check_range("stiffness of marbles in N/m", self.stiffness_n_m, 1.0, 1e9)
    }
}

/// State of a marble.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarbleState {
    /// Position of the centre, in m.
    pub position: DVec3,
    /// Velocity of the centre, in m/s.
    pub velocity: DVec3,
    /// Angular velocity, in rad/s.
    pub spin: DVec3,
}

impl MarbleState {
    pub(crate) fn is_finite(&self) -> bool {
        self.position.is_finite() && self.velocity.is_finite() && self.spin.is_finite()
    }
}
