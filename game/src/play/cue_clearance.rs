//! Clearance of the cue: the elevation at which it passes over rails and balls.

use carom_billiards::physics::{BallState, Shot, Stroke, Table};
use glam::{DVec2, DVec3};

use super::aim::Aim;
use super::cue::{CueView, DRAW_M};
use crate::scene::cue_stick::{CUE_LENGTH_M, CuePose, cue_radius_m};

/// The cue ball and possible obstacles of the cue.
#[derive(Clone, Copy, Debug)]
pub(super) struct CueClearance<'a> {
    table: &'a Table,
    cue_ball: BallState,
    balls: &'a [BallState],
}

impl<'a> CueClearance<'a> {
    /// The clearance over the present balls; none without a cue ball on the table.
    pub(super) fn new(table: &'a Table, balls: &'a [BallState]) -> Option<Self> {
        let is_cue_ball = |ball: &&BallState| ball.number == 0 && ball.phase.is_on_table();
        Some(Self {
            table,
            cue_ball: *balls.iter().find(is_cue_ball)?,
            balls,
        })
    }

    /// Sets the elevation to the one wanted by the player, or higher if obstacles demand it.
    pub(super) fn raise(&self, aim: &mut Aim) {
        aim.elevation_rad = self.lowest_clear_rad(aim, aim.wanted_rad);
    }

    /// The least elevation from `wanted_rad` up, in radians, at which the whole cue, drawn back or
    /// not, is clear; the greatest allowed one if there is none.
    fn lowest_clear_rad(&self, aim: &Aim, wanted_rad: f64) -> f64 {
        let ground = self.ground(aim.bearing_rad);
        let clear = |elevation_rad: f64| {
            let rod = CueShaft::new(&self.cue_ball, aim, elevation_rad);
            rod.is_over(&ground) && !self.balls.iter().any(|ball| rod.touches(ball))
        };
        if clear(wanted_rad) {
            return wanted_rad;
        }
        let steps = (1..).map(|step| wanted_rad + f64::from(step) * STEP_RAD);
        let mut above = steps.take_while(|e| *e < Stroke::ELEVATION_MAX_RAD);
        let Some(mut high) = above.find(|e| clear(*e)) else {
            return Stroke::ELEVATION_MAX_RAD;
        };
        // Bisection with the invariant that `low` is not clear and `high` is.
        let mut low = high - STEP_RAD;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if clear(middle) { &mut high } else { &mut low }) = middle;
        }
        high
    }

    /// The greatest height of the table under the cue's width, every [`STRIDE_M`] behind the cue ball's
    /// centre.
    fn ground(&self, bearing_rad: f64) -> Vec<f64> {
        let back = -DVec2::from_angle(bearing_rad);
        let across = back.perp() * WIDTH_HALF_M;
        let strides = ((CUE_LENGTH_M + DRAW_M + self.cue_ball.body.radius_m) / STRIDE_M) as u32;
        (0..=strides)
            .map(|stride| {
                let place =
                    self.cue_ball.position.truncate() + back * (f64::from(stride) * STRIDE_M);
                let heights = [place - across, place, place + across];
                heights
                    .map(|p| top_m(self.table, p))
                    .into_iter()
                    .fold(f64::MIN, f64::max)
            })
            .collect()
    }
}

/// The cue of a shot, reconstructed from the ball's velocity: through the centre of the ball, and level
/// unless obstacles raise it.
pub fn cue_of_shot(table: &Table, shot: &Shot) -> Option<CueView> {
    let balls = shot.states_at(0.0);
    let clearance = CueClearance::new(table, &balls)?;
    let velocity = clearance.cue_ball.velocity.truncate();
    let mut aim = Aim {
        bearing_rad: velocity.try_normalize()?.to_angle(),
        ..Aim::LEVEL
    };
    clearance.raise(&mut aim);
    Some(CueView::resting(clearance.cue_ball.position, &aim))
}

/// Position of the cue in space.
struct CueShaft {
    /// Centre of the tip's end when it touches the ball.
    tip: DVec3,
    back: DVec3,
    cue_ball: DVec2,
}

impl CueShaft {
    fn new(cue_ball: &BallState, aim: &Aim, elevation_rad: f64) -> Self {
        let aim = Aim {
            elevation_rad,
            ..*aim
        };
        let held = CueView {
            gap_m: 0.0,
            ..CueView::resting(cue_ball.position, &aim)
        };
        let CuePose { tip, back } = held.pose(cue_ball.body.radius_m);
        Self {
            tip,
            back,
            cue_ball: cue_ball.position.truncate(),
        }
    }

    /// Whether its underside is above the ground along its whole length and travel.
    fn is_over(&self, ground: &[f64]) -> bool {
        // `level` is the cosine of the elevation, `first_m` the tip's horizontal distance behind the cue
        // ball's centre: both convert horizontal distances of the ground to distances along the cue.
        let level = self.back.truncate().length();
        let first_m = (self.tip.truncate() - self.cue_ball).dot(self.back.truncate()) / level;
        ground.iter().enumerate().all(|(stride, height)| {
            let along_m = (stride as f64 * STRIDE_M - first_m) / level;
            if !(0.0..=CUE_LENGTH_M + DRAW_M).contains(&along_m) {
                return true;
            }
            let axis_m = self.tip.z + along_m * self.back.z;
            // Measured vertically, the underside is the radius over the cosine of the elevation below the
            // axis.
            axis_m - cue_radius_m(along_m) / level >= height + MARGIN_M
        })
    }

    fn touches(&self, ball: &BallState) -> bool {
        if ball.number == 0 || !ball.phase.is_on_table() {
            return false;
        }
        let to_ball = ball.position - self.tip;
        let along_m = to_ball.dot(self.back).clamp(0.0, CUE_LENGTH_M + DRAW_M);
        let gap_m = (to_ball - self.back * along_m).length();
        gap_m < ball.body.radius_m + cue_radius_m(along_m) + MARGIN_M
    }
}

/// Height of the table's surface at a position seen from above, in m above the cloth; `f64::MIN` outside
/// and over pockets.
fn top_m(table: &Table, place: DVec2) -> f64 {
    if table.is_rail_under(place) {
        return table.rail_height_m();
    }
    if let Some(cushion) = table.cushions().iter().find(|c| c.covers(place)) {
        let nose = &table.noses()[cushion.nose];
        let depth_m = nose.normal().dot(nose.from() - place).max(0.0);
        let rise = table.rails().map_or(0.0, |rails| {
            rails.rise_m * (depth_m / rails.cushion_width_m).min(1.0)
        });
        return table.nose_height_m() + rise;
    }
    let in_jaw = |jaw: &carom_billiards::physics::Circle| place.distance(jaw.center) < jaw.radius_m;
    if table.jaws().iter().any(in_jaw) {
        return table.nose_height_m();
    }
    let open = !table.contains(place) || table.pocket_under(place).is_some();
    if open { f64::MIN } else { 0.0 }
}

const STEP_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Bisection steps: 0.5° / 2¹³ is below 1e-4 of a degree.
const HALVINGS: u32 = 13;
const STRIDE_M: f64 = 0.004;
/// Largest radius of the cue, that of its butt.
const WIDTH_HALF_M: f64 = 0.0145;
/// Least distance of the cue from obstacles.
const MARGIN_M: f64 = 0.002;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::{BallLayout, Phase, World};

    /// The elevation with the cue ball at `place`, other balls at `others`, along a bearing.
    fn elevation_deg(place: (f64, f64), others: &[(f64, f64)], bearing_deg: f64) -> f64 {
        let table = Table::nine_foot();
        let places = [&[place], others].concat();
        let ball =
            |(n, (x, y)): (usize, (f64, f64))| BallState::at_rest(n as u8, x, y, &table.ball());
        let balls = places.into_iter().enumerate().map(ball).collect();
        let world = World::new(table.clone(), BallLayout { balls }).unwrap();
        let balls = world.balls();
        let reach = CueClearance::new(world.table(), &balls).unwrap();
        let aim = Aim {
            bearing_rad: bearing_deg.to_radians(),
            ..Aim::LEVEL
        };
        reach.lowest_clear_rad(&aim, 0.0).to_degrees()
    }

    #[test]
    fn the_cue_is_nearly_level_in_mid_table() {
        // The length of the table leaves the whole cue over the cloth.
        assert!(elevation_deg((1.0, 0.0), &[], 0.0) < 0.2);
        // Across, the butt passes over a rail a little higher than the ball's middle.
        let across = elevation_deg((0.3, 0.0), &[], 90.0);
        assert!((0.5..4.0).contains(&across), "{across}");
    }

    #[test]
    fn the_cue_clears_the_rail_of_a_frozen_ball() {
        let table = Table::nine_foot();
        let x = -0.5 * table.length_m() + table.ball().radius_m;
        let frozen = elevation_deg((x, 0.0), &[], 0.0);
        // By hand: the underside at the nose, a ball's radius behind the centre, must be as high as
        // the nose; at the back of the rail as high as the rail.
        let radius = table.ball().radius_m;
        let least = ((table.nose_height_m() - radius) / radius)
            .atan()
            .to_degrees();
        assert!(frozen > least && frozen < 40.0, "{frozen}, over {least}");
        assert!(
            elevation_deg((x, 0.0), &[], 180.0) < 0.2,
            "away from the rail it is level"
        );
        let near = elevation_deg((x + 0.1, 0.0), &[], 0.0);
        assert!(near < 0.5 * frozen, "{near} against {frozen}");
    }

    #[test]
    fn the_cue_is_steep_over_a_ball_close_behind() {
        let radius = Table::nine_foot().ball().radius_m;
        let close = elevation_deg((0.0, 0.0), &[(-2.02 * radius, 0.0)], 0.0);
        let far = elevation_deg((0.0, 0.0), &[(-0.3, 0.0)], 0.0);
        let beside = elevation_deg((0.0, 0.0), &[(-0.3, 0.06)], 0.0);
        // By hand: the ball's centre is 2.02 radii from the cue ball's, and must be a radius, the
        // tip's and the margin from the cue's axis; the cue is hardly thicker there than at its tip.
        let by_hand = (radius + cue_radius_m(0.0) + MARGIN_M) / (2.02 * radius);
        assert!((close - by_hand.asin().to_degrees()).abs() < 0.3, "{close}");
        assert!((5.0..20.0).contains(&far), "{far}");
        assert!(beside < 4.0, "{beside}");
    }

    #[test]
    fn the_least_elevation_is_the_least_clear_one() {
        let table = Table::nine_foot();
        let mut balls = table.rack_eight(5).balls;
        balls[0].position = DVec3::new(0.2, 0.55, balls[0].body.radius_m);
        let world = World::new(table, BallLayout { balls }).unwrap();
        let balls = world.balls();
        let reach = CueClearance::new(world.table(), &balls).unwrap();
        for degrees in (-180..180).step_by(3) {
            let mut aim = Aim {
                bearing_rad: f64::from(degrees).to_radians(),
                ..Aim::LEVEL
            };
            reach.raise(&mut aim);
            let rod = |elevation_rad| CueShaft::new(&balls[0], &aim, elevation_rad);
            let ground = reach.ground(aim.bearing_rad);
            let touches = |rod: &CueShaft| {
                !rod.is_over(&ground) || balls.iter().any(|ball| rod.touches(ball))
            };
            assert!(!touches(&rod(aim.elevation_rad)), "{degrees}");
            if aim.elevation_rad > 0.0 {
                assert!(touches(&rod(aim.elevation_rad - 1e-4)), "{degrees}");
            }
        }
    }

    #[test]
    fn a_pocketed_ball_is_in_nobody_s_way() {
        let table = Table::nine_foot();
        let mut balls = vec![
            BallState::at_rest(0, 0.0, 0.0, &table.ball()),
            BallState::at_rest(1, -0.1, 0.0, &table.ball()),
        ];
        balls[1].phase = Phase::Pocketed;
        let world = World::new(table, BallLayout { balls }).unwrap();
        let balls = world.balls();
        let reach = CueClearance::new(world.table(), &balls).unwrap();
        assert!(reach.lowest_clear_rad(&Aim::LEVEL, 0.0) < 0.1);
    }
}
