//! Many primitives of a shape: each ray by itself against the boxes of sixteen parts at once, then
//! against sixteen primitives at once.
//!
//! The [`Tree`] with inner nodes joined until they have a part per lane (Wald, Benthin and
//! Boulos, "Getting rid of packets", 2008): paths have spread by their second ray, and packets of
//! them would visit nearly all that each of their rays does.

use std::marker::PhantomData;

use fearless_simd::prelude::*;

use super::geometry::{NONE, Nearest, One, Rays};
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::shapes::{Meeting, Shape, Solids};
use crate::tree::{DEPTH_MAX, SLACK, Subtree, Tree};

/// Primitives under a tree of wide nodes.
pub(super) struct Forest<F, const N: usize> {
    branches: Vec<Branch>,
    packs: Vec<Pack<F, N>>,
    /// A branch, or with [`PACK`] a pack.
    root: u32,
}

/// Set in the number of a pack.
const PACK: u32 = 1 << 31;

/// Boxes of a node's parts, by lane.
struct Branch {
    /// A bit for each lane that has a part: rays that are no numbers enter any box.
    lanes: u64,
    center: [[f32; LANES]; 3],
    half: [[f32; LANES]; 3],
    parts: [u32; LANES],
}

/// Primitives by lane; the numbers of lanes without one are NaN.
struct Pack<F, const N: usize> {
    numbers: [[f32; LANES]; N],
    id: [u32; LANES],
    has_clear: bool,
    shape: PhantomData<F>,
}

/// Rays by lane.
struct Columns {
    origin: [[f32; LANES]; 3],
    direction: [[f32; LANES]; 3],
    inverse: [[f32; LANES]; 3],
    skip: [u32; LANES],
}

/// Parts still to be visited, each with the distance at which the ray enters its box: on every
/// level of the tree at most one fewer than lanes.
struct Stack {
    parts: [(f32, u32); STACK_PARTS],
    len: usize,
}

const STACK_PARTS: usize = ((DEPTH_MAX + 1) as usize) * LANES;

impl<F: Shape<N>, const N: usize> Forest<F, N> {
    /// Of what is not hidden of `each`. `reach` is twice the largest coordinate of the scene.
    pub(super) fn new(tree: &Tree, each: &[Option<One<F, N>>], reach: f32) -> Self {
        let mut forest = Self {
            branches: Vec::new(),
            packs: Vec::new(),
            root: 0,
        };
        forest.root = Growth { tree, each, reach }.grow(&mut forest, &tree.root);
        forest
    }

    /// Takes what rays meet before what they have met, or as far away with a smaller id.
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(&self, simd: S, rays: &Rays<S>, nearest: &mut Nearest<S>) {
        let (distance, id) = simd.vectorize(
            #[inline(always)]
            || self.nearest_by_lane(simd, rays, nearest),
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
    ) -> ([f32; LANES], [u32; LANES]) {
        let columns = Columns::of(rays);
        let mut stack = Stack::new();
        let (mut distance, mut id) = (nearest.distance.to_array(), nearest.id.to_array());
        for lane in 0..LANES {
            let ray = columns.ray(simd, lane);
            stack.push(0.0, self.root);
            while let Some((entry, part)) = stack.pop() {
                if entry > distance[lane] {
                    continue;
                }
                if part & PACK == 0 {
                    let branch = &self.branches[part as usize];
                    branch.enter(simd, &ray, distance[lane], &mut stack);
                    continue;
                }
                let pack = &self.packs[(part & !PACK) as usize];
                let Some((hit, t)) = pack.meet(simd, &ray, distance[lane].next_up()) else {
                    continue;
                };
                let (t, mut hits) = (t.to_array(), hit.to_bitmask());
                while hits != 0 {
                    let at = hits.trailing_zeros() as usize % LANES;
                    hits &= hits - 1;
                    let met = (t[at], pack.id[at]);
                    if met < (distance[lane], id[lane]) {
                        (distance[lane], id[lane]) = met;
                    }
                }
            }
        }
        (distance, id)
    }

    /// Adds where a primitive lies before `distance` to `dark`.
    #[inline(always)]
    pub(super) fn occlude<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        distance: Float<S>,
        dark: &mut Mask<S>,
    ) {
        let lanes = dark.to_bitmask();
        let lanes = simd.vectorize(
            #[inline(always)]
            || self.occlude_by_lane(simd, rays, distance, lanes),
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
    ) -> u64 {
        let columns = Columns::of(rays);
        let mut stack = Stack::new();
        for (lane, limit) in distance.to_array().into_iter().enumerate() {
            if limit <= 0.0 || dark >> lane & 1 == 1 {
                continue;
            }
            let ray = columns.ray(simd, lane);
            stack.push(0.0, self.root);
            while let Some((_, part)) = stack.pop() {
                if part & PACK == 0 {
                    let branch = &self.branches[part as usize];
                    branch.enter(simd, &ray, limit, &mut stack);
                    continue;
                }
                let met = self.packs[(part & !PACK) as usize].meet(simd, &ray, limit);
                if met.is_some_and(|(hit, _)| hit.any_true()) {
                    dark |= 1 << lane;
                    stack.len = 0;
                }
            }
        }
        dark
    }
}

impl Branch {
    /// Puts the parts whose boxes the ray enters up to `limit` on the stack, the nearest on top.
    #[inline(always)]
    fn enter<S: Simd>(&self, simd: S, ray: &Rays<S>, limit: f32, stack: &mut Stack) {
        let center = load(simd, &self.center);
        let half = load(simd, &self.half);
        let middle = (center - ray.origin).scale(ray.inverse);
        let near = (-half).scale_add(ray.inverse_abs, middle);
        let far = half.scale_add(ray.inverse_abs, middle);
        let entry = near.x.max(near.y).max(near.z).max(0.0);
        let exit = far.x.min(far.y).min(far.z).min(limit);
        let mut hits = entry.simd_le(exit).to_bitmask() & self.lanes;
        if hits == 0 {
            return;
        }
        let (entry, bottom) = (entry.to_array(), stack.len);
        while hits != 0 {
            let lane = hits.trailing_zeros() as usize % LANES;
            hits &= hits - 1;
            stack.insert(bottom, entry[lane], self.parts[lane]);
        }
    }
}

impl<F: Shape<N>, const N: usize> Pack<F, N> {
    /// Where the ray meets primitives before `limit`.
    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, ray: &Rays<S>, limit: f32) -> Meeting<S> {
        let mut numbers = [Float::splat(simd, 0.0); N];
        for (lanes, number) in numbers.iter_mut().zip(&self.numbers) {
            *lanes = Float::load_array(simd, *number);
        }
        let solids = Solids {
            numbers,
            id: Word::load_array(simd, self.id),
            has_clear: self.has_clear,
        };
        let (hit, t) = F::meet(ray, &solids, Float::splat(simd, limit))?;
        Some((hit & solids.id.simd_ne(NONE), t))
    }
}

impl Columns {
    #[inline(always)]
    fn of<S: Simd>(rays: &Rays<S>) -> Self {
        let columns = |v: Vec3x<S>| [v.x.to_array(), v.y.to_array(), v.z.to_array()];
        Self {
            origin: columns(rays.origin),
            direction: columns(rays.direction),
            inverse: columns(rays.inverse),
            skip: rays.skip.to_array(),
        }
    }

    /// One ray in all lanes.
    #[inline(always)]
    fn ray<S: Simd>(&self, simd: S, lane: usize) -> Rays<S> {
        let inverse = splat(simd, &self.inverse, lane);
        Rays {
            origin: splat(simd, &self.origin, lane),
            direction: splat(simd, &self.direction, lane),
            skip: Word::splat(simd, self.skip[lane]),
            inverse,
            inverse_abs: inverse.abs(),
        }
    }
}

#[inline(always)]
fn splat<S: Simd>(simd: S, [x, y, z]: &[[f32; LANES]; 3], lane: usize) -> Vec3x<S> {
    Vec3x::splat(simd, [x[lane], y[lane], z[lane]])
}

impl Stack {
    #[inline(always)]
    fn new() -> Self {
        Self {
            parts: [(0.0, 0); STACK_PARTS],
            len: 0,
        }
    }

    #[inline(always)]
    fn push(&mut self, entry: f32, part: u32) {
        self.parts[self.len] = (entry, part);
        self.len += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<(f32, u32)> {
        self.len = self.len.checked_sub(1)?;
        Some(self.parts[self.len])
    }

    /// Keeps what lies above `bottom` in order, the nearest on top.
    #[inline(always)]
    fn insert(&mut self, bottom: usize, entry: f32, part: u32) {
        let mut at = self.len;
        while at > bottom && self.parts[at - 1].0 < entry {
            self.parts[at] = self.parts[at - 1];
            at -= 1;
        }
        self.parts[at] = (entry, part);
        self.len += 1;
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, [x, y, z]: &[[f32; LANES]; 3]) -> Vec3x<S> {
    Vec3x::new(
        Float::load_array(simd, *x),
        Float::load_array(simd, *y),
        Float::load_array(simd, *z),
    )
}

/// What a forest is grown from.
struct Growth<'a, F, const N: usize> {
    tree: &'a Tree,
    each: &'a [Option<One<F, N>>],
    reach: f32,
}

impl<F, const N: usize> Growth<'_, F, N> {
    /// The number of the branch or pack that becomes of `subtree`.
    fn grow(&self, forest: &mut Forest<F, N>, subtree: &Subtree) -> u32 {
        if subtree.count as usize <= LANES {
            forest.packs.push(self.pack(subtree));
            return PACK | (forest.packs.len() - 1) as u32;
        }
        let number = forest.branches.len();
        forest.branches.push(Branch {
            lanes: 0,
            center: [[0.0; LANES]; 3],
            half: [[0.0; LANES]; 3],
            parts: [0; LANES],
        });
        for (lane, part) in self.parts(subtree).iter().enumerate() {
            let center = 0.5 * (part.min + part.max);
            let slack = 0.5 * SLACK * self.reach;
            let half = (part.max - center).max(center - part.min) + slack;
            let grown = self.grow(forest, part);
            let branch = &mut forest.branches[number];
            for axis in 0..3 {
                branch.center[axis][lane] = center[axis];
                branch.half[axis][lane] = half[axis];
            }
            branch.parts[lane] = grown;
            branch.lanes |= 1 << lane;
        }
        number as u32
    }

    /// Divides `subtree` into a part per lane, always the one that most rays enter.
    fn parts(&self, subtree: &Subtree) -> Vec<Subtree> {
        let mut parts = vec![*subtree];
        while parts.len() < LANES {
            let divisible = parts.iter().enumerate();
            let divisible = divisible.filter(|(_, part)| part.count as usize > LANES);
            let largest =
                divisible.max_by(|(_, a), (_, b)| a.half_area().total_cmp(&b.half_area()));
            let Some((place, part)) = largest else {
                break;
            };
            let [left, right] = self.tree.nodes[part.node as usize];
            parts[place] = left;
            parts.push(right);
        }
        parts
    }

    fn pack(&self, subtree: &Subtree) -> Pack<F, N> {
        let mut pack = Pack {
            numbers: [[f32::NAN; LANES]; N],
            id: [NONE; LANES],
            has_clear: false,
            shape: PhantomData,
        };
        let order = &self.tree.order[subtree.first as usize..][..subtree.count as usize];
        let visible = order
            .iter()
            .filter_map(|&id| self.each[id as usize].as_ref());
        for (lane, one) in visible.enumerate() {
            for (column, number) in pack.numbers.iter_mut().zip(one.numbers) {
                column[lane] = number;
            }
            pack.id[lane] = one.id;
            pack.has_clear |= one.is_clear;
        }
        pack
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::Vec3;

    use super::super::geometry::{Geometry, INSIDE};
    use super::*;
    use crate::compiled::{Hierarchy, ShapeKind};
    use crate::tree::crowd::{CROWDS, SHAPES, crowd, ray};
    use crate::{CompiledScene, CpuTracer};

    type Packet = ([[f32; LANES]; 6], [u32; LANES]);
    type Answer = ([u32; LANES], [u32; LANES], [u64; 2]);

    /// Bits of the distance to the nearest primitive, its id, and what is occluded from half that way
    /// and from twice it.
    #[inline(always)]
    fn meet<S: Simd>(simd: S, geometry: &Geometry, (six, skip): &Packet) -> Answer {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::load_array(simd, *skip));
        let nearest = geometry.nearest(simd, &rays);
        let (none, one) = (Word::splat(simd, NONE), Float::splat(simd, 1.0));
        let met = nearest.id.simd_ne(NONE);
        let limit = met.select(nearest.distance, one);
        let outwards = Word::load_array(simd, skip.map(|id| id & !INSIDE));
        let shadows = Rays::new(simd, origin, direction, outwards);
        let occluded = |limit| geometry.occluded(simd, &shadows, limit, none).to_bitmask();
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

    /// Compares the forest with each primitive by itself; returns how many rays hit.
    fn compare(level: Level, mut scene: CompiledScene, packets: &[Packet]) -> u32 {
        scene.hierarchy = Hierarchy::Never;
        let each = Geometry::new(&scene);
        scene.hierarchy = Hierarchy::Always;
        let tree = Geometry::new(&scene);
        let mut hits = 0;
        for packet in packets {
            let expected = dispatch!(level, simd => meet(simd, &each, packet));
            let found = dispatch!(level, simd => meet(simd, &tree, packet));
            assert_eq!(found, expected, "{level:?} {packet:?}");
            hits += expected.1.iter().filter(|id| **id != NONE).count() as u32;
        }
        hits
    }

    #[test]
    fn rays_meet_what_they_meet_one_by_one_bit_for_bit() {
        const PACKETS: u32 = 20_000 / LANES as u32 / 5;
        for level in CpuTracer::levels_available() {
            for shape in SHAPES {
                for kind in CROWDS {
                    for (seed, count) in (0..).zip([5, 17, 64, 300, 1500]) {
                        let scene = crowd(kind, shape, count, seed);
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

    #[test]
    fn numbers_that_are_none_miss() {
        for shape in SHAPES {
            let scene = crowd(CROWDS[0], shape, 300, 0);
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, 1e-40] {
                for column in 0..6 {
                    let mut packet: Packet = ([[0.1; LANES]; 6], [NONE; LANES]);
                    packet.0[column] = [bad; LANES];
                    compare(Level::new(), scene.clone(), &[packet]);
                }
            }
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0] {
                let packet: Packet = ([[bad; LANES]; 6], [NONE; LANES]);
                compare(Level::new(), scene.clone(), &[packet]);
            }
        }
    }

    #[test]
    fn moved_and_hidden_balls_are_found_where_they_are() {
        use crate::{ObjectPose, SceneUpdate};
        let mut scene = crowd(CROWDS[0], ShapeKind::Sphere, 200, 3);
        scene.hierarchy = Hierarchy::Always;
        assert!(scene.tree(ShapeKind::Sphere, 0).is_some());
        let poses = (0..60).map(|object| ObjectPose {
            object,
            position: Vec3::new(0.02 * object as f32 - 0.6, 0.3, 1.2),
            rotation: glam::Quat::IDENTITY,
            visible: object % 3 != 0,
        });
        let update = SceneUpdate {
            camera: None,
            poses: poses.collect(),
        };
        scene.apply(&update).unwrap();
        let packets = packets(&scene, 9, 200);
        compare(Level::new(), scene, &packets);
    }
}
