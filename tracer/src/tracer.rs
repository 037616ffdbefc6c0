//! The one seam between back ends: work in, tiles of radiance out.

use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use crate::tonemap::srgb8;
use crate::{CompiledScene, Error, ImageSize, RenderSettings, Tile, TileAovs};

/// A device that traces tiles. It keeps nothing between calls but caches, so that any number of
/// threads may call it at once: a GPU has two frames in flight when two threads do.
pub trait Tracer: Send + Sync {
    /// What the device is.
    fn info(&self) -> DeviceInfo;

    /// Whether a job of `settings` can begin at once. A device that has to prepare itself first says no, as a GPU does
    /// that takes seconds to compile the kernels for such a scene; its next job prepares it.
    fn is_ready(&self, _scene: &CompiledScene, _settings: &RenderSettings) -> bool {
        true
    }

    /// Traces every tile of `job`, handing each to `sink` as it is finished, in any order and
    /// perhaps from several threads at once. Returns when the last has been handed over, or early
    /// when [`TraceJob::cancelled`] turns true.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost or refuses; tiles already handed over are right.
    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error>;

    /// Traces like [`Tracer::trace`], and hands tiles over as they are shown: by [`crate::tonemap::srgb8`] of
    /// `exposure`, up to a step where a device rounds otherwise.
    ///
    /// # Errors
    /// As those of [`Tracer::trace`].
    fn trace_srgb8(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: f32,
        sink: &(dyn Fn(TileSrgb8) + Sync),
    ) -> Result<TraceStats, Error> {
        self.trace(scene, job, &|tile| sink(tile.srgb8(exposure)))
    }

    /// Finds what the camera rays of `job`'s samples meet first, and hands it over like
    /// [`Tracer::trace`].
    ///
    /// # Errors
    /// As those of [`Tracer::trace`]; by default [`Error::Device`], of a tracer that has radiance alone.
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

/// What to trace of a scene.
#[derive(Clone, Copy, Debug)]
pub struct TraceJob<'a> {
    /// The whole image, of which the tiles are parts.
    pub size: ImageSize,
    /// Tiles inside `size`.
    pub tiles: &'a [Tile],
    /// Samples, maximum depth and seed.
    pub settings: RenderSettings,
    /// Looked at now and then; `true` ends the work early.
    pub cancelled: &'a AtomicBool,
}

impl TraceJob<'_> {
    /// Checks the image's size, the settings and that each tile lies in the image.
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
    /// Mean radiance per pixel over the job's samples, row-major: `tile.width × tile.height`.
    pub radiance: Vec<[f32; 3]>,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u32,
}

impl TileRadiance {
    /// The tile as it is shown: by [`srgb8`] of `exposure`.
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

/// A finished tile as it is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TileSrgb8 {
    /// Index into [`TraceJob::tiles`].
    pub index: usize,
    /// 8-bit sRGB, row-major: `tile.width × tile.height`.
    pub pixels: Vec<[u8; 3]>,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u32,
}

/// What a call of [`Tracer::trace`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceStats {
    /// Paths begun.
    pub samples: u64,
    /// Rays traced, shadow rays among them; 0 where the device does not count them.
    pub rays: u64,
    /// Time the device itself measured, in nanoseconds; 0 where it measures none.
    pub device_nanos: u64,
    /// Of it, what first hits for the denoiser took.
    pub first_hits_nanos: u64,
    /// Of it, what the denoiser's filter took.
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

/// What kind of device traces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DeviceKind {
    /// SIMD over threads.
    Cpu,
    /// Compute shaders.
    Gpu,
    /// The scalar tracer.
    Scalar,
}

/// A device in words and numbers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceInfo {
    /// Kind of back end.
    pub kind: DeviceKind,
    /// For people: processor or adapter, and the instruction set or driver in use.
    pub name: String,
    /// Lanes of one instruction; 1 for a GPU.
    pub width: u32,
    /// Threads; 1 for a GPU.
    pub threads: u32,
}
