//! Chalk dust: ballistic grains with air drag, which settle.

use glam::{DVec3, Vec3};

use crate::body::{Ball, Bodies};
use crate::error::{Result, check_finite, check_range};

/// Grains that do not interact with each other: each falls with Stokes drag until it settles on an
/// obstacle. The motion is integrated in closed form, exact for steps of any length.
#[derive(Clone, Debug)]
pub struct Dust {
    grain: Grain,
    gravity: Vec3,
    specks: Vec<Speck>,
}

/// Properties of the grains of a dust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grain {
    /// Diameter, in m; default 2e-5, chalk. Stokes drag holds up to about 8e-5.
    pub diameter_m: f32,
    /// Density, in kg/m³; default 2,700, that of calcite.
    pub density_kg_m3: f32,
    /// Dynamic viscosity of air, in Pa·s; default 1.8e-5.
    pub air_viscosity_pa_s: f32,
}

/// State of a grain of dust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Speck {
    /// Position, in m.
    pub position: Vec3,
    /// Velocity, in m/s; 0 once settled.
    pub velocity: Vec3,
    /// Whether it lies on an obstacle, where it stays until a ball carries it off.
    pub is_settled: bool,
}

impl Default for Grain {
    fn default() -> Self {
        Self {
            diameter_m: 2e-5,
            density_kg_m3: 2700.0,
            air_viscosity_pa_s: 1.8e-5,
        }
    }
}

impl Grain {
    /// Mass of a grain, in kg.
    pub fn mass_kg(&self) -> f32 {
        self.density_kg_m3 * std::f32::consts::PI / 6.0 * self.diameter_m.powi(3)
    }

    /// Relaxation time of a velocity under drag, after which 1/e of it is left, in s: `ρ d² / (18 η)`, after
    /// Stokes 1851.
    pub fn relaxation_secs(&self) -> f32 {
        let square = self.diameter_m * self.diameter_m;
        self.density_kg_m3 * square / (18.0 * self.air_viscosity_pa_s)
    }
}

impl Dust {
    /// An empty dust under an acceleration of gravity in m/s².
    ///
    /// # Errors
    ///
    /// If a number is out of range or not finite.
    pub fn new(grain: Grain, gravity: Vec3) -> Result<Self> {
        check_range(
            "diameter of a grain in m",
            grain.diameter_m.into(),
            1e-7,
            1e-3,
        )?;
        check_range("density in kg/m³", grain.density_kg_m3.into(), 1e-3, 1e5)?;
        let viscosity = grain.air_viscosity_pa_s.into();
        check_range("viscosity of air in Pa·s", viscosity, 1e-7, 1.0)?;
        check_finite("acceleration of free fall", gravity)?;
        Ok(Self {
            grain,
            gravity,
            specks: Vec::new(),
        })
    }

    /// Adds a grain at a position in m with a velocity in m/s.
    ///
    /// # Errors
    ///
    /// If either is not finite.
    pub fn add(&mut self, position: Vec3, velocity: Vec3) -> Result<()> {
        check_finite("place of a grain", position)?;
        check_finite("velocity of a grain", velocity)?;
        self.specks.push(Speck {
            position,
            velocity,
            is_settled: false,
        });
        Ok(())
    }

    /// Advances all grains by a time in s. Balls carry along grains that they touch and lose the momentum
    /// that these gain; the balls' positions do not change. Impulses are added to those that balls have.
    ///
    /// # Errors
    ///
    /// If the time or a body is out of range or not finite.
    pub fn step(&mut self, duration_secs: f64, bodies: &mut Bodies) -> Result<()> {
        check_range("duration of a step in s", duration_secs, 0.0, 3600.0)?;
        bodies.validate()?;
        let mass_kg = self.grain.mass_kg().into();
        let relaxation_secs = self.grain.relaxation_secs();
        let terminal = self.gravity * relaxation_secs;
        let ratio = duration_secs as f32 / relaxation_secs;
        let kept = (-ratio).exp();
        // dv/dt = (v∞ − v)/τ with the terminal velocity v∞ = g τ: v − v∞ decays as exp(−t/τ), and its
        // integral over the step is τ (1 − exp(−T/τ)). `exp_m1` keeps that accurate for short steps.
        let glide_secs = -(-ratio).exp_m1() * relaxation_secs;
        for speck in &mut self.specks {
            if !speck.is_settled {
                let excess = speck.velocity - terminal;
                speck.position += terminal * duration_secs as f32 + excess * glide_secs;
                speck.velocity = terminal + excess * kept;
                settle(speck, bodies);
            }
            for ball in &mut bodies.balls {
                carry(speck, ball, mass_kg);
            }
        }
        Ok(())
    }

    /// States of all grains, in the order in which they were added.
    pub fn specks(&self) -> &[Speck] {
        &self.specks
    }

    /// Keeps the grains for which the function returns true.
    pub fn retain(&mut self, keep: impl FnMut(&Speck) -> bool) {
        self.specks.retain(keep);
    }
}

/// Settles a grain that has entered an obstacle on its surface.
fn settle(speck: &mut Speck, bodies: &Bodies) {
    for obstacle in &bodies.obstacles {
        let (distance, normal) = obstacle.distance(speck.position.as_dvec3());
        if distance <= 0.0 {
            speck.position -= (normal * distance).as_vec3();
            speck.velocity = Vec3::ZERO;
            speck.is_settled = true;
        }
    }
}

/// Moves a grain that is inside a ball to its surface, at the surface's velocity, and applies the opposite
/// impulse to the ball.
fn carry(speck: &mut Speck, ball: &mut Ball, mass_kg: f64) {
    let arm = speck.position.as_dvec3() - ball.position;
    if arm.length_squared() >= ball.radius_m * ball.radius_m {
        return;
    }
    let arm = arm.normalize_or(DVec3::Z) * ball.radius_m;
    let velocity = ball.velocity + ball.angular_velocity.cross(arm);
    let impulse = mass_kg * (velocity - speck.velocity.as_dvec3());
    ball.kick(-impulse, -arm.cross(impulse));
    speck.position = (ball.position + arm).as_vec3();
    speck.velocity = velocity.as_vec3();
    speck.is_settled = false;
}
