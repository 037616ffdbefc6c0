//! Pockets: their holes and leather collars.

use carom_billiards::physics::Table;
use carom_tracer::{Axis, CsgSolid, Shape, Subtraction};
use glam::{Vec2, Vec3};

use super::{SceneBuilder, beyond, subtraction};

impl SceneBuilder {
    /// Adds a leather collar with a bevelled rim around each pocket, on the wood.
    pub(super) fn collars(&mut self, table: &Table) {
        let holes: Vec<Subtraction> = bores(table).collect();
        for (index, (pocket, bore)) in table.pockets().iter().zip(holes).enumerate() {
            let radius = pocket.radius_m as f32 + COLLAR_WIDTH_M;
            let foot = pocket.center.as_vec2().extend(self.frame.rail_height);
            let rim = CsgSolid::ConeExterior {
                axis: Axis::Z,
                center: foot,
                radius,
                taper: -1.0,
                beyond: Vec3::ZERO,
            };
            let half = Vec3::new(radius, radius, 0.0);
            let shape = Shape::CsgBox {
                min: foot - half,
                max: foot + half.with_z(COLLAR_HEIGHT_M),
                subtractions: vec![self.opening(), bore, subtraction(rim)],
            };
            self.add(format!("collar{index}"), "collar leather", shape);
        }
    }
}

/// Subtractions of the pockets' holes, lined with leather.
pub(super) fn bores(table: &Table) -> impl Iterator<Item = Subtraction> + '_ {
    table.pockets().iter().map(|pocket| Subtraction {
        solid: CsgSolid::Cylinder {
            center: pocket.center.as_vec2().extend(0.0),
            radius: pocket.radius_m as f32,
        },
        material: Some("leather".to_owned()),
    })
}

/// Subtraction of the vertical edge at a corner of the table.
pub(super) fn trimmed(corner: Vec2, outer: Vec2) -> Subtraction {
    let point = corner * outer - corner * Vec2::new(TRIM_M, 0.0);
    beyond(point.extend(0.0), corner.extend(0.0))
}

/// Length along the rail cut off each corner of the table.
const TRIM_M: f32 = 0.07;
const COLLAR_WIDTH_M: f32 = 0.026;
/// Height of a collar above the wood.
const COLLAR_HEIGHT_M: f32 = 0.005;
