//! The table: straight cushions, rounded jaws, pockets and spots, read from JSON.
//!
//! Coordinates are centred on the cloth: x along the length, y across, z up, cloth at z = 0.

use glam::DVec2;
use serde::Deserialize;

use super::error::{Error, Result};

/// The nose line of a straight cushion: balls touch it from the left of `from` → `to`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nose {
    from: DVec2,
    to: DVec2,
    normal: DVec2,
}

impl Nose {
    /// # Errors
    /// [`Error::Table`] for ends that coincide or are not finite.
    pub fn new(from: DVec2, to: DVec2) -> Result<Self> {
        let along = to - from;
        match along.try_normalize() {
            Some(unit) if from.is_finite() && to.is_finite() => Ok(Self {
                from,
                to,
                normal: unit.perp(),
            }),
            _ => Err(Error::Table(format!(
                "a nose from {from} to {to} has no length"
            ))),
        }
    }

    /// One end, in m.
    pub fn from(&self) -> DVec2 {
        self.from
    }

    /// The other end, in m.
    pub fn to(&self) -> DVec2 {
        self.to
    }

    /// Unit vector towards the balls.
    pub fn normal(&self) -> DVec2 {
        self.normal
    }

    /// Whether a point is beside the nose, not beyond its ends.
    pub(crate) fn spans(&self, point: DVec2) -> bool {
        let along = self.to - self.from;
        let t = (point - self.from).dot(along);
        let slack = JOINT_SLACK_M * along.length();
        t >= -slack && t <= along.length_squared() + slack
    }
}

/// A circle seen from above: a rounded jaw, or the rim of a pocket.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Circle {
    /// In m.
    pub center: DVec2,
    /// In m.
    pub radius_m: f64,
}

/// A table's shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    name: String,
    length_m: f64,
    width_m: f64,
    nose_height_m: f64,
    noses: Vec<Nose>,
    jaws: Vec<Circle>,
    pockets: Vec<Circle>,
    low: DVec2,
    high: DVec2,
}

/// The parts of a [`Table`].
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableParts {
    /// For the player.
    pub name: String,
    /// Playing surface from nose to nose along x, in m.
    pub length_m: f64,
    /// Playing surface from nose to nose along y, in m.
    pub width_m: f64,
    /// Height of the noses over the cloth in m: over a ball's radius, under its diameter.
    pub nose_height_m: f64,
    /// Ends of the straight cushions: balls touch them from the left of the first to the second.
    pub noses: Vec<[DVec2; 2]>,
    /// Rounded ends of cushions. A ball touches the whole circle; what of it lies behind a nose
    /// is out of reach.
    pub jaws: Vec<Circle>,
    /// A ball whose centre enters the circle is pocketed.
    pub pockets: Vec<Circle>,
}

impl Table {
    /// A 9-foot pool table: 2.54 × 1.27 m between noses, six pockets.
    pub fn nine_foot() -> Self {
        Self::parse(include_str!("../../../assets/tables/nine_foot.json"))
            .expect("the built-in table is valid: a test reads it")
    }

    /// Reads a table from JSON ([`TableParts`]).
    ///
    /// # Errors
    /// [`Error::Table`] with the place in the text or the rule that is broken.
    pub fn parse(json: &str) -> Result<Self> {
        let parts = serde_json::from_str(json).map_err(|error| Error::Table(error.to_string()))?;
        Self::from_parts(parts)
    }

    /// Builds a table.
    ///
    /// # Errors
    /// [`Error::Table`] for sizes that are not positive and finite, or a table without cushions.
    pub fn from_parts(parts: TableParts) -> Result<Self> {
        let circles = || parts.jaws.iter().chain(&parts.pockets);
        let sizes = [parts.length_m, parts.width_m, parts.nose_height_m];
        let radii = circles().map(|circle| circle.radius_m);
        if let Some(bad) = sizes
            .into_iter()
            .chain(radii)
            .find(|s| !(*s > 0.0 && s.is_finite()))
        {
            return Err(Error::Table(format!("a size of {bad} m is not over 0")));
        }
        if circles().any(|circle| !circle.center.is_finite()) {
            return Err(Error::Table("a circle's center is not finite".to_owned()));
        }
        if parts.noses.is_empty() {
            return Err(Error::Table(
                "it has no noses, so that nothing holds the balls".to_owned(),
            ));
        }
        let corners = parts.noses.iter().flatten().copied();
        let (low, high) = circles()
            .flat_map(|c| [c.center - c.radius_m, c.center + c.radius_m])
            .chain(corners)
            .fold(
                (DVec2::INFINITY, DVec2::NEG_INFINITY),
                |(low, high), point| (low.min(point), high.max(point)),
            );
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
            jaws: parts.jaws,
            pockets: parts.pockets,
            low,
            high,
        })
    }

    /// For the player.
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

    /// Pockets.
    pub fn pockets(&self) -> &[Circle] {
        &self.pockets
    }

    /// Where the cue ball starts: a quarter of the length from the head cushion, at −x.
    pub fn head_spot(&self) -> DVec2 {
        DVec2::new(-0.25 * self.length_m, 0.0)
    }

    /// Where the apex of a rack lies: a quarter of the length from the foot cushion, at +x.
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

/// Noses reach this far over their ends, so that no ball slips between a nose and the jaw that
/// continues it.
const JOINT_SLACK_M: f64 = 1e-9;
