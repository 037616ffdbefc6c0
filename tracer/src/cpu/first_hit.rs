//! First hits through pixel centres, without shading.
//!
//! Rays are traced through every second pixel of every second row. A pixel between them is interpolated
//! where its traced neighbours hit the same primitive at a similar depth, and traced otherwise. Features
//! narrower than two pixels can be missed.

use fearless_simd::prelude::*;
use glam::Vec3;
use rayon::prelude::*;

use super::beam::Beam;
use super::geometry::Geometry;
use super::lanes::{Float, LANES, Vec3x, Word};
use super::rays::{NONE, Rays};
use crate::compiled::{CameraFrame, ShapeKind};
use crate::simd::{Level, dispatch};
use crate::{CompiledScene, ImageSize};

/// The nearest surface through the centre of each pixel, row-major from the top left.
#[derive(Clone, Debug)]
pub struct FirstHits {
    /// Pixels across and down.
    pub size: ImageSize,
    /// Reciprocal depth: 1/s where the surface is at `eye + s·direction`, with the direction of the pixel's
    /// centre as in [`CameraFrame`], which is not normalised; 0 where the ray leaves the scene.
    pub inverse_depth: Vec<f32>,
    /// Id of the primitive: a ball's is its index in [`CompiledScene::spheres`], the other shapes follow,
    /// and all triangles of a mesh have the id of its first; [`FirstHits::ESCAPED`] where the ray leaves
    /// the scene.
    pub primitive: Vec<u32>,
    /// Hits at even columns and rows, up to the first beyond the film.
    grid: Grid,
}

#[derive(Clone, Debug, Default)]
struct Grid {
    inverse_depth: Vec<f32>,
    primitive: Vec<u32>,
}

impl FirstHits {
    /// Id of a ray that leaves the scene.
    pub const ESCAPED: u32 = NONE;

    /// Traces first hits of `scene` through its camera on the current thread pool: 7 to 11 ns of
    /// processor time per pixel of the pool room, by the example `reprojection_speed`.
    pub fn new(scene: &CompiledScene, size: ImageSize) -> Self {
        let mut hits = Self {
            size,
            inverse_depth: Vec::new(),
            primitive: Vec::new(),
            grid: Grid::default(),
        };
        hits.update(scene, size);
        hits
    }

    /// Traces first hits of `scene` again, possibly at another size. Reuses the buffers: page faults of new
    /// memory take one thread longer than all threads take for tracing.
    pub fn update(&mut self, scene: &CompiledScene, size: ImageSize) {
        let rays = FirstRays::new(scene, size);
        let level = Level::new();
        let width = (size.width as usize).max(1);
        let (columns, lines) = (grid_columns(width), size.height as usize / 2 + 1);
        self.size = size;
        self.inverse_depth.resize(size.pixels(), 0.0);
        self.primitive.resize(size.pixels(), NONE);
        let grid = &mut self.grid;
        grid.inverse_depth.resize(columns * lines, 0.0);
        grid.primitive.resize(columns * lines, NONE);
        let rows = grid.inverse_depth.par_chunks_mut(columns);
        let rows = rows.zip(grid.primitive.par_chunks_mut(columns)).enumerate();
        rows.for_each(|(line, row)| dispatch!(level, simd => rays.grid_row(simd, line, row)));
        let rows = self.inverse_depth.par_chunks_mut(width);
        let rows = rows.zip(self.primitive.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, row)| dispatch!(level, simd => rays.row(simd, grid, y, row)));
    }
}

/// Columns of the grid that surround a row of the film of `width` pixels.
fn grid_columns(width: usize) -> usize {
    width.div_ceil(2) + 1
}

/// A scene prepared for camera rays.
struct FirstRays<'a> {
    scene: &'a CompiledScene,
    geometry: Geometry,
    camera: CameraFrame,
    first_triangle: u32,
}

/// Reciprocal depths and primitive ids of a row.
type Row<'a> = (&'a mut [f32], &'a mut [u32]);

impl<'a> FirstRays<'a> {
    fn new(scene: &'a CompiledScene, size: ImageSize) -> Self {
        Self {
            scene,
            geometry: Geometry::new(scene),
            camera: scene.camera_frame(size),
            first_triangle: scene.first_id(ShapeKind::Triangle),
        }
    }

    /// Traces a row of the grid.
    #[inline(always)]
    fn grid_row<S: Simd>(&self, simd: S, line: usize, (inverse_depth, primitive): Row) {
        let packets = inverse_depth.chunks_mut(LANES);
        let packets = packets.zip(primitive.chunks_mut(LANES)).enumerate();
        for (packet, (inverse_depth, primitive)) in packets {
            let mut columns = [0; LANES];
            for (lane, column) in columns.iter_mut().enumerate() {
                *column = 2 * (packet * LANES + lane);
            }
            let (depths, primitives) = self.trace(simd, &columns, 2 * line);
            inverse_depth.copy_from_slice(&depths[..inverse_depth.len()]);
            primitive.copy_from_slice(&primitives[..primitive.len()]);
        }
    }

    /// Interpolates a row of the film from the grid rows around it, and traces the pixels that remain open.
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, grid: &Grid, y: usize, (inverse_depth, primitive): Row) {
        let columns = grid_columns(inverse_depth.len());
        let above = y / 2 * columns;
        // Even rows of the film coincide with rows of the grid: there both neighbours are the same row.
        let below = above + y % 2 * columns;
        let depths = (
            &grid.inverse_depth[above..above + columns],
            &grid.inverse_depth[below..below + columns],
        );
        let primitives = (
            &grid.primitive[above..above + columns],
            &grid.primitive[below..below + columns],
        );
        simd.vectorize(
            #[inline(always)]
            || between(depths, primitives, inverse_depth, primitive),
        );
        let mut open = [0; LANES];
        let mut count = 0;
        for x in 0..primitive.len() {
            if primitive[x] != OPEN {
                continue;
            }
            open[count] = x;
            count += 1;
            if count == LANES {
                self.trace_into(simd, &open, y, inverse_depth, primitive);
                count = 0;
            }
        }
        if count > 0 {
            // Padding repeats the last pixel: columns stay ascending, as the beam between the first and the
            // last requires, and writing a pixel twice does no harm.
            let last = open[count - 1];
            open[count..].fill(last);
            self.trace_into(simd, &open, y, inverse_depth, primitive);
        }
    }

    #[inline(always)]
    fn trace_into<S: Simd>(
        &self,
        simd: S,
        columns: &[usize; LANES],
        y: usize,
        inverse_depth: &mut [f32],
        primitive: &mut [u32],
    ) {
        let (depths, primitives) = self.trace(simd, columns, y);
        for (&x, (depth, id)) in columns.iter().zip(depths.iter().zip(primitives)) {
            inverse_depth[x] = *depth;
            primitive[x] = id;
        }
    }

    /// Traces the rays through the pixels of row `y` at `columns`, which ascend.
    #[inline(never)]
    fn trace<S: Simd>(
        &self,
        simd: S,
        columns: &[usize; LANES],
        y: usize,
    ) -> ([f32; LANES], [u32; LANES]) {
        simd.vectorize(
            #[inline(always)]
            || {
                let camera = &self.camera;
                let dx = Vec3::from(camera.dx);
                let left = Vec3::from(camera.corner) + (y as f32 + 0.5) * Vec3::from(camera.dy);
                let mut steps = [0.0; LANES];
                for (step, column) in steps.iter_mut().zip(columns) {
                    *step = *column as f32 + 0.5;
                }
                let (first, last) = (steps[0], steps[LANES - 1]);
                let steps = Float::load_array(simd, steps);
                let right = Vec3x::splat(simd, camera.dx);
                let direction = right.mul_add(steps, Vec3x::splat(simd, left.into()));
                let length = direction.length_squared().sqrt();
                let direction = direction * (1.0 / length);
                let eye = Vec3x::splat(simd, camera.eye);
                // Bit-identical to the eye without a near plane.
                let start = direction.mul_add(length * camera.near_m, eye);
                let rays = Rays::new(simd, start, direction, Word::splat(simd, NONE));
                // All directions of a row lie between its ends, whatever their lengths: beams need no unit
                // vectors.
                let beam = Beam::between(camera.eye, left + first * dx, left + last * dx);
                let nearest = self.geometry.nearest(simd, &rays, Some(&beam));
                let mut primitives = nearest.id.to_array();
                let triangles = self.scene.meshes.triangles.len() as u32;
                if triangles > 0 {
                    for id in &mut primitives {
                        // Ids below the first triangle wrap to large numbers: one comparison instead of
                        // two.
                        let triangle = id.wrapping_sub(self.first_triangle);
                        if triangle < triangles {
                            *id = self.first_triangle + self.scene.meshes.first_of_mesh(triangle);
                        }
                    }
                }
                // Distances count from the near plane; 1/s = length / (distance from the eye).
                let depth = nearest.distance + length * camera.near_m;
                ((length / depth).to_array(), primitives)
            },
        )
    }
}

/// Interpolates a row of the film from the grid rows above and below it, which are the same on even rows.
#[inline(always)]
fn between(
    (depths_above, depths_below): (&[f32], &[f32]),
    (above, below): (&[u32], &[u32]),
    inverse_depth: &mut [f32],
    primitive: &mut [u32],
) {
    let cells = above.windows(2).zip(below.windows(2));
    let depths = depths_above.windows(2).zip(depths_below.windows(2));
    let pixels = inverse_depth.chunks_mut(2).zip(primitive.chunks_mut(2));
    for (((above, below), (upper, lower)), (depth, id)) in cells.zip(depths).zip(pixels) {
        // 1/s is affine in the pixel coordinates on a plane, because directions are those of the film and
        // not normalised. So means of neighbours are exact on planes, and accurate on surfaces of low
        // curvature.
        let is_left = above[0] == below[0] && is_near(upper[0], lower[0]);
        id[0] = if is_left { above[0] } else { OPEN };
        depth[0] = 0.5 * (upper[0] + lower[0]);
        if let ([_, depth], [_, id]) = (depth, id) {
            let is_one = is_left & (above[1] == below[1]) & (above[0] == above[1]);
            let is_one = is_one & is_near(upper[0], upper[1]) & is_near(lower[0], lower[1]);
            // Branch-free, with `&` instead of `&&`, so that the loop is vectorised over pixels.
            *id = if is_one { above[0] } else { OPEN };
            *depth = 0.25 * (upper[0] + upper[1] + lower[0] + lower[1]);
        }
    }
}

#[inline(always)]
fn is_near(a: f32, b: f32) -> bool {
    a.min(b) >= DEPTH_RATIO_MIN * a.max(b)
}

/// Id of a pixel that remains to be traced.
const OPEN: u32 = NONE - 1;
/// Least ratio of neighbouring depths that count as one surface.
const DEPTH_RATIO_MIN: f32 = 0.9;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;

    fn pool() -> CompiledScene {
        let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
        CompiledScene::new(&scene).unwrap()
    }

    #[test]
    fn depths_are_from_the_eye_whatever_the_near_plane() {
        let size = ImageSize::new(96, 54);
        let mut scene = pool();
        let whole = FirstHits::new(&scene, size);
        scene.camera.near_m = 0.3;
        let cut = FirstHits::new(&scene, size);
        let depths = whole.inverse_depth.iter().zip(&cut.inverse_depth);
        let off = depths.filter(|(a, b)| (*a - *b).abs() > 1e-4 * a.abs());
        // By rounding, a few rays pass an edge on the other side.
        assert!(off.count() < 20);
    }

    /// Traces the ray through each pixel.
    fn all_traced(scene: &CompiledScene, size: ImageSize) -> (Vec<f32>, Vec<u32>) {
        let rays = FirstRays::new(scene, size);
        let width = size.width as usize;
        let (mut depths, mut primitives) = (Vec::new(), Vec::new());
        for y in 0..size.height as usize {
            for first in (0..width).step_by(LANES) {
                let columns = std::array::from_fn(|lane| first + lane);
                let count = LANES.min(width - first);
                let (depth, primitive) =
                    dispatch!(Level::new(), simd => rays.trace(simd, &columns, y));
                depths.extend_from_slice(&depth[..count]);
                primitives.extend_from_slice(&primitive[..count]);
            }
        }
        (depths, primitives)
    }

    #[test]
    fn pixels_between_those_of_the_grid_see_what_their_own_rays_see() {
        let scene = pool();
        for size in [ImageSize::new(640, 360), ImageSize::new(331, 187)] {
            let hits = FirstHits::new(&scene, size);
            let (depths, primitives) = all_traced(&scene, size);
            let others = primitives.iter().zip(&hits.primitive);
            let others = others.filter(|(traced, found)| traced != found).count();
            // Features narrower than two pixels.
            assert!(others * 2000 <= size.pixels(), "{others} of {size:?}");
            let same = (0..size.pixels()).filter(|at| primitives[*at] == hits.primitive[*at]);
            let error = |at: usize| (hits.inverse_depth[at] / depths[at] - 1.0).abs();
            let errors: Vec<f32> = same.filter(|at| depths[*at] > 0.0).map(error).collect();
            let mean = errors.iter().sum::<f32>() / errors.len() as f32;
            let most = errors.iter().copied().fold(0.0, f32::max);
            assert!(mean < 1e-4 && most < 0.05, "{mean}, at most {most}");
        }
    }

    #[test]
    fn films_of_any_size_have_no_open_pixel() {
        let scene = pool();
        for (width, height) in [(1, 1), (2, 1), (1, 2), (3, 3), (16, 2), (17, 33), (34, 5)] {
            let size = ImageSize::new(width, height);
            let hits = FirstHits::new(&scene, size);
            assert_eq!(hits.primitive.len(), size.pixels());
            assert!(hits.primitive.iter().all(|id| *id != OPEN), "{size:?}");
        }
    }
}
