//! Backward motion vectors: where on an earlier film the points were that pixels see now.

use std::ops::Range;

use fearless_simd::prelude::*;
use glam::{Mat3, Vec3};

use super::first_hit::FirstHits;
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use crate::compiled::CameraFrame;
use crate::simd::{Level, dispatch};

/// Where a primitive was, whose points are now at `p`: at `turn · p + shift`.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Numbers of primitives as in [`FirstHits`].
    pub(crate) ids: Range<u32>,
    pub(crate) turn: Mat3,
    /// Metres.
    pub(crate) shift: Vec3,
    /// Of a sphere, metres: points on the side that was turned away from the earlier eye were not seen.
    pub(crate) center: Option<Vec3>,
}

/// The way back from what a camera sees to the film of an earlier one.
#[derive(Debug)]
pub(crate) struct MotionVectors {
    camera: CameraFrame,
    before: FilmProjection,
    /// By their numbers; all other primitives stay.
    motions: Vec<Motion>,
}

impl MotionVectors {
    /// From what `camera` sees to where `before` saw it. `motions` are by their numbers.
    pub(crate) fn new(camera: CameraFrame, before: &CameraFrame, motions: Vec<Motion>) -> Self {
        Self {
            camera,
            before: FilmProjection::new(before),
            motions,
        }
    }

    /// For each pixel of row `y` of `hits` the place on the earlier film, in pixels from the top left; not a number if
    /// the point was behind the eye, or on the far side of its ball.
    pub(crate) fn row(&self, level: Level, hits: &FirstHits, y: usize, places: &mut [[f32; 2]]) {
        let first = y * places.len();
        let distance = &hits.distance[first..first + places.len()];
        let primitive = &hits.primitive[first..first + places.len()];
        dispatch!(level, simd => self.row_lanes(simd, y, distance, primitive, places));
    }

    #[inline(always)]
    fn row_lanes<S: Simd>(
        &self,
        simd: S,
        y: usize,
        distance: &[f32],
        primitive: &[u32],
        places: &mut [[f32; 2]],
    ) {
        let camera = &self.camera;
        let steps: [f32; LANES] = std::array::from_fn(|lane| lane as f32 + 0.5);
        let steps = Float::load_array(simd, steps);
        let (dx, dy) = (Vec3x::splat(simd, camera.dx), Vec3x::splat(simd, camera.dy));
        let left = dy.mul_add(
            Float::splat(simd, y as f32 + 0.5),
            Vec3x::splat(simd, camera.corner),
        );
        let pixels = distance.chunks(LANES).zip(primitive.chunks(LANES));
        let packets = pixels.zip(places.chunks_mut(LANES)).enumerate();
        for (packet, ((distances, primitives), places)) in packets {
            let (mut distance, mut ids) = ([0.0; LANES], [FirstHits::ESCAPED; LANES]);
            distance[..distances.len()].copy_from_slice(distances);
            ids[..primitives.len()].copy_from_slice(primitives);
            let direction = dx.mul_add(steps + (packet * LANES) as f32, left);
            let distance = Float::load_array(simd, distance);
            let [x, y] = self.places(simd, direction, distance, &ids);
            let (x, y) = (x.to_array(), y.to_array());
            for (place, at) in places.iter_mut().zip(x.into_iter().zip(y)) {
                *place = at.into();
            }
        }
    }

    /// For points that are `distance` metres along directions of any length.
    #[inline(always)]
    fn places<S: Simd>(
        &self,
        simd: S,
        direction: Vec3x<S>,
        distance: Float<S>,
        ids: &[u32; LANES],
    ) -> [Float<S>; 2] {
        let eye = Vec3x::splat(simd, self.camera.eye);
        let reach = distance / direction.length_squared().sqrt();
        let point = direction.mul_add(reach, eye);
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
                hidden |= own & from_center.dot(was_seen).simd_ge(0.0);
            }
        }
        self.before.project(simd, seen, hidden)
    }

    fn motion(&self, id: u32) -> Option<&Motion> {
        let after = self
            .motions
            .partition_point(|motion| motion.ids.start <= id);
        let motion = self.motions[..after].last()?;
        motion.ids.contains(&id).then_some(motion)
    }
}

/// A camera turned round: from directions to places on its film, in pixels from the top left.
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
        // Rows of the inverse of the matrix with the columns dx, dy and corner.
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

    /// Not a number where `hidden`, or behind the eye.
    #[inline(always)]
    fn project<S: Simd>(&self, simd: S, seen: Vec3x<S>, hidden: Mask<S>) -> [Float<S>; 2] {
        let depth = Vec3x::splat(simd, self.depth.to_array()).dot(seen);
        let shown = depth.simd_gt(0.0) & !hidden;
        let share = shown.select(1.0 / depth, Float::splat(simd, f32::NAN));
        [self.x, self.y].map(|axis| Vec3x::splat(simd, axis.to_array()).dot(seen) * share)
    }
}
