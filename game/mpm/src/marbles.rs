//! Marbles: rigid spheres of one size in contact with each other, balls and obstacles.
//!
//! Discrete element method with soft contacts: a linear spring and dashpot along the normal, and a
//! tangential spring bounded by Coulomb's law, which keeps its stretch as long as the contact lasts
//! (Cundall and Strack 1979, "A discrete numerical model for granular assemblies"). The stretch lets a heap
//! rest without creep.

use std::collections::HashMap;

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

use crate::body::Bodies;
use crate::error::{Error, Result, check_range};
use crate::marble::{Marble, MarbleState};
use crate::marble_contact::{Surface, damping_of};
use crate::settings::REST_SECS;
use crate::storage::neighbours;

/// Second body of a contact, by index. The order of contacts follows from that of the variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
enum Partner {
    Marble(u32),
    Obstacle(u32),
    Ball(u32),
}

/// A marble and a body near enough to touch it before contacts are found again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Contact {
    marble: u32,
    partner: Partner,
    /// Stretch of the tangential spring, in m.
    stretch: DVec3,
}

/// A collection of marbles, whose contacts are processed one after the other in a fixed order: the same
/// steps give the same bits.
#[derive(Clone, Debug)]
pub struct Marbles {
    marble: Marble,
    /// Damping ratios (shares of critical damping) of contacts with marbles and balls, and with obstacles.
    damping: [f64; 2],
    gravity: DVec3,
    rest_speed_m_s: f64,
    spheres: Vec<MarbleState>,
    /// Sorted by marble and partner.
    contacts: Vec<Contact>,
    rested_secs: f64,
}

/// The changing state of [`Marbles`], to be stored; restored marbles continue with the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MarbleSnapshot {
    spheres: Vec<MarbleState>,
    contacts: Vec<Contact>,
    rested_secs: f64,
}

impl MarbleSnapshot {
    /// Number of marbles.
    pub fn len(&self) -> usize {
        self.spheres.len()
    }

    /// Whether there are no marbles.
    pub fn is_empty(&self) -> bool {
        self.spheres.is_empty()
    }
}

impl Marbles {
    /// An empty collection under an acceleration of gravity in m/s². When all marbles have been slower than
    /// the speed of rest in m/s for [`REST_SECS`], they sleep until a faster ball comes near; with 0 they
    /// never sleep.
    ///
    /// # Errors
    ///
    /// If a number is out of range or not finite.
    pub fn new(marble: Marble, gravity: DVec3, rest_speed_m_s: f64) -> Result<Self> {
        marble.validate()?;
        check_range(
            "acceleration of free fall in m/s²",
            gravity.length(),
            0.0,
            1e4,
        )?;
        check_range("speed of rest in m/s", rest_speed_m_s, 0.0, 1e3)?;
        let restitutions = [marble.restitution, marble.obstacle_restitution];
        Ok(Self {
            marble,
            damping: restitutions.map(damping_of),
            gravity,
            rest_speed_m_s,
            spheres: Vec::new(),
            contacts: Vec::new(),
            rested_secs: 0.0,
        })
    }

    /// Adds a marble.
    ///
    /// # Errors
    ///
    /// If one of its vectors is not finite or longer than 1e6 in SI units.
    pub fn add(&mut self, sphere: MarbleState) -> Result<()> {
        for (quantity, value) in [
            ("place of a marble", sphere.position),
            ("velocity of a marble", sphere.velocity),
            ("spin of a marble", sphere.spin),
        ] {
            crate::error::check_finite(quantity, value.as_vec3())?;
            check_range(quantity, value.length(), 0.0, NUMBER_MAX)?;
        }
        self.spheres.push(sphere);
        self.rested_secs = 0.0;
        Ok(())
    }

    /// The properties that all marbles share.
    pub fn marble(&self) -> &Marble {
        &self.marble
    }

    /// States of all marbles, in the order in which they were added.
    pub fn spheres(&self) -> &[MarbleState] {
        &self.spheres
    }

    /// Whether all marbles sleep: steps do not change them until a moving ball comes near.
    pub fn is_asleep(&self) -> bool {
        self.spheres.is_empty() || self.rested_secs >= REST_SECS
    }

    /// A copy of the present state.
    pub fn snapshot(&self) -> MarbleSnapshot {
        MarbleSnapshot {
            spheres: self.spheres.clone(),
            contacts: self.contacts.clone(),
            rested_secs: self.rested_secs,
        }
    }

    /// Restores the state of a snapshot.
    ///
    /// # Errors
    ///
    /// [`Error::BadSnapshot`] if it is not a state that [`Self::snapshot`] returns; nothing has changed then.
    pub fn restore(&mut self, snapshot: &MarbleSnapshot) -> Result<()> {
        let refuse = |fault| Err(Error::BadSnapshot { fault });
        let is_small = |v: DVec3| v.is_finite() && v.length() < NUMBER_MAX;
        let sphere =
            |s: &MarbleState| is_small(s.position) && is_small(s.velocity) && is_small(s.spin);
        if !snapshot.spheres.iter().all(sphere) {
            return refuse("a marble has a number that is not finite, or too large");
        }
        let count = snapshot.spheres.len() as u32;
        let contact = |c: &Contact| c.marble < count && is_small(c.stretch);
        if snapshot.contacts.len() > CONTACTS_MAX * snapshot.spheres.len()
            || !snapshot.contacts.iter().all(contact)
        {
            return refuse("marbles touch that are not there");
        }
        if !(snapshot.rested_secs >= 0.0 && snapshot.rested_secs.is_finite()) {
            return refuse("marbles have rested for a time that is none");
        }
        self.spheres.clone_from(&snapshot.spheres);
        self.contacts.clone_from(&snapshot.contacts);
        self.rested_secs = snapshot.rested_secs;
        Ok(())
    }

    /// Advances marbles and balls by a time in s; the balls' impulses are set to those by marbles.
    ///
    /// # Errors
    ///
    /// If the time or a body is out of range or not finite; nothing has changed then.
    /// [`Error::MarblesDiverged`] if a number is no longer finite; the marbles cannot be continued then.
    pub fn step(&mut self, duration_secs: f64, bodies: &mut Bodies) -> Result<()> {
        check_range("duration of a step in s", duration_secs, 0.0, STEP_SECS_MAX)?;
        bodies.validate()?;
        bodies.clear_impulses();
        if self.is_asleep() && !self.is_disturbed(bodies) {
            bodies.move_freely(duration_secs);
            return Ok(());
        }
        let count = (duration_secs / self.marble.substep_secs_max())
            .ceil()
            .max(1.0);
        let dt = duration_secs / count;
        // Indices of balls are the caller's and may change between steps, so stretches towards balls are
        // dropped.
        self.contacts
            .retain(|c| !matches!(c.partner, Partner::Ball(_)));
        self.find_contacts(bodies);
        let mut travelled_m = 0.0;
        for _ in 0..count as u32 {
            let fastest = self.substep(dt, bodies);
            // Twice, as two may move towards each other.
            travelled_m += 2.0 * fastest * dt;
            if !fastest.is_finite() || !self.spheres.iter().all(MarbleState::is_finite) {
                return Err(Error::MarblesDiverged { substep_secs: dt });
            }
            if travelled_m > SKIN_RADII * self.marble.radius_m {
                self.find_contacts(bodies);
                travelled_m = 0.0;
            }
        }
        self.rested_secs = match self.fastest_m_s() < self.rest_speed_m_s {
            true => self.rested_secs + duration_secs,
            false => 0.0,
        };
        Ok(())
    }

    fn fastest_m_s(&self) -> f64 {
        let radius_m = self.marble.radius_m;
        let speed = |s: &MarbleState| s.velocity.length().max(s.spin.length() * radius_m);
        self.spheres.iter().map(speed).fold(0.0, f64::max)
    }

    fn is_disturbed(&self, bodies: &Bodies) -> bool {
        let mut moving = bodies.balls.iter();
        moving.any(|ball| {
            let reach_m = ball.radius_m + (1.0 + 2.0 * SKIN_RADII) * self.marble.radius_m;
            let is_near = |s: &MarbleState| s.position.distance(ball.position) < reach_m;
            ball.velocity.length() > self.rest_speed_m_s && self.spheres.iter().any(is_near)
        })
    }

    /// Finds all pairs nearer than the skin (Verlet list), which stays valid until any pair has approached
    /// by the skin. Pairs that were listed before keep their stretch.
    fn find_contacts(&mut self, bodies: &Bodies) {
        let radius_m = self.marble.radius_m;
        let skin_m = SKIN_RADII * radius_m;
        // Cells are as wide as contacts reach, so the 27 cells around a marble hold all marbles that it may
        // touch.
        let edge_m = 2.0 * radius_m + skin_m;
        let cell = |at: DVec3| (at / edge_m).floor().as_ivec3();
        let mut cells: HashMap<IVec3, Vec<u32>> = HashMap::new();
        for (index, sphere) in (0u32..).zip(&self.spheres) {
            cells.entry(cell(sphere.position)).or_default().push(index);
        }
        let mut found = Vec::with_capacity(self.contacts.len());
        for (marble, sphere) in (0u32..).zip(&self.spheres) {
            let at = sphere.position;
            let mut add = |partner| {
                found.push(Contact {
                    marble,
                    partner,
                    stretch: DVec3::ZERO,
                });
            };
            for offset in neighbours() {
                for &other in cells.get(&(cell(at) + offset)).into_iter().flatten() {
                    let apart = self.spheres[other as usize].position.distance(at);
                    if other > marble && apart < edge_m {
                        add(Partner::Marble(other));
                    }
                }
            }
            for (index, obstacle) in (0u32..).zip(&bodies.obstacles) {
                if obstacle.distance(at).0 < radius_m + skin_m {
                    add(Partner::Obstacle(index));
                }
            }
            for (index, ball) in (0u32..).zip(&bodies.balls) {
                if ball.position.distance(at) < ball.radius_m + radius_m + skin_m {
                    add(Partner::Ball(index));
                }
            }
        }
        found.sort_unstable_by_key(|contact| (contact.marble, contact.partner));
        // Both lists are sorted by the same key: one merge pass finds the pairs of the old list.
        let mut old = self.contacts.iter().peekable();
        for contact in &mut found {
            let key = (contact.marble, contact.partner);
            while old.next_if(|old| (old.marble, old.partner) < key).is_some() {}
            if let Some(old) = old.next_if(|old| (old.marble, old.partner) == key) {
                contact.stretch = old.stretch;
            }
        }
        self.contacts = found;
    }

    /// Advances marbles and balls by the forces of contacts over a time in s, and returns the largest speed
    /// of a marble or ball, in m/s.
    fn substep(&mut self, dt: f64, bodies: &mut Bodies) -> f64 {
        let Self {
            marble,
            damping,
            spheres,
            contacts,
            ..
        } = self;
        for sphere in spheres.iter_mut() {
            sphere.velocity += self.gravity * dt;
        }
        for ball in &mut bodies.balls {
            ball.velocity += ball.acceleration * dt;
        }
        // Impulses are summed before any is applied, so that all contacts see the same state.
        let mut kicks = vec![(DVec3::ZERO, DVec3::ZERO); spheres.len()];
        let mut ball_kicks = vec![(DVec3::ZERO, DVec3::ZERO); bodies.balls.len()];
        for contact in contacts.iter_mut() {
            let index = contact.marble as usize;
            let sphere = spheres[index];
            let other = surface(contact.partner, &sphere, spheres, bodies, marble);
            let damping = damping[usize::from(other.mass_kg.is_infinite())];
            let push = other.push(marble, damping, &sphere, &mut contact.stretch, dt);
            let Some(push) = push else {
                contact.stretch = DVec3::ZERO;
                continue;
            };
            kicks[index].0 += push.impulse;
            kicks[index].1 += push.arm.cross(push.impulse) + push.rolling;
            let [impulse, turn] = [
                -push.impulse,
                push.other_arm.cross(-push.impulse) - push.rolling,
            ];
            match contact.partner {
                Partner::Marble(other) => {
                    kicks[other as usize].0 += impulse;
                    kicks[other as usize].1 += turn;
                }
                Partner::Ball(ball) => {
                    ball_kicks[ball as usize].0 += impulse;
                    ball_kicks[ball as usize].1 += turn;
                }
                Partner::Obstacle(_) => {}
            }
        }
        let (mass_kg, inertia) = (marble.mass_kg(), marble.moment_of_inertia());
        let mut fastest = 0.0_f64;
        for (sphere, (impulse, turn)) in spheres.iter_mut().zip(kicks) {
            sphere.velocity += impulse / mass_kg;
            sphere.spin += turn / inertia;
            // With the velocity after the impulses (semi-implicit Euler), so that springs gain no energy in
            // the long run.
            sphere.position += sphere.velocity * dt;
            fastest = fastest.max(sphere.velocity.length());
        }
        for (ball, (impulse, turn)) in bodies.balls.iter_mut().zip(ball_kicks) {
            ball.kick(impulse, turn);
            ball.advance(dt);
            fastest = fastest.max(ball.velocity.length());
        }
        fastest
    }
}

/// The surface of a contact's partner at a marble.
fn surface(
    partner: Partner,
    sphere: &MarbleState,
    spheres: &[MarbleState],
    bodies: &Bodies,
    marble: &Marble,
) -> Surface {
    match partner {
        Partner::Marble(other) => {
            let MarbleState {
                position,
                velocity,
                spin,
            } = spheres[other as usize];
            let surface = Surface::sphere(sphere.position, position, marble.radius_m);
            surface.moving(velocity, spin, marble.mass_kg())
        }
        Partner::Ball(ball) => {
            let ball = &bodies.balls[ball as usize];
            let surface = Surface::sphere(sphere.position, ball.position, ball.radius_m);
            surface.moving(ball.velocity, ball.angular_velocity, ball.mass_kg)
        }
        Partner::Obstacle(obstacle) => {
            let obstacle = &bodies.obstacles[obstacle as usize];
            let (distance_m, normal) = obstacle.distance(sphere.position);
            Surface::still(distance_m, normal)
        }
    }
}

/// Skin of the contact list over the radius of a marble: pairs this much apart are listed.
const SKIN_RADII: f64 = 0.25;
/// Bound on positions, velocities, spins and stretches, in SI units: beyond any plausible value.
const NUMBER_MAX: f64 = 1e6;
/// Bound on the contacts of a snapshot per marble: spheres of one size touch at most twelve others,
/// besides obstacles and balls.
const CONTACTS_MAX: usize = 64;
/// Longest duration of one step, in s.
const STEP_SECS_MAX: f64 = 10.0;
