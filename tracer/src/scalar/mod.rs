//! The scalar path tracer: f64, one sample at a time, with the random numbers of the fast tracers.
//!
//! # Estimator
//! The fast tracers follow it sample for sample, to the rounding of f32. With `k` the
//! depth, from 0, and `u = sampling::pair(pixel, sample, block, seed)`:
//!
//! 1. **Camera.** The ray goes through film position `pixel + u` of block `BLOCK_CAMERA`, and through the point of the lens
//!    of block `BLOCK_LENS`.
//! 2. **Edge.** The nearest primitive with `t > 0` is hit, the first of equals in the order
//!    spheres, boxes, discs, rectangles, CSG boxes, triangles, area lights. The primitive that the ray leaves is skipped: each
//!    is convex, so an outward ray cannot meet it again, and no origin need be offset; a ray inside
//!    a dielectric meets that body's far side and no other of its own, or any triangle of a mesh ([`triangle`]). There it flies freely first:
//!    it is scattered after `−ln(1 − u[1]) / sampling_density` metres if that is nearer, with `u` of block
//!    `block_choice(k)`, evenly by `block_scatter(k)`, which counts as a scattering. A ray that
//!    meets nothing adds `beta · environment` and ends. A ray that meets an area light ends; from the
//!    front it adds `beta · radiance · w`, where `w` is 1 for camera rays and after what has no
//!    density (a metal mirror, smooth glass, a medium), 0 where step 3 has added the area lights (after a
//!    coat's mirror, and where light that was scattered inside a ball is joined by [`refracted_nee`]),
//!    else the power heuristic of the pdf against `brightness / light_weight_sum`. After
//!    `max_depth` scattering events a ray that meets a surface ends black.
//! 3. **Light.** The coat's share: if the nearest area light in the mirror's direction is met from the
//!    front and nothing is in between, adds `beta · F · radiance`; where the path is regularised
//!    ([`crate::regularisation`]) it is part of the other lobes', weighed by 1. The other lobes' (block
//!    `block_light(k)`): an area light drawn by brightness times solid angle with `u[0]`, which is then
//!    stretched to [0, 1) again, and a direction uniform in its solid angle, or, where that is below
//!    [`AreaLightData::SOLID_ANGLE_MIN`], a point uniform in its area. Unless something is in between, adds
//!    `beta · f · cos · radiance / pdf · w`, `w` weighing the same two densities as in step 2,
//!    where `f` leaves out mirrors, and directions into a dielectric are. Inside a ball that allows it
//!    the same point is aimed at by the path refracted at the boundary, if
//!    that counts as a scattering that is left: a point that light falls on from `spread` per
//!    solid angle.
//! 4. **Scattering** (block `block_scatter(k)`). A surface that emits adds `beta · emission · w`, at camera rays too. Metals and
//!    dielectrics: [`microfacet`], whose choice to reflect takes `u[0]` of `block_choice(k)`, as that of
//!    [`mod@metallic_roughness`]. Others: with `F` the Fresnel reflectance seen
//!    from `wo` and `a` the channel mean of the albedo at the hit, the mirror is chosen if `u[0]` is
//!    below `p = F / (F + (1−F)·a)` (0 where `F` is 0), with weight `F/p`. Else `u[0]` is stretched
//!    to [0, 1) again and `wi` drawn by the cosine: `(√u[0]·cos 2πu[1], √u[0]·sin 2πu[1],
//!    √(1−u[0]))` in the basis of [`basis::basis`], pdf `(1−p)·cos/π`, weight `f·cos / pdf`. A path
//!    whose weight is 0 ends. A rough coat is here, as in step 3, the mirror of one of its microfacets (block
//!    `block_coat(k)`, [`bsdf::Bsdf::with_facet`]), whose reflectance `F·G₁` takes the place of `F` seen from `wo`. Denoised
//!    pictures find its light along the path, as that of a rough metal, not beside first hits.
//!
//! What each part is worth at 16 samples on the pool table (relMSE; the whole 2.8e-4, 2.85 rays a
//! sample): points of step 1 that are independent, 1.5e-3; area lights drawn uniformly, 3.9e-4; area lights by
//! chance alone after the mirror, 7.5e-4; the balance heuristic, 1.1e-3. What would cost more than
//! it is worth: every area light at each scattering, 2.6e-4 for 3.75 rays.
//!
//! What goes straight on through a smooth thin wall has no density, as behind smooth glass.
//!
//! A constant environment is found by scattering alone. An environment map is aimed at instead of an area light with
//! probability [`CompiledEnvironment::probability`] by `u[0]` of `block_light(k)`, which is then stretched to [0, 1) again, and
//! weighed in the same way; what coats and media lead to it counts in full. Before both, [`mod@punctual_light`]s have their
//! share of `u[0]`, which chance does not find, and before all surfaces that emit ([`mod@emissive_surface`]), whose
//! light is weighed as that of an environment map where chance finds it, at the last vertex too. From the second vertex on, paths outside of bodies that would bring
//! little light are ended by Russian roulette ([`crate::sampling::SURVIVAL_PER_THROUGHPUT`]). There is no clamping; a
//! sample that is not finite counts as black and is reported.
//!
//! [`intersect()`], [`camera_ray`] and [`bsdf::Bsdf`] are public for tests of each part.

mod aov;
pub mod area_light;
pub mod basis;
pub mod bsdf;
pub mod csg;
pub mod emissive_surface;
pub mod environment;
pub mod ggx;
mod integrator;
pub mod intersect;
mod light_sampling;
pub mod medium;
pub mod metallic_roughness;
pub mod microfacet;
mod normal_map;
pub mod punctual_light;
mod ray;
pub mod refracted_nee;
pub mod scatter;
mod textured;
pub mod triangle;
mod vertex;

use std::sync::atomic::Ordering;

use rayon::prelude::*;

#[cfg(doc)]
use crate::compiled::{AreaLightData, CompiledEnvironment};
use crate::denoise::{
    DenoiseInput, DenoiseInputTile, DenoiseSource, FilterMemory, SampleSums, trace_denoised,
};
use crate::simd::Level;
use crate::tracer::{DeviceInfo, DeviceKind, TileRadiance, TraceJob, TraceStats, Tracer};
use crate::{Aovs, CompiledScene, Error, ImageSize, RenderSettings, TileAovs};
pub use integrator::camera_ray;
use integrator::{PathTracer, TileRow};
pub use intersect::{Hit, Ray, intersect};

/// The f64 path tracer of this module, over rayon's threads.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScalarTracer;

impl Tracer for ScalarTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            kind: DeviceKind::Scalar,
            name: "f64 scalar".to_owned(),
            width: 1,
            threads: rayon::current_num_threads() as u32,
        }
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        job.validate()?;
        if job.settings.denoise {
            let memory = FilterMemory::default();
            return trace_denoised(self, Level::new(), &memory, scene, job, sink);
        }
        Ok(PathTracer::new(scene, job).trace(job, |index, _, rows| {
            sink(TileRadiance {
                index,
                dropped_samples: rows.iter().map(|row| row.dropped_samples).sum(),
                radiance: rows.into_iter().flat_map(|row| row.radiance).collect(),
            });
        }))
    }

    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        job.validate()?;
        let tracer = PathTracer::new(scene, job);
        job.tiles.par_iter().enumerate().for_each(|(index, &tile)| {
            if !job.cancelled.load(Ordering::Relaxed) {
                let pixels = tracer.aovs(tile);
                sink(TileAovs { index, pixels });
            }
        });
        Ok(())
    }
}

impl DenoiseSource for ScalarTracer {
    fn trace_denoise_input(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(DenoiseInputTile) + Sync),
    ) -> Result<TraceStats, Error> {
        let tracer = PathTracer::new(scene, job);
        Ok(tracer.trace(job, |index, tile, rows| {
            let hits = tracer.aovs(tile);
            let dropped_samples = rows.iter().map(|row| row.dropped_samples).sum();
            sink(DenoiseInputTile {
                index,
                tile,
                pixels: denoise_input(job.settings.samples, &rows, &hits),
                dropped_samples,
            });
        }))
    }

    fn trace_hits(
        &self,
        scene: &CompiledScene,
        size: ImageSize,
        settings: RenderSettings,
        pixels: &[(u32, u32)],
    ) -> Vec<Aovs> {
        let frame = scene.camera_frame(size);
        let tracer = PathTracer {
            scene,
            frame,
            settings,
        };
        let pixels = pixels.par_iter();
        pixels.map(|&(x, y)| tracer.pixel_aovs(x, y)).collect()
    }
}

fn denoise_input(samples: u32, rows: &[TileRow], hits: &[Aovs]) -> DenoiseInput {
    let aovs = |hits: &[Aovs]| columns(hits.iter().map(Aovs::columns));
    let radiance = columns(rows.iter().flat_map(|row| row.radiance.iter().copied()));
    let half = columns(rows.iter().flat_map(|row| row.half.iter().copied()));
    let hits = aovs(hits);
    let mut pixels = DenoiseInput::default();
    pixels.extend(
        samples,
        &SampleSums {
            counts: [1; 2],
            radiance: radiance.each_ref().map(Vec::as_slice),
            half: half.each_ref().map(Vec::as_slice),
            hits: hits.each_ref().map(Vec::as_slice),
        },
    );
    pixels
}

fn columns<const N: usize>(pixels: impl Iterator<Item = [f32; N]>) -> [Vec<f32>; N] {
    let mut columns = [const { Vec::new() }; N];
    for pixel in pixels {
        for (column, value) in columns.iter_mut().zip(pixel) {
            column.push(value);
        }
    }
    columns
}
