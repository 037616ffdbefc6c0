//! The room round the table: stand, lampshades, walls, cue rack.

use carom_billiards::physics::Table;
use carom_tracer::{AreaLight, CsgSolid, Shape};
use glam::{Vec2, Vec3};

use super::{
    APRON_M, BAR_M, LAMP_GAP_M, LAMP_HALF_M, LAMP_X_M, LAMP_Z_M, POCKET_DEPTH_M, SHADE_HEIGHT_M,
    SHADE_RIM_M, SceneBuilder, beyond, corners, subtraction,
};

impl SceneBuilder {
    /// The pockets' floor, and legs.
    pub(super) fn stand(&mut self, table: &Table) {
        let (inside, outer, floor) = (self.frame.inside, self.frame.outer, self.frame.floor);
        let reach = table.pockets().first().map_or(0.0, |p| p.radius_m as f32);
        let half = (inside + reach).min(outer - 0.02);
        let tray = Shape::Box {
            min: (-half).extend(-APRON_M),
            max: half.extend(-POCKET_DEPTH_M),
        };
        self.add("pocket floor", "leather", tray);
        for corner in corners() {
            let center = corner * (outer - LEG_INSET_M);
            let leg = Shape::CsgBox {
                min: (center - LEG_HALF_M).extend(floor),
                max: (center + LEG_HALF_M).extend(-APRON_M),
                subtractions: [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y]
                    .map(|side| {
                        let top = center.extend(-APRON_M) + side * LEG_HALF_M;
                        beyond(top, side - Vec3::Z * LEG_TAPER)
                    })
                    .into(),
            };
            self.add("leg", "dark wood", leg);
        }
    }

    /// Enamelled shades over the lamps, hung from a brass bar.
    pub(super) fn lampshades(&mut self) {
        let scale = self.frame.scale;
        let lamp_half = LAMP_HALF_M * Vec2::new(scale, 1.0);
        let half = lamp_half + SHADE_RIM_M;
        let (low, high) = (LAMP_Z_M + LAMP_GAP_M, LAMP_Z_M + SHADE_HEIGHT_M);
        for x in LAMP_X_M {
            let center = Vec2::new(scale * x, 0.0);
            let slope = |side: Vec3| {
                let foot = center.extend(LAMP_Z_M + 0.01) + side * half.dot(side.truncate().abs());
                beyond(foot, side + Vec3::Z * SHADE_SLOPE)
            };
            let shade = Shape::CsgBox {
                min: (center - half).extend(low),
                max: (center + half).extend(high),
                subtractions: [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y]
                    .map(slope)
                    .into(),
            };
            self.add("lampshade", "enamel", shade);
        }
        let bar = Shape::Box {
            min: Vec3::new(-0.9 * scale, -0.01, high),
            max: Vec3::new(0.9 * scale, 0.01, high + BAR_M),
        };
        self.add("lamp bar", "brass", bar);
        for x in [-0.6 * scale, 0.6 * scale] {
            let rod = Shape::Box {
                min: Vec3::new(x - 0.004, -0.004, high + BAR_M),
                max: Vec3::new(x + 0.004, 0.004, ROOM_HEIGHT_M),
            };
            self.add("lamp rod", "brass", rod);
        }
    }

    /// Floor, carpet, panelled walls with pictures, and no ceiling: the environment comes in there.
    pub(super) fn walls(&mut self) {
        let (outer, floor) = (self.frame.outer, self.frame.floor);
        let half = outer + ROOM_MARGIN_M;
        let ground = Shape::Box {
            min: (-half).extend(floor - 0.1),
            max: half.extend(floor),
        };
        self.add("floor", "floor", ground);
        let carpet = Shape::Rectangle {
            center: Vec3::Z * (floor + 0.006),
            half_u: Vec3::X * (outer.x + 0.9),
            half_v: Vec3::Y * (outer.y + 0.8),
        };
        self.add("carpet", "carpet", carpet);
        self.ring("wall", "wall", half, 0.1, ROOM_HEIGHT_M);
        self.ring(
            "panelling",
            "panelling",
            half - 0.03,
            0.04,
            floor + PANEL_HEIGHT_M,
        );
        self.ring(
            "panel rail",
            "dark wood",
            half - 0.05,
            0.06,
            floor + PANEL_HEIGHT_M + 0.04,
        );
        for (index, x) in [-1.8f32, 1.8].into_iter().enumerate() {
            for side in [-1.0, 1.0] {
                let y = side * (half.y - 0.02);
                let center = Vec3::new(x, y, 0.62);
                self.picture(center, Vec3::X, ["picture red", "picture blue"][index]);
            }
        }
        for side in [-1.0, 1.0] {
            let center = Vec3::new(side * (half.x - 0.02), 0.0, 0.62);
            self.picture(center, Vec3::Y, "picture gold");
        }
    }

    /// A cue on the wall beyond the foot of the table, where the player looks.
    pub(super) fn cue_rack(&mut self) {
        let (half, floor) = (self.frame.outer + ROOM_MARGIN_M, self.frame.floor);
        let foot = Vec3::new(half.x - 0.12, 1.45, floor + RACK_M);
        let mut plank = |name: &str, material: &str, low: Vec3, high: Vec3| {
            let (min, max) = (foot + low, foot + high);
            self.add(name, material, Shape::Box { min, max });
        };
        plank(
            "cue board",
            "wall",
            Vec3::new(0.06, -0.09, -0.12),
            Vec3::new(0.11, 0.09, CUE_M + 0.1),
        );
        plank(
            "cue tray",
            "brass",
            Vec3::new(-0.04, -0.07, -0.02),
            Vec3::new(0.06, 0.07, 0.0),
        );
        plank(
            "cue clip",
            "brass",
            Vec3::new(0.01, -0.012, 1.18),
            Vec3::new(0.06, 0.012, 1.2),
        );
        self.cue(foot);
    }

    /// A cue that stands on its butt.
    pub(super) fn cue(&mut self, foot: Vec3) {
        let mut low = 0.0;
        for (part, high) in CUE_PARTS {
            let wide = CUE_RADII_M[0] + 0.001;
            let across = Vec3::new(wide, wide, 0.0);
            let cone = CsgSolid::ConeExterior {
                center: foot,
                radius: CUE_RADII_M[0],
                taper: (CUE_RADII_M[1] - CUE_RADII_M[0]) / CUE_M,
                beyond: Vec3::ZERO,
            };
            let shape = Shape::CsgBox {
                min: foot - across + Vec3::Z * low,
                max: foot + across + Vec3::Z * high,
                subtractions: vec![subtraction(cone)],
            };
            self.add(part, part, shape);
            low = high;
        }
    }

    /// Four walls of a thickness round a rectangle, from the floor to `top`.
    pub(super) fn ring(
        &mut self,
        name: &str,
        material: &str,
        inner: Vec2,
        thickness: f32,
        top: f32,
    ) {
        let floor = self.frame.floor;
        let hollow = subtraction(CsgSolid::Box {
            min: (-inner).extend(floor - 1.0),
            max: inner.extend(top + 1.0),
        });
        let shape = Shape::CsgBox {
            min: (-inner - thickness).extend(floor),
            max: (inner + thickness).extend(top),
            subtractions: vec![hollow],
        };
        self.add(name, material, shape);
    }

    /// A framed picture on a wall that runs `along`.
    pub(super) fn picture(&mut self, center: Vec3, along: Vec3, material: &str) {
        let into = Vec3::ONE - along - Vec3::Z;
        let half = along * 0.55 + Vec3::Z * 0.36;
        let frame = half + into * 0.025;
        self.add(
            "frame",
            "brass",
            Shape::Box {
                min: center - frame,
                max: center + frame,
            },
        );
        let canvas = half - along * 0.06 - Vec3::Z * 0.06 + into * 0.027;
        self.add(
            "canvas",
            material,
            Shape::Box {
                min: center - canvas,
                max: center + canvas,
            },
        );
    }
}

pub(super) fn area_light(x: f32, scale: f32) -> AreaLight {
    AreaLight {
        name: format!("lamp at {x}"),
        center: Vec3::new(scale * x, 0.0, LAMP_Z_M),
        half_u: Vec3::X * scale * LAMP_HALF_M.x,
        half_v: Vec3::NEG_Y * LAMP_HALF_M.y,
        radiance: Vec3::new(17.0, 15.5, 13.0),
    }
}

const LEG_INSET_M: f32 = 0.2;
const LEG_HALF_M: f32 = 0.08;
/// How much a leg narrows, over its height.
const LEG_TAPER: f32 = 0.05;
/// Rise of a shade's sides over their run.
const SHADE_SLOPE: f32 = 0.9;
/// From the table to the walls: more than the player's farthest eye.
const ROOM_MARGIN_M: f32 = 5.2;
const ROOM_HEIGHT_M: f32 = 2.4;
const PANEL_HEIGHT_M: f32 = 1.0;
/// From the floor to the foot of the cue.
const RACK_M: f32 = 0.45;
const CUE_M: f32 = 1.47;
/// At the foot and at the tip.
const CUE_RADII_M: [f32; 2] = [0.0147, 0.0065];
/// Materials, and how high above the foot each part ends.
const CUE_PARTS: [(&str, f32); 6] = [
    ("cue butt", 0.13),
    ("cue wrap", 0.43),
    ("cue butt", 0.74),
    ("cue shaft", 1.438),
    ("cue ferrule", 1.463),
    ("cue tip", CUE_M),
];
