//! Layout of the buffers that kernels read and write. It mirrors `shaders/structs.wgsl`, which describes
//! the fields.

use bytemuck::{Pod, Zeroable};

use crate::gpu::shader;
use crate::material::Material;

/// Constants of a batch.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub(super) origin: [i32; 3],
    pub(super) particles: u32,
    pub(super) blocks: [u32; 3],
    pub(super) balls: u32,
    pub(super) gravity: [f32; 3],
    pub(super) cell_size: f32,
    pub(super) courant: f32,
    pub(super) mass_scale: f32,
    pub(super) margin: f32,
    pub(super) group: u32,
    pub(super) obstacles: u32,
    pub(super) padding: [u32; 3],
}

/// State of the sequence of substeps.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Control {
    pub(super) dt: f32,
    pub(super) left: f32,
    pub(super) drift: f32,
    pub(super) travelled: f32,
    pub(super) momentum_scale: f32,
    pub(super) gather_scale: f32,
    pub(super) speed: f32,
    pub(super) sound: f32,
    pub(super) group_left: u32,
    pub(super) gather: u32,
    pub(super) scatter: u32,
    pub(super) substeps: u32,
    pub(super) orderings: u32,
    pub(super) padding: [u32; 3],
}

/// Counts and bounds that the threads of kernels accumulate atomically.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Counters {
    pub(super) particles: u32,
    pub(super) chunks: u32,
    pub(super) nodes: u32,
    pub(super) speed: u32,
    pub(super) sound: u32,
    pub(super) touched: u32,
    pub(super) faults: u32,
    pub(super) padding: u32,
    pub(super) low: [i32; 4],
    pub(super) high: [i32; 4],
}

/// Bits of [`Counters::faults`].
pub(super) const NOT_FINITE: u32 = 1;
pub(super) const DRIFTED: u32 = 2;
pub(super) const TOO_HEAVY: u32 = 4;

/// Range of particles of one block, processed by one workgroup.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Chunk {
    pub(super) block: [i32; 3],
    pub(super) start: u32,
    pub(super) len: u32,
    pub(super) padding: [u32; 3],
}

/// Constants of a material.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct MaterialRow {
    kind: u32,
    density: f32,
    friction: f32,
    sound: f32,
    lambda: f32,
    mu: f32,
    viscosity: f32,
    stiffness: f32,
    pub(super) bulk: f32,
    stretch_low: f32,
    stretch_high: f32,
    hardening: f32,
}

impl MaterialRow {
    pub(super) fn new(material: &Material) -> Self {
        let mut row = Self {
            kind: shader::kind(material) as u32,
            density: material.density_kg_m3(),
            friction: material.friction(),
            sound: material.sound_speed_m_s(),
            ..Self::default()
        };
        let mut lame = |lame: crate::material::Lame| {
            row.lambda = lame.lambda;
            row.mu = lame.mu;
        };
        match material {
            Material::Jelly(jelly) => {
                lame(jelly.lame());
                row.viscosity = jelly.viscosity_pa_s;
            }
            Material::Water(water) => {
                row.viscosity = water.viscosity_pa_s;
                row.stiffness = water.stiffness_pa();
            }
            Material::Sand(sand) => {
                lame(sand.lame());
                row.bulk = sand.yield_factor();
            }
            Material::Snow(snow) => {
                lame(snow.lame());
                [row.stretch_low, row.stretch_high] = snow.critical_stretches();
                row.hardening = snow.hardening;
            }
        }
        row
    }
}

/// A ball, in cells from the region's first node.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct BallRow {
    pub(super) position: [f32; 3],
    pub(super) radius: f32,
    pub(super) velocity: [f32; 3],
    pub(super) mass: f32,
    pub(super) spin: [f32; 3],
    /// Least height of its centre, in cells.
    pub(super) floor_height: f32,
    pub(super) acceleration: [f32; 3],
    pub(super) padding_1: f32,
    pub(super) moved: [f32; 3],
    pub(super) padding_2: f32,
    pub(super) impulse: [f32; 3],
    pub(super) padding_3: f32,
    pub(super) turn: [f32; 3],
    pub(super) padding_4: f32,
}

/// A half-space or a box, in cells from the region's first node.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct ObstacleRow {
    pub(super) place: [f32; 3],
    pub(super) offset: f32,
    pub(super) half_size: [f32; 3],
    pub(super) is_bonded: u32,
    pub(super) axes: [[f32; 4]; 3],
}
