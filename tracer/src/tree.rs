//! A hierarchy of boxes round a scene's balls: which few of many a ray may meet.
//!
//! A binary tree by the surface area heuristic (MacDonald and Booth, "Heuristics for ray tracing
//! using space subdivision", The Visual Computer 6, 1990) over bins (Wald, "On fast Construction of
//! SAH-based Bounding Volume Hierarchies", 2007). Every leaf but the last has [`LEAF_BALLS`] balls:
//! each cut is moved to the next multiple. So the tree of a number of balls always has the same
//! number of nodes wherever they are, kernels keep their layout from frame to frame, and the tree
//! can be built by several threads into memory that is taken once.

use glam::Vec3;

use crate::compiled::SphereData;

/// Balls of a leaf; the last one may have fewer.
pub const LEAF_BALLS: usize = 4;
/// Inner nodes from the root to any leaf, at most.
pub const DEPTH_MAX: u32 = 32;
/// How far, over the largest coordinate of the scene, boxes must be widened by those who test rays
/// in f32: tests of boxes and of balls together err by less than half of this.
pub const SLACK: f32 = 64.0 * 0.5 * f32::EPSILON;

/// Balls by place.
#[derive(Clone, Debug, PartialEq)]
pub struct BallTree {
    /// All of them.
    pub root: Subtree,
    /// Places in [`crate::CompiledScene::spheres`], leaf by leaf.
    pub order: Vec<u32>,
    /// Both halves of each part that is not a leaf, depth first: one fewer than leaves.
    pub nodes: Vec<[Subtree; 2]>,
}

/// A part of the balls, and the box round them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Subtree {
    /// Corner of the smallest coordinates, metres.
    pub min: Vec3,
    /// Corner of the largest.
    pub max: Vec3,
    /// Its first ball in [`BallTree::order`], a multiple of [`LEAF_BALLS`].
    pub first: u32,
    /// Its balls; a leaf if there are no more than [`LEAF_BALLS`].
    pub count: u32,
    /// Its halves in [`BallTree::nodes`]; of a leaf without meaning.
    pub node: u32,
}

impl Subtree {
    /// Whether it is not divided further.
    pub fn is_leaf(&self) -> bool {
        self.count as usize <= LEAF_BALLS
    }

    /// Half the surface of its box, m².
    pub fn half_area(&self) -> f32 {
        half_area(self.min, self.max)
    }
}

impl BallTree {
    /// The tree of `spheres`, hidden ones among them; none if they are no more than one leaf. By
    /// the threads of the current pool: `carom-farm bench hierarchy` prints how long it takes.
    pub fn new(spheres: &[SphereData]) -> Option<Self> {
        if spheres.len() <= LEAF_BALLS {
            return None;
        }
        let balls = spheres.iter().zip(0u32..).map(|(sphere, index)| Ball {
            center: sphere.center.into(),
            radius: sphere.radius,
            index,
        });
        let mut balls: Vec<Ball> = balls.collect();
        let mut nodes = vec![[Subtree::default(); 2]; leaves(balls.len()) - 1];
        let root = Part {
            balls: &mut balls,
            nodes: &mut nodes,
            first: 0,
            node: 0,
            depth: 0,
        }
        .build();
        let order = balls.iter().map(|ball| ball.index).collect();
        Some(Self { root, order, nodes })
    }
}

/// Leaves of the tree of so many balls.
pub const fn leaves(balls: usize) -> usize {
    balls.div_ceil(LEAF_BALLS)
}

#[derive(Clone, Copy)]
struct Ball {
    center: Vec3,
    radius: f32,
    index: u32,
}

/// What is to become a subtree.
struct Part<'a> {
    balls: &'a mut [Ball],
    nodes: &'a mut [[Subtree; 2]],
    first: u32,
    node: u32,
    depth: u32,
}

impl Part<'_> {
    fn build(self) -> Subtree {
        let Self {
            balls,
            nodes,
            first,
            node,
            depth,
        } = self;
        let subtree = Subtree {
            min: least(balls.iter().map(|ball| ball.center - ball.radius)),
            max: most(balls.iter().map(|ball| ball.center + ball.radius)),
            first,
            count: balls.len() as u32,
            node,
        };
        let Some((halves, nodes)) = nodes.split_first_mut() else {
            return subtree;
        };
        let is_large = balls.len() >= PARALLEL_MIN;
        let left = divide(balls, depth);
        let (left_balls, right_balls) = balls.split_at_mut(left);
        let (left_nodes, right_nodes) = nodes.split_at_mut(leaves(left) - 1);
        let left = Part {
            first,
            node: node + 1,
            depth: depth + 1,
            balls: left_balls,
            nodes: left_nodes,
        };
        let right = Part {
            first: first + left.balls.len() as u32,
            node: left.node + left.nodes.len() as u32,
            depth: depth + 1,
            balls: right_balls,
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

/// Puts the balls of one half before those of the other; returns how many, a multiple of
/// [`LEAF_BALLS`].
fn divide(balls: &mut [Ball], depth: u32) -> usize {
    let low = least(balls.iter().map(|ball| ball.center));
    let extent = most(balls.iter().map(|ball| ball.center)) - low;
    let axis = extent.max_position();
    let leaves = leaves(balls.len());
    // Halves by number, from here on, would reach the last level: each has no more than half the
    // leaves, rounded up.
    let is_deep = depth + leaves.next_power_of_two().ilog2() >= DEPTH_MAX;
    let bins_per_metre = BINS as f32 / extent[axis];
    let left = if is_deep || !bins_per_metre.is_finite() {
        leaves / 2
    } else {
        let bin = |ball: &Ball| ((ball.center[axis] - low[axis]) * bins_per_metre) as usize;
        let left = cheapest_cut(balls, |ball| bin(ball).min(BINS - 1));
        (left + LEAF_BALLS / 2) / LEAF_BALLS
    };
    let left = left.clamp(1, leaves - 1) * LEAF_BALLS;
    let by_place = |a: &Ball, b: &Ball| a.center[axis].total_cmp(&b.center[axis]);
    balls.select_nth_unstable_by(left, by_place);
    left
}

/// How many balls lie below the cut between two bins that makes the fewest rays times balls.
fn cheapest_cut(balls: &[Ball], bin: impl Fn(&Ball) -> usize) -> usize {
    let mut bins = [Bin::EMPTY; BINS];
    for ball in balls {
        bins[bin(ball)].take(ball);
    }
    let mut above = [0.0; BINS];
    let mut whole = Bin::EMPTY;
    for (cost, bin) in above.iter_mut().zip(&bins).rev() {
        whole.join(bin);
        *cost = whole.cost();
    }
    let mut below = Bin::EMPTY;
    let (mut best, mut least) = (balls.len() / 2, f32::INFINITY);
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
struct Bin {
    min: Vec3,
    max: Vec3,
    count: usize,
}

impl Bin {
    const EMPTY: Self = Self {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
        count: 0,
    };

    fn take(&mut self, ball: &Ball) {
        self.min = self.min.min(ball.center - ball.radius);
        self.max = self.max.max(ball.center + ball.radius);
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
/// Parts with fewer balls are not worth a task.
const PARALLEL_MIN: usize = 4096;

/// Scenes of balls and rays among them, on which trees are tested against each ball by itself.
#[cfg(test)]
pub(crate) mod crowd {
    use std::collections::BTreeMap;

    use glam::{Quat, Vec3};

    use crate::sampling::uniforms;
    use crate::{Camera, CompiledScene, Environment, Material, Object, Scene, Shape};

    #[derive(Clone, Copy, Debug)]
    pub(crate) enum Crowd {
        /// Here and there, through each other too.
        Cloud,
        /// In a lattice, each touching its neighbours.
        Touching,
        /// Several in the same place.
        Coincident,
        /// From a micrometre to a metre.
        Sized,
        /// Along a line, with gaps that grow to a kilometre.
        Growing,
        /// A cloud of glass.
        Glass,
        /// A hundred kilometres from the origin.
        Far,
    }

    pub(crate) const CROWDS: [Crowd; 7] = [
        Crowd::Cloud,
        Crowd::Touching,
        Crowd::Coincident,
        Crowd::Sized,
        Crowd::Growing,
        Crowd::Glass,
        Crowd::Far,
    ];

    /// Place and radius of ball `i` of `count`.
    fn ball(kind: Crowd, count: u32, seed: u32, i: u32) -> (Vec3, f32) {
        let [x, y, z, r] = uniforms(i, seed, 7, 0);
        let (cloud, small) = (
            2.0 * Vec3::new(x, y, z) - 1.0,
            (count as f32).cbrt().recip(),
        );
        match kind {
            Crowd::Cloud | Crowd::Glass => (cloud, (0.05 + 0.6 * r) * small),
            Crowd::Touching => {
                let edge = (count as f32).cbrt().ceil() as u32;
                let place = [i % edge, i / edge % edge, i / edge / edge];
                (0.25 * Vec3::from(place.map(|at| at as f32)), 0.125)
            }
            Crowd::Coincident => {
                let [x, y, z, r] = uniforms(i / 3, seed, 7, 0);
                (2.0 * Vec3::new(x, y, z) - 1.0, (0.2 + 0.5 * r) * small)
            }
            Crowd::Sized => (cloud, 10f32.powf(-6.0 * r)),
            Crowd::Growing => (
                Vec3::new(1000f32.powf(i as f32 / count as f32) - 1.0, 0.1 * y, 0.0),
                0.05 * (1.0 + i as f32 / count as f32),
            ),
            Crowd::Far => (cloud + Vec3::new(1e5, -1e5, 3e4), 0.5 * small),
        }
    }

    pub(crate) fn crowd(kind: Crowd, count: u32, seed: u32) -> CompiledScene {
        let albedo = Vec3::ONE;
        let material = match kind {
            Crowd::Glass => Material::Dielectric {
                ior: 1.5,
                alpha: 0.0,
                medium: None,
            },
            _ => Material::Diffuse { albedo },
        };
        let object = |i| {
            let (center, radius) = ball(kind, count, seed, i);
            let rotation = Quat::IDENTITY;
            let shape = Shape::Sphere {
                center,
                radius,
                rotation,
            };
            let (name, material) = (String::new(), "m".to_owned());
            Object {
                name,
                material,
                shape,
            }
        };
        let (target, _) = ball(kind, count, seed, 0);
        let scene = Scene {
            camera: Camera {
                eye: target + 3.0,
                target,
                up: Vec3::Z,
                fov_x_deg: 40.0,
            },
            environment: Environment { radiance: albedo },
            materials: BTreeMap::from([("m".to_owned(), material)]),
            objects: (0..count).map(object).collect(),
            lamps: Vec::new(),
        };
        CompiledScene::new(&scene).unwrap()
    }

    pub(crate) struct CrowdRay {
        pub(crate) origin: Vec3,
        /// Of unit length.
        pub(crate) direction: Vec3,
        /// The ball that it leaves.
        pub(crate) left: Option<u32>,
        /// It crosses that ball's inside.
        pub(crate) is_inside: bool,
    }

    /// From the eye, from between the balls or from one's surface, at a ball, along an axis or
    /// anywhere.
    pub(crate) fn ray(scene: &CompiledScene, seed: u32, i: u32) -> CrowdRay {
        let [a, b, c, d] = uniforms(i, seed, 8, 0);
        let [e, f, g, h] = uniforms(i, seed, 9, 0);
        let balls = &scene.spheres;
        let some = |u: f32| (u * balls.len() as f32) as usize;
        let aside = (Vec3::new(e, f, g) - 0.5)
            .try_normalize()
            .unwrap_or(Vec3::X);
        let from = &balls[some(a)];
        let (center, radius) = (Vec3::from(from.center), from.radius);
        let is_left = i % 4 > 1 && radius > 0.0;
        let origin = match i % 4 {
            0 => scene.camera.eye,
            1 => center + 2.0 * aside * (b - 0.5),
            _ => center + radius * aside,
        };
        let at = &balls[some(c)];
        let aim = Vec3::from(at.center) + 1.1 * at.radius * (Vec3::new(f, g, h) - 0.5);
        let direction = match i / 4 % 8 {
            0 => Vec3::AXES[some(d) % 3],
            1 => -Vec3::AXES[some(d) % 3],
            2 => Vec3::new(g, h, e) - 0.5,
            _ => aim - origin,
        };
        let mut direction = direction.try_normalize().unwrap_or(Vec3::Y);
        let is_inside = is_left && i % 4 == 3 && scene.materials[0].ior > 1.0;
        let outwards = direction.dot(aside);
        if is_left && (outwards < 0.0) != is_inside {
            direction -= 2.0 * outwards * aside;
            direction = direction.normalize();
        }
        CrowdRay {
            origin,
            direction,
            left: is_left.then_some(some(a) as u32),
            is_inside,
        }
    }
}

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
            is_window: 0,
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
    fn check(tree: &BallTree, spheres: &[SphereData], part: &Subtree) -> u32 {
        let range = part.first as usize..(part.first + part.count) as usize;
        assert!(range.start.is_multiple_of(LEAF_BALLS));
        for &index in &tree.order[range] {
            let sphere = &spheres[index as usize];
            let center = Vec3::from(sphere.center);
            assert!((center - sphere.radius).cmpge(part.min).all());
            assert!((center + sphere.radius).cmple(part.max).all());
        }
        if part.is_leaf() {
            return 0;
        }
        let [left, right] = &tree.nodes[part.node as usize];
        assert_eq!(left.first, part.first);
        assert_eq!(left.first + left.count, right.first);
        assert_eq!(left.count + right.count, part.count);
        assert!(left.count > 0 && right.count > 0);
        1 + check(tree, spheres, left).max(check(tree, spheres, right))
    }

    #[test]
    fn every_ball_lies_in_one_leaf_and_in_the_boxes_above_it() {
        for count in [5, 8, 9, 63, 64, 65, 1000, 10_000] {
            for spheres in crowds(count) {
                let tree = BallTree::new(&spheres).unwrap();
                let mut order = tree.order.clone();
                order.sort_unstable();
                assert!(order.into_iter().eq(0..count as u32));
                assert_eq!(tree.nodes.len(), leaves(count) - 1);
                let depth = check(&tree, &spheres, &tree.root);
                assert!(depth <= DEPTH_MAX, "{depth}");
            }
        }
    }

    #[test]
    fn few_balls_have_no_tree() {
        for count in 0..=LEAF_BALLS {
            let spheres = vec![sphere(Vec3::ONE, 0.5); count];
            assert_eq!(BallTree::new(&spheres), None);
        }
    }
}
