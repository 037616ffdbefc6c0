//! Furniture at the far end of the room, beyond the foot of the table, which the player sees.

use carom_tracer::{Axis, CsgSolid, Shape, Subtraction};
use glam::{DVec3, Quat, Vec2, Vec3};

use super::room::{PANEL_HEIGHT_M, ROOM_MARGIN_M, WINDOW_M};
use super::{SceneBuilder, subtraction};
use crate::scene::cue_stick::{CUE_LENGTH_M, CUE_NAME, CuePose};
use crate::scene::scoreboard::HAND_NAME;

impl SceneBuilder {
    /// Adds a bench, a rack of cues, a bar table with stools, a scoreboard, and the bars of a window, whose
    /// light is [`super::room::window`].
    pub(super) fn far_end(&mut self) {
        let wall_x = self.frame.outer.x + ROOM_MARGIN_M - PANELLING_M;
        self.wainscot(wall_x);
        self.bench(wall_x);
        self.cue_rack(wall_x);
        self.bar_table(wall_x);
        self.scoreboard();
        self.casing(wall_x);
        let (center, half) = WINDOW_M;
        for (y, z) in [(half.x, 0.02), (0.02, half.y)] {
            let bar = Vec3::new(0.03, y, z);
            let middle = Vec3::new(wall_x + 0.02, center.x, center.y);
            self.solid("window bar", "dark wood", middle - bar, middle + bar);
        }
    }

    /// Adds a skirting board below the panelling, a chair rail on top, and a window sill.
    fn wainscot(&mut self, wall_x: f32) {
        let (floor, half_y) = (self.frame.floor, self.frame.outer.y + ROOM_MARGIN_M);
        let top = floor + PANEL_HEIGHT_M;
        let (window, half) = WINDOW_M;
        let sill = half.x + 0.12;
        let foot = window.y - half.y;
        for (depth, [first_y, last_y], [bottom, top]) in [
            (0.03, [-half_y, half_y], [floor, floor + 0.14]),
            (0.04, [-half_y, half_y], [top - 0.05, top + 0.03]),
            (
                0.12,
                [window.x - sill, window.x + sill],
                [foot - 0.04, foot],
            ),
        ] {
            let min = Vec3::new(wall_x - depth, first_y, bottom);
            let max = Vec3::new(wall_x + PANELLING_M, last_y, top);
            self.solid("wainscot", "dark wood", min, max);
        }
    }

    /// Adds boards around the window, which stands on its sill.
    fn casing(&mut self, wall_x: f32) {
        let (center, half) = WINDOW_M;
        let (low, high) = (center - half, center + half);
        for (min, max) in [
            (Vec2::new(low.x - CASING_M, low.y), Vec2::new(low.x, high.y)),
            (
                Vec2::new(high.x, low.y),
                Vec2::new(high.x + CASING_M, high.y),
            ),
            (
                Vec2::new(low.x - CASING_M, high.y),
                Vec2::new(high.x + CASING_M, high.y + CASING_M),
            ),
        ] {
            let min = Vec3::new(wall_x - 0.02, min.x, min.y);
            let max = Vec3::new(wall_x + PANELLING_M, max.x, max.y);
            self.solid("casing", "dark wood", min, max);
        }
    }

    /// Adds three seats with backs on a plinth.
    fn bench(&mut self, wall_x: f32) {
        let [first_y, last_y] = BENCH_Y_M;
        let [plinth, seat, back] = [0.24, 0.46, 0.94].map(|height| self.frame.floor + height);
        self.solid(
            "bench plinth",
            "dark wood",
            Vec3::new(wall_x - 0.56, first_y, self.frame.floor),
            Vec3::new(wall_x, last_y, plinth),
        );
        for (depth, bottom, top) in [(0.62, plinth, seat), (0.16, seat, back)] {
            let min = Vec3::new(wall_x - depth, first_y, bottom);
            let max = Vec3::new(wall_x, last_y, top);
            self.add("bench cushions", "bench leather", upholstered(min, max));
        }
    }

    /// Adds four cues on the wall.
    fn cue_rack(&mut self, wall_x: f32) {
        let floor = self.frame.floor;
        let half = Vec2::new(0.27, 0.62);
        let middle = Vec3::new(wall_x, RACK_Y_M, floor + 1.1);
        let board = Vec3::new(0.02, half.x, half.y);
        self.solid("cue rack", "rail wood", middle - board, middle + board);
        for place in [-1.5, -0.5, 0.5, 1.5] {
            let tip = middle + Vec3::new(-0.045, 0.14 * place, 0.5 * CUE_LENGTH_M as f32);
            let pose = CuePose {
                tip: tip.as_dvec3(),
                back: DVec3::NEG_Z,
            };
            self.add("cue in the rack", CUE_NAME, pose.shape());
        }
    }

    /// Adds the scoreboard, on the wall over the bench.
    fn scoreboard(&mut self) {
        let scoreboard = self.frame.scoreboard();
        self.add("scoreboard", "scoreboard", scoreboard.shape());
        for hand in scoreboard.hand_shapes() {
            self.add(HAND_NAME, "enamel", hand);
        }
    }

    /// Adds a round table on a post, and two stools.
    fn bar_table(&mut self, wall_x: f32) {
        let (x, floor) = (wall_x - 0.85, self.frame.floor);
        let foot = Vec3::new(x, BAR_TABLE_Y_M, floor);
        self.disc_slab(
            "bar table",
            "rail wood",
            foot.with_z(floor + 1.04),
            0.34,
            0.03,
        );
        let post = Vec3::new(0.035, 0.035, 0.0);
        self.solid("post", "enamel", foot - post, foot + post.with_z(1.01));
        for aside in [-0.62, 0.6] {
            let foot = foot + Vec3::new(-0.08, aside, 0.0);
            let seat = foot.with_z(floor + 0.76);
            self.disc_slab("stool", "bench leather", seat, 0.18, 0.06);
            let leg = Shape::TruncatedCone {
                center: seat - Vec3::Z * 0.06,
                rotation: Quat::from_rotation_arc(Vec3::Z, Vec3::NEG_Z),
                length: 0.7,
                radii: [0.025, 0.17],
            };
            self.add("stool leg", "enamel", leg);
        }
    }

    /// Adds a round slab below a point.
    fn disc_slab(&mut self, name: &str, material: &str, top: Vec3, radius: f32, thickness: f32) {
        let half = Vec3::new(radius, radius, 0.0);
        let rim = CsgSolid::ConeExterior {
            axis: Axis::Z,
            center: top,
            radius,
            taper: 0.0,
            beyond: Vec3::ZERO,
        };
        let shape = Shape::CsgBox {
            min: top - half.with_z(thickness),
            max: top + half,
            subtractions: vec![subtraction(rim)],
        };
        self.add(name, material, shape);
    }

    fn solid(&mut self, name: &str, material: &str, min: Vec3, max: Vec3) {
        self.add(name, material, Shape::Box { min, max });
    }
}

/// Three cushions side by side against a wall at +x, with rounded edges where they are visible. As three
/// boxes rather than one, they would cost every ray four intersection tests more.
fn upholstered(min: Vec3, max: Vec3) -> Shape {
    let edge = |axis, aside: Vec3| {
        let corner = Vec3::select(aside.cmplt(Vec3::ZERO), min, max);
        rounding(axis, corner - CUSHION_RADIUS_M * aside, aside)
    };
    let mut subtractions = vec![
        edge(Axis::Y, Vec3::new(-1.0, 0.0, 1.0)),
        edge(Axis::X, Vec3::new(0.0, -1.0, 1.0)),
        edge(Axis::X, Vec3::new(0.0, 1.0, 1.0)),
        edge(Axis::Z, Vec3::new(-1.0, -1.0, 0.0)),
        edge(Axis::Z, Vec3::new(-1.0, 1.0, 0.0)),
    ];
    subtractions.extend([1.0, 2.0].map(|cushions| {
        let y = min.y + cushions / 3.0 * (max.y - min.y);
        subtraction(CsgSolid::Box {
            min: Vec3::new(min.x - 1.0, y - SEAM_M, min.z + 0.02),
            max: Vec3::new(max.x - 0.03, y + SEAM_M, max.z + 1.0),
        })
    }));
    Shape::CsgBox {
        min,
        max,
        subtractions,
    }
}

/// Subtraction of the outside of a rounded edge along an axis through `center`; `aside` points to the edge.
fn rounding(axis: Axis, center: Vec3, aside: Vec3) -> Subtraction {
    subtraction(CsgSolid::ConeExterior {
        axis,
        center,
        radius: CUSHION_RADIUS_M,
        taper: 0.0,
        // The plane through the two lines where the rounding meets the faces.
        beyond: 0.5 * CUSHION_RADIUS_M * aside,
    })
}

/// Depth of the panelling in front of the wall.
const PANELLING_M: f32 = 0.05;
const BENCH_Y_M: [f32; 2] = [-0.8, 1.9];
/// Width of the boards around a window.
const CASING_M: f32 = 0.09;
const CUSHION_RADIUS_M: f32 = 0.045;
/// Half the gap between two cushions of the bench.
const SEAM_M: f32 = 0.01;
const RACK_Y_M: f32 = 2.4;
const BAR_TABLE_Y_M: f32 = -1.9;
