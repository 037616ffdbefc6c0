//! Builder of the scene: the simulated table in a room with lamps, floor and walls.
//!
//! All geometry of the table is derived from the simulation's dimensions, so that balls meet what the
//! picture shows. Lengths are in metres, the cloth is at z = 0.

mod cushions;
mod furniture;
mod materials;
mod pockets;
mod room;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use carom_billiards::physics::Table;
use carom_billiards::rules::{self, RuleSet};
use carom_billiards::shot_report::table_layout;
use carom_tracer::{Camera, CsgSolid, Environment, Lens, Object, Scene, Shape, Subtraction};
use glam::{DVec2, Quat, Vec2, Vec3};

use self::materials::materials;
pub use self::room::below_lamp;
use self::room::window;
use crate::scene::scoreboard::Scoreboard;
use crate::scene::table_style::TableStyle;

/// Exposure for which the room's area lights are set.
pub const EXPOSURE: f32 = 1.0;

/// Default horizontal field of view of the cameras, degrees.
pub const FOV_X_DEG: f64 = 44.0;

/// The scene of a room around `table`, with the balls of a game and the look of `style`.
pub fn room(table: &Table, rules: RuleSet, style: TableStyle) -> Scene {
    let mut room = SceneBuilder {
        frame: TableMeasures::of(table),
        objects: Vec::new(),
    };
    room.balls(table, rules);
    room.bed(table);
    room.rails(table);
    room.collars(table);
    for cushion in table.cushions() {
        room.cushion(table, cushion);
    }
    room.stand(table);
    room.lampshade();
    room.walls();
    room.far_end();
    let light = style.brightness.factor();
    let mut area_lights = vec![room.lamp(), window(room.frame.outer)];
    for lamp in &mut area_lights {
        lamp.radiance *= light;
    }
    Scene {
        camera: Camera {
            eye: room.frame.scale * Vec3::new(-2.02, -0.3, 0.56),
            target: room.frame.scale * Vec3::new(-0.25, 0.0, 0.0),
            up: Vec3::Z,
            fov_x_deg: FOV_X_DEG as f32,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: light * Vec3::new(0.4, 0.37, 0.33),
        },
        materials: materials(&room.frame, table, rules, style),
        area_lights,
        objects: room.objects,
        ..Scene::new()
    }
}

/// Main dimensions of a table.
struct TableMeasures {
    /// Half the length and width between the cushions' backs.
    inside: Vec2,
    /// Half the length and width of the whole table.
    outer: Vec2,
    rail_height: f32,
    floor: f32,
    /// Length over that of a nine-foot table.
    scale: f32,
}

impl TableMeasures {
    fn of(table: &Table) -> Self {
        let half = 0.5 * DVec2::new(table.length_m(), table.width_m());
        let (cushion, width) = table.rails().map_or((CUSHION_M, RAIL_M), |rails| {
            (rails.cushion_width_m, rails.width_m)
        });
        Self {
            inside: (half + cushion).as_vec2(),
            outer: (half + width).as_vec2(),
            rail_height: table.rail_height_m() as f32,
            floor: -table.bed_height_m() as f32,
            scale: (table.length_m() / NINE_FOOT_M) as f32,
        }
    }

    /// Half the length and width of the lamp.
    fn lamp_half(&self) -> Vec2 {
        LAMP_HALF_M * Vec2::new(self.scale, 1.0)
    }

    /// The scoreboard on the far wall, over the bench.
    fn scoreboard(&self) -> Scoreboard {
        let wall_x = self.outer.x + room::ROOM_MARGIN_M;
        Scoreboard {
            center: Vec3::new(
                wall_x - SCOREBOARD_M.x,
                SCOREBOARD_M.y,
                self.floor + SCOREBOARD_M.z,
            ),
        }
    }
}

struct SceneBuilder {
    frame: TableMeasures,
    objects: Vec<Object>,
}

impl SceneBuilder {
    fn add(&mut self, name: impl Into<String>, material: &str, shape: Shape) {
        self.objects.push(Object {
            name: name.into(),
            material: material.to_owned(),
            shape,
        });
    }

    /// Adds the balls in their rack, each with its number towards the player, and the cue behind the cue
    /// ball.
    fn balls(&mut self, table: &Table, rules: RuleSet) {
        let racked = rules::rack(rules, &table_layout(table), 1);
        let racked: BTreeMap<u8, DVec2> = racked.into_iter().map(|p| (p.ball, p.at)).collect();
        if let Some(at) = racked.get(&0) {
            let radius_m = table.cue_ball().radius_m;
            self.cue(at.extend(radius_m), radius_m);
        }
        for (number, at) in racked {
            let body = table.body_of(number);
            let shape = Shape::Sphere {
                center: at.extend(body.radius_m).as_vec3(),
                radius: body.radius_m as f32,
                rotation: Quat::IDENTITY,
            };
            self.add(format!("ball{number}"), &format!("ball {number}"), shape);
        }
    }
}

fn corners() -> impl Iterator<Item = Vec2> {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .into_iter()
        .map(Vec2::from)
}

/// Four boxes between two rectangles around the table's centre, as their least and greatest corners.
fn around(inner: Vec2, outer: Vec2) -> [(Vec2, Vec2); 4] {
    [
        (-outer, Vec2::new(outer.x, -inner.y)),
        (Vec2::new(-outer.x, inner.y), outer),
        (Vec2::new(-outer.x, -inner.y), Vec2::new(-inner.x, inner.y)),
        (Vec2::new(inner.x, -inner.y), Vec2::new(outer.x, inner.y)),
    ]
}

fn subtraction(solid: CsgSolid) -> Subtraction {
    Subtraction {
        solid,
        material: None,
    }
}

/// Subtraction of the half-space on the side of a plane to which its normal points.
fn beyond(point: Vec3, normal: Vec3) -> Subtraction {
    subtraction(CsgSolid::HalfSpace { point, normal })
}

/// The scoreboard of a table's room.
pub fn scoreboard(table: &Table) -> Scoreboard {
    TableMeasures::of(table).scoreboard()
}

/// Centre of the clock: distance from the far wall, y, and height above the floor.
const SCOREBOARD_M: Vec3 = Vec3::new(0.035, 0.55, 1.25);
/// Widths of cushions and rails of tables that define none.
const CUSHION_M: f64 = 0.05;
const RAIL_M: f64 = 0.18;
/// Depth of the pockets' floor below the cloth.
pub(super) const POCKET_DEPTH_M: f32 = 0.165;
/// Height of the frame below the cloth.
const APRON_M: f32 = 0.17;
/// Length of the table for which the lamp and the default camera are laid out.
const NINE_FOOT_M: f64 = 2.54;
/// Half the extent of the lamp of a nine-foot table.
const LAMP_HALF_M: Vec2 = Vec2::new(1.02, 0.18);
const SHADE_RIM_M: f32 = 0.03;
/// Distance of a lamp's diffuser below the underside of its shade. A rim that extends below the diffuser
/// would be a bright surface that light sampling does not sample: at 2 cm it causes two thirds of the
/// room's squared error at 16 samples (relMSE 2.0e-3 against 5.9e-4, `carom-tracer`'s example `noise`).
const LAMP_GAP_M: f32 = 0.001;
const SHADE_HEIGHT_M: f32 = 0.15;
