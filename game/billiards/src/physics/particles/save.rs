//! Particles of a table as a file stores them: the full state of the simulation, which continues with
//! the same bits.

use carom_mpm::{MarbleSnapshot, Simulation, Snapshot};
use serde::{Deserialize, Serialize};

use super::bed::settings;
use super::marbles;
use super::{ParticleBed, ParticleGroup, ParticlePatch, ParticlePrecision};
use crate::physics::Table;
use crate::{ParticleFault, Result};

/// Particles of a table, at rest or moving: 110 bytes each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BedSave {
    patches: Vec<ParticlePatch>,
    precision: ParticlePrecision,
    groups: Vec<ParticleGroup>,
    snapshot: Snapshot,
    marbles: MarbleSnapshot,
}

impl BedSave {
    pub(crate) fn of(bed: &ParticleBed) -> Self {
        Self {
            patches: bed.patches().to_vec(),
            precision: bed.precision(),
            groups: bed.groups().to_vec(),
            snapshot: bed.simulation().snapshot(),
            marbles: bed.marbles().snapshot(),
        }
    }

    /// Restores the particles on their table.
    ///
    /// # Errors
    /// [`crate::Error::Particles`] for contents that no table can have.
    pub(crate) fn restore(&self, table: &Table) -> Result<ParticleBed> {
        self.check_groups()?;
        let materials = self
            .groups
            .iter()
            .filter_map(|group| group.material.model());
        let materials: Vec<_> = materials.collect();
        let settings = settings(self.precision);
        let simulation = Simulation::restore(settings, &materials, &self.snapshot);
        let simulation = simulation.map_err(ParticleFault::from)?;
        let mut marbles = marbles::none()?;
        let restored = marbles.restore(&self.marbles);
        restored.map_err(ParticleFault::from)?;
        let patches = self.patches.clone();
        ParticleBed::assemble(
            table,
            patches,
            self.precision,
            (simulation, marbles),
            self.groups.clone(),
        )
    }

    /// Checks that the groups match the materials of the particles, in the order of their numbers.
    fn check_groups(&self) -> Result<(), ParticleFault> {
        let total: u64 = self.groups.iter().map(|group| u64::from(group.count)).sum();
        let max = ParticleBed::PARTICLES_MAX;
        if total > max as u64 {
            let particles = total as usize;
            return Err(ParticleFault::TooMany { particles, max });
        }
        let mut marbles = 0;
        let mut said = Vec::new();
        for group in &self.groups {
            match group.material.model() {
                None => marbles += group.count as usize,
                // Models are numbered as groups are: marbles are the last.
                Some(_) => {
                    let number = said.last().map_or(0, |last: &u16| last + 1);
                    said.extend(std::iter::repeat_n(number, group.count as usize));
                }
            }
        }
        let is_right = marbles == self.marbles.len() && self.groups.iter().all(|g| g.count > 0);
        let materials = self.snapshot.materials_by_id();
        let is_in_order = self
            .groups
            .windows(2)
            .all(|pair| pair[0].material < pair[1].material);
        if !is_in_order || !is_right || materials.as_ref() != Some(&said) {
            return Err(ParticleFault::OtherThanSaid);
        }
        Ok(())
    }
}
