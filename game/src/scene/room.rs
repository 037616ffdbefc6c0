//! The room that the game is played in: the table of the simulation, lamps, floor and walls.
//!
//! Everything is made from the table's own numbers, so that a ball meets what the picture shows.
//! Lengths are in metres, the cloth's level is z = 0.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use carom_billiards::physics::{Circle, Cushion, Table};
use carom_billiards::rules::{self, RuleSet};
use carom_billiards::shot_report::table_layout;
use carom_tracer::{
    AreaLight, Axis, Camera, CsgSolid, Environment, Material, Object, ProceduralTexture, Scene,
    Shape, Sights, Subtraction,
};
use glam::{DVec2, Quat, Vec2, Vec3};

use crate::scene::ball_materials::BallSet;

/// The room round `table`, whose balls are those of a game and of `set`, as the game's scene.
pub fn room(table: &Table, rules: RuleSet, set: BallSet) -> Scene {
    let mut room = Room {
        frame: Frame::of(table),
        objects: Vec::new(),
    };
    room.balls(table, rules);
    room.bed(table);
    room.rails(table);
    room.castings(table);
    for cushion in table.cushions() {
        room.cushion(table, cushion);
    }
    room.stand(table);
    room.lampshades();
    room.walls();
    room.cue_rack();
    Scene {
        camera: Camera {
            eye: room.frame.scale * Vec3::new(-2.02, -0.3, 0.56),
            target: room.frame.scale * Vec3::new(-0.25, 0.0, 0.0),
            up: Vec3::Z,
            fov_x_deg: 44.0,
        },
        environment: Environment {
            radiance: Vec3::new(0.16, 0.15, 0.135),
        },
        materials: materials(&room.frame, table, rules, set),
        area_lights: LAMP_X_M.map(|x| area_light(x, room.frame.scale)).into(),
        objects: room.objects,
    }
}

/// The corners of a box round the lampshades and their bar, m: no camera goes there.
pub fn lampshades(table: &Table) -> (Vec3, Vec3) {
    let scale = Frame::of(table).scale;
    let half = LAMP_HALF_M * Vec2::new(scale, 1.0) + SHADE_RIM_M;
    let reach = Vec2::new(scale * LAMP_X_M[1], 0.0) + half;
    (
        (-reach).extend(LAMP_Z_M - SHADE_LIP_M),
        reach.extend(LAMP_Z_M + SHADE_HEIGHT_M + BAR_M),
    )
}

/// The main measures of a table.
struct Frame {
    /// Half the length and width between the cushions' backs.
    inside: Vec2,
    /// Half the length and width of the whole table.
    outer: Vec2,
    rail_height: f32,
    floor: f32,
    /// Its length over that of a nine-foot table.
    scale: f32,
}

impl Frame {
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
}

struct Room {
    frame: Frame,
    objects: Vec<Object>,
}

impl Room {
    fn add(&mut self, name: impl Into<String>, material: &str, shape: Shape) {
        self.objects.push(Object {
            name: name.into(),
            material: material.to_owned(),
            shape,
        });
    }

    /// At rest where a rack would be, each with its number towards the player.
    fn balls(&mut self, table: &Table, rules: RuleSet) {
        let racked = rules::rack(rules, &table_layout(table), 1);
        let racked: BTreeMap<u8, DVec2> = racked.into_iter().map(|p| (p.ball, p.at)).collect();
        for (number, at) in racked {
            let body = if number == 0 {
                table.cue_ball()
            } else {
                table.ball()
            };
            let shape = Shape::Sphere {
                center: at.extend(body.radius_m).as_vec3(),
                radius: body.radius_m as f32,
                rotation: Quat::IDENTITY,
            };
            self.add(format!("ball{number}"), &format!("ball {number}"), shape);
        }
    }

    /// The slate under its cloth, with the pockets' holes.
    fn bed(&mut self, table: &Table) {
        let inside = self.frame.inside;
        let subtractions = bores(table).collect();
        let shape = Shape::CsgBox {
            min: (-inside).extend(-POCKET_DEPTH_M),
            max: inside.extend(0.0),
            subtractions,
        };
        self.add("bed", "cloth", shape);
    }

    /// The wooden frame: bevelled outside, open inside, bored for the pockets.
    fn rails(&mut self, table: &Table) {
        let (outer, top) = (self.frame.outer, self.frame.rail_height);
        let mut subtractions = vec![self.opening()];
        subtractions.extend(bores(table));
        for (side, normal) in [(outer.x, Vec3::X), (outer.y, Vec3::Y)] {
            for sign in [-1.0, 1.0] {
                let edge = sign * normal * (side - BEVEL_M) + Vec3::Z * top;
                subtractions.push(beyond(edge, sign * normal + Vec3::Z));
            }
        }
        subtractions.extend(corners().map(|corner| trimmed(corner, outer)));
        let shape = Shape::CsgBox {
            min: (-outer).extend(-APRON_M),
            max: outer.extend(top),
            subtractions,
        };
        self.add("rails", "rail wood", shape);
    }

    /// Chrome round each pocket, a little above the wood.
    fn castings(&mut self, table: &Table) {
        let (inside, outer) = (self.frame.inside, self.frame.outer + CASTING_M);
        let top = self.frame.rail_height + CASTING_M;
        let holes: Vec<Subtraction> = bores(table).collect();
        for (index, (pocket, bore)) in table.pockets().iter().zip(holes).enumerate() {
            let center = pocket.center.as_vec2();
            let reach = pocket.radius_m as f32 + CASTING_RIM_M;
            let is_corner = center.x.abs() > 0.25 * outer.x;
            let side = center.signum();
            let (near, far) = if is_corner {
                ((center.abs() - 0.5 * reach).min(inside - 0.03), outer)
            } else {
                (
                    Vec2::new(-reach, inside.y - 0.01),
                    Vec2::new(reach, outer.y),
                )
            };
            let (a, b) = if is_corner {
                (near * side, far * side)
            } else {
                (near * Vec2::new(1.0, side.y), far * Vec2::new(1.0, side.y))
            };
            let mut subtractions = vec![self.opening(), bore];
            if is_corner {
                subtractions.push(trimmed(side, outer));
            }
            let shape = Shape::CsgBox {
                min: a.min(b).extend(-CASTING_DEPTH_M),
                max: a.max(b).extend(top),
                subtractions,
            };
            self.add(format!("casting{index}"), "chrome", shape);
        }
    }

    /// A cushion between two facings, under-cut below the nose and rising to the rail; its tips are
    /// rounded as balls meet them.
    fn cushion(&mut self, table: &Table, cushion: &Cushion) {
        let [a, b, c, d] = cushion.corners.map(|corner| corner.as_vec2());
        let normal = table.noses()[cushion.nose].normal().as_vec2();
        let nose = table.nose_height_m() as f32;
        let (low, high) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
        let rise = self.frame.rail_height - nose - NOSE_HALF_M;
        let depth = (c - b).dot(-normal);
        let facing = |from: Vec2, to: Vec2| {
            let out = Vec2::new(to.y - from.y, from.x - to.x);
            beyond(from.extend(0.0), out.extend(0.0))
        };
        let tips = cushion.corners.into_iter().zip(cushion.jaws);
        let rounded = tips.filter_map(|(tip, jaw)| Some(rounding(tip, jaw?)));
        let subtractions = [
            facing(b, c),
            facing(d, a),
            beyond(a.extend(nose + NOSE_HALF_M), (normal * rise).extend(depth)),
            beyond(
                a.extend(nose - NOSE_HALF_M),
                (normal * (nose - NOSE_HALF_M)).extend(-UNDERCUT_M),
            ),
        ];
        let subtractions = subtractions.into_iter().chain(rounded).collect();
        let shape = Shape::CsgBox {
            min: low.extend(0.0),
            max: high.extend(self.frame.rail_height),
            subtractions,
        };
        self.add(format!("cushion{}", cushion.nose), "cushion cloth", shape);
    }

    /// The pockets' floor, and legs.
    fn stand(&mut self, table: &Table) {
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
    fn lampshades(&mut self) {
        let scale = self.frame.scale;
        let lamp_half = LAMP_HALF_M * Vec2::new(scale, 1.0);
        let half = lamp_half + SHADE_RIM_M;
        let (low, high) = (LAMP_Z_M - SHADE_LIP_M, LAMP_Z_M + SHADE_HEIGHT_M);
        for x in LAMP_X_M {
            let center = Vec2::new(scale * x, 0.0);
            let hollow = lamp_half + 0.004;
            let mut subtractions = vec![Subtraction {
                solid: CsgSolid::Box {
                    min: (center - hollow).extend(low - 1.0),
                    max: (center + hollow).extend(LAMP_Z_M + 0.004),
                },
                material: Some("shade inside".to_owned()),
            }];
            for side in [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y] {
                let foot = center.extend(LAMP_Z_M + 0.01) + side * half.dot(side.truncate().abs());
                subtractions.push(beyond(foot, side + Vec3::Z * SHADE_SLOPE));
            }
            let shade = Shape::CsgBox {
                min: (center - half).extend(low),
                max: (center + half).extend(high),
                subtractions,
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
    fn walls(&mut self) {
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
    fn cue_rack(&mut self) {
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
    fn cue(&mut self, foot: Vec3) {
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
    fn ring(&mut self, name: &str, material: &str, inner: Vec2, thickness: f32, top: f32) {
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
    fn picture(&mut self, center: Vec3, along: Vec3, material: &str) {
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

    /// What the rails leave open: cloth and cushions.
    fn opening(&self) -> Subtraction {
        let inside = self.frame.inside;
        subtraction(CsgSolid::Box {
            min: (-inside).extend(-1.0),
            max: inside.extend(1.0),
        })
    }
}

fn corners() -> impl Iterator<Item = Vec2> {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .into_iter()
        .map(Vec2::from)
}

/// The pockets' holes, lined with leather.
fn bores(table: &Table) -> impl Iterator<Item = Subtraction> + '_ {
    table.pockets().iter().map(|pocket| Subtraction {
        solid: CsgSolid::Cylinder {
            center: pocket.center.as_vec2().extend(0.0),
            radius: pocket.radius_m as f32,
        },
        material: Some("leather".to_owned()),
    })
}

/// The upright edge at a corner of the table, cut off.
fn trimmed(corner: Vec2, outer: Vec2) -> Subtraction {
    let point = corner * outer - corner * Vec2::new(TRIM_M, 0.0);
    beyond(point.extend(0.0), corner.extend(0.0))
}

/// The tip of a cushion outside its jaw.
fn rounding(tip: DVec2, jaw: Circle) -> Subtraction {
    let out = tip - jaw.center;
    // As far out as the jaw touches the sides that meet in the tip.
    let beyond = out * (jaw.radius_m * jaw.radius_m / out.length_squared());
    subtraction(CsgSolid::ConeExterior {
        center: jaw.center.extend(0.0).as_vec3(),
        radius: jaw.radius_m as f32,
        taper: 0.0,
        beyond: beyond.extend(0.0).as_vec3(),
    })
}

fn subtraction(solid: CsgSolid) -> Subtraction {
    Subtraction {
        solid,
        material: None,
    }
}

fn beyond(point: Vec3, normal: Vec3) -> Subtraction {
    subtraction(CsgSolid::HalfSpace { point, normal })
}

fn area_light(x: f32, scale: f32) -> AreaLight {
    AreaLight {
        name: format!("lamp at {x}"),
        center: Vec3::new(scale * x, 0.0, LAMP_Z_M),
        half_u: Vec3::X * scale * LAMP_HALF_M.x,
        half_v: Vec3::NEG_Y * LAMP_HALF_M.y,
        radiance: Vec3::new(17.0, 15.5, 13.0),
    }
}

fn materials(
    frame: &Frame,
    table: &Table,
    rules: RuleSet,
    set: BallSet,
) -> BTreeMap<String, Material> {
    let middle = 0.5 * (frame.inside + frame.outer);
    let sights = Sights {
        spacing: (0.125 * table.length_m()) as f32,
        end_x: middle.x,
        side_y: middle.y,
    };
    let lacquer = |albedo| Material::SmoothPlastic {
        albedo,
        ior: 1.5,
        internal_reflectance: None,
        stripe: None,
    };
    let cloth = |albedo: Vec3, sheen| Material::Cloth {
        albedo,
        sheen,
        sheen_roughness: 0.35,
    };
    let diffuse = |albedo| Material::Diffuse { albedo };
    let planks = ProceduralTexture::Planks {
        light: Vec3::new(0.26, 0.15, 0.075),
        dark: Vec3::new(0.10, 0.05, 0.025),
    };
    let chrome = (Vec3::new(3.1, 3.1, 2.3), Vec3::new(3.3, 3.3, 3.1));
    let brass = (Vec3::new(0.445, 0.527, 1.095), Vec3::new(3.7, 2.765, 1.829));
    let metal = |(eta, k), alpha| Material::Conductor { eta, k, alpha };
    let green = Vec3::new(0.03, 0.23, 0.1);
    let named = [
        ("cloth", cloth(green, Vec3::new(0.05, 0.12, 0.07))),
        (
            "cushion cloth",
            cloth(0.88 * green, Vec3::new(0.05, 0.12, 0.07)),
        ),
        (
            "carpet",
            cloth(Vec3::new(0.17, 0.03, 0.03), Vec3::splat(0.1)),
        ),
        ("rail wood", wood(Axis::X, Some(sights), 1.0)),
        ("dark wood", wood(Axis::Z, None, 0.7)),
        ("panelling", wood(Axis::Z, None, 1.6)),
        (
            "floor",
            Material::Coated {
                ior: 1.4,
                texture: planks,
            },
        ),
        ("leather", diffuse(Vec3::new(0.035, 0.022, 0.016))),
        ("chrome", metal(chrome, 0.22)),
        ("brass", metal(brass, 0.12)),
        ("cue butt", wood(Axis::Z, None, 0.5)),
        ("cue wrap", diffuse(Vec3::new(0.05, 0.06, 0.08))),
        ("cue shaft", wood(Axis::Z, None, 2.6)),
        ("cue ferrule", lacquer(Vec3::new(0.8, 0.78, 0.7))),
        ("cue tip", diffuse(Vec3::new(0.06, 0.16, 0.3))),
        ("enamel", lacquer(Vec3::new(0.01, 0.07, 0.035))),
        ("shade inside", diffuse(Vec3::splat(0.7))),
        ("wall", diffuse(Vec3::new(0.45, 0.38, 0.27))),
        ("picture red", diffuse(Vec3::new(0.3, 0.07, 0.04))),
        ("picture blue", diffuse(Vec3::new(0.05, 0.1, 0.25))),
        ("picture gold", diffuse(Vec3::new(0.4, 0.28, 0.08))),
    ];
    let last = if rules == RuleSet::Snooker { 21 } else { 15 };
    let balls = (0..=last).map(|number| {
        let material = set.material(rules, number);
        (format!("ball {number}"), material)
    });
    let named = named.map(|(name, material)| (name.to_owned(), material));
    named.into_iter().chain(balls).collect()
}

/// Varnished, from a `tone` of 1 upwards paler.
fn wood(grain: Axis, sights: Option<Sights>, tone: f32) -> Material {
    Material::Coated {
        ior: 1.5,
        texture: ProceduralTexture::Wood {
            light: Vec3::new(0.30, 0.125, 0.045) * tone,
            dark: Vec3::new(0.085, 0.028, 0.011) * tone,
            grain,
            sights,
        },
    }
}

/// Where tables without rails of their own get some.
const CUSHION_M: f64 = 0.05;
const RAIL_M: f64 = 0.18;
const POCKET_DEPTH_M: f32 = 0.13;
/// How far the frame reaches below the cloth.
const APRON_M: f32 = 0.17;
const BEVEL_M: f32 = 0.012;
/// Cut off each corner of the table, along the rail.
const TRIM_M: f32 = 0.07;
/// How much the chrome stands out over the wood.
const CASTING_M: f32 = 0.0016;
const CASTING_RIM_M: f32 = 0.03;
const CASTING_DEPTH_M: f32 = 0.06;
/// Half the height of the nose's upright edge.
const NOSE_HALF_M: f32 = 0.0015;
/// How far the foot of a cushion stands behind its nose.
const UNDERCUT_M: f32 = 0.016;
const LEG_INSET_M: f32 = 0.2;
const LEG_HALF_M: f32 = 0.08;
/// How much a leg narrows, over its height.
const LEG_TAPER: f32 = 0.05;
/// Lamps, and where the first picture is taken from, are laid out for this length.
const NINE_FOOT_M: f64 = 2.54;
const LAMP_X_M: [f32; 2] = [-0.62, 0.62];
const LAMP_Z_M: f32 = 1.0;
const LAMP_HALF_M: Vec2 = Vec2::new(0.45, 0.18);
const SHADE_RIM_M: f32 = 0.03;
const SHADE_LIP_M: f32 = 0.02;
const SHADE_HEIGHT_M: f32 = 0.15;
/// The bar that the lamps hang from.
const BAR_M: f32 = 0.02;
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
