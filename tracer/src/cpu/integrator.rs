//! The path tracer as stages over a stream: extend, shade, connect, until all paths have ended.
//!
//! Next-event estimation towards the lamps and directions from the BSDF are weighed by the power
//! heuristic (Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, §9.2);
//! the environment is found by the BSDF's directions alone.

use fearless_simd::{i32x16, prelude::*};

use super::bsdf::Bsdf;
use super::geometry::{Geometry, INSIDE, NONE, Nearest, Rays};
use super::gloss::{SCATTERED, untagged};
use super::lanes::{Float, Mask, Vec3x, Word};
use super::sampling::uniforms;
use super::stream::{Packet, Stream, load, load_words, packets, store, store_words};
use super::surface::{Hit, Rows, Surfaces};
use crate::compiled::{CameraFrame, CompiledScene, LampData};
use crate::sampling::{BLOCK_CAMERA, block_light, block_scatter};
use crate::{ImageSize, RenderSettings};

/// A scene for one picture, laid out for the lanes.
pub(super) struct Prepared {
    camera: CameraFrame,
    pub(super) environment: [f32; 3],
    pub(super) geometry: Geometry,
    pub(super) surfaces: Surfaces,
    pub(super) lamps: Vec<LampRow>,
    pub(super) settings: RenderSettings,
}

pub(super) type LampRow = [f32; 16];

const LAMP_CENTER: usize = 0;
const LAMP_HALF_U: usize = 3;
const LAMP_HALF_V: usize = 6;
pub(super) const LAMP_NORMAL: usize = 9;
pub(super) const LAMP_RADIANCE: usize = 12;
/// Area times the number of lamps: the inverse density of a point on any of them.
const LAMP_AREA: usize = 15;

impl Prepared {
    pub(super) fn new(scene: &CompiledScene, size: ImageSize, settings: RenderSettings) -> Self {
        let count = scene.lamps.len() as f32;
        Self {
            camera: scene.camera_frame(size),
            environment: scene.environment.to_array(),
            geometry: Geometry::new(scene),
            surfaces: Surfaces::new(scene),
            lamps: scene.lamps.iter().map(|l| lamp_row(l, count)).collect(),
            settings,
        }
    }

    /// Traces the paths of `stream`, whose pixels, samples and slots are set, to their end.
    /// Returns the number of rays.
    #[inline(always)]
    pub(super) fn trace<S: Simd>(&self, simd: S, stream: &mut Stream) -> u64 {
        let mut rays = 0;
        let scatterings_max = self.settings.scatterings_max;
        simd.vectorize(
            #[inline(always)]
            || self.generate(simd, stream),
        );
        for bounce in 0..=scatterings_max {
            let last = bounce == scatterings_max;
            rays += stream.len as u64;
            simd.vectorize(
                #[inline(always)]
                || self.extend(simd, stream, bounce, last),
            );
            if stream.len == 0 {
                break;
            }
            simd.vectorize(
                #[inline(always)]
                || self.shade(simd, stream, bounce),
            );
            if !self.lamps.is_empty() {
                rays += simd.vectorize(
                    #[inline(always)]
                    || self.connect(simd, stream),
                );
            }
        }
        rays
    }

    /// Camera rays through a random point of each path's pixel.
    #[inline(always)]
    fn generate<S: Simd>(&self, simd: S, stream: &mut Stream) {
        let eye = self.eye(simd);
        let one = Float::splat(simd, 1.0);
        for Packet { at, .. } in packets(stream.len) {
            let pixel = load_words(simd, &stream.pixel, at);
            let sample = load_words(simd, &stream.sample, at);
            let direction = self.camera_direction(simd, pixel, sample);
            let inverse_length = one / direction.length_squared().sqrt();
            stream.origin.store(at, eye);
            stream.direction.store(at, direction * inverse_length);
            stream.beta.store(at, Vec3x::new(one, one, one));
            stream.radiance.store(at, Vec3x::splat(simd, [0.0; 3]));
            store(&mut stream.pdf, at, Float::splat(simd, f32::INFINITY));
            store_words(&mut stream.primitive, at, Word::splat(simd, NONE));
        }
    }

    #[inline(always)]
    pub(super) fn eye<S: Simd>(&self, simd: S) -> Vec3x<S> {
        Vec3x::splat(simd, self.camera.eye)
    }

    /// Where a sample's camera ray goes: of length 1 along the camera's axis.
    #[inline(always)]
    pub(super) fn camera_direction<S: Simd>(
        &self,
        simd: S,
        pixel: Word<S>,
        sample: Word<S>,
    ) -> Vec3x<S> {
        let camera = &self.camera;
        let corner = Vec3x::splat(simd, camera.corner);
        let (dx, dy) = (Vec3x::splat(simd, camera.dx), Vec3x::splat(simd, camera.dy));
        let u = uniforms(simd, pixel, sample, BLOCK_CAMERA, self.settings.seed);
        let (x, y) = (small_to_float(pixel & 0xffff), small_to_float(pixel >> 16));
        // Whole pixels first: x + u would cost wide images the digits of u.
        let at_pixel = dx.mul_add(x, dy.mul_add(y, corner));
        dx.mul_add(u[0], dy.mul_add(u[1], at_pixel))
    }

    /// Finds what each path meets next, ends those that meet light or nothing, or all if this is
    /// their last edge, and closes the ranks of the others.
    #[inline(always)]
    fn extend<S: Simd>(&self, simd: S, stream: &mut Stream, bounce: u32, last: bool) {
        let mut kept = 0;
        for packet in packets(stream.len) {
            let at = packet.at;
            let origin = stream.origin.load(simd, at);
            let direction = stream.direction.load(simd, at);
            let skip = load_words(simd, &stream.primitive, at);
            let rays = Rays::new(simd, origin, direction, skip);
            let mut nearest = self.geometry.nearest(simd, &rays);
            let alive = packet.mask(simd);
            let mut met = nearest.id;
            if self.surfaces.has_clear {
                self.fly(simd, stream, at, bounce, &mut nearest);
                met = untagged(nearest.id);
            }
            let unscattered = met.simd_ge(self.geometry.lamps_first) & alive;
            if unscattered.any_true() {
                let light_id = unscattered.select(nearest.id, Word::splat(simd, NONE));
                let mut light = self.found_light(simd, stream, at, nearest.distance, light_id);
                if self.settings.denoise && bounce <= 1 {
                    light = self.without_emission(simd, stream, at, light);
                }
                let radiance = stream.radiance.load(simd, at);
                stream.finish(packet, unscattered, radiance + light);
            }
            let scattering = alive & !unscattered;
            if last {
                let radiance = stream.radiance.load(simd, at);
                stream.finish(packet, scattering, radiance);
            } else {
                store(&mut stream.distance, at, nearest.distance);
                store_words(&mut stream.primitive, at, nearest.id);
                kept = stream.keep(simd, packet, scattering, kept);
            }
        }
        stream.len = kept;
    }

    /// Flies through what fills clear bodies: light is absorbed, and may be scattered before the
    /// boundary.
    #[inline(always)]
    fn fly<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        at: usize,
        bounce: u32,
        nearest: &mut Nearest<S>,
    ) {
        let skip = load_words(simd, &stream.primitive, at);
        let none = Word::splat(simd, NONE);
        let within = (skip & INSIDE).simd_ne(0) & skip.simd_ne(none);
        if !within.any_true() {
            return;
        }
        let pixel = load_words(simd, &stream.pixel, at);
        let sample = load_words(simd, &stream.sample, at);
        let [.., u] = uniforms(
            simd,
            pixel,
            sample,
            block_scatter(bounce),
            self.settings.seed,
        );
        let flight = self.surfaces.fly(simd, within, skip, nearest.distance, u);
        let beta = stream.beta.load(simd, at);
        stream.beta.store(at, beta.scale(flight.weight));
        nearest.distance = flight.distance;
        nearest.id = flight.scattered.select(skip | SCATTERED, nearest.id);
    }

    /// Light that comes in along rays that meet a lamp or nothing.
    #[inline(always)]
    fn found_light<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        distance: Float<S>,
        id: Word<S>,
    ) -> Vec3x<S> {
        let beta = stream.beta.load(simd, at);
        let environment = beta.scale(Vec3x::splat(simd, self.environment));
        let escaped = id.simd_eq(NONE);
        if escaped.all_true() || self.lamps.is_empty() {
            return environment;
        }
        let first = self.geometry.lamps_first;
        let lit = id.simd_ge(first) & !escaped;
        let lamp = lit.select(id - first, Word::splat(simd, 0));
        let rows = Rows::new(&self.lamps, lamp);
        let direction = stream.direction.load(simd, at);
        let cos_lamp = -direction.dot(rows.triple(simd, LAMP_NORMAL));
        let inverse_pdf = cos_lamp * rows.number(simd, LAMP_AREA) / (distance * distance);
        let pdf = load(simd, &stream.pdf, at);
        let weight = power_heuristic(1.0 / (pdf * inverse_pdf));
        let unweighted = pdf.simd_eq(f32::INFINITY);
        let weight = unweighted.select(Float::splat(simd, 1.0), weight);
        let emitted = beta.scale(rows.triple(simd, LAMP_RADIANCE)) * weight;
        let black = Vec3x::splat(simd, [0.0; 3]);
        let emitted = Vec3x::select(lit & cos_lamp.simd_gt(0.0), emitted, black);
        Vec3x::select(escaped, environment, emitted)
    }

    /// Leaves out light that is in the emission of first hits, which is traced apart.
    #[inline(always)]
    fn without_emission<S: Simd>(
        &self,
        simd: S,
        stream: &Stream,
        at: usize,
        light: Vec3x<S>,
    ) -> Vec3x<S> {
        let scattered = load(simd, &stream.pdf, at).simd_lt(f32::INFINITY);
        let left = load_words(simd, &stream.primitive, at);
        let within = (left & INSIDE).simd_ne(0) & left.simd_ne(NONE);
        Vec3x::select(scattered | within, light, Vec3x::splat(simd, [0.0; 3]))
    }

    /// Scatters each path where it hit: a shadow ray towards a lamp and the path's next direction.
    #[inline(always)]
    fn shade<S: Simd>(&self, simd: S, stream: &mut Stream, bounce: u32) {
        for packet in packets(stream.len) {
            let at = packet.at;
            let alive = packet.mask(simd);
            let tag = load_words(simd, &stream.primitive, at);
            let tag = alive.select(tag, Word::splat(simd, tag[0]));
            let origin = stream.origin.load(simd, at);
            let direction = stream.direction.load(simd, at);
            let distance = load(simd, &stream.distance, at);
            let hit = self.surfaces.hit(simd, origin, direction, distance, tag);
            let bsdf = Bsdf::new(simd, &hit, -direction);
            let beta = stream.beta.load(simd, at);
            let pixel = load_words(simd, &stream.pixel, at);
            let sample = load_words(simd, &stream.sample, at);
            let seed = self.settings.seed;
            if !self.lamps.is_empty() {
                let u = uniforms(simd, pixel, sample, block_light(bounce), seed);
                self.aim_at_lamp(simd, stream, packet, &hit, &bsdf, beta, u);
            }
            let [lobe, u1, u2, _] = uniforms(simd, pixel, sample, block_scatter(bounce), seed);
            let mut inside = Mask::splat(simd, false);
            let scattered = bsdf.sample(simd, [lobe, u1, u2], &mut inside);
            stream.origin.store(at, hit.position);
            stream.direction.store(at, scattered.wi);
            stream.beta.store(at, beta.scale(scattered.weight));
            store(&mut stream.pdf, at, scattered.pdf);
            let mut left = tag;
            if self.surfaces.has_clear {
                left = untagged(tag);
                left = inside.select(left | INSIDE, left);
            }
            store_words(&mut stream.primitive, at, left);
        }
    }

    /// Next-event estimation: a shadow ray towards a random point of a random lamp.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "one packet's values, all in registers"
    )]
    fn aim_at_lamp<S: Simd>(
        &self,
        simd: S,
        stream: &mut Stream,
        Packet { at, lanes }: Packet,
        hit: &Hit<S>,
        bsdf: &Bsdf<S>,
        beta: Vec3x<S>,
        u: [Float<S>; 4],
    ) {
        let count = self.lamps.len() as u32;
        let index: i32x16<S> = (u[0] * count as f32).to_int();
        let index: Word<S> = index.bitcast();
        let index = index.min(count - 1);
        let rows = Rows::new(&self.lamps, index);
        let point = rows.triple(simd, LAMP_CENTER);
        let point = rows
            .triple(simd, LAMP_HALF_U)
            .mul_add(u[1] * 2.0 - 1.0, point);
        let point = rows
            .triple(simd, LAMP_HALF_V)
            .mul_add(u[2] * 2.0 - 1.0, point);
        let to_lamp = point - hit.position;
        let distance_squared = to_lamp.length_squared();
        let distance = distance_squared.sqrt();
        let wi = to_lamp * (1.0 / distance);
        let cos_i = hit.normal.dot(wi);
        let cos_lamp = -rows.triple(simd, LAMP_NORMAL).dot(wi);
        let inverse_pdf = cos_lamp * rows.number(simd, LAMP_AREA) / distance_squared;
        let (f_cos, bsdf_pdf) = bsdf.evaluate(simd, wi, cos_i);
        let weight = inverse_pdf * power_heuristic(bsdf_pdf * inverse_pdf);
        let emitted = rows.triple(simd, LAMP_RADIANCE);
        let lit = Packet { at, lanes }.mask(simd) & bsdf.sees(cos_i) & cos_lamp.simd_gt(0.0);
        let shadow = &mut stream.shadow;
        shadow.direction.store(at, wi);
        shadow
            .radiance
            .store(at, beta.scale(f_cos).scale(emitted) * weight);
        store(
            &mut shadow.distance,
            at,
            lit.select(distance, Float::splat(simd, 0.0)),
        );
        store_words(&mut shadow.lamp, at, index + self.geometry.lamps_first);
    }

    /// Adds the light of the shadow rays that reach their lamp. Returns how many were traced.
    #[inline(always)]
    fn connect<S: Simd>(&self, simd: S, stream: &mut Stream) -> u64 {
        let mut rays = 0;
        for Packet { at, .. } in packets(stream.len) {
            let distance = load(simd, &stream.shadow.distance, at);
            let lit: Mask<S> = distance.simd_gt(0.0);
            let traced = lit.to_bitmask().count_ones();
            if traced == 0 {
                continue;
            }
            rays += u64::from(traced);
            let origin = stream.origin.load(simd, at);
            let direction = stream.shadow.direction.load(simd, at);
            // Shadow rays leave outwards, whatever the path does.
            let skip = load_words(simd, &stream.primitive, at) & !INSIDE;
            let lamp = load_words(simd, &stream.shadow.lamp, at);
            let shadow_rays = Rays::new(simd, origin, direction, skip);
            let dark = self.geometry.occluded(simd, &shadow_rays, distance, lamp);
            let radiance = stream.radiance.load(simd, at);
            let added = radiance + stream.shadow.radiance.load(simd, at);
            let radiance = Vec3x::select(lit & !dark, added, radiance);
            stream.radiance.store(at, radiance);
        }
        rays
    }
}

fn lamp_row(lamp: &LampData, count: f32) -> LampRow {
    let mut row = [0.0; 16];
    row[LAMP_CENTER..][..3].copy_from_slice(&lamp.center);
    row[LAMP_HALF_U..][..3].copy_from_slice(&lamp.half_u);
    row[LAMP_HALF_V..][..3].copy_from_slice(&lamp.half_v);
    row[LAMP_NORMAL..][..3].copy_from_slice(&lamp.normal);
    row[LAMP_RADIANCE..][..3].copy_from_slice(&lamp.radiance);
    row[LAMP_AREA] = lamp.area * count;
    row
}

/// The power heuristic (β = 2) for a strategy beside another of `density_ratio` times its density.
/// By their quotient: the squares of densities towards tiny lamps would overflow.
#[inline(always)]
fn power_heuristic<S: Simd>(density_ratio: Float<S>) -> Float<S> {
    1.0 / density_ratio.mul_add(density_ratio, Float::splat(density_ratio.token(), 1.0))
}

/// Words below 2²³ as numbers: signed conversion is exact there and cheaper.
#[inline(always)]
fn small_to_float<S: Simd>(word: Word<S>) -> Float<S> {
    let bits: i32x16<S> = word.bitcast();
    bits.to_float()
}
