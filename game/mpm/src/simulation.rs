//! Simulation of particles of several materials in stable explicit substeps.

use fearless_simd::{Level, dispatch};
use glam::Vec3;
use rayon::prelude::*;

use crate::body::Bodies;
use crate::coupling::resolve_contacts;
use crate::error::{Error, Result, check_finite, check_range};
use crate::g2p::g2p;
use crate::grid::{GridStep, REACH_CELLS, update};
use crate::material::Material;
use crate::p2g::{Substep, p2g};
use crate::region::Region;
use crate::settings::{PARTICLES_MAX, REST_SECS, Settings};
use crate::storage::{DRIFT_MAX, Particle, Storage};
use crate::totals::Totals;
use crate::touch::find_touches;

/// Largest distance that a particle or ball may move in a substep, in cells.
pub(crate) const TRAVEL_CELLS_MAX: f64 = 0.5;

/// Particles and the background grid on which they interact.
#[derive(Clone)]
pub struct Simulation {
    settings: Settings,
    level: Level,
    pub(crate) materials: Vec<Material>,
    pub(crate) storage: Storage,
    pub(crate) particles: usize,
    pub(crate) next_id: u32,
    /// Whether particles were added or removed since they were last sorted.
    is_disordered: bool,
    /// Bound on the distance that any particle has moved along an axis since the last sorting, in cells.
    drift: f32,
    /// Largest component of a particle's velocity, in m/s.
    pub(crate) speed_max: f32,
    /// Largest speed of sound of any particle, in m/s.
    pub(crate) sound_max: f32,
    /// Time for which all particles have been slower than the speed of rest, in s.
    pub(crate) rested_secs: f64,
}

/// Statistics of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Substeps taken; 0 while particles sleep.
    pub substeps: u32,
    /// Number of times that particles were sorted.
    pub orderings: u32,
}

impl Simulation {
    /// An empty simulation.
    ///
    /// # Errors
    ///
    /// If a setting is out of its range.
    pub fn new(settings: Settings) -> Result<Self> {
        settings.validate()?;
        Ok(Self {
            settings,
            level: Level::new(),
            materials: Vec::new(),
            storage: Storage::new(settings.cell_size_m),
            particles: 0,
            next_id: 0,
            is_disordered: false,
            drift: 0.0,
            speed_max: 0.0,
            sound_max: 0.0,
            rested_secs: 0.0,
        })
    }

    /// Fills a region with a material that moves at a velocity in m/s, and returns the number of
    /// particles added. Their masses add up to the region's volume times the density.
    ///
    /// # Errors
    ///
    /// If a number is out of range or not finite, or the region holds no or too many particles.
    pub fn fill(&mut self, region: &Region, material: Material, velocity: Vec3) -> Result<usize> {
        region.validate()?;
        let spacing_m = self.settings.spacing_m();
        self.check_count(region.count(spacing_m) as usize)?;
        let places = region.places(spacing_m);
        if places.is_empty() {
            return Err(Error::EmptyRegion { spacing_m });
        }
        let volume_m3 = (region.volume_m3() / places.len() as f64) as f32;
        self.add(&places, material, volume_m3, velocity)?;
        Ok(places.len())
    }

    /// Adds particles of a material at positions in m, each of the same volume in m³ at rest and the same
    /// velocity in m/s.
    ///
    /// # Errors
    ///
    /// If a number is out of range or not finite, or there would be too many particles.
    pub fn add(
        &mut self,
        places: &[Vec3],
        material: Material,
        volume_m3: f32,
        velocity: Vec3,
    ) -> Result<()> {
        material.validate()?;
        check_finite("velocity of particles", velocity)?;
        check_range("volume of a particle in m³", volume_m3.into(), 1e-18, 1e3)?;
        self.check_count(places.len())?;
        for place in places {
            check_finite("place of a particle", *place)?;
            self.storage.locate(*place)?;
        }
        let index = self.material_index(material);
        for place in places {
            let particle = Particle {
                id: self.next_id,
                position: *place,
                velocity,
                mass_kg: volume_m3 * material.density_kg_m3(),
                volume_m3,
                material: index,
            };
            self.storage.add(&particle, material.state_at_rest())?;
            self.next_id += 1;
        }
        self.particles += places.len();
        self.is_disordered = true;
        self.rested_secs = 0.0;
        self.speed_max = self.speed_max.max(velocity.abs().max_element());
        self.sound_max = self.sound_max.max(material.sound_speed_m_s());
        Ok(())
    }

    /// Keeps the particles for which the function returns true, and wakes them if any were removed.
    pub fn retain(&mut self, keep: impl FnMut(&Particle) -> bool) {
        self.storage.retain(keep);
        let particles = self.storage.particles().count();
        if particles != self.particles {
            self.particles = particles;
            self.is_disordered = true;
            self.rested_secs = 0.0;
        }
    }

    /// Advances particles and balls by a time in s.
    ///
    /// # Errors
    ///
    /// If the time or a body is out of range or not finite; nothing has changed then. Also if velocities
    /// are no longer finite, a particle is out of reach or too many substeps would be needed: particles and
    /// bodies are then those of the last substep, and after [`Error::Diverged`] the simulation cannot be
    /// continued.
    pub fn step(&mut self, duration_secs: f64, bodies: &mut Bodies) -> Result<StepReport> {
        check_range("duration of a step in s", duration_secs, 0.0, 3600.0)?;
        bodies.validate()?;
        bodies.clear_impulses();
        let mut report = StepReport::default();
        let mut left_secs = duration_secs;
        while left_secs > 0.0 {
            if self.is_asleep() && !self.is_disturbed(bodies) {
                bodies.move_freely(left_secs);
                break;
            }
            // Planned anew for each substep, as speeds change: the rest of the step in equal parts.
            let longest_secs = self.substep_secs_max(bodies);
            let count = (left_secs / longest_secs).ceil().max(1.0);
            self.check_substeps(
                duration_secs,
                longest_secs,
                count + f64::from(report.substeps),
            )?;
            let dt = left_secs / count;
            self.substep(dt, bodies, &mut report)?;
            // Exactly 0 at the end: a rounding remainder would become a substep of its own.
            left_secs = if count > 1.0 { left_secs - dt } else { 0.0 };
        }
        Ok(report)
    }

    /// Sorts particles by block, material and cell, as steps do when necessary. The bits of later steps then
    /// depend on nothing but what [`Self::snapshot`] holds.
    ///
    /// # Errors
    /// If a particle is out of reach.
    pub fn put_in_order(&mut self) -> Result<()> {
        self.storage.put_in_order(&self.materials)?;
        self.is_disordered = false;
        self.drift = 0.0;
        Ok(())
    }

    fn substep(&mut self, dt: f64, bodies: &mut Bodies, report: &mut StepReport) -> Result<()> {
        let cell_size_m = self.settings.cell_size_m;
        let travel = self.speed_max * dt as f32 / cell_size_m;
        if self.is_disordered || self.drift + travel > DRIFT_MAX {
            self.put_in_order()?;
            report.orderings += 1;
        }
        self.drift += travel;
        let (level, materials) = (self.level, &self.materials);
        let substep = Substep {
            dt: dt as f32,
            cell_size_m,
        };
        let Storage { blocks, nodes, .. } = &mut self.storage;
        let balls = &bodies.balls;
        blocks.par_iter_mut().for_each(|block| {
            dispatch!(level, simd => p2g(simd, block, materials, substep));
            find_touches(block, balls, substep);
        });
        let grid_step = GridStep {
            blocks,
            bodies,
            cell_size_m: cell_size_m.into(),
            dt,
            fall: self.settings.gravity * dt as f32,
        };
        nodes
            .par_iter_mut()
            .for_each(|node| dispatch!(level, _simd => update(node, grid_step)));
        // External forces first, as for nodes in `update`: contacts then see both velocities after gravity,
        // and particles that carry a ball take its weight in the same substep.
        for ball in &mut bodies.balls {
            ball.velocity += ball.acceleration * dt;
        }
        resolve_contacts(nodes, bodies, cell_size_m.into());
        for ball in &mut bodies.balls {
            ball.advance(dt);
        }
        let nodes = &*nodes;
        blocks.par_iter_mut().for_each(|block| {
            dispatch!(level, simd => g2p(simd, block, nodes));
        });
        report.substeps += 1;
        self.observe(dt)
    }

    /// Updates the largest speeds and the time at rest after a substep.
    fn observe(&mut self, dt: f64) -> Result<()> {
        self.speed_max = 0.0;
        self.sound_max = 0.0;
        for block in &self.storage.blocks {
            if !block.speed_max.is_finite() {
                let courant = self.settings.courant;
                return Err(Error::Diverged { courant });
            }
            self.speed_max = self.speed_max.max(block.speed_max);
            self.sound_max = self.sound_max.max(block.sound_max);
        }
        if self.speed_max < self.settings.rest_speed_m_s {
            self.rested_secs += dt;
        } else {
            self.rested_secs = 0.0;
        }
        Ok(())
    }

    /// The longest stable substep, in s: sound travels at most the Courant number of cells, and particles and
    /// balls at most [`TRAVEL_CELLS_MAX`].
    fn substep_secs_max(&self, bodies: &Bodies) -> f64 {
        let cell_size_m = f64::from(self.settings.cell_size_m);
        let by_sound = f64::from(self.settings.courant) * cell_size_m / f64::from(self.sound_max);
        let balls = bodies.balls.iter().map(|ball| ball.velocity.length());
        let fastest = balls.fold(f64::from(self.speed_max), f64::max);
        by_sound.min(TRAVEL_CELLS_MAX * cell_size_m / fastest)
    }

    pub(crate) fn check_substeps(
        &self,
        duration_secs: f64,
        substep_secs: f64,
        substeps: f64,
    ) -> Result<()> {
        let max = self.settings.substeps_max;
        if substeps <= f64::from(max) {
            return Ok(());
        }
        Err(Error::TooManySubsteps {
            duration_secs,
            substeps,
            substep_secs,
            max,
        })
    }

    // Counts ids given so far, also of removed particles: ids are not reused.
    fn check_count(&self, added: usize) -> Result<()> {
        let particles = added.saturating_add(self.next_id as usize);
        if particles <= PARTICLES_MAX {
            return Ok(());
        }
        let max = PARTICLES_MAX;
        Err(Error::TooManyParticles { particles, max })
    }

    fn material_index(&mut self, material: Material) -> usize {
        let known = self.materials.iter().position(|known| *known == material);
        known.unwrap_or_else(|| {
            self.materials.push(material);
            self.materials.len() - 1
        })
    }

    /// Whether all particles sleep: steps change none of them until a moving ball touches their nodes or
    /// particles are added or removed.
    pub fn is_asleep(&self) -> bool {
        self.particles == 0 || self.rested_secs >= REST_SECS
    }

    /// Whether a moving ball may touch a node of a particle.
    fn is_disturbed(&self, bodies: &Bodies) -> bool {
        let cell_size_m = f64::from(self.settings.cell_size_m);
        let rest_speed = f64::from(self.settings.rest_speed_m_s);
        let reach = REACH_CELLS * cell_size_m;
        let moving = bodies
            .balls
            .iter()
            .filter(|ball| ball.velocity.length() > rest_speed);
        moving.into_iter().any(|ball| {
            self.storage.nodes.iter().any(|node| {
                let center = (node.coordinate.as_dvec3() + 0.375) * 4.0 * cell_size_m;
                center.distance(ball.position) < ball.radius_m + reach
            })
        })
    }

    #[cfg(any(test, feature = "gpu"))]
    pub(crate) fn storage(&self) -> &Storage {
        &self.storage
    }

    #[cfg(test)]
    pub(crate) fn storage_mut(&mut self) -> &mut Storage {
        &mut self.storage
    }

    /// Largest component of a particle's velocity and largest speed of sound, in m/s.
    #[cfg(feature = "gpu")]
    pub(crate) fn speeds(&self) -> (f32, f32) {
        (self.speed_max, self.sound_max)
    }

    /// A simulation of the same settings and materials with other states of its particles, and their largest
    /// velocity component and speed of sound in m/s.
    #[cfg(feature = "gpu")]
    pub(crate) fn with_storage(&self, storage: Storage, speeds: (f32, f32)) -> Self {
        let (speed_max, sound_max) = speeds;
        Self {
            storage,
            speed_max,
            sound_max,
            settings: self.settings,
            level: self.level,
            materials: self.materials.clone(),
            particles: self.particles,
            next_id: self.next_id,
            is_disordered: true,
            drift: 0.0,
            rested_secs: 0.0,
        }
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.particles
    }

    /// Whether there are no particles.
    pub fn is_empty(&self) -> bool {
        self.particles == 0
    }

    /// The settings given to [`Self::new`].
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The distinct materials of all particles added so far.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Mass, momenta and kinetic energy of all particles.
    pub fn totals(&self) -> Totals {
        self.storage.totals()
    }

    /// Every particle, in an order that changes as they move; their ids do not.
    pub fn particles(&self) -> impl Iterator<Item = Particle> + '_ {
        self.storage.particles()
    }
}
