//! Bounding volume hierarchy (BVH) over many primitives of a shape.
//!
//! A binary BVH by the surface area heuristic (MacDonald and Booth, "Heuristics for ray tracing
//! using space subdivision", The Visual Computer 6, 1990) over bins (Wald, "On fast Construction of
//! SAH-based Bounding Volume Hierarchies", 2007).

use glam::Vec3;

use crate::compiled::{
    AreaLightData, BoxData, CsgBoxData, DiscData, RectangleData, SphereData, TriangleData,
};

/// Primitives of a leaf; the last one may have fewer.
///
/// Every other leaf is full: each split is moved to the next multiple. So the BVH of a number of
/// primitives has the same number of nodes wherever they are, kernels keep their layout from frame to
/// frame, and several threads build it into memory that is taken once.
pub const LEAF: usize = 4;
/// Inner nodes from the root to any leaf, at most.
pub const DEPTH_MAX: u32 = 32;
/// How far, over the largest coordinates of the BVH and of the ray's origin together, boxes must be widened by those
/// who test rays in f32: tests of boxes and of what is in them together err by less than half of this. Only where a ray
/// grazes a flat shape may a test find it further outside its box; then a BVH misses it.
pub const SLACK: f32 = 64.0 * 0.5 * f32::EPSILON;

/// What a primitive lies in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Corner of the smallest coordinates, metres.
    pub min: Vec3,
    /// Corner of the largest.
    pub max: Vec3,
}

impl Bounds {
    fn around(center: [f32; 3], half: Vec3) -> Self {
        let center = Vec3::from(center);
        Self {
            min: center - half,
            max: center + half,
        }
    }
}

impl From<&SphereData> for Bounds {
    fn from(sphere: &SphereData) -> Self {
        Self::around(sphere.center, Vec3::splat(sphere.radius))
    }
}

impl From<&BoxData> for Bounds {
    fn from(data: &BoxData) -> Self {
        Self {
            min: data.min.into(),
            max: data.max.into(),
        }
    }
}

impl From<&DiscData> for Bounds {
    fn from(disc: &DiscData) -> Self {
        // Sines of the angles between the normal and the axes.
        let [x, y, z] = disc.normal;
        // √(1 − x²) would cancel where the normal is along an axis, just where the bounds are thin.
        let sines = Vec3::new(y.hypot(z), z.hypot(x), x.hypot(y));
        Self::around(disc.center, disc.radius * sines)
    }
}

impl From<&RectangleData> for Bounds {
    fn from(rectangle: &RectangleData) -> Self {
        let half = Vec3::from(rectangle.half_u).abs() + Vec3::from(rectangle.half_v).abs();
        Self::around(rectangle.center, half)
    }
}

impl From<&CsgBoxData> for Bounds {
    fn from(data: &CsgBoxData) -> Self {
        Self {
            min: data.min.into(),
            max: data.max.into(),
        }
    }
}

impl From<&AreaLightData> for Bounds {
    fn from(light: &AreaLightData) -> Self {
        let half_u = Vec3::from(light.axis_u) * light.length_u;
        let half_v = Vec3::from(light.axis_v) * light.length_v;
        Self::around(light.center, half_u.abs() + half_v.abs())
    }
}

impl From<&TriangleData> for Bounds {
    fn from(triangle: &TriangleData) -> Self {
        let [a, b, c] = triangle.corners();
        Self {
            min: a.min(b).min(c),
            max: a.max(b).max(c),
        }
    }
}

/// Primitives by place.
#[derive(Clone, Debug, PartialEq)]
pub struct Bvh {
    /// All of them.
    pub root: BvhNode,
    /// Indices of the primitives, leaf by leaf.
    pub order: Vec<u32>,
    /// Both halves of each part that is not a leaf, depth first: one fewer than leaves.
    pub nodes: Vec<[BvhNode; 2]>,
}

/// A part of the primitives, and the box round them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BvhNode {
    /// Corner of the smallest coordinates, metres.
    pub min: Vec3,
    /// Corner of the largest.
    pub max: Vec3,
    /// Its first primitive in [`Bvh::order`], a multiple of [`LEAF`].
    pub first: u32,
    /// Its primitives; a leaf if there are no more than [`LEAF`].
    pub count: u32,
    /// Its halves in [`Bvh::nodes`]; of a leaf without meaning.
    pub node: u32,
}

impl BvhNode {
    /// Whether it is not divided further.
    pub fn is_leaf(&self) -> bool {
        self.count as usize <= LEAF
    }

    /// Half the surface of its box, m².
    pub fn half_area(&self) -> f32 {
        half_area(self.min, self.max)
    }
}

impl Bvh {
    /// The BVH of primitives in `bounds`; none if they are no more than one leaf. By the threads of
    /// the current pool: `carom-bench bvh` prints how long it takes.
    pub fn new(bounds: impl ExactSizeIterator<Item = Bounds>) -> Option<Self> {
        if bounds.len() <= LEAF {
            return None;
        }
        let mut items: Vec<BuildItem> = bounds
            .zip(0u32..)
            .map(|(bounds, index)| BuildItem { bounds, index })
            .collect();
        let mut nodes = vec![[BvhNode::default(); 2]; leaves(items.len()) - 1];
        let root = BuildTask {
            items: &mut items,
            nodes: &mut nodes,
            first: 0,
            node: 0,
            depth: 0,
        }
        .build();
        let order = items.iter().map(|item| item.index).collect();
        Some(Self { root, order, nodes })
    }

    /// By how much its boxes are to be widened, metres: [`SLACK`] of its largest coordinate.
    pub fn slack(&self) -> f32 {
        SLACK * self.root.min.abs().max(self.root.max.abs()).max_element()
    }
}

/// Leaves of the BVH of so many primitives.
pub const fn leaves(primitives: usize) -> usize {
    primitives.div_ceil(LEAF)
}

#[derive(Clone, Copy)]
struct BuildItem {
    bounds: Bounds,
    index: u32,
}

impl BuildItem {
    fn center(&self) -> Vec3 {
        0.5 * self.bounds.min + 0.5 * self.bounds.max
    }
}

/// A subtree to be built, with the memory for its nodes.
struct BuildTask<'a> {
    items: &'a mut [BuildItem],
    nodes: &'a mut [[BvhNode; 2]],
    first: u32,
    node: u32,
    depth: u32,
}

impl BuildTask<'_> {
    fn build(self) -> BvhNode {
        let Self {
            items,
            nodes,
            first,
            node,
            depth,
        } = self;
        let subtree = BvhNode {
            min: least(items.iter().map(|item| item.bounds.min)),
            max: most(items.iter().map(|item| item.bounds.max)),
            first,
            count: items.len() as u32,
            node,
        };
        // The slice has one node fewer than the subtree has leaves, so that it is empty for a leaf and
        // nothing else.
        let Some((halves, nodes)) = nodes.split_first_mut() else {
            return subtree;
        };
        // Both halves own their slices of primitives and of nodes. So threads share nothing, and where a
        // node is put depends on counts alone: the BVH is the same however many threads build it.
        let is_large = items.len() >= PARALLEL_MIN;
        let left = divide(items, depth);
        let (left_items, right_items) = items.split_at_mut(left);
        let (left_nodes, right_nodes) = nodes.split_at_mut(leaves(left) - 1);
        let left = BuildTask {
            first,
            node: node + 1,
            depth: depth + 1,
            items: left_items,
            nodes: left_nodes,
        };
        let right = BuildTask {
            first: first + left.items.len() as u32,
            node: left.node + left.nodes.len() as u32,
            depth: depth + 1,
            items: right_items,
            nodes: right_nodes,
        };
        let (left, right) = if is_large {
            rayon::join(|| left.build(), || right.build())
        } else {
            (left.build(), right.build())
        };
        *halves = [left, right];
        subtree
    }
}

/// Puts the primitives of one half before those of the other; returns how many, a multiple of
/// [`LEAF`].
fn divide(items: &mut [BuildItem], depth: u32) -> usize {
    let low = least(items.iter().map(BuildItem::center));
    let extent = most(items.iter().map(BuildItem::center)) - low;
    let axis = extent.max_position();
    let leaves = leaves(items.len());
    // Halves by number, from here on, would reach the last level: each has no more than half the
    // leaves, rounded up.
    // This bounds the stacks of all traversals, those in shaders included.
    let is_deep = depth + leaves.next_power_of_two().ilog2() >= DEPTH_MAX;
    let bins_per_metre = BINS as f32 / extent[axis];
    // All centres in one place give a division by zero; then any division is as good.
    let left = if is_deep || !bins_per_metre.is_finite() {
        leaves / 2
    } else {
        let bin = |item: &BuildItem| ((item.center()[axis] - low[axis]) * bins_per_metre) as usize;
        let left = cheapest_split(items, |item| bin(item).min(BINS - 1));
        (left + LEAF / 2) / LEAF
    };
    // The split is moved to a multiple of a leaf and no longer lies between two bins. So primitives are
    // divided by rank, not by bin; total_cmp orders those with the same coordinate, −0 and NaN included,
    // without a panic.
    let left = left.clamp(1, leaves - 1) * LEAF;
    let by_place = |a: &BuildItem, b: &BuildItem| a.center()[axis].total_cmp(&b.center()[axis]);
    items.select_nth_unstable_by(left, by_place);
    left
}

/// Number of primitives below the split between two bins whose surface area heuristic is least.
fn cheapest_split(items: &[BuildItem], bin: impl Fn(&BuildItem) -> usize) -> usize {
    let mut bins = [SahBin::EMPTY; BINS];
    for item in items {
        bins[bin(item)].add(item);
    }
    // One sweep from above for the costs of upper parts, one from below that adds those of lower parts:
    // each split costs O(1) instead of O(bins).
    let mut above = [0.0; BINS];
    let mut whole = SahBin::EMPTY;
    for (cost, bin) in above.iter_mut().zip(&bins).rev() {
        whole.join(bin);
        *cost = whole.cost();
    }
    let mut below = SahBin::EMPTY;
    let (mut best, mut least) = (items.len() / 2, f32::INFINITY);
    for (bin, above) in bins.iter().zip(&above[1..]) {
        below.join(bin);
        let cost = below.cost() + above;
        if cost < least {
            (best, least) = (below.count, cost);
        }
    }
    best
}

#[derive(Clone, Copy)]
struct SahBin {
    min: Vec3,
    max: Vec3,
    count: usize,
}

impl SahBin {
    const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
        count: 0,
    };

    fn add(&mut self, item: &BuildItem) {
        self.min = self.min.min(item.bounds.min);
        self.max = self.max.max(item.bounds.max);
        self.count += 1;
    }

    fn join(&mut self, other: &Self) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.count += other.count;
    }

    fn cost(&self) -> f32 {
        if self.count == 0 {
            return 0.0;
        }
        // No constants of traversal and of leaves: every subtree is divided down to leaves of one size,
        // and what all splits pay alike changes no comparison.
        half_area(self.min, self.max) * self.count as f32
    }
}

fn half_area(min: Vec3, max: Vec3) -> f32 {
    let edges = max - min;
    edges.dot(Vec3::new(edges.y, edges.z, edges.x))
}

fn least(points: impl Iterator<Item = Vec3>) -> Vec3 {
    points.fold(Vec3::INFINITY, Vec3::min)
}

fn most(points: impl Iterator<Item = Vec3>) -> Vec3 {
    points.fold(Vec3::NEG_INFINITY, Vec3::max)
}

const BINS: usize = 16;
/// Parts with fewer primitives are not worth a task.
const PARALLEL_MIN: usize = 4096;

#[cfg(test)]
pub(crate) mod test_scenes;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::uniforms;

    fn sphere(center: Vec3, radius: f32) -> SphereData {
        SphereData {
            center: center.to_array(),
            radius,
            stripe_axis: [0.0, 0.0, 1.0],
            material: 0,
            number_axis: [1.0, 0.0, 0.0],
            allows_refracted_nee: 0,
        }
    }

    /// Balls in a cloud, in one place, along lines with growing gaps, huge and tiny, hidden.
    fn crowds(count: usize) -> Vec<Vec<SphereData>> {
        let random = |i: usize| {
            let [x, y, z, r] = uniforms(i as u32, 7, 0, 0);
            sphere(Vec3::new(x, y, z), 0.1 * r)
        };
        let growing = |i: usize| {
            let x = 1e7f32.powf(i as f32 / count as f32);
            sphere(Vec3::new(x, 0.0, 0.0), 1e-3)
        };
        let sized = |i: usize| {
            let [x, y, z, r] = uniforms(i as u32, 8, 0, 0);
            sphere(Vec3::new(x, y, z), 10f32.powf(12.0 * r - 6.0))
        };
        let hidden = |i: usize| SphereData {
            radius: if i.is_multiple_of(3) { 0.0 } else { 0.01 },
            ..random(i)
        };
        let same = |_| sphere(Vec3::ONE, 0.5);
        let places: [&dyn Fn(usize) -> SphereData; 5] = [&random, &growing, &sized, &hidden, &same];
        let crowd = |place: &dyn Fn(usize) -> SphereData| (0..count).map(place).collect();
        places.into_iter().map(crowd).collect()
    }

    /// Checks a part and returns the longest way down.
    fn check(bvh: &Bvh, spheres: &[SphereData], part: &BvhNode) -> u32 {
        let range = part.first as usize..(part.first + part.count) as usize;
        assert!(range.start.is_multiple_of(LEAF));
        for &index in &bvh.order[range] {
            let sphere = &spheres[index as usize];
            let center = Vec3::from(sphere.center);
            assert!((center - sphere.radius).cmpge(part.min).all());
            assert!((center + sphere.radius).cmple(part.max).all());
        }
        if part.is_leaf() {
            return 0;
        }
        let [left, right] = &bvh.nodes[part.node as usize];
        assert_eq!(left.first, part.first);
        assert_eq!(left.first + left.count, right.first);
        assert_eq!(left.count + right.count, part.count);
        assert!(left.count > 0 && right.count > 0);
        1 + check(bvh, spheres, left).max(check(bvh, spheres, right))
    }

    #[test]
    fn every_ball_lies_in_one_leaf_and_its_boxes() {
        for count in [5, 8, 9, 63, 64, 65, 1000, 10_000] {
            for spheres in crowds(count) {
                let bvh = Bvh::new(spheres.iter().map(Bounds::from)).unwrap();
                let mut order = bvh.order.clone();
                order.sort_unstable();
                assert!(order.into_iter().eq(0..count as u32));
                assert_eq!(bvh.nodes.len(), leaves(count) - 1);
                let depth = check(&bvh, &spheres, &bvh.root);
                assert!(depth <= DEPTH_MAX, "{depth}");
            }
        }
    }

    /// A terrain of a million triangles, most of them in one corner.
    #[test]
    fn the_bvh_of_a_million_triangles_is_no_deeper_than_stacks_are() {
        let edge = 708;
        let height = |x: f32, y: f32| 0.1 * (7.0 * x).sin() * (5.0 * y).cos();
        let corner = |i: u32, j: u32| {
            let [x, y] = [i, j].map(|at| (at as f32 / edge as f32).powi(4));
            [x, y, height(x, y)]
        };
        let triangles = (0..edge * edge).flat_map(|at| {
            let (i, j) = (at % edge, at / edge);
            let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(x, y)| corner(i + x, j + y));
            [[a, b, c], [a, c, d]]
        });
        let triangles: Vec<TriangleData> = triangles
            .map(|[a, b, c]| TriangleData {
                a,
                b,
                c,
                ..bytemuck::Zeroable::zeroed()
            })
            .collect();
        let bvh = Bvh::new(triangles.iter().map(Bounds::from)).unwrap();
        assert_eq!(bvh.nodes.len(), leaves(triangles.len()) - 1);
        let mut stack = vec![(bvh.root, 0)];
        let mut met = 0;
        while let Some((part, depth)) = stack.pop() {
            assert!(depth <= DEPTH_MAX);
            if !part.is_leaf() {
                let halves = bvh.nodes[part.node as usize];
                stack.extend(halves.map(|half| (half, depth + 1)));
                continue;
            }
            for &index in &bvh.order[part.first as usize..][..part.count as usize] {
                let bounds = Bounds::from(&triangles[index as usize]);
                assert!(bounds.min.cmpge(part.min).all() && bounds.max.cmple(part.max).all());
                met += 1;
            }
        }
        assert_eq!(met, triangles.len());
    }

    #[test]
    fn few_primitives_have_no_bvh() {
        for count in 0..=LEAF {
            let spheres = vec![sphere(Vec3::ONE, 0.5); count];
            assert_eq!(Bvh::new(spheres.iter().map(Bounds::from)), None);
        }
    }

    /// Points of a flat shape lie in its bounds, and some near each side.
    #[test]
    fn bounds_of_flat_shapes_are_tight() {
        for i in 0..1000 {
            let [a, b, c, radius] = uniforms(i, 3, 1, 0);
            let normal = (Vec3::new(a, b, c) - 0.5).normalize();
            let (u, v) = normal.any_orthonormal_pair();
            let disc = DiscData {
                center: [a, b, c],
                radius,
                normal: normal.to_array(),
                material: 0,
            };
            let around = |turn: u32| {
                let (sin, cos) = (turn as f32 * std::f32::consts::TAU / 720.0).sin_cos();
                Vec3::new(a, b, c) + radius * (cos * u + sin * v)
            };
            let [half_u, half_v] = [u * radius, v * (2.0 * radius)].map(|half| half.to_array());
            let rectangle = RectangleData {
                center: disc.center,
                half_u,
                half_v,
                ..bytemuck::Zeroable::zeroed()
            };
            let corner = |turn: u32| {
                let [x, y] = [1, 2].map(|bit| if turn & bit == 0 { 1.0 } else { -1.0 });
                Vec3::new(a, b, c) + radius * (x * u + y * 2.0 * v)
            };
            for (bounds, points) in [
                (
                    Bounds::from(&disc),
                    (0..720).map(around).collect::<Vec<_>>(),
                ),
                (Bounds::from(&rectangle), (0..4).map(corner).collect()),
            ] {
                let (low, high) = (least(points.iter().copied()), most(points.into_iter()));
                assert!((low - bounds.min).abs().max_element() < 1e-4 * radius + 1e-6);
                assert!((high - bounds.max).abs().max_element() < 1e-4 * radius + 1e-6);
            }
        }
    }
}
