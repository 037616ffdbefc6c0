//! The frames of a simulation: each pixel names its frame, its tile and its samples, so that a wrong one
//! is noticed.

use std::collections::BTreeMap;
use std::ops::Range;

use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{FrameId, PixelFormat, TraceRequest};
use carom_tracer::{
    Camera, Environment, Lens, RenderSettings, Scene, SceneUpdate, TileGrid, TileRange,
};
use glam::Vec3;

use super::FarmPlan;
use carom_farm::{Frame, FrameSpec, Pixels};

pub(super) fn frame_spec(plan: &FarmPlan) -> FrameSpec {
    FrameSpec {
        update: SceneUpdate::default(),
        size: plan.size,
        settings: RenderSettings {
            samples: plan.samples,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF32,
    }
}

/// What a simulated node sends for tiles: each pixel names its frame, its tile and its samples.
pub(super) fn tile_pixels(request: &TraceRequest, tiles: TileRange) -> TilePixels {
    let mut pixels = Vec::with_capacity(request.grid.pixels(tiles));
    for index in tiles.indices() {
        let count = request.grid.tile(index).pixels();
        let first = request.settings.first_sample;
        let pixel = pixel(
            request.frame,
            index,
            first..first + request.settings.samples,
        );
        pixels.extend(std::iter::repeat_n(pixel, count));
    }
    TilePixels::Linear(pixels)
}

/// What a node sends that has gone wrong.
pub(super) fn poison(request: &TraceRequest, tiles: TileRange) -> TilePixels {
    TilePixels::Linear(vec![[f32::NAN; 3]; request.grid.pixels(tiles)])
}

/// What a node sends that lies: the picture, but brighter.
pub(super) fn forgery(request: &TraceRequest, tiles: TileRange) -> TilePixels {
    match tile_pixels(request, tiles) {
        TilePixels::Linear(mut pixels) => {
            pixels.iter_mut().for_each(|pixel| pixel[0] *= 1.5);
            TilePixels::Linear(pixels)
        }
        other => other,
    }
}

/// Whether each pixel is what it should be: where tiles are missing black or, of several passes, the mean
/// of some of its samples.
pub(super) fn is_right(frame: &Frame, grid: TileGrid, samples: u32) -> bool {
    let Pixels::Linear(pixels) = &frame.pixels else {
        return false;
    };
    let (width, edge) = (grid.size.width, u32::from(grid.edge));
    let mut missing = vec![false; grid.len() as usize];
    for tile in &frame.missing {
        missing[(tile.y / edge * grid.columns() + tile.x / edge) as usize] = true;
    }
    let [.., samples_are] = pixel(frame.id, 0, 0..samples);
    let is_right = |(position, found): (usize, &[f32; 3])| {
        let (x, y) = (position as u32 % width, position as u32 / width);
        let tile = y / edge * grid.columns() + x / edge;
        let [frame_is, tile_is] = [frame.id.0 as f32 + 1.0, tile as f32];
        if !missing[tile as usize] {
            let error = (found[2] / samples_are - 1.0).abs();
            return found[..2] == [frame_is, tile_is] && error < 1e-6;
        }
        *found == [0.0; 3] || frame.stats.passes > 1 && found[..2] == [frame_is, tile_is]
    };
    pixels.len() == grid.size.pixels() && pixels.iter().enumerate().all(is_right)
}

/// Squares, so that no range of samples has the mean of another.
fn pixel(frame: FrameId, tile: u32, samples: Range<u32>) -> [f32; 3] {
    let count = samples.len() as f64;
    let sum: f64 = samples.map(|sample| f64::from(sample + 1).powi(2)).sum();
    [frame.0 as f32 + 1.0, tile as f32, (sum / count) as f32]
}

/// A scene without anything in it: whatever is looked at is as bright.
pub fn empty_scene() -> Scene {
    Scene {
        camera: Camera {
            eye: Vec3::NEG_Y,
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 40.0,
            lens: Lens::default(),
        },
        environment: Environment {
            radiance: Vec3::ONE,
        },
        materials: BTreeMap::new(),
        objects: Vec::new(),
        area_lights: Vec::new(),
        ..Scene::new()
    }
}
