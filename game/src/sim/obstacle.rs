//! What a ball in the air can touch, when, and in which direction it is pushed.
//!
//! The cushions are solid up to their noses; a ball over the nose meets its edge, and behind it the
//! top that slopes up to the flat rail. A pocket has a rounded rim, where a slow ball tips over,
//! and a wall. All distances are exact for the parabola on which the ball moves: polynomials, and
//! for the level circles of rims and jaws [`reaches_ring`].

use glam::{DVec2, DVec3};

use super::{
    contact_time::{
        Course, direction, leaves_circle, reaches_nose, reaches_plane, reaches_point, reaches_ring,
    },
    elementary::hypot,
    event::Surface,
    table::{Cushion, JOINT_SLACK_M, Nose, Pocket, Rails, Table},
};

/// A part of the table that does not move, by its index in the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Obstacle {
    /// A nose: its face below, its edge above.
    Nose(usize),
    /// A jaw likewise.
    Jaw(usize),
    /// The rounded edge of a pocket's hole.
    Rim(usize),
    /// The wall of a pocket.
    Wall(usize),
    /// The edge where that wall meets the flat rail.
    Lip(usize),
    /// The sloping top of a cushion.
    Slope(usize),
    /// The edge where a cushion's slope meets the flat rail.
    Crease(usize),
    /// The flat top of the rails.
    Top,
}

impl Obstacle {
    /// What it is made of.
    pub(crate) fn surface(self) -> Surface {
        match self {
            Self::Rim(_) | Self::Wall(_) | Self::Lip(_) => Surface::Pocket,
            _ => Surface::Rail,
        }
    }
}

/// How an obstacle pushes a ball. Both are unit vectors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Push {
    /// From the place of contact to the ball's centre.
    pub(crate) normal: DVec3,
    /// Where the ball gets free. Noses and pockets' walls count as upright where they lean, so
    /// that it differs there.
    pub(crate) away: DVec3,
}

/// A ball in the air among the obstacles of a table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scout<'a> {
    pub(crate) table: &'a Table,
    pub(crate) radius_m: f64,
}

impl Scout<'_> {
    /// The first obstacle that is touched, and when, within `horizon`.
    pub(crate) fn first_touch(&self, course: &Course, horizon: f64) -> Option<(f64, Obstacle)> {
        let mut first: Option<(f64, Obstacle)> = None;
        let mut consider = |time: Option<f64>, obstacle| {
            if let Some(time) = time.filter(|&time| first.is_none_or(|(best, _)| time < best)) {
                first = Some((time, obstacle));
            }
        };
        let table = self.table;
        for (index, nose) in table.noses().iter().enumerate() {
            consider(self.face(course, nose, horizon), Obstacle::Nose(index));
            consider(self.edge(course, nose, horizon), Obstacle::Nose(index));
        }
        for index in 0..table.jaws().len() {
            consider(self.jaw(course, index, horizon), Obstacle::Jaw(index));
        }
        for (index, pocket) in table.pockets().iter().enumerate() {
            consider(self.rim(course, pocket, horizon), Obstacle::Rim(index));
            consider(self.wall(course, pocket, horizon), Obstacle::Wall(index));
            consider(self.lip(course, pocket, horizon), Obstacle::Lip(index));
        }
        if let Some(rails) = table.rails() {
            for (index, cushion) in table.cushions().iter().enumerate() {
                let slope = self.slope(course, (cushion, rails), horizon);
                consider(slope, Obstacle::Slope(index));
                let crease = self.crease(course, (cushion, rails), horizon);
                consider(crease, Obstacle::Crease(index));
            }
            consider(self.top(course, horizon), Obstacle::Top);
        }
        first
    }

    /// Where a ball that touches an obstacle is pushed.
    pub(crate) fn push(&self, obstacle: Obstacle, center: DVec3) -> Push {
        let normal = self.normal(obstacle, center);
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
        Push { normal, away }
    }

    /// The unit vector out of an obstacle to the centre of a ball that touches it.
    fn normal(&self, obstacle: Obstacle, center: DVec3) -> DVec3 {
        let table = self.table;
        match obstacle {
            Obstacle::Nose(index) => {
                let nose = &table.noses()[index];
                let in_front = nose.normal().dot(center.truncate() - nose.from());
                self.over_nose(nose.normal(), in_front, center.z)
            }
            Obstacle::Jaw(index) => {
                let jaw = table.jaws()[index];
                let out = center.truncate() - jaw.center;
                let away = out.try_normalize().unwrap_or(DVec2::X);
                self.over_nose(away, out.length() - jaw.radius_m, center.z)
            }
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

    /// Below the nose's height the ball touches its line from below, as the law of cushions on
    /// the cloth has it; above, from where it is.
    fn over_nose(&self, away: DVec2, in_front: f64, height: f64) -> DVec3 {
        let above = height - self.table.nose_height_m();
        let reach = if above < 0.0 { self.radius_m } else { in_front };
        (reach * away)
            .extend(above)
            .try_normalize()
            .unwrap_or(DVec3::Z)
    }

    fn is_below_nose(&self, course: &Course, t: f64) -> bool {
        course.at(t).z < self.table.nose_height_m()
    }

    fn face(&self, course: &Course, nose: &Nose, horizon: f64) -> Option<f64> {
        reaches_nose(course, nose, self.radius_m, horizon)
            .filter(|&t| self.is_below_nose(course, t))
    }

    fn edge(&self, course: &Course, nose: &Nose, horizon: f64) -> Option<f64> {
        let corner = nose.from().extend(self.table.nose_height_m());
        let seen = course.across_edge(corner, nose.normal().extend(0.0));
        let t = reaches_point(&seen, self.radius_m, horizon)?;
        let behind = self
            .table
            .rails()
            .map_or(0.0, |rails| self.radius_m * slope_sin(rails));
        let valid = !self.is_below_nose(course, t)
            && seen.at(t).x >= -behind
            && nose.spans(course.at(t).truncate());
        valid.then_some(t)
    }

    fn jaw(&self, course: &Course, index: usize, horizon: f64) -> Option<f64> {
        let jaw = self.table.jaws()[index];
        let flat = course.flat_from(jaw.center);
        let side = reaches_point(&flat, self.radius_m + jaw.radius_m, horizon)
            .filter(|&t| self.is_below_nose(course, t));
        let ring = (jaw.center.extend(self.table.nose_height_m()), jaw.radius_m);
        let edge = reaches_ring(course, ring, self.radius_m, horizon).filter(|&t| {
            flat.at(t).length() >= jaw.radius_m - JOINT_SLACK_M && !self.is_below_nose(course, t)
        });
        side.into_iter().chain(edge).min_by(f64::total_cmp)
    }

    fn rim(&self, course: &Course, pocket: &Pocket, horizon: f64) -> Option<f64> {
        if pocket.depth_m == 0.0 {
            return None;
        }
        let edge = pocket.center.extend(-pocket.rim_radius_m);
        let distance = self.radius_m + pocket.rim_radius_m;
        let t = reaches_ring(course, (edge, pocket.radius_m), distance, horizon)?;
        let place = course.at(t);
        let inside = place.truncate().distance(pocket.center) <= pocket.radius_m + JOINT_SLACK_M;
        (inside && place.z > edge.z).then_some(t)
    }

    fn wall(&self, course: &Course, pocket: &Pocket, horizon: f64) -> Option<f64> {
        let room = pocket.bore_radius_m() - self.radius_m;
        if pocket.depth_m == 0.0 || room <= 0.0 {
            return None;
        }
        let t = leaves_circle(&course.flat_from(pocket.center), room, horizon)?;
        let place = course.at(t);
        let is_near = place.truncate().distance(pocket.center) <= pocket.radius_m;
        let is_open = is_open(pocket, place) && place.z > -pocket.rim_radius_m;
        (is_near && !is_open && place.z <= self.table.rail_height_m()).then_some(t)
    }

    fn lip(&self, course: &Course, pocket: &Pocket, horizon: f64) -> Option<f64> {
        let height = self.table.rails().map(|_| self.table.rail_height_m())?;
        let ring = (pocket.center.extend(height), pocket.bore_radius_m());
        let t = reaches_ring(course, ring, self.radius_m, horizon)?;
        let place = course.at(t);
        let inside = place.truncate().distance(pocket.center) <= ring.1 + JOINT_SLACK_M;
        (inside && place.z > height && !is_open(pocket, place)).then_some(t)
    }

    fn slope(
        &self,
        course: &Course,
        (cushion, rails): (&Cushion, Rails),
        horizon: f64,
    ) -> Option<f64> {
        let nose = &self.table.noses()[cushion.nose];
        let normal = self.tilt(cushion, rails);
        let line = nose.from().extend(self.table.nose_height_m());
        let plane = (line + self.radius_m * normal, normal);
        let t = reaches_plane(course, plane, self.radius_m, horizon)?;
        cushion
            .covers((course.at(t) - self.radius_m * normal).truncate())
            .then_some(t)
    }

    fn crease(
        &self,
        course: &Course,
        (cushion, rails): (&Cushion, Rails),
        horizon: f64,
    ) -> Option<f64> {
        let nose = &self.table.noses()[cushion.nose];
        let back = nose.from() - rails.cushion_width_m * nose.normal();
        let seen = course.across_edge(
            back.extend(self.table.rail_height_m()),
            nose.normal().extend(0.0),
        );
        let t = reaches_point(&seen, self.radius_m, horizon)?;
        let across = seen.at(t);
        let between = (-2.0 * JOINT_SLACK_M..=self.radius_m * slope_sin(rails)).contains(&across.x);
        let [_, _, first, last] = cushion.corners;
        let along = (last - first).dot(course.at(t).truncate() - first);
        let beside = (0.0..=first.distance_squared(last)).contains(&along);
        (across.y > 0.0 && between && beside).then_some(t)
    }

    fn top(&self, course: &Course, horizon: f64) -> Option<f64> {
        let level = DVec3::Z * (self.table.rail_height_m() + self.radius_m);
        let t = reaches_plane(course, (level, DVec3::Z), self.radius_m, horizon)?;
        self.table
            .is_rail_under(course.at(t).truncate())
            .then_some(t)
    }

    /// The normal of a cushion's top.
    fn tilt(&self, cushion: &Cushion, rails: Rails) -> DVec3 {
        let inward = self.table.noses()[cushion.nose].normal();
        let sin = slope_sin(rails);
        (sin * inward).extend((1.0 - sin * sin).sqrt())
    }
}

/// Whether a ball is on the side of a pocket where it has no wall over the cloth.
fn is_open(pocket: &Pocket, place: DVec3) -> bool {
    let out = (place.truncate() - pocket.center).normalize_or_zero();
    out.dot(pocket.mouth) > OPEN_COS
}

/// Sine of the angle at which a cushion's top rises.
fn slope_sin(rails: Rails) -> f64 {
    rails.rise_m / hypot(rails.rise_m, rails.cushion_width_m)
}

/// Cosine of the angle from the mouth at which a pocket's wall over the cloth begins: behind the
/// ends of the facings.
const OPEN_COS: f64 = 0.4;
/// Over the cloth a pocket's wall leans in, so that it drives balls down: sine of 15°, the steepest
/// vertical pocket angle of WPA's specifications.
const LEAN_SIN: f64 = 0.258_819_045_102_520_76;
