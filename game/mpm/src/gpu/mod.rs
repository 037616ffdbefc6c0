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
//! Particles are stored in chunks, each of one block of 4x4x4 cells and processed by one workgroup. A chunk
//! gathers from and scatters to a tile in workgroup memory, with a margin of a cell, so that particles need
//! to be sorted only when they may have moved by almost as much. Tiles accumulate momentum and mass as
//! 32-bit integers, and so does the grid: integer sums do not depend on order, so the same GPU gives the
//! same bits every time. One thread chooses each substep's length by the CPU's rules, and ends a batch
//! early when the grid's region must be fitted anew.

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
