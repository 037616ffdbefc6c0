//! Bounding volume hierarchy (BVH) over the primitives of one shape.
//!
//! A binary BVH, built by the surface area heuristic (SAH; MacDonald and Booth, "Heuristics for ray tracing
//! using space subdivision", The Visual Computer 6, 1990) over bins (Wald, "On fast Construction of
//! SAH-based Bounding Volume Hierarchies", 2007).

use glam::Vec3;

use crate::compiled::{
    AreaLightData, BoxData, CsgBoxData, DiscData, RectangleData, SphereData, TriangleData,
};

/// Primitives per leaf; the last leaf may have fewer.
///
/// All other leaves are full, as splits are rounded to multiples of this. So the number of nodes depends on
/// the number of primitives alone, GPU buffers keep their layout from frame to frame, and threads build
/// subtrees into preallocated slices.
pub const LEAF: usize = 4;
/// Maximum number of inner nodes from the root to a leaf.
pub const DEPTH_MAX: u32 = 32;
/// Relative slack by which f32 traversal has to widen boxes, times the largest coordinate of BVH and ray
/// origin together: box tests and tests of the primitives inside err by less than half of this in sum. Only
/// a grazing ray on a flat shape may be found to hit it further outside its box; a BVH misses such a hit.
pub const SLACK: f32 = 64.0 * 0.5 * f32::EPSILON;

/// Axis-aligned bounding box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Minimum corner, metres.
    pub min: Vec3,
    /// Maximum corner, metres.
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
        // Extents of a disc along the axes are its radius times the sines between normal and axes.
        let [x, y, z] = disc.normal;
        // √(1 − x²) would cancel for a normal along an axis, where the bounds are thin.
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

/// A BVH.
#[derive(Clone, Debug, PartialEq)]
pub struct Bvh {
    /// Node of all primitives.
    pub root: BvhNode,
    /// Indices of the primitives, leaf by leaf.
    pub order: Vec<u32>,
    /// Children of the inner nodes, depth first: one pair fewer than leaves.
    pub nodes: Vec<[BvhNode; 2]>,
}

/// A node: a range of primitives and their bounding box.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BvhNode {
    /// Minimum corner, metres.
    pub min: Vec3,
    /// Maximum corner, metres.
    pub max: Vec3,
    /// Index of its first primitive in [`Bvh::order`], a multiple of [`LEAF`].
    pub first: u32,
    /// Number of its primitives; a leaf if at most [`LEAF`].
    pub count: u32,
    /// Index of its children in [`Bvh::nodes`]; meaningless for a leaf.
    pub node: u32,
}

impl BvhNode {
    /// Whether it is a leaf.
    pub fn is_leaf(&self) -> bool {
        self.count as usize <= LEAF
    }

    /// Half the surface area of its box, m².
    pub fn half_area(&self) -> f32 {
        half_area(self.min, self.max)
    }
}

impl Bvh {
    /// Builds the BVH of primitives with these bounds on the current thread pool (`carom-bench bvh` prints
    /// the time); `None` if they fit one leaf.
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

    /// Amount by which its boxes have to be widened, metres: [`SLACK`] times its largest coordinate.
    pub fn slack(&self) -> f32 {
        SLACK * self.root.min.abs().max(self.root.max.abs()).max_element()
    }
}

/// Number of leaves of the BVH of `primitives` primitives.
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

/// A subtree to be built, with preallocated slices for its primitives and nodes.
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
        // A subtree has one pair of children fewer than leaves, so that the slice is empty exactly for a
        // leaf.
        let Some((halves, nodes)) = nodes.split_first_mut() else {
            return subtree;
        };
        // Both children own disjoint slices of primitives and nodes, at offsets that depend on counts
        // alone: the BVH is identical for any number of threads.
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

/// Partitions the primitives in place; returns the size of the first part, a multiple of
/// [`LEAF`].
fn divide(items: &mut [BuildItem], depth: u32) -> usize {
    let low = least(items.iter().map(BuildItem::center));
    let extent = most(items.iter().map(BuildItem::center)) - low;
    let axis = extent.max_position();
    let leaves = leaves(items.len());
    // Median splits from here on would reach the maximum depth, as each part has at most half the leaves,
    // rounded up. The limit bounds the stacks of all traversals, including those in shaders.
    let is_deep = depth + leaves.next_power_of_two().ilog2() >= DEPTH_MAX;
    let bins_per_metre = BINS as f32 / extent[axis];
    // Coinciding centres give a division by zero; then any split is as good.
    let left = if is_deep || !bins_per_metre.is_finite() {
        leaves / 2
    } else {
        let bin = |item: &BuildItem| ((item.center()[axis] - low[axis]) * bins_per_metre) as usize;
        let left = cheapest_split(items, |item| bin(item).min(BINS - 1));
        (left + LEAF / 2) / LEAF
    };
    // A split rounded to full leaves no longer lies between two bins, so primitives are partitioned by
    // rank. total_cmp orders equal coordinates, −0 and NaN without a panic.
    let left = left.clamp(1, leaves - 1) * LEAF;
    let by_place = |a: &BuildItem, b: &BuildItem| a.center()[axis].total_cmp(&b.center()[axis]);
    items.select_nth_unstable_by(left, by_place);
    left
}

/// Number of primitives below the bin boundary of least SAH cost.
fn cheapest_split(items: &[BuildItem], bin: impl Fn(&BuildItem) -> usize) -> usize {
    let mut bins = [SahBin::EMPTY; BINS];
    for item in items {
        bins[bin(item)].add(item);
    }
    // A sweep from above accumulates the costs of upper parts, one from below adds those of lower parts:
    // O(1) per split instead of O(bins).
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
        // Without constants for traversal and leaves: all subtrees are split down to leaves of one size, so
        // that these costs are the same for all splits.
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
/// Least number of primitives of a subtree that is worth a task.
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

    /// Spheres in a cloud, coinciding, along lines with growing gaps, huge and tiny, hidden.
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

    /// Checks a subtree and returns its depth.
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

    /// The bounds of a flat shape contain its points, and are tight on each side.
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
