//! The crate's error type, whose messages name the wrong value and what would be right.

use glam::Vec3;

/// Result of the crate's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Failure of a request. Unless a function says otherwise, the simulation is as it was before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A number of settings, material, body or step is out of range.
    #[error("the {quantity} is {value}: it must be from {min:e} to {max:e}")]
    OutOfRange {
        /// Name and unit of the quantity.
        quantity: &'static str,
        /// Its value.
        value: f64,
        /// Least allowed value.
        min: f64,
        /// Greatest allowed value.
        max: f64,
    },
    /// A component of a vector is NaN or infinite.
    #[error("the {quantity} {value} is not finite: check what computed it")]
    NotFinite {
        /// Name of the quantity.
        quantity: &'static str,
        /// Its value.
        value: Vec3,
    },
    /// A region is too small for a single particle.
    #[error(
        "the region holds no particle: it must be wider than {spacing_m} m, the distance of \
         particles, or the cells must be smaller"
    )]
    EmptyRegion {
        /// Distance between neighbouring particles, in m.
        spacing_m: f32,
    },
    /// More particles than a simulation may have.
    #[error("{particles} particles are more than {max}: use larger cells or a smaller region")]
    TooManyParticles {
        /// Number of particles that there would be.
        particles: usize,
        /// Largest allowed number.
        max: usize,
    },
    /// A particle is so far from the origin that its block's coordinates are out of range.
    #[error("a particle at {position_m} m is out of reach: remove it with `retain`")]
    OutOfReach {
        /// Position of the particle, in m.
        position_m: Vec3,
    },
    /// A step would take more substeps than allowed.
    #[error(
        "a step of {duration_secs} s takes {substeps} substeps of {substep_secs:e} s, more than \
         {max}: step less, or use larger cells or softer materials"
    )]
    TooManySubsteps {
        /// Duration of the step, in s.
        duration_secs: f64,
        /// Number of substeps that it would take.
        substeps: f64,
        /// Longest stable substep, in s.
        substep_secs: f64,
        /// Largest allowed number of substeps.
        max: u32,
    },
    /// There is no device with compute through Vulkan, Metal or Direct3D 12.
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
        /// Name and driver of the GPU.
        device: String,
        /// Description of the failure.
        message: String,
    },
    /// A GPU's buffers or the kernels' tables are too small.
    #[cfg(feature = "gpu")]
    #[error(
        "the number of {quantity} is {value}: {device} takes {max} at most; use fewer, or the CPU"
    )]
    GpuLimit {
        /// Name of the quantity that is too large.
        quantity: &'static str,
        /// Its value.
        value: u64,
        /// Largest value that the device takes.
        max: u64,
        /// Name and driver of the GPU.
        device: String,
    },
    /// The 32-bit integers in which a GPU sums mass and momentum came near to overflow.
    #[cfg(feature = "gpu")]
    #[error(
        "a node of the grid holds more than {times} times the mass of the fullest cell at the start, or \
         its momentum at twice the fastest speed: lower `Settings::courant`, now {courant}, and start again"
    )]
    NodeTooHeavy {
        /// Largest allowed mass of a node over the nominal mass.
        times: u32,
        /// [`crate::Settings::courant`] as it was set.
        courant: f32,
    },
    /// A snapshot is not one that a simulation returns.
    #[error("the stored particles are none of a simulation: {fault}")]
    BadSnapshot {
        /// Description of the fault.
        fault: &'static str,
    },
    /// Velocities are no longer finite.
    #[error("the simulation diverged: lower `Settings::courant`, now {courant}, and start again")]
    Diverged {
        /// [`crate::Settings::courant`] as it was set.
        courant: f32,
    },
    /// The state of a marble is no longer finite.
    #[error(
        "the marbles diverged at substeps of {substep_secs:e} s: make them softer or heavier, or the balls that meet \
         them slower, and start again"
    )]
    MarblesDiverged {
        /// Length of the substeps, in s.
        substep_secs: f64,
    },
}

/// Returns an error for a number that is not in a closed range, or NaN.
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

/// Returns an error for a vector with a component that is not finite.
pub(crate) fn check_finite(quantity: &'static str, value: Vec3) -> Result<()> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::NotFinite { quantity, value })
}
