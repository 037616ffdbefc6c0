//! Clusters of adjacent boxes: a ray that misses the bounds of a cluster misses all of its boxes.

use glam::Vec3;

use crate::bvh::Bounds;

/// Partition of a scene's boxes, if they are few, into single ones and clusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Clusters {
    /// Bit mask of the boxes in each cluster; 0 behind the last.
    members: [u64; Self::COUNT_MAX],
}

impl Clusters {
    /// No clusters: all boxes are single.
    pub(crate) const NONE: Self = Self {
        members: [0; Self::COUNT_MAX],
    };
    /// Maximum number of clusters.
    const COUNT_MAX: usize = 10;
    /// Number of boxes whose bounds a kernel tests together; no cluster spans several groups.
    pub(crate) const GROUP: usize = 32;
    /// Maximum number of groups that are partitioned.
    pub(crate) const GROUPS_MAX: usize = 2;
    /// Maximum number of boxes that are partitioned.
    const BOXES_MAX: usize = Self::GROUPS_MAX * Self::GROUP;

    /// Partition that needs few tests of boxes and bounds for rays from `origin` in all directions;
    /// [`Clusters::NONE`] for more than [`Clusters::BOXES_MAX`] boxes.
    pub(crate) fn new(boxes: &[Bounds], origin: Vec3) -> Self {
        if boxes.len() > Self::BOXES_MAX {
            return Self::NONE;
        }
        let groups = boxes.chunks(Self::GROUP).enumerate();
        let mut found: Vec<u64> = groups
            .flat_map(|(group, boxes)| {
                let parts = merged(boxes, origin).into_iter();
                parts.map(move |part| part.members << (group * Self::GROUP))
            })
            .filter(|members| members.count_ones() > 1)
            .collect();
        // The largest clusters, if there are too many.
        found.sort_by_key(|members| members.count_zeros());
        found.truncate(Self::COUNT_MAX);
        found.sort_unstable();
        let mut clusters = Self::NONE;
        clusters.members[..found.len()].copy_from_slice(&found);
        clusters
    }

    /// Bit mask of the boxes in each cluster.
    pub(crate) fn members(&self) -> impl Iterator<Item = u64> + '_ {
        let members = self.members.iter().copied();
        members.filter(|members| *members != 0)
    }

    /// Number of clusters.
    #[cfg(any(test, feature = "gpu"))]
    pub(crate) fn len(&self) -> usize {
        self.members().count()
    }

    /// Common bounds of each cluster.
    #[cfg(any(test, feature = "gpu"))]
    pub(crate) fn bounds(&self, boxes: &[Bounds]) -> Vec<Bounds> {
        let bound = |members: u64| {
            let is_member = |(index, _): &(usize, &Bounds)| members >> index & 1 == 1;
            let own = boxes.iter().enumerate().filter(is_member);
            let own = own.map(|(_, bounds)| *bounds);
            own.reduce(union).expect("a cluster has boxes")
        };
        self.members().map(bound).collect()
    }
}

/// A set of boxes with their common bounds.
#[derive(Clone, Copy)]
struct Part {
    /// Bit mask of the boxes.
    members: u64,
    bound: Bounds,
    /// Expected number of tests per group of rays.
    cost: f32,
}

impl Part {
    /// A part with its cost: 1 for a single box; for a cluster 1 for its bounds, and the number of its
    /// boxes times the fraction of groups that hit the bounds.
    fn new(members: u64, bound: Bounds, origin: Vec3) -> Self {
        let cost = match members.count_ones() {
            1 => 1.0,
            count => 1.0 + share_of_groups(bound, origin) * count as f32,
        };
        Self {
            members,
            bound,
            cost,
        }
    }
}

/// Greedy agglomeration: merges the pair that saves the most, until no pair saves anything.
fn merged(boxes: &[Bounds], origin: Vec3) -> Vec<Part> {
    let single = |(index, bounds): (usize, &Bounds)| Part::new(1 << index, *bounds, origin);
    let mut parts: Vec<Part> = boxes.iter().enumerate().map(single).collect();
    loop {
        // Cubic in the number of boxes, which is at most `Clusters::GROUP`.
        let mut best = (0.0, None);
        for (i, a) in parts.iter().enumerate() {
            for (j, b) in parts.iter().enumerate().skip(i + 1) {
                let both = Part::new(a.members | b.members, union(a.bound, b.bound), origin);
                let saved = a.cost + b.cost - both.cost;
                if saved > best.0 {
                    best = (saved, Some((i, j, both)));
                }
            }
        }
        let (_, Some((i, j, both))) = best else {
            return parts;
        };
        parts[i] = both;
        parts.swap_remove(j);
    }
}

/// Smallest box around both.
pub(crate) fn union(a: Bounds, b: Bounds) -> Bounds {
    Bounds {
        min: a.min.min(b.min),
        max: a.max.max(b.max),
    }
}

/// Approximate fraction of ray groups from `origin` of which some ray hits the bounds: solid angle over 4π,
/// for groups of [`RAYS_APART`] independent directions.
fn share_of_groups(bound: Bounds, origin: Vec3) -> f32 {
    let to_nearest = origin.clamp(bound.min, bound.max).distance(origin);
    let to_middle = 0.5 * (bound.min + bound.max) - origin;
    if to_nearest == 0.0 {
        return 1.0;
    }
    // Representative distance between the nearest point and the centre.
    let distance = to_nearest.midpoint(to_middle.length());
    let extent = bound.max - bound.min;
    // Projected area towards the origin, by the faces' areas and the direction's components.
    let faces = Vec3::new(
        extent.y * extent.z,
        extent.z * extent.x,
        extent.x * extent.y,
    );
    let seen = faces.dot(to_middle.normalize().abs());
    let share = seen / (4.0 * std::f32::consts::PI * distance * distance);
    // A group enters a cluster if any of its rays does.
    1.0 - (1.0 - share.min(1.0)).powi(RAYS_APART)
}

/// Effective number of independent directions in a group of 32 rays, as adjacent rays are similar.
const RAYS_APART: i32 = 8;

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(centers: &[[f32; 3]], half: f32) -> Vec<Bounds> {
        let bound = |center: &[f32; 3]| Bounds {
            min: Vec3::from(*center) - half,
            max: Vec3::from(*center) + half,
        };
        centers.iter().map(bound).collect()
    }

    #[test]
    fn distant_neighbours_are_a_cluster_and_what_is_round_the_origin_is_not() {
        let near = [
            [0.0, 0.0, 1.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
        ];
        let far = [
            [9.0, 0.0, 0.0],
            [9.0, 0.5, 0.0],
            [9.0, 1.0, 0.0],
            [9.0, 1.5, 0.0],
        ];
        let boxes = boxes(&[near, far].concat(), 0.2);
        let clusters = Clusters::new(&boxes, Vec3::ZERO);
        assert!(clusters.members().eq([0b1111_0000]));
        let bounds = clusters.bounds(&boxes);
        assert_eq!(bounds[0].min, Vec3::new(8.8, -0.2, -0.2));
        assert_eq!(bounds[0].max, Vec3::new(9.2, 1.7, 0.2));
    }

    #[test]
    fn neighbours_are_a_cluster_in_whatever_order_they_are() {
        let sides = [[9.0, 0.0, 0.0], [-9.0, 0.0, 0.0]];
        let center = |i: u8| Vec3::from(sides[usize::from(i % 2)]) + 0.1 * f32::from(i);
        let centers: Vec<_> = (0..8).map(|i| center(i).to_array()).collect();
        let clusters = Clusters::new(&boxes(&centers, 0.2), Vec3::ZERO);
        assert!(clusters.members().eq([0b0101_0101, 0b1010_1010]));
    }

    #[test]
    fn few_and_many_boxes_are_no_clusters() {
        for count in [0, 1, 65, 70] {
            let all = boxes(&vec![[9.0, 0.0, 0.0]; count], 0.1);
            assert_eq!(Clusters::new(&all, Vec3::ZERO).len(), 0, "{count}");
        }
    }

    #[test]
    fn boxes_that_are_tested_apart_are_in_no_cluster_together() {
        let all = boxes(&[[9.0, 0.0, 0.0]; 45], 0.1);
        let clusters = Clusters::new(&all, Vec3::ZERO);
        let (first, second) = (u64::from(u32::MAX), ((1 << 13) - 1) << 32);
        assert!(clusters.members().eq([first, second]));
    }

    #[test]
    fn there_are_at_most_as_many_clusters_as_fit() {
        // Two clusters of four boxes at each corner of a cube around the origin, in different groups.
        let center = |i: u8| {
            let corner = [0, 1, 2].map(|axis| if (i / 4) >> axis & 1 == 1 { 2.0 } else { -2.0 });
            (Vec3::from(corner) + 0.1 * f32::from(i % 4)).to_array()
        };
        let centers: Vec<_> = (0..64).map(center).collect();
        let clusters = Clusters::new(&boxes(&centers, 0.5), Vec3::ZERO);
        assert_eq!(clusters.len(), Clusters::COUNT_MAX);
        for members in clusters.members() {
            let heap = members.trailing_zeros() / 4;
            assert_eq!(members, 0b1111 << (4 * heap), "{members:b}");
        }
    }
}
