//! The interface between tracers and their users: takes jobs, delivers tiles of radiance.

use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use crate::tonemap::srgb8;
use crate::{CompiledScene, Error, ImageSize, RenderSettings, Tile, TileAovs};

/// A device that traces tiles. It has no state but caches and may be called from several threads at
/// once: a GPU then has two frames in flight.
pub trait Tracer: Send + Sync {
    /// Description of the device.
    fn info(&self) -> DeviceInfo;

    /// Whether a job with these settings can start at once. A device that needs preparation returns
    /// false, such as a GPU that takes seconds to compile the kernels for such a scene; the next
    /// job prepares it.
    fn is_ready(&self, _scene: &CompiledScene, _settings: &RenderSettings) -> bool {
        true
    }

    /// Traces all tiles of `job` and passes each to `sink` when it is finished, in any order and
    /// possibly from several threads at once. Returns after the last tile, or early if
    /// [`TraceJob::cancelled`] becomes true.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost or refuses; tiles that were handed over before are
    /// valid.
    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error>;

    /// As [`Tracer::trace`], but hands over tone-mapped tiles: those of [`crate::tonemap::srgb8`]
    /// with `exposure`, up to one level where a device rounds differently.
    ///
    /// # Errors
    /// As for [`Tracer::trace`].
    fn trace_srgb8(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: f32,
        sink: &(dyn Fn(TileSrgb8) + Sync),
    ) -> Result<TraceStats, Error> {
        self.trace(scene, job, &|tile| sink(tile.srgb8(exposure)))
    }

    /// Traces the AOVs of the first hits of `job`'s samples, and hands them over as
    /// [`Tracer::trace`] does.
    ///
    /// # Errors
    /// As for [`Tracer::trace`]; by default [`Error::Device`], for tracers without AOVs.
    fn aovs(
        &self,
        _scene: &CompiledScene,
        _job: &TraceJob<'_>,
        _sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        Err(Error::Device {
            device: self.info().name,
            message: "it traces radiance alone, no albedo, normals or depth".to_owned(),
        })
    }
}

/// What to trace of a scene, and how.
#[derive(Clone, Copy, Debug)]
pub struct TraceJob<'a> {
    /// The whole image, of which the tiles are parts.
    pub size: ImageSize,
    /// Tiles inside `size`.
    pub tiles: &'a [Tile],
    /// Samples, maximum depth and seed.
    pub settings: RenderSettings,
    /// Checked now and then; `true` ends the job early.
    pub cancelled: &'a AtomicBool,
}

impl TraceJob<'_> {
    /// Checks the image size, the settings, and that all tiles lie in the image.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] with the value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        self.size.validate()?;
        self.settings.validate()?;
        let inside = |first: u32, count: u32, end: u32| {
            count > 0 && first.checked_add(count).is_some_and(|last| last <= end)
        };
        for tile in self.tiles {
            if !inside(tile.x, tile.width, self.size.width)
                || !inside(tile.y, tile.height, self.size.height)
            {
                return Err(Error::settings(format!(
                    "a tile of {}x{} pixels at ({}, {}) does not lie in an image of {}",
                    tile.width, tile.height, tile.x, tile.y, self.size
                )));
            }
        }
        Ok(())
    }
}

/// A finished tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileRadiance {
    /// Index into [`TraceJob::tiles`].
    pub index: usize,
    /// Mean radiance per pixel over the job's samples, in row-major order:
    /// `tile.width × tile.height`.
    pub radiance: Vec<[f32; 3]>,
    /// Number of samples that were not finite and count as black.
    pub dropped_samples: u32,
}

impl TileRadiance {
    /// The tile tone mapped by [`srgb8`] with `exposure`.
    pub fn srgb8(&self, exposure: f32) -> TileSrgb8 {
        let mut pixels = Vec::with_capacity(self.radiance.len());
        pixels.extend(self.radiance.iter().map(|light| srgb8(*light, exposure)));
        TileSrgb8 {
            index: self.index,
            pixels,
            dropped_samples: self.dropped_samples,
        }
    }
}

/// A finished, tone-mapped tile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileSrgb8 {
    /// Index into [`TraceJob::tiles`].
    pub index: usize,
    /// 8-bit sRGB in row-major order: `tile.width × tile.height`.
    pub pixels: Vec<[u8; 3]>,
    /// Number of samples that were not finite and count as black.
    pub dropped_samples: u32,
}

/// Statistics of a call of [`Tracer::trace`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceStats {
    /// Number of paths started.
    pub samples: u64,
    /// Number of rays including shadow rays; 0 if the device does not count them.
    pub rays: u64,
    /// Time in nanoseconds as measured by the device; 0 if it measures none.
    pub device_nanos: u64,
    /// The part of `device_nanos` spent on first hits for the denoiser.
    pub first_hits_nanos: u64,
    /// The part of `device_nanos` spent on the denoiser's filter.
    pub filter_nanos: u64,
}

impl std::ops::AddAssign for TraceStats {
    fn add_assign(&mut self, more: Self) {
        self.samples += more.samples;
        self.rays += more.rays;
        self.device_nanos += more.device_nanos;
        self.first_hits_nanos += more.first_hits_nanos;
        self.filter_nanos += more.filter_nanos;
    }
}

/// Kind of device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceKind {
    /// The SIMD tracer, on several threads.
    Cpu,
    /// The compute-shader tracer.
    Gpu,
    /// The scalar f64 tracer.
    Scalar,
}

/// Description of a device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceInfo {
    /// Kind of device.
    pub kind: DeviceKind,
    /// For display: processor or adapter, and the instruction set or driver in use.
    pub name: String,
    /// SIMD lanes; 1 for a GPU.
    pub width: u32,
    /// Number of threads; 1 for a GPU.
    pub threads: u32,
}
