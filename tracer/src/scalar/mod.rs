//! Scalar path tracer: f64, one sample at a time, with the random numbers of the fast tracers.
//!
//! # Estimator
//! The fast tracers follow it sample by sample, up to the rounding of f32. With `k` the depth, from 0,
//! and `u = sampling::pair(pixel, sample, block, seed)`:
//!
//! 1. **Camera.** The ray goes through film position `pixel + u` of block `BLOCK_CAMERA`, and through the
//!    point of the lens of block `BLOCK_LENS`.
//! 2. **Edge.** The nearest primitive with `t > 0` is hit, at equal distances the first in the order
//!    spheres, boxes, discs, rectangles, CSG boxes, triangles, area lights. The primitive that the ray
//!    leaves is skipped: each is convex, so an outward ray cannot hit it again, and origins need no
//!    offset; a ray inside a dielectric hits the far side of that body and no other of its own, or any
//!    triangle of a mesh ([`triangle`]). Inside, free flight comes first: the path is scattered after
//!    `−ln(1 − u[1]) / sampling_density` metres if that is nearer, with `u` of block `block_choice(k)`,
//!    isotropically by `block_scatter(k)`, which counts as a scattering event. A ray that hits nothing
//!    adds `beta · environment` and ends. A ray that hits an area light ends; from the front it adds
//!    `beta · radiance · w`, where `w` is 1 for camera rays and after specular or volume scattering,
//!    which has no density (a metal mirror, smooth glass, a medium), 0 where step 3 has added the area
//!    lights (after a coat's mirror, and for light scattered inside a ball that is connected by
//!    [`refracted_nee`]), else the power heuristic of the pdf against `brightness / light_weight_sum`.
//!    After `max_depth` scattering events a ray that hits a surface ends black.
//! 3. **Light.** Coat: if the nearest area light in the mirror direction is hit from the front and not
//!    occluded, adds `beta · F · radiance`; where the path is regularised ([`crate::regularisation`]) the
//!    coat is instead part of the other lobes' estimate, with weight 1. Other lobes (block
//!    `block_light(k)`): an area light is drawn in proportion to brightness times solid angle with
//!    `u[0]`, which is then rescaled to [0, 1), and a direction uniform in its solid angle, or, where
//!    that is below [`AreaLightData::SOLID_ANGLE_MIN`], a point uniform in its area. Unless occluded,
//!    adds `beta · f · cos · radiance / pdf · w`, with the MIS weight `w` of the same two densities as in
//!    step 2; `f` excludes mirrors and directions into a dielectric. Inside a ball that allows it the
//!    same point is connected by a path refracted at the boundary, if a scattering event for the
//!    refraction is left; `spread` is the area at the light per solid angle inside.
//! 4. **Scattering** (block `block_scatter(k)`). A surface that emits adds `beta · emission · w`, for
//!    camera rays too. Metals and dielectrics: [`microfacet`], which chooses reflection by `u[0]` of
//!    `block_choice(k)`, as does [`mod@metallic_roughness`]. Others: with `F` the Fresnel reflectance
//!    seen from `wo` and `a` the channel mean of the albedo at the hit, the mirror is chosen if `u[0]` is
//!    below `p = F / (F + (1−F)·a)` (0 where `F` is 0), with weight `F/p`. Else `u[0]` is rescaled to
//!    [0, 1) and `wi` drawn with cosine density: `(√u[0]·cos 2πu[1], √u[0]·sin 2πu[1], √(1−u[0]))` in the
//!    basis of [`basis::basis`], pdf `(1−p)·cos/π`, weight `f·cos / pdf`. A path of weight 0 ends. A
//!    rough coat is here, as in step 3, the mirror of one of its microfacets (block `block_coat(k)`,
//!    [`bsdf::Bsdf::with_facet`]), whose reflectance `F·G₁` replaces `F` seen from `wo`. In denoised
//!    images its light is part of the path's radiance, as for a rough metal, not of the first-hit AOVs.
//!
//! Value of each part at 16 samples on the pool table, as the relMSE without it (2.8e-4 with all, at 2.85
//! rays per sample): independent points in step 1, 1.5e-3; area lights drawn uniformly, 3.9e-4; area lights
//! found by BSDF sampling alone after the coat's mirror, 7.5e-4; the balance heuristic, 1.1e-3. Sampling
//! every area light at each scattering event would give 2.6e-4 for 3.75 rays, which does not pay.
//!
//! Light straight through a smooth thin wall has no density, as behind smooth glass.
//!
//! A constant environment is found by BSDF sampling alone. Light sampling chooses an environment map
//! instead of an area light with probability [`CompiledEnvironment::probability`] by `u[0]` of
//! `block_light(k)`, which is then rescaled to [0, 1), and applies MIS in the same way; light from it via
//! coats and media has weight 1. Punctual lights ([`mod@punctual_light`]) have an interval of `u[0]`
//! before both, and no MIS, as BSDF sampling cannot hit them. Emissive surfaces
//! ([`mod@emissive_surface`]) have the first interval; their light is weighted like that of an
//! environment map where a path hits them, at the last vertex too. From the second vertex on, paths
//! outside bodies with low throughput are terminated by Russian roulette
//! ([`crate::sampling::SURVIVAL_PER_THROUGHPUT`]). There is no clamping; a sample that is not finite
//! counts as black and is reported.
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
