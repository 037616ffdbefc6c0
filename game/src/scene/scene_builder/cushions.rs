//! The table's bed, rails and cushions.

use carom_billiards::physics::{Circle, Cushion, Table};
use carom_tracer::{Axis, CsgSolid, Shape, Subtraction};
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

    /// A cushion between two facings, with a round nose from which it rises to the rail and is under-cut;
    /// its tips are rounded as balls meet them.
    pub(super) fn cushion(&mut self, table: &Table, cushion: &Cushion) {
        let [a, b, c, d] = cushion.corners.map(|corner| corner.as_vec2());
        let normal = table.noses()[cushion.nose].normal().as_vec2();
        let (low, high) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
        let facing = |from: Vec2, to: Vec2| {
            let out = Vec2::new(to.y - from.y, from.x - to.x);
            beyond(from.extend(0.0), out.extend(0.0))
        };
        let tips = cushion.corners.into_iter().zip(cushion.jaws);
        let rounded = tips.filter_map(|(tip, jaw)| Some(rounding(tip, jaw?)));
        let profile = Profile::new(table, self.frame.rail_height, (c - b).dot(-normal));
        let subtractions = [facing(b, c), facing(d, a)];
        let subtractions = subtractions.into_iter().chain(profile.cuts(a, normal));
        let shape = Shape::CsgBox {
            min: low.extend(0.0),
            max: high.extend(self.frame.rail_height),
            subtractions: subtractions.chain(rounded).collect(),
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

/// A cushion seen along its nose: x away from the nose line into the rail, y above the cloth.
///
/// ```text
///         top __.-- rail
///       __.--       |
///      (o           |    o: the middle of the nose
///       \\          |
///        \\_________|
/// ```
struct Profile {
    /// Of the nose, where balls that touch the nose line of the simulation touch it.
    middle: Vec2,
    /// Out of the top and of the under-cut side, both tangents of the nose.
    normals: [Vec2; 2],
}

impl Profile {
    /// Of a cushion that rises to `rail_height` over `depth`.
    fn new(table: &Table, rail_height: f32, depth: f32) -> Self {
        let height = table.nose_height_m() as f32;
        let radius = table.ball().radius_m as f32;
        let behind = |distance: f32| (distance * distance - (height - radius).powi(2)).sqrt();
        let middle = Vec2::new(behind(radius + NOSE_RADIUS_M) - behind(radius), height);
        Self {
            middle,
            normals: [
                // From the rail forwards the nose lies below the tangent, and from the foot up behind it.
                tangent_normal(Vec2::new(depth, rail_height), middle, 1.0),
                tangent_normal(Vec2::new(UNDERCUT_M, 0.0), middle, -1.0),
            ],
        }
    }

    /// What is taken off a block whose nose line begins at `from`, with a `normal` out of the cushion.
    fn cuts(&self, from: Vec2, normal: Vec2) -> [Subtraction; 3] {
        let at = |v: Vec2| (-normal * v.x).extend(v.y);
        let center = from.extend(0.0) + at(self.middle);
        let [top, under] = self.normals;
        let side = |out: Vec2| beyond(center + at(NOSE_RADIUS_M * out), at(out));
        // The chord between the points where the sides touch the nose.
        let chord = 0.5 * (top + under);
        let axis = if normal.x.abs() > normal.y.abs() {
            Axis::Y
        } else {
            Axis::X
        };
        let nose = CsgSolid::ConeExterior {
            axis,
            center,
            radius: NOSE_RADIUS_M,
            taper: 0.0,
            beyond: at(NOSE_RADIUS_M * chord),
        };
        [side(top), side(under), subtraction(nose)]
    }
}

/// The normal, towards the cloth's middle, of the line from a point to where it touches the nose: on its
/// upper or, with `sign` −1, its lower side.
fn tangent_normal(from: Vec2, middle: Vec2, sign: f32) -> Vec2 {
    let to = middle - from;
    let sin = NOSE_RADIUS_M / to.length();
    let across = Vec2::new(to.y, -to.x) * sign / to.length();
    let along = to / to.length();
    across * (1.0 - sin * sin).max(0.0).sqrt() - along * sin
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
        axis: Axis::Z,
        center: jaw.center.extend(0.0).as_vec3(),
        radius: jaw.radius_m as f32,
        taper: 0.0,
        beyond: beyond.extend(0.0).as_vec3(),
    })
}

const BEVEL_M: f32 = 0.012;
/// Of a nose, under its cloth.
const NOSE_RADIUS_M: f32 = 0.003;
/// How far the foot of a cushion stands behind its nose.
const UNDERCUT_M: f32 = 0.016;
