//! Materials of the room and its table.

use std::collections::BTreeMap;

use carom_billiards::physics::Table;
use carom_billiards::rules::RuleSet;
use carom_tracer::{Axis, Material, ProceduralTexture, Sights};
use glam::Vec3;

use super::TableMeasures;
use crate::scene::ball_materials::BallSet;

pub(super) fn materials(
    frame: &TableMeasures,
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
pub(super) fn wood(grain: Axis, sights: Option<Sights>, tone: f32) -> Material {
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
