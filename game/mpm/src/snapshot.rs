//! Serialisable snapshot of a simulation, from which it continues with the same bits.

use glam::{IVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::material::Material;
use crate::settings::{PARTICLES_MAX, Settings};
use crate::simulation::Simulation;
use crate::storage::{BLOCK_COORDINATE_MAX, BLOCK_EDGE, Particle, ParticleState};

/// The changing state of a [`Simulation`], about 110 bytes a particle. The caller stores its settings and
/// materials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    blocks: Vec<BlockSnapshot>,
    next_id: u32,
    sound_max_m_s: f32,
    rested_secs: f64,
}

/// The particles of a block of cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct BlockSnapshot {
    coordinate: [i32; 3],
    particles: Vec<ParticleSnapshot>,
}

/// State of a particle, in the units of [`crate::packet::Packet`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct ParticleSnapshot {
    id: u32,
    material: u16,
    volume_m3: f32,
    position: [f32; 3],
    velocity: [f32; 3],
    affine: [[f32; 3]; 3],
    deformation: [f32; 9],
    state: f32,
}

impl Simulation {
    /// A copy of the particles' present state.
    pub fn snapshot(&self) -> Snapshot {
        let blocks = self.storage.states().map(|(coordinate, particles)| {
            let particles = particles.into_iter().map(ParticleSnapshot::of);
            BlockSnapshot {
                coordinate: coordinate.to_array(),
                particles: particles.collect(),
            }
        });
        Snapshot {
            blocks: blocks.collect(),
            next_id: self.next_id,
            sound_max_m_s: self.sound_max,
            rested_secs: self.rested_secs,
        }
    }

    /// A simulation of the particles of a snapshot, sorted. With the settings and materials of the original
    /// simulation, later steps give the same bits as those of the original after
    /// [`Simulation::put_in_order`].
    ///
    /// # Errors
    /// If a setting or a material is out of its range, or the snapshot is not one that a simulation returns.
    pub fn restore(
        settings: Settings,
        materials: &[Material],
        snapshot: &Snapshot,
    ) -> Result<Self> {
        let mut simulation = Self::new(settings)?;
        for material in materials {
            material.validate()?;
        }
        snapshot.validate(materials)?;
        simulation.materials = materials.to_vec();
        for block in &snapshot.blocks {
            let coordinate = IVec3::from_array(block.coordinate);
            for particle in &block.particles {
                let state = particle.state(materials);
                let velocity = state.particle.velocity.abs().max_element();
                simulation.speed_max = simulation.speed_max.max(velocity);
                simulation.storage.add_state(coordinate, &state);
                simulation.particles += 1;
            }
        }
        simulation.next_id = snapshot.next_id;
        simulation.sound_max = snapshot.sound_max_m_s;
        simulation.rested_secs = snapshot.rested_secs;
        simulation.put_in_order()?;
        Ok(simulation)
    }
}

impl Snapshot {
    /// Index of the material of each particle, by particle id; none if an id is missing or occurs twice.
    pub fn materials_by_id(&self) -> Option<Vec<u16>> {
        let count = self.particles().count();
        let mut materials = vec![None; count];
        for particle in self.particles() {
            let slot = materials.get_mut(particle.id as usize)?;
            if slot.replace(particle.material).is_some() {
                return None;
            }
        }
        materials.into_iter().collect()
    }

    fn particles(&self) -> impl Iterator<Item = &ParticleSnapshot> {
        self.blocks.iter().flat_map(|block| &block.particles)
    }

    fn validate(&self, materials: &[Material]) -> Result<()> {
        let refuse = |fault| Err(Error::BadSnapshot { fault });
        if self.next_id as usize > PARTICLES_MAX {
            return refuse("there are more than a simulation may have");
        }
        if !(0.0..SPEED_MAX_M_S).contains(&self.sound_max_m_s) {
            return refuse("their sound is not from 0 to 10 km/s");
        }
        if !(self.rested_secs >= 0.0 && self.rested_secs.is_finite()) {
            return refuse("they have rested for a time that is none");
        }
        let far = |block: &BlockSnapshot| {
            let coordinate = IVec3::from_array(block.coordinate).as_dvec3();
            coordinate.abs().max_element() > BLOCK_COORDINATE_MAX
        };
        if self.blocks.iter().any(far) {
            return refuse("some are out of reach");
        }
        match self.particles().find_map(|p| p.fault(self, materials)) {
            Some(fault) => refuse(fault),
            None => Ok(()),
        }
    }
}

impl ParticleSnapshot {
    fn of(state: ParticleState) -> Self {
        let ParticleState {
            particle,
            local,
            affine,
            deformation,
            state,
        } = state;
        Self {
            id: particle.id,
            material: particle.material as u16,
            volume_m3: particle.volume_m3,
            position: local.to_array(),
            velocity: particle.velocity.to_array(),
            affine: affine.map(|column| column.to_array()),
            deformation,
            state,
        }
    }

    fn state(&self, materials: &[Material]) -> ParticleState {
        let material = usize::from(self.material);
        ParticleState {
            particle: Particle {
                id: self.id,
                position: Vec3::ZERO,
                velocity: Vec3::from_array(self.velocity),
                mass_kg: self.volume_m3 * materials[material].density_kg_m3(),
                volume_m3: self.volume_m3,
                material,
            },
            local: Vec3::from_array(self.position),
            affine: self.affine.map(Vec3::from_array),
            deformation: self.deformation,
            state: self.state,
        }
    }

    /// The first reason why it cannot be a particle of a simulation, if there is one.
    fn fault(&self, snapshot: &Snapshot, materials: &[Material]) -> Option<&'static str> {
        let edge = BLOCK_EDGE as f32;
        let is_near = |at: &f32| (-edge..2.0 * edge).contains(at);
        let is_slow = |speed: &f32| speed.abs() < SPEED_MAX_M_S;
        let mut strains = self.deformation.iter().chain([&self.state]);
        if usize::from(self.material) >= materials.len() {
            Some("one is of a material that there is not")
        } else if self.id >= snapshot.next_id {
            Some("one has a number that was not given yet")
        } else if !(VOLUME_M3_MIN..=VOLUME_M3_MAX).contains(&self.volume_m3) {
            Some("one has no volume, or more than there can be")
        } else if !self.position.iter().all(is_near) {
            Some("one is not in its block")
        } else if !self.velocity.iter().all(is_slow) || !self.affine.iter().flatten().all(is_slow) {
            Some("one is faster than 10 km/s")
        } else if !strains.all(|strain| strain.abs() < STRAIN_MAX) {
            Some("one is deformed beyond all measure")
        } else {
            None
        }
    }
}

/// Bound on speeds: beyond those of a stable simulation.
const SPEED_MAX_M_S: f32 = 1e4;
/// The range of volumes of [`Simulation::add`].
const VOLUME_M3_MIN: f32 = 1e-18;
const VOLUME_M3_MAX: f32 = 1e3;
/// Bound on the entries of a deformation gradient: a stretch to a thousand times the length.
const STRAIN_MAX: f32 = 1e3;
