//! Aim line, ghost ball and marks on balls, projected into the picture by the current camera.

use carom_billiards::physics::{AimContact, AimLine};
use carom_billiards::rules::{PlacementArea, RuleSet, TableLayout};
use egui::{Color32, Painter, Pos2, Rect, Rgba, Stroke};
use glam::{DVec2, DVec3, Vec3};

use crate::camera::Projection;
use crate::play::{AimAids, BallPath, PathEnd, ShotPreview};
use crate::scene::ball_materials::ball_colour;

/// Context for drawing into `screen`, which the projection's film covers.
#[derive(Clone, Copy)]
pub struct AimOverlay<'a> {
    /// Target of the drawing.
    pub painter: &'a Painter,
    /// The window, in points.
    pub screen: Rect,
    /// Projection of the camera; its film is the window in points.
    pub projection: &'a Projection,
    /// Radius of a ball, metres.
    pub ball_radius_m: f64,
    /// The game, which determines the balls' colours.
    pub rules: RuleSet,
    /// Centres and radii of balls that hide the paths behind them, metres.
    pub balls: &'a [(DVec3, f64)],
}

/// A visible segment of a ball's path.
#[derive(Clone, Copy, Debug, PartialEq)]
struct WayPiece {
    ends: [DVec3; 2],
    /// Position along the path, 0 to 1.
    share: f64,
}

impl AimOverlay<'_> {
    /// Draws the preview of a shot, as far as the aids show it.
    pub fn shot_preview(&self, shot_preview: &ShotPreview) {
        for way in &shot_preview.ways {
            self.whole_way(way);
        }
        if shot_preview.aids != AimAids::Full {
            self.path(&shot_preview.line.path, Stroke::new(1.6, GUIDE));
        }
        if shot_preview.aids != AimAids::Line {
            self.contact(&shot_preview.line, shot_preview.aids);
        }
    }

    /// Draws a ball's path in the ball's colour, fading, with its end: a ring where it rests, a dashed ring
    /// at the edge of particles, a cross at its pocket.
    fn whole_way(&self, way: &BallPath) {
        let width = if way.number == 0 { 1.8 } else { 1.6 };
        for piece in self.seen_pieces(way) {
            let color = way_color(self.rules, way.number, piece.share);
            let [from, to] = piece.ends;
            self.segment(from, to, Stroke::new(width, color));
        }
        let color = way_color(self.rules, way.number, 0.5);
        let Some(end) = way.path.last() else {
            return;
        };
        let Some((at, radius)) = self.disc(*end, self.ball_radius_m) else {
            return;
        };
        let stroke = Stroke::new(width, color);
        match way.end {
            PathEnd::Rests => {
                self.painter.circle_stroke(at, radius, stroke);
            }
            PathEnd::Particles => {
                for dash in 0..DASHES {
                    let corner = |share: f32| {
                        let turn = (dash as f32 + share) / DASHES as f32;
                        at + radius * egui::Vec2::angled(turn * std::f32::consts::TAU)
                    };
                    self.painter
                        .line_segment([corner(0.0), corner(0.5)], stroke);
                }
            }
            PathEnd::LeavesTable => {
                let arm = 0.6 * radius;
                for [x, y] in [[arm, arm], [arm, -arm]] {
                    let arm = egui::vec2(x, y);
                    self.painter.line_segment([at - arm, at + arm], stroke);
                }
            }
        }
    }

    /// The segments of a path that no ball hides.
    fn seen_pieces(&self, way: &BallPath) -> Vec<WayPiece> {
        let lengths = way.path.windows(2).map(|pair| pair[0].distance(pair[1]));
        let whole_m: f64 = lengths.sum();
        let mut gone_m = 0.0;
        let mut pieces = Vec::with_capacity(way.path.len());
        for pair in way.path.windows(2) {
            let middle = 0.5 * (pair[0] + pair[1]);
            let share = gone_m / whole_m.max(f64::MIN_POSITIVE);
            gone_m += pair[0].distance(pair[1]);
            let hides = |(center, radius_m): &(DVec3, f64)| {
                self.projection.is_hidden(middle, *center, *radius_m)
            };
            if !self.balls.iter().any(hides) {
                let ends = [pair[0], pair[1]];
                pieces.push(WayPiece { ends, share });
            }
        }
        pieces
    }

    /// Draws the first contact of the cue ball, and the directions of both balls after it.
    fn contact(&self, line: &AimLine, aids: AimAids) {
        let ways = aids == AimAids::Ghost;
        match line.contact {
            AimContact::Ball {
                number,
                ghost,
                object,
                object_direction,
                cue_direction,
                ..
            } => {
                self.ball(ghost);
                if ways {
                    let stroke = Stroke::new(2.0, way_color(self.rules, number, 0.0));
                    self.way(object, object_direction, OBJECT_WAY_M, stroke);
                    self.way(ghost, cue_direction, CUE_WAY_M, Stroke::new(1.6, GUIDE));
                }
            }
            AimContact::Cushion {
                ghost,
                cue_direction,
            } => {
                self.ball(ghost);
                if ways {
                    self.way(ghost, cue_direction, CUE_WAY_M, Stroke::new(1.6, GUIDE));
                }
            }
            AimContact::Pocket { .. } | AimContact::Nothing | AimContact::Particles => {
                line.path.last().into_iter().for_each(|end| self.ball(*end));
            }
        }
    }

    /// Draws a carried cue ball: a ring with a tick if it may be placed here, otherwise with a cross.
    pub fn carried(&self, at: DVec2, is_legal: bool) {
        let Some((center, radius)) = self.disc(at.extend(self.ball_radius_m), self.ball_radius_m)
        else {
            return;
        };
        let (tint, color) = if is_legal {
            (LEGAL_TINT, LEGAL)
        } else {
            (ILLEGAL_TINT, ILLEGAL)
        };
        self.painter
            .circle(center, radius * 1.15, tint, Stroke::new(2.5, color));
        let point = |x: f32, y: f32| center + radius * egui::vec2(x, y);
        let lines = if is_legal {
            [
                [point(-0.5, 0.0), point(-0.1, 0.4)],
                [point(-0.1, 0.4), point(0.55, -0.45)],
            ]
        } else {
            [
                [point(-0.5, -0.5), point(0.5, 0.5)],
                [point(-0.5, 0.5), point(0.5, -0.5)],
            ]
        };
        for line in lines {
            self.painter.line_segment(line, Stroke::new(3.0, color));
        }
    }

    /// Marks a ball that may be hit first with a ring on the cloth around it, hidden where the ball is in
    /// front of it.
    pub fn ringed(&self, at: DVec2, radius_m: f64) {
        let Some((center, radius)) = self.disc(at.extend(radius_m), radius_m) else {
            return;
        };
        let stroke = Stroke::new(1.6, RING);
        let on_ring = |i: u32| {
            let angle = std::f64::consts::TAU * f64::from(i) / f64::from(2 * ARC);
            (at + RING_RADII * radius_m * DVec2::from_angle(angle)).extend(0.0)
        };
        for i in 0..2 * ARC {
            let Some(ends) = self.projection.film_segment(on_ring(i), on_ring(i + 1)) else {
                continue;
            };
            let ends = ends.map(|end| self.point(end));
            if ends[0].distance(center) > radius {
                self.painter.line_segment(ends, stroke);
            }
        }
    }

    /// Draws the boundary of the area in which the cue ball may be placed.
    pub fn area(&self, ground: &TableLayout, area: Option<PlacementArea>) {
        let stroke = Stroke::new(1.5, GUIDE);
        let line = |from: DVec2, to: DVec2| self.segment(from.extend(0.0), to.extend(0.0), stroke);
        let half = 0.5 * ground.width_m;
        match area {
            Some(PlacementArea::Kitchen) => {
                let x = ground.head_spot().x;
                line(DVec2::new(x, -half), DVec2::new(x, half));
            }
            Some(PlacementArea::D) => {
                let (middle, radius) = (ground.baulk_spot(), ground.d_radius_m());
                let at = |i: u32| {
                    let angle = std::f64::consts::PI * (0.5 + f64::from(i) / f64::from(ARC));
                    middle + radius * DVec2::from_angle(angle)
                };
                (0..ARC).for_each(|i| line(at(i), at(i + 1)));
                line(at(ARC), at(0));
            }
            Some(PlacementArea::Anywhere) | None => {}
        }
    }

    /// Centre and radius of a ball in the window, in points; none if it is behind the eye.
    pub(super) fn disc(&self, center: DVec3, radius_m: f64) -> Option<(Pos2, f32)> {
        let film = self.projection.film_from_world(center)?;
        let scale = self.projection.film_per_metre(center)?;
        Some((self.point(film), (radius_m * scale) as f32))
    }

    fn path(&self, path: &[DVec3], stroke: Stroke) {
        for pair in path.windows(2) {
            self.segment(pair[0], pair[1], stroke);
        }
    }

    fn way(&self, from: DVec3, direction: DVec3, length_m: f64, stroke: Stroke) {
        // Starts at the ball's surface, so that the line does not cross the ball.
        let start = from + direction * self.ball_radius_m;
        self.segment(
            start,
            from + direction * (self.ball_radius_m + length_m),
            stroke,
        );
    }

    fn segment(&self, a: DVec3, b: DVec3, stroke: Stroke) {
        if let Some(ends) = self.projection.film_segment(a, b) {
            self.painter
                .line_segment(ends.map(|end| self.point(end)), stroke);
        }
    }

    fn ball(&self, center: DVec3) {
        if let Some((center, radius)) = self.disc(center, self.ball_radius_m) {
            self.painter
                .circle(center, radius, GHOST, Stroke::new(1.4, GUIDE));
        }
    }

    fn point(&self, film: DVec2) -> Pos2 {
        // Clamped, as the tessellator fails on coordinates far outside the window in f32.
        let film = film.clamp(DVec2::splat(-FILM_MAX), DVec2::splat(FILM_MAX));
        self.screen.min + egui::vec2(film.x as f32, film.y as f32)
    }
}

/// Colour of a ball's path at a share of it: the ball's own, lightened against the cloth, and fading.
fn way_color(rules: RuleSet, number: u8, share: f64) -> Color32 {
    let [r, g, b] = ball_colour(rules, number)
        .lerp(Vec3::ONE, WHITENED)
        .to_array();
    let alpha = 1.0 - FADED * share as f32;
    Rgba::from_rgb(r, g, b).multiply(alpha).into()
}

/// Share of white in the colour of a path: the 8's black and the 2's blue would not be visible otherwise.
const WHITENED: f32 = 0.2;
/// Share of a path's colour that has faded at its end.
const FADED: f32 = 0.75;
const ARC: u32 = 24;
const LEGAL: Color32 = Color32::from_rgb(120, 230, 160);
const LEGAL_TINT: Color32 = Color32::from_rgba_premultiplied(20, 60, 35, 90);
const ILLEGAL: Color32 = Color32::from_rgb(255, 120, 90);
const ILLEGAL_TINT: Color32 = Color32::from_rgba_premultiplied(80, 20, 10, 110);
const RING: Color32 = Color32::from_rgba_premultiplied(150, 150, 140, 150);
/// Radius of the ring around a ball, in the ball's radii.
const RING_RADII: f64 = 1.35;
/// Number of dashes of the ring around a ball at the edge of particles.
const DASHES: u32 = 12;
const OBJECT_WAY_M: f64 = 0.35;
const CUE_WAY_M: f64 = 0.2;
const FILM_MAX: f64 = 20_000.0;
const GUIDE: Color32 = Color32::from_rgba_premultiplied(200, 200, 195, 200);
const GHOST: Color32 = Color32::from_rgba_premultiplied(40, 40, 40, 40);

#[cfg(test)]
mod tests {
    use carom_tracer::{Camera, Lens};
    use egui::{Context, LayerId};

    use super::*;

    /// The visible parts of a path along x at y = 0, seen from the side, with a ball of 0.1 m at `center`.
    fn pieces(center: DVec3) -> Vec<WayPiece> {
        let camera = Camera {
            eye: Vec3::new(0.0, -3.0, 0.0),
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 60.0,
            lens: Lens::default(),
            near_m: 0.0,
        };
        let painter = Painter::new(Context::default(), LayerId::background(), Rect::EVERYTHING);
        let overlay = AimOverlay {
            painter: &painter,
            screen: Rect::EVERYTHING,
            projection: &Projection::new(&camera, 640.0, 360.0),
            ball_radius_m: 0.1,
            rules: RuleSet::Eight,
            balls: &[(center, 0.1)],
        };
        overlay.seen_pieces(&BallPath {
            number: 3,
            path: (0..=100)
                .map(|i| DVec3::X * (0.01 * f64::from(i)))
                .collect(),
            end: PathEnd::Rests,
        })
    }

    #[test]
    fn ways_are_hidden_behind_balls() {
        let seen = pieces(DVec3::new(0.5, -0.001, 0.0));
        let xs = seen.iter().map(|piece| piece.ends[0].x);
        let hidden = 100 - xs.clone().count();
        assert!((19..=21).contains(&hidden), "{hidden}");
        assert!(xs.clone().all(|x| (x - 0.495).abs() > 0.09));
        assert_eq!(
            pieces(DVec3::new(0.5, 1.0, 0.0)).len(),
            100,
            "a ball behind the way"
        );
    }

    #[test]
    fn ways_have_the_colours_of_their_balls_and_fade() {
        let seen = pieces(DVec3::Z);
        assert!(seen.is_sorted_by(|a, b| a.share < b.share) && seen[99].share > 0.98);
        let alpha = |share| way_color(RuleSet::Eight, 3, share).a();
        assert!(alpha(0.0) == 255 && alpha(1.0) < 80 && alpha(0.5) < alpha(0.2));
        let solids: Vec<_> = (0..=8).map(|n| way_color(RuleSet::Eight, n, 0.0)).collect();
        for (i, color) in solids.iter().enumerate() {
            assert!(!solids[..i].contains(color), "{i}");
        }
    }
}
