//! Ray intersection with all primitives: nearest hit and occlusion, one packet of rays at a time.
//!
//! A pool table needs no hierarchy: each primitive is broadcast to all lanes. Shapes with many primitives
//! use a BVH ([`super::bvh16`]).

use fearless_simd::prelude::*;

use super::beam::{Beam, BoundsGroups};
use super::bvh16::{Bvh16, Solid};
use super::csg::CsgBox;
use super::lanes::{Float, Mask, Word};
use super::rays::{INSIDE, Nearest, Rays};
use super::shapes::{AlignedBox, Disc, PackedPrimitive, Rectangle, Shape, Sphere};
use super::triangle::Triangles;
use crate::bvh::{Bounds, Bvh};
use crate::compiled::clusters::Clusters;
use crate::compiled::{CompiledScene, KIND_DIELECTRIC, ShapeKind};

/// Everything that a ray can hit. Ids number spheres, boxes, discs, rectangles, faces of CSG boxes,
/// triangles and area lights in this order, as in [`super::surface::Surfaces`].
pub(super) struct Geometry {
    spheres: PrimitiveSet<Sphere, 6>,
    boxes: PrimitiveSet<AlignedBox, 6>,
    discs: PrimitiveSet<Disc, 7>,
    rectangles: PrimitiveSet<Rectangle, 12>,
    csg_boxes: Vec<CsgBox>,
    csg_bounds: BoundsGroups,
    triangles: Triangles,
    area_lights: PrimitiveSet<Rectangle, 12>,
    /// Id of the first area light; a hit with this id or above terminates its path.
    pub(super) area_lights_first: u32,
    /// Whether some sphere or box is a dielectric, so that rays continue inside.
    has_dielectric: bool,
}

/// All primitives of one shape.
struct PrimitiveSet<F, const N: usize> {
    /// Empty if the primitives are in the BVH.
    each: Vec<PackedPrimitive<F, N>>,
    bounds: BoundsGroups,
    bvh: Option<Bvh16<F, N>>,
}

impl Geometry {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        let reach = reach(scene);
        let is_dielectric =
            |material: u32| scene.materials[material as usize].kind == KIND_DIELECTRIC;
        let first = |kind| scene.first_id(kind);
        let kind = ShapeKind::Sphere;
        // Thresholds are measured for this back end and per shape; the GPU uses others for the same BVH.
        let bvh = scene.bvh(kind, Sphere::BVH_MIN);
        let spheres = PrimitiveSet::of(
            &scene.spheres,
            first(kind),
            bvh,
            Clusters::NONE,
            reach,
            |data| Some((Sphere::numbers(data, reach)?, is_dielectric(data.material))),
        );
        let kind = ShapeKind::Box;
        let bvh = scene.bvh(kind, AlignedBox::BVH_MIN);
        let boxes = PrimitiveSet::of(
            &scene.boxes,
            first(kind),
            bvh,
            scene.box_clusters,
            reach,
            |data| Some((AlignedBox::numbers(data), is_dielectric(data.material))),
        );
        let kind = ShapeKind::Disc;
        let bvh = scene.bvh(kind, Disc::BVH_MIN);
        let discs = PrimitiveSet::of(
            &scene.discs,
            first(kind),
            bvh,
            Clusters::NONE,
            reach,
            |data| Some((Disc::numbers(data), false)),
        );
        let kind = ShapeKind::Rectangle;
        let bvh = scene.bvh(kind, Rectangle::BVH_MIN);
        let rectangles = PrimitiveSet::of(
            &scene.rectangles,
            first(kind),
            bvh,
            Clusters::NONE,
            reach,
            |data| Some((Rectangle::numbers(data), false)),
        );
        let csg_faces_first = first(ShapeKind::CsgFace);
        let triangles_first = first(ShapeKind::Triangle);
        let area_lights_first = triangles_first + scene.meshes.triangles.len() as u32;
        let csg_boxes = scene.csg_boxes.iter();
        let csg_boxes = csg_boxes
            .map(|c| CsgBox::new(c, &scene.csg_faces, csg_faces_first))
            .collect();
        Self {
            spheres,
            boxes,
            discs,
            rectangles,
            csg_boxes,
            csg_bounds: BoundsGroups::new(
                scene.csg_boxes.iter().map(Bounds::from),
                scene.csg_clusters,
                reach,
            ),
            triangles: Triangles::new(scene, triangles_first, reach),
            area_lights: area_lights(scene, area_lights_first, reach),
            area_lights_first,
            has_dielectric: has_dielectric(scene),
        }
    }

    /// Distance and id of the nearest primitive, of the first at equal distance; ∞ and [`NONE`] where there
    /// is none. A dielectric hit from within has [`INSIDE`] in its id. A `beam` of the rays culls
    /// primitives, which pays for coherent rays.
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
    ) -> Nearest<S> {
        let mut nearest = Nearest::none(simd);
        self.spheres.nearest(simd, rays, beam, &mut nearest);
        self.boxes.nearest(simd, rays, beam, &mut nearest);
        self.discs.nearest(simd, rays, beam, &mut nearest);
        self.rectangles.nearest(simd, rays, beam, &mut nearest);
        // A CSG box returns the id of its face, which is known only at the end of its traversal.
        for group in 0..self.csg_bounds.len() {
            for index in self
                .csg_bounds
                .met(simd, group, rays, beam, nearest.distance)
            {
                let csg_box = &self.csg_boxes[index];
                if let Some((hit, t, face)) = csg_box.intersect(simd, rays, nearest.distance) {
                    nearest.distance = hit.select(t, nearest.distance);
                    nearest.id = hit.select(face, nearest.id);
                }
            }
        }
        if !self.triangles.is_empty() {
            self.triangles.nearest(simd, rays, beam, &mut nearest);
        }
        // Last, in the order of ids: the integrator treats every id from the first area light on as the end
        // of a path.
        self.area_lights.nearest(simd, rays, beam, &mut nearest);
        if self.has_dielectric {
            // A hit of the body that the ray is inside of is on its far side: the id keeps its INSIDE flag.
            let within = rays.start.simd_eq(nearest.id | INSIDE);
            nearest.id = within.select(rays.start, nearest.id);
        }
        nearest
    }

    /// [`Geometry::nearest`] among area lights alone.
    #[inline(always)]
    pub(super) fn nearest_area_light<S: Simd>(&self, simd: S, rays: &Rays<S>) -> Nearest<S> {
        let mut nearest = Nearest::none(simd);
        self.area_lights.nearest(simd, rays, None, &mut nearest);
        nearest
    }

    /// Lanes whose ray hits something before `distance` other than the area light with id `target`. `beam`,
    /// if any, bounds the rays up to `distance`.
    #[inline(always)]
    pub(super) fn occluded<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        distance: Float<S>,
        target: Word<S>,
    ) -> Mask<S> {
        let mut dark = Mask::splat(simd, false);
        self.spheres.occlude(simd, rays, beam, distance, &mut dark);
        self.boxes.occlude(simd, rays, beam, distance, &mut dark);
        self.discs.occlude(simd, rays, beam, distance, &mut dark);
        self.rectangles
            .occlude(simd, rays, beam, distance, &mut dark);
        for group in 0..self.csg_bounds.len() {
            for index in self.csg_bounds.met(simd, group, rays, beam, distance) {
                let csg_box = &self.csg_boxes[index];
                if let Some((hit, ..)) = csg_box.intersect(simd, rays, distance) {
                    dark |= hit;
                }
            }
        }
        if !self.triangles.is_empty() {
            self.triangles
                .occlude(simd, rays, beam, distance, &mut dark);
        }
        for light in &self.area_lights.each {
            let met = Rectangle::intersect(rays, &(), &light.splat(simd), distance);
            if let Some((hit, _)) = met {
                // The target light is excluded by id, because its distance is known only up to rounding.
                dark |= hit & target.simd_ne(light.id);
            }
        }
        dark
    }
}

impl<F: Shape<N>, const N: usize> PrimitiveSet<F, N> {
    /// Ids count from `first`. `numbers` returns a primitive's numbers and whether it is a dielectric, or
    /// `None` if it is hidden.
    fn of<D>(
        all: &[D],
        first: u32,
        bvh: Option<&Bvh>,
        clusters: Clusters,
        reach: f32,
        numbers: impl Fn(&D) -> Option<([f32; N], bool)>,
    ) -> Self
    where
        for<'a> Bounds: From<&'a D>,
    {
        let each = all.iter().zip(first..).map(|(data, id)| {
            let (numbers, is_dielectric) = numbers(data)?;
            let one = PackedPrimitive::new(numbers, id, is_dielectric);
            Some((one, Bounds::from(data)))
        });
        if let Some(bvh) = bvh {
            // Hidden primitives keep their place in the list, as the BVH refers to primitives by index.
            let each: Vec<_> = each.map(|one| Some(one?.0)).collect();
            return Self {
                each: Vec::new(),
                bounds: BoundsGroups::new([], Clusters::NONE, reach),
                bvh: Some(Bvh16::new(bvh, &each)),
            };
        }
        let (each, bounds): (Vec<_>, Vec<_>) = each.flatten().unzip();
        Self {
            each,
            bounds: BoundsGroups::new(bounds, clusters, reach),
            bvh: None,
        }
    }

    #[inline(always)]
    fn nearest<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        nearest: &mut Nearest<S>,
    ) {
        if let Some(bvh) = &self.bvh {
            bvh.nearest(simd, rays, nearest, &Solid);
        }
        let frame = F::frame(simd, rays);
        for group in 0..self.bounds.len() {
            for index in self.bounds.met(simd, group, rays, beam, nearest.distance) {
                let one = &self.each[index];
                let met = F::intersect(rays, &frame, &one.splat(simd), nearest.distance);
                nearest.update(met, one.id);
            }
        }
    }

    /// Sets the lanes in `dark` whose ray hits one of them before `distance`.
    #[inline(always)]
    fn occlude<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        distance: Float<S>,
        dark: &mut Mask<S>,
    ) {
        if let Some(bvh) = &self.bvh {
            bvh.occlude(simd, rays, distance, dark, &Solid);
        }
        let frame = F::frame(simd, rays);
        for group in 0..self.bounds.len() {
            for index in self.bounds.met(simd, group, rays, beam, distance) {
                let one = &self.each[index];
                if let Some((hit, _)) = F::intersect(rays, &frame, &one.splat(simd), distance) {
                    *dark |= hit;
                }
            }
        }
    }
}

/// Area lights, with ids from `first` on.
fn area_lights(scene: &CompiledScene, first: u32, reach: f32) -> PrimitiveSet<Rectangle, 12> {
    let far = |bounds: Bounds| bounds.min.abs().max(bounds.max.abs()).element_sum();
    let far = scene.area_lights.iter().map(|light| far(light.into()));
    // `reach` does not cover area lights; the slack for a light far outside the scene follows from its own
    // coordinates.
    let reach = far.fold(reach, |reach, far| reach.max(2.0 * far));
    let all = &scene.area_lights;
    PrimitiveSet::of(all, first, None, Clusters::NONE, reach, |light| {
        Some((Rectangle::area_light_numbers(light), false))
    })
}

fn has_dielectric(scene: &CompiledScene) -> bool {
    let spheres = scene.spheres.iter().map(|sphere| sphere.material);
    let mut materials = spheres.chain(scene.boxes.iter().map(|data| data.material));
    materials.any(|material| scene.materials[material as usize].kind == KIND_DIELECTRIC)
}

/// Upper bound of the distance between any ray origin and any sphere centre, metres.
fn reach(scene: &CompiledScene) -> f32 {
    let eye = scene.camera.eye.to_array();
    let far = |p: [f32; 3], extent: f32| p.iter().fold(extent, |sum, c| sum + c.abs());
    let extents = scene.extents(|v| far(v, 0.0));
    let from_world_origin = extents.map(|(center, extent)| far(center, extent));
    // Origins are the eye or on primitives, all within this sum of |coordinates|; the distance of two such
    // points is at most twice as large.
    2.0 * from_world_origin.fold(far(eye, 0.0).max(scene.meshes.reach), f32::max)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::{DVec3, Quat, Vec3};

    use super::super::lanes::{LANES, Vec3x};
    use super::super::rays::NONE;
    use super::*;
    use crate::compiled::Primitive;
    use crate::sampling::uniforms;
    use crate::scalar::{Ray, intersect};
    use crate::simd::{Level, dispatch};
    use crate::{
        Camera, CpuTracer, CsgSolid, Environment, Lens, Material, Mesh, Object, Scene, Shape,
        Subtraction,
    };

    type Six = [[f32; LANES]; 6];

    #[inline(always)]
    fn nearest_hits<S: Simd>(
        simd: S,
        geometry: &Geometry,
        six: &Six,
    ) -> ([f32; LANES], [u32; LANES]) {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
        let nearest = geometry.nearest(simd, &rays, None);
        let limit = nearest.distance * (1.0 - 1e-5);
        let none = Word::splat(simd, NONE);
        let before = geometry.occluded(simd, &rays, None, limit, none);
        assert_eq!(before.to_bitmask(), 0, "occluded before the nearest hit");
        let behind = geometry.occluded(simd, &rays, None, nearest.distance * (1.0 + 1e-5), none);
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
                lens: Lens::default(),
                near_m: 0.0,
            },
            environment: Environment {
                radiance: Vec3::ZERO,
            },
            materials: BTreeMap::from([("m".to_owned(), Material::Diffuse { albedo })]),
            objects: shapes.iter().map(object).collect(),
            area_lights: Vec::new(),
            ..Scene::new()
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

    /// Traces rays through all lanes of `level`; compares with the f64 scalar tracer and returns how
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
            let (t, id) = dispatch!(level, simd => nearest_hits(simd, &geometry, &six));
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
                    Primitive::Rectangle(_) | Primitive::AreaLight(_) => {
                        geometry.area_lights_first - 1
                    }
                    Primitive::CsgFace(_) => panic!("no CSG boxes here"),
                    Primitive::Triangle(i) => i,
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
    fn shapes_are_hit_where_scalar_rays_hit() {
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
            Shape::Mesh(Mesh::new(
                vec![
                    Vec3::new(-0.4, 0.2, 0.3),
                    Vec3::new(0.5, 0.1, -0.2),
                    Vec3::new(0.0, -0.5, 0.4),
                ],
                vec![[0, 1, 2]],
            )),
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

    /// Boxes and CSG boxes clustered around the origin.
    fn heaps() -> Vec<Shape> {
        let solid = |i: u32, is_csg: bool| {
            let heap = Vec3::from(
                [(0.0, 3.0), (3.0, 0.0), (-3.0, 1.0)]
                    .map(|(x, y)| if is_csg { x + y } else { x - y }),
            );
            let (aside, size, _) = random(i);
            let middle = heap * (1.0 + f32::from(u8::from(i.is_multiple_of(2)))) + 0.4 * aside;
            let (min, max) = (middle - 0.1 - 0.1 * size, middle + 0.2);
            match is_csg {
                false => Shape::Box { min, max },
                true => Shape::CsgBox {
                    min,
                    max,
                    subtractions: vec![Subtraction {
                        solid: CsgSolid::Box {
                            min: middle - 0.05,
                            max: max + 0.1,
                        },
                        material: None,
                    }],
                },
            }
        };
        let boxes = (0..20).flat_map(|i| [solid(i, false), solid(i + 40, true)]);
        boxes.collect()
    }

    fn middle(shape: &Shape) -> Vec3 {
        match shape {
            Shape::Box { min, max } | Shape::CsgBox { min, max, .. } => 0.5 * (*min + *max),
            other => panic!("no heap has a {other:?}"),
        }
    }

    #[test]
    fn clusters_leave_out_nothing_that_rays_meet() {
        let clustered = scene(&heaps(), Vec3::ONE);
        assert!(clustered.box_clusters.len() > 1 && clustered.csg_clusters.len() > 1);
        let mut one_by_one = clustered.clone();
        (one_by_one.box_clusters, one_by_one.csg_clusters) = (Clusters::NONE, Clusters::NONE);
        let middles: Vec<Vec3> = heaps().iter().map(middle).collect();
        let (clustered, one_by_one) = (Geometry::new(&clustered), Geometry::new(&one_by_one));
        let mut met = 0;
        for packet in 0..4_000 {
            let rays: Vec<_> = (0..LANES as u32)
                .map(|lane| {
                    let (origin, c, _) = random(packet * LANES as u32 + lane);
                    let (towards, ..) = random(packet * LANES as u32 + lane + (1 << 20));
                    let origin = origin * 4.0 * c;
                    // Half of them aim near a box.
                    let at = middles[(packet + 7 * lane) as usize % middles.len()];
                    let direction = match lane % 2 {
                        0 => towards,
                        _ => (at + 0.2 * towards - origin).normalize(),
                    };
                    (origin, direction)
                })
                .collect();
            let six: Six = std::array::from_fn(|i| {
                std::array::from_fn(|lane| {
                    let (origin, direction) = rays[lane];
                    if i < 3 { origin[i] } else { direction[i - 3] }
                })
            });
            for level in CpuTracer::levels_available() {
                let [expected, found] = [&one_by_one, &clustered]
                    .map(|geometry| dispatch!(level, simd => nearest_hits(simd, geometry, &six)));
                assert_eq!(found, expected, "{level:?}, packet {packet}");
                met += found.1.iter().filter(|id| **id != NONE).count();
            }
        }
        assert!(met > 5_000, "only {met} rays meet anything");
    }

    #[test]
    fn gpu_hits_balls_right_from_any_distance() {
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

    /// Impacts a few ulps inside and outside a ball's silhouette: beyond 4 ulps all are classified
    /// correctly.
    #[test]
    fn grazing_rays_are_exact_to_4_ulps() {
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
                let (t, id) = dispatch!(level, simd => nearest_hits(simd, &geometry, &six));
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
    fn rays_in_slab_planes_hit_without_nan() {
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
                let (t, id) = dispatch!(Level::new(), simd => nearest_hits(simd, &geometry, &six));
                assert_eq!(id, [0; LANES], "y = {y}, z = {z}");
                assert!((t[0] - 2.0).abs() < 1e-6, "y = {y}, z = {z}: {t:?}");
            }
        }
    }
}
