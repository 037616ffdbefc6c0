//! The material point method on a GPU.
//!
//! ```text
//!  once a group of substeps          each substep, no read-back
//! ┌─ order ───────────────┐   ┌──────────────────────────────────────┐
//! │ clear, count, allocate │──▶│ transfer ──▶ grid ──▶ coupling        │──▶ transfer
//! │ finish, move           │   │ gather,      obstacles  balls, next   │    gather
//! └────────────────────────┘   │ strain,      free fall  substep       │
//!                              │ scatter                               │
//!                              └──────────────────────────────────────┘
//! ```
//!
//! Particles lie in chunks of one block of 4x4x4 cells, a workgroup a chunk. A chunk gathers from and
//! scatters to a tile in the workgroup's memory, with a margin of a cell, so that particles need to be
//! put in order only when they may have moved by almost as much. Tiles add up momentum and mass as 32-bit
//! integers and the grid adds up tiles alike: sums of integers do not depend on order, so the same GPU
//! gives the same bits every time. One thread chooses each substep's length by the CPU's rules, and ends a
//! batch early when the grid's region must be fitted anew.

mod batch;
mod bodies;
mod buffers;
mod device;
mod kernels;
mod layout;
mod particle_copy;
mod shader;
mod simulation;

pub use buffers::{GPU_BALLS_MAX, GPU_BLOCKS_MAX, GPU_MATERIALS_MAX, GPU_OBSTACLES_MAX};
pub use device::Gpu;
pub use simulation::GpuSimulation;
