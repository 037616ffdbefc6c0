//! Triangles that emit, a lane each: [`crate::compiled::MeshLights`] says how they are drawn.

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::triangle::TriangleTables;
use super::triangle_surface::interpolate;
use crate::CompiledScene;
use crate::compiled::{AlphaTest, MESH_LIGHT_REACH, MeshLightData, MeshLights};

/// The triangles of a scene that emit, and all that tells what of them is seen.
pub(super) struct MeshLightSampler {
    lights: MeshLights,
    /// The same, if they are few.
    few: Vec<LightRow>,
    surfaces: TriangleTables,
    /// Emission depends on the place on some of them.
    emission_varies: bool,
}

impl MeshLightSampler {
    /// None without any.
    pub(super) fn new(scene: &CompiledScene) -> Option<Self> {
        (scene.mesh_lights.sixteenths > 0).then(|| {
            let (lights, surfaces) = (scene.mesh_lights.clone(), TriangleTables::new(scene));
            let tables = surfaces.alpha_test();
            let few = match lights.triangles.len() {
                0..=FEW_LIGHTS_MAX => (lights.triangles.iter())
                    .map(|light| LightRow::new(light, &tables))
                    .collect(),
                _ => Vec::new(),
            };
            Self {
                lights,
                few,
                surfaces,
                emission_varies: (0..scene.materials.len())
                    .any(|index| scene.emission_varies(index)),
            }
        })
    }

    /// With which light sampling aims at them.
    pub(super) fn probability(&self) -> f32 {
        self.lights.probability()
    }

    /// Draws a point for each of `lanes`; no light comes in the others. Out of line: scenes without are not to pay for it.
    #[inline(never)]
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        point: Vec3x<S>,
        u: [Float<S>; 2],
    ) -> MeshLightSample<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
                let drawn = match self.few.split_first() {
                    Some((first, others)) => draw_of_few(simd, first, others, u[0]),
                    None => self.draw(simd, lanes, u[0]),
                };
                let (before, probability) = (drawn.before, drawn.probability);
                let within = ((u[0] - before) / probability).max(zero).min(one);
                let root = within.sqrt();
                let weights = [one - root, root * (one - u[1]), root * u[1]];
                let corners = drawn.corners;
                let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let twice_area = across.length_squared().sqrt();
                let to_light = interpolate(corners, weights) - point;
                let distance2 = to_light.length_squared();
                let distance = distance2.sqrt();
                let wi = to_light * (one / distance);
                let cosine = (wi.dot(across) / twice_area).abs();
                // Triangles without area and points on their own plane bring nothing: 0 / 0.
                let is_seen = lanes & cosine.simd_gt(0.0) & distance.simd_gt(0.0);
                let per_angle = cosine / (distance2 * self.probability());
                let emission = match self.emission_varies {
                    true => self.emission(simd, lanes, &drawn.triangles.to_array(), weights),
                    false => drawn.emission,
                };
                let radiance = emission * (0.5 * twice_area * per_angle / probability);
                let forward = Vec3x::splat(simd, [0.0, 0.0, 1.0]);
                let black = Vec3x::splat(simd, [0.0; 3]);
                MeshLightSample {
                    wi: Vec3x::select(is_seen, wi, forward),
                    distance: is_seen.select(distance * MESH_LIGHT_REACH, zero),
                    inverse_density: is_seen.select(per_angle / drawn.point_density, zero),
                    radiance: Vec3x::select(is_seen, radiance, black),
                }
            },
        )
    }

    /// A triangle for each of `lanes`, by a number in [0, 1).
    #[inline(always)]
    fn draw<S: Simd>(&self, simd: S, lanes: Mask<S>, u: Float<S>) -> DrawnTriangles<S> {
        let tables = self.surfaces.alpha_test();
        let (lanes, u) = (lanes.to_bitmask(), u.to_array());
        let mut triangles = [0; LANES];
        let mut columns = [[0.0; LANES]; LIGHT_NUMBERS];
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let row = LightRow::new(self.lights.triangle(u[lane]), &tables);
            triangles[lane] = row.triangle;
            for (column, number) in columns.iter_mut().zip(row.numbers) {
                column[lane] = number;
            }
        }
        let mut numbers = [Float::splat(simd, 0.0); LIGHT_NUMBERS];
        for (lanes, column) in numbers.iter_mut().zip(columns) {
            *lanes = Float::load_array(simd, column);
        }
        DrawnTriangles::new(Word::load_array(simd, triangles), numbers)
    }

    /// What each lane's triangle emits where corners have these weights.
    #[inline(never)]
    fn emission<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        triangles: &[u32; LANES],
        weights: [Float<S>; 3],
    ) -> Vec3x<S> {
        let tables = self.surfaces.alpha_test();
        let weights = weights.map(Float::<S>::to_array);
        let mut columns = [[0.0; LANES]; 3];
        let bits = lanes.to_bitmask();
        for lane in (0..LANES).filter(|lane| bits >> lane & 1 == 1) {
            let emission = tables.emission(triangles[lane], weights.map(|weight| weight[lane]));
            for (column, channel) in columns.iter_mut().zip(emission.to_array()) {
                column[lane] = channel;
            }
        }
        Vec3x::load_arrays(simd, &columns)
    }
}

/// A triangle for each lane, by a number in [0, 1). Of few, each is looked at: faster than to fetch a row for each lane.
#[inline(always)]
fn draw_of_few<S: Simd>(
    simd: S,
    first: &LightRow,
    others: &[LightRow],
    u: Float<S>,
) -> DrawnTriangles<S> {
    let mut triangles = Word::splat(simd, first.triangle);
    let mut numbers = [Float::splat(simd, 0.0); LIGHT_NUMBERS];
    for (lanes, number) in numbers.iter_mut().zip(first.numbers) {
        *lanes = Float::splat(simd, number);
    }
    for light in others {
        let is_after = u.simd_ge(light.numbers[BEFORE]);
        triangles = is_after.select(Word::splat(simd, light.triangle), triangles);
        for (lanes, number) in numbers.iter_mut().zip(light.numbers) {
            *lanes = is_after.select(Float::splat(simd, number), *lanes);
        }
    }
    DrawnTriangles::new(triangles, numbers)
}

/// The most triangles that count as few.
const FEW_LIGHTS_MAX: usize = 8;

/// A triangle that emits: corners, emission, and what follows.
struct LightRow {
    numbers: [f32; LIGHT_NUMBERS],
    triangle: u32,
}

const LIGHT_NUMBERS: usize = 15;
const POINT_DENSITY: usize = 12;
const BEFORE: usize = 13;
const PROBABILITY: usize = 14;

impl LightRow {
    #[inline(always)]
    fn new(light: &MeshLightData, tables: &AlphaTest<'_>) -> Self {
        let data = &tables.triangles[light.triangle as usize];
        let material = &tables.materials[data.material as usize];
        let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (data.a, data.b, data.c);
        let [r, g, b] = material.k;
        let (density, before, probability) = (material.majorant, light.before, light.probability);
        Self {
            numbers: [
                ax,
                ay,
                az,
                bx,
                by,
                bz,
                cx,
                cy,
                cz,
                r,
                g,
                b,
                density,
                before,
                probability,
            ],
            triangle: light.triangle,
        }
    }
}

/// Triangles that emit, drawn for each lane.
struct DrawnTriangles<S: Simd> {
    triangles: Word<S>,
    corners: [Vec3x<S>; 3],
    /// Where emission varies, its factor.
    emission: Vec3x<S>,
    /// With which light sampling draws a point of the triangle, m⁻².
    point_density: Float<S>,
    /// Probability of the triangles before it in the table.
    before: Float<S>,
    /// Its own probability.
    probability: Float<S>,
}

impl<S: Simd> DrawnTriangles<S> {
    #[inline(always)]
    fn new(triangles: Word<S>, numbers: [Float<S>; LIGHT_NUMBERS]) -> Self {
        let [ax, ay, az, bx, by, bz, cx, cy, cz, r, g, b, ..] = numbers;
        Self {
            triangles,
            corners: [
                Vec3x::new(ax, ay, az),
                Vec3x::new(bx, by, bz),
                Vec3x::new(cx, cy, cz),
            ],
            emission: Vec3x::new(r, g, b),
            point_density: numbers[POINT_DENSITY],
            before: numbers[BEFORE],
            probability: numbers[PROBABILITY],
        }
    }
}

/// Points on triangles that emit, as directions to them.
pub(super) struct MeshLightSample<S: Simd> {
    pub(super) wi: Vec3x<S>,
    /// As far as anything may be in the way; 0 where no light comes.
    pub(super) distance: Float<S>,
    /// Of the density that the power heuristic takes, per solid angle among all directions to light.
    pub(super) inverse_density: Float<S>,
    /// What emits, over the density with which it was drawn.
    pub(super) radiance: Vec3x<S>,
}
