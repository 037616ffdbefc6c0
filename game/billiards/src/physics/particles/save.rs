//! Particles of a table as a file has them: the numbers of the simulation, from which it goes on with the same bits.

use carom_mpm::{Simulation, Snapshot};
use serde::{Deserialize, Serialize};

use super::bed::settings;
use super::{ParticleBed, ParticleMaterial, ParticlePatch, ParticlePrecision, TrackGroup};
use crate::physics::Table;
use crate::{ParticleFault, Result};

/// Particles of a table, as they lie or move: 110 bytes each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BedSave {
    patches: Vec<ParticlePatch>,
    precision: ParticlePrecision,
    groups: Vec<TrackGroup>,
    snapshot: Snapshot,
}

impl BedSave {
    pub(crate) fn of(bed: &ParticleBed) -> Self {
        let groups = bed.groups().iter();
        let groups = groups.map(|&(material, count)| TrackGroup { material, count });
        Self {
            patches: bed.patches().to_vec(),
            precision: bed.precision(),
            groups: groups.collect(),
            snapshot: bed.simulation().snapshot(),
        }
    }

    /// The particles on their table.
    ///
    /// # Errors
    /// [`crate::Error::Particles`] for particles that no table has.
    pub(crate) fn restore(&self, table: &Table) -> Result<ParticleBed> {
        let groups: Vec<(ParticleMaterial, u32)> = self
            .groups
            .iter()
            .map(|group| (group.material, group.count))
            .collect();
        self.check_groups()?;
        let materials: Vec<_> = groups
            .iter()
            .map(|(material, _)| material.model())
            .collect();
        let settings = settings(self.precision);
        let simulation = Simulation::restore(settings, &materials, &self.snapshot);
        let simulation = simulation.map_err(ParticleFault::from)?;
        ParticleBed::assemble(
            table,
            self.patches.clone(),
            self.precision,
            simulation,
            groups,
        )
    }

    /// Whether there are as many particles of each material as is said, in the order of their numbers.
    fn check_groups(&self) -> Result<(), ParticleFault> {
        let total: u64 = self.groups.iter().map(|group| u64::from(group.count)).sum();
        let max = ParticleBed::PARTICLES_MAX;
        if total > max as u64 {
            let particles = total as usize;
            return Err(ParticleFault::TooMany { particles, max });
        }
        let said = self.groups.iter().zip(0u16..);
        let said = said.flat_map(|(group, index)| std::iter::repeat_n(index, group.count as usize));
        let materials = self.snapshot.materials_by_id();
        let is_in_order = self
            .groups
            .windows(2)
            .all(|pair| pair[0].material < pair[1].material);
        if !is_in_order || !materials.is_some_and(|materials| said.eq(materials)) {
            return Err(ParticleFault::OtherThanSaid);
        }
        Ok(())
    }
}
