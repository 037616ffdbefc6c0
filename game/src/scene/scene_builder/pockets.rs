//! The pockets: their holes and the castings round them.

use carom_billiards::physics::Table;
use carom_tracer::{CsgSolid, Shape, Subtraction};
use glam::Vec2;

use super::{SceneBuilder, beyond};

impl SceneBuilder {
    /// A bronze casting round each pocket, a little above the wood.
    pub(super) fn castings(&mut self, table: &Table) {
        let (inside, outer) = (self.frame.inside, self.frame.outer + CASTING_M);
        let top = self.frame.rail_height + CASTING_M;
        let holes: Vec<Subtraction> = bores(table).collect();
        for (index, (pocket, bore)) in table.pockets().iter().zip(holes).enumerate() {
            let center = pocket.center.as_vec2();
            let reach = pocket.radius_m as f32 + CASTING_RIM_M;
            let is_corner = center.x.abs() > 0.25 * outer.x;
            let side = center.signum();
            let (near, far) = if is_corner {
                ((center.abs() - 0.5 * reach).min(inside - 0.03), outer)
            } else {
                (
                    Vec2::new(-reach, inside.y - 0.01),
                    Vec2::new(reach, outer.y),
                )
            };
            let (a, b) = if is_corner {
                (near * side, far * side)
            } else {
                (near * Vec2::new(1.0, side.y), far * Vec2::new(1.0, side.y))
            };
            let mut subtractions = vec![self.opening(), bore];
            if is_corner {
                subtractions.push(trimmed(side, outer));
            }
            let shape = Shape::CsgBox {
                min: a.min(b).extend(-CASTING_DEPTH_M),
                max: a.max(b).extend(top),
                subtractions,
            };
            self.add(format!("casting{index}"), "casting", shape);
        }
    }
}

/// The pockets' holes, lined with leather.
pub(super) fn bores(table: &Table) -> impl Iterator<Item = Subtraction> + '_ {
    table.pockets().iter().map(|pocket| Subtraction {
        solid: CsgSolid::Cylinder {
            center: pocket.center.as_vec2().extend(0.0),
            radius: pocket.radius_m as f32,
        },
        material: Some("leather".to_owned()),
    })
}

/// The upright edge at a corner of the table, cut off.
pub(super) fn trimmed(corner: Vec2, outer: Vec2) -> Subtraction {
    let point = corner * outer - corner * Vec2::new(TRIM_M, 0.0);
    beyond(point.extend(0.0), corner.extend(0.0))
}

/// Cut off each corner of the table, along the rail.
const TRIM_M: f32 = 0.07;
/// How much a casting stands out over the wood.
const CASTING_M: f32 = 0.0016;
const CASTING_RIM_M: f32 = 0.03;
const CASTING_DEPTH_M: f32 = 0.06;
