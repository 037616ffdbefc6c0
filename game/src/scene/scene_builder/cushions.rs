//! The table's bed, rails and cushions.

use carom_billiards::physics::{Circle, Cushion, Table};
use carom_tracer::{CsgSolid, Shape, Subtraction};
use glam::{DVec2, Vec2, Vec3};

use super::pockets::bores;
use super::pockets::trimmed;
use super::{APRON_M, POCKET_DEPTH_M, SceneBuilder, around, beyond, corners, subtraction};

impl SceneBuilder {
    /// The slate under its cloth, with the pockets' holes.
    pub(super) fn bed(&mut self, table: &Table) {
        let inside = self.frame.inside;
        let subtractions = bores(table).collect();
        let shape = Shape::CsgBox {
            min: (-inside).extend(-POCKET_DEPTH_M),
            max: inside.extend(0.0),
            subtractions,
        };
        self.add("bed", "cloth", shape);
    }

    /// The wooden frame of four boxes, which few rays meet: bevelled outside, bored for the pockets.
    pub(super) fn rails(&mut self, table: &Table) {
        let (inside, outer) = (self.frame.inside, self.frame.outer);
        let top = self.frame.rail_height;
        let mut subtractions: Vec<_> = bores(table).collect();
        for (side, normal) in [(outer.x, Vec3::X), (outer.y, Vec3::Y)] {
            for sign in [-1.0, 1.0] {
                let edge = sign * normal * (side - BEVEL_M) + Vec3::Z * top;
                subtractions.push(beyond(edge, sign * normal + Vec3::Z));
            }
        }
        subtractions.extend(corners().map(|corner| trimmed(corner, outer)));
        for (near, far) in around(inside, outer) {
            let (min, max) = (near.extend(-APRON_M), far.extend(top));
            let reaching = subtractions.iter().filter(|cut| reaches(cut, min, max));
            let shape = Shape::CsgBox {
                min,
                max,
                subtractions: reaching.cloned().collect(),
            };
            self.add("rail", "rail wood", shape);
        }
    }

    /// A cushion between two facings, under-cut below the nose and rising to the rail; its tips are
    /// rounded as balls meet them.
    pub(super) fn cushion(&mut self, table: &Table, cushion: &Cushion) {
        let [a, b, c, d] = cushion.corners.map(|corner| corner.as_vec2());
        let normal = table.noses()[cushion.nose].normal().as_vec2();
        let nose = table.nose_height_m() as f32;
        let (low, high) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
        let rise = self.frame.rail_height - nose - NOSE_HALF_M;
        let depth = (c - b).dot(-normal);
        let facing = |from: Vec2, to: Vec2| {
            let out = Vec2::new(to.y - from.y, from.x - to.x);
            beyond(from.extend(0.0), out.extend(0.0))
        };
        let tips = cushion.corners.into_iter().zip(cushion.jaws);
        let rounded = tips.filter_map(|(tip, jaw)| Some(rounding(tip, jaw?)));
        let subtractions = [
            facing(b, c),
            facing(d, a),
            beyond(a.extend(nose + NOSE_HALF_M), (normal * rise).extend(depth)),
            beyond(
                a.extend(nose - NOSE_HALF_M),
                (normal * (nose - NOSE_HALF_M)).extend(-UNDERCUT_M),
            ),
        ];
        let subtractions = subtractions.into_iter().chain(rounded).collect();
        let shape = Shape::CsgBox {
            min: low.extend(0.0),
            max: high.extend(self.frame.rail_height),
            subtractions,
        };
        self.add(format!("cushion{}", cushion.nose), "cushion cloth", shape);
    }

    /// What the rails leave open: cloth and cushions.
    pub(super) fn opening(&self) -> Subtraction {
        let inside = self.frame.inside;
        subtraction(CsgSolid::Box {
            min: (-inside).extend(-1.0),
            max: inside.extend(1.0),
        })
    }
}

/// Whether a subtraction takes something from a box.
fn reaches(cut: &Subtraction, min: Vec3, max: Vec3) -> bool {
    match cut.solid {
        CsgSolid::Cylinder { center, radius } => {
            let nearest = center.clamp(min, max);
            nearest.truncate().distance(center.truncate()) < radius
        }
        CsgSolid::HalfSpace { point, normal } => {
            let corner = Vec3::select(normal.cmpgt(Vec3::ZERO), max, min);
            (corner - point).dot(normal) > 0.0
        }
        _ => true,
    }
}

/// The tip of a cushion outside its jaw.
pub(super) fn rounding(tip: DVec2, jaw: Circle) -> Subtraction {
    let out = tip - jaw.center;
    // As far out as the jaw touches the sides that meet in the tip.
    let beyond = out * (jaw.radius_m * jaw.radius_m / out.length_squared());
    subtraction(CsgSolid::ConeExterior {
        center: jaw.center.extend(0.0).as_vec3(),
        radius: jaw.radius_m as f32,
        taper: 0.0,
        beyond: beyond.extend(0.0).as_vec3(),
    })
}

const BEVEL_M: f32 = 0.012;
/// Half the height of the nose's upright edge.
const NOSE_HALF_M: f32 = 0.0015;
/// How far the foot of a cushion stands behind its nose.
const UNDERCUT_M: f32 = 0.016;
