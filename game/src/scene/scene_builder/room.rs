//! The room around the table: stand, lampshade, walls, prints and window.

use carom_billiards::physics::Table;
use carom_tracer::{AreaLight, Camera, ProceduralTexture, Shape};
use glam::{DVec3, Vec2, Vec3};

use crate::camera::EYE_Z_M_MAX;
use crate::scene::cue_stick::{CUE_NAME, CuePose};

use super::{
    APRON_M, LAMP_GAP_M, POCKET_DEPTH_M, SHADE_HEIGHT_M, SHADE_RIM_M, SceneBuilder, TableMeasures,
    around, beyond, corners,
};

/// The camera with a near plane that hides the lamp, if its eye is above all players' views and a plane
/// fits between the whole lamp and the whole table, as in steep views. Otherwise the camera is unchanged,
/// and a view from above and aside shows the lamp.
pub fn below_lamp(table: &Table, camera: Camera) -> Camera {
    if f64::from(camera.eye.z) <= EYE_Z_M_MAX + ROUNDING_M {
        return camera;
    }
    let frame = TableMeasures::of(table);
    let forward = (camera.target - camera.eye).normalize();
    let depths = |half: Vec2, z: f32| {
        corners().map(move |corner| forward.dot((corner * half).extend(z) - camera.eye))
    };
    // Depths along the view direction: the near plane must be behind all corners of the lamp and before all
    // of the table.
    let lamp = depths(frame.lamp_half() + SHADE_RIM_M, LAMP_Z_M).fold(0.0, f32::max);
    let table = depths(frame.outer, frame.rail_height).fold(f32::INFINITY, f32::min);
    let near_m = lamp + LAMP_CLEARANCE_M;
    match near_m < table {
        true => camera.near_m(near_m),
        false => camera,
    }
}

impl SceneBuilder {
    /// Adds the pockets' floor, and legs.
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

    /// Adds an enamelled shade over the lamp, hung from the ceiling.
    pub(super) fn lampshade(&mut self) {
        let center = LAMP_Z_M * Vec3::Z;
        let half = self.frame.lamp_half() + SHADE_RIM_M;
        let (low, high) = (LAMP_Z_M + LAMP_GAP_M, LAMP_Z_M + SHADE_HEIGHT_M);
        let slope = |side: Vec3| {
            let foot = center + Vec3::Z * 0.01 + side * half.dot(side.truncate().abs());
            beyond(foot, side + Vec3::Z * SHADE_SLOPE)
        };
        let shade = Shape::CsgBox {
            min: (center.truncate() - half).extend(low),
            max: (center.truncate() + half).extend(high),
            subtractions: [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y]
                .map(slope)
                .into(),
        };
        self.add("lampshade", "enamel", shade);
        let rod = Shape::Box {
            min: (center.truncate() - 0.008).extend(high),
            max: (center.truncate() + 0.008).extend(high + ROD_M),
        };
        self.add("lamp rod", "brass", rod);
    }

    /// The lamp over the table.
    pub(super) fn lamp(&self) -> AreaLight {
        let half = self.frame.lamp_half();
        AreaLight {
            name: "lamp".to_owned(),
            center: LAMP_Z_M * Vec3::Z,
            half_u: Vec3::X * half.x,
            half_v: Vec3::NEG_Y * half.y,
            radiance: Vec3::new(17.0, 15.9, 14.0),
            ..AreaLight::new(1.0, 1.0)
        }
    }

    /// Adds floor, carpet and panelled walls with prints. There is no ceiling, so that the environment
    /// lights the room.
    pub(super) fn walls(&mut self) {
        let (outer, floor) = (self.frame.outer, self.frame.floor);
        let half = outer + ROOM_MARGIN_M;
        let ground = Shape::Box {
            min: (-half).extend(floor - 0.1),
            max: half.extend(floor),
        };
        self.add("floor", "floor", ground);
        let rug = outer + Vec2::new(0.9, 0.8);
        let carpet = Shape::Box {
            min: (-rug).extend(floor),
            max: rug.extend(floor + 0.006),
        };
        self.add("carpet", "carpet", carpet);
        self.ring("wall", "wall", half, 0.1, ROOM_HEIGHT_M);
        let panels = half - 0.05;
        self.ring(
            "panelling",
            "panelling",
            panels,
            0.06,
            floor + PANEL_HEIGHT_M,
        );
        for print in prints(&self.frame) {
            self.add("print", print.name, print.shape());
        }
    }

    /// Adds the cue, aimed along the table at the cue ball.
    pub(super) fn cue(&mut self, cue_ball: DVec3, radius_m: f64) {
        let pose = CuePose::aimed(cue_ball, radius_m, 0.0);
        self.add(CUE_NAME, CUE_NAME, pose.shape());
    }

    /// Adds four walls of a thickness around a rectangle, from the floor to `top`.
    pub(super) fn ring(
        &mut self,
        name: &str,
        material: &str,
        inner: Vec2,
        thickness: f32,
        top: f32,
    ) {
        for (near, far) in around(inner, inner + thickness) {
            let wall = Shape::Box {
                min: near.extend(self.frame.floor),
                max: far.extend(top),
            };
            self.add(name, material, wall);
        }
    }
}

/// A framed print on a wall.
pub(super) struct Print {
    /// Name of its material.
    pub(super) name: &'static str,
    center: Vec3,
    /// Half of its extent.
    half: Vec3,
    sky: Vec3,
    hills: Vec3,
}

impl Print {
    pub(super) fn texture(&self) -> ProceduralTexture {
        ProceduralTexture::Print {
            sky: self.sky,
            hills: self.hills,
            center: self.center,
            half_height: PRINT_HALF_M,
        }
    }

    fn shape(&self) -> Shape {
        Shape::Box {
            min: self.center - self.half,
            max: self.center + self.half,
        }
    }
}

/// The prints: one on each wall beside the table, and one on the wall behind its head.
pub(super) fn prints(frame: &TableMeasures) -> [Print; 3] {
    let walls = frame.outer + ROOM_MARGIN_M;
    let z = frame.floor + PRINT_HEIGHT_M;
    let width = PRINT_WIDTH * PRINT_HALF_M;
    let beside = Vec3::new(width, PRINT_DEPTH_M, PRINT_HALF_M);
    let print = |name, center, half, sky, hills| Print {
        name,
        center,
        half,
        sky,
        hills,
    };
    [
        print(
            "print of a dawn",
            Vec3::new(0.0, -walls.y, z),
            beside,
            Vec3::new(0.62, 0.42, 0.27),
            Vec3::new(0.13, 0.035, 0.03),
        ),
        print(
            "print of a noon",
            Vec3::new(0.0, walls.y, z),
            beside,
            Vec3::new(0.5, 0.55, 0.45),
            Vec3::new(0.03, 0.09, 0.07),
        ),
        print(
            "print of a dusk",
            Vec3::new(-walls.x, 0.0, z),
            Vec3::new(PRINT_DEPTH_M, width, PRINT_HALF_M),
            Vec3::new(0.33, 0.4, 0.5),
            Vec3::new(0.02, 0.04, 0.1),
        ),
    ]
}

/// Area light of the window in the far wall, an evening sky.
pub(super) fn window(outer: Vec2) -> AreaLight {
    let (center, half) = WINDOW_M;
    AreaLight {
        name: "window".to_owned(),
        center: Vec3::new(outer.x + ROOM_MARGIN_M - 0.03, center.x, center.y),
        half_u: Vec3::Z * half.y,
        half_v: Vec3::Y * half.x,
        radiance: Vec3::new(0.33, 0.3, 0.36),
        gradient: Vec3::new(-0.667, -0.467, -0.056),
    }
}

/// Height of the lamp above the cloth.
const LAMP_Z_M: f32 = 1.0;
/// Distance from the lamp to a near plane behind it.
const LAMP_CLEARANCE_M: f32 = 0.01;
/// Tolerance for rounding of an eye at the greatest height below the lamp.
const ROUNDING_M: f64 = 1e-3;
const LEG_INSET_M: f32 = 0.2;
const LEG_HALF_M: f32 = 0.08;
/// Decrease of a leg's width over its height.
const LEG_TAPER: f32 = 0.05;
/// Rise of a shade's sides over their run.
const SHADE_SLOPE: f32 = 0.9;
/// Distance from the table to the walls, beyond the farthest eye of the player's views.
pub(super) const ROOM_MARGIN_M: f32 = 5.2;
const ROOM_HEIGHT_M: f32 = 2.4;
/// Height of a print's centre above the floor.
const PRINT_HEIGHT_M: f32 = 1.62;
/// Half the height of a print.
const PRINT_HALF_M: f32 = 0.44;
/// Width of a print over its height.
const PRINT_WIDTH: f32 = 1.5;
/// Depth of a print in front of the wall.
const PRINT_DEPTH_M: f32 = 0.03;
/// Length of the rod from a shade up to the walls' height.
const ROD_M: f32 = ROOM_HEIGHT_M - 1.15;
pub(super) const PANEL_HEIGHT_M: f32 = 1.04;
/// Centre and half the extent of the window in the far wall, as y and z.
pub(super) const WINDOW_M: (Vec2, Vec2) = (Vec2::new(-2.1, 0.98), Vec2::new(0.85, 0.62));
