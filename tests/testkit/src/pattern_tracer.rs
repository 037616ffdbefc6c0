//! A tracer of known output: its radiance is a hash of pixel, sample, seed and camera, and it fails on
//! demand.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use carom_farm::FrameSpec;
use carom_tracer::sampling::{pixel_key, uniforms};
use carom_tracer::{
    Camera, CompiledScene, DeviceInfo, DeviceKind, Environment, Error, Lens, Material, Object,
    RenderSettings, Scene, SceneError, Shape, Tile, TileRadiance, TraceJob, TraceStats, Tracer,
};
use glam::{Quat, Vec3};

/// A device whose pixels are a hash of their position and of what they show.
pub struct PatternTracer {
    pace: Duration,
    fault: Option<DeviceFault>,
    /// Tiles left before the fault, which persists unless its gate has opened.
    tiles_left: AtomicU32,
}

/// A fault of a device.
#[derive(Clone)]
pub enum DeviceFault {
    /// It returns an error.
    Error,
    /// It returns pixels that are 1.5 times as bright, from the first tile on.
    Forgery,
    /// It returns an error that blames the scene.
    Refusal,
    /// It panics.
    Panic,
    /// It hangs until the gate opens.
    Hang(Gate),
}

/// A gate at which a device hangs.
#[derive(Clone, Default)]
pub struct Gate(Arc<(Mutex<GateState>, Condvar)>);

#[derive(Default)]
struct GateState {
    open: bool,
    reached: bool,
}

impl Gate {
    /// A closed gate.
    pub fn closed() -> Self {
        Self::default()
    }

    /// Opens the gate for good.
    pub fn open(&self) {
        self.0.0.lock().unwrap().open = true;
        self.0.1.notify_all();
    }

    /// Waits until a device hangs at it.
    pub fn wait_until_reached(&self) {
        let state = self.0.0.lock().unwrap();
        drop(self.0.1.wait_while(state, |state| !state.reached).unwrap());
    }

    fn pass(&self) {
        let mut state = self.0.0.lock().unwrap();
        state.reached = true;
        self.0.1.notify_all();
        drop(self.0.1.wait_while(state, |state| !state.open).unwrap());
    }
}

impl Default for PatternTracer {
    fn default() -> Self {
        Self {
            pace: Duration::ZERO,
            fault: None,
            tiles_left: AtomicU32::new(0),
        }
    }
}

impl PatternTracer {
    /// A sound device without artificial delay.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets the additional time per tile, in µs.
    pub fn with_pace(mut self, micros: u64) -> Self {
        self.pace = Duration::from_micros(micros);
        self
    }

    /// Makes it fail when it has traced `after_tiles`.
    pub fn with_fault(mut self, fault: DeviceFault, after_tiles: u32) -> Self {
        self.fault = Some(fault);
        self.tiles_left = AtomicU32::new(after_tiles);
        self
    }

    fn fail(&self) -> Result<(), Error> {
        let left = |left: u32| left.checked_sub(1);
        let healthy = self
            .tiles_left
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, left);
        match &self.fault {
            _ if healthy.is_ok() => Ok(()),
            None => Ok(()),
            Some(DeviceFault::Forgery) => Ok(()),
            Some(DeviceFault::Error) => Err(Error::Device {
                device: "pattern".into(),
                message: "it was told to fail".into(),
            }),
            Some(DeviceFault::Refusal) => Err(Error::InvalidScene(SceneError::TooMany {
                what: "objects",
                count: 9,
                max: 4,
            })),
            Some(DeviceFault::Panic) => panic!("it was told to panic"),
            Some(DeviceFault::Hang(gate)) => {
                gate.pass();
                Ok(())
            }
        }
    }
}

impl Tracer for PatternTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "pattern".into(),
            width: 1,
            threads: 1,
        }
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        for (index, tile) in job.tiles.iter().enumerate() {
            if job.cancelled.load(Ordering::Relaxed) {
                break;
            }
            self.fail()?;
            let mut radiance = tile_radiance(*tile, &scene.camera, &job.settings);
            if matches!(self.fault, Some(DeviceFault::Forgery)) {
                let channels = radiance.iter_mut().flatten();
                channels.for_each(|channel| *channel *= 1.5);
            }
            if !self.pace.is_zero() {
                std::thread::sleep(self.pace); // the work of a slow device
            }
            sink(TileRadiance {
                index,
                radiance,
                dropped_samples: 0,
            });
        }
        Ok(TraceStats::default())
    }
}

/// The expected picture of `spec` in [`scene`].
pub fn picture(spec: &FrameSpec) -> Vec<[f32; 3]> {
    picture_of(&scene(), spec)
}

/// The expected picture of `spec` in a scene.
pub fn picture_of(scene: &Scene, spec: &FrameSpec) -> Vec<[f32; 3]> {
    let tile = Tile {
        x: 0,
        y: 0,
        width: spec.size.width,
        height: spec.size.height,
    };
    tile_radiance(tile, &scene.camera, &spec.settings)
}

/// Radiance of a tile: the mean over the requested samples.
fn tile_radiance(tile: Tile, camera: &Camera, settings: &RenderSettings) -> Vec<[f32; 3]> {
    let rows = tile.y..tile.y + tile.height;
    let pixels = rows.flat_map(|y| (tile.x..tile.x + tile.width).map(move |x| pixel_key(x, y)));
    let block = camera.eye.z.to_bits();
    let samples = settings.first_sample..settings.first_sample + settings.samples;
    let radiance = |pixel| {
        let mut sum = [0.0; 3];
        for sample in samples.clone() {
            let values = uniforms(pixel, sample, block, settings.seed);
            for (sum, value) in sum.iter_mut().zip(values) {
                *sum += f64::from(value);
            }
        }
        sum.map(|sum| (sum / samples.len() as f64) as f32)
    };
    pixels.map(radiance).collect()
}

/// A ball in grey light.
pub fn scene() -> Scene {
    Scene {
        camera: Camera {
            eye: Vec3::new(0.0, -3.0, 1.0),
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 40.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::splat(0.5),
        },
        materials: [(
            "chalk".to_owned(),
            Material::Diffuse {
                albedo: Vec3::splat(0.8),
            },
        )]
        .into(),
        objects: vec![Object {
            name: "ball".into(),
            material: "chalk".into(),
            shape: Shape::Sphere {
                center: Vec3::ZERO,
                radius: 0.5,
                rotation: Quat::IDENTITY,
            },
        }],
        area_lights: Vec::new(),
        ..Scene::new()
    }
}
