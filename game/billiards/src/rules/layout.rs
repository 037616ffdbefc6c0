//! The layout of a table: its marks, areas for the cue ball, and spotting.

use carom_text::text;
use glam::DVec2;

use crate::PlacementFault;
use crate::deterministic_math::unit_at;

/// A ball that lies on the table: its number and its centre seen from above, in m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPosition {
    /// 0 is the cue ball.
    pub ball: u8,
    /// x along the length, from the head to the foot; y across; the centre of the cloth is 0.
    pub at: DVec2,
}

/// The balls that lie on the table.
pub type BallPositions = Vec<BallPosition>;

/// Position of this ball, if it is on the table.
pub(crate) fn place_of(positions: &[BallPosition], ball: u8) -> Option<DVec2> {
    positions.iter().find(|p| p.ball == ball).map(|p| p.at)
}

/// The numbers of all but the cue ball.
pub(crate) fn object_balls(positions: &[BallPosition]) -> Vec<u8> {
    let balls = positions.iter().map(|p| p.ball);
    balls.filter(|&ball| ball != 0).collect()
}

/// Area in which a player may place the cue ball.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlacementArea {
    /// Anywhere on the table.
    Anywhere,
    /// Behind the head string.
    Kitchen,
    /// Snooker's half circle at the baulk line.
    D,
}

impl PlacementArea {
    /// In words, to follow "the cue ball is in hand".
    pub fn display_text(self) -> &'static str {
        match self {
            Self::Anywhere => text!("area-anywhere"),
            Self::Kitchen => text!("area-kitchen"),
            Self::D => text!("area-d"),
        }
    }
}

/// The properties of a table that concern the rules.
#[derive(Clone, Debug, PartialEq)]
pub struct TableLayout {
    /// From nose to nose along x, in m.
    pub length_m: f64,
    /// From nose to nose along y, in m.
    pub width_m: f64,
    /// Radius of an object ball, in m.
    pub radius_m: f64,
    /// Radius of the cue ball, in m.
    pub cue_radius_m: f64,
    /// Centres of the pockets, in m.
    pub pockets: Vec<DVec2>,
}

impl TableLayout {
    /// The head spot: a quarter of the length from the head cushion.
    pub fn head_spot(&self) -> DVec2 {
        DVec2::new(-0.25 * self.length_m, 0.0)
    }

    /// The foot spot: a quarter of the length from the foot cushion.
    pub fn foot_spot(&self) -> DVec2 {
        DVec2::new(0.25 * self.length_m, 0.0)
    }

    /// The middle of snooker's baulk line, 737 mm (29 in) from the baulk cushion on a full-size table
    /// (WPBSA section 1, 1 (e)), in proportion on others.
    pub fn baulk_spot(&self) -> DVec2 {
        DVec2::new((BAULK_SHARE - 0.5) * self.length_m, 0.0)
    }

    /// Radius of snooker's D: 292 mm on a full-size table.
    pub fn d_radius_m(&self) -> f64 {
        D_SHARE * self.length_m
    }

    /// Whether the cue ball may be put at a place. Lines belong to the area within them.
    ///
    /// # Errors
    /// The reason why not.
    pub fn may_place(
        &self,
        positions: &[BallPosition],
        at: DVec2,
        area: PlacementArea,
    ) -> Result<(), PlacementFault> {
        if !at.is_finite() || !self.is_on_cloth(at, self.cue_radius_m) {
            return Err(PlacementFault::NotOnCloth);
        }
        if !self.is_within(at, area) {
            let area = area.display_text();
            return Err(PlacementFault::OutsideArea(area));
        }
        let least = self.radius_m + self.cue_radius_m;
        let touches = |p: &&BallPosition| p.ball != 0 && p.at.distance(at) < least + TOUCH_M;
        match positions.iter().find(touches) {
            Some(p) => Err(PlacementFault::Touches(p.ball)),
            None => Ok(()),
        }
    }

    /// Initial place of a cue ball in hand, from which a player may move it: the middle of the area's
    /// line, or the nearest free place.
    pub fn place_in_hand(&self, positions: &[BallPosition], area: PlacementArea) -> DVec2 {
        let home = match area {
            PlacementArea::D => self.baulk_spot() - DVec2::new(0.0, 0.5 * self.d_radius_m()),
            PlacementArea::Kitchen | PlacementArea::Anywhere => self.head_spot(),
        };
        let step = 0.5 * self.cue_radius_m;
        let ring = |i: u32| {
            let angle = f64::from(i % 16) * std::f64::consts::TAU / 16.0;
            // Rounded up: place 0 is `home` itself, and from place 1 on each ring has sixteen.
            home + unit_at(angle) * (step * f64::from(i.div_ceil(16)))
        };
        (0..16 * RINGS)
            .map(ring)
            .find(|&at| self.may_place(positions, at, area).is_ok())
            .unwrap_or(home)
    }

    fn is_within(&self, at: DVec2, area: PlacementArea) -> bool {
        match area {
            PlacementArea::Anywhere => true,
            PlacementArea::Kitchen => at.x <= self.head_spot().x + LINE_M,
            PlacementArea::D => {
                let from = at - self.baulk_spot();
                from.x <= LINE_M && from.length() <= self.d_radius_m() + LINE_M
            }
        }
    }

    /// Whether a ball lies clear of cushions and pockets.
    fn is_on_cloth(&self, at: DVec2, radius_m: f64) -> bool {
        let half = 0.5 * DVec2::new(self.length_m, self.width_m) - radius_m;
        let in_hole = |pocket: &DVec2| pocket.distance(at) < HOLE_RADII * radius_m;
        at.abs().cmple(half).all() && !self.pockets.iter().any(in_hole)
    }

    /// Whether a ball can lie at a spot without touching another.
    pub fn is_free(&self, positions: &[BallPosition], spot: DVec2) -> bool {
        positions
            .iter()
            .all(|p| p.at.distance(spot) >= self.radius_m + self.radius_of(p.ball))
    }

    /// Place at which a ball is spotted: the spot, or on the line through it along the table as near as
    /// possible, first towards the foot cushion, and towards the head if there is no room (WPA 1.4;
    /// WPBSA 7). It may touch an object ball, never the cue ball.
    pub fn spotted(&self, positions: &[BallPosition], spot: DVec2) -> DVec2 {
        // The other balls leave intervals of the line free: the nearest free place is the spot or an
        // end of an interval.
        let mut places: Vec<f64> = vec![spot.x];
        for p in positions {
            let gap = if p.ball == 0 { CUE_GAP_M } else { SPOT_GAP_M };
            let least = self.radius_m + self.radius_of(p.ball) + gap;
            let across = p.at.y - spot.y;
            if across.abs() < least {
                let along = (least * least - across * across).sqrt();
                places.extend([p.at.x + along, p.at.x - along]);
            }
        }
        let towards_foot = |x: &f64| *x >= spot.x;
        let (mut foot, mut head): (Vec<f64>, Vec<f64>) = places.into_iter().partition(towards_foot);
        foot.sort_by(f64::total_cmp);
        head.sort_by(|a, b| b.total_cmp(a));
        let at = |x: f64| DVec2::new(x, spot.y);
        foot.into_iter()
            .chain(head)
            .map(at)
            .find(|&at| {
                let half = 0.5 * self.length_m - self.radius_m;
                at.x.abs() <= half && self.is_free(positions, at)
            })
            .unwrap_or(spot)
    }

    pub(crate) fn radius_of(&self, ball: u8) -> f64 {
        if ball == 0 {
            self.cue_radius_m
        } else {
            self.radius_m
        }
    }

    /// Whether the straight path of a ball of radius `moving_radius_m` from `from` to `to` is clear of
    /// the balls of `positions` that `blocks` names.
    pub fn is_clear(
        &self,
        positions: &[BallPosition],
        (from, to): (DVec2, DVec2),
        moving_radius_m: f64,
        blocks: impl Fn(u8) -> bool,
    ) -> bool {
        let way = to - from;
        positions.iter().filter(|p| blocks(p.ball)).all(|p| {
            let t = ((p.at - from).dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0);
            (from + t * way).distance(p.at) >= moving_radius_m + self.radius_of(p.ball) - LINE_M
        })
    }

    /// The name of a pocket, as seen from the head of the table.
    pub fn pocket_name(&self, pocket: usize) -> String {
        let Some(at) = self.pockets.get(pocket) else {
            return text!("pocket").to_owned();
        };
        let along = if at.x.abs() < 0.2 * self.length_m {
            "side"
        } else if at.x > 0.0 {
            "foot"
        } else {
            "head"
        };
        let across = if at.y > 0.0 { "left" } else { "right" };
        text!("pocket-named", across = across, along = along)
    }
}

/// Distance of the baulk line over the length: 737 mm of 3569 mm.
const BAULK_SHARE: f64 = 0.737 / 3.569;
/// Radius of the D over the length: 292 mm of 3569 mm.
const D_SHARE: f64 = 0.292 / 3.569;
/// Distance in m within which a place is on a line.
const LINE_M: f64 = 1e-6;
/// Minimum gap in m between a ball in hand and others.
const TOUCH_M: f64 = 1e-4;
/// Gap in m between a spotted ball and an object ball, which it all but touches; that to the cue ball
/// is larger.
const SPOT_GAP_M: f64 = 1e-6;
const CUE_GAP_M: f64 = 1e-3;
/// Distance from a pocket's centre, in ball radii, within which a ball hangs over the pocket's edge.
const HOLE_RADII: f64 = 2.2;
/// Rings of places around the first that are tried: they cover the whole table.
const RINGS: u32 = 200;
