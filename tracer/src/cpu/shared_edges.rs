//! Triangles of small meshes against packets of rays, by the corners and edges that they share.
//!
//! A line goes through a triangle where it passes all three edges on the same side. Most edges are of two triangles, and
//! most corners of six: here each is looked at once a packet, and nothing branches until it is known which lanes go
//! through which triangles. The edge function of an edge the other way round is the same with its sign flipped, exactly,
//! because each of its products is rounded by itself: hits are those of [`super::triangle::Triangle`] bit for bit.

use std::cell::RefCell;
use std::collections::HashMap;

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x, Word, has_zero};
use super::rays::{INSIDE, Nearest, Rays};
use super::sampling::basis;

/// Triangles, with each corner and each edge of theirs once.
pub(super) struct SharedEdges {
    vertices: Vec<[f32; 3]>,
    /// The vertices at which each edge begins and ends.
    edges: Vec<[u8; 2]>,
    triangles: Vec<EdgeTriangle>,
    /// The id of the first triangle.
    first: u32,
}

/// A triangle by the edge opposite to each of its corners.
struct EdgeTriangle {
    corners: [u8; 3],
    /// Indices into [`Crossed::sides`].
    sides: [u8; 3],
    /// −1 of edges the other way round.
    signs: [f32; 3],
    is_dielectric: bool,
}

/// The most triangles: a bit each.
const TRIANGLES_MAX: usize = 64;
/// The most vertices.
const VERTICES_MAX: usize = 256;
/// The most edges.
const EDGES_MAX: usize = 128;
/// Edges a triangle may have beside others: as many as a square of two has.
const EDGES_PER_TRIANGLE_MAX: f32 = 2.5;

/// What the rays of a packet, taken as lines, go through. Kept by each thread: to clear it each time would take as long
/// as the rest.
struct Crossed {
    /// Where vertices are across the rays, and how far along.
    x: [Column; VERTICES_MAX],
    y: [Column; VERTICES_MAX],
    along: [Column; VERTICES_MAX],
    /// Edge functions.
    weights: [Column; EDGES_MAX],
    /// In the lower half the lanes that an edge passes on the left, in the upper on the right; then the same of edges the
    /// other way round.
    sides: [u32; 2 * EDGES_MAX],
    /// By triangle, the lanes that go through it.
    lanes: [u32; TRIANGLES_MAX],
}

/// A number per lane.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Column([f32; LANES]);

/// Which triangles are gone through.
struct CrossedTriangles {
    /// A bit for each.
    bits: u64,
    /// Some line goes through that of an edge.
    has_zero: bool,
}

thread_local! {
    static CROSSED: RefCell<Crossed> = const { RefCell::new(Crossed::ZERO) };
}

impl Crossed {
    const ZERO: Self = {
        let zero = Column([0.0; LANES]);
        Self {
            x: [zero; VERTICES_MAX],
            y: [zero; VERTICES_MAX],
            along: [zero; VERTICES_MAX],
            weights: [zero; EDGES_MAX],
            sides: [0; 2 * EDGES_MAX],
            lanes: [0; TRIANGLES_MAX],
        }
    };
}

impl Column {
    #[inline(always)]
    fn load<S: Simd>(&self, simd: S) -> Float<S> {
        Float::load_array(simd, self.0)
    }

    #[inline(always)]
    fn store<S: Simd>(&mut self, numbers: Float<S>) {
        numbers.store_slice(&mut self.0);
    }
}

impl SharedEdges {
    /// Of triangles with ids from `first` on, by their corners and whether they are dielectrics; none if they are too
    /// many or share too little.
    pub(super) fn new(
        triangles: impl ExactSizeIterator<Item = ([[f32; 3]; 3], bool)>,
        first: u32,
    ) -> Option<Self> {
        let count = triangles.len();
        if count > TRIANGLES_MAX {
            return None;
        }
        let (mut vertex_index, mut edge_index) = (HashMap::new(), HashMap::new());
        let (mut vertices, mut edges) = (Vec::new(), Vec::<[u8; 2]>::new());
        let triangles = triangles.map(|(corners, is_dielectric)| {
            let corners = corners.map(|corner| {
                // At most 192.
                *vertex_index
                    // Shared are corners of the same bits. Nearby ones would change what is hit.
                    .entry(corner.map(f32::to_bits))
                    .or_insert_with(|| {
                        vertices.push(corner);
                        (vertices.len() - 1) as u8
                    })
            });
            let [a, b, c] = corners;
            let sides = [(b, c), (c, a), (a, b)].map(|(from, to)| {
                // One direction for both neighbours of an edge: they see the same function, and no ray
                // slips between them.
                let ends = [from.min(to), from.max(to)];
                let edge = *edge_index.entry(ends).or_insert_with(|| {
                    edges.push(ends);
                    edges.len() - 1
                });
                // Wrong only of meshes with too many edges, which are refused below.
                (edge % EDGES_MAX + if from > to { EDGES_MAX } else { 0 }) as u8
            });
            EdgeTriangle {
                corners,
                sides,
                signs: sides.map(|side| {
                    if usize::from(side) < EDGES_MAX {
                        1.0
                    } else {
                        -1.0
                    }
                }),
                is_dielectric,
            }
        });
        let triangles = triangles.collect();
        let is_shared = edges.len() as f32 <= EDGES_PER_TRIANGLE_MAX * count as f32;
        (edges.len() <= EDGES_MAX && is_shared).then_some(Self {
            vertices,
            edges,
            triangles,
            first,
        })
    }

    /// Takes what rays meet before what they have met.
    #[inline(never)]
    pub(super) fn nearest<S: Simd>(&self, simd: S, rays: &Rays<S>, nearest: &mut Nearest<S>) {
        CROSSED.with_borrow_mut(|crossed| {
            simd.vectorize(
                #[inline(always)]
                || self.nearest_inline(simd, rays, crossed, nearest),
            );
        });
    }

    #[inline(always)]
    fn nearest_inline<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        crossed: &mut Crossed,
        nearest: &mut Nearest<S>,
    ) {
        let mut triangles = self.cross(simd, rays, u16::MAX, crossed);
        let (mut distance, mut id) = (nearest.distance, nearest.id);
        while let Some(index) = triangles.next() {
            let (hit, t) = self.meet(simd, rays, crossed, &triangles, index, distance);
            distance = hit.select(t, distance);
            id = hit.select(Word::splat(simd, self.first + index as u32), id);
        }
        *nearest = Nearest { distance, id };
    }

    /// Adds where a triangle lies before `distance` to `dark`.
    #[inline(never)]
    pub(super) fn occlude<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        distance: Float<S>,
        dark: &mut Mask<S>,
    ) {
        CROSSED.with_borrow_mut(|crossed| {
            simd.vectorize(
                #[inline(always)]
                || self.occlude_inline(simd, rays, crossed, distance, dark),
            );
        });
    }

    #[inline(always)]
    fn occlude_inline<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        crossed: &mut Crossed,
        distance: Float<S>,
        dark: &mut Mask<S>,
    ) {
        let lit = distance.simd_gt(0.0) & !*dark;
        let mut triangles = self.cross(simd, rays, lit.to_bitmask() as u16, crossed);
        let mut hits = *dark;
        while let Some(index) = triangles.next() {
            let (hit, _) = self.meet(simd, rays, crossed, &triangles, index, distance);
            hits |= hit;
        }
        *dark = hits;
    }

    /// What the rays of `lanes` go through, ahead or behind.
    #[inline(always)]
    fn cross<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        lanes: u16,
        crossed: &mut Crossed,
    ) -> CrossedTriangles {
        // Copies, which stay in registers whatever is stored.
        let (origin, direction) = (rays.origin, rays.direction);
        let (u, v) = basis(simd, direction);
        let columns = (crossed.x.iter_mut())
            .zip(&mut crossed.y)
            .zip(&mut crossed.along);
        for (((x, y), along), vertex) in columns.zip(&self.vertices) {
            let p = Vec3x::splat(simd, *vertex) - origin;
            x.store(u.dot(p));
            y.store(v.dot(p));
            along.store(direction.dot(p));
        }
        let mut zeros = 0;
        let (forward, backward) = crossed.sides.split_at_mut(EDGES_MAX);
        let columns = (crossed.weights.iter_mut()).zip(forward).zip(backward);
        for (((weight, forward), backward), [from, to]) in columns.zip(&self.edges) {
            let (from, to) = (usize::from(*from), usize::from(*to));
            let [from_x, to_x] = [crossed.x[from].load(simd), crossed.x[to].load(simd)];
            let [from_y, to_y] = [crossed.y[from].load(simd), crossed.y[to].load(simd)];
            let function = from_x * to_y - from_y * to_x;
            weight.store(function);
            // A line through an edge passes it on both sides. So it meets at least one of the triangles
            // that share the edge: meshes are watertight.
            let left = function.simd_ge(0.0).to_bitmask() as u32;
            let right = function.simd_le(0.0).to_bitmask() as u32;
            zeros |= left & right;
            *forward = left | right << LANES;
            // Swapping the halves is what the flipped sign does to the two comparisons.
            *backward = forward.rotate_left(LANES as u32);
        }
        let mut bits = 0;
        for (index, triangle) in self.triangles.iter().take(TRIANGLES_MAX).enumerate() {
            let [a, b, c] = triangle.sides.map(usize::from);
            // All three on the left in the lower half, all three on the right in the upper one.
            let same = crossed.sides[a] & crossed.sides[b] & crossed.sides[c];
            let through = (same | same >> LANES) & u32::from(lanes);
            crossed.lanes[index] = through;
            bits |= u64::from(through != 0) << index;
        }
        CrossedTriangles {
            bits,
            has_zero: zeros != 0,
        }
    }

    /// Where the lanes that go through a triangle meet it before `limit`.
    #[inline(always)]
    fn meet<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        crossed: &Crossed,
        triangles: &CrossedTriangles,
        index: usize,
        limit: Float<S>,
    ) -> (Mask<S>, Float<S>) {
        let triangle = &self.triangles[index];
        let id = self.first + index as u32;
        // Which side the hits lie on is not known yet: lines go through what is behind their origins too.
        let mut candidate = Mask::from_bitmask(simd, u64::from(crossed.lanes[index]));
        candidate &= rays.start.simd_ne(id);
        let weights = [
            triangle.weight(simd, crossed, 0),
            triangle.weight(simd, crossed, 1),
            triangle.weight(simd, crossed, 2),
        ];
        let [a, b, c] = weights;
        let sum = a + b + c;
        if triangle.is_dielectric {
            let within = rays.start.simd_eq(id | INSIDE);
            candidate &= !within | sum.simd_gt(0.0);
        }
        if triangles.has_zero {
            let on_line = a.simd_eq(0.0) | b.simd_eq(0.0) | c.simd_eq(0.0);
            let is_in_bounds = has_zero(triangle.at_corners(simd, &crossed.x))
                & has_zero(triangle.at_corners(simd, &crossed.y));
            candidate &= is_in_bounds | !on_line;
        }
        let [along_a, along_b, along_c] = triangle.at_corners(simd, &crossed.along);
        let t = a.mul_add(along_a, b.mul_add(along_b, c * along_c)) / sum;
        // Without an area t is infinite or no number, and not before the limit.
        (candidate & t.simd_gt(0.0) & t.simd_lt(limit), t)
    }
}

impl EdgeTriangle {
    #[inline(always)]
    fn weight<S: Simd>(&self, simd: S, crossed: &Crossed, corner: usize) -> Float<S> {
        let edge = usize::from(self.sides[corner]) % EDGES_MAX;
        crossed.weights[edge].load(simd) * self.signs[corner]
    }

    #[inline(always)]
    fn at_corners<S: Simd>(&self, simd: S, columns: &[Column; VERTICES_MAX]) -> [Float<S>; 3] {
        let [a, b, c] = self.corners;
        [
            columns[usize::from(a)].load(simd),
            columns[usize::from(b)].load(simd),
            columns[usize::from(c)].load(simd),
        ]
    }
}

impl CrossedTriangles {
    /// The index of the next triangle.
    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let index = self.bits.trailing_zeros() as usize;
        if self.bits == 0 {
            return None;
        }
        self.bits &= self.bits - 1;
        Some(index % TRIANGLES_MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a fan round a corner.
    fn fan(count: usize) -> impl ExactSizeIterator<Item = ([[f32; 3]; 3], bool)> {
        (0..count).map(|i| {
            (
                [[0.0; 3], [1.0, i as f32, 0.0], [1.0, (i + 1) as f32, 0.0]],
                false,
            )
        })
    }

    #[test]
    fn each_corner_and_each_edge_is_kept_once() {
        let shared = SharedEdges::new(fan(10), 5).unwrap();
        assert_eq!((shared.vertices.len(), shared.edges.len()), (12, 21));
        for triangle in &shared.triangles {
            for (corner, side) in triangle.sides.into_iter().enumerate() {
                let from = triangle.corners[(corner + 1) % 3];
                let to = triangle.corners[(corner + 2) % 3];
                let ends = shared.edges[usize::from(side) % EDGES_MAX];
                let is_forward = triangle.signs[corner] > 0.0;
                assert_eq!(ends, if is_forward { [from, to] } else { [to, from] });
            }
        }
    }

    #[test]
    fn triangles_that_are_many_or_share_nothing_are_left_to_others() {
        assert!(
            SharedEdges::new(fan(TRIANGLES_MAX), 0).is_none(),
            "too many edges"
        );
        assert!(SharedEdges::new(fan(TRIANGLES_MAX + 1), 0).is_none());
        let apart = [0.0f32, 1.0, 2.0].map(|z| {
            let corners = [[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z]];
            (corners, false)
        });
        assert!(SharedEdges::new(apart.into_iter(), 0).is_none());
    }
}
