//! Contacts during a shot: the bodies, the law and the reported event of each.

use glam::DVec3;

use super::{
    ball::Phase,
    ball_ball::{CLUSTER_SPEED_M_S, Twist},
    ball_in_motion::{BallInMotion, ON_RAIL_RADII},
    contact_cluster::ClusterContact,
    contact_time::direction,
    event::{EventKind, Surface},
    event_engine::EventEngine,
    rebound::{kept_apart, wedged},
    slate_impact::skimmed,
    static_contact::{ContactFinder, ContactNormal, Obstacle},
};

impl EventEngine<'_> {
    /// Resolves the contact of a ball with an obstacle that does not move.
    pub(super) fn touch(&mut self, ball: usize, obstacle: Obstacle) {
        let BallInMotion { number, body, .. } = self.balls[ball];
        let before = self.balls[ball].twist(self.now);
        let sunk_m = self.table.rail_height_m() + body.radius_m - self.balls[ball].position.z;
        if obstacle == Obstacle::Top && sunk_m < LANDING_SLACK_M {
            return self.land(ball, before);
        }
        let finder = ContactFinder {
            table: self.table,
            radius_m: body.radius_m,
        };
        let center = self.balls[ball].position;
        let ContactNormal { normal, away } = finder.contact_normal(obstacle, center);
        let point = center - body.radius_m * away;
        let speed_m_s = -before.velocity.dot(away);
        let (cushion, kind) = match obstacle {
            Obstacle::Nose(_) | Obstacle::Jaw(_) => {
                let kind = EventKind::Cushion {
                    ball: number,
                    point,
                    speed_m_s,
                };
                (true, kind)
            }
            _ => {
                let kind = EventKind::Bounces {
                    ball: number,
                    surface: obstacle.surface(),
                    point,
                    speed_m_s,
                };
                (false, kind)
            }
        };
        let law = match obstacle.surface() {
            Surface::Pocket => self.laws.pocket,
            Surface::Rail | Surface::Cloth => self.laws.slate,
        };
        let mut after = if !cushion {
            law.resolve(&body, normal, before)
        } else if self.balls[ball].motion.phase == Phase::Airborne {
            self.laws.cushion.resolve(&body, normal, before)
        } else {
            let nose_height_m = self.table.nose_height_m();
            self.laws
                .cushion
                .rebound(&body, (away, nose_height_m), before)
        };
        // Round-off must not leave a velocity into the obstacle: the same contact would be found again
        // at once.
        after.velocity = if cushion {
            kept_apart(away, before.velocity, after.velocity)
        } else {
            skimmed(away, before.velocity, after.velocity)
        };
        // Between two vertical edges the contacts would accumulate, infinitely many in a finite time.
        if let Some(opposite) = self.opposite(ball, obstacle, away) {
            after.velocity = wedged([away, opposite], after.velocity);
        }
        self.balls[ball].touched = Some((self.now, obstacle, away));
        self.report(kind);
        self.set_off(ball, after);
    }

    /// Direction away from the previous contact, for a ball caught between that and the vertical edge
    /// of a facing: it would move to and fro over ever shorter distances.
    fn opposite(&self, ball: usize, obstacle: Obstacle, away: DVec3) -> Option<DVec3> {
        let is_corner = |obstacle| matches!(obstacle, Obstacle::Corner(_));
        let (time, other, out) = self.balls[ball].touched?;
        let is_opposite = other != obstacle
            && (is_corner(other) || is_corner(obstacle))
            && self.now - time < CAUGHT_SECS
            && out.dot(away) < 0.0;
        is_opposite.then_some(out)
    }

    /// Resolves the fall of a ball onto a level surface: the cloth, or a rail.
    pub(super) fn land(&mut self, ball: usize, before: Twist) {
        let BallInMotion { number, body, .. } = self.balls[ball];
        let height = self.balls[ball].position.z;
        let on_rail = height > ON_RAIL_RADII * body.radius_m;
        let (surface, level) = if on_rail {
            (Surface::Rail, self.table.rail_height_m() + body.radius_m)
        } else {
            (Surface::Cloth, body.radius_m)
        };
        self.balls[ball].position.z = level;
        let center = self.balls[ball].position;
        let speed_m_s = -before.velocity.z;
        if speed_m_s >= self.quiet_m_s {
            self.report(EventKind::Bounces {
                ball: number,
                surface,
                point: center.with_z(level - body.radius_m),
                speed_m_s,
            });
        }
        let after = self.laws.slate.resolve(&body, DVec3::Z, before);
        if after.velocity.z < self.hop_speed_m_s() {
            self.lie(ball, after);
        } else {
            self.fly(ball, after);
        }
    }

    pub(super) fn collide(&mut self, first: usize, second: usize) {
        let (_, [one, other]) = self.meet(first, second);
        self.set_off(first, one);
        self.set_off(second, other);
    }

    /// Reports the contact of two balls; returns the normal from the first to the second, and both
    /// twists after it.
    pub(super) fn meet(&mut self, first: usize, second: usize) -> (DVec3, [Twist; 2]) {
        let bodies = [first, second].map(|ball| self.balls[ball].body);
        let normal = direction(self.balls[first].position, self.balls[second].position);
        let before = [first, second].map(|ball| self.balls[ball].twist(self.now));
        self.report(EventKind::BallBall {
            first: self.balls[first].number,
            second: self.balls[second].number,
            point: self.balls[first].position + bodies[0].radius_m * normal,
            speed_m_s: (before[0].velocity - before[1].velocity).dot(normal),
        });
        let law = &self.laws.ball_ball;
        let (one, other) = law.resolve(normal, (&bodies[0], before[0]), (&bodies[1], before[1]));
        (normal, [one, other])
    }

    /// Whether a pair approaches faster than [`CLUSTER_SPEED_M_S`].
    pub(super) fn meets_fast(&self, (first, second): (usize, usize)) -> bool {
        let normal = direction(self.balls[first].position, self.balls[second].position);
        let [one, other] = [first, second].map(|ball| self.balls[ball].twist(self.now).velocity);
        (one - other).dot(normal) > CLUSTER_SPEED_M_S
    }

    /// Resolves simultaneous contacts that share balls.
    pub(super) fn collide_together(&mut self, pairs: &[(usize, usize)]) {
        let mut balls: Vec<_> = pairs.iter().flat_map(|&(a, b)| [a, b]).collect();
        balls.sort_unstable();
        balls.dedup();
        let place = |ball: usize| balls.partition_point(|&b| b < ball);
        let mut twists: Vec<_> = balls
            .iter()
            .map(|&ball| self.balls[ball].twist(self.now))
            .collect();
        let bodies: Vec<_> = balls.iter().map(|&ball| self.balls[ball].body).collect();
        let mut touches = Vec::with_capacity(pairs.len());
        for &(first, second) in pairs {
            let touch = ClusterContact {
                first: place(first),
                second: place(second),
                normal: direction(self.balls[first].position, self.balls[second].position),
            };
            let closing = twists[touch.first].velocity - twists[touch.second].velocity;
            self.report(EventKind::BallBall {
                first: self.balls[first].number,
                second: self.balls[second].number,
                point: self.balls[first].position + bodies[touch.first].radius_m * touch.normal,
                speed_m_s: closing.dot(touch.normal),
            });
            touches.push(touch);
        }
        self.laws
            .ball_ball
            .resolve_together(&bodies, &touches, &mut twists);
        for (&ball, &twist) in balls.iter().zip(&twists) {
            self.set_off(ball, twist);
        }
    }
}

/// Time in s between opposite contacts below which a ball is wedged between them.
const CAUGHT_SECS: f64 = 1e-4;
/// Depth below the rail's level up to which a contact with its top is a landing. A ball that comes from
/// the side and is lower is thrown up as by a cushion's slope: lifting it to the level would add
/// energy.
const LANDING_SLACK_M: f64 = 1e-6;
