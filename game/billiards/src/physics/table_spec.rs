//! Specification of a table: the dimensions of equipment standards, and the construction of its shape
//! from them.
//!
//! ```text
//!            back                 The facing turns away from the nose line by 180° − cut angle;
//!      ________________           jaws are rounded where they meet. The mouth is measured
//!     /                \          between the unrounded tips, the shelf from the mouth to where
//!    / facing    facing \         the level cloth ends.
//!   (____________________)  ←── rounded jaw
//!    ↑       nose       ↑
//!  mouth              mouth
//! ```

use std::ops::Range;

use glam::DVec2;
use serde::Deserialize;

use crate::{Result, TableFault};

use super::{
    ball::BallBody,
    table::{Circle, Cushion, Pocket, Rails, Table, TableParts},
};
use crate::deterministic_math::{sin_cos, tan};

/// The dimensions of a table, as its file stores them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableSpec {
    /// Display name.
    pub name: String,
    /// Source of the figures.
    pub source: String,
    /// Playing surface from nose to nose along x, in m.
    pub length_m: f64,
    /// Playing surface from nose to nose along y, in m.
    pub width_m: f64,
    /// Height of the cloth over the floor, in m.
    pub bed_height_m: f64,
    /// Height of the noses over the cloth, in m: over a ball's radius, under its diameter.
    pub nose_height_m: f64,
    /// Tops of the cushions, and rails around them.
    pub rails: Rails,
    /// The pockets in the corners; none on a carom table.
    pub corner_pockets: Option<PocketSpec>,
    /// The pockets in the middle of the long sides; only with corner pockets.
    pub side_pockets: Option<PocketSpec>,
    /// Body of the object balls.
    pub ball: BallBody,
    /// Body of the cue ball, if it differs.
    pub cue_ball: Option<BallBody>,
}

/// The dimensions of a pocket.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PocketSpec {
    /// Distance between the tips of the cushions, in m.
    pub mouth_m: f64,
    /// Angle between nose line and facing inside the cushion, in degrees, 90 to 179.
    pub cut_deg: f64,
    /// Radius of the rounded jaws, in m.
    pub jaw_radius_m: f64,
    /// Distance from the mouth to where the level cloth ends, in m; negative if the hole reaches beyond
    /// the mouth.
    pub shelf_m: f64,
    /// Radius of the hole where the level cloth ends, in m.
    pub radius_m: f64,
    /// Radius of the slate's rounded edge, in m.
    pub rim_radius_m: f64,
    /// Depth to which a ball falls before it is removed, in m.
    pub depth_m: f64,
}

impl Table {
    /// Reads a table from JSON ([`TableSpec`]).
    ///
    /// # Errors
    /// [`crate::Error::Table`] with the place in the text or the rule that is broken.
    pub fn parse(json: &str) -> Result<Self> {
        TableSpec::parse(json)?.build()
    }
}

impl TableSpec {
    /// Reads the dimensions of a table from JSON.
    ///
    /// # Errors
    /// [`crate::Error::Table`] with the place in the text.
    pub fn parse(json: &str) -> Result<Self> {
        Ok(serde_json::from_str(json).map_err(TableFault::Json)?)
    }

    /// Builds the table with these dimensions.
    ///
    /// # Errors
    /// [`crate::Error::Table`] for a dimension out of its range, or pockets that leave no cushion.
    pub fn build(&self) -> Result<Table> {
        self.validate()?;
        let mut outlines = CushionOutlines {
            cushion_width_m: self.rails.cushion_width_m,
            ..CushionOutlines::default()
        };
        let corners = self.corners();
        for side in 0..4 {
            let (from, to) = (corners[side], corners[(side + 1) % 4]);
            self.lay_side(&mut outlines, from, to);
        }
        let flat = Table::from_parts(TableParts {
            name: self.name.clone(),
            length_m: self.length_m,
            width_m: self.width_m,
            nose_height_m: self.nose_height_m,
            noses: outlines.noses,
            jaws: outlines.jaws,
            pockets: Vec::new(),
        })?;
        let balls = [self.ball, self.cue_ball.unwrap_or(self.ball)];
        let pockets = self.pockets();
        Ok(flat.raised(
            self.bed_height_m,
            self.rails,
            pockets,
            outlines.cushions,
            balls,
        ))
    }

    /// Lays the cushions of one side, with the balls on its left.
    fn lay_side(&self, outlines: &mut CushionOutlines, from: DVec2, to: DVec2) {
        let along = (to - from).normalize();
        let corner = self.corner_pockets.map(|pocket| CushionEnd {
            pocket,
            // The mouth is the hypotenuse of the right angle in the corner, and the insets of both sides
            // are its legs.
            inset_m: pocket.mouth_m * 0.5f64.sqrt(),
        });
        let side = self.side_pockets.map(|pocket| CushionEnd {
            pocket,
            inset_m: 0.5 * pocket.mouth_m,
        });
        if side.is_some() && along.y == 0.0 {
            let middle = from.midpoint(to);
            outlines.lay_cushion((from, corner), (middle, side));
            outlines.lay_cushion((middle, side), (to, corner));
        } else {
            outlines.lay_cushion((from, corner), (to, corner));
        }
    }

    /// Intersections of the nose lines, anticlockwise from −x, −y.
    fn corners(&self) -> [DVec2; 4] {
        let half = 0.5 * DVec2::new(self.length_m, self.width_m);
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| half * DVec2::new(x, y))
    }

    /// The pockets, from −x to +x, first those at −y.
    fn pockets(&self) -> Vec<Pocket> {
        let half = 0.5 * DVec2::new(self.length_m, self.width_m);
        let mut pockets = Vec::new();
        for across in [-1.0, 1.0] {
            for along in [-1.0, 0.0, 1.0] {
                let spec = if along == 0.0 {
                    self.side_pockets
                } else {
                    self.corner_pockets
                };
                let Some(spec) = spec else { continue };
                let outward = DVec2::new(along, across).normalize();
                // In a corner's right angle the middle of the mouth, the hypotenuse, is half its length
                // away.
                let inset = if along == 0.0 {
                    0.0
                } else {
                    0.5 * spec.mouth_m
                };
                let mouth = half * DVec2::new(along, across) - inset * outward;
                pockets.push(Pocket {
                    center: mouth + (spec.shelf_m + spec.radius_m) * outward,
                    radius_m: spec.radius_m,
                    mouth: -outward,
                    rim_radius_m: spec.rim_radius_m,
                    depth_m: spec.depth_m,
                });
            }
        }
        pockets
    }

    /// The dimensions with their names and ranges.
    fn dimensions(&self) -> Vec<(&'static str, f64, Range<f64>)> {
        let radius = self.ball.radius_m;
        let size = 0.1..1e4;
        let small = 1e-4..1.0;
        let mut checks = vec![
            ("length", self.length_m, size.clone()),
            ("width", self.width_m, size),
            ("height of the bed", self.bed_height_m, 0.1..10.0),
            (
                "height of the noses",
                self.nose_height_m,
                radius..2.0 * radius,
            ),
            (
                "width of the cushions",
                self.rails.cushion_width_m,
                small.clone(),
            ),
            (
                "rise of the cushions",
                self.rails.rise_m,
                0.0..self.rails.cushion_width_m,
            ),
            (
                "width of the rails",
                self.rails.width_m,
                self.rails.cushion_width_m..2.0,
            ),
            ("mass of the balls", self.ball.mass_kg, 1e-6..1e3),
            ("radius of the balls", radius, 1e-4..10.0),
        ];
        for pocket in self.corner_pockets.iter().chain(&self.side_pockets) {
            checks.extend([
                ("mouth of a pocket", pocket.mouth_m, 2.0 * radius..1.0),
                ("cut angle of a pocket", pocket.cut_deg, 90.0..179.0),
                ("jaw radius of a pocket", pocket.jaw_radius_m, small.clone()),
                ("shelf of a pocket", pocket.shelf_m, -pocket.radius_m..1.0),
                ("radius of a pocket", pocket.radius_m, radius..1.0),
                (
                    "rim radius of a pocket",
                    pocket.rim_radius_m,
                    0.0..pocket.radius_m - radius,
                ),
                ("depth of a pocket", pocket.depth_m, 0.0..self.bed_height_m),
            ]);
        }
        checks
    }

    fn validate(&self) -> Result<()> {
        let table = || self.name.clone();
        let outside =
            |(_, value, range): &(_, f64, Range<f64>)| !(range.start..=range.end).contains(value);
        if let Some((name, value, range)) = self.dimensions().into_iter().find(outside) {
            return Err(TableFault::Dimension {
                table: table(),
                dimension: name,
                value,
                min: range.start,
                max: range.end,
            }
            .into());
        }
        if self.side_pockets.is_some() && self.corner_pockets.is_none() {
            return Err(TableFault::SidePocketsOnly(table()).into());
        }
        let mouths =
            |pocket: Option<PocketSpec>| pocket.map_or(0.0, |p| p.mouth_m + 2.0 * p.jaw_radius_m);
        let taken_m = 2.0 * (mouths(self.corner_pockets) + mouths(self.side_pockets));
        if taken_m > self.width_m.min(self.length_m) {
            return Err(TableFault::NoCushionLeft {
                table: table(),
                taken_m,
            }
            .into());
        }
        Ok(())
    }
}

/// End of a cushion at a pocket.
#[derive(Clone, Copy)]
struct CushionEnd {
    pocket: PocketSpec,
    /// Distance in m from the corner, or from the pocket's middle, to the unrounded tip.
    inset_m: f64,
}

/// Parts of the cushions under construction.
#[derive(Default)]
struct CushionOutlines {
    cushion_width_m: f64,
    noses: Vec<[DVec2; 2]>,
    jaws: Vec<Circle>,
    cushions: Vec<Cushion>,
}

impl CushionOutlines {
    /// Lays a cushion between two points of a side; an end without a pocket is mitred.
    fn lay_cushion(
        &mut self,
        (start, opens): (DVec2, Option<CushionEnd>),
        (stop, ends): (DVec2, Option<CushionEnd>),
    ) {
        let along = (stop - start).normalize();
        let inward = along.perp();
        let inset = |tip: Option<CushionEnd>| tip.map_or(0.0, |tip| tip.inset_m);
        let (from, to) = (start + inset(opens) * along, stop - inset(ends) * along);
        let nose = self.noses.len();
        // Pushed before its facings, which follow it up to the next cushion's nose: `Table::slant`
        // relies on this order.
        self.noses.push([from, to]);
        let (first_back, first_jaw) = self.lay_end(from, -along, inward, opens);
        let (last_back, last_jaw) = self.lay_end(to, along, inward, ends);
        let rounded = |tip: Option<CushionEnd>| tip.map_or(0.0, |tip| tip.pocket.tangent_m());
        self.noses[nose] = [from + rounded(opens) * along, to - rounded(ends) * along];
        self.cushions.push(Cushion {
            nose,
            corners: [to, from, first_back, last_back],
            jaws: [last_jaw, first_jaw],
        });
    }

    /// Lays jaw and facing at an end whose unrounded `tip` points along `outward`; returns where the
    /// facing meets the back, and the jaw.
    fn lay_end(
        &mut self,
        tip: DVec2,
        outward: DVec2,
        inward: DVec2,
        end: Option<CushionEnd>,
    ) -> (DVec2, Option<Circle>) {
        let Some(CushionEnd { pocket, .. }) = end else {
            return (tip + self.cushion_width_m * (outward - inward), None);
        };
        let (sin, cos) = sin_cos(pocket.turn_rad());
        let facing = cos * outward - sin * inward;
        let length = self.cushion_width_m / sin;
        let tangent = pocket.tangent_m();
        let back = tip + length * facing;
        // Otherwise the rounding takes up the whole facing.
        if length > tangent {
            let ends = [tip + tangent * facing, back];
            // Balls are on the left of a line: at the far end that is from the tip backwards.
            let is_far = outward.perp() == inward;
            self.noses
                .push(if is_far { ends } else { [ends[1], ends[0]] });
        }
        let jaw = Circle {
            center: tip - tangent * outward - pocket.jaw_radius_m * inward,
            radius_m: pocket.jaw_radius_m,
        };
        self.jaws.push(jaw);
        (back, Some(jaw))
    }
}

impl PocketSpec {
    fn turn_rad(&self) -> f64 {
        (180.0 - self.cut_deg).to_radians()
    }

    /// Distance in m from the unrounded tip to where the rounding begins.
    fn tangent_m(&self) -> f64 {
        // r·tan(turn/2): a circle tangent to both lines.
        self.jaw_radius_m * tan(0.5 * self.turn_rad())
    }
}
