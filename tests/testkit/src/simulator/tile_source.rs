//! Pixels of simulated frames, such that a wrong one is detected.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{FrameId, PixelFormat, TraceRequest};
use carom_tracer::{
    Camera, CompiledScene, Environment, Lens, Material, Plane, RenderSettings, Scene, SceneUpdate,
    Sphere, Tile, TileGrid, TileRadiance, TileRange, TraceJob, Tracer,
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

/// Source of the pixels of simulated nodes.
pub(super) enum TileSource {
    /// A pattern: each pixel encodes its frame, its tile and its samples.
    Pattern,
    /// A tracer.
    Tracer(Box<TracedScene>),
}

/// A scene with the tracer of all nodes.
pub(super) struct TracedScene {
    tracer: Arc<dyn Tracer + Send + Sync>,
    scene: CompiledScene,
    /// The frame, traced by one call.
    whole: Vec<[f32; 3]>,
}

impl TileSource {
    /// Source for a plan's frames, all of which show `scene`.
    ///
    /// # Panics
    /// If the tracer fails.
    pub(super) fn new(
        plan: &FarmPlan,
        scene: &Scene,
        tracer: Option<Arc<dyn Tracer + Send + Sync>>,
    ) -> Self {
        let Some(tracer) = tracer else {
            return Self::Pattern;
        };
        let scene = CompiledScene::new(scene).expect("the simulation's scene is valid");
        let mut traced = TracedScene {
            tracer,
            scene,
            whole: Vec::new(),
        };
        let grid = TileGrid::new(plan.size, plan.size.width.max(plan.size.height) as u16);
        let tiles = TileRange { first: 0, count: 1 };
        traced.whole = traced.trace(grid, tiles, frame_spec(plan).settings);
        Self::Tracer(Box::new(traced))
    }

    /// Pixels that an honest node sends for tiles.
    pub(super) fn pixels(&self, request: &TraceRequest, tiles: TileRange) -> TilePixels {
        TilePixels::Linear(match self {
            Self::Pattern => pattern(request, tiles),
            Self::Tracer(traced) => traced.trace(request.grid, tiles, request.settings),
        })
    }

    /// Whether each pixel of a frame is correct: where tiles are missing it must be black or, with
    /// several passes, the mean of some of its samples.
    pub(super) fn is_right(&self, frame: &Frame, grid: TileGrid, samples: u32) -> bool {
        let Pixels::Linear(pixels) = &frame.pixels else {
            return false;
        };
        let (width, edge) = (grid.size.width, u32::from(grid.edge));
        let mut missing = vec![false; grid.len() as usize];
        for tile in &frame.missing {
            missing[(tile.y / edge * grid.columns() + tile.x / edge) as usize] = true;
        }
        let several = frame.stats.passes > 1;
        let is_right = |(position, found): (usize, &[f32; 3])| {
            let (x, y) = (position as u32 % width, position as u32 / width);
            let tile = y / edge * grid.columns() + x / edge;
            let is_whole = !missing[tile as usize];
            !is_whole && *found == [0.0; 3]
                || match self {
                    Self::Pattern => {
                        let right = pixel(frame.id, tile, 0..samples);
                        let error = (found[2] / right[2] - 1.0).abs();
                        found[..2] == right[..2] && if is_whole { error < 1e-6 } else { several }
                    }
                    Self::Tracer(traced) => {
                        let error = (Vec3::from(*found) - Vec3::from(traced.whole[position])).abs();
                        let rounding = if several { 1e-5 } else { 0.0 };
                        error.max_element() <= rounding || !is_whole && several
                    }
                }
        };
        pixels.len() == grid.size.pixels() && pixels.iter().enumerate().all(is_right)
    }
}

impl TracedScene {
    fn trace(&self, grid: TileGrid, tiles: TileRange, settings: RenderSettings) -> Vec<[f32; 3]> {
        let tiles: Vec<Tile> = grid.tiles(tiles).collect();
        let job = TraceJob {
            size: grid.size,
            tiles: &tiles,
            settings,
            cancelled: &AtomicBool::new(false),
        };
        let traced = Mutex::new(vec![Vec::new(); tiles.len()]);
        let sink = |tile: TileRadiance| {
            traced.lock().expect("no thread panics")[tile.index] = tile.radiance;
        };
        let stats = self.tracer.trace(&self.scene, &job, &sink);
        stats.expect("the simulation's tracer traces");
        traced.into_inner().expect("no thread panics").concat()
    }
}

fn pattern(request: &TraceRequest, tiles: TileRange) -> Vec<[f32; 3]> {
    let mut pixels = Vec::with_capacity(request.grid.pixels(tiles));
    for index in tiles.indices() {
        let count = request.grid.tile(index).pixels();
        let first = request.settings.first_sample;
        let samples = first..first + request.settings.samples;
        let pixel = pixel(request.frame, index, samples);
        pixels.extend(std::iter::repeat_n(pixel, count));
    }
    pixels
}

/// Pixels of a node that has gone wrong: not numbers.
pub(super) fn poison(request: &TraceRequest, tiles: TileRange) -> TilePixels {
    TilePixels::Linear(vec![[f32::NAN; 3]; request.grid.pixels(tiles)])
}

/// Pixels of a node that forges: the picture, with its red 1.5 times as bright.
pub(super) fn brighter(pixels: TilePixels) -> TilePixels {
    match pixels {
        TilePixels::Linear(mut pixels) => {
            pixels.iter_mut().for_each(|pixel| pixel[0] *= 1.5);
            TilePixels::Linear(pixels)
        }
        other => other,
    }
}

/// Pixel of the pattern. Its samples enter by their squares, so that no range of samples has the mean
/// of another.
fn pixel(frame: FrameId, tile: u32, samples: Range<u32>) -> [f32; 3] {
    let count = samples.len() as f64;
    let sum: f64 = samples.map(|sample| f64::from(sample + 1).powi(2)).sum();
    [frame.0 as f32 + 1.0, tile as f32, (sum / count) as f32]
}

/// An empty scene of uniform radiance.
pub fn empty_scene() -> Scene {
    Scene {
        camera: Camera {
            eye: Vec3::NEG_Y,
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 40.0,
            lens: Lens::default(),
            near_m: 0.0,
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

/// A ball on a plane.
pub(super) fn ball_on_plane() -> Scene {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::gold(0.2));
    scene.add(Plane::z(0.0), Material::grey(0.5));
    scene
}
