//! First hits through the centres of pixels: one ray a pixel, no light.

use fearless_simd::prelude::*;
use glam::Vec3;
use rayon::prelude::*;

use super::beam::Beam;
use super::geometry::Geometry;
use super::lanes::{Float, LANES, Vec3x, Word};
use super::rays::{NONE, Rays};
use crate::compiled::CameraFrame;
use crate::simd::{Level, dispatch};
use crate::{CompiledScene, ImageSize};

/// The nearest surface through the centre of each pixel, row-major from the top left.
#[derive(Clone, Debug)]
pub struct FirstHits {
    /// Pixels across and down.
    pub size: ImageSize,
    /// From the eye along the ray, metres; ∞ where the ray leaves the scene.
    pub distance: Vec<f32>,
    /// A number for each primitive: a ball's is its place in [`CompiledScene::spheres`], the others
    /// follow, and a mesh has that of its first triangle; [`FirstHits::ESCAPED`] where the ray leaves the scene.
    pub primitive: Vec<u32>,
}

impl FirstHits {
    /// The number of no primitive.
    pub const ESCAPED: u32 = NONE;

    /// Looks at `scene` through its camera, on all threads of the current pool: about 12 ns of
    /// processor time a pixel of the pool room.
    pub fn new(scene: &CompiledScene, size: ImageSize) -> Self {
        let mut hits = Self {
            size,
            distance: Vec::new(),
            primitive: Vec::new(),
        };
        hits.update(scene, size);
        hits
    }

    /// Looks at `scene` again, perhaps in another size. Keeps the memory: the first touch of new pages takes one
    /// thread longer than all threads take to find what pixels see.
    pub fn update(&mut self, scene: &CompiledScene, size: ImageSize) {
        self.size = size;
        self.distance.resize(size.pixels(), f32::INFINITY);
        self.primitive.resize(size.pixels(), NONE);
        let geometry = Geometry::new(scene);
        let camera = scene.camera_frame(size);
        let level = Level::new();
        let width = (size.width as usize).max(1);
        let rows = self.distance.par_chunks_mut(width);
        let rows = rows.zip(self.primitive.par_chunks_mut(width));
        rows.enumerate().for_each(|(y, (distance, primitive))| {
            dispatch!(level, simd => row(simd, &geometry, &camera, y, distance, primitive));
        });
        self.name_meshes(scene);
    }

    /// Gives all triangles of a mesh one number.
    fn name_meshes(&mut self, scene: &CompiledScene) {
        let (first, count) = (first_triangle(scene), scene.meshes.triangles.len() as u32);
        if count == 0 {
            return;
        }
        self.primitive.par_iter_mut().for_each(|primitive| {
            let triangle = primitive.wrapping_sub(first);
            if triangle < count {
                *primitive = first + scene.meshes.first_of_mesh(triangle);
            }
        });
    }
}

/// The number of the first triangle of a scene.
pub(crate) fn first_triangle(scene: &CompiledScene) -> u32 {
    let plates = scene.discs.len() + scene.rectangles.len();
    let solids = scene.spheres.len() + scene.boxes.len() + scene.csg_faces.len();
    (plates + solids) as u32
}

#[inline(always)]
fn row<S: Simd>(
    simd: S,
    geometry: &Geometry,
    camera: &CameraFrame,
    y: usize,
    distance: &mut [f32],
    primitive: &mut [u32],
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let steps: [f32; LANES] = std::array::from_fn(|lane| lane as f32 + 0.5);
            let steps = Float::load_array(simd, steps);
            let eye = Vec3x::splat(simd, camera.eye);
            let dx = Vec3::from(camera.dx);
            let left = Vec3::from(camera.corner) + (y as f32 + 0.5) * Vec3::from(camera.dy);
            let columns = distance.chunks_mut(LANES).zip(primitive.chunks_mut(LANES));
            for (packet, (distance, primitive)) in columns.enumerate() {
                let x = (packet * LANES) as f32;
                let right = Vec3x::splat(simd, dx.into());
                let direction = right.mul_add(steps + x, Vec3x::splat(simd, left.into()));
                let direction = direction * (1.0 / direction.length_squared().sqrt());
                let rays = Rays::new(simd, eye, direction, Word::splat(simd, NONE));
                let beam = Beam::between(camera.eye, left + x * dx, left + (x + LANES as f32) * dx);
                let nearest = geometry.nearest(simd, &rays, Some(&beam));
                distance.copy_from_slice(&nearest.distance.to_array()[..distance.len()]);
                primitive.copy_from_slice(&nearest.id.to_array()[..primitive.len()]);
            }
        },
    );
}
