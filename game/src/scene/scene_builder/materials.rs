//! Materials of the room and its table.

use std::collections::BTreeMap;

use carom_billiards::physics::Table;
use carom_billiards::rules::RuleSet;
use carom_billiards::shot_report::table_layout;
use carom_tracer::{Axis, ClothMarks, Material, ProceduralTexture, Sights};
use glam::Vec3;

use super::TableMeasures;
use super::room::prints;
use crate::scene::cue_stick::CUE_NAME;
use crate::scene::table_style::TableStyle;

pub(super) fn materials(
    frame: &TableMeasures,
    table: &Table,
    rules: RuleSet,
    style: TableStyle,
) -> BTreeMap<String, Material> {
    let green = style.cloth.albedo(rules);
    let [shaft, butt] = style.cue.albedos();
    let cue = Material::Coated {
        ior: 1.5,
        alpha: 0.0,
        texture: ProceduralTexture::Cue { shaft, butt },
    };
    let fabric = furniture().into_iter().chain([
        (CUE_NAME, cue),
        (
            "scoreboard",
            Material::Coated {
                ior: 1.05,
                alpha: 0.0,
                texture: frame.scoreboard().texture(),
            },
        ),
        ("cloth", cloth(green, Some(marks(table, rules)))),
        (
            "cushion cloth",
            cloth(0.9 * green, Some(ClothMarks::default())),
        ),
        (
            "rail wood",
            MAHOGANY.varnished(Axis::X, Some(sights(frame, table, rules))),
        ),
    ]);
    let prints = prints(frame);
    let fabric = fabric.chain(
        prints
            .iter()
            .map(|print| (print.name, matt(print.texture()))),
    );
    let last = if rules == RuleSet::Snooker { 21 } else { 15 };
    let balls = (0..=last).map(|number| {
        let material = style.balls.material(rules, number);
        (format!("ball {number}"), material)
    });
    let named = fabric.map(|(name, material)| (name.to_owned(), material));
    named.chain(balls).collect()
}

/// Materials that are the same in every room, by name.
fn furniture() -> Vec<(&'static str, Material)> {
    let soft = |albedo: Vec3, sheen| Material::Cloth {
        albedo,
        sheen: Vec3::splat(sheen),
        sheen_roughness: 0.5,
        marks: None,
    };
    let planks = |light, dark, grain| matt(ProceduralTexture::Planks { light, dark, grain });
    let bricks = ProceduralTexture::Bricks {
        light: Vec3::new(0.34, 0.155, 0.095),
        dark: Vec3::new(0.17, 0.075, 0.052),
        mortar: Vec3::new(0.28, 0.25, 0.215),
    };
    let brass = (Vec3::new(0.445, 0.527, 1.095), Vec3::new(3.7, 2.765, 1.829));
    let metal = |(eta, k), alpha| Material::Conductor {
        eta,
        k,
        alpha,
        number: 0,
    };
    vec![
        ("carpet", soft(Vec3::new(0.085, 0.09, 0.115), 0.06)),
        ("bench leather", soft(Vec3::new(0.2, 0.06, 0.036), 0.05)),
        ("dark wood", WALNUT.oiled(Axis::Z)),
        (
            "panelling",
            planks(
                Vec3::new(0.15, 0.083, 0.044),
                Vec3::new(0.108, 0.059, 0.031),
                Axis::Z,
            ),
        ),
        (
            "floor",
            planks(
                Vec3::new(0.17, 0.105, 0.058),
                Vec3::new(0.105, 0.062, 0.034),
                Axis::X,
            ),
        ),
        ("leather", Material::diffuse([0.03, 0.022, 0.017])),
        ("collar leather", soft(Vec3::new(0.075, 0.038, 0.022), 0.03)),
        ("brass", metal(brass, 0.2)),
        ("enamel", Material::plastic([0.012, 0.014, 0.018])),
        (
            "wall",
            Material::Coated {
                ior: 1.05,
                alpha: 0.0,
                texture: bricks,
            },
        ),
    ]
}

/// Worsted cloth.
fn cloth(albedo: Vec3, marks: Option<ClothMarks>) -> Material {
    Material::Cloth {
        albedo,
        sheen: 0.02 + 0.3 * albedo,
        sheen_roughness: 0.35,
        marks,
    }
}

/// Lines and spots on the table of a game. A table without pockets has no line.
fn marks(table: &Table, rules: RuleSet) -> ClothMarks {
    let layout = table_layout(table);
    let foot_x = layout.foot_spot().x as f32;
    if rules == RuleSet::Snooker {
        // The black's spot is 324 mm from the top cushion of a table 3569 mm long (WPBSA section 1, 1 (f)).
        let black_x = ((0.5 - 324.0 / 3569.0) * layout.length_m) as f32;
        return ClothMarks {
            line_x: -layout.baulk_spot().x as f32,
            d_radius: layout.d_radius_m() as f32,
            spots_x: [foot_x, 0.0, black_x],
        };
    }
    if table.pockets().is_empty() {
        return ClothMarks {
            spots_x: [foot_x, 0.0, -foot_x],
            ..ClothMarks::default()
        };
    }
    ClothMarks {
        line_x: foot_x,
        d_radius: 0.0,
        spots_x: [foot_x; 3],
    }
}

/// Sights on mitred rails; snooker's rails have none.
fn sights(frame: &TableMeasures, table: &Table, rules: RuleSet) -> Sights {
    let middle = 0.5 * (frame.inside + frame.outer);
    let spacing = (0.125 * table.length_m()) as f32;
    Sights {
        spacing: if rules == RuleSet::Snooker {
            0.0
        } else {
            spacing
        },
        end_x: middle.x,
        side_y: middle.y,
    }
}

/// A texture without a coating.
fn matt(texture: ProceduralTexture) -> Material {
    Material::Coated {
        ior: 1.0,
        alpha: 0.0,
        texture,
    }
}

/// A kind of wood.
struct Wood {
    light: Vec3,
    dark: Vec3,
    scale: f32,
}

impl Wood {
    /// The wood under a satin varnish.
    fn varnished(&self, grain: Axis, sights: Option<Sights>) -> Material {
        Material::Coated {
            ior: VARNISH_IOR,
            alpha: SATIN_ALPHA,
            texture: self.texture(grain, sights),
        }
    }

    fn oiled(&self, grain: Axis) -> Material {
        matt(self.texture(grain, None))
    }

    fn texture(&self, grain: Axis, sights: Option<Sights>) -> ProceduralTexture {
        ProceduralTexture::Wood {
            light: self.light,
            dark: self.dark,
            grain,
            sights,
            scale: self.scale,
        }
    }
}

const VARNISH_IOR: f32 = 1.4;
/// GGX width of a satin varnish.
const SATIN_ALPHA: f32 = 0.16;

const MAHOGANY: Wood = Wood {
    light: Vec3::new(0.17, 0.06, 0.026),
    dark: Vec3::new(0.07, 0.022, 0.01),
    scale: 0.55,
};
const WALNUT: Wood = Wood {
    light: Vec3::new(0.085, 0.045, 0.024),
    dark: Vec3::new(0.04, 0.02, 0.011),
    scale: 0.4,
};
