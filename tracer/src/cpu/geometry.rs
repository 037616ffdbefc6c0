//! Rays against every primitive: nearest hit and occlusion, a packet of lanes at a time.
//!
//! A pool table needs no hierarchy. Each primitive is broadcast to all lanes and first tested by its
//! cheapest sufficient condition; the exact test runs only when some lane passes. Many balls are
//! found by a tree ([`super::forest`]).

use fearless_simd::prelude::*;

use super::carved::Carved;
use super::forest::Forest;
use super::lanes::{Float, Mask, Vec3x, Word};
use crate::compiled::{BoxData, CompiledScene, DiscData, KIND_DIELECTRIC, SphereData};

/// The id of no primitive.
pub(super) const NONE: u32 = u32::MAX;

/// Set in the id of a clear body that a ray is inside of: it meets that body's far side.
pub(super) const INSIDE: u32 = 1 << 31;

/// From so many balls on a tree is faster: by 1.04 to 1.15 there, 1.5 for 512, 10 for 10,000 and 34 for
/// 100,000 balls with AVX-512: `carom-farm bench hierarchy --backend cpu`.
const TREE_SPHERES_MIN: usize = 192;

/// Directions closer to a slab's plane count as this close, so that no product is 0 · ∞.
const DIRECTION_MIN: f32 = 1e-30;

/// Everything a ray can meet. Ids number spheres, boxes, discs, rectangles, faces of carved boxes and
/// lamps in this order, as [`super::surface::Surfaces`] lists them.
pub(super) struct Geometry {
    /// Empty if they are in the forest.
    spheres: Vec<Ball>,
    forest: Option<Forest>,
    boxes: Vec<Slabs>,
    discs: Vec<Plate>,
    rectangles: Vec<Panel>,
    carved: Vec<Carved>,
    lamps: Vec<Panel>,
    /// The id of the first lamp; a hit of this id or above ends its path.
    pub(super) lamps_first: u32,
    /// Some spheres or boxes are clear, so that rays go on inside.
    has_clear: bool,
}

/// Rays with what their tests share.
#[derive(Clone, Copy)]
pub(super) struct Rays<S: Simd> {
    pub(super) origin: Vec3x<S>,
    /// Of unit length.
    pub(super) direction: Vec3x<S>,
    /// The primitive that each ray starts on, which it cannot meet: all are convex. With [`INSIDE`]
    /// the clear body that it is inside of.
    pub(super) skip: Word<S>,
    pub(super) inverse: Vec3x<S>,
    pub(super) inverse_abs: Vec3x<S>,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, origin: Vec3x<S>, direction: Vec3x<S>, skip: Word<S>) -> Self {
        let inverse = inverse(simd, direction);
        Self {
            origin,
            direction,
            skip,
            inverse,
            inverse_abs: inverse.abs(),
        }
    }

    /// Distances to the nearer and the farther plane of each pair of a box's.
    #[inline(always)]
    pub(super) fn slabs(&self, simd: S, min: [f32; 3], max: [f32; 3]) -> (Vec3x<S>, Vec3x<S>) {
        let a = (Vec3x::splat(simd, min) - self.origin).scale(self.inverse);
        let b = (Vec3x::splat(simd, max) - self.origin).scale(self.inverse);
        (
            Vec3x::new(a.x.min(b.x), a.y.min(b.y), a.z.min(b.z)),
            Vec3x::new(a.x.max(b.x), a.y.max(b.y), a.z.max(b.z)),
        )
    }
}

/// `1 / d` with |d| kept away from 0.
#[inline(always)]
pub(super) fn inverse<S: Simd>(simd: S, direction: Vec3x<S>) -> Vec3x<S> {
    Vec3x::new(
        inverse_component(simd, direction.x),
        inverse_component(simd, direction.y),
        inverse_component(simd, direction.z),
    )
}

#[inline(always)]
fn inverse_component<S: Simd>(simd: S, d: Float<S>) -> Float<S> {
    1.0 / d.abs().max(Float::splat(simd, DIRECTION_MIN)).copysign(d)
}

impl Geometry {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        let mut ids = 0u32..;
        let mut id = || ids.next().expect("ids do not run out");
        let reach = reach(scene);
        let is_clear = |material: u32| scene.materials[material as usize].kind == KIND_DIELECTRIC;
        let tree = scene.ball_tree(TREE_SPHERES_MIN);
        let forest = tree.map(|tree| Forest::new(tree, &scene.spheres, reach));
        let has_clear_ball = scene.spheres.iter().any(|s| is_clear(s.material));
        let spheres = scene.spheres.iter();
        let spheres = spheres.map(|s| Ball::new(s, reach, id(), is_clear(s.material)));
        // A radius of 0 hides a ball, but its id stays taken.
        let spheres = spheres.filter(|ball| ball.radius > 0.0 && forest.is_none());
        let spheres: Vec<Ball> = spheres.collect();
        let boxes = scene.boxes.iter();
        let boxes: Vec<Slabs> = boxes
            .map(|b| Slabs::new(b, id(), is_clear(b.material)))
            .collect();
        let discs = scene.discs.iter().map(|d| Plate::new(d, id())).collect();
        let rectangles = scene.rectangles.iter();
        let rectangles = rectangles
            .map(|r| {
                let [u, v] = [(r.half_u, r.inv_u2), (r.half_v, r.inv_v2)];
                Panel::new(r.center, r.normal, u, v, id())
            })
            .collect();
        // As many ids as there are faces.
        let faces_first = id();
        let lamps_first = faces_first + scene.faces.len() as u32;
        let carved = scene.carved.iter();
        let carved = carved
            .map(|c| Carved::new(c, &scene.faces, faces_first))
            .collect();
        let lamps = scene.lamps.iter().zip(lamps_first..);
        let lamps = lamps
            .map(|(l, id)| {
                let [u, v] = [(l.axis_u, 1.0 / l.length_u), (l.axis_v, 1.0 / l.length_v)];
                Panel::new(l.center, l.normal, u, v, id)
            })
            .collect();
        let has_clear = has_clear_ball || boxes.iter().any(|slabs| slabs.is_clear);
        Self {
            spheres,
            forest,
            boxes,
            discs,
            rectangles,
            carved,
            lamps,
            lamps_first,
            has_clear,
        }
    }

    /// Distance to and id of the nearest primitive, of equals the first; ∞ and [`NONE`] where
    /// there is none. The id of a clear body that is met from within has [`INSIDE`].
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(&self, simd: S, rays: &Rays<S>) -> Nearest<S> {
        let mut nearest = match &self.forest {
            Some(forest) => forest.nearest(simd, rays),
            None => Nearest::none(simd),
        };
        for ball in &self.spheres {
            nearest.take(ball.meet(simd, rays, nearest.distance), ball.id);
        }
        for slabs in &self.boxes {
            nearest.take(slabs.meet(simd, rays, nearest.distance), slabs.id);
        }
        for plate in &self.discs {
            nearest.take(plate.meet(simd, rays, nearest.distance), plate.id);
        }
        for panel in &self.rectangles {
            nearest.take(panel.meet(simd, rays, nearest.distance), panel.id);
        }
        for carved in &self.carved {
            if let Some((hit, t, face)) = carved.meet(simd, rays, nearest.distance) {
                nearest.distance = hit.select(t, nearest.distance);
                nearest.id = hit.select(face, nearest.id);
            }
        }
        for panel in &self.lamps {
            nearest.take(panel.meet(simd, rays, nearest.distance), panel.id);
        }
        if self.has_clear {
            let within = rays.skip.simd_eq(nearest.id | INSIDE);
            nearest.id = within.select(rays.skip, nearest.id);
        }
        nearest
    }

    /// [`Geometry::nearest`] of the lamps alone.
    #[inline(always)]
    pub(super) fn nearest_lamp<S: Simd>(&self, simd: S, rays: &Rays<S>) -> Nearest<S> {
        let mut nearest = Nearest::none(simd);
        for panel in &self.lamps {
            nearest.take(panel.meet(simd, rays, nearest.distance), panel.id);
        }
        nearest
    }

    /// Where something lies before `distance`, the lamp of id `target` aside.
    #[inline(always)]
    pub(super) fn occluded<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        distance: Float<S>,
        target: Word<S>,
    ) -> Mask<S> {
        let mut dark = match &self.forest {
            Some(forest) => forest.occluded(simd, rays, distance),
            None => Mask::splat(simd, false),
        };
        for ball in &self.spheres {
            cast(&mut dark, ball.meet(simd, rays, distance));
        }
        for slabs in &self.boxes {
            cast(&mut dark, slabs.meet(simd, rays, distance));
        }
        for plate in &self.discs {
            cast(&mut dark, plate.meet(simd, rays, distance));
        }
        for panel in &self.rectangles {
            cast(&mut dark, panel.meet(simd, rays, distance));
        }
        for carved in &self.carved {
            if let Some((hit, ..)) = carved.meet(simd, rays, distance) {
                dark |= hit;
            }
        }
        for panel in &self.lamps {
            if let Some((hit, _)) = panel.meet(simd, rays, distance) {
                dark |= hit & target.simd_ne(panel.id);
            }
        }
        dark
    }
}

/// Where the lanes that meet a primitive do.
type Meeting<S> = Option<(Mask<S>, Float<S>)>;

/// The nearest primitive so far, per lane.
pub(super) struct Nearest<S: Simd> {
    pub(super) distance: Float<S>,
    pub(super) id: Word<S>,
}

impl<S: Simd> Nearest<S> {
    #[inline(always)]
    fn none(simd: S) -> Self {
        Self {
            distance: Float::splat(simd, f32::INFINITY),
            id: Word::splat(simd, NONE),
        }
    }

    #[inline(always)]
    fn take(&mut self, meeting: Meeting<S>, id: u32) {
        if let Some((hit, t)) = meeting {
            self.distance = hit.select(t, self.distance);
            self.id = hit.select(Word::splat(t.token(), id), self.id);
        }
    }
}

#[inline(always)]
fn cast<S: Simd>(dark: &mut Mask<S>, meeting: Meeting<S>) {
    if let Some((hit, _)) = meeting {
        *dark |= hit;
    }
}

/// An upper bound of the distance from any ray's origin to any sphere's centre.
fn reach(scene: &CompiledScene) -> f32 {
    let eye = scene.camera.eye.to_array();
    let far = |p: [f32; 3], extent: f32| p.iter().fold(extent, |sum, c| sum + c.abs());
    let length = |v: [f32; 3]| far(v, 0.0);
    let spheres = scene.spheres.iter().map(|s| far(s.center, s.radius));
    let boxes = scene.boxes.iter();
    let boxes = boxes.map(|b| far(b.min, 0.0).max(far(b.max, 0.0)));
    let discs = scene.discs.iter().map(|d| far(d.center, d.radius));
    let rectangles = scene.rectangles.iter();
    let rectangles = rectangles.map(|r| far(r.center, length(r.half_u) + length(r.half_v)));
    let carved = scene.carved.iter();
    let carved = carved.map(|c| far(c.min, 0.0).max(far(c.max, 0.0)));
    let from_world_origin = spheres
        .chain(boxes)
        .chain(discs)
        .chain(rectangles)
        .chain(carved);
    2.0 * from_world_origin.fold(far(eye, 0.0), f32::max)
}

/// No ray passes outside this radius and hits, whatever the rounding of the quick test.
pub(super) fn reject_radius(radius: f32, reach: f32) -> f32 {
    radius * 1.000_01 + reach * (8.0 * f32::EPSILON)
}

/// A sphere.
struct Ball {
    center: [f32; 3],
    radius: f32,
    reject_radius: f32,
    id: u32,
    is_clear: bool,
}

impl Ball {
    fn new(sphere: &SphereData, reach: f32, id: u32, is_clear: bool) -> Self {
        Self {
            center: sphere.center,
            radius: sphere.radius,
            reject_radius: reject_radius(sphere.radius, reach),
            id,
            is_clear,
        }
    }

    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, rays: &Rays<S>, limit: Float<S>) -> Meeting<S> {
        let center = Vec3x::splat(simd, self.center);
        let from_center = rays.origin - center;
        let closest = -from_center.dot(rays.direction);
        let miss_squared = rays
            .direction
            .mul_add(closest, from_center)
            .length_squared();
        let reject = self.reject_radius;
        let candidate = miss_squared.simd_le(reject * reject) & closest.simd_gt(-reject);
        if !candidate.any_true() {
            return None;
        }
        let radius = Float::splat(simd, self.radius);
        let chord = Chord::new(rays.origin, rays.direction, center, radius);
        let mut t = chord.first();
        let mut hit = chord.real & t.simd_gt(0.0);
        if self.is_clear {
            let within = rays.skip.simd_eq(self.id | INSIDE);
            t = within.select(chord.far.max(0.0), t);
            hit |= within;
        }
        let hit = hit & t.simd_lt(limit) & rays.skip.simd_ne(self.id);
        Some((hit, t))
    }
}

/// The part of a line inside a sphere, right in f32 however far the origin is: the difference of
/// origin and centre keeps its rounding error (Knuth's TwoDiff), and the foot of the perpendicular
/// is projected twice. Haines et al., "Precision Improvements for Ray/Sphere Intersection", Ray
/// Tracing Gems ch. 7, 2019, goes halfway.
pub(super) struct Chord<S: Simd> {
    /// From the centre to the line, at right angles to it.
    perpendicular: Vec3x<S>,
    half: Float<S>,
    near: Float<S>,
    pub(super) far: Float<S>,
    /// Where line and sphere meet.
    pub(super) real: Mask<S>,
}

impl<S: Simd> Chord<S> {
    #[inline(always)]
    pub(super) fn new(
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        center: Vec3x<S>,
        radius: Float<S>,
    ) -> Self {
        let (x, x_error) = two_diff(origin.x, center.x);
        let (y, y_error) = two_diff(origin.y, center.y);
        let (z, z_error) = two_diff(origin.z, center.z);
        let error = Vec3x::new(x_error, y_error, z_error);
        let closest = -Vec3x::new(x, y, z).dot(direction);
        // The products cancel against x, y and z: without fused rounding nothing would be left.
        let rough = Vec3x::new(
            direction.x.mul_add_precise(closest, x),
            direction.y.mul_add_precise(closest, y),
            direction.z.mul_add_precise(closest, z),
        ) + error;
        let correction = -rough.dot(direction);
        let perpendicular = direction.mul_add(correction, rough);
        let discriminant = radius * radius - perpendicular.length_squared();
        let half = discriminant.max(0.0).sqrt();
        Self {
            perpendicular,
            half,
            near: (closest - half) + correction,
            far: (closest + half) + correction,
            real: discriminant.simd_ge(0.0),
        }
    }

    /// Distance along the ray to the first meeting point that is ahead.
    #[inline(always)]
    pub(super) fn first(&self) -> Float<S> {
        self.near.simd_gt(0.0).select(self.near, self.far)
    }

    /// That point as seen from the centre, which keeps the digits that `origin + t · direction`
    /// has lost; for rays `within` the sphere, the far one.
    #[inline(always)]
    pub(super) fn first_from_center(&self, direction: Vec3x<S>, within: Mask<S>) -> Vec3x<S> {
        let is_near = self.near.simd_gt(0.0) & !within;
        let half = is_near.select(-self.half, self.half);
        direction.mul_add(half, self.perpendicular)
    }
}

/// `a − b` and what rounding took from it.
#[inline(always)]
fn two_diff<S: Simd>(a: Float<S>, b: Float<S>) -> (Float<S>, Float<S>) {
    let difference = a - b;
    let b_part = difference - a;
    (difference, (a - (difference - b_part)) - (b + b_part))
}

/// An axis-aligned box as three slabs.
struct Slabs {
    center: [f32; 3],
    half: [f32; 3],
    id: u32,
    is_clear: bool,
}

impl Slabs {
    fn new(data: &BoxData, id: u32, is_clear: bool) -> Self {
        let center: [f32; 3] = std::array::from_fn(|i| 0.5 * (data.min[i] + data.max[i]));
        // Rounded up, so that rays within a face and through an edge hit.
        let half = std::array::from_fn(|i| {
            let half = (data.max[i] - center[i]).max(center[i] - data.min[i]);
            half.next_up().next_up()
        });
        Self {
            center,
            half,
            id,
            is_clear,
        }
    }

    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, rays: &Rays<S>, limit: Float<S>) -> Meeting<S> {
        let to_center = Vec3x::splat(simd, self.center) - rays.origin;
        let middle = to_center.scale(rays.inverse);
        let half = Vec3x::splat(simd, self.half);
        let near = (-half).scale_add(rays.inverse_abs, middle);
        let far = half.scale_add(rays.inverse_abs, middle);
        let entry = near.x.max(near.y).max(near.z);
        let exit = far.x.min(far.y).min(far.z);
        let hit = entry.max(0.0).simd_le(exit.min(limit)) & rays.skip.simd_ne(self.id);
        if self.is_clear {
            let within = rays.skip.simd_eq(self.id | INSIDE);
            let t = entry.simd_gt(0.0).select(entry, exit);
            let t = within.select(exit.max(0.0), t);
            let ahead = hit & t.simd_gt(0.0);
            return Some(((ahead | within) & t.simd_lt(limit), t));
        }
        if !hit.any_true() {
            return None;
        }
        let t = entry.simd_gt(0.0).select(entry, exit);
        Some((hit & t.simd_gt(0.0) & t.simd_lt(limit), t))
    }
}

/// A disc.
struct Plate {
    center: [f32; 3],
    normal: [f32; 3],
    radius_squared: f32,
    id: u32,
}

impl Plate {
    fn new(disc: &DiscData, id: u32) -> Self {
        Self {
            center: disc.center,
            normal: disc.normal,
            radius_squared: disc.radius * disc.radius,
            id,
        }
    }

    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, rays: &Rays<S>, limit: Float<S>) -> Meeting<S> {
        let crossing = Crossing::new(simd, rays, self.center, self.normal);
        let bound = crossing.denominator * crossing.denominator * self.radius_squared;
        let inside = crossing.from_center.length_squared().simd_le(bound);
        crossing.finish(rays, inside, limit, self.id)
    }
}

/// A rectangle, of an object or a lamp.
struct Panel {
    center: [f32; 3],
    normal: [f32; 3],
    /// Half edges over their squared length: dot products with them are in [−1, 1] inside.
    u: [f32; 3],
    v: [f32; 3],
    id: u32,
}

impl Panel {
    fn new(
        center: [f32; 3],
        normal: [f32; 3],
        (u, u_scale): ([f32; 3], f32),
        (v, v_scale): ([f32; 3], f32),
        id: u32,
    ) -> Self {
        Self {
            center,
            normal,
            u: u.map(|c| c * u_scale),
            v: v.map(|c| c * v_scale),
            id,
        }
    }

    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, rays: &Rays<S>, limit: Float<S>) -> Meeting<S> {
        let crossing = Crossing::new(simd, rays, self.center, self.normal);
        let bound = crossing.denominator.abs();
        let along_u = crossing.from_center.dot(Vec3x::splat(simd, self.u)).abs();
        let along_v = crossing.from_center.dot(Vec3x::splat(simd, self.v)).abs();
        let inside = along_u.simd_le(bound) & along_v.simd_le(bound);
        crossing.finish(rays, inside, limit, self.id)
    }
}

/// Where rays cross a plane, as fractions: most crossings lie outside the shape and need no
/// division.
struct Crossing<S: Simd> {
    numerator: Float<S>,
    denominator: Float<S>,
    /// From the centre to the crossing, times the denominator.
    from_center: Vec3x<S>,
}

impl<S: Simd> Crossing<S> {
    #[inline(always)]
    fn new(simd: S, rays: &Rays<S>, center: [f32; 3], normal: [f32; 3]) -> Self {
        let normal = Vec3x::splat(simd, normal);
        let from_center = rays.origin - Vec3x::splat(simd, center);
        let denominator = rays.direction.dot(normal);
        let numerator = -from_center.dot(normal);
        Self {
            numerator,
            denominator,
            from_center: rays.direction.mul_add(numerator, from_center * denominator),
        }
    }

    #[inline(always)]
    fn finish(self, rays: &Rays<S>, inside: Mask<S>, limit: Float<S>, id: u32) -> Meeting<S> {
        let ahead = (self.numerator * self.denominator).simd_gt(0.0);
        let candidate = inside & ahead & rays.skip.simd_ne(id);
        if !candidate.any_true() {
            return None;
        }
        let t = self.numerator / self.denominator;
        Some((candidate & t.simd_gt(0.0) & t.simd_lt(limit), t))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use fearless_simd::{Level, dispatch};
    use glam::{DVec3, Quat, Vec3};

    use super::super::lanes::LANES;
    use super::*;
    use crate::compiled::Primitive;
    use crate::reference::{Ray, intersect};
    use crate::sampling::uniforms;
    use crate::{Camera, CpuTracer, Environment, Material, Object, Scene, Shape};

    type Six = [[f32; LANES]; 6];

    #[inline(always)]
    fn meet<S: Simd>(simd: S, geometry: &Geometry, six: &Six) -> ([f32; LANES], [u32; LANES]) {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
        let nearest = geometry.nearest(simd, &rays);
        let limit = nearest.distance * (1.0 - 1e-5);
        let none = Word::splat(simd, NONE);
        let before = geometry.occluded(simd, &rays, limit, none);
        assert_eq!(before.to_bitmask(), 0, "occluded before the nearest hit");
        let behind = geometry.occluded(simd, &rays, nearest.distance * (1.0 + 1e-5), none);
        assert_eq!(
            behind.to_bitmask(),
            nearest.id.simd_ne(NONE).to_bitmask(),
            "not occluded by the nearest hit"
        );
        (nearest.distance.to_array(), nearest.id.to_array())
    }

    fn scene(shapes: &[Shape], eye: Vec3) -> CompiledScene {
        let albedo = Vec3::ONE;
        let object = |shape: &Shape| Object {
            name: String::new(),
            material: "m".to_owned(),
            shape: shape.clone(),
        };
        let scene = Scene {
            camera: Camera {
                eye,
                target: Vec3::ZERO,
                up: Vec3::Z,
                fov_x_deg: 40.0,
            },
            environment: Environment {
                radiance: Vec3::ZERO,
            },
            materials: BTreeMap::from([("m".to_owned(), Material::Diffuse { albedo })]),
            objects: shapes.iter().map(object).collect(),
            lamps: Vec::new(),
        };
        CompiledScene::new(&scene).unwrap()
    }

    fn sphere(center: Vec3, radius: f32) -> Shape {
        Shape::Sphere {
            center,
            radius,
            rotation: Quat::IDENTITY,
        }
    }

    /// A unit direction and two more numbers in [0, 1).
    fn random(index: u32) -> (Vec3, f32, f32) {
        let [a, b, c, d] = uniforms(index, 1, 2, 3);
        let (sin, cos) = (a * std::f32::consts::TAU).sin_cos();
        let z = 2.0 * b - 1.0;
        let r = (1.0 - z * z).max(0.0).sqrt();
        (Vec3::new(r * cos, r * sin, z).normalize(), c, d)
    }

    /// Traces rays through all lanes of `level`; compares with the f64 reference and returns how
    /// many disagree on what is hit, how many hit, and the worst error of the distance: relative
    /// beyond 1 m, in metres before.
    fn compare(level: Level, scene: &CompiledScene, rays: &[(Vec3, Vec3)]) -> (usize, usize, f64) {
        let geometry = Geometry::new(scene);
        let (mut wrong, mut hits, mut worst) = (0, 0, 0.0f64);
        for packet in rays.chunks_exact(LANES) {
            let mut six: Six = [[0.0; LANES]; 6];
            for (lane, (origin, direction)) in packet.iter().enumerate() {
                for axis in 0..3 {
                    six[axis][lane] = origin[axis];
                    six[axis + 3][lane] = direction[axis];
                }
            }
            let (t, id) = dispatch!(level, simd => meet(simd, &geometry, &six));
            for (lane, (origin, direction)) in packet.iter().enumerate() {
                let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3());
                let length = direction.length();
                let direction: DVec3 = direction / length;
                let truth = intersect(scene, &Ray { origin, direction });
                let Some(truth) = truth else {
                    wrong += usize::from(id[lane] != NONE);
                    continue;
                };
                hits += 1;
                let number = match truth.primitive {
                    Primitive::Sphere(i) => i,
                    Primitive::Box(i) => i + scene.spheres.len() as u32,
                    Primitive::Disc(i) => i + (scene.spheres.len() + scene.boxes.len()) as u32,
                    Primitive::Rectangle(_) | Primitive::Lamp(_) => geometry.lamps_first - 1,
                    Primitive::Face(_) => panic!("no carved boxes here"),
                };
                if id[lane] == number {
                    let t = f64::from(t[lane]) * length;
                    worst = worst.max((t - truth.t).abs() / truth.t.max(1.0));
                } else {
                    wrong += 1;
                }
            }
        }
        (wrong, hits, worst)
    }

    #[test]
    fn every_shape_is_met_where_the_reference_meets_it() {
        let shapes = [
            sphere(Vec3::new(0.3, -0.2, 0.1), 0.4),
            Shape::Box {
                min: Vec3::new(-0.5, -0.1, -0.7),
                max: Vec3::new(0.2, 0.6, -0.1),
            },
            Shape::Disc {
                center: Vec3::new(0.1, 0.2, 0.3),
                normal: Vec3::new(1.0, -2.0, 0.5),
                radius: 0.5,
            },
            Shape::Rectangle {
                center: Vec3::new(-0.1, 0.1, 0.2),
                half_u: Vec3::new(0.3, 0.3, 0.0),
                half_v: Vec3::new(-0.2, 0.2, 0.5),
            },
        ];
        for (which, shape) in shapes.iter().enumerate() {
            let scene = scene(std::slice::from_ref(shape), Vec3::ONE);
            let ray = |i: u32| {
                let (from, c, d) = random(i);
                let (towards, e, _) = random(i + (1 << 20));
                // Half the origins are within the shape's bounds, so that insides are hit too.
                let origin = from * if c < 0.5 { d * 0.5 } else { 1.0 + 3.0 * d };
                (origin, (towards * (0.7 * e) - origin).normalize())
            };
            let rays: Vec<_> = (0..40_000).map(ray).collect();
            for level in CpuTracer::levels_available() {
                let (wrong, hits, worst) = compare(level, &scene, &rays);
                assert!(hits > 5000, "shape {which}: only {hits} rays hit");
                // Rays that graze an edge by less than an ulp may go either way.
                assert!(
                    wrong <= 4,
                    "shape {which}, {level:?}: {wrong} of {hits} wrong"
                );
                // Grazing rays: an ulp of the discriminant is its root in the distance.
                assert!(worst < 5e-4, "shape {which}, {level:?}: {worst:e}");
            }
        }
    }

    #[test]
    fn balls_are_met_right_from_any_distance() {
        const RADIUS: f32 = 0.028_575;
        for exponent in 0..=7 {
            let meters = 10.0f32.powi(exponent);
            let ray = |i: u32| {
                let (from, c, d) = random(i);
                let origin = from * meters;
                let (aside, ..) = random(i + (1 << 20));
                let aim = aside * (1.2 * RADIUS * c.max(d));
                (origin, (aim - origin).as_dvec3().normalize().as_vec3())
            };
            let rays: Vec<_> = (0..25_600).map(ray).collect();
            let scene = scene(&[sphere(Vec3::ZERO, RADIUS)], Vec3::X * meters);
            for level in CpuTracer::levels_available() {
                let (wrong, hits, worst) = compare(level, &scene, &rays);
                assert_eq!(wrong, 0, "{meters} m, {level:?}: of {hits}");
                assert!(worst < 2e-6, "{meters} m, {level:?}: {worst:e}");
            }
        }
    }

    /// Impacts a few ulps inside and outside of a ball's outline: beyond 4 of them none is mistaken.
    #[test]
    fn rays_that_graze_a_ball_are_told_apart_to_4_ulps() {
        const RADIUS: f32 = 0.028_575;
        let scene = scene(&[sphere(Vec3::ZERO, RADIUS)], Vec3::X);
        let geometry = Geometry::new(&scene);
        for level in CpuTracer::levels_available() {
            for first in (0..128).step_by(LANES) {
                let mut six: Six = [[0.0; LANES]; 6];
                (six[0], six[3]) = ([-1.0; LANES], [1.0; LANES]);
                six[1] = std::array::from_fn(|lane| {
                    f32::from_bits(RADIUS.to_bits() + (first + lane) as u32 - 64)
                });
                let (t, id) = dispatch!(level, simd => meet(simd, &geometry, &six));
                for lane in 0..LANES {
                    let ulps = first + lane;
                    let is_right = (id[lane] == 0) == (ulps < 64);
                    assert!(ulps.abs_diff(64) <= 4 || is_right, "{level:?}: {ulps}");
                    assert!(!t[lane].is_nan());
                }
            }
        }
    }

    #[test]
    fn rays_in_the_planes_of_a_box_hit_it_and_no_lane_is_lost_to_nan() {
        let shape = Shape::Box {
            min: Vec3::splat(-1.0),
            max: Vec3::splat(1.0),
        };
        let scene = scene(&[shape], Vec3::ONE);
        let geometry = Geometry::new(&scene);
        for zero in [0.0, -0.0, 1e-40, -1e-40] {
            for (y, z) in [(1.0, 0.5), (-1.0, 0.5), (1.0, 1.0), (0.25, -1.0)] {
                let mut six: Six = [[0.0; LANES]; 6];
                for (column, value) in six.iter_mut().zip([-3.0, y, z, 1.0, zero, zero]) {
                    *column = [value; LANES];
                }
                let (t, id) = dispatch!(Level::new(), simd => meet(simd, &geometry, &six));
                assert_eq!(id, [0; LANES], "y = {y}, z = {z}");
                assert!((t[0] - 2.0).abs() < 1e-6, "y = {y}, z = {z}: {t:?}");
            }
        }
    }
}
