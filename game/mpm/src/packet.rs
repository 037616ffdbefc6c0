//! Packets of particles, laid out for SIMD.

use glam::Vec3;

use crate::lanes::LANES;

/// Up to 16 particles of one block and material. Lanes from `len` on are unused.
#[derive(Clone)]
pub(crate) struct Packet {
    /// Index of the material.
    pub(crate) material: u16,
    pub(crate) len: usize,
    /// Positions in cells from the block's first node, less one half; x, y, z and 0.
    pub(crate) position: [[f32; 4]; LANES],
    /// Velocities in m/s; x, y, z and 0.
    pub(crate) velocity: [[f32; 4]; LANES],
    /// Columns of the affine velocity matrix of APIC: change of velocity over a cell along x, y and
    /// z, in m/s.
    pub(crate) affine: [[[f32; 4]; LANES]; 3],
    /// Elastic deformation gradients in row-major order, each up to a rotation from the right.
    pub(crate) deformation: [[f32; LANES]; 9],
    /// State variable of the material's model.
    pub(crate) state: [f32; LANES],
    /// Masses in kg; 0 in unused lanes.
    pub(crate) mass: [f32; LANES],
    /// Volumes at rest, in m³.
    pub(crate) volume: [f32; LANES],
    pub(crate) id: [u32; LANES],
}

impl Packet {
    pub(crate) fn new(material: u16, state: f32) -> Self {
        let one = [1.0; LANES];
        let zero = [0.0; LANES];
        Self {
            material,
            len: 0,
            position: [[0.0; 4]; LANES],
            velocity: [[0.0; 4]; LANES],
            affine: [[[0.0; 4]; LANES]; 3],
            deformation: [one, zero, zero, zero, one, zero, zero, zero, one],
            state: [state; LANES],
            mass: zero,
            volume: zero,
            id: [u32::MAX; LANES],
        }
    }

    /// Appends a particle of another packet, which must have the same material.
    pub(crate) fn push(&mut self, from: &Self, lane: usize) {
        let to = self.len;
        self.len += 1;
        self.position[to] = from.position[lane];
        self.velocity[to] = from.velocity[lane];
        for (to_column, column) in self.affine.iter_mut().zip(&from.affine) {
            to_column[to] = column[lane];
        }
        for (to_entry, entry) in self.deformation.iter_mut().zip(&from.deformation) {
            to_entry[to] = entry[lane];
        }
        self.state[to] = from.state[lane];
        self.mass[to] = from.mass[lane];
        self.volume[to] = from.volume[lane];
        self.id[to] = from.id[lane];
    }

    /// Columns of a particle's affine velocity matrix, in m/s a cell.
    pub(crate) fn affine_columns(&self, lane: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|axis: usize| Vec3::from_slice(&self.affine[axis][lane]))
    }
}

/// The last of a block's packets, or a new one if that is full or of another material.
pub(crate) fn room_in(
    packets: &mut Vec<Packet>,
    material: u16,
    state: impl FnOnce() -> f32,
) -> &mut Packet {
    let is_full = |last: &Packet| last.len == LANES || last.material != material;
    if packets.last().is_none_or(is_full) {
        packets.push(Packet::new(material, state()));
    }
    packets.last_mut().expect("there is one now")
}
