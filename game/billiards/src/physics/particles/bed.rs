//! The particles on a table.

use std::fmt;

use carom_mpm::{Ball, Bodies, Grip, Marbles, Obstacle, Settings, Simulation, Solid};
use glam::{DQuat, DVec2, DVec3, Vec3};

use super::height_map::HeightMap;
use super::marbles;
use super::{ParticleGroup, ParticleMaterial, ParticlePatch, ParticlePrecision};
use crate::physics::{BallState, Table};
use crate::{ParticleFault, Result};

/// Particles on a table, at rest or moving.
#[derive(Clone)]
pub struct ParticleBed {
    patches: Vec<ParticlePatch>,
    precision: ParticlePrecision,
    simulation: Simulation,
    marbles: Marbles,
    obstacles: Vec<Obstacle>,
    /// Groups by material, in the order of the particles' numbers.
    groups: Vec<ParticleGroup>,
    /// Bounding rectangle of the particles at the last [`ParticleBed::find_bounds`], in m.
    bounds: [DVec2; 2],
    /// Heights of the particles between two shots.
    heights: HeightMap,
    /// Half the cloth's length and width, in m.
    cloth_half_m: DVec2,
}

impl fmt::Debug for ParticleBed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut fields = f.debug_struct(stringify!(ParticleBed));
        fields.field("patches", &self.patches.len());
        fields.field("groups", &self.groups).finish_non_exhaustive()
    }
}

impl ParticleBed {
    /// Maximum number of particles on a table: a shot through all of them takes some seconds.
    pub const PARTICLES_MAX: usize = 32_000;

    /// Fresh particles on patches of a table, except where balls lie, settled to rest: 0.1 to 0.8 s of
    /// a core for a trick table.
    ///
    /// # Errors
    /// [`crate::Error::Particles`] if a patch is not on the cloth, or for no particles, more than
    /// [`ParticleBed::PARTICLES_MAX`], or marbles beside others, as neither would push the other.
    pub fn new(
        table: &Table,
        balls: &[BallState],
        patches: &[ParticlePatch],
        precision: ParticlePrecision,
    ) -> Result<Self> {
        Self::unsettled(table, balls, patches, precision)?.settled(balls)
    }

    /// Fresh particles on patches of a table, not settled yet: they slump when simulated.
    ///
    /// # Errors
    /// As [`ParticleBed::new`].
    pub fn unsettled(
        table: &Table,
        balls: &[BallState],
        patches: &[ParticlePatch],
        precision: ParticlePrecision,
    ) -> Result<Self> {
        let mut patches = patches.to_vec();
        // Particle numbers, and so the bits of a shot, must not depend on the order of the patches.
        patches.sort_unstable();
        patches.dedup_by_key(|patch| (patch.column, patch.row));
        let mut simulation = Simulation::new(settings(precision)).map_err(ParticleFault::from)?;
        let mut groups = Vec::new();
        for material in ParticleMaterial::ALL {
            let Some(model) = material.model() else {
                continue;
            };
            let covered = patches.iter().filter(|patch| patch.material == material);
            let places: Vec<Vec3> = covered
                .flat_map(|patch| places(patch, precision))
                .filter(|place| balls.iter().all(|ball| is_clear(ball, *place, precision)))
                .collect();
            check_count(simulation.len() + places.len(), Self::PARTICLES_MAX)?;
            if !places.is_empty() {
                let volume_m3 = spacing_m(precision).powi(3) as f32;
                let added = simulation.add(&places, model, volume_m3, Vec3::ZERO);
                added.map_err(ParticleFault::from)?;
                let count = places.len() as u32;
                groups.push(ParticleGroup { material, count });
            }
        }
        let marbles = marbles::laid(&patches, |place, radius_m| {
            balls.iter().all(|ball| {
                let apart = ball.position.distance(place);
                !ball.phase.is_on_table() || apart > ball.body.radius_m + radius_m
            })
        })?;
        let count = marbles.spheres().len();
        check_count(count, marbles::MARBLES_MAX)?;
        check_count(simulation.len() + count, Self::PARTICLES_MAX)?;
        if count > 0 {
            groups.push(ParticleGroup {
                material: ParticleMaterial::Marbles,
                count: count as u32,
            });
        }
        Self::assemble(table, patches, precision, (simulation, marbles), groups)
    }

    /// The particles settled to rest around immovable balls; unchanged if they are at rest.
    ///
    /// # Errors
    /// [`crate::Error::Particles`] if the simulation fails.
    pub fn settled(mut self, balls: &[BallState]) -> Result<Self> {
        let lying = balls.iter().filter(|ball| ball.phase.is_on_table());
        let lying = lying.map(|ball| Ball::new(ball.position, ball.body.radius_m, IMMOVABLE_KG));
        let lying: Vec<Ball> = lying.collect();
        let steps = (SETTLE_SECS_MAX / SETTLE_STEP_SECS) as u32;
        for _ in 0..steps {
            if self.is_asleep() {
                break;
            }
            self.step(SETTLE_STEP_SECS, lying.clone())?;
        }
        self.put_in_order()?;
        self.find_bounds();
        Ok(self)
    }

    /// Assembles particles on their table.
    ///
    /// # Errors
    /// [`crate::Error::Particles`] if a patch is not on the cloth, there are no particles, or marbles and others.
    pub(super) fn assemble(
        table: &Table,
        patches: Vec<ParticlePatch>,
        precision: ParticlePrecision,
        (simulation, marbles): (Simulation, Marbles),
        groups: Vec<ParticleGroup>,
    ) -> Result<Self> {
        check_places(table, &patches)?;
        if groups.is_empty() {
            return Err(ParticleFault::None.into());
        }
        if !simulation.is_empty() && !marbles.spheres().is_empty() {
            return Err(ParticleFault::Mixed.into());
        }
        let mut bed = Self {
            obstacles: obstacles(table, &patches),
            patches,
            precision,
            simulation,
            marbles,
            groups,
            bounds: [DVec2::ZERO; 2],
            heights: HeightMap::new(&[], spacing_m(precision)),
            cloth_half_m: 0.5 * DVec2::new(table.length_m(), table.width_m()),
        };
        bed.put_in_order()?;
        bed.find_bounds();
        Ok(bed)
    }

    /// A simulation of water between obstacles of its own.
    #[cfg(test)]
    pub(super) fn of_water(
        table: &Table,
        simulation: Simulation,
        obstacles: Vec<Obstacle>,
    ) -> Self {
        let count = simulation.len() as u32;
        let material = ParticleMaterial::Water;
        let groups = vec![ParticleGroup { material, count }];
        let precision = ParticlePrecision::Fine;
        let marbles = marbles::none().expect("a valid marble");
        let bed = Self::assemble(table, Vec::new(), precision, (simulation, marbles), groups);
        Self {
            obstacles,
            ..bed.expect("there are some")
        }
    }

    /// Patches that it was made of.
    pub fn patches(&self) -> &[ParticlePatch] {
        &self.patches
    }

    /// Precision of the simulation.
    pub fn precision(&self) -> ParticlePrecision {
        self.precision
    }

    /// Groups by material, in the order of the particles' numbers.
    pub fn groups(&self) -> &[ParticleGroup] {
        &self.groups
    }

    /// Half the cloth's length and width, in m: no particle moves beyond.
    pub fn cloth_half_m(&self) -> DVec2 {
        self.cloth_half_m
    }

    /// Mean spacing of particles at rest, in m.
    pub fn spacing_m(&self) -> f32 {
        spacing_m(self.precision) as f32
    }

    /// Centres of all particles by their numbers, in m.
    pub fn centers(&self) -> Vec<Vec3> {
        let mut centers = vec![Vec3::ZERO; self.simulation.len()];
        for particle in self.simulation.particles() {
            centers[particle.id as usize] = particle.position;
        }
        let marbles = self.marbles.spheres().iter();
        centers.extend(marbles.map(|marble| marble.position.as_vec3()));
        centers
    }

    pub(super) fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    pub(super) fn marbles(&self) -> &Marbles {
        &self.marbles
    }

    /// Sorts the particles and updates the height map between two shots, so that the bits of the next
    /// shot depend on nothing but the stored state.
    pub(super) fn put_in_order(&mut self) -> Result<()> {
        let ordered = self.simulation.put_in_order();
        ordered.map_err(ParticleFault::from)?;
        let half = 0.5 * self.spacing_m();
        let particles = self.simulation.particles();
        let tops = particles.map(|particle| particle.position + half * Vec3::Z);
        let tops = tops.chain(marbles::tops(&self.marbles));
        let tops: Vec<Vec3> = tops.collect();
        self.heights = HeightMap::new(&tops, spacing_m(self.precision));
        Ok(())
    }

    /// Heights of the particles between two shots.
    pub(super) fn heights(&self) -> &HeightMap {
        &self.heights
    }

    pub(super) fn has_marbles(&self) -> bool {
        !self.marbles.spheres().is_empty()
    }

    /// Whether all particles are at rest until a ball disturbs them.
    pub(super) fn is_asleep(&self) -> bool {
        self.simulation.is_asleep() && self.marbles.is_asleep()
    }

    /// Updates the bounding rectangle of the particles.
    pub(super) fn find_bounds(&mut self) {
        let particles = self.simulation.particles();
        let places = particles.map(|particle| particle.position.truncate().as_dvec2());
        let places = places.chain(marbles::reach(&self.marbles));
        let none = [DVec2::INFINITY, DVec2::NEG_INFINITY];
        self.bounds = places.fold(none, |[min, max], place| [min.min(place), max.max(place)]);
    }

    /// Whether a ball may touch particles within a step.
    pub(super) fn may_touch(&self, position: DVec3, radius_m: f64) -> bool {
        let reach = radius_m + REACH_CELLS * self.precision.cell_size_m();
        let [min, max] = self.bounds;
        let at = position.truncate();
        (at.cmpge(min - reach) & at.cmple(max + reach)).all()
    }

    /// Whether particles at rest reach a ball at this position, and so may carry it.
    pub(super) fn carries(&self, position: DVec3, radius_m: f64) -> bool {
        let reach_m = radius_m + self.precision.cell_size_m();
        self.heights.touches(position, reach_m)
    }

    /// Advances the particles; returns the balls with the impulses from particles.
    pub(super) fn step(&mut self, secs: f64, balls: Vec<Ball>) -> Result<Vec<Ball>> {
        let mut bodies = Bodies {
            balls,
            obstacles: std::mem::take(&mut self.obstacles),
        };
        let stepped = match self.has_marbles() {
            true => self.marbles.step(secs, &mut bodies),
            false => self.simulation.step(secs, &mut bodies).map(drop),
        };
        self.obstacles = bodies.obstacles;
        stepped.map_err(ParticleFault::from)?;
        Ok(bodies.balls)
    }
}

pub(super) fn settings(precision: ParticlePrecision) -> Settings {
    Settings {
        cell_size_m: precision.cell_size_m() as f32,
        // Grains that creep more slowly count as at rest: a shot must not wait for the last of them.
        rest_speed_m_s: 0.02,
        ..Settings::default()
    }
}

/// Spacing of particles at rest, in m.
fn spacing_m(precision: ParticlePrecision) -> f64 {
    precision.cell_size_m() / 2.0
}

/// Positions of a patch's particles, each with an equal part of its volume: whole numbers along each
/// edge.
fn places(patch: &ParticlePatch, precision: ParticlePrecision) -> impl Iterator<Item = Vec3> {
    let spacing = spacing_m(precision);
    let along = (ParticlePatch::EDGE_M / spacing).round().max(1.0);
    let layers = (patch.material.depth_m() / spacing).round().max(1.0);
    let corner = patch.corner().extend(0.0);
    let step = ParticlePatch::EDGE_M / along;
    let count = [along as u32, along as u32, layers as u32];
    let indices = (0..count[0])
        .flat_map(move |x| (0..count[1]).flat_map(move |y| (0..count[2]).map(move |z| [x, y, z])));
    indices.map(move |index| {
        let number = (index[0] * count[1] + index[1]) * count[2] + index[2];
        // Seeded by position, not by the order of patches: an added patch leaves the grains of the
        // others where they are.
        let shift = scatter(patch_seed(corner), number) * SCATTER;
        let at = DVec3::from(index.map(f64::from)) + 0.5 + shift;
        (corner + at * DVec3::new(step, step, spacing)).as_vec3()
    })
}

fn patch_seed(corner: DVec3) -> u64 {
    corner.x.to_bits() ^ corner.y.to_bits().rotate_left(32)
}

/// Three numbers in ±0.5 from a hash of two words: the mixer of SplitMix64 (Steele, Lea and Flood 2014,
/// "Fast splittable pseudorandom number generators").
fn scatter(seed: u64, number: u32) -> DVec3 {
    let mut word = seed.wrapping_add(u64::from(number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^= word >> 31;
    let part = |shift: u32| ((word >> shift) & 0xfffff) as f64 / f64::from(1 << 20) - 0.5;
    DVec3::new(part(0), part(20), part(40))
}

fn check_count(particles: usize, max: usize) -> Result<()> {
    match particles <= max {
        true => Ok(()),
        false => Err(ParticleFault::TooMany { particles, max }.into()),
    }
}

fn is_clear(ball: &BallState, place: Vec3, precision: ParticlePrecision) -> bool {
    let reach_m = ball.body.radius_m + 0.5 * spacing_m(precision);
    let is_there = ball.phase.is_on_table();
    !is_there || ball.position.distance(place.as_dvec3()) > reach_m
}

fn check_places(table: &Table, patches: &[ParticlePatch]) -> Result<()> {
    match patches.iter().find(|patch| !patch.is_on_cloth(table)) {
        Some(patch) => Err(ParticleFault::OffCloth { at: patch.corner() }.into()),
        None => Ok(()),
    }
}

/// Boundaries of the particles: the cloth, the cushions all around, also where pockets are, and the
/// solid that jelly is glued to.
fn obstacles(table: &Table, patches: &[ParticlePatch]) -> Vec<Obstacle> {
    let half = 0.5 * DVec2::new(table.length_m(), table.width_m());
    let mut obstacles = vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)];
    for (axis, reach) in [(DVec3::X, half.x), (DVec3::Y, half.y)] {
        for normal in [axis, -axis] {
            obstacles.push(Obstacle::plane(-reach * normal, normal));
        }
    }
    let jelly = patches
        .iter()
        .filter(|patch| patch.material == ParticleMaterial::Jelly);
    let corners: Vec<DVec2> = jelly.map(ParticlePatch::corner).collect();
    if let Some(first) = corners.first() {
        let min = corners.iter().fold(*first, |min, corner| min.min(*corner));
        let max = corners.iter().fold(*first, |max, corner| max.max(*corner));
        let half_size = (0.5 * (max + ParticlePatch::EDGE_M - min)).extend(0.5 * GLUE_M);
        obstacles.push(Obstacle {
            solid: Solid::Cuboid {
                center: (min + half_size.truncate()).extend(-0.5 * GLUE_M),
                half_size,
                orientation: DQuat::IDENTITY,
            },
            grip: Grip::Bonded,
        });
    }
    obstacles
}

/// Time in s by which fresh particles have come to rest, or creep too slowly to be seen.
const SETTLE_SECS_MAX: f64 = 6.0;
/// Interval in s between two checks whether they are at rest.
const SETTLE_STEP_SECS: f64 = 1.0 / 60.0;
/// Mass of a ball at rest while particles settle.
const IMMOVABLE_KG: f64 = 1e6;
/// Random displacement over the spacing: grains are no lattice.
const SCATTER: f64 = 0.9;
/// Reach of particles' grid nodes in cells, more than a ball moves in a step.
const REACH_CELLS: f64 = 4.0;
/// Thickness of the solid that jelly is glued to, in m.
const GLUE_M: f64 = 0.06;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_laid_lies() {
        for material in ParticleMaterial::ALL {
            let squares = (0..6).flat_map(|column| (-3..3).map(move |row| (column, row)));
            let patch = |(column, row)| ParticlePatch {
                material,
                column,
                row,
            };
            let patches: Vec<_> = squares.map(patch).collect();
            let table = Table::nine_foot();
            let balls = [BallState::at_rest(1, 0.1, 0.05, &table.ball())];
            let precision = ParticlePrecision::Coarse;
            let fresh = ParticleBed::unsettled(&table, &balls, &patches, precision).unwrap();
            assert!(!fresh.is_asleep());
            let mut bed = ParticleBed::new(&table, &balls, &patches, precision).unwrap();
            assert!(bed.is_asleep(), "{material:?}");
            let laid = bed.centers();
            bed.step(1.0, Vec::new()).unwrap();
            assert!(laid == bed.centers(), "{material:?} moves before a stroke");
            // Grains lie around the ball, none in it.
            let depth = laid.iter().map(|center| {
                balls[0].body.radius_m - balls[0].position.distance(center.as_dvec3())
            });
            let deepest = depth.fold(f64::MIN, f64::max);
            assert!(deepest < 0.0, "{material:?}: {deepest} m");
        }
    }
}
