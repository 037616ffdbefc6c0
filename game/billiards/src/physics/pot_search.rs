//! A stroke that pots a ball, found by trying strokes with the simulator that plays them.
//!
//! ```text
//! target × pocket ─► ghost ball ─► bearing, corrected until the object ball leaves for the pocket
//!   (easiest first)                   │   (throw, squirt and swerve are in the simulation)
//!                                     ▼
//!                    the whole shot pots it, legally? ─► how many of its neighbours do as well
//! ```
//! It knows no rules: which balls may be hit and potted is an argument. The search is bounded by a
//! number of simulations and takes everything in a fixed order, so that the same table gets the
//! same answer.

use std::f64::consts::PI;

use glam::DVec2;

use crate::Result;

use super::{
    aim_line::{AimContact, predict},
    ball::BallState,
    cue_impact::Stroke,
    event::EventKind,
    shot::Shot,
    world::World,
};
use crate::deterministic_math::{angle_of, atan2};

/// A stroke that pots a ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Suggestion {
    /// To be played with [`World::strike`] as it is.
    pub stroke: Stroke,
    /// The ball that it pots.
    pub ball: u8,
    /// Index into the table's pockets.
    pub pocket: usize,
    /// How many of the four strokes beside it, 0.15° to the left and right, 8 % softer and harder,
    /// pot a target as well.
    pub margin: u32,
    /// Strokes that were simulated, in whole or up to the first contact.
    pub simulated: u32,
}

/// Looks for a stroke after which the cue ball first touches one of `targets`, one of them is
/// potted, and the cue ball stays on the table. `simulations_max` bounds the time: a simulation
/// takes a fraction of a millisecond, a few milliseconds while a rack is tight. The best of those
/// that were found until then; None if none was, or no target or no cue ball is on the table.
///
/// # Errors
/// [`crate::Error::Endless`] if a stroke passes the simulation's limits.
pub fn suggest(world: &World, targets: &[u8], simulations_max: u32) -> Result<Option<Suggestion>> {
    let mut search = PotSearch {
        world,
        targets,
        left: simulations_max,
        best: None,
    };
    let lines = search.lines();
    'lines: for line in &lines {
        for (speed_m_s, vertical) in TOUCHES {
            if search.left == 0 || search.is_safe() {
                break 'lines;
            }
            let stroke = Stroke {
                vertical,
                ..Stroke::straight(line.bearing_rad, speed_m_s)
            };
            search.try_line(line, stroke)?;
        }
    }
    let simulated = simulations_max - search.left;
    Ok(search.best.map(|best| Suggestion { simulated, ..best }))
}

/// A straight way from the cue ball by a ghost ball to a pocket.
#[derive(Clone, Copy, Debug)]
struct PotLine {
    ball: u8,
    bearing_rad: f64,
    to_pocket: DVec2,
    /// By how much the object ball's way turns for a turn of the cue's.
    lever: f64,
    /// How far an error of the cue is off at the pocket, in m per rad.
    difficulty: f64,
}

struct PotSearch<'a> {
    world: &'a World,
    targets: &'a [u8],
    left: u32,
    best: Option<Suggestion>,
}

impl PotSearch<'_> {
    /// Easiest first.
    fn lines(&self) -> Vec<PotLine> {
        let balls = self.world.balls();
        let lies = |ball: &&BallState| ball.phase.is_on_table();
        let Some(cue_ball) = balls.iter().filter(lies).find(|ball| ball.number == 0) else {
            return Vec::new();
        };
        let mut lines = Vec::new();
        for object in balls
            .iter()
            .filter(lies)
            .filter(|b| self.targets.contains(&b.number))
        {
            for rim in self.world.table().pockets() {
                let place = object.position.truncate();
                let radii_m = cue_ball.body.radius_m + object.body.radius_m;
                let way = rim.center - place;
                let to_pocket = way.normalize_or_zero();
                let to_ghost = place - radii_m * to_pocket - cue_ball.position.truncate();
                let cos_cut = to_ghost.normalize_or_zero().dot(to_pocket);
                if object.number != 0 && cos_cut > COS_CUT_MIN {
                    let lever = to_ghost.length() / (radii_m * cos_cut);
                    lines.push(PotLine {
                        ball: object.number,
                        bearing_rad: angle_of(to_ghost),
                        to_pocket,
                        lever,
                        difficulty: lever * way.length(),
                    });
                }
            }
        }
        lines.sort_by(|a, b| a.difficulty.total_cmp(&b.difficulty));
        lines
    }

    /// Whether nothing better can be found.
    fn is_safe(&self) -> bool {
        self.best.is_some_and(|best| best.margin == NEIGHBOURS)
    }

    fn try_line(&mut self, line: &PotLine, stroke: Stroke) -> Result<()> {
        let Some(stroke) = self.aimed(line, stroke)? else {
            return Ok(());
        };
        let Some((ball, pocket)) = self.potted(stroke)? else {
            return Ok(());
        };
        let mut margin = 0;
        for (turn_rad, harder) in [
            (BESIDE_RAD, 1.0),
            (-BESIDE_RAD, 1.0),
            (0.0, 0.92),
            (0.0, 1.08),
        ] {
            let beside = Stroke {
                direction_rad: stroke.direction_rad + turn_rad,
                speed_m_s: stroke.speed_m_s * harder,
                ..stroke
            };
            margin += u32::from(self.potted(beside)?.is_some());
        }
        if self.best.is_none_or(|best| margin > best.margin) {
            self.best = Some(Suggestion {
                stroke,
                ball,
                pocket,
                margin,
                simulated: 0,
            });
        }
        Ok(())
    }

    /// The stroke turned until the object ball leaves for the pocket; None if the way is blocked.
    fn aimed(&mut self, line: &PotLine, mut stroke: Stroke) -> Result<Option<Stroke>> {
        for _ in 0..CORRECTIONS {
            if !self.simulates() {
                return Ok(None);
            }
            let contact = predict(self.world, stroke)?.contact;
            let AimContact::Ball {
                number,
                object_direction,
                ..
            } = contact
            else {
                return Ok(None);
            };
            let way = object_direction.truncate();
            if number != line.ball || way == DVec2::ZERO {
                return Ok(None);
            }
            let off = atan2(line.to_pocket.perp_dot(way), line.to_pocket.dot(way));
            if off.abs() < AIMED_RAD {
                break;
            }
            // A cue turned to the left meets the ball more on its left and sends it to the right.
            stroke.direction_rad += (off / line.lever).clamp(-PI / 16.0, PI / 16.0);
        }
        Ok(Some(stroke))
    }

    /// The target that a stroke pots, and where; None if it pots none or is not allowed.
    fn potted(&mut self, stroke: Stroke) -> Result<Option<(u8, usize)>> {
        if !self.simulates() {
            return Ok(None);
        }
        Ok(self.judge(&self.world.strike(stroke)?))
    }

    fn judge(&self, shot: &Shot) -> Option<(u8, usize)> {
        let mut first_touched = None;
        let mut potted = None;
        for event in shot.events() {
            match event.kind {
                EventKind::BallBall { first, second, .. } if first == 0 || second == 0 => {
                    first_touched = first_touched.or(Some(first.max(second)));
                }
                EventKind::Pocketed { ball, pocket, .. } if self.targets.contains(&ball) => {
                    potted = potted.or(Some((ball, pocket)));
                }
                _ => {}
            }
        }
        let is_legal = first_touched.is_some_and(|number| self.targets.contains(&number));
        let ends = shot.final_states();
        let stays = ends
            .iter()
            .any(|ball| ball.number == 0 && ball.phase.is_on_table());
        potted.filter(|_| is_legal && stays)
    }

    /// Whether one more simulation is allowed; it then counts.
    fn simulates(&mut self) -> bool {
        let allowed = self.left > 0;
        self.left -= u32::from(allowed);
        allowed
    }
}

/// Speeds of the cue in m/s and heights of the tip that are tried on each line.
const TOUCHES: [(f64, f64); 6] = [
    (2.0, 0.0),
    (3.0, 0.0),
    (1.2, 0.2),
    (2.5, -0.3),
    (2.5, 0.3),
    (5.0, 0.0),
];
/// Thinner cuts, beyond 80°, are left out.
const COS_CUT_MIN: f64 = 0.17;
/// Predictions to aim one stroke.
const CORRECTIONS: u32 = 5;
/// 3 mm off after 3 m.
const AIMED_RAD: f64 = 1e-3;
/// A good player's error of aim.
const BESIDE_RAD: f64 = 0.15 * PI / 180.0;
const NEIGHBOURS: u32 = 4;
