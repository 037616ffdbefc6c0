//! Reprojection: an image as it would look from another view, or a moment later. It is shown while
//! the requested image is still being traced.
//!
//! The scene is known exactly, so nothing is guessed from neighbouring pixels: a ray through each
//! pixel of the new view finds the visible point, the point is moved back to where its ball, cue or
//! mesh was, and the old image is sampled there (reverse reprojection: Nehab et al., "Accelerating
//! Real-Time Shading with Reverse Reprojection Caching", 2007). A primitive is convex, so the point
//! was visible if the old image shows the same primitive there from the same side. A mesh is
//! treated as convex too, and so are all surfaces of particles, which are also assumed not to move.
//! Where the point was not visible, the nearest pixel of the same primitive is substituted, or, if
//! that is far away, the primitive's mean in the old image; such pixels are counted. Reflections,
//! shadows and the numbers on turning balls stay as they were until the next image, as nothing is
//! traced.

mod disocclusion;
pub mod temporal_accumulation;

use std::ops::Range;
use std::sync::LazyLock;

use crate::compiled::{CSG_FACE_APEX_CONE, CameraFrame, ShapeKind, SphereData};
use crate::cpu::{FirstHits, Footprint, Motion, MotionVectors};
use crate::simd::{Level, dispatch};
use crate::{CompiledScene, ImageSize, ObjectPose};
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;

use disocclusion::{PrimitiveMeans, stand_in, whole_neighbourhoods};

/// The state an image is taken of: a camera, the objects that move, and the first hit of each
/// pixel.
#[derive(Clone, Debug)]
pub struct View {
    camera: CameraFrame,
    spheres: Vec<SphereData>,
    cones: Vec<PlacedCone>,
    /// Each mesh's pose, with the primitive number of its pixels.
    meshes: Vec<(u32, ObjectPose)>,
    hits: FirstHits,
}

/// An image reprojected to another [`View`].
#[derive(Clone, Debug, PartialEq)]
pub struct Reprojected<P> {
    /// Row-major from the top left.
    pub pixels: Vec<P>,
    /// Number of pixels that the old image did not show and that hold a substitute.
    pub guessed: usize,
}

impl View {
    /// A view of `scene` in its current state, for an image of `size`.
    pub fn new(scene: &CompiledScene, size: ImageSize) -> Self {
        Self {
            camera: scene.camera_frame(size),
            spheres: scene.spheres.clone(),
            cones: cones(scene),
            meshes: meshes(scene),
            hits: FirstHits::new(scene, size),
        }
    }

    /// Updates the view to the current state of the same scene, reusing its memory.
    pub fn update(&mut self, scene: &CompiledScene, size: ImageSize) {
        self.camera = scene.camera_frame(size);
        self.spheres.clone_from(&scene.spheres);
        self.cones = cones(scene);
        self.meshes = meshes(scene);
        self.hits.update(scene, size);
    }

    /// Width and height in pixels.
    pub fn size(&self) -> ImageSize {
        self.hits.size
    }

    /// The image `pixels` of this view as it looks from `to`. Both views must be of the same scene.
    ///
    /// # Panics
    /// If the number of `pixels` is not that of this view's size.
    pub fn reproject<T: Channel, const N: usize>(
        &self,
        pixels: &[[T; N]],
        to: &Self,
    ) -> Reprojected<[T; N]> {
        self.reproject_into(pixels, to, Vec::new())
    }

    /// As [`Self::reproject`], but reuses the memory of `moved`, whose contents do not matter.
    ///
    /// # Panics
    /// If the number of `pixels` is not that of this view's size.
    pub fn reproject_into<T: Channel, const N: usize>(
        &self,
        pixels: &[[T; N]],
        to: &Self,
        mut moved: Vec<[T; N]>,
    ) -> Reprojected<[T; N]> {
        assert_eq!(pixels.len(), self.size().pixels(), "pixels of the picture");
        let width = (to.size().width as usize).max(1);
        moved.resize(to.size().pixels(), [T::default(); N]);
        let (level, vectors) = (Level::new(), to.motion_vectors(self));
        let means = LazyLock::new(|| PrimitiveMeans::new(&self.hits, pixels));
        let rows = moved.par_chunks_mut(width).enumerate();
        let guessed = rows.map_init(
            || vec![Footprint::default(); width],
            |footprints, (y, row)| {
                vectors.row(level, &to.hits, y, footprints);
                let primitives = &to.hits.primitive[y * width..][..row.len()];
                self.fill_row(level, pixels, (footprints, primitives), &means, row)
            },
        );
        let guessed = guessed.sum();
        Reprojected {
            pixels: moved,
            guessed,
        }
    }

    /// Fills a row by sampling the image at `footprints`; returns the number of pixels for which it
    /// has none of the primitive.
    fn fill_row<T: Channel, const N: usize>(
        &self,
        level: Level,
        pixels: &[[T; N]],
        (footprints, primitives): (&[Footprint], &[u32]),
        means: &LazyLock<PrimitiveMeans<T, N>, impl FnOnce() -> PrimitiveMeans<T, N>>,
        row: &mut [[T; N]],
    ) -> usize {
        let mut missing = Vec::new();
        dispatch!(level, _simd => {
            let of_row = row.iter_mut().zip(footprints.iter().zip(primitives));
            for (x, (pixel, (footprint, primitive))) in of_row.enumerate() {
                match self.look_up(pixels, footprint, *primitive) {
                    Some(found) => *pixel = found,
                    None => missing.push(x),
                }
            }
        });
        if missing.is_empty() {
            return 0;
        }
        let whole = whole_neighbourhoods(row.len(), &missing);
        for &x in &missing {
            row[x] = match stand_in(primitives, &whole, x) {
                Some(near) => row[near],
                None => means.of(primitives[x]),
            };
        }
        missing.len()
    }

    /// Motion vectors from this view back to `before`.
    fn motion_vectors(&self, before: &Self) -> MotionVectors {
        let spheres = self.spheres.iter().zip(&before.spheres);
        let spheres = (0..).zip(spheres).map(|(id, (now, before))| Motion {
            ids: id..id + 1,
            turn: Mat3::IDENTITY,
            shift: Vec3::from(before.center) - Vec3::from(now.center),
            // From the centre it follows which side of the sphere faced away from the earlier eye.
            center: Some(now.center.into()),
        });
        let cones = self.cones.iter().zip(&before.cones);
        let cones = cones.map(|(now, before)| now.motion_from(before));
        let meshes = self.meshes.iter().zip(&before.meshes);
        let meshes = meshes.map(|((id, now), (_, before))| {
            // From world to object space by the present pose, and back by the former one:
            // x ↦ turn · (x − now) + before.
            let turn = Mat3::from_quat(before.rotation * now.rotation.inverse());
            Motion {
                ids: *id..*id + 1,
                turn,
                shift: before.position - turn * now.position,
                center: None,
            }
        });
        let motions = spheres.chain(cones).chain(meshes).collect();
        MotionVectors::new(self.camera, (&before.camera, before.size()), motions)
    }

    /// The image sampled bilinearly at a footprint, among those of its four pixels that show
    /// `primitive`; `None` if these have almost no weight.
    #[inline(always)]
    fn look_up<T: Channel, const N: usize>(
        &self,
        pixels: &[[T; N]],
        footprint: &Footprint,
        primitive: u32,
    ) -> Option<[T; N]> {
        if footprint.first == Footprint::OUTSIDE {
            return None;
        }
        // In an image of one column or row, each pixel is its own neighbour.
        let ImageSize { width, height } = self.size();
        let (right, below) = (
            usize::from(width > 1),
            width as usize * usize::from(height > 1),
        );
        let first = footprint.first as usize;
        let primitives = &self.hits.primitive;
        let [right_share, lower_share] = footprint.shares;
        let corners = [first, first + right, first + below, first + below + right];
        // Fast path without weights: all four pixels show the primitive.
        let mut is_whole = true;
        for corner in corners {
            is_whole &= primitives[corner] == primitive;
        }
        if is_whole {
            let [upper_left, upper_right] = [&pixels[first], &pixels[first + right]];
            let [lower_left, lower_right] = [&pixels[corners[2]], &pixels[corners[3]]];
            let mut found = [T::default(); N];
            for (channel, found) in found.iter_mut().enumerate() {
                let upper = lerp(upper_left[channel], upper_right[channel], right_share);
                let lower = lerp(lower_left[channel], lower_right[channel], right_share);
                *found = T::from_f32(lower_share.mul_add(lower - upper, upper));
            }
            return Some(found);
        }
        let (left_share, upper_share) = (1.0 - right_share, 1.0 - lower_share);
        let shares = [
            left_share * upper_share,
            right_share * upper_share,
            left_share * lower_share,
            right_share * lower_share,
        ];
        // Loops, since closures are not compiled for the caller's instruction set.
        let (mut sum, mut weights) = ([0.0; N], 0.0);
        for (corner, share) in corners.into_iter().zip(shares) {
            let is_same = primitives[corner] == primitive;
            let share = if is_same { share } else { 0.0 };
            weights += share;
            for (sum, channel) in sum.iter_mut().zip(pixels[corner]) {
                *sum += share * channel.to_f32();
            }
        }
        if weights <= WEIGHT_MIN {
            return None;
        }
        let mut found = [T::default(); N];
        let per_weight = 1.0 / weights;
        for (found, sum) in found.iter_mut().zip(sum) {
            *found = T::from_f32(sum * per_weight);
        }
        Some(found)
    }
}

/// The position of a truncated cone, which is rotationally symmetric, and the ids of its faces.
#[derive(Clone, Debug)]
struct PlacedCone {
    ids: Range<u32>,
    apex: Vec3,
    axis: Vec3,
}

impl PlacedCone {
    /// The motion that takes its points to where they were when it was at `before`.
    fn motion_from(&self, before: &Self) -> Motion {
        // Any rotation from one axis to the other will do, as the cone is rotationally symmetric.
        let turn = Mat3::from_quat(Quat::from_rotation_arc(self.axis, before.axis));
        Motion {
            ids: self.ids.clone(),
            turn,
            shift: before.apex - turn * self.apex,
            center: None,
        }
    }
}

fn meshes(scene: &CompiledScene) -> Vec<(u32, ObjectPose)> {
    let first = scene.first_id(ShapeKind::Triangle);
    let poses = scene.meshes.poses();
    poses
        .map(|(triangle, pose)| (first + triangle, pose))
        .collect()
}

fn cones(scene: &CompiledScene) -> Vec<PlacedCone> {
    let sides = (scene.first_id(ShapeKind::CsgFace)..).zip(&scene.csg_faces);
    let sides = sides.filter(|(_, face)| face.kind == CSG_FACE_APEX_CONE);
    sides
        .map(|(id, side)| PlacedCone {
            // The lateral face and both ends.
            ids: id..id + 3,
            apex: side.a.into(),
            axis: Vec3::from(side.b).normalize(),
        })
        .collect()
}

#[inline(always)]
fn lerp<T: Channel>(from: T, to: T, share: f32) -> f32 {
    let (from, to) = (from.to_f32(), to.to_f32());
    share.mul_add(to - from, from)
}

/// A channel of a pixel's colour.
pub trait Channel: Copy + Default + Send + Sync {
    /// The value as f32.
    fn to_f32(self) -> f32;
    /// The nearest representable value.
    fn from_f32(value: f32) -> Self;
}

impl Channel for u8 {
    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }

    #[inline(always)]
    fn from_f32(value: f32) -> Self {
        // Adding 2²³ rounds to an integer and leaves it in the lowest mantissa bits; unlike the
        // saturating `as`, this vectorises.
        (value + 8_388_608.0).to_bits() as Self
    }
}

impl Channel for f32 {
    fn to_f32(self) -> f32 {
        self
    }

    fn from_f32(value: f32) -> Self {
        value
    }
}

/// Weight below which a footprint touches the primitive only at the rim of a pixel, whose light is
/// mostly another primitive's.
const WEIGHT_MIN: f32 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_moved_cone_are_found_where_they_were() {
        let cone = |apex: Vec3, axis: Vec3| PlacedCone {
            ids: 0..3,
            apex,
            axis: axis.normalize(),
        };
        let before = cone(Vec3::new(0.1, 0.2, 0.3), Vec3::new(1.0, 0.2, 0.1));
        let now = cone(Vec3::new(-0.3, 0.0, 0.2), Vec3::new(0.8, -0.4, 0.3));
        let point = now.apex + 1.5 * now.axis + 0.01 * now.axis.any_orthonormal_vector();
        let motion = now.motion_from(&before);
        let moved = motion.turn * point + motion.shift - before.apex;
        assert!((moved.dot(before.axis) - 1.5).abs() < 1e-5, "{moved}");
        assert!((moved.length() - (point - now.apex).length()).abs() < 1e-5);
    }
}
