//! Contacts of a ball in the air with obstacles that do not move: their times and normals.
//!
//! The cushions are solid up to their noses. A ball above the nose meets its edge, and behind it the
//! top that slopes up to the flat rail, which also bounds the facings and jaws of the pockets
//! (`cushion_edge.rs`, `jaw_contact.rs`). A pocket has a rounded rim, where a slow ball tips over, and
//! a wall. All distances are exact for the parabola on which the ball moves: polynomials, and for rims
//! and jaws steps that cannot pass a contact ([`reaches_ring`], `JawSolid::reached`).

use glam::{DVec2, DVec3};

use super::{
    clipped_contact::{OPEN_COS, first_touch},
    contact_time::{
        QuadraticPath, direction, leaves_circle, reaches_plane, reaches_point, reaches_ring,
    },
    cushion_edge::CushionEdge,
    event::Surface,
    jaw_contact::JawSolid,
    table::{Cushion, JOINT_SLACK_M, Nose, Pocket, Rails, Table},
};
use crate::deterministic_math::hypot;

/// A part of the table that a ball can touch, by its index in the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Obstacle {
    /// A nose: its face below the nose's height, its edge above.
    Nose(usize),
    /// A jaw likewise.
    Jaw(usize),
    /// The rounded edge of a pocket's hole.
    Rim(usize),
    /// The wall of a pocket.
    Wall(usize),
    /// The edge where that wall meets the flat rail.
    Lip(usize),
    /// The vertical edge at the back of a facing: twice the cushion's index, plus one at its far end.
    Corner(usize),
    /// The sloping top of a cushion.
    Slope(usize),
    /// The edge of the flat rail behind a cushion and beside it, up to the pockets' holes.
    Crease(usize),
    /// The flat top of the rails.
    Top,
}

impl Obstacle {
    /// Surface that it belongs to.
    pub(crate) fn surface(self) -> Surface {
        match self {
            Self::Rim(_) | Self::Wall(_) | Self::Lip(_) | Self::Corner(_) => Surface::Pocket,
            _ => Surface::Rail,
        }
    }
}

/// Directions in which an obstacle pushes a ball. Both are unit vectors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContactNormal {
    /// From the place of contact to the ball's centre.
    pub(crate) normal: DVec3,
    /// Direction in which the ball separates. It differs from `normal` for noses and walls of pockets,
    /// which count as vertical here though their normals lean.
    pub(crate) away: DVec3,
}

/// A ball in the air among the obstacles of a table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContactFinder<'a> {
    pub(crate) table: &'a Table,
    pub(crate) radius_m: f64,
}

impl ContactFinder<'_> {
    /// The first obstacle that is touched, and its time, within `horizon`.
    pub(crate) fn first_obstacle(
        &self,
        path: &QuadraticPath,
        horizon: f64,
    ) -> Option<(f64, Obstacle)> {
        let mut first: Option<(f64, Obstacle)> = None;
        let mut consider = |time: Option<f64>, obstacle| {
            if let Some(time) = time.filter(|&time| first.is_none_or(|(best, _)| time < best)) {
                first = Some((time, obstacle));
            }
        };
        let table = self.table;
        for (index, nose) in table.noses().iter().enumerate() {
            consider(self.face(path, nose, horizon), Obstacle::Nose(index));
            consider(self.edge(path, nose, horizon), Obstacle::Nose(index));
        }
        for index in 0..table.jaws().len() {
            consider(self.jaw(path, index, horizon), Obstacle::Jaw(index));
        }
        for (index, pocket) in table.pockets().iter().enumerate() {
            consider(self.rim(path, pocket, horizon), Obstacle::Rim(index));
            consider(self.wall(path, pocket, horizon), Obstacle::Wall(index));
            consider(self.lip(path, pocket, horizon), Obstacle::Lip(index));
        }
        if let Some(rails) = table.rails() {
            for (index, cushion) in table.cushions().iter().enumerate() {
                let slope = self.slope(path, (cushion, rails), horizon);
                consider(slope, Obstacle::Slope(index));
                let crease = self.crease(path, (cushion, rails), horizon);
                consider(crease, Obstacle::Crease(index));
                for (end, place) in cushion.facing_backs().into_iter().enumerate() {
                    let corner = place.and_then(|place| self.corner(path, place, horizon));
                    consider(corner, Obstacle::Corner(2 * index + end));
                }
            }
            consider(self.top(path, horizon), Obstacle::Top);
        }
        first
    }

    /// Directions in which an obstacle pushes a ball that touches it.
    pub(crate) fn contact_normal(&self, obstacle: Obstacle, center: DVec3) -> ContactNormal {
        let normal = self.normal(obstacle, center);
        // The minimum speed of separation acts along `away`: along a nose's leaning normal it would
        // push the ball into the slate.
        let upright = match obstacle {
            Obstacle::Nose(_) | Obstacle::Jaw(_) => center.z < self.table.nose_height_m(),
            Obstacle::Wall(_) => true,
            _ => false,
        };
        let away = if upright {
            normal.with_z(0.0).try_normalize().unwrap_or(normal)
        } else {
            normal
        };
        ContactNormal { normal, away }
    }

    /// The unit vector out of an obstacle to the centre of a ball that touches it.
    fn normal(&self, obstacle: Obstacle, center: DVec3) -> DVec3 {
        let table = self.table;
        match obstacle {
            Obstacle::Nose(index) => {
                let nose = &table.noses()[index];
                let edge = CushionEdge::over(nose, table.nose_height_m());
                edge.out_to(center)
                    .unwrap_or_else(|| self.off_face(nose.normal(), center.z))
            }
            Obstacle::Jaw(index) if center.z < table.nose_height_m() => {
                let out = center.truncate() - table.jaws()[index].center;
                self.off_face(out.try_normalize().unwrap_or(DVec2::X), center.z)
            }
            Obstacle::Jaw(index) => direction(JawSolid::of(table, index).nearest(center).0, center),
            Obstacle::Rim(index) => {
                let pocket = table.pockets()[index];
                let out = (center.truncate() - pocket.center).normalize_or_zero();
                let edge = pocket.center + pocket.radius_m * out;
                direction(edge.extend(-pocket.rim_radius_m), center)
            }
            Obstacle::Wall(index) => {
                let pocket = table.pockets()[index];
                let inward = (pocket.center - center.truncate()).normalize_or_zero();
                let lean = if center.z > 0.0 { LEAN_SIN } else { 0.0 };
                ((1.0 - lean * lean).sqrt() * inward).extend(-lean)
            }
            Obstacle::Lip(index) => {
                let pocket = table.pockets()[index];
                let out = (center.truncate() - pocket.center).normalize_or_zero();
                let edge = pocket.center + pocket.bore_radius_m() * out;
                direction(edge.extend(table.rail_height_m()), center)
            }
            Obstacle::Corner(index) => {
                let [_, _, first, last] = table.cushions()[index / 2].corners;
                let place = if index % 2 == 0 { first } else { last };
                let height = center.z.min(table.rail_height_m());
                direction(place.extend(height), center)
            }
            Obstacle::Slope(index) => {
                let cushion = &table.cushions()[index];
                table
                    .rails()
                    .map_or(DVec3::Z, |rails| self.tilt(cushion, rails))
            }
            Obstacle::Crease(index) => {
                let nose = &table.noses()[table.cushions()[index].nose];
                let back = table.rails().map_or(0.0, |rails| rails.cushion_width_m);
                let behind = nose.normal().dot(center.truncate() - nose.from()) + back;
                let out = behind * nose.normal();
                direction(DVec3::ZERO, out.extend(center.z - table.rail_height_m()))
            }
            Obstacle::Top => DVec3::Z,
        }
    }

    /// Normal from the nose line to the centre: below the nose's height it points down, as in the law
    /// of cushions on the cloth; above, up to the edge of a facing, it is horizontal.
    fn off_face(&self, away: DVec2, height: f64) -> DVec3 {
        let above = (height - self.table.nose_height_m()).min(0.0);
        (self.radius_m * away)
            .extend(above)
            .try_normalize()
            .unwrap_or(DVec3::Z)
    }

    fn face(&self, path: &QuadraticPath, nose: &Nose, horizon: f64) -> Option<f64> {
        let edge = CushionEdge::over(nose, self.table.nose_height_m());
        let front = nose.from() + self.radius_m * nose.normal();
        let plane = (front.extend(0.0), edge.across);
        first_touch(
            (path, horizon),
            |path, horizon| reaches_plane(path, plane, self.radius_m, horizon),
            |place| edge.height_over(place) < 0.0 && nose.spans(place.truncate()),
            |crossings| {
                crossings.plane(edge.from, edge.up);
                crossings.ends(nose.from(), nose.to());
            },
        )
    }

    fn edge(&self, path: &QuadraticPath, nose: &Nose, horizon: f64) -> Option<f64> {
        let edge = CushionEdge::over(nose, self.table.nose_height_m());
        let rails = self.table.rails();
        // Farther behind the nearest point is on the sloping top.
        let behind = rails.map_or(0.0, |rails| self.radius_m * slope_sin(rails));
        first_touch(
            (path, horizon),
            |path, horizon| {
                let seen = path.across_edge(edge.from, [edge.across, edge.up]);
                reaches_point(&seen, self.radius_m, horizon)
            },
            |place| {
                edge.height_over(place) >= 0.0
                    && edge.distance_before(place) >= -behind
                    && edge.spans(place)
            },
            |crossings| {
                crossings.plane(edge.from, edge.up);
                crossings.plane(edge.from - behind * edge.across, edge.across);
                crossings.plane(edge.from, edge.along);
                crossings.plane(edge.to, edge.along);
            },
        )
    }

    fn jaw(&self, path: &QuadraticPath, index: usize, horizon: f64) -> Option<f64> {
        let jaw = self.table.jaws()[index];
        let nose_height_m = self.table.nose_height_m();
        let reach = self.radius_m + jaw.radius_m;
        // Below the nose's height a jaw is a vertical cylinder, as for a ball on the cloth; above it is
        // the solid under its tops, of which the faces belong to the slope and the rail.
        let side = first_touch(
            (path, horizon),
            |path, horizon| reaches_point(&path.flat_from(jaw.center), reach, horizon),
            |place| place.z < nose_height_m,
            |crossings| crossings.level(nose_height_m),
        );
        let solid = JawSolid::of(self.table, index);
        let edge = first_touch(
            (path, horizon),
            |path, horizon| solid.reached(path, self.radius_m, horizon),
            |place| place.z >= nose_height_m && !solid.nearest(place).1,
            |crossings| {
                crossings.level(nose_height_m);
                solid.borders(crossings);
            },
        );
        [side, edge].into_iter().flatten().min_by(f64::total_cmp)
    }

    fn rim(&self, path: &QuadraticPath, pocket: &Pocket, horizon: f64) -> Option<f64> {
        if pocket.depth_m == 0.0 {
            return None;
        }
        // The rounded edge is the inner upper quarter of a torus, between the level cloth and the bore: a
        // ball touches it at `distance` from the ring at its core.
        let edge = pocket.center.extend(-pocket.rim_radius_m);
        let distance = self.radius_m + pocket.rim_radius_m;
        first_touch(
            (path, horizon),
            |path, horizon| reaches_ring(path, (edge, pocket.radius_m), distance, horizon),
            |place| {
                let away = place.truncate().distance(pocket.center);
                away <= pocket.radius_m + JOINT_SLACK_M && place.z > edge.z
            },
            |crossings| {
                crossings.level(edge.z);
                crossings.circle(pocket.center, pocket.radius_m);
            },
        )
    }

    fn wall(&self, path: &QuadraticPath, pocket: &Pocket, horizon: f64) -> Option<f64> {
        let room = pocket.bore_radius_m() - self.radius_m;
        if pocket.depth_m == 0.0 || room <= 0.0 {
            return None;
        }
        let rail_height_m = self.table.rail_height_m();
        first_touch(
            (path, horizon),
            // From inside: the centre can move within the bore's radius less the ball's.
            |path, horizon| leaves_circle(&path.flat_from(pocket.center), room, horizon),
            |place| {
                let is_near = place.truncate().distance(pocket.center) <= pocket.radius_m;
                let is_open = is_open(pocket, place) && place.z > -pocket.rim_radius_m;
                is_near && !is_open && place.z <= rail_height_m
            },
            |crossings| {
                crossings.mouth(pocket);
                crossings.circle(pocket.center, pocket.radius_m);
                crossings.level(-pocket.rim_radius_m);
                crossings.level(rail_height_m);
            },
        )
    }

    fn lip(&self, path: &QuadraticPath, pocket: &Pocket, horizon: f64) -> Option<f64> {
        let height = self.table.rails().map(|_| self.table.rail_height_m())?;
        // A sharp edge, which a ball touches at its radius from the ring.
        let ring = (pocket.center.extend(height), pocket.bore_radius_m());
        first_touch(
            (path, horizon),
            |path, horizon| reaches_ring(path, ring, self.radius_m, horizon),
            |place| {
                let away = place.truncate().distance(pocket.center);
                away <= ring.1 + JOINT_SLACK_M && place.z > height && !is_open(pocket, place)
            },
            |crossings| {
                crossings.mouth(pocket);
                crossings.level(height);
                crossings.circle(pocket.center, ring.1);
            },
        )
    }

    fn corner(&self, path: &QuadraticPath, place: DVec2, horizon: f64) -> Option<f64> {
        let top = self.table.rail_height_m();
        // Below the rail's top the edge is a vertical line, at the top its end is a point.
        let side = first_touch(
            (path, horizon),
            |path, horizon| reaches_point(&path.flat_from(place), self.radius_m, horizon),
            |center| (0.0..top).contains(&center.z),
            |crossings| {
                crossings.level(0.0);
                crossings.level(top);
            },
        );
        let tip = first_touch(
            (path, horizon),
            |path, horizon| {
                let seen = path.mapped(place.extend(top), |v| v);
                reaches_point(&seen, self.radius_m, horizon)
            },
            |center| center.z >= top,
            |crossings| crossings.level(top),
        );
        [side, tip].into_iter().flatten().min_by(f64::total_cmp)
    }

    fn slope(
        &self,
        path: &QuadraticPath,
        (cushion, rails): (&Cushion, Rails),
        horizon: f64,
    ) -> Option<f64> {
        let nose = &self.table.noses()[cushion.nose];
        let normal = self.tilt(cushion, rails);
        let line = nose.from().extend(self.table.nose_height_m());
        let to_center = self.radius_m * normal;
        first_touch(
            (path, horizon),
            |path, horizon| reaches_plane(path, (line + to_center, normal), self.radius_m, horizon),
            // The point of contact, not the centre, must lie on the cushion.
            |place| cushion.covers((place - to_center).truncate()),
            |crossings| {
                for (from, to) in cushion.sides() {
                    crossings.line(from + to_center.truncate(), (to - from).perp());
                }
            },
        )
    }

    fn crease(
        &self,
        path: &QuadraticPath,
        (cushion, rails): (&Cushion, Rails),
        horizon: f64,
    ) -> Option<f64> {
        let across = self.table.noses()[cushion.nose].normal();
        let [_, _, first, last] = cushion.corners;
        let edge = first.extend(self.table.rail_height_m());
        // Between the normals of the slope and of the flat top; farther in front the ball touches the
        // slope.
        let steep = self.radius_m * slope_sin(rails);
        let in_front = |place: DVec3| across.dot(place.truncate() - first);
        first_touch(
            (path, horizon),
            |path, horizon| {
                let seen = path.across_edge(edge, [across.extend(0.0), DVec3::Z]);
                reaches_point(&seen, self.radius_m, horizon)
            },
            |place| {
                let foot = place.truncate() - in_front(place) * across;
                // Beside the cushion, in the throat of a pocket, no slope leads up to the edge.
                let most = if cushion.covers(foot) {
                    steep
                } else {
                    self.radius_m
                };
                place.z > edge.z
                    && (-2.0 * JOINT_SLACK_M..=most).contains(&in_front(place))
                    && self
                        .table
                        .is_rail_under(foot - 2.0 * JOINT_SLACK_M * across)
            },
            |crossings| {
                crossings.level(edge.z);
                for distance in [-JOINT_SLACK_M, steep, self.radius_m] {
                    crossings.line(first + distance * across, across);
                }
                crossings.ends(first, last);
            },
        )
    }

    fn top(&self, path: &QuadraticPath, horizon: f64) -> Option<f64> {
        let level = DVec3::Z * (self.table.rail_height_m() + self.radius_m);
        first_touch(
            (path, horizon),
            |path, horizon| reaches_plane(path, (level, DVec3::Z), self.radius_m, horizon),
            |place| self.table.is_rail_under(place.truncate()),
            |crossings| {
                let (low, high) = self.table.inside_of_rails();
                for (corner, normal) in [
                    (low, DVec2::X),
                    (low, DVec2::Y),
                    (high, DVec2::X),
                    (high, DVec2::Y),
                ] {
                    crossings.line(corner, normal);
                }
                for pocket in self.table.pockets() {
                    crossings.circle(pocket.center, pocket.bore_radius_m());
                }
            },
        )
    }

    /// The normal of a cushion's top.
    fn tilt(&self, cushion: &Cushion, rails: Rails) -> DVec3 {
        let inward = self.table.noses()[cushion.nose].normal();
        let sin = slope_sin(rails);
        (sin * inward).extend((1.0 - sin * sin).sqrt())
    }
}

/// Whether a centre is on the side of a pocket where it has no wall over the cloth.
fn is_open(pocket: &Pocket, place: DVec3) -> bool {
    let out = (place.truncate() - pocket.center).normalize_or_zero();
    out.dot(pocket.mouth) > OPEN_COS
}

/// Sine of the angle at which a cushion's top rises.
fn slope_sin(rails: Rails) -> f64 {
    rails.rise_m / hypot(rails.rise_m, rails.cushion_width_m)
}
/// Above the cloth a pocket's wall leans inwards, so that it deflects balls downwards: sine of 15°, the
/// steepest vertical pocket angle of WPA's specifications.
const LEAN_SIN: f64 = 0.258_819_045_102_520_76;
