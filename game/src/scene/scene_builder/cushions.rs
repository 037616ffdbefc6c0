//! Bed, rails and cushions of the table.

use carom_billiards::physics::{Circle, Cushion, Table};
use carom_tracer::{Axis, CsgSolid, Shape, Subtraction};
use glam::{DVec2, Vec2, Vec3};

use super::pockets::bores;
use super::pockets::trimmed;
use super::{APRON_M, POCKET_DEPTH_M, SceneBuilder, around, beyond, corners, subtraction};

impl SceneBuilder {
    /// Adds the slate under its cloth, with the pockets' holes.
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

    /// Adds the wooden frame as four boxes, bevelled outside and bored for the pockets.
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

    /// Adds a cushion between two facings, with a round nose, a top that rises to the rail, and an undercut;
    /// its tips are rounded like the jaws of the simulation.
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

    /// Subtraction of the opening between the rails, which has cloth and cushions.
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
///      (o           |    o: the centre of the nose
///       \\          |
///        \\_________|
/// ```
struct Profile {
    /// Centre of the nose, placed so that balls touch it when they touch the simulation's nose line.
    middle: Vec2,
    /// Outward normals of the top and of the undercut side, which are tangents of the nose.
    normals: [Vec2; 2],
}

impl Profile {
    /// The profile of a cushion that rises to `rail_height` over `depth`.
    fn new(table: &Table, rail_height: f32, depth: f32) -> Self {
        let height = table.nose_height_m() as f32;
        let radius = table.ball().radius_m as f32;
        // Horizontal distance from a ball's centre to a point at the nose's height that is `distance` away:
        // the surface of a ball and the nose's centre, when they touch.
        let behind = |distance: f32| (distance * distance - (height - radius).powi(2)).sqrt();
        let middle = Vec2::new(behind(radius + NOSE_RADIUS_M) - behind(radius), height);
        Self {
            middle,
            normals: [
                // The tangent from the rail touches the nose from above, that from the foot from the front.
                tangent_normal(Vec2::new(depth, rail_height), middle, 1.0),
                tangent_normal(Vec2::new(UNDERCUT_M, 0.0), middle, -1.0),
            ],
        }
    }

    /// Subtractions from a block whose nose line begins at `from`, with a `normal` out of the cushion.
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

/// The outward normal of the tangent from a point to the nose, on its upper or, with `sign` −1, its lower
/// side.
fn tangent_normal(from: Vec2, middle: Vec2, sign: f32) -> Vec2 {
    let to = middle - from;
    let sin = NOSE_RADIUS_M / to.length();
    let across = Vec2::new(to.y, -to.x) * sign / to.length();
    let along = to / to.length();
    across * (1.0 - sin * sin).max(0.0).sqrt() - along * sin
}

/// Whether a subtraction may intersect a box.
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

/// Subtraction of the tip of a cushion outside its jaw.
pub(super) fn rounding(tip: DVec2, jaw: Circle) -> Subtraction {
    let out = tip - jaw.center;
    // The chord between the points where the jaw touches the two sides that meet in the tip: the polar line
    // of the tip is at r²/|out| from the jaw's centre.
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
/// Radius of a nose.
const NOSE_RADIUS_M: f32 = 0.003;
/// Distance of a cushion's foot behind its nose line.
const UNDERCUT_M: f32 = 0.016;
