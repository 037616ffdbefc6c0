//! The crate's error: what was wrong, with its value, and what would be right.

use glam::Vec3;

/// The crate's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// A request that cannot be carried out. The simulation is as it was before it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A number of settings, material, body or step is out of range.
    #[error("the {quantity} is {value}: it must be from {min:e} to {max:e}")]
    OutOfRange {
        /// Its name and unit.
        quantity: &'static str,
        /// What it is.
        value: f64,
        /// The least.
        min: f64,
        /// The most.
        max: f64,
    },
    /// A place, a speed or a deformation is no number or infinite.
    #[error("the {quantity} {value} is not finite: check what computed it")]
    NotFinite {
        /// Its name.
        quantity: &'static str,
        /// What it is.
        value: Vec3,
    },
    /// A region holds not one particle.
    #[error(
        "the region holds no particle: it must be wider than {spacing_m} m, the distance of \
         particles, or the cells must be smaller"
    )]
    EmptyRegion {
        /// Between neighbouring particles, in m.
        spacing_m: f32,
    },
    /// More particles than a simulation may have.
    #[error("{particles} particles are more than {max}: use larger cells or a smaller region")]
    TooManyParticles {
        /// How many there would be.
        particles: usize,
        /// The most.
        max: usize,
    },
    /// A particle is so far away that its cell has no number.
    #[error("a particle at {position_m} m is out of reach: remove it with `retain`")]
    OutOfReach {
        /// In m.
        position_m: Vec3,
    },
    /// A step would take more substeps than allowed.
    #[error(
        "a step of {duration_secs} s takes {substeps} substeps of {substep_secs:e} s, more than \
         {max}: step less, or use larger cells or softer materials"
    )]
    TooManySubsteps {
        /// Of the step, in s.
        duration_secs: f64,
        /// How many it would take.
        substeps: f64,
        /// As they were, in s.
        substep_secs: f64,
        /// The most.
        max: u32,
    },
    /// No device computes through Vulkan, Metal or Direct3D 12.
    #[cfg(feature = "gpu")]
    #[error(
        "there is no GPU: install its Vulkan driver, or one in software (Debian: \
         mesa-vulkan-drivers) and allow it"
    )]
    NoGpu,
    /// A GPU or its driver failed.
    #[cfg(feature = "gpu")]
    #[error("{device}: {message}")]
    Gpu {
        /// Its name and driver.
        device: String,
        /// What happened.
        message: String,
    },
    /// A GPU's buffers or the kernels' tables are too small.
    #[cfg(feature = "gpu")]
    #[error(
        "the number of {quantity} is {value}: {device} takes {max} at most; use fewer, or the CPU"
    )]
    GpuLimit {
        /// Of what there is too much.
        quantity: &'static str,
        /// How many.
        value: u64,
        /// The most.
        max: u64,
        /// The GPU's name and driver.
        device: String,
    },
    /// The integers in which a GPU sums are too small.
    #[cfg(feature = "gpu")]
    #[error(
        "a node of the grid holds more than {times} times the mass of the fullest cell at the start, or \
         its momentum at twice the fastest speed: lower `Settings::courant`, now {courant}, and start again"
    )]
    NodeTooHeavy {
        /// The most.
        times: u32,
        /// As it was set.
        courant: f32,
    },
    /// Stored particles that no simulation has.
    #[error("the stored particles are none of a simulation: {fault}")]
    BadSnapshot {
        /// What they have that none has.
        fault: &'static str,
    },
    /// Velocities grew past all numbers.
    #[error("the simulation diverged: lower `Settings::courant`, now {courant}, and start again")]
    Diverged {
        /// As it was set.
        courant: f32,
    },
    /// Velocities of marbles grew past all numbers.
    #[error(
        "the marbles diverged at substeps of {substep_secs:e} s: make them softer or heavier, or the balls that meet \
         them slower, and start again"
    )]
    MarblesDiverged {
        /// As they were, in s.
        substep_secs: f64,
    },
}

/// Refuses a number that is not in a closed range.
pub(crate) fn check_range(quantity: &'static str, value: f64, min: f64, max: f64) -> Result<()> {
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(Error::OutOfRange {
        quantity,
        value,
        min,
        max,
    })
}

/// Refuses a vector with a component that is not finite.
pub(crate) fn check_finite(quantity: &'static str, value: Vec3) -> Result<()> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::NotFinite { quantity, value })
}
