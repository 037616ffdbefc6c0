//! Backward motion vectors: where on an earlier film the point seen by each pixel was.

use std::ops::Range;

use fearless_simd::{i32x16, prelude::*};
use glam::{Mat3, Vec3};

use super::first_hit::FirstHits;
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use crate::ImageSize;
use crate::compiled::CameraFrame;
use crate::simd::{Level, dispatch};

/// Rigid motion of a primitive: a point now at `p` was at `turn · p + shift`.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Ids of primitives as in [`FirstHits`].
    pub(crate) ids: Range<u32>,
    pub(crate) turn: Mat3,
    /// Translation, metres.
    pub(crate) shift: Vec3,
    /// Present centre of a sphere, metres: points that faced away from the earlier eye were not visible.
    pub(crate) center: Option<Vec3>,
}

/// The four pixels around a position on a film, for bilinear interpolation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Footprint {
    /// Row-major index of the upper left pixel; [`Footprint::OUTSIDE`] for positions outside the film.
    pub(crate) first: u32,
    /// Weights of the right and of the lower pixels, 0 to 1.
    pub(crate) shares: [f32; 2],
}

impl Footprint {
    /// Index that stands for a position outside the film.
    pub(crate) const OUTSIDE: u32 = u32::MAX;
}

/// Mapping from the points that a camera sees to the film of an earlier camera.
#[derive(Debug)]
pub(crate) struct MotionVectors {
    camera: CameraFrame,
    size_before: ImageSize,
    before: FilmProjection,
    /// Sorted by id; all other primitives are static.
    motions: Vec<Motion>,
}

impl MotionVectors {
    /// Mapping from what `camera` sees to the film of `before`, of size `size_before`. `motions` are sorted
    /// by id.
    pub(crate) fn new(
        camera: CameraFrame,
        (before, size_before): (&CameraFrame, ImageSize),
        motions: Vec<Motion>,
    ) -> Self {
        Self {
            camera,
            size_before,
            before: FilmProjection::new(before),
            motions,
        }
    }

    /// Footprint on the earlier film of each pixel of row `y` of `hits`; outside if the point was behind
    /// the eye or on the far side of its sphere.
    pub(crate) fn row(&self, level: Level, hits: &FirstHits, y: usize, row: &mut [Footprint]) {
        let first = y * row.len();
        let inverse_depth = &hits.inverse_depth[first..first + row.len()];
        let primitive = &hits.primitive[first..first + row.len()];
        dispatch!(level, simd => self.row_lanes(simd, y, inverse_depth, primitive, row));
    }

    #[inline(always)]
    fn row_lanes<S: Simd>(
        &self,
        simd: S,
        y: usize,
        inverse_depth: &[f32],
        primitive: &[u32],
        row: &mut [Footprint],
    ) {
        let camera = &self.camera;
        let steps: [f32; LANES] = std::array::from_fn(|lane| lane as f32 + 0.5);
        let steps = Float::load_array(simd, steps);
        let (dx, dy) = (Vec3x::splat(simd, camera.dx), Vec3x::splat(simd, camera.dy));
        let left = dy.mul_add(
            Float::splat(simd, y as f32 + 0.5),
            Vec3x::splat(simd, camera.corner),
        );
        let pixels = inverse_depth.chunks(LANES).zip(primitive.chunks(LANES));
        let packets = pixels.zip(row.chunks_mut(LANES)).enumerate();
        for (packet, ((depths, primitives), row)) in packets {
            let (mut depth, mut ids) = ([0.0; LANES], [FirstHits::ESCAPED; LANES]);
            match (depths.try_into(), primitives.try_into()) {
                (Ok(all), Ok(all_ids)) => (depth, ids) = (all, all_ids),
                _ => {
                    depth[..depths.len()].copy_from_slice(depths);
                    ids[..primitives.len()].copy_from_slice(primitives);
                }
            }
            let direction = dx.mul_add(steps + (packet * LANES) as f32, left);
            let inverse_depth = Float::load_array(simd, depth);
            let place = self.places(simd, direction, inverse_depth, &ids);
            let (first, [right, below]) = self.footprints(simd, place);
            let (first, right, below) = (first.to_array(), right.to_array(), below.to_array());
            let lanes = first.iter().zip(right.iter().zip(&below));
            for (footprint, (first, (right, below))) in row.iter_mut().zip(lanes) {
                *footprint = Footprint {
                    first: *first,
                    shares: [*right, *below],
                };
            }
        }
    }

    /// Upper left pixels of positions on the earlier film, and the weights of the right and lower pixels.
    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, [x, y]: [Float<S>; 2]) -> (Word<S>, [Float<S>; 2]) {
        let ImageSize { width, height } = self.size_before;
        let is_inside =
            x.simd_ge(0.0) & y.simd_ge(0.0) & x.simd_lt(width as f32) & y.simd_lt(height as f32);
        let (column, right) = neighbours(simd, x, width);
        let (line, below) = neighbours(simd, y, height);
        let first = line * width + column;
        let outside = Word::splat(simd, Footprint::OUTSIDE);
        (is_inside.select(first, outside), [right, below])
    }

    /// Positions on the earlier film of points along directions, at depths as in
    /// [`FirstHits::inverse_depth`].
    #[inline(always)]
    fn places<S: Simd>(
        &self,
        simd: S,
        direction: Vec3x<S>,
        inverse_depth: Float<S>,
        ids: &[u32; LANES],
    ) -> [Float<S>; 2] {
        let eye = Vec3x::splat(simd, self.camera.eye);
        let point = direction.mul_add(1.0 / inverse_depth, eye);
        let eye_before = Vec3x::splat(simd, self.before.eye.to_array());
        let mut seen = point - eye_before;
        let mut hidden = Mask::splat(simd, false);
        let lanes = Word::load_array(simd, *ids);
        let mut last = None;
        for id in ids {
            if last == Some(id) {
                continue;
            }
            last = Some(id);
            let own = lanes.simd_eq(*id);
            if *id == FirstHits::ESCAPED {
                // A point at infinity moves with the eye. Its reciprocal depth is 0, which made the product
                // above ∞.
                seen = Vec3x::select(own, direction, seen);
                continue;
            }
            let Some(motion) = self.motion(*id) else {
                continue;
            };
            let shift = (motion.shift - self.before.eye).to_array();
            let columns = motion.turn.to_cols_array_2d();
            let [x, y, z] = columns.map(|column| Vec3x::splat(simd, column));
            let shift = z.mul_add(point.z, Vec3x::splat(simd, shift));
            let was_seen = x.mul_add(point.x, y.mul_add(point.y, shift));
            seen = Vec3x::select(own, was_seen, seen);
            if let Some(center) = motion.center {
                let from_center = point - Vec3x::splat(simd, center.to_array());
                // For a sphere that only translates, the offset from the centre is also the earlier normal:
                // the point is hidden if that faced away from the earlier eye.
                hidden |= own & from_center.dot(was_seen).simd_ge(0.0);
            }
        }
        self.before.project(simd, seen, hidden)
    }

    /// Motion of a primitive; `None` if it is static.
    fn motion(&self, id: u32) -> Option<&Motion> {
        let after = self
            .motions
            .partition_point(|motion| motion.ids.start <= id);
        let motion = self.motions[..after].last()?;
        motion.ids.contains(&id).then_some(motion)
    }
}

/// Index of the first of the two pixels whose centres enclose `at` in a row or column, and the weight of
/// the second.
#[inline(always)]
fn neighbours<S: Simd>(simd: S, at: Float<S>, count: u32) -> (Word<S>, Float<S>) {
    let last = count.saturating_sub(1) as f32;
    let zero = Float::splat(simd, 0.0);
    let at = zero.max((at - 0.5).min(last));
    // At most the last but one, so that the second pixel exists; at the far edge its weight is 1.
    let first: i32x16<S> = at.min((last - 1.0).max(0.0)).to_int();
    let whole: Float<S> = first.to_float();
    (first.bitcast(), at - whole)
}

/// Inverse camera: maps directions to positions on the film, in pixels from the top left.
#[derive(Debug)]
struct FilmProjection {
    eye: Vec3,
    x: Vec3,
    y: Vec3,
    depth: Vec3,
}

impl FilmProjection {
    fn new(camera: &CameraFrame) -> Self {
        let [corner, dx, dy] = [camera.corner, camera.dx, camera.dy].map(Vec3::from);
        // Rows of the inverse of the matrix with the columns dx, dy and corner; dx and dy are orthogonal.
        let depth = dx.cross(dy);
        let depth = depth / depth.dot(corner);
        let row = |axis: Vec3| axis / axis.length_squared();
        Self {
            eye: camera.eye.into(),
            x: row(dx) - depth * row(dx).dot(corner),
            y: row(dy) - depth * row(dy).dot(corner),
            depth,
        }
    }

    /// Position on the film; NaN where `hidden` or behind the eye.
    #[inline(always)]
    fn project<S: Simd>(&self, simd: S, seen: Vec3x<S>, hidden: Mask<S>) -> [Float<S>; 2] {
        let depth = Vec3x::splat(simd, self.depth.to_array()).dot(seen);
        let shown = depth.simd_gt(0.0) & !hidden;
        // NaN fails all comparisons in `footprints`, so that such positions count as outside without a mask
        // of their own.
        let share = shown.select(1.0 / depth, Float::splat(simd, f32::NAN));
        [self.x, self.y].map(|axis| Vec3x::splat(simd, axis.to_array()).dot(seen) * share)
    }
}
