//! BVH with 16 children per node: each ray by itself against 16 boxes at once, then against 16 primitives
//! at once.
//!
//! The binary [`Bvh`] with inner nodes collapsed until they have a child per lane (Wald, Benthin and
//! Boulos, "Getting rid of packets", 2008): from the second vertex on rays are incoherent, and a packet
//! would visit nearly the union of the nodes that its rays visit.

mod packet;

use std::marker::PhantomData;

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::rays::{HitMask, NONE, Nearest, Rays};
use super::shapes::{PackedPrimitive, Primitives, Shape};
use crate::bvh::{Bvh, BvhNode, DEPTH_MAX, SLACK};

/// Primitives and the wide BVH over them.
pub(super) struct Bvh16<F, const N: usize> {
    nodes: Vec<Bvh16Node>,
    leaves: Vec<Bvh16Leaf<F, N>>,
    /// Whether some primitive belongs to a dielectric.
    has_dielectric: bool,
    /// Root: index of a node, or of a leaf with [`LEAF_TAG`].
    root: u32,
}

/// Filter of hits, for surfaces that rays may pass through (opacity).
pub(super) trait HitFilter {
    /// Whether the filter may reject hits; if not, it need not be asked.
    fn is_some(&self) -> bool;

    /// Whether a ray that intersects primitive `id` hits it.
    fn is_met(&self, origin: [f32; 3], direction: [f32; 3], id: u32) -> bool;
}

/// Filter that accepts all hits.
pub(super) struct Solid;

impl HitFilter for Solid {
    #[inline(always)]
    fn is_some(&self) -> bool {
        false
    }

    #[inline(always)]
    fn is_met(&self, _: [f32; 3], _: [f32; 3], _: u32) -> bool {
        true
    }
}

/// Flag of an index that refers to a leaf.
const LEAF_TAG: u32 = 1 << 31;

/// Node: bounding boxes and children, by lane. Aligned to a cache line.
#[repr(C, align(64))]
struct Bvh16Node {
    center: [[f32; LANES]; 3],
    half: [[f32; LANES]; 3],
    /// Children: index of a node, or of a leaf with [`LEAF_TAG`].
    parts: [u32; LANES],
    /// Bit mask of the lanes with a child; without it rays with NaN would enter unused lanes too.
    lanes: u64,
}

/// Leaf: primitives by lane; the numbers of unused lanes are NaN. Aligned to a cache line.
#[repr(C, align(64))]
struct Bvh16Leaf<F, const N: usize> {
    numbers: [[f32; LANES]; N],
    id: [u32; LANES],
    shape: PhantomData<F>,
}

/// Components of rays, as arrays by lane.
struct RayLanes {
    origin: [[f32; LANES]; 3],
    direction: [[f32; LANES]; 3],
    inverse: [[f32; LANES]; 3],
    start: [u32; LANES],
}

/// Nodes and leaves still to be visited: at most `LANES − 1` siblings per level of the BVH.
type Stack = [Entry; STACK_PARTS];

const STACK_PARTS: usize = ((DEPTH_MAX + 1) as usize) * LANES;

/// Node or leaf with its entry distance. The distance's bits come first, so that entries compare by
/// distance: non-negative floats and their bit patterns have the same order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry(u64);

impl Entry {
    #[inline(always)]
    fn new(distance: f32, part: u32) -> Self {
        Self(u64::from(distance.to_bits()) << 32 | u64::from(part))
    }

    #[inline(always)]
    fn distance(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    #[inline(always)]
    fn part(self) -> u32 {
        self.0 as u32
    }
}

impl<F: Shape<N>, const N: usize> Bvh16<F, N> {
    /// Builds the wide BVH; `None` in `each` is a hidden primitive, which is left out.
    pub(super) fn new(bvh: &Bvh, each: &[Option<PackedPrimitive<F, N>>]) -> Self {
        let mut bvh16 = Self {
            nodes: Vec::new(),
            leaves: Vec::new(),
            has_dielectric: each.iter().flatten().any(|one| one.is_dielectric),
            root: 0,
        };
        let slack = bvh.slack();
        bvh16.root = Bvh16Builder { bvh, each, slack }.build(&mut bvh16, &bvh.root);
        bvh16
    }

    /// Updates `nearest` by hits that `filter` accepts and that are nearer, or equally far with a smaller
    /// id.
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        nearest: &mut Nearest<S>,
        filter: &impl HitFilter,
    ) {
        let (distance, id) = simd.vectorize(
            #[inline(always)]
            || self.nearest_by_lane(simd, rays, nearest, filter),
        );
        nearest.distance = Float::load_array(simd, distance);
        nearest.id = Word::load_array(simd, id);
    }

    #[inline(always)]
    fn nearest_by_lane<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        nearest: &Nearest<S>,
        filter: &impl HitFilter,
    ) -> ([f32; LANES], [u32; LANES]) {
        let columns = RayLanes::new(rays);
        let mut stack = [Entry(0); STACK_PARTS];
        let (mut distance, mut id) = (nearest.distance.to_array(), nearest.id.to_array());
        for lane in 0..LANES {
            if !columns.is_finite(lane) {
                continue;
            }
            let ray = columns.ray(simd, lane);
            let frame = F::frame(simd, &ray);
            let slack = origin_slack(&ray);
            // A local of its own rather than a field of the stack, so that it stays in a register.
            // Number of entries on the stack.
            let mut waiting = 0;
            let mut next = Some(Entry::new(0.0, self.root));
            while let Some(entry) = next {
                let part = entry.part();
                if part & LEAF_TAG == 0 {
                    let node = &self.nodes[part as usize];
                    let (entries, hits) = node.enter(simd, &ray, slack, distance[lane]);
                    // The nearest child is visited at once: it never goes through the stack, where its
                    // distance would be compared again.
                    if hits != 0 {
                        let nearest;
                        (nearest, waiting) =
                            queue(&entries, &node.parts, hits, &mut stack, waiting);
                        next = Some(nearest);
                        continue;
                    }
                } else {
                    let leaf = &self.leaves[(part & !LEAF_TAG) as usize];
                    let nearest = (&mut distance[lane], &mut id[lane]);
                    self.update(simd, leaf, (&ray, &frame), nearest, |id| {
                        columns.is_met(lane, id, filter)
                    });
                }
                (next, waiting) = pop(&stack, waiting, distance[lane]);
            }
        }
        (distance, id)
    }

    /// Updates the nearest hit by the hits of a leaf that are nearer, or equally far with a smaller id:
    /// so the result does not depend on the order of traversal.
    #[inline(always)]
    fn update<S: Simd>(
        &self,
        simd: S,
        leaf: &Bvh16Leaf<F, N>,
        (ray, frame): (&Rays<S>, &F::Frame<S>),
        (distance, id): (&mut f32, &mut u32),
        is_met: impl Fn(u32) -> bool,
    ) {
        // Shapes report hits strictly before the limit. The next larger float admits hits at equal
        // distance, of which the smaller id wins, as in a linear search in the order of ids.
        let Some((hit, t)) = self.meet(simd, leaf, ray, frame, distance.next_up()) else {
            return;
        };
        let (t, mut hits) = (t.to_array(), hit.to_bitmask());
        while hits != 0 {
            let at = hits.trailing_zeros() as usize % LANES;
            hits &= hits - 1;
            let met = (t[at], leaf.id[at]);
            // The filter comes last: a texture look-up of opacity costs far more than both comparisons.
            if met < (*distance, *id) && is_met(met.1) {
                (*distance, *id) = met;
            }
        }
    }

    /// Sets the lanes in `dark` whose ray hits a primitive that `filter` accepts before `distance`.
    #[inline(always)]
    pub(super) fn occlude<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        distance: Float<S>,
        dark: &mut Mask<S>,
        filter: &impl HitFilter,
    ) {
        let lanes = dark.to_bitmask();
        let lanes = simd.vectorize(
            #[inline(always)]
            || self.occlude_by_lane(simd, rays, distance, lanes, filter),
        );
        *dark = Mask::from_bitmask(simd, lanes);
    }

    #[inline(always)]
    fn occlude_by_lane<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        distance: Float<S>,
        mut dark: u64,
        filter: &impl HitFilter,
    ) -> u64 {
        let columns = RayLanes::new(rays);
        let mut stack = [Entry(0); STACK_PARTS];
        for (lane, limit) in distance.to_array().into_iter().enumerate() {
            // Distance 0 marks a lane without a shadow ray; a lane that is dark already needs no further
            // occluder.
            if limit <= 0.0 || dark >> lane & 1 == 1 || !columns.is_finite(lane) {
                continue;
            }
            let ray = columns.ray(simd, lane);
            let frame = F::frame(simd, &ray);
            let slack = origin_slack(&ray);
            let mut waiting = 0;
            let mut next = Some(Entry::new(0.0, self.root));
            while let Some(entry) = next {
                let part = entry.part();
                if part & LEAF_TAG == 0 {
                    let node = &self.nodes[part as usize];
                    let (entries, hits) = node.enter(simd, &ray, slack, limit);
                    if hits != 0 {
                        let nearest;
                        (nearest, waiting) =
                            queue(&entries, &node.parts, hits, &mut stack, waiting);
                        next = Some(nearest);
                        continue;
                    }
                } else {
                    let leaf = &self.leaves[(part & !LEAF_TAG) as usize];
                    let met = self.meet(simd, leaf, &ray, &frame, limit);
                    let mut hits = met.map_or(0, |(hit, _)| hit.to_bitmask());
                    if filter.is_some() {
                        hits = columns.met(lane, hits, &leaf.id, filter);
                    }
                    if hits != 0 {
                        dark |= 1 << lane;
                        break; // any hit will do
                    }
                }
                (next, waiting) = pop(&stack, waiting, limit);
            }
        }
        dark
    }

    /// Hits of a ray on the primitives of a leaf before `limit`.
    #[inline(always)]
    fn meet<S: Simd>(
        &self,
        simd: S,
        leaf: &Bvh16Leaf<F, N>,
        ray: &Rays<S>,
        frame: &F::Frame<S>,
        limit: f32,
    ) -> HitMask<S> {
        let mut numbers = [Float::splat(simd, 0.0); N];
        for (lanes, number) in numbers.iter_mut().zip(&leaf.numbers) {
            *lanes = Float::load_array(simd, *number);
        }
        let primitives = Primitives {
            numbers,
            id: Word::load_array(simd, leaf.id),
            has_dielectric: self.has_dielectric,
        };
        let (hit, t) = F::intersect(ray, frame, &primitives, Float::splat(simd, limit))?;
        Some((hit & primitives.id.simd_ne(NONE), t))
    }
}

impl Bvh16Node {
    /// Distances at which a ray enters the children's boxes, and the bit mask of those that it enters up
    /// to `limit`.
    #[inline(always)]
    fn enter<S: Simd>(
        &self,
        simd: S,
        ray: &Rays<S>,
        slack: Float<S>,
        limit: f32,
    ) -> ([f32; LANES], u64) {
        let center = Vec3x::load_arrays(simd, &self.center);
        let half = Vec3x::load_arrays(simd, &self.half);
        // The boxes' own slack covers rounding relative to the coordinates of the scene, this one rounding
        // relative to the ray's origin.
        let half = Vec3x::new(half.x + slack, half.y + slack, half.z + slack);
        // Slab test by centre and half extent: multiplying by |1/d| orders near and far planes by itself,
        // where corners need a minimum and a maximum more per axis.
        let middle = (center - ray.origin).scale(ray.inverse);
        let near = (-half).scale_add(ray.inverse_abs, middle);
        let far = half.scale_add(ray.inverse_abs, middle);
        // Clamped to 0, so that the distances' bits can be compared as integers.
        let entry = near.x.max(near.y).max(near.z.max(0.0));
        let exit = far.x.min(far.y).min(far.z.min(limit));
        // Unused lanes hold a box of size 0 at the origin, which a ray from there would enter.
        let hits = entry.simd_le(exit).to_bitmask() & self.lanes;
        (entry.to_array(), hits)
    }
}

/// Returns the nearest of the children in `hits` (not empty) and the new stack height. The other children
/// are pushed above the `waiting` entries of the stack, the nearest on top.
#[inline(always)]
fn queue(
    entries: &[f32; LANES],
    parts: &[u32; LANES],
    mut hits: u64,
    stack: &mut Stack,
    waiting: usize,
) -> (Entry, usize) {
    let (mut nearest, mut top) = (next(entries, parts, &mut hits), waiting);
    while hits != 0 {
        let entry = next(entries, parts, &mut hits);
        // A running minimum, and insertion sort of the others: cheapest where a ray enters few boxes.
        let farther = nearest.max(entry);
        nearest = nearest.min(entry);
        let mut at = top;
        while at > waiting && stack[at - 1] < farther {
            stack[at] = stack[at - 1];
            at -= 1;
        }
        stack[at] = farther;
        top += 1;
    }
    (nearest, top)
}

#[inline(always)]
fn next(entries: &[f32; LANES], parts: &[u32; LANES], hits: &mut u64) -> Entry {
    // The remainder changes no value but proves the index in bounds, which removes the bounds check.
    let lane = hits.trailing_zeros() as usize % LANES;
    *hits &= *hits - 1;
    Entry::new(entries[lane], parts[lane])
}

impl RayLanes {
    #[inline(always)]
    fn new<S: Simd>(rays: &Rays<S>) -> Self {
        let columns = |v: Vec3x<S>| [v.x.to_array(), v.y.to_array(), v.z.to_array()];
        Self {
            origin: columns(rays.origin),
            direction: columns(rays.direction),
            inverse: columns(rays.inverse),
            start: rays.start.to_array(),
        }
    }

    /// Whether the origin of a lane's ray is finite. Lanes of terminated paths may hold NaN, which would
    /// enter every box.
    #[inline(always)]
    fn is_finite(&self, lane: usize) -> bool {
        self.origin.iter().all(|column| column[lane].is_finite())
    }

    #[inline(always)]
    fn is_met(&self, lane: usize, id: u32, filter: &impl HitFilter) -> bool {
        let vector = |columns: &[[f32; LANES]; 3]| columns.map(|column| column[lane]);
        !filter.is_some() || filter.is_met(vector(&self.origin), vector(&self.direction), id)
    }

    /// Subset of `hits` whose primitives the filter lets a lane's ray hit.
    #[inline(always)]
    fn met(&self, lane: usize, hits: u64, ids: &[u32; LANES], filter: &impl HitFilter) -> u64 {
        let bits = (0..LANES).filter(|at| hits >> at & 1 == 1);
        let met = bits.filter(|at| self.is_met(lane, ids[*at], filter));
        met.fold(0, |bits, at| bits | 1 << at)
    }

    /// Broadcasts the ray of one lane to all lanes.
    #[inline(always)]
    fn ray<S: Simd>(&self, simd: S, lane: usize) -> Rays<S> {
        let inverse = splat(simd, &self.inverse, lane);
        Rays {
            origin: splat(simd, &self.origin, lane),
            direction: splat(simd, &self.direction, lane),
            start: Word::splat(simd, self.start[lane]),
            inverse,
            inverse_abs: inverse.abs(),
        }
    }
}

/// Slack of boxes for rounding at the coordinates of a ray's origin. A slack by the extent of the whole
/// scene would enlarge the boxes of a small mesh on a floor of 10 km so much that they cull nothing.
#[inline(always)]
fn origin_slack<S: Simd>(ray: &Rays<S>) -> Float<S> {
    let origin = &ray.origin;
    origin.x.abs().max(origin.y.abs()).max(origin.z.abs()) * SLACK
}

#[inline(always)]
fn splat<S: Simd>(simd: S, [x, y, z]: &[[f32; LANES]; 3], lane: usize) -> Vec3x<S> {
    Vec3x::splat(simd, [x[lane], y[lane], z[lane]])
}

/// Pops the next entry up to `limit`, and returns it with the remaining stack height.
#[inline(always)]
fn pop(stack: &Stack, mut waiting: usize, limit: f32) -> (Option<Entry>, usize) {
    while waiting > 0 {
        waiting -= 1;
        let entry = stack[waiting];
        // Only siblings are sorted among themselves: entries below one that is too far may still be near
        // enough, so the search goes on.
        if entry.distance() <= limit {
            return (Some(entry), waiting);
        }
    }
    (None, 0)
}

/// Inputs of the BVH construction.
struct Bvh16Builder<'a, F, const N: usize> {
    bvh: &'a Bvh,
    each: &'a [Option<PackedPrimitive<F, N>>],
    /// Amount by which all boxes are enlarged; rays add the slack of their origin ([`origin_slack`]).
    slack: f32,
}

impl<F, const N: usize> Bvh16Builder<'_, F, N> {
    /// Converts `subtree` and returns its index, with [`LEAF_TAG`] if it is a leaf.
    fn build(&self, bvh16: &mut Bvh16<F, N>, subtree: &BvhNode) -> u32 {
        if subtree.count as usize <= LANES {
            bvh16.leaves.push(self.leaf(subtree));
            return LEAF_TAG | (bvh16.leaves.len() - 1) as u32;
        }
        // Depth first, so that a node and its first child are adjacent in memory.
        let number = bvh16.nodes.len();
        bvh16.nodes.push(Bvh16Node {
            center: [[0.0; LANES]; 3],
            half: [[0.0; LANES]; 3],
            parts: [0; LANES],
            lanes: 0,
        });
        for (lane, part) in self.parts(subtree).iter().enumerate() {
            let center = 0.5 * (part.min + part.max);
            // Maximum of both differences: the centre is rounded, and the half extent has to reach the
            // farther corner.
            let half = (part.max - center).max(center - part.min) + self.slack;
            let child = self.build(bvh16, part);
            let node = &mut bvh16.nodes[number];
            for axis in 0..3 {
                node.center[axis][lane] = center[axis];
                node.half[axis][lane] = half[axis];
            }
            node.parts[lane] = child;
            node.lanes |= 1 << lane;
        }
        number as u32
    }

    /// Collapses `subtree` to up to one child per lane, opening the child of the largest surface area,
    /// which most rays enter, first.
    fn parts(&self, subtree: &BvhNode) -> Vec<BvhNode> {
        let mut parts = vec![*subtree];
        while parts.len() < LANES {
            let divisible = parts.iter().enumerate();
            // What fits a leaf stays whole: opened, it would be spread over several leaves, each of which
            // costs a full step.
            let divisible = divisible.filter(|(_, part)| part.count as usize > LANES);
            let largest =
                divisible.max_by(|(_, a), (_, b)| a.half_area().total_cmp(&b.half_area()));
            let Some((place, part)) = largest else {
                break;
            };
            let [left, right] = self.bvh.nodes[part.node as usize];
            parts[place] = left;
            parts.push(right);
        }
        parts
    }

    fn leaf(&self, subtree: &BvhNode) -> Bvh16Leaf<F, N> {
        let mut leaf = Bvh16Leaf {
            numbers: [[f32::NAN; LANES]; N],
            id: [NONE; LANES],
            shape: PhantomData,
        };
        let order = &self.bvh.order[subtree.first as usize..][..subtree.count as usize];
        let visible = order
            .iter()
            .filter_map(|&id| self.each[id as usize].as_ref());
        for (lane, one) in visible.enumerate() {
            for (column, number) in leaf.numbers.iter_mut().zip(one.numbers) {
                column[lane] = number;
            }
            leaf.id[lane] = one.id;
        }
        leaf
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::geometry::Geometry;
    use super::super::rays::INSIDE;
    use super::super::shapes::join;
    use super::super::shared_edges::SharedEdges;
    use super::super::triangle::Triangle;
    use super::*;
    use crate::bvh::test_scenes::{ARRANGEMENTS, SHAPES, ray, test_scene};
    use crate::compiled::{BvhUse, KIND_DIELECTRIC, ShapeKind};
    use crate::simd::{Level, dispatch};
    use crate::{CompiledScene, CpuTracer};

    type Packet = ([[f32; LANES]; 6], [u32; LANES]);
    type Answer = ([u32; LANES], [u32; LANES], [u64; 2]);

    /// Bits of the distance to the nearest primitive, its id, and occlusion before half and before twice
    /// that distance.
    #[inline(always)]
    fn nearest_hits<S: Simd>(simd: S, geometry: &Geometry, (six, start): &Packet) -> Answer {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::load_array(simd, *start));
        let nearest = geometry.nearest(simd, &rays, None);
        let (none, one) = (Word::splat(simd, NONE), Float::splat(simd, 1.0));
        let met = nearest.id.simd_ne(NONE);
        let limit = met.select(nearest.distance, one);
        let outwards = Word::load_array(simd, start.map(|id| id & !INSIDE));
        let shadows = Rays::new(simd, origin, direction, outwards);
        let occluded = |limit| {
            geometry
                .occluded(simd, &shadows, None, limit, none)
                .to_bitmask()
        };
        (
            nearest.distance.to_array().map(f32::to_bits),
            nearest.id.to_array(),
            [occluded(limit * 0.5), occluded(limit * 2.0)],
        )
    }

    fn packets(scene: &CompiledScene, seed: u32, count: u32) -> Vec<Packet> {
        let packet = |packet: u32| {
            let mut columns: Packet = ([[0.0; LANES]; 6], [NONE; LANES]);
            for lane in 0..LANES {
                let ray = ray(scene, seed, packet * LANES as u32 + lane as u32);
                for axis in 0..3 {
                    columns.0[axis][lane] = ray.origin[axis];
                    columns.0[axis + 3][lane] = ray.direction[axis];
                }
                columns.1[lane] = match ray.left {
                    Some(left) if ray.is_inside => left | INSIDE,
                    Some(left) => left,
                    None => NONE,
                };
            }
            columns
        };
        (0..count).map(packet).collect()
    }

    /// Compares the BVH with a linear search; returns the number of hits.
    fn compare(level: Level, mut scene: CompiledScene, packets: &[Packet]) -> u32 {
        scene.bvh_use = BvhUse::Never;
        let each = Geometry::new(&scene);
        scene.bvh_use = BvhUse::Always;
        let bvh = Geometry::new(&scene);
        let mut hits = 0;
        for packet in packets {
            let expected = dispatch!(level, simd => nearest_hits(simd, &each, packet));
            let found = dispatch!(level, simd => nearest_hits(simd, &bvh, packet));
            assert_eq!(found, expected, "{level:?} {packet:?}");
            hits += expected.1.iter().filter(|id| **id != NONE).count() as u32;
        }
        hits
    }

    #[test]
    fn bvh16_hits_equal_those_of_a_linear_scan() {
        const PACKETS: u32 = 20_000 / LANES as u32 / 5;
        for level in CpuTracer::levels_available() {
            for shape in SHAPES {
                for kind in ARRANGEMENTS {
                    for (seed, count) in (0..).zip([5, 17, 64, 300, 1500]) {
                        let scene = test_scene(kind, shape, count, seed);
                        let packets = packets(&scene, seed, PACKETS);
                        let hits = compare(level, scene, &packets);
                        assert!(
                            hits > PACKETS / 2,
                            "{shape:?} {kind:?}, {count}: {hits} hits"
                        );
                    }
                }
            }
        }
    }

    /// A box, a second one of glass and a square, as triangles that share corners and edges.
    fn small_meshes() -> CompiledScene {
        use crate::{Camera, Material, Mesh, Scene};
        let block = |center: Vec3, half: f32| {
            let corner = |i: u32| Vec3::from([i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32));
            let corners = (0..8).map(|i| center + half * (2.0 * corner(i) - 1.0));
            let faces = [
                [0, 2, 3, 1],
                [4, 5, 7, 6],
                [0, 1, 5, 4],
                [2, 6, 7, 3],
                [0, 4, 6, 2],
                [1, 3, 7, 5],
            ];
            let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
            Mesh::new(
                corners.collect(),
                faces.into_iter().flat_map(halves).collect(),
            )
        };
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let square = square.map(|[x, y]| Vec3::new(x, y, -0.5));
        let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 1.0], [0.0; 3]));
        scene.add_named("box", block(Vec3::ZERO, 0.5), Material::diffuse(Vec3::ONE));
        scene.add_named(
            "glass",
            block(Vec3::new(0.3, 0.8, 0.1), 0.4),
            Material::glass(),
        );
        scene.add_named(
            "square",
            Mesh::new(square.into(), vec![[0, 1, 2], [0, 2, 3]]),
            Material::diffuse(Vec3::ONE),
        );
        CompiledScene::new(&scene).unwrap()
    }

    /// Rays to corners of triangles and to points on their edges, from random origins and along an axis.
    fn packets_at_edges(scene: &CompiledScene, count: u32) -> Vec<Packet> {
        let mut packets = packets(scene, 2, count);
        for (i, lane) in (0..count * LANES as u32).zip((0..LANES).cycle()) {
            let triangles = &scene.meshes.triangles;
            let [a, b, _] = triangles[i as usize * 7 % triangles.len()].corners();
            let aim = a.lerp(b, [0.0, 0.5, 0.3][i as usize % 3]);
            let [x, y, z, _] = crate::sampling::uniforms(i, 6, 1, 3);
            let origin = match i % 5 {
                0 => aim + 2.0 * Vec3::AXES[i as usize / 5 % 3],
                _ => 4.0 * (Vec3::new(x, y, z) - 0.5),
            };
            let direction = (aim - origin).normalize();
            let (six, start) = &mut packets[i as usize / LANES];
            start[lane] = NONE;
            for axis in 0..3 {
                six[axis][lane] = origin[axis];
                six[axis + 3][lane] = direction[axis];
            }
        }
        packets
    }

    /// Bits of distances, ids and occlusion: of the triangles by shared edges, then of each by itself.
    #[inline(always)]
    fn by_edges_and_each<S: Simd>(
        simd: S,
        triangles: &[([[f32; 3]; 3], bool)],
        (six, start): &Packet,
    ) -> [([u32; LANES], [u32; LANES], u64); 2] {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::load_array(simd, *start));
        let (reach, dark) = (Float::splat(simd, 2.0), Mask::splat(simd, false));
        let (mut by_edges, mut each) = (Nearest::none(simd), Nearest::none(simd));
        let mut darks = [dark, dark];
        let shared = SharedEdges::new(triangles.iter().copied(), 0).unwrap();
        shared.nearest(simd, &rays, &mut by_edges);
        shared.occlude(simd, &rays, reach, &mut darks[0]);
        let frame = Triangle::frame(simd, &rays);
        for (&(corners, is_dielectric), id) in triangles.iter().zip(0..) {
            let one = PackedPrimitive::<Triangle, 9>::new(join(corners), id, is_dielectric);
            let one = one.splat(simd);
            let met = Triangle::intersect(&rays, &frame, &one, each.distance);
            each.update(met, id);
            if let Some((hit, _)) = Triangle::intersect(&rays, &frame, &one, reach) {
                darks[1] |= hit;
            }
        }
        let bits = |nearest: Nearest<S>, dark: Mask<S>| {
            let distance = nearest.distance.to_array().map(f32::to_bits);
            (distance, nearest.id.to_array(), dark.to_bitmask())
        };
        [bits(by_edges, darks[0]), bits(each, darks[1])]
    }

    #[test]
    fn triangles_by_shared_edges_are_met_as_each_by_itself() {
        let scene = small_meshes();
        let triangles = scene.meshes.triangles.iter().map(|data| {
            let is_glass = scene.materials[data.material as usize].kind == KIND_DIELECTRIC;
            ([data.a, data.b, data.c], is_glass)
        });
        let triangles: Vec<_> = triangles.collect();
        for level in CpuTracer::levels_available() {
            for packets in [packets(&scene, 1, 4_000), packets_at_edges(&scene, 1_000)] {
                let mut met = 0;
                for packet in &packets {
                    let [by_edges, each] =
                        dispatch!(level, simd => by_edges_and_each(simd, &triangles, packet));
                    assert_eq!(by_edges, each, "{level:?} {packet:?}");
                    met += each.1.iter().filter(|id| **id != NONE).count();
                }
                assert!(met > 4 * packets.len(), "{met} hits");
            }
        }
    }

    /// Like [`compare`]; for rays with origins that are not finite, checks that the BVH reports no hits.
    fn compare_or_miss(scene: &CompiledScene, packet: Packet) {
        let level = Level::new();
        if packet.0[..3].iter().flatten().all(|c| c.is_finite()) {
            compare(level, scene.clone(), &[packet]);
            return;
        }
        let mut scene = scene.clone();
        scene.bvh_use = BvhUse::Always;
        let bvh = Geometry::new(&scene);
        let found = dispatch!(level, simd => nearest_hits(simd, &bvh, &packet));
        assert_eq!((found.1, found.2), ([NONE; LANES], [0; 2]), "{packet:?}");
    }

    #[test]
    fn rays_that_begin_nowhere_miss_and_directions_that_are_none_change_nothing() {
        for shape in SHAPES {
            let scene = test_scene(ARRANGEMENTS[0], shape, 300, 0);
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, 1e-40] {
                for column in 0..6 {
                    let mut packet: Packet = ([[0.1; LANES]; 6], [NONE; LANES]);
                    packet.0[column] = [bad; LANES];
                    compare_or_miss(&scene, packet);
                }
            }
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0] {
                compare_or_miss(&scene, ([[bad; LANES]; 6], [NONE; LANES]));
            }
        }
    }

    #[test]
    fn moved_and_hidden_balls_are_found_where_they_are() {
        use crate::{ObjectPose, SceneUpdate};
        let mut scene = test_scene(ARRANGEMENTS[0], ShapeKind::Sphere, 200, 3);
        scene.bvh_use = BvhUse::Always;
        assert!(scene.bvh(ShapeKind::Sphere, 0).is_some());
        let poses = (0..60).map(|object| ObjectPose {
            object,
            position: Vec3::new(0.02 * object as f32 - 0.6, 0.3, 1.2),
            rotation: glam::Quat::IDENTITY,
            visible: object % 3 != 0,
        });
        let update = SceneUpdate {
            camera: None,
            poses: poses.collect(),
            ..SceneUpdate::default()
        };
        scene.apply(&update).unwrap();
        let packets = packets(&scene, 9, 200);
        compare(Level::new(), scene, &packets);
    }
}
