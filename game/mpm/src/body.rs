//! Rigid bodies in contact with particles: moving balls and static obstacles.

use glam::{DQuat, DVec3};

use crate::error::{Error, Result, check_range};

/// All bodies of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bodies {
    /// Moving spheres, coupled in both directions with particles.
    pub balls: Vec<Ball>,
    /// Static bodies: slate, cushions, walls.
    pub obstacles: Vec<Obstacle>,
}

impl Bodies {
    pub(crate) fn validate(&self) -> Result<()> {
        self.balls.iter().try_for_each(Ball::validate)?;
        self.obstacles.iter().try_for_each(Obstacle::validate)
    }

    /// Clears the impulses on balls, at the start of a step.
    pub(crate) fn clear_impulses(&mut self) {
        for ball in &mut self.balls {
            ball.impulse = DVec3::ZERO;
            ball.angular_impulse = DVec3::ZERO;
        }
    }

    /// Advances balls that no particles touch by a time in s.
    pub(crate) fn move_freely(&mut self, dt: f64) {
        for ball in &mut self.balls {
            ball.velocity += ball.acceleration * dt;
            ball.advance(dt);
        }
    }
}

/// A rigid sphere. A step moves it, and changes its velocities by its acceleration and by the
/// impulses of particles.
///
/// Vectors are in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Position of the centre, in m.
    pub position: DVec3,
    /// Velocity of the centre, in m/s.
    pub velocity: DVec3,
    /// Angular velocity, in rad/s.
    pub angular_velocity: DVec3,
    /// Acceleration by all forces but those of particles, in m/s²: gravity, reaction and friction of the
    /// cloth.
    pub acceleration: DVec3,
    /// Least height of its centre, in m, as that of a ball on the slate, which takes up downward impulses;
    /// -∞ for none.
    pub floor_m: f64,
    /// Radius, in m.
    pub radius_m: f64,
    /// Mass, in kg.
    pub mass_kg: f64,
    /// Impulse by particles during the last step, in kg·m/s.
    pub impulse: DVec3,
    /// Angular impulse by particles during the last step, about the centre, in kg·m²/s.
    pub angular_impulse: DVec3,
}

impl Ball {
    /// A ball at rest without acceleration and floor.
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

    /// Moment of inertia of a uniform sphere, in kg·m².
    pub fn moment_of_inertia(&self) -> f64 {
        0.4 * self.mass_kg * self.radius_m * self.radius_m
    }

    /// Applies an impulse in kg·m/s and an angular impulse in kg·m²/s to its velocities, and adds them to
    /// its sums.
    pub(crate) fn kick(&mut self, impulse: DVec3, turn: DVec3) {
        self.velocity += impulse / self.mass_kg;
        self.angular_velocity += turn / self.moment_of_inertia();
        self.impulse += impulse;
        self.angular_impulse += turn;
    }

    /// Advances its position by a time in s, not below its floor.
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

/// A static body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstacle {
    /// Its shape.
    pub solid: Solid,
    /// Boundary condition for particles.
    pub grip: Grip,
}

/// Shape of an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solid {
    /// The half-space below a plane: slate, floors and walls.
    HalfSpace {
        /// A point of the plane, in m.
        point: DVec3,
        /// Unit normal, out of the solid.
        normal: DVec3,
    },
    /// A box: cushions and rails. It must be at least two cells thick, or particles on both sides interact.
    Cuboid {
        /// Centre, in m.
        center: DVec3,
        /// Half of its edges, in m.
        half_size: DVec3,
        /// Rotation from the box's frame to the world (`world_from_cuboid`).
        orientation: DQuat,
    },
}

/// Boundary condition of an obstacle for particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grip {
    /// Particles may separate from it and slide on it with their material's coefficient of friction.
    Friction,
    /// Particles stick to it, as a bumper glued to a rail.
    Bonded,
}

impl Obstacle {
    /// A half-space with friction through a point in m; the unit normal points out of the solid.
    pub fn plane(point: DVec3, normal: DVec3) -> Self {
        let solid = Solid::HalfSpace { point, normal };
        Self {
            solid,
            grip: Grip::Friction,
        }
    }

    /// Six half-spaces with friction around a box in m, which confine particles to its inside.
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

    /// Signed distance of a point from the surface, in m and negative inside, and the unit normal there.
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
                // Outside, the direction from the nearest point of the box; inside, the normal of the
                // nearest face.
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
