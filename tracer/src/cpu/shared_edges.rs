//! Packets of rays against triangles of small meshes, by their shared vertices and edges.
//!
//! A line intersects a triangle if it passes all three edges on the same side. Most edges belong to two
//! triangles, and most vertices to six: here each is evaluated once per packet, without branches until the
//! lanes that intersect each triangle are known. The edge function of a reversed edge is exactly the
//! negative, because each of its products is rounded separately: hits are bit-identical to those of
//! [`super::triangle::Triangle`].

use std::cell::RefCell;
use std::collections::HashMap;

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x, Word, has_zero};
use super::rays::{INSIDE, Nearest, Rays};
use super::sampling::basis;

/// Indexed triangle mesh with unique vertices and edges.
pub(super) struct SharedEdges {
    vertices: Vec<[f32; 3]>,
    /// Indices of the start and end vertices of each edge.
    edges: Vec<[u8; 2]>,
    triangles: Vec<EdgeTriangle>,
    /// The id of the first triangle.
    first: u32,
}

/// A triangle; side i is the edge opposite to corner i.
struct EdgeTriangle {
    corners: [u8; 3],
    /// Indices into [`Crossed::sides`]: those of reversed edges are offset by [`EDGES_MAX`].
    sides: [u8; 3],
    /// 1, or −1 for reversed edges.
    signs: [f32; 3],
    is_dielectric: bool,
}

/// Largest number of triangles: they are bits of a u64.
const TRIANGLES_MAX: usize = 64;
/// Largest number of vertices: their indices are u8.
const VERTICES_MAX: usize = 256;
/// Largest number of edges: with the reversed ones their indices are u8.
const EDGES_MAX: usize = 128;
/// Largest number of edges per triangle at which sharing pays: that of a square of two triangles.
const EDGES_PER_TRIANGLE_MAX: f32 = 2.5;

/// Results per packet for the rays as infinite lines. Thread-local, because initialising it per packet
/// would take as long as the rest.
struct Crossed {
    /// Coordinates of vertices orthogonal to the rays, and along them.
    x: [Column; VERTICES_MAX],
    y: [Column; VERTICES_MAX],
    along: [Column; VERTICES_MAX],
    /// Edge functions: barycentric weight of the opposite corner times twice the projected area.
    weights: [Column; EDGES_MAX],
    /// Lanes that pass an edge on its left in the lower half, on its right in the upper half; then the same
    /// for the reversed edges.
    sides: [u32; 2 * EDGES_MAX],
    /// Per triangle, the lanes whose line intersects it.
    lanes: [u32; TRIANGLES_MAX],
}

/// One number per lane.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Column([f32; LANES]);

/// Set of the triangles that some line intersects.
struct CrossedTriangles {
    /// Bit mask of the triangles.
    bits: u64,
    /// Whether some line passes exactly through the line of an edge.
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
    /// Builds the mesh from corners and whether triangles are dielectrics, with ids from `first` on; `None`
    /// if there are too many triangles or they share too few edges.
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
                // At most 3 · 64 = 192 vertices, so that indices fit in u8.
                *vertex_index
                    // Only bit-identical corners are merged; merging nearby ones would move the surface.
                    .entry(corner.map(f32::to_bits))
                    .or_insert_with(|| {
                        vertices.push(corner);
                        (vertices.len() - 1) as u8
                    })
            });
            let [a, b, c] = corners;
            let sides = [(b, c), (c, a), (a, b)].map(|(from, to)| {
                // The same direction for both neighbours of an edge: they evaluate the same function, and
                // no ray passes between them.
                let ends = [from.min(to), from.max(to)];
                let edge = *edge_index.entry(ends).or_insert_with(|| {
                    edges.push(ends);
                    edges.len() - 1
                });
                // Wraps only for meshes with too many edges, which are rejected below.
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

    /// Updates `nearest` by hits that are nearer.
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

    /// Sets the lanes in `dark` whose ray hits a triangle before `distance`.
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

    /// Intersects the lines of the rays in `lanes` with all triangles, ahead of the origin or behind it.
    #[inline(always)]
    fn cross<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        lanes: u16,
        crossed: &mut Crossed,
    ) -> CrossedTriangles {
        // Local copies stay in registers, as stores to `crossed` cannot alias them.
        let (origin, direction) = (rays.origin, rays.direction);
        // Orthonormal basis with the ray as third axis: the test becomes that of a point in a 2D triangle.
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
            // A line exactly through an edge counts on both sides. So it hits at least one of the triangles
            // that share the edge, and meshes are watertight.
            let left = function.simd_ge(0.0).to_bitmask() as u32;
            let right = function.simd_le(0.0).to_bitmask() as u32;
            zeros |= left & right;
            *forward = left | right << LANES;
            // Reversing an edge negates its function, which swaps the two comparisons.
            *backward = forward.rotate_left(LANES as u32);
        }
        let mut bits = 0;
        for (index, triangle) in self.triangles.iter().take(TRIANGLES_MAX).enumerate() {
            let [a, b, c] = triangle.sides.map(usize::from);
            // All three edges on the left in the lower half, all three on the right in the upper half.
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

    /// Lanes that hit a triangle before `limit`, and their distances.
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
        // Lines may intersect the triangle behind the ray's origin, which `t` decides below.
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
            // A ray that starts on this triangle inside the body hits it only on its way out, after
            // scattering.
            let within = rays.start.simd_eq(id | INSIDE);
            candidate &= !within | sum.simd_gt(0.0);
        }
        // With a weight of 0 the edge test also accepts points on the extension of an edge: the triangle's
        // bounds across the ray have to contain the line.
        if triangles.has_zero {
            let on_line = a.simd_eq(0.0) | b.simd_eq(0.0) | c.simd_eq(0.0);
            let is_in_bounds = has_zero(triangle.at_corners(simd, &crossed.x))
                & has_zero(triangle.at_corners(simd, &crossed.y));
            candidate &= is_in_bounds | !on_line;
        }
        let [along_a, along_b, along_c] = triangle.at_corners(simd, &crossed.along);
        let t = a.mul_add(along_a, b.mul_add(along_b, c * along_c)) / sum;
        // For a degenerate triangle t is infinite or NaN, and fails the comparisons.
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
    /// Removes the first triangle from the set and returns its index.
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

    /// Triangles of a fan around a corner.
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
