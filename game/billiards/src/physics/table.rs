//! The table: straight cushions, rounded jaws, pockets, rails and spots.
//!
//! Coordinates are centred on the cloth: x along the length, y across, z up, cloth at z = 0.

use glam::DVec2;
use serde::Deserialize;

use crate::{Result, TableFault};

use super::{
    ball::{BallBody, BallState},
    cloth::TableSpeed,
};

/// The nose line of a straight cushion: balls touch it from the left of `from` → `to`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nose {
    from: DVec2,
    to: DVec2,
    normal: DVec2,
    rises_m: [f64; 2],
}

impl Nose {
    /// A nose line between two ends, in m.
    ///
    /// # Errors
    /// [`crate::Error::Table`] for ends that coincide or are not finite.
    pub fn new(from: DVec2, to: DVec2) -> Result<Self> {
        let along = to - from;
        match along.try_normalize() {
            Some(unit) if from.is_finite() && to.is_finite() => Ok(Self {
                from,
                to,
                normal: unit.perp(),
                rises_m: [0.0; 2],
            }),
            _ => Err(TableFault::NoseWithoutLength { from, to }.into()),
        }
    }

    /// Start, in m.
    pub fn from(&self) -> DVec2 {
        self.from
    }

    /// End, in m.
    pub fn to(&self) -> DVec2 {
        self.to
    }

    /// Unit vector towards the balls.
    pub fn normal(&self) -> DVec2 {
        self.normal
    }

    /// Rise of its edge above the noses' height at its two ends, in m: positive for the facing of a
    /// pocket, which ends at the cushion's rising top.
    pub(crate) fn rises_m(&self) -> [f64; 2] {
        self.rises_m
    }

    /// Whether a point is beside the nose, not beyond its ends.
    pub(crate) fn spans(&self, point: DVec2) -> bool {
        let along = self.to - self.from;
        let t = (point - self.from).dot(along);
        // `t` is a length times that of the nose.
        let slack = JOINT_SLACK_M * along.length();
        t >= -slack && t <= along.length_squared() + slack
    }
}

/// A circle seen from above: a rounded jaw, or the rim of a pocket.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre, in m.
    pub center: DVec2,
    /// Radius, in m.
    pub radius_m: f64,
}

/// A hole in the slate, and how a ball falls into it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pocket {
    /// Centre, in m.
    pub center: DVec2,
    /// Radius in m at which the level cloth ends: a ball whose centre is farther in has lost its
    /// support.
    pub radius_m: f64,
    /// Unit vector from the centre to the mouth. On the other sides the pocket has a wall as high as
    /// the rails; below the cloth, all around.
    pub mouth: DVec2,
    /// Radius in m of the slate's rounded edge, over which a slow ball tips.
    pub rim_radius_m: f64,
    /// Depth in m to which a ball's centre falls below the cloth before it is removed. With 0 a ball is
    /// removed as soon as its centre passes the rim.
    pub depth_m: f64,
}

impl Pocket {
    /// Radius of the hole below its rounded edge, in m.
    pub fn bore_radius_m(&self) -> f64 {
        self.radius_m - self.rim_radius_m
    }
}

/// The rails around the cushions, for balls that fly.
///
/// ```text
///   height      ______________   nose height + rise
///   over       /   flat top   |
///   cloth   __/ slope         |
///          <  nose            |
///   cloth  |__________________|
///          0  cushion   width     behind the nose line
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rails {
    /// Distance in m from the nose line to the back of the cushion, over which its top rises.
    pub cushion_width_m: f64,
    /// Height of the flat top above the nose, in m.
    pub rise_m: f64,
    /// Distance in m from the nose line to the table's outer edge.
    pub width_m: f64,
}

/// A cushion seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cushion {
    /// Index of its nose line in [`Table::noses`].
    pub nose: usize,
    /// Its corners anticlockwise, in m: the ends of the nose line with the jaws not rounded, then
    /// the ends of its back. The sides between are the facings of the pockets.
    pub corners: [DVec2; 4],
    /// Roundings of the first and the second corner; none where the cushion is mitred.
    pub jaws: [Option<Circle>; 2],
}

impl Cushion {
    /// Whether a point lies on it, seen from above.
    pub fn covers(&self, point: DVec2) -> bool {
        let inside = self.sides().all(|(from, to)| {
            (to - from).perp_dot(point - from) >= -JOINT_SLACK_M * (to - from).length()
        });
        inside && !self.is_rounded_off(point)
    }

    /// The sides of the quadrilateral.
    pub(crate) fn sides(&self) -> impl Iterator<Item = (DVec2, DVec2)> {
        (0..4).map(|i| (self.corners[i], self.corners[(i + 1) % 4]))
    }

    /// Ends of its facings, at the first and the second corner of its back; none where it is mitred.
    pub(crate) fn facing_backs(&self) -> [Option<DVec2>; 2] {
        let [_, _, first, last] = self.corners;
        [self.jaws[1].map(|_| first), self.jaws[0].map(|_| last)]
    }

    /// Whether a point of the quadrilateral is cut off by the rounding of a corner.
    fn is_rounded_off(&self, point: DVec2) -> bool {
        let [to, from, first_back, last_back] = self.corners;
        [(to, from, last_back), (from, to, first_back)]
            .into_iter()
            .zip(self.jaws)
            .any(|((tip, other, back), jaw)| {
                jaw.is_some_and(|jaw| {
                    // In the sector between its tangent points the circle is the outline.
                    let seen = point - jaw.center;
                    let ahead = seen.dot(tip - other) > 0.0 && seen.dot(tip - back) > 0.0;
                    ahead && seen.length() > jaw.radius_m + JOINT_SLACK_M
                })
            })
    }
}

/// A table's shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    name: String,
    length_m: f64,
    width_m: f64,
    nose_height_m: f64,
    bed_height_m: f64,
    noses: Vec<Nose>,
    jaws: Vec<Circle>,
    jaw_slopes: Vec<DVec2>,
    pockets: Vec<Pocket>,
    cushions: Vec<Cushion>,
    rails: Option<Rails>,
    ball: BallBody,
    cue_ball: BallBody,
    speed: TableSpeed,
    low: DVec2,
    high: DVec2,
}

/// The parts of a flat [`Table`], from which balls that enter a pocket or fly over a cushion are
/// removed.
#[derive(Clone, Debug)]
pub struct TableParts {
    /// Display name.
    pub name: String,
    /// Playing surface from nose to nose along x, in m.
    pub length_m: f64,
    /// Playing surface from nose to nose along y, in m.
    pub width_m: f64,
    /// Height of the noses over the cloth in m: over a ball's radius, under its diameter.
    pub nose_height_m: f64,
    /// Ends of the straight cushions: balls touch them from the left of the first to the second.
    pub noses: Vec<[DVec2; 2]>,
    /// Rounded ends of cushions. A ball touches the whole circle; what lies behind a nose is out of
    /// reach.
    pub jaws: Vec<Circle>,
    /// A ball whose centre enters the circle is pocketed.
    pub pockets: Vec<Circle>,
}

impl Table {
    /// Builds a flat table.
    ///
    /// # Errors
    /// [`crate::Error::Table`] for sizes that are not positive and finite, or a table without cushions.
    pub fn from_parts(parts: TableParts) -> Result<Self> {
        let circles = || parts.jaws.iter().chain(&parts.pockets);
        let sizes = [parts.length_m, parts.width_m, parts.nose_height_m];
        let radii = circles().map(|circle| circle.radius_m);
        if let Some(bad) = sizes
            .into_iter()
            .chain(radii)
            .find(|s| !(*s > 0.0 && s.is_finite()))
        {
            return Err(TableFault::Size(bad).into());
        }
        if circles().any(|circle| !circle.center.is_finite()) {
            return Err(TableFault::CircleNotFinite.into());
        }
        if parts.noses.is_empty() {
            return Err(TableFault::NoNoses.into());
        }
        let corners = parts.noses.iter().flatten().copied();
        let (low, high) = circles()
            .flat_map(|c| [c.center - c.radius_m, c.center + c.radius_m])
            .chain(corners)
            .fold(
                (DVec2::INFINITY, DVec2::NEG_INFINITY),
                |(low, high), point| (low.min(point), high.max(point)),
            );
        let center = 0.5 * (low + high);
        let hole = |circle: &Circle| Pocket {
            center: circle.center,
            radius_m: circle.radius_m,
            mouth: (center - circle.center).try_normalize().unwrap_or(DVec2::X),
            rim_radius_m: 0.0,
            depth_m: 0.0,
        };
        Ok(Self {
            noses: parts
                .noses
                .iter()
                .map(|&[a, b]| Nose::new(a, b))
                .collect::<Result<_>>()?,
            name: parts.name,
            length_m: parts.length_m,
            width_m: parts.width_m,
            nose_height_m: parts.nose_height_m,
            bed_height_m: BED_HEIGHT_M,
            jaw_slopes: vec![DVec2::ZERO; parts.jaws.len()],
            jaws: parts.jaws,
            pockets: parts.pockets.iter().map(hole).collect(),
            cushions: Vec::new(),
            rails: None,
            ball: BallBody::POOL,
            cue_ball: BallBody::POOL,
            speed: TableSpeed::default(),
            low,
            high,
        })
    }

    /// A flat table with rails, pockets, and its object and cue balls added.
    pub(crate) fn raised(
        self,
        bed_height_m: f64,
        rails: Rails,
        pockets: Vec<Pocket>,
        cushions: Vec<Cushion>,
        [ball, cue_ball]: [BallBody; 2],
    ) -> Self {
        let outer = 0.5 * DVec2::new(self.length_m, self.width_m) + rails.width_m;
        let mut raised = Self {
            bed_height_m,
            pockets,
            cushions,
            rails: Some(rails),
            ball,
            cue_ball,
            low: -outer,
            high: outer,
            ..self
        };
        raised.slant(rails.rise_m / rails.cushion_width_m);
        raised
    }

    /// The same table with another cloth.
    pub(crate) fn with_speed(self, speed: TableSpeed) -> Self {
        Self { speed, ..self }
    }

    /// Sets the heights of facings and jaws to those of their cushions' tops, which rise behind the
    /// noses.
    fn slant(&mut self, steepness: f64) {
        for (index, cushion) in self.cushions.iter().enumerate() {
            let line = self.noses[cushion.nose];
            let next = self.cushions.get(index + 1);
            let end = next.map_or(self.noses.len(), |next| next.nose);
            // `TableSpec` pushes the facings of a cushion between its nose and the next cushion's.
            for facing in &mut self.noses[cushion.nose + 1..end] {
                // A cushion's top rises in proportion to the distance behind its nose line.
                facing.rises_m = [facing.from, facing.to]
                    .map(|tip| steepness * line.normal.dot(line.from - tip));
            }
            for (jaw, slope) in self.jaws.iter().zip(&mut self.jaw_slopes) {
                if cushion.jaws.contains(&Some(*jaw)) {
                    *slope = -steepness * line.normal;
                }
            }
        }
    }

    /// Display name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Playing surface along x, in m.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Playing surface along y, in m.
    pub fn width_m(&self) -> f64 {
        self.width_m
    }

    /// Height of the noses over the cloth, in m.
    pub fn nose_height_m(&self) -> f64 {
        self.nose_height_m
    }

    /// Straight cushions.
    pub fn noses(&self) -> &[Nose] {
        &self.noses
    }

    /// Rounded jaws.
    pub fn jaws(&self) -> &[Circle] {
        &self.jaws
    }

    /// Gradients of the heights of the cushions' tops over the jaws.
    pub(crate) fn jaw_slopes(&self) -> &[DVec2] {
        &self.jaw_slopes
    }

    /// Pockets.
    pub fn pockets(&self) -> &[Pocket] {
        &self.pockets
    }

    /// The pocket whose hole is under a point.
    pub fn pocket_under(&self, point: DVec2) -> Option<usize> {
        let holds = |pocket: &Pocket| point.distance(pocket.center) < pocket.radius_m;
        self.pockets.iter().position(holds)
    }

    /// Cushions between the pockets; none for a flat table.
    pub fn cushions(&self) -> &[Cushion] {
        &self.cushions
    }

    /// The rails around; none for a flat table.
    pub fn rails(&self) -> Option<Rails> {
        self.rails
    }

    /// Height of the rails' flat top above the cloth, in m; of the noses on a flat table.
    pub fn rail_height_m(&self) -> f64 {
        self.nose_height_m + self.rails.map_or(0.0, |rails| rails.rise_m)
    }

    /// Whether the flat top of a rail is under a point.
    pub fn is_rail_under(&self, point: DVec2) -> bool {
        let (low, high) = self.inside_of_rails();
        let inside =
            point.cmpgt(low - JOINT_SLACK_M).all() && point.cmplt(high + JOINT_SLACK_M).all();
        let in_hole = |pocket: &Pocket| {
            point.distance(pocket.center) < pocket.bore_radius_m() + JOINT_SLACK_M
        };
        self.rails.is_some() && !inside && self.contains(point) && !self.pockets.iter().any(in_hole)
    }

    /// Lowest and highest corner of the rectangle of cloth and cushions within the flat rails.
    pub(crate) fn inside_of_rails(&self) -> (DVec2, DVec2) {
        let half = 0.5 * DVec2::new(self.length_m, self.width_m)
            + self.rails.map_or(0.0, |rails| rails.cushion_width_m);
        (-half, half)
    }

    /// Height of the cloth over the room's floor, in m.
    pub fn bed_height_m(&self) -> f64 {
        self.bed_height_m
    }

    /// Body of the object balls.
    pub fn ball(&self) -> BallBody {
        self.ball
    }

    /// Body of the cue ball, which may be larger than the others.
    pub fn cue_ball(&self) -> BallBody {
        self.cue_ball
    }

    /// Body of the ball of this number: the cue ball is 0.
    pub fn body_of(&self, number: u8) -> BallBody {
        match number {
            0 => self.cue_ball,
            _ => self.ball,
        }
    }

    /// The ball of this number at rest, in m from the table's middle.
    pub fn resting_ball(&self, number: u8, at: DVec2) -> BallState {
        BallState::at_rest(number, at.x, at.y, &self.body_of(number))
    }

    /// Speed of its cloth.
    pub fn speed(&self) -> TableSpeed {
        self.speed
    }

    /// Start of the cue ball: a quarter of the length from the head cushion, at −x.
    pub fn head_spot(&self) -> DVec2 {
        DVec2::new(-0.25 * self.length_m, 0.0)
    }

    /// Apex of a rack: a quarter of the length from the foot cushion, at +x.
    pub fn foot_spot(&self) -> DVec2 {
        DVec2::new(0.25 * self.length_m, 0.0)
    }

    /// Lowest and highest corner of the outline of all cushions and pockets, in m.
    pub fn outline(&self) -> (DVec2, DVec2) {
        (self.low, self.high)
    }

    /// Whether a centre lies within the outline.
    pub fn contains(&self, point: DVec2) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }
}

/// Extension of noses beyond their ends in m, so that no ball slips between a nose and the jaw that
/// continues it.
pub(crate) const JOINT_SLACK_M: f64 = 1e-9;
/// Default height of the bed: 30 inches; WPA's specifications allow at most 31.
const BED_HEIGHT_M: f64 = 0.762;
