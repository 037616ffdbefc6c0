//! Bodies that particles meet: balls that move, and obstacles that stay.

use glam::{DQuat, DVec3};

use crate::error::{Error, Result, check_range};

/// All bodies of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bodies {
    /// Spheres that push particles and are pushed.
    pub balls: Vec<Ball>,
    /// What does not move: slate, cushions, walls.
    pub obstacles: Vec<Obstacle>,
}

impl Bodies {
    pub(crate) fn validate(&self) -> Result<()> {
        self.balls.iter().try_for_each(Ball::validate)?;
        self.obstacles.iter().try_for_each(Obstacle::validate)
    }

    /// Begins a step, whose impulses add up.
    pub(crate) fn clear_impulses(&mut self) {
        for ball in &mut self.balls {
            ball.impulse = DVec3::ZERO;
            ball.angular_impulse = DVec3::ZERO;
        }
    }

    /// Moves balls that nothing touches.
    pub(crate) fn move_freely(&mut self, dt: f64) {
        for ball in &mut self.balls {
            ball.velocity += ball.acceleration * dt;
            ball.advance(dt);
        }
    }
}

/// A rigid sphere. A step moves it, and changes its velocities by its acceleration and by the
/// impulses of particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Of the centre, in m.
    pub position: DVec3,
    /// Of the centre, in m/s.
    pub velocity: DVec3,
    /// In rad/s.
    pub angular_velocity: DVec3,
    /// By all forces but the particles', in m/s²: free fall, the cloth's reaction and friction.
    pub acceleration: DVec3,
    /// Height under which its centre does not sink, in m: a slate carries it, and takes up what would press it lower.
    /// -∞: nothing does.
    pub floor_m: f64,
    /// In m.
    pub radius_m: f64,
    /// In kg.
    pub mass_kg: f64,
    /// By particles in the last step, in kg·m/s.
    pub impulse: DVec3,
    /// By particles in the last step about the centre, in kg·m²/s.
    pub angular_impulse: DVec3,
}

impl Ball {
    /// A ball at rest that nothing accelerates.
    pub fn new(position: DVec3, radius_m: f64, mass_kg: f64) -> Self {
        Self {
            position,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
            acceleration: DVec3::ZERO,
            floor_m: f64::NEG_INFINITY,
            radius_m,
            mass_kg,
            impulse: DVec3::ZERO,
            angular_impulse: DVec3::ZERO,
        }
    }

    /// Of a uniform sphere, in kg·m².
    pub fn moment_of_inertia(&self) -> f64 {
        0.4 * self.mass_kg * self.radius_m * self.radius_m
    }

    /// Changes its velocities by an impulse and an angular one, and notes both.
    pub(crate) fn kick(&mut self, impulse: DVec3, turn: DVec3) {
        self.velocity += impulse / self.mass_kg;
        self.angular_velocity += turn / self.moment_of_inertia();
        self.impulse += impulse;
        self.angular_impulse += turn;
    }

    /// Moves it on at its velocity, as far as its floor lets it.
    pub(crate) fn advance(&mut self, dt: f64) {
        self.position += self.velocity * dt;
        if self.position.z < self.floor_m {
            self.position.z = self.floor_m;
            self.velocity.z = self.velocity.z.max(0.0);
        }
    }

    pub(crate) fn validate(&self) -> Result<()> {
        check_range("radius of a ball in m", self.radius_m, 1e-6, 1e3)?;
        check_range("mass of a ball in kg", self.mass_kg, 1e-12, 1e9)?;
        check_range("floor of a ball in m", self.floor_m.max(-1e6), -1e6, 1e6)?;
        for (quantity, value) in [
            ("position of a ball", self.position),
            ("velocity of a ball", self.velocity),
            ("angular velocity of a ball", self.angular_velocity),
            ("acceleration of a ball", self.acceleration),
        ] {
            check_vector(quantity, value)?;
        }
        Ok(())
    }
}

/// A body that stays where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Its solid.
    pub solid: Solid,
    /// How it holds particles.
    pub grip: Grip,
}

/// The volume of an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    /// All below a plane: slate, floors and walls.
    HalfSpace {
        /// A point of the plane, in m.
        point: DVec3,
        /// Out of the solid, of length 1.
        normal: DVec3,
    },
    /// A box: cushions and rails. At least two cells thick, or particles reach through it.
    Cuboid {
        /// In m.
        center: DVec3,
        /// Half of its edges, in m.
        half_size: DVec3,
        /// `world_from_cuboid`.
        orientation: DQuat,
    },
}

/// How an obstacle holds particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grip {
    /// They may leave it, and slide on it with their material's friction.
    Friction,
    /// They neither leave it nor slide: a bumper glued to a rail.
    Bonded,
}

impl Obstacle {
    /// A plane with friction, the solid below it.
    pub fn plane(point: DVec3, normal: DVec3) -> Self {
        let solid = Solid::HalfSpace { point, normal };
        Self {
            solid,
            grip: Grip::Friction,
        }
    }

    /// Six planes with friction around a box, in m: its faces hold what is inside.
    pub fn walls(min: DVec3, max: DVec3) -> Vec<Self> {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let low = axes.map(|axis| Self::plane(min, axis));
        let high = axes.map(|axis| Self::plane(max, -axis));
        low.into_iter().chain(high).collect()
    }

    pub(crate) fn validate(&self) -> Result<()> {
        match self.solid {
            Solid::HalfSpace { point, normal } => {
                check_vector("point of a plane", point)?;
                check_range("length of a plane's normal", normal.length(), 0.999, 1.001)
            }
            Solid::Cuboid {
                center,
                half_size,
                orientation,
            } => {
                check_vector("centre of a box", center)?;
                let least = half_size.min_element();
                check_range("half edge of a box in m", least, 1e-6, 1e6)?;
                check_vector("half edges of a box", half_size)?;
                let length = orientation.length();
                check_range("length of a box's quaternion", length, 0.999, 1.001)
            }
        }
    }

    /// Signed distance of a point from the surface, in m and negative inside, and the normal there.
    pub(crate) fn distance(&self, at: DVec3) -> (f64, DVec3) {
        match self.solid {
            Solid::HalfSpace { point, normal } => ((at - point).dot(normal), normal),
            Solid::Cuboid {
                center,
                half_size,
                orientation,
            } => {
                let local = orientation.inverse() * (at - center);
                let outside = local.abs() - half_size;
                let normal = if outside.max_element() > 0.0 {
                    outside.max(DVec3::ZERO)
                } else {
                    DVec3::AXES[outside.max_position()]
                };
                let normal = normal.normalize() * local.signum();
                let distance = outside.max(DVec3::ZERO).length() + outside.max_element().min(0.0);
                (distance, orientation * normal)
            }
        }
    }
}

fn check_vector(quantity: &'static str, value: DVec3) -> Result<()> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::NotFinite {
        quantity,
        value: value.as_vec3(),
    })
}
