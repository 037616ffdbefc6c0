//! Beams: conservative bounds of a packet of rays, which cull many primitives at once.
//!
//! Rays of adjacent pixels have similar origins and directions. At a distance t all of them lie in a box
//! whose faces move linearly with t, so that each face of a primitive's bounds gives an interval of t,
//! and the bounds can be hit only where all six intervals overlap: interval arithmetic over the packet
//! (Boulos, Wald and Shirley, "Geometric and Arithmetic Culling Methods for Entire Ray Packets", 2006),
//! transposed so that a lane is a primitive. No ray hits a culled primitive.

use fearless_simd::{f32x4, f32x8, prelude::*};
use glam::Vec3;

use super::lanes::{Float, LANES, Mask, Vec3x};
use super::rays::{DIRECTION_MIN, Rays};
use crate::bvh::{Bounds, SLACK};
use crate::compiled::clusters::{Clusters, union};

/// Box around all rays of a packet as a function of the distance from their origins.
pub(super) struct Beam {
    /// Per axis: the face of smaller, then that of larger coordinates.
    faces: [[Face; 2]; 3],
    /// Length of the longest ray, in units of the directions' length.
    distance: f32,
}

/// A face of the box, at `origin + velocity · t` along its axis.
#[derive(Clone, Copy)]
struct Face {
    origin: f32,
    /// 1 / velocity, finite.
    inverse: f32,
}

/// Bounds of primitives, in groups of [`LANES`].
pub(super) struct BoundsGroups {
    groups: Vec<BoundsGroup>,
}

struct BoundsGroup {
    /// Minimum x, y, z, then maximum x, y, z; empty bounds in unused lanes.
    bounds: [[f32; LANES]; 6],
    /// Bit mask of the primitives that are in no cluster.
    single: u32,
    clusters: Vec<BoundsCluster>,
}

/// Adjacent primitives of a group with their common bounds: a ray that misses the bounds misses all of
/// them.
struct BoundsCluster {
    min: [f32; 3],
    max: [f32; 3],
    /// Bit mask of the group's primitives in the cluster.
    members: u32,
}

impl Beam {
    /// Beam of the rays of `lanes` up to `distance`; `None` if one of those rays is not finite.
    #[inline(always)]
    pub(super) fn new<S: Simd>(
        simd: S,
        rays: &Rays<S>,
        lanes: Mask<S>,
        distance: Float<S>,
    ) -> Option<Self> {
        let (o, d) = (rays.origin, rays.direction);
        // ∞ · 0 and NaN · 0 are NaN, which is not equal to itself: one comparison instead of six.
        let zero = (o.x + o.y + o.z + d.x + d.y + d.z) * 0.0;
        if (lanes & !zero.simd_eq(zero)).any_true() {
            return None;
        }
        // Maximum, by the one reduction available.
        let distance = -least(simd, -distance, lanes);
        Some(Self {
            faces: [
                faces(simd, o.x, d.x, lanes),
                faces(simd, o.y, d.y, lanes),
                faces(simd, o.z, d.z, lanes),
            ],
            // Finite, because the empty bounds of unused lanes begin at ∞.
            distance: distance.min(f32::MAX),
        })
    }

    /// Beam of all rays from a point whose directions, of any length, lie between `first` and `last` on
    /// each axis.
    #[inline(always)]
    pub(super) fn between(origin: [f32; 3], first: Vec3, last: Vec3) -> Self {
        let (low, high) = (first.min(last), first.max(last));
        let faces = |axis: usize| {
            [
                Face::new(origin[axis], low[axis]),
                Face::new(origin[axis], high[axis]),
            ]
        };
        Self {
            faces: [faces(0), faces(1), faces(2)],
            distance: f32::MAX,
        }
    }

    /// Bit mask of the bounds of a group that the beam overlaps.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, bounds: &[[f32; LANES]; 6]) -> u32 {
        let [x, y, z, max_x, max_y, max_z] = bounds;
        let min = Vec3x::load_arrays(simd, &[*x, *y, *z]);
        let max = Vec3x::load_arrays(simd, &[*max_x, *max_y, *max_z]);
        let (begin, end) = self.overlap(min, max);
        begin.simd_le(end).to_bitmask() as u32
    }

    /// Interval of distances in which the beam overlaps the bounds of each lane; empty if the first is
    /// larger.
    #[inline(always)]
    pub(super) fn overlap<S: Simd>(&self, min: Vec3x<S>, max: Vec3x<S>) -> (Float<S>, Float<S>) {
        let simd = min.x.token();
        let mut begin = Float::splat(simd, 0.0);
        let mut end = Float::splat(simd, self.distance);
        let bounds = [[min.x, max.x], [min.y, max.y], [min.z, max.z]];
        for ([low, high], [min, max]) in self.faces.into_iter().zip(bounds) {
            // The lower face is at o + v·t and has to be below the bounds' maximum: t ≤ (max − o)/v if v
            // > 0, and t ≥ (max − o)/v if v < 0. For the upper face and the minimum both comparisons are
            // reversed.
            let t = (max - low.origin) * low.inverse;
            if low.inverse > 0.0 {
                end = end.min(t);
            } else {
                begin = begin.max(t);
            }
            let t = (min - high.origin) * high.inverse;
            if high.inverse > 0.0 {
                begin = begin.max(t);
            } else {
                end = end.min(t);
            }
        }
        (begin, end)
    }

    /// Largest absolute coordinate of an origin, metres.
    #[inline(always)]
    pub(super) fn origin_max(&self) -> f32 {
        let [[a, b], [c, d], [e, f]] = self.faces.map(|axis| axis.map(|face| face.origin.abs()));
        a.max(b).max(c.max(d)).max(e.max(f))
    }
}

impl Face {
    #[inline(always)]
    fn new(origin: f32, velocity: f32) -> Self {
        // A face at rest then overlaps bounds for all t or, with a bound of t near ±1e30 metres, for none.
        let inverse = 1.0 / velocity.abs().max(DIRECTION_MIN).copysign(velocity);
        Self { origin, inverse }
    }
}

impl BoundsGroups {
    /// `reach` bounds the absolute coordinates of primitives and ray origins together, metres; all bounds
    /// are widened in proportion to it.
    pub(super) fn new(
        bounds: impl IntoIterator<Item = Bounds>,
        clusters: Clusters,
        reach: f32,
    ) -> Self {
        // Beams are tested in f32 too. Without slack a beam could cull what one of its rays grazes, and the
        // image would depend on which rays share a packet.
        let widened = |bounds: Bounds| Bounds {
            min: bounds.min - reach * SLACK,
            max: bounds.max + reach * SLACK,
        };
        let all: Vec<Bounds> = bounds.into_iter().map(widened).collect();
        let groups = all.chunks(LANES).enumerate();
        let groups = groups.map(|(index, of_group)| BoundsGroup::new(of_group, index, clusters));
        Self {
            groups: groups.collect(),
        }
    }

    /// Number of groups.
    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.groups.len()
    }

    /// Indices of the primitives of a group that the beam may hit, ascending; without a beam, of those
    /// that any of the rays may hit before its `limit`.
    #[inline(always)]
    pub(super) fn met<S: Simd>(
        &self,
        simd: S,
        group: usize,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        limit: Float<S>,
    ) -> Indices {
        let first = group * LANES;
        let group = &self.groups[group];
        let bits = match beam {
            Some(beam) => beam.meets(simd, &group.bounds),
            None => group.met_by_rays(simd, rays, limit),
        };
        Indices { first, bits }
    }
}

impl BoundsGroup {
    /// Group `index` of the primitives, from their bounds.
    fn new(of_group: &[Bounds], index: usize, clusters: Clusters) -> Self {
        // Unused lanes get empty bounds, which nothing overlaps.
        let (min, max) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
        let mut bounds = [min, min, min, max, max, max];
        for (lane, one) in of_group.iter().enumerate() {
            for axis in 0..3 {
                bounds[axis][lane] = one.min[axis];
                bounds[axis + 3][lane] = one.max[axis];
            }
        }
        let mut group = Self {
            bounds,
            single: u32::MAX >> (u32::BITS as usize - of_group.len()),
            clusters: Vec::new(),
        };
        for members in clusters.members() {
            // A cluster may span several groups, so its mask is shifted to this one.
            let members = (members.checked_shr((index * LANES) as u32)).unwrap_or(0);
            let members = members as u32 & group.single;
            if members.count_ones() < 2 {
                continue;
            }
            let own = Indices {
                first: 0,
                bits: members,
            };
            // A group keeps its own part of a cluster, with bounds of that part alone.
            let bound = own.map(|lane| of_group[lane]).reduce(union);
            let bound = bound.expect("a cluster has boxes");
            group.single &= !members;
            group.clusters.push(BoundsCluster {
                min: bound.min.into(),
                max: bound.max.into(),
                members,
            });
        }
        group
    }

    #[inline(always)]
    fn met_by_rays<S: Simd>(&self, simd: S, rays: &Rays<S>, limit: Float<S>) -> u32 {
        let mut bits = self.single;
        for cluster in &self.clusters {
            let (near, far) = rays.slabs(simd, cluster.min, cluster.max);
            let enter = near.x.max(near.y).max(near.z).max(0.0);
            let leave = far.x.min(far.y).min(far.z).min(limit);
            if enter.simd_le(leave).any_true() {
                bits |= cluster.members;
            }
        }
        bits
    }
}

/// Iterator over the indices of the bits that are set, ascending.
pub(super) struct Indices {
    first: usize,
    bits: u32,
}

impl Iterator for Indices {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let bit = self.bits.trailing_zeros() as usize;
        if self.bits == 0 {
            return None;
        }
        self.bits &= self.bits - 1;
        Some(self.first + bit)
    }
}

/// Both faces on an axis of rays with these origins and velocities.
#[inline(always)]
fn faces<S: Simd>(simd: S, origin: Float<S>, velocity: Float<S>, lanes: Mask<S>) -> [Face; 2] {
    let low = Face::new(least(simd, origin, lanes), least(simd, velocity, lanes));
    let high = [least(simd, -origin, lanes), least(simd, -velocity, lanes)];
    // Minimum origin and minimum velocity may belong to different rays; the box stays conservative.
    [low, Face::new(-high[0], -high[1])]
}

/// Minimum of `values` over `lanes`.
#[inline(always)]
pub(super) fn least<S: Simd>(simd: S, values: Float<S>, lanes: Mask<S>) -> f32 {
    let values = lanes.select(values, Float::splat(simd, f32::INFINITY));
    let (low, high): (f32x8<S>, f32x8<S>) = values.split();
    let (low, high): (f32x4<S>, f32x4<S>) = low.min(high).split();
    let [a, b, c, d] = low.min(high).to_array();
    let (a, b) = (if a < b { a } else { b }, if c < d { c } else { d });
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::super::geometry::Geometry;
    use super::super::lanes::Word;
    use super::super::rays::NONE;
    use super::*;
    use crate::sampling::uniforms;
    use crate::simd::dispatch;
    use crate::{CompiledScene, CpuTracer, Scene};

    /// Lanes of a packet: origins, then directions.
    type Six = [[f32; LANES]; 6];

    /// A number in [−1, 1).
    fn random(index: u32, block: u32) -> f32 {
        2.0 * uniforms(index, block, 5, 7)[0] - 1.0
    }

    /// Rays whose origins and directions differ by up to `spread`; some directions are parallel to an axis.
    fn packet(index: u32, spread: f32) -> Six {
        let middle: [f32; 6] = std::array::from_fn(|i| random(index, i as u32));
        let along = (index % 3) as usize;
        std::array::from_fn(|i| {
            std::array::from_fn(|lane| {
                let aside = spread * random(index * LANES as u32 + lane as u32, 10 + i as u32);
                match i {
                    0..3 => 3.0 * middle[i] + aside,
                    _ if index.is_multiple_of(4) && i - 3 != along => 0.0,
                    _ => middle[i] + aside,
                }
            })
        })
    }

    /// Hits, and occlusion before 2 m, of the rays of `lanes`, with their beam or without.
    #[inline(always)]
    fn hits<S: Simd>(
        simd: S,
        geometry: &Geometry,
        six: &Six,
        lanes: u64,
        is_by_beam: bool,
    ) -> ([f32; LANES], [u32; LANES], u64) {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let direction = direction * (1.0 / direction.length_squared().sqrt());
        let none = Word::splat(simd, NONE);
        let rays = Rays::new(simd, origin, direction, none);
        let lanes = Mask::from_bitmask(simd, lanes);
        let (endless, near) = (Float::splat(simd, f32::INFINITY), Float::splat(simd, 2.0));
        let beam = |distance| Beam::new(simd, &rays, lanes, distance).filter(|_| is_by_beam);
        let nearest = geometry.nearest(simd, &rays, beam(endless).as_ref());
        let dark = geometry.occluded(simd, &rays, beam(near).as_ref(), near, none);
        let missed = Float::splat(simd, f32::INFINITY);
        (
            lanes.select(nearest.distance, missed).to_array(),
            lanes.select(nearest.id, none).to_array(),
            (dark & lanes).to_bitmask(),
        )
    }

    #[test]
    fn a_beam_leaves_out_nothing_that_its_rays_meet() {
        let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
        let geometry = Geometry::new(&CompiledScene::new(&scene).unwrap());
        let mut met = 0;
        for level in CpuTracer::levels_available() {
            for index in 0..4_000 {
                let spread = [0.0, 1e-3, 0.05, 0.5, 3.0][index as usize % 5];
                let mut six = packet(index, spread);
                let lanes = if index % 7 == 0 { 0x0ff3 } else { 0xffff };
                if index % 7 == 0 {
                    // A masked-out lane may hold any values.
                    six[index as usize % 6][2] = [f32::NAN, f32::INFINITY][index as usize % 2];
                }
                let [all, by_beam] = [false, true].map(|is_by_beam| {
                    dispatch!(level, simd => hits(simd, &geometry, &six, lanes, is_by_beam))
                });
                assert_eq!(by_beam, all, "{level:?}, packet {index}");
                met += by_beam.1.iter().filter(|id| **id != NONE).count();
            }
        }
        assert!(met > 10_000, "only {met} rays meet anything");
    }

    #[test]
    fn a_beam_meets_what_is_in_its_way_only() {
        let at = |x: f32, y: f32| Bounds {
            min: Vec3::new(x, y, -0.1),
            max: Vec3::new(x + 0.2, y + 0.2, 0.1),
        };
        let bounds = (0..40).map(|i| at((i / 4) as f32, (i % 4) as f32 - 0.1));
        let groups = BoundsGroups::new(bounds, Clusters::NONE, 20.0);
        let ahead = Beam::between(
            [-1.0, 0.0, 0.0],
            Vec3::new(1.0, -0.01, 0.0),
            Vec3::new(1.0, 0.01, 0.0),
        );
        for level in CpuTracer::levels_available() {
            let [met, all] = [Some(&ahead), None].map(|beam| {
                dispatch!(level, simd => {
                    let groups = &groups;
                    let x = Vec3x::splat(simd, [1.0, 0.0, 0.0]);
                    let rays = Rays::new(simd, x, x, Word::splat(simd, NONE));
                    let limit = Float::splat(simd, f32::INFINITY);
                    let met = (0..groups.len())
                        .flat_map(|group| groups.met(simd, group, &rays, beam, limit));
                    met.collect::<Vec<usize>>()
                })
            });
            assert_eq!(met, (0..40).step_by(4).collect::<Vec<_>>(), "{level:?}");
            assert_eq!(all, (0..40).collect::<Vec<_>>(), "{level:?}");
        }
    }

    #[test]
    fn rays_that_are_not_finite_have_no_beam() {
        for (place, value) in [(0, f32::NAN), (4, f32::NAN), (2, f32::NEG_INFINITY)] {
            let mut six = packet(1, 0.1);
            six[place][3] = value;
            let is_there = dispatch!(crate::simd::Level::new(), simd => {
                let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
                let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
                let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
                let (all, far) = (Mask::splat(simd, true), Float::splat(simd, 1.0));
                Beam::new(simd, &rays, all, far).is_some()
            });
            assert!(!is_there, "{value} in column {place}");
        }
    }
}
