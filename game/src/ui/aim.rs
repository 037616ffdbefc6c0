//! Aim line and ghost ball, projected into the picture by the current camera.

use carom_billiards::physics::{AimContact, AimLine};
use carom_billiards::rules::{PlacementArea, TableLayout};
use egui::{Color32, Painter, Pos2, Rect, Stroke};
use glam::{DVec2, DVec3};

use crate::camera::Projection;
use crate::play::{AimAids, BallPath, ShotPreview};

/// Draws into `screen`, the window in points, which the projection's film covers.
#[derive(Clone, Copy)]
pub struct AimOverlay<'a> {
    /// Where to draw.
    pub painter: &'a Painter,
    /// The window.
    pub screen: Rect,
    /// The camera; its film is the window in points.
    pub projection: &'a Projection,
    /// Radius of a ball, metres.
    pub ball_radius_m: f64,
}

impl AimOverlay<'_> {
    /// Where the balls will go, as far as the aids show it.
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

    /// A ball's way to where it rests, ringed, or to its pocket, crossed.
    fn whole_way(&self, way: &BallPath) {
        let (color, width) = match way.number {
            0 => (GUIDE, 1.8),
            _ => (OBJECT, 1.4),
        };
        self.path(&way.path, Stroke::new(width, color));
        let Some(end) = way.path.last() else {
            return;
        };
        let scale = self.projection.film_per_metre(*end);
        let (Some(film), Some(scale)) = (self.projection.film_from_world(*end), scale) else {
            return;
        };
        let (at, radius) = (self.point(film), (self.ball_radius_m * scale) as f32);
        let stroke = Stroke::new(width, color);
        if way.stays {
            self.painter.circle_stroke(at, radius, stroke);
        } else {
            let arm = 0.6 * radius;
            for [x, y] in [[arm, arm], [arm, -arm]] {
                let arm = egui::vec2(x, y);
                self.painter.line_segment([at - arm, at + arm], stroke);
            }
        }
    }

    /// What the cue ball meets, and where both go from there.
    fn contact(&self, line: &AimLine, aids: AimAids) {
        let ways = aids == AimAids::Ghost;
        match line.contact {
            AimContact::Ball {
                ghost,
                object,
                object_direction,
                cue_direction,
                ..
            } => {
                self.ball(ghost);
                if ways {
                    let stroke = Stroke::new(2.0, OBJECT);
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
            AimContact::Pocket { .. } | AimContact::Nothing => {
                line.path.last().into_iter().for_each(|end| self.ball(*end));
            }
        }
    }

    /// A cue ball that is carried: a ring with a tick where it may lie, with a cross where not.
    pub fn carried(&self, at: DVec2, is_legal: bool) {
        let Some((center, radius)) = self.disc(at, self.ball_radius_m) else {
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

    /// A ball that may be hit first: a ring on the cloth around it, hidden where the ball stands before it.
    pub fn ringed(&self, at: DVec2, radius_m: f64) {
        let Some((center, radius)) = self.disc(at, radius_m) else {
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

    /// The line that bounds where the cue ball may be put.
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

    /// A ball on the cloth as it is seen.
    fn disc(&self, at: DVec2, radius_m: f64) -> Option<(Pos2, f32)> {
        let center = at.extend(radius_m);
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
        // From the ball's rim, so that the line does not cross the ball.
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
        let seen = self.projection.film_from_world(center);
        if let (Some(film), Some(scale)) = (seen, self.projection.film_per_metre(center)) {
            let radius = (self.ball_radius_m * scale) as f32;
            let center = self.point(film);
            self.painter
                .circle(center, radius, GHOST, Stroke::new(1.4, GUIDE));
        }
    }

    fn point(&self, film: DVec2) -> Pos2 {
        // Far outside the window, floats of a few digits would make the tessellator stumble.
        let film = film.clamp(DVec2::splat(-FILM_MAX), DVec2::splat(FILM_MAX));
        self.screen.min + egui::vec2(film.x as f32, film.y as f32)
    }
}

const ARC: u32 = 24;
const LEGAL: Color32 = Color32::from_rgb(120, 230, 160);
const LEGAL_TINT: Color32 = Color32::from_rgba_premultiplied(20, 60, 35, 90);
const ILLEGAL: Color32 = Color32::from_rgb(255, 120, 90);
const ILLEGAL_TINT: Color32 = Color32::from_rgba_premultiplied(80, 20, 10, 110);
const RING: Color32 = Color32::from_rgba_premultiplied(150, 150, 140, 150);
/// Radius of the ring around a ball, in the ball's.
const RING_RADII: f64 = 1.35;
const OBJECT_WAY_M: f64 = 0.35;
const CUE_WAY_M: f64 = 0.2;
const FILM_MAX: f64 = 20_000.0;
const GUIDE: Color32 = Color32::from_rgba_premultiplied(200, 200, 195, 200);
const OBJECT: Color32 = Color32::from_rgba_premultiplied(220, 185, 80, 220);
const GHOST: Color32 = Color32::from_rgba_premultiplied(40, 40, 40, 40);
