//! Clusters of boxes that lie together: rays that do not meet the bound of one meet none of its boxes.

use std::ops::Range;

use glam::Vec3;

use crate::bvh::Bounds;

/// How the boxes of a scene, few and in their order, are divided into single ones and clusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Clusters {
    /// First box and length of each; those behind the last are empty.
    ranges: [(u8, u8); Self::COUNT_MAX],
}

impl Clusters {
    /// Single boxes alone.
    pub(crate) const NONE: Self = Self {
        ranges: [(0, 0); Self::COUNT_MAX],
    };
    const COUNT_MAX: usize = 10;
    /// Boxes whose bounds a kernel tests together: none are in one cluster with those of another group.
    pub(crate) const GROUP: usize = 32;
    /// Groups of boxes that are divided at most.
    pub(crate) const GROUPS_MAX: usize = 2;
    /// The most boxes that are divided.
    const BOXES_MAX: usize = Self::GROUPS_MAX * Self::GROUP;
    const LENGTH_MIN: usize = 3;

    /// The division with the fewest tests of boxes and bounds for rays that leave `origin` in all directions; no clusters of
    /// more than [`Clusters::BOXES_MAX`] boxes.
    pub(crate) fn new(boxes: &[Bounds], origin: Vec3) -> Self {
        if boxes.len() > Self::BOXES_MAX {
            return Self::NONE;
        }
        // The best division of the first boxes: its cost, and where its last part begins.
        let mut best = vec![(0.0, 0)];
        for end in 1..=boxes.len() {
            // Costs are tests per group of rays: 1 of a single box; of a cluster 1 of its bound, and
            // those of its boxes in the share of groups that meet it.
            let single = (best[end - 1].0 + 1.0, end - 1);
            let cluster = |first: usize| {
                let bound = union(&boxes[first..end]);
                let walked = share_of_groups(bound, origin) * (end - first) as f32;
                (best[first].0 + 1.0 + walked, first)
            };
            let group_first = (end - 1) / Self::GROUP * Self::GROUP;
            let clusters = (group_first..(end + 1).saturating_sub(Self::LENGTH_MIN)).map(cluster);
            best.push(clusters.fold(single, |a, b| if b.0 < a.0 { b } else { a }));
        }
        let mut ranges = Vec::new();
        let mut end = boxes.len();
        while end > 0 {
            let first = best[end].1;
            if end - first > 1 {
                ranges.push((first as u8, (end - first) as u8));
            }
            end = first;
        }
        // The longest ones, if there are too many.
        ranges.sort_by_key(|&(_, length)| std::cmp::Reverse(length));
        ranges.truncate(Self::COUNT_MAX);
        ranges.sort_unstable();
        let mut clusters = Self::NONE;
        clusters.ranges[..ranges.len()].copy_from_slice(&ranges);
        clusters
    }

    /// The boxes of each.
    pub(crate) fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let ranges = self.ranges.iter().filter(|(_, length)| *length > 0);
        ranges.map(|&(first, length)| usize::from(first)..usize::from(first) + usize::from(length))
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.ranges().count()
    }

    /// Their bounds.
    pub(crate) fn bounds(&self, boxes: &[Bounds]) -> Vec<Bounds> {
        self.ranges().map(|range| union(&boxes[range])).collect()
    }
}

fn union(boxes: &[Bounds]) -> Bounds {
    let all = boxes.iter().copied();
    let union = |a: Bounds, b: Bounds| Bounds {
        min: a.min.min(b.min),
        max: a.max.max(b.max),
    };
    all.reduce(union).expect("a cluster has boxes")
}

/// The share of groups of rays from `origin` of which some ray meets a bound.
fn share_of_groups(bound: Bounds, origin: Vec3) -> f32 {
    let to_nearest = origin.clamp(bound.min, bound.max).distance(origin);
    let to_middle = (0.5 * (bound.min + bound.max)).distance(origin);
    let distance = to_nearest.midpoint(to_middle);
    if to_nearest == 0.0 {
        return 1.0;
    }
    let extent = bound.max - bound.min;
    let area = 2.0 * extent.dot(Vec3::new(extent.y, extent.z, extent.x));
    // A convex body shows a quarter of its surface on average (Cauchy).
    let share = 0.25 * area / (4.0 * std::f32::consts::PI * distance * distance);
    // A group enters a cluster for any one of its rays.
    1.0 - (1.0 - share.min(1.0)).powi(RAYS_APART)
}

/// Directions that a group of 32 rays has, as those of neighbours are alike.
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
            [1.0, 0.0, 0.0],
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
        assert!(clusters.ranges().eq(std::iter::once(4..8)));
        let bounds = clusters.bounds(&boxes);
        assert_eq!(bounds[0].min, Vec3::new(8.8, -0.2, -0.2));
        assert_eq!(bounds[0].max, Vec3::new(9.2, 1.7, 0.2));
    }

    #[test]
    fn few_and_many_boxes_are_no_clusters() {
        for count in [0, 1, 2, 65, 70] {
            let all = boxes(&vec![[9.0, 0.0, 0.0]; count], 0.1);
            assert_eq!(Clusters::new(&all, Vec3::ZERO).len(), 0, "{count}");
        }
    }

    #[test]
    fn boxes_that_are_tested_apart_are_in_no_cluster_together() {
        let all = boxes(&[[9.0, 0.0, 0.0]; 45], 0.1);
        let clusters = Clusters::new(&all, Vec3::ZERO);
        assert!(clusters.ranges().eq([0..32, 32..45]));
    }

    #[test]
    fn there_are_at_most_as_many_clusters_as_fit() {
        // Sixteen groups, by turns on either side of the origin.
        let center = |i: u8| {
            let side = if (i / 4).is_multiple_of(2) {
                20.0
            } else {
                -20.0
            };
            [side, 0.1 * f32::from(i), 0.0]
        };
        let centers: Vec<_> = (0..64).map(center).collect();
        let clusters = Clusters::new(&boxes(&centers, 0.05), Vec3::ZERO);
        assert_eq!(clusters.len(), Clusters::COUNT_MAX);
        let mut end = 0;
        for range in clusters.ranges() {
            assert!(range.start >= end && range.len() == 4, "{range:?}");
            end = range.end;
        }
        assert!(end <= 64);
    }
}
