//! Beams: what a whole packet of rays may meet, found for many primitives at once.
//!
//! Rays of neighbouring pixels leave from about the same place in about the same direction. At a distance t all of
//! them are within a box whose faces move linearly with t, so that each face of a primitive's bounds gives an interval
//! of t, and the bounds are met only where the intervals of all six overlap: interval arithmetic over the packet
//! (Boulos, Wald and Shirley, "Geometric and Arithmetic Culling Methods for Entire Ray Packets", 2006), turned around
//! so that a lane is a primitive. Whatever is left out is met by none of the rays.

use fearless_simd::{f32x4, f32x8, prelude::*};
use glam::Vec3;

use super::lanes::{Float, LANES, Mask, Vec3x};
use super::rays::{DIRECTION_MIN, Rays};
use crate::bvh::{Bounds, SLACK};
use crate::compiled::clusters::{Clusters, union};

/// A box round all rays of a packet at each distance from their origins.
pub(super) struct Beam {
    /// By axis: the face of the smaller coordinates, then the other.
    faces: [[Face; 2]; 3],
    /// To the end of the longest ray, in lengths of their directions.
    distance: f32,
}

/// A face of the box, which moves along its axis.
#[derive(Clone, Copy)]
struct Face {
    origin: f32,
    /// 1 / velocity, without infinities.
    inverse: f32,
}

/// Bounds of primitives, by [`LANES`] of them.
pub(super) struct BoundsGroups {
    groups: Vec<BoundsGroup>,
}

struct BoundsGroup {
    /// Corners of the smallest coordinates, then of the largest.
    bounds: [[f32; LANES]; 6],
    /// Primitives that are in no cluster, a bit each.
    single: u32,
    clusters: Vec<BoundsCluster>,
}

/// Primitives of a group that lie together: rays that do not meet their common bound meet none of them.
struct BoundsCluster {
    min: [f32; 3],
    max: [f32; 3],
    /// A bit each.
    members: u32,
}

impl Beam {
    /// The beam of the rays of `lanes`, as far as `distance`; none if one of them is not finite.
    #[inline(always)]
    pub(super) fn new<S: Simd>(
        simd: S,
        rays: &Rays<S>,
        lanes: Mask<S>,
        distance: Float<S>,
    ) -> Option<Self> {
        let (o, d) = (rays.origin, rays.direction);
        // Not a number where one of them is not finite.
        // One comparison instead of six: ∞ · 0 and NaN · 0 are NaN, which is not equal to itself.
        let zero = (o.x + o.y + o.z + d.x + d.y + d.z) * 0.0;
        if (lanes & !zero.simd_eq(zero)).any_true() {
            return None;
        }
        // The largest, by the one reduction there is.
        let distance = -least(simd, -distance, lanes);
        Some(Self {
            faces: [
                faces(simd, o.x, d.x, lanes),
                faces(simd, o.y, d.y, lanes),
                faces(simd, o.z, d.z, lanes),
            ],
            // Below ∞, where the bounds of no primitive begin.
            distance: distance.min(f32::MAX),
        })
    }

    /// The beam of all rays from a point whose directions, of any length, lie between two.
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

    /// Which bounds of a group overlap the box somewhere, a bit each.
    #[inline(always)]
    fn meets<S: Simd>(&self, simd: S, bounds: &[[f32; LANES]; 6]) -> u32 {
        let [x, y, z, max_x, max_y, max_z] = bounds;
        let min = Vec3x::load_arrays(simd, &[*x, *y, *z]);
        let max = Vec3x::load_arrays(simd, &[*max_x, *max_y, *max_z]);
        let (begin, end) = self.overlap(min, max);
        begin.simd_le(end).to_bitmask() as u32
    }

    /// From which distance to which the bounds of a primitive per lane overlap the box; none if the first is larger.
    #[inline(always)]
    pub(super) fn overlap<S: Simd>(&self, min: Vec3x<S>, max: Vec3x<S>) -> (Float<S>, Float<S>) {
        let simd = min.x.token();
        let mut begin = Float::splat(simd, 0.0);
        let mut end = Float::splat(simd, self.distance);
        let bounds = [[min.x, max.x], [min.y, max.y], [min.z, max.z]];
        for ([low, high], [min, max]) in self.faces.into_iter().zip(bounds) {
            // The lower face is at o + v·t. It has to be below the bounds' maximum: t ≤ (max − o)/v if it
            // moves up, and t ≥ that if it moves down. With the upper face and the minimum both
            // comparisons turn round.
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

    /// The largest coordinate of an origin.
    #[inline(always)]
    pub(super) fn origin_max(&self) -> f32 {
        let [[a, b], [c, d], [e, f]] = self.faces.map(|axis| axis.map(|face| face.origin.abs()));
        a.max(b).max(c.max(d)).max(e.max(f))
    }
}

impl Face {
    #[inline(always)]
    fn new(origin: f32, velocity: f32) -> Self {
        // A face that stands still then meets bounds always or, at a t of about ±1e30 metres, never.
        let inverse = 1.0 / velocity.abs().max(DIRECTION_MIN).copysign(velocity);
        Self { origin, inverse }
    }
}

impl BoundsGroups {
    /// `reach` is an upper bound of the coordinates of primitives and of rays' origins together, by which bounds are
    /// widened.
    pub(super) fn new(
        bounds: impl IntoIterator<Item = Bounds>,
        clusters: Clusters,
        reach: f32,
    ) -> Self {
        // Beams are tested in f32 too. Without slack a ray that grazes a face could meet what its
        // beam has left out, and the picture would depend on which rays share a packet.
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

    /// How many groups there are.
    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.groups.len()
    }

    /// Indices of the primitives of a group that the beam may meet, in order; without a beam those that one of the rays
    /// may meet before its `limit`.
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
    /// The `index`-th group of the primitives, of these bounds.
    fn new(of_group: &[Bounds], index: usize, clusters: Clusters) -> Self {
        // Nothing meets what is not there.
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
            // A cluster may be in several groups.
            let members = (members.checked_shr((index * LANES) as u32)).unwrap_or(0);
            let members = members as u32 & group.single;
            if members.count_ones() < 2 {
                continue;
            }
            let own = Indices {
                first: 0,
                bits: members,
            };
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

/// Indices of the bits that are set, in order.
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

/// Both faces of an axis, along which rays begin at `origin` and move by `velocity`.
#[inline(always)]
fn faces<S: Simd>(simd: S, origin: Float<S>, velocity: Float<S>, lanes: Mask<S>) -> [Face; 2] {
    let low = Face::new(least(simd, origin, lanes), least(simd, velocity, lanes));
    let high = [least(simd, -origin, lanes), least(simd, -velocity, lanes)];
    // The smallest origin with the smallest velocity need not be one ray's. The box only grows by that.
    [low, Face::new(-high[0], -high[1])]
}

/// The least of the values of `lanes`.
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

    /// Rays whose origins and directions are as far apart as `spread`, now along an axis and now not.
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

    /// Hits, and where something lies before 2 m, of the `lanes`, by their beam or without.
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
                    // A lane that is left out may hold anything.
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
