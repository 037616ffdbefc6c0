//! Many balls: each ray by itself against the boxes of sixteen parts at once, then against sixteen
//! balls at once.
//!
//! The [`BallTree`] with inner nodes joined until they have a part per lane (Wald, Benthin and
//! Boulos, "Getting rid of packets", 2008): paths have spread by their second ray, and packets of
//! them would visit nearly all that each of their rays does.

use fearless_simd::prelude::*;

use super::geometry::{Chord, INSIDE, NONE, Nearest, Rays, reject_radius};
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use crate::compiled::SphereData;
use crate::tree::{BallTree, DEPTH_MAX, SLACK, Subtree};

/// Balls under a tree of wide nodes.
pub(super) struct Forest {
    branches: Vec<Branch>,
    packs: Vec<Pack>,
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

/// Balls by lane; lanes without one have a radius that nothing passes.
struct Pack {
    center: [[f32; LANES]; 3],
    radius: [f32; LANES],
    /// See [`reject_radius`]; NaN where nothing is to be met.
    reject_radius: [f32; LANES],
    id: [u32; LANES],
}

/// One ray in all lanes.
struct Ray<S: Simd> {
    origin: Vec3x<S>,
    direction: Vec3x<S>,
    inverse: Vec3x<S>,
    inverse_abs: Vec3x<S>,
    skip: u32,
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

impl Forest {
    /// `reach` is an upper bound of the distance from any ray's origin to any ball's centre.
    pub(super) fn new(tree: &BallTree, spheres: &[SphereData], reach: f32) -> Self {
        let mut forest = Self {
            branches: Vec::new(),
            packs: Vec::new(),
            root: 0,
        };
        let growth = Growth {
            tree,
            spheres,
            reach,
        };
        forest.root = growth.grow(&mut forest, &tree.root);
        forest
    }

    /// The nearest ball of each ray, of equals the first.
    #[inline(always)]
    pub(super) fn nearest<S: Simd>(&self, simd: S, rays: &Rays<S>) -> Nearest<S> {
        let (distance, id) = simd.vectorize(
            #[inline(always)]
            || self.nearest_by_lane(simd, rays),
        );
        Nearest {
            distance: Float::load_array(simd, distance),
            id: Word::load_array(simd, id),
        }
    }

    #[inline(always)]
    fn nearest_by_lane<S: Simd>(&self, simd: S, rays: &Rays<S>) -> ([f32; LANES], [u32; LANES]) {
        let columns = Columns::of(rays);
        let mut stack = Stack::new();
        let (mut distance, mut id) = ([f32::INFINITY; LANES], [NONE; LANES]);
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
                let Some((hit, t)) = pack.meet(simd, &ray) else {
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

    /// Where a ball lies before `distance`; not where that is 0.
    #[inline(always)]
    pub(super) fn occluded<S: Simd>(&self, simd: S, rays: &Rays<S>, distance: Float<S>) -> Mask<S> {
        let dark = simd.vectorize(
            #[inline(always)]
            || self.occluded_by_lane(simd, rays, distance),
        );
        Mask::from_bitmask(simd, dark)
    }

    #[inline(always)]
    fn occluded_by_lane<S: Simd>(&self, simd: S, rays: &Rays<S>, distance: Float<S>) -> u64 {
        let columns = Columns::of(rays);
        let mut stack = Stack::new();
        let mut dark = 0;
        for (lane, limit) in distance.to_array().into_iter().enumerate() {
            if limit <= 0.0 {
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
                let met = self.packs[(part & !PACK) as usize].meet(simd, &ray);
                let is_before = |(hit, t): (Mask<S>, Float<S>)| (hit & t.simd_lt(limit)).any_true();
                if met.is_some_and(is_before) {
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
    fn enter<S: Simd>(&self, simd: S, ray: &Ray<S>, limit: f32, stack: &mut Stack) {
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

impl Pack {
    /// Where the ray meets the balls; the test of `geometry`'s `Ball`, operation by operation.
    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, ray: &Ray<S>) -> Option<(Mask<S>, Float<S>)> {
        let center = load(simd, &self.center);
        let from_center = ray.origin - center;
        let closest = -from_center.dot(ray.direction);
        let miss_squared = ray.direction.mul_add(closest, from_center).length_squared();
        let reject = Float::load_array(simd, self.reject_radius);
        let candidate = miss_squared.simd_le(reject * reject) & closest.simd_gt(-reject);
        if !candidate.any_true() {
            return None;
        }
        let radius = Float::load_array(simd, self.radius);
        let chord = Chord::new(ray.origin, ray.direction, center, radius);
        let mut t = chord.first();
        let mut hit = candidate & chord.real & t.simd_gt(0.0);
        let id = Word::load_array(simd, self.id);
        if ray.skip & INSIDE != 0 {
            // Empty lanes have the id of no primitive, and `skip` may be that.
            let within = (id | INSIDE).simd_eq(ray.skip) & id.simd_ne(NONE);
            t = within.select(chord.far.max(0.0), t);
            hit |= within;
        }
        Some((hit & id.simd_ne(ray.skip), t))
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

    #[inline(always)]
    fn ray<S: Simd>(&self, simd: S, lane: usize) -> Ray<S> {
        let inverse = Vec3x::splat(simd, self.inverse.map(|column| column[lane]));
        Ray {
            origin: Vec3x::splat(simd, self.origin.map(|column| column[lane])),
            direction: Vec3x::splat(simd, self.direction.map(|column| column[lane])),
            inverse,
            inverse_abs: inverse.abs(),
            skip: self.skip[lane],
        }
    }
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
struct Growth<'a> {
    tree: &'a BallTree,
    spheres: &'a [SphereData],
    reach: f32,
}

impl Growth<'_> {
    /// The number of the branch or pack that becomes of `subtree`.
    fn grow(&self, forest: &mut Forest, subtree: &Subtree) -> u32 {
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
            // `reach` is twice the largest coordinate.
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

    fn pack(&self, subtree: &Subtree) -> Pack {
        let mut pack = Pack {
            center: [[0.0; LANES]; 3],
            radius: [0.0; LANES],
            reject_radius: [f32::NAN; LANES],
            id: [NONE; LANES],
        };
        let order = &self.tree.order[subtree.first as usize..][..subtree.count as usize];
        let spheres = order.iter().map(|&id| (id, &self.spheres[id as usize]));
        // A radius of 0 hides a ball.
        let visible = spheres.filter(|(_, sphere)| sphere.radius > 0.0);
        for (lane, (id, sphere)) in visible.enumerate() {
            for axis in 0..3 {
                pack.center[axis][lane] = sphere.center[axis];
            }
            pack.radius[lane] = sphere.radius;
            pack.reject_radius[lane] = reject_radius(sphere.radius, self.reach);
            pack.id[lane] = id;
        }
        pack
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::Vec3;

    use super::super::geometry::Geometry;
    use super::*;
    use crate::compiled::Hierarchy;
    use crate::tree::crowd::{CROWDS, crowd, ray};
    use crate::{CompiledScene, CpuTracer};

    type Packet = ([[f32; LANES]; 6], [u32; LANES]);
    type Answer = ([u32; LANES], [u32; LANES], [u64; 2]);

    /// Bits of the distance to the nearest ball, its id, and what is occluded from half that way
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
                    Some(ball) if ray.is_inside => ball | INSIDE,
                    Some(ball) => ball,
                    None => NONE,
                };
            }
            columns
        };
        (0..count).map(packet).collect()
    }

    /// Compares the forest with each ball by itself; returns how many rays hit.
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
    fn rays_meet_the_balls_that_they_meet_one_by_one_bit_for_bit() {
        const PACKETS: u32 = 20_000 / LANES as u32 / 5;
        for level in CpuTracer::levels_available() {
            for kind in CROWDS {
                for (seed, count) in [5, 17, 64, 300, 1500].into_iter().enumerate() {
                    let scene = crowd(kind, count, seed as u32);
                    let packets = packets(&scene, seed as u32, PACKETS);
                    let hits = compare(level, scene, &packets);
                    assert!(hits > PACKETS, "{kind:?}, {count} balls: {hits} hits");
                }
            }
        }
    }

    #[test]
    fn numbers_that_are_none_miss() {
        let scene = crowd(CROWDS[0], 300, 0);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, 1e-40] {
            for column in 0..6 {
                let mut packet: Packet = ([[0.1; LANES]; 6], [NONE; LANES]);
                packet.0[column] = [bad; LANES];
                compare(Level::new(), scene.clone(), &[packet]);
            }
            let packet: Packet = ([[bad; LANES]; 6], [NONE; LANES]);
            compare(Level::new(), scene.clone(), &[packet]);
        }
    }

    #[test]
    fn moved_and_hidden_balls_are_found_where_they_are() {
        use crate::{ObjectPose, SceneUpdate};
        let mut scene = crowd(CROWDS[0], 200, 3);
        scene.hierarchy = Hierarchy::Always;
        assert!(scene.ball_tree(0).is_some());
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
