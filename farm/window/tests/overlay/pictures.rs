//! Pictures of each level of the overlay.

use std::path::PathBuf;

use carom_window::stats::StatsLevel;
use carom_window::stats::maps::MapKind;

use crate::fixture::{input, nodes, overlay};
use crate::looks::{Gpu, Look};

#[test]
fn each_level_looks_as_it_did() {
    let sizes = [(1280, 720), (640, 360)];
    let levels = [
        (StatsLevel::Line, "line"),
        (StatsLevel::Card, "card"),
        (StatsLevel::Full, "full"),
    ];
    let gpu = Gpu::open();
    let mut differing = Vec::new();
    for (size, text_scale) in sizes.into_iter().flat_map(|size| [(size, 1), (size, 2)]) {
        for (level, name) in levels {
            let look = look(level, size, text_scale as f32, MapKind::None);
            let name = format!("{name}_{}x{}_text_{text_scale}.png", size.0, size.1);
            differing.extend(look.differences(&folder().join(name), gpu.as_ref()));
        }
    }
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

#[test]
fn the_maps_look_as_they_did() {
    let gpu = Gpu::open();
    let mut differing = Vec::new();
    for (kind, name) in [(MapKind::Owner, "owner"), (MapKind::Cost, "cost")] {
        let path = folder().join(format!("map_{name}.png"));
        let look = look(StatsLevel::Full, (1280, 720), 1.0, kind);
        differing.extend(look.differences(&path, gpu.as_ref()));
    }
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

fn folder() -> PathBuf {
    PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/overlay/pictures"
    ))
}

fn look(level: StatsLevel, size: (u32, u32), text_scale: f32, map: MapKind) -> Look {
    let temporary = tempfile::tempdir().unwrap();
    let mut stats = overlay(level, temporary.path());
    stats.show_map(map);
    let nodes = nodes();
    Look::new(size, text_scale, |ui, pass| {
        stats.draw(ui.ctx(), 0.3 * f64::from(pass), &input(&nodes));
    })
}
